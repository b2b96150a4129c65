"""Friction without an answer, or with too many, is named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result
from sidtool.solver import compile_scene
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.system.errors import SimulationError
from tests.codes import only
from tests.solver.dynamics.friction.rubbed import (
    ENERGIES,
    G,
    assert_balanced,
    changes,
    simulate,
    vector,
)
from tests.solver.dynamics.joint_scenes import scene


def door(hinges: int, **law: Any) -> dict[str, Any]:
    places = {f"h{k}": {"position": [0.0, 0.0, 0.4 * k]} for k in range(hinges)}
    law = {"coefficient": 0.1, "radius": 0.01, **law}
    return {
        "gravity": [0.0, -G, 0.0],
        "ground": {"markers": places},
        "bodies": {
            "door": {"mass": 3.0, "inertia": [0.2, 0.2, 0.2], "markers": places}
        },
        "joints": {
            f"hinge{k}": {
                "type": "revolute",
                "markers": [f"ground.h{k}", f"door.h{k}"],
                **({"friction": law} if k == 0 else {}),
            }
            for k in range(hinges)
        },
        "outputs": {"record": ["hinge0.normal_force"]},
    }


def test_an_indeterminate_load_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="hinge0 is statically indeterminate") as error:
        simulate("spatial", 0.1, **door(2))
    assert "hinge1" in str(error.value)
    simulate("spatial", 0.1, **door(1))


def test_redundant_constraints_that_do_not_load_the_bearing_are_no_matter() -> None:
    """Four spatial revolute joints in a plane: what lies along their axes is redundant.

    The load across them is determined, and the motion that of the planar scene.
    """

    def four_bar(dimension: str) -> Result:
        plane = dimension == "planar"
        inertia = 0.02 if plane else [0.02, 0.02, 0.02]
        corners = [(0.0, 0.0), (0.0, 0.5), (0.9, 0.8), (1.0, 0.0)]
        bodies, joints = {}, {}
        for k, name in enumerate(("left", "top", "right")):
            (x0, y0), (x1, y1) = corners[k], corners[k + 1]
            half = [(x1 - x0) / 2, (y1 - y0) / 2]
            bodies[name] = {
                "mass": 1.0 + k,
                "inertia": inertia,
                "markers": {
                    "a": {"position": vector(dimension, -half[0], -half[1])},
                    "b": {"position": vector(dimension, *half)},
                },
                "initial": {
                    "position": vector(dimension, (x0 + x1) / 2, (y0 + y1) / 2)
                },
            }
        ends = ["ground", "left.a", "left.b", "top.a", "top.b", "right.a", "right.b"]
        pairs = zip(ends[::2], [*ends[1::2], "ground.end"], strict=True)
        law = {"coefficient": 0.3, "radius": 0.04}
        for k, pair in enumerate(pairs):
            joints[f"pin{k}"] = {
                "type": "revolute",
                "markers": list(pair),
                "friction": law,
            }
        return simulate(
            dimension,
            1.0,
            gravity=vector(dimension, 0.0, -G),
            ground={"markers": {"end": {"position": vector(dimension, 1.0, 0.0)}}},
            bodies=bodies,
            joints=joints,
            outputs={"record": [f"pin{k}.angle" for k in range(4)] + ENERGIES},
        )

    plane, space = four_bar("planar"), four_bar("spatial")
    assert_balanced(plane, 1e-8)
    np.testing.assert_allclose(space.values[:, :4], plane.values[:, :4], atol=1e-7)
    assert len(changes(plane, "pin0")) == len(changes(space, "pin0"))


def leaning_rod(
    mu: float, angle: float, spin: float, speed: float, **options: Any
) -> Result:
    """Painleve's rod: its tip slides over the ground that it leans forward on."""
    half = 0.5
    x, y = half * np.cos(angle), half * np.sin(angle)
    return simulate(
        "planar",
        0.1,
        gravity=[0.0, -G],
        bodies={
            "rod": {
                "mass": 1.0,
                "inertia": 1.0 / 12.0,
                "markers": {"tip": {"position": [-half, 0.0]}},
                "initial": {
                    "position": [x, y],
                    "angle": angle,
                    "velocity": [-speed - spin * y, spin * x],
                    "angular_velocity": spin,
                },
            }
        },
        joints={
            "floor": {
                "type": "point_on_line",
                "markers": ["ground", "rod.tip"],
                "friction": {"coefficient": mu},
            }
        },
        outputs={"record": ["rod.angle", "floor.normal_force"]},
        **options,
    )


