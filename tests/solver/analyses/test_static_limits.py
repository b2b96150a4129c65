"""Equilibria at limits of controllers, and modes about corners of forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import Equilibrium, static_equilibrium
from sidtool.solver.system.errors import SimulationError
from tests.codes import codes, only
from tests.solver.scenes import compiled, scene

G, MASS, ARM = 9.81, 3.0, 0.4
PLACE = -0.52


def rested(turning: bool, limit: float, i: float, **forces: Any) -> Equilibrium:
    """A box that slides along y, or an arm that turns, both falling, with a motor that
    holds it at zero as far as it can."""
    body: dict[str, Any] = {"mass": MASS, "inertia": 0.1}
    guide: dict[str, Any] = {"type": "prismatic", "axis": [0.0, 1.0]}
    name = "guide.displacement"
    if turning:
        body |= {"centre_of_mass": [ARM, 0.0]}
        guide, name = {"type": "revolute"}, "guide.angle"
    pid = {"type": "pid", "measured": name, "p": 900.0, "d": 20.0, "i": i}
    motor = {"type": "actuator", "joint": "guide"}
    motor["function"] = pid | {"limits": [-limit, limit]}
    for force in forces.values():
        force["joint"] = "guide"
    described = scene(
        {"body": body},
        {"guide": guide | {"markers": ["ground", "body"]}},
        forces={"motor": motor, **forces},
        gravity=[0.0, -G],
        record=["body.y"],
    )
    return static_equilibrium(compiled(described))


def stop(load: float) -> dict[str, Any]:
    """A buffer from -0.5 downwards, which bears a load at `PLACE`."""
    deflection, force = [-1.5, PLACE, -0.5, 1.0], [-100.0 * load, -load, 0.0, 0.0]
    table = {"deflection": deflection, "force": force}
    return {"type": "spring_damper", "table": table}


@pytest.mark.parametrize("i", [0.0, 300.0])
@pytest.mark.parametrize("limit", [8.0, 20.0])
def test_a_weak_lift_comes_to_rest_on_its_buffer(limit: float, i: float) -> None:
    found = rested(False, limit, i, stop=stop(MASS * G - limit))
    assert found.z[1] == pytest.approx(PLACE, rel=1e-8)
    at_limit = only(found, "N511")
    assert at_limit.subject == "motor" and at_limit.data["limit"] == limit


@pytest.mark.parametrize("i", [0.0, 300.0])
def test_a_weak_motor_lets_an_arm_hang_askew(i: float) -> None:
    """m g r cos(angle) is what it can bear; with a buffer, what both can."""
    found = rested(True, 5.0, i)
    assert np.cos(found.z[2]) == pytest.approx(5.0 / (MASS * G * ARM), rel=1e-8)
    left = MASS * G * ARM * np.cos(PLACE) - 5.0
    found = rested(True, 5.0, i, stop=stop(left))
    assert found.z[2] == pytest.approx(PLACE, rel=1e-8)


@pytest.mark.parametrize("i", [0.0, 300.0])
def test_a_strong_motor_holds_and_says_nothing_of_limits(i: float) -> None:
    found = rested(False, 50.0, i)
    place = 0.0 if i else -MASS * G / 900.0
    assert found.z[1] == pytest.approx(place, abs=1e-9)
    assert "N511" not in codes(found)


@pytest.mark.parametrize("i", [0.0, 300.0])
def test_what_no_motor_can_hold_is_named(i: float) -> None:
    with pytest.raises(SimulationError) as failure:
        rested(False, 20.0, i)
    none, limit = failure.value.diagnostics
    assert (none.code, none.data["body"]) == ("N701", "body")
    assert (limit.code, limit.subject) == ("N511", "motor")


@pytest.mark.parametrize(
    ("position", "named"),
    [(0.0, "damper, stop"), (0.001, "damper"), (-0.001, "damper")],
)
def test_modes_name_forces_with_a_corner_at_the_state(
    position: float, named: str
) -> None:
    """A stop that is touched, and a damper of two slopes at rest: sqrt(k / m) has the
    mean stiffness at the corner, that of one side beside it."""
    soft, hard, own, damping = 200.0, 1000.0, 1e4, 0.5
    stop = {"deflection": [-0.1, 0.0, 0.1], "force": [-0.1 * soft, 0.0, 0.1 * hard]}
    law = f"-{damping}*body.vx - {damping}*min(body.vx, 0)"
    described = scene(
        {
            "body": {
                "mass": MASS,
                "inertia": 0.1,
                "initial": {"position": [position, 0]},
            }
        },
        {"guide": {"type": "prismatic", "axis": [1, 0], "markers": ["ground", "body"]}},
        forces={
            "stop": {"type": "spring_damper", "joint": "guide", "table": stop},
            "spring": {"type": "spring_damper", "joint": "guide", "stiffness": own},
            "damper": {
                "type": "actuator",
                "joint": "guide",
                "function": {"type": "expression", "value": law},
            },
        },
        record=["body.x"],
    )
    modes = linearise(compiled(described), "start", frozen=True)
    assert only(modes, "N745").subject == named
    k = own + {0.0: (soft + hard) / 2, 0.001: hard, -0.001: soft}[position]
    seen = 2.0 * np.pi * modes.frequencies[0]
    assert seen == pytest.approx(np.sqrt(k / MASS), rel=1e-6)


@pytest.mark.parametrize(
    ("law", "jumps"),
    [
        ("-0.005*sign(body.vx)", True),
        ("-0.005*tanh(body.vx/1e-7)", False),
        ("-0.005*tanh(body.vx/1e-4)", False),
        ("-2*body.vx", False),
    ],
)
def test_dry_friction_at_rest_has_no_slope(law: str, jumps: bool) -> None:
    """One that tanh rounds has one: the fast motion decays with F / (v0 m)."""
    described = scene(
        {"body": {"mass": MASS, "inertia": 0.1}},
        {"guide": {"type": "prismatic", "axis": [1, 0], "markers": ["ground", "body"]}},
        forces={
            "spring": {"type": "spring_damper", "joint": "guide", "stiffness": 0.01},
            "guide_friction": {
                "type": "actuator",
                "joint": "guide",
                "function": {"type": "expression", "value": law},
            },
        },
        record=["body.x"],
    )
    modes = linearise(compiled(described))
    if jumps:
        assert only(modes, "N745").subject == "guide_friction"
        return
    assert "N745" not in codes(modes)
    slopes = {"-0.005*tanh(body.vx/1e-7)": 5e4, "-0.005*tanh(body.vx/1e-4)": 50.0}
    wanted = np.roots([MASS, slopes.get(law, 2.0), 0.01])
    assert modes.eigenvalues.real.min() == pytest.approx(wanted.min(), rel=1e-6)


@pytest.mark.parametrize("stiffness", [50.0, 1e3, 1e6, 1e8])
@pytest.mark.parametrize("gravity", [0.0, G])
def test_a_spring_between_markers_has_no_corner(
    stiffness: float, gravity: float
) -> None:
    """To both sides of its line it is stretched alike, by the square of the way: that
    is a curve, whatever the load. A mass on it swings with sqrt(k / m)."""
    spring = {"type": "spring_damper", "markers": ["ground", "body"], "rest": 0.5}
    described = scene(
        {"body": {"mass": MASS, "initial": {"position": [0.0, -0.5]}}},
        {},
        forces={"spring": spring | {"stiffness": stiffness}},
        gravity=[0.0, -gravity],
        record=["body.y"],
    )
    modes = linearise(compiled(described))
    assert "N745" not in codes(modes)
    fastest = 2.0 * np.pi * modes.frequencies.max()
    assert fastest == pytest.approx(np.sqrt(stiffness / MASS), rel=1e-6)
