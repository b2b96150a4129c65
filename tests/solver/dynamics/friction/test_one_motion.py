"""Joints with friction that hold one motion together: two feet, a wedge, a brake.

How such joints share what they hold is open. Whether they hold it follows from sliding:
they stick where friction at its limit would brake a motion in either sense.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.solver.dynamics.friction.rubbed import (
    ENERGIES,
    G,
    assert_balanced,
    assert_changes,
    simulate,
)
from tests.solver.dynamics.friction.stick_slip import Rub


def sliding(
    acceleration: Callable[[float, float, float, bool], float],
) -> Rub:
    """A motion by its acceleration (sense, t, x, with the friction of rest)."""

    def ends(t: float, x: float) -> tuple[float, float]:
        return acceleration(1.0, t, x, True), acceleration(-1.0, t, x, True)

    return Rub(
        lambda t, x: -sum(ends(t, x)) / 2.0,
        lambda t, x: (ends(t, x)[1] - ends(t, x)[0]) / 2.0,
        lambda t, x, v, s: acceleration(s, t, x, False),
    )


def harmonic_push(marker: str, offset: float, amplitude: float) -> dict[str, Any]:
    """A force along x, harmonic with 1 Hz."""
    function = {
        "type": "harmonic",
        "offset": offset,
        "amplitude": amplitude,
        "frequency": 1.0,
    }
    force = {"type": "force", "marker": marker, "force": [1.0, 0.0]}
    return force | {"function": function}


@pytest.mark.parametrize("rest", [1.0, 1.3])
@pytest.mark.parametrize("height", [0.0, 0.25])
def test_a_block_on_two_feet(rest: float, height: float) -> None:
    """The push tilts the load from one foot to the other, of two coefficients."""
    mass, front, back, centre, mu = 3.0, 0.3, 0.5, 0.2, np.array([0.2, 0.4])
    feet = {"front": [front, 0.0], "back": [-back, 0.0], "push": [0.0, height]}

    def acceleration(s: float, t: float, x: float, at_rest: bool) -> float:
        push = 12.0 * np.sin(2.0 * np.pi * t)
        a, b = s * mu * (rest if at_rest else 1.0)
        load = mass * G * (back + b * centre) + (height - centre) * push
        load /= front + back + (b - a) * centre
        return float(push - a * load - b * (mass * G - load)) / mass

    result = simulate(
        "planar",
        1.0,
        gravity=[0.0, -G],
        bodies={
            "block": {
                "mass": mass,
                "inertia": 0.05,
                "centre_of_mass": [0.0, centre],
                "markers": {name: {"position": place} for name, place in feet.items()},
            }
        },
        joints={
            name: {
                "type": "point_on_line",
                "markers": ["ground", f"block.{name}"],
                "friction": {"coefficient": m, "static": rest * m},
            }
            for name, m in zip(("front", "back"), mu, strict=True)
        },
        forces={"push": harmonic_push("block.push", 0.0, 12.0)},
        outputs={"record": ["block.x", *ENERGIES]},
    )
    known = sliding(acceleration).motion(0.0, 0.0, 1.0)
    assert len(known) >= 3
    assert_changes(result, "front", known, 1e-8)
    assert_changes(result, "back", known, 1e-8)
    assert_balanced(result, 1e-7)


@pytest.mark.parametrize("mu", [(0.2, 0.1, 0.16), (0.1, 0.0, 0.1)])
def test_a_wedge_that_lifts_a_ram(mu: tuple[float, ...]) -> None:
    """Three guides rub: of base, column and face, the second one self-locking."""
    slope, wedge, ram, stiffness = 0.22, 2.0, 5.0, 2000.0
    sine, cosine = np.sin(slope), np.cos(slope)

    def acceleration(s: float, t: float, x: float, at_rest: bool) -> float:
        push = 60.0 + 90.0 * np.sin(2.0 * np.pi * t) - stiffness * x
        base, column, face = s * np.array(mu)
        up, across = cosine - face * sine, sine + face * cosine
        lever = (base * up + across) / (up - column * abs(across))
        force = push - base * wedge * G - lever * ram * G
        return float(force / (wedge + lever * ram * np.tan(slope)))

    def guide(markers: list[str], axis: list[float], m: float) -> dict[str, Any]:
        law = {"coefficient": m}
        return {"type": "prismatic", "markers": markers, "axis": axis, "friction": law}

    result = simulate(
        "planar",
        1.0,
        gravity=[0.0, -G],
        bodies={
            "wedge": {"mass": wedge, "inertia": 0.05},
            "ram": {"mass": ram, "inertia": 0.05},
        },
        joints={
            "base": guide(["ground", "wedge"], [1.0, 0.0], mu[0]),
            "column": guide(["ground", "ram"], [0.0, 1.0], mu[1]),
            "face": guide(["wedge", "ram"], [cosine, -sine], mu[2]),
        },
        forces={
            "push": harmonic_push("wedge", 60.0, 90.0),
            "spring": {
                "type": "spring_damper",
                "joint": "base",
                "stiffness": stiffness,
            },
        },
        outputs={"record": ["wedge.x", *ENERGIES]},
    )
    known = [c for c in sliding(acceleration).motion(0.0, 0.0, 1.0) if c[1] > 0.0]
    assert len(known) >= 3
    assert_changes(result, "face", known, 1e-8)
    assert_balanced(result, 1e-7)


@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_a_rod_that_a_lever_brakes(speed: float) -> None:
    """It comes to rest without a load along it: nothing has to be shared."""
    arm, height, pull, mu, guide = 0.3, 0.05, 20.0, 0.3, 0.1
    result = simulate(
        "planar",
        1.0,
        ground={"markers": {"pivot": {"position": [0.0, height]}}},
        bodies={
            "rod": {
                "mass": 4.0,
                "inertia": 0.5,
                "initial": {"velocity": [speed, 0.0]},
            },
            "lever": {
                "mass": 1.0,
                "inertia": 0.02,
                "markers": {
                    "pad": {"position": [arm, -height]},
                    "pull": {"position": [0.5, 0.0]},
                },
                "initial": {"position": [0.0, height]},
            },
        },
        joints={
            "guide": {
                "type": "prismatic",
                "markers": ["ground", "rod"],
                "friction": {"coefficient": guide},
            },
            "pivot": {"type": "revolute", "markers": ["ground.pivot", "lever"]},
            "pad": {
                "type": "point_on_line",
                "markers": ["rod", "lever.pad"],
                "friction": {"coefficient": mu},
            },
        },
        forces={
            "pull": {"type": "force", "marker": "lever.pull", "force": [0.0, -pull]}
        },
        outputs={"record": ["rod.x", *ENERGIES]},
    )
    sense = np.sign(speed)
    load = 0.5 * pull / (arm + sense * mu * height)
    braking = (mu + guide) * load / 4.0
    stop = [("stick", abs(speed) / braking, sense * speed**2 / (2.0 * braking))]
    assert result.completed
    assert_changes(result, "pad", stop, 1e-9)
    assert_changes(result, "guide", stop, 1e-9)
    assert result["rod.x"][-1] == pytest.approx(stop[0][2], abs=1e-10)