def test_friction_without_a_solution_is_told() -> None:
    """1 + 3 cos^2 - 3 mu sin cos is zero at tan = (3 mu - sqrt(9 mu^2 - 16)) / 2.

    Beyond it the load pulls (P. Painleve 1895); towards it, it grows without bound.
    """
    mu = 2.0
    least = float(np.arctan((3.0 * mu - np.sqrt(9.0 * mu**2 - 16.0)) / 2.0))
    with pytest.raises(SimulationError, match="stopped at t = 0 s: N501"):
        leaning_rod(mu, least + 0.05, 0.0, 1.0)
    with pytest.raises(SimulationError) as error:
        leaning_rod(mu, 0.45, 4.0, 4.0)
    locked = [d for d in error.value.diagnostics if d.code == "N501"]
    assert locked and locked[0].data["joints"] == ("floor",)
    reached = error.value.result
    assert reached.values[-1, 0] == pytest.approx(least, abs=1e-6)
    assert reached.values[-1, 1] > 1e6
    for rtol in (1e-3, 1e-5):
        with pytest.raises(SimulationError, match="N501") as e:
            leaning_rod(mu, 0.45, 4.0, 4.0, method="generalised_alpha", rtol=rtol)
        assert e.value.result.values[-1, 0] == pytest.approx(least, abs=0.02)
    with pytest.raises(SimulationError):
        leaning_rod(mu, 0.45, 4.0, 4.0, method="generalised_alpha", step=1e-4)


@pytest.mark.parametrize(
    ("law", "what"),
    [
        ({"radius": None}, "radius: is missing"),
        ({"static": 0.05}, "static: is 0.05, below"),
        ({"stribeck_velocity": 0.1}, "stribeck_velocity: has no coefficient"),
        ({"coefficient": -0.1}, "coefficient"),
    ],
)
def test_laws_that_make_no_sense(law: dict[str, Any], what: str) -> None:
    tables = door(1, **law)
    friction = tables["joints"]["hinge0"]["friction"]
    tables["joints"]["hinge0"]["friction"] = {
        key: value for key, value in friction.items() if value is not None
    }
    with pytest.raises(InputError, match=what):
        simulate("spatial", 0.1, **tables)


def test_equilibrium_is_told_to_be_without_friction() -> None:
    tables = door(1)
    tables["joints"]["hinge0"]["friction"]["coefficient"] = 0.5
    system = compile_scene(scene("spatial", 1.0, **tables), ".", keep_joints=True)
    found = static_equilibrium(system)
    assert only(found, "N515").subject == "hinge0"
    load = found.result().values[0, 0]
    assert load == pytest.approx(3.0 * G, rel=1e-9)
    held = linearise(system)
    assert len(held.eigenvalues) == 0
    state = only(held, "N514")
    assert (state.subject, state.data["state"]) == ("hinge0", "holds")


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_two_joints_that_hold_one_motion_break_loose_together(dimension: str) -> None:
    """A rack on its guide and a wheel in its bearing: limits add up, at rest and after.

    No force tells what part of the pull each of them holds.
    """
    wheel, rack, inertia, big, pin, ramp = 3.0, 2.0, 0.04, 0.25, 0.02, 8.0
    end = 2.0
    space = inertia if dimension == "planar" else [0.1, 0.1, inertia]
    line = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0.0, 1.0]}]}
    law = {"coefficient": 0.2, "static": 0.3}
    result = simulate(
        dimension,
        end,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "rack": {"mass": rack, "inertia": space},
            "wheel": {"mass": wheel, "inertia": space},
        },
        joints={
            "guide": {
                "type": "prismatic",
                "markers": ["ground", "rack"],
                "friction": law,
            },
            "bearing": {
                "type": "revolute",
                "markers": ["ground", "wheel"],
                "friction": {**law, "radius": pin},
            },
            "teeth": {
                "type": "coupling",
                "joints": ["guide", "bearing"],
                "weights": [1.0, -big],
            },
        },
        forces={
            "pull": {
                "type": "force",
                "marker": "rack",
                "force": vector(dimension, ramp, 0.0),
                "function": line,
            }
        },
        outputs={
            "record": [
                "guide.displacement",
                "guide.friction",
                "bearing.friction",
                *ENERGIES,
            ]
        },
    )
    limit = G * (rack + wheel * pin / big)
    loose = 0.3 * limit / ramp
    for joint in ("guide", "bearing"):
        assert changes(result, joint) == [("slip", pytest.approx(loose, abs=1e-9))]
    place, guide, bearing, *_ = result.values.T
    stuck = result.t < loose
    held = guide[stuck] + bearing[stuck] / big
    np.testing.assert_allclose(held, -ramp * result.t[stuck], atol=1e-9)
    since = result.t[~stuck] - loose
    pushed = ramp * (result.t[~stuck] ** 3 - loose**3) / 6.0
    pushed -= ramp * loose**2 * since / 2.0 + 0.2 * limit * since**2 / 2.0
    way = pushed / (rack + inertia / big**2)
    np.testing.assert_allclose(place[~stuck], way, atol=1e-8)
    assert_balanced(result, 1e-8)
