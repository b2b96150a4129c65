"""Modes where joints rub: what sticks is held, what slides has a derivative."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.solver import compile_scene
from sidtool.solver.analyses.linearisation import Linearisation, linearise
from tests.codes import only

from ..dynamics.joint_scenes import scene

G = 9.81


def vector(dimension: str, x: float, y: float) -> list[float]:
    return [x, y] if dimension == "planar" else [x, y, 0.0]


def modes(dimension: str, about: str, **tables: Any) -> Linearisation:
    made = scene(dimension, 1.0, **tables)
    return linearise(compile_scene(made, ".", keep_joints=True), about)


# --- what sticks is held --------------------------------------------------------------

UPPER, LOWER = {"m": 2.0, "l": 0.3, "I": 0.02}, {"m": 1.1, "l": 0.25, "I": 0.03}


def two_links(dimension: str, coefficient: float, **more: Any) -> Linearisation:
    """A double pendulum with friction in its upper joint, about its equilibrium."""
    plane = dimension == "planar"

    def link(data: dict[str, float], y: float) -> dict[str, Any]:
        inertia = data["I"] if plane else [0.02, 0.025, data["I"]]
        ends = {"a": data["l"], "b": -data["l"]}
        markers = {k: {"position": vector(dimension, 0, x)} for k, x in ends.items()}
        start = {"position": vector(dimension, 0.0, y)}
        return {
            "mass": data["m"],
            "inertia": inertia,
            "markers": markers,
            "initial": start,
        }

    below = -2.0 * UPPER["l"] - LOWER["l"]
    law = {"coefficient": coefficient, "radius": 0.04, **more}
    return modes(
        dimension,
        "static",
        gravity=vector(dimension, 0.0, -G),
        bodies={"upper": link(UPPER, -UPPER["l"]), "lower": link(LOWER, below)},
        joints={
            "top": {"type": "revolute", "markers": ["ground", "upper.a"]},
            "mid": {
                "type": "revolute",
                "markers": ["upper.b", "lower.a"],
                "friction": law,
            },
        },
    )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_joint_that_sticks_is_held(dimension: str) -> None:
    """Both links swing as one body: what is left is its physical pendulum."""
    found = two_links(dimension, 0.2)
    low = 2.0 * UPPER["l"] + LOWER["l"]
    moment = UPPER["m"] * UPPER["l"] + LOWER["m"] * low
    inertia = UPPER["I"] + UPPER["m"] * UPPER["l"] ** 2
    inertia += LOWER["I"] + LOWER["m"] * low**2
    known = np.sqrt(moment * G / inertia)
    assert found.eigenvalues == pytest.approx([1j * known], rel=1e-7)
    held = only(found, "N514")
    assert (held.subject, held.data["state"]) == ("mid", "holds")


# --- a block on a belt: friction falls with speed, and the load with the way ----------

MASS, STIFF, TILT, BELT = 1.7, 900.0, 0.6, 0.5
SLIDING, REST, WIDTH, VISCOUS = 0.25, 0.45, 0.6, 1.3


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize(("sense", "tilt"), [(1.0, TILT), (-1.0, TILT), (1.0, -TILT)])
def test_a_block_that_slides_on_a_belt(
    dimension: str, sense: float, tilt: float
) -> None:
    """m x'' = cos (f - k x) + t, t = -s mu(x' - V) (m g - sin (f - k x)) - d (x' - V).

    The force f - k x also presses the block on the belt, or lifts it.
    """
    c, s, speed = np.cos(tilt), np.sin(tilt), sense * BELT
    more = (REST - SLIDING) * np.exp(-((BELT / WIDTH) ** 2))
    mu = SLIDING + more
    pull = -(sense * mu * MASS * G + VISCOUS * speed) / (c - sense * mu * s)
    load = MASS * G - s * pull
    falls = 2.0 * BELT / WIDTH**2 * more * load
    polynomial = [MASS, VISCOUS - falls, STIFF * (c - sense * mu * s)]
    inertia = 0.1 if dimension == "planar" else [0.1] * 3
    drive = {"type": "polynomial", "pieces": [{"from": 0, "coefficients": [0, speed]}]}
    law = {"type": "expression", "value": f"{pull!r} - {STIFF}*block.x"}
    law["value"] = law["value"].replace("np.float64(", "").replace(")", "")
    found = modes(
        dimension,
        "start",
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "belt": {
                "mass": 3.0,
                "inertia": inertia,
                "initial": {"velocity": vector(dimension, speed, 0.0)},
            },
            "block": {"mass": MASS, "inertia": inertia},
        },
        joints={
            "run": {"type": "prismatic", "markers": ["ground", "belt"]},
            "slide": {
                "type": "prismatic",
                "markers": ["belt", "block"],
                "friction": {
                    "coefficient": SLIDING,
                    "static": REST,
                    "stribeck_velocity": WIDTH,
                    "viscous": VISCOUS,
                },
            },
        },
        drives={"motor": {"joint": "run", "function": drive}},
        forces={
            "push": {
                "type": "force",
                "marker": "block",
                "force": vector(dimension, c, s),
                "function": law,
            }
        },
    )
    known = [root for root in np.roots(polynomial) if root.imag > 0.0]
    assert len(known) == 1
    assert found.eigenvalues == pytest.approx(known, rel=1e-6)
    sliding = only(found, "N514")
    assert (sliding.subject, sliding.data["state"]) == ("slide", "slides")


# --- states without an answer ---------------------------------------------------------


def block_at_rest(slope: float, gravity: float = G) -> Linearisation:
    """A block on an incline, and a pendulum on it."""
    return modes(
        "planar",
        "start",
        gravity=[-gravity * np.sin(slope), -gravity * np.cos(slope)],
        bodies={
            "block": {"mass": 2.0, "inertia": 0.1},
            "bob": {
                "mass": 1e-3,
                "markers": {},
                "initial": {"position": [-0.4 * np.sin(slope), -0.4 * np.cos(slope)]},
            },
        },
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "friction": {"coefficient": 0.3, "static": 0.4},
            },
            "thread": {"type": "distance", "markers": ["block", "bob"]},
        },
    )


def test_a_block_that_friction_holds_on_an_incline() -> None:
    """The pendulum swings as if its support were the ground."""
    found = block_at_rest(0.35)
    assert found.eigenvalues == pytest.approx([1j * np.sqrt(G / 0.4)], rel=1e-6)


def test_states_beside_which_friction_has_no_derivative_are_refused() -> None:
    with pytest.raises(InputError, match="rail rests .* friction cannot hold it there"):
        block_at_rest(0.5)
    with pytest.raises(InputError, match="rail carries no load in this state"):
        block_at_rest(0.0, gravity=0.0)
