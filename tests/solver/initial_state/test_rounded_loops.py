"""Closed loops whose numbers are rounded move as those with all digits.

Reference: the same mechanism with all digits; rounded numbers move it by about as much
as they were rounded.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from tests.codes import codes, only, with_code
from tests.solver.scenes import polynomial, scene

GROUND, CRANK, COUPLER, ROCKER = 0.4, 0.13, 0.35, 0.3


def rounded(values: Any, digits: int | None) -> list[float]:
    return [float(x) if digits is None else round(float(x), digits) for x in values]


def four_bar(
    digits: int | None, normal: tuple[float, float, float], driven: bool, start: float
) -> SceneFile:
    """A crank-rocker in a plane across `normal`, all four joints revolute."""
    n = np.array(normal) / np.linalg.norm(normal)
    x = np.cross(n, [0.3, -0.5, 0.8])
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    A, D = np.zeros(2), np.array([GROUND, 0.0])
    B = CRANK * np.array([math.cos(start), math.sin(start)])
    span = float(np.hypot(*(D - B)))
    cosine = (COUPLER**2 + span**2 - ROCKER**2) / (2.0 * COUPLER * span)
    angle = math.atan2(*(D - B)[::-1]) + math.acos(cosine)
    C = B + COUPLER * np.array([math.cos(angle), math.sin(angle)])

    def at(p: np.ndarray) -> np.ndarray:
        return p[0] * x + p[1] * y

    def bar(p: np.ndarray, q: np.ndarray, mass: float) -> dict[str, Any]:
        middle, inertia = at(p + q) / 2.0, mass * float(np.sum((q - p) ** 2)) / 12.0
        ends = {"p": at(p) - middle, "q": at(q) - middle}
        return {
            "mass": mass,
            "inertia": [inertia] * 3,
            "markers": {k: {"position": rounded(v, digits)} for k, v in ends.items()},
            "initial": {"position": rounded(middle, digits)},
        }

    hinges = {
        "ja": ["ground.A", "crank.p"],
        "jb": ["crank.q", "coupler.p"],
        "jc": ["coupler.q", "rocker.q"],
        "jd": ["ground.D", "rocker.p"],
    }
    axis = rounded(n, digits)
    turn = {"turn": {"joint": "ja", "function": polynomial(0.0, 2.0 * math.pi, 0.5)}}
    places = {k: {"position": rounded(at(p), digits)} for k, p in (("A", A), ("D", D))}
    return scene(
        {
            "crank": bar(A, B, 0.5),
            "coupler": bar(B, C, 1.0),
            "rocker": bar(D, C, 0.8),
        },
        {
            name: {"type": "revolute", "markers": ends, "axis": axis}
            for name, ends in hinges.items()
        },
        turn if driven else {},
        dimension="spatial",
        end=1.5,
        steps=30,
        gravity=[0.0, 0.0, -9.81],
        ground={"markers": places},
        record=["rocker.x", "rocker.y", "rocker.z", "jc.angle", "jd.fx", "ja.mz"],
    )


@cache
def exact_four_bar(
    normal: tuple[float, float, float], driven: bool, start: float
) -> Result:
    """The motion with all digits, for all numbers of digits."""
    return simulate(compile_scene(four_bar(None, normal, driven, start)), rtol=1e-8)


@pytest.mark.parametrize("driven", [True, False])
@pytest.mark.parametrize("digits", [4, 10, 12])
@pytest.mark.parametrize(
    ("normal", "start"), [((1.0, 2.0, 2.0), 0.7), ((-0.4, 1.3, 0.9), 2.0)]
)
def test_a_spatial_four_bar_moves_as_well_as_it_is_written(
    normal: tuple[float, float, float], start: float, digits: int, driven: bool
) -> None:
    exact = exact_four_bar(normal, driven, start)
    content = four_bar(digits, normal, driven, start)
    result = simulate(compile_scene(content), rtol=1e-8)
    assert result.completed and np.ptp(result["rocker.z"]) > 1e-3
    off = np.abs(result.values - exact.values).max(axis=0)
    assert (off[:4] < 100.0 * 10.0**-digits + 1e-10).all()
    assert (off[4:] < 2000.0 * 10.0**-digits + 1e-7).all()
    assert not {"N232", "N323"} & set(codes(exact))
    for diagnostic in with_code(result, "N232"):
        data = diagnostic.data
        assert data["count"] == 3
        assert "as a universal joint" in str(data["substitution"])
        assert 0.02 * 10.0**-digits < data["residual"] < 20.0 * 10.0**-digits
    if normal == (1.0, 2.0, 2.0) and digits < 12:
        assert "N232" in codes(result)


def test_analyses_meet_rounded_loops_as_well() -> None:
    normal, start = (1.0, 2.0, 2.0), 0.7
    for analyse in (
        inverse_dynamics,
        lambda system: static_equilibrium(system).result(),
    ):
        exact, found = (
            analyse(compile_scene(content, keep_joints=True))
            for content in (
                four_bar(None, normal, True, start),
                four_bar(6, normal, True, start),
            )
        )
        assert found.values == pytest.approx(exact.values, abs=3e-4)
        assert "N232" in codes(found)


def door(digits: int | None, upper: str) -> SceneFile:
    """A door on two hinges in line, the upper one of another type perhaps."""
    axis = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
    markers = {
        name: {"position": rounded(height * axis, digits)}
        for name, height in (("low", 0.2), ("high", 1.83))
    }
    centre = axis + 0.7 * np.cross(axis, [0.0, 0.0, 1.0])
    turned = {"axis": rounded(axis, digits)}
    return scene(
        {
            "door": {
                "mass": 20.0,
                "inertia": [4.0, 6.0, 5.0],
                "centre_of_mass": [float(x) for x in centre],
                "markers": markers,
                "initial": {"angular_velocity": [float(x) for x in axis]},
            }
        },
        {
            "l": {"type": "revolute", "markers": ["ground.low", "door.low"], **turned},
            "u": {"type": upper, "markers": ["ground.high", "door.high"], **turned},
        },
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        ground={"markers": markers},
        record=["door.x", "door.y", "door.low.x", "door.low.y", "l.angle"],
    )


@pytest.mark.parametrize("digits", [6, 10])
@pytest.mark.parametrize("upper", ["revolute", "cylindrical"])
def test_a_door_on_two_rounded_hinges_swings(upper: str, digits: int) -> None:
    exact = simulate(compile_scene(door(None, upper)), rtol=1e-9)
    result = simulate(compile_scene(door(digits, upper)), rtol=1e-9)
    assert np.ptp(exact["l.angle"]) > 0.3
    assert result["l.angle"] == pytest.approx(exact["l.angle"], abs=20.0 * 0.1**digits)
    substitution = only(result, "N232").data["substitution"]
    assert "as a spherical joint" in str(substitution)


def linkage(digits: int | None) -> SceneFile:
    """A planar parallelogram with three cranks."""
    length, angle = 1.0 / 3.0, 0.6
    feet = [i * 2.0 / 7.0 for i in range(3)]
    up = np.array([length * math.cos(angle), length * math.sin(angle)])
    ends = {
        f"p{i}": {"position": rounded([x, 0.0], digits)} for i, x in enumerate(feet)
    }
    bodies: dict[str, Any] = {
        "bar": {
            "mass": 1.0,
            "inertia": 0.1,
            "markers": ends,
            "initial": {
                "position": rounded(up, digits),
                "velocity": [-8.0 * float(up[1]), 8.0 * float(up[0])],
            },
        }
    }
    joints = {}
    for i, x in enumerate(feet):
        tip = [length * math.cos(0.4 * i), length * math.sin(0.4 * i)]
        bodies[f"c{i}"] = {
            "mass": 0.2,
            "inertia": 0.01,
            "markers": {"e": {"position": rounded(tip, digits)}},
            "initial": {
                "position": rounded([x, 0.0], digits),
                "angle": angle - 0.4 * i,
                "angular_velocity": 8.0,
            },
        }
        joints[f"f{i}"] = {"type": "revolute", "markers": [f"ground.p{i}", f"c{i}"]}
        joints[f"h{i}"] = {"type": "revolute", "markers": [f"c{i}.e", f"bar.p{i}"]}
    return scene(
        bodies,
        joints,
        gravity=[0.0, -9.81],
        ground={"markers": ends},
        record=["bar.x", "bar.y"],
        end=0.2,
    )


@pytest.mark.parametrize("digits", [4, 7])
def test_a_planar_parallelogram_with_three_rounded_cranks_moves(digits: int) -> None:
    """From one side over the top to the other: what follows from the rest turns."""
    exact = simulate(compile_scene(linkage(None)), rtol=1e-9)
    result = simulate(compile_scene(linkage(digits)), rtol=1e-9)
    assert exact["bar.x"].min() < -0.05 and exact["bar.x"].max() > 0.2
    assert result.values == pytest.approx(exact.values, abs=20.0 * 0.1**digits)
    assert only(result, "N232").data["count"] == 1


def advised(content: SceneFile, first: Result) -> SceneFile:
    """The scene with the joints that a remedy names, each of the type that it names."""
    note = str(only(first, "N232").data["substitution"])
    table = content.model_dump(by_alias=True, exclude_none=True)
    told = re.findall(r"(\w+) as a (\w+) joint(?: \((axis = .*?\])\))?", note)
    assert told and "less" not in note
    for name, kind, axes in told:
        joint = table["joints"][name]
        joint["type"] = kind
        if kind == "spherical":
            del joint["axis"]
        for key, numbers in re.findall(r"(\w*axis) = \[(.*?)\]", axes):
            joint[key] = [float(x) for x in numbers.split(", ")]
    table["outputs"]["record"] = [x for x in content.outputs.record if x[-2:-1] == "."]
    return SceneFile.model_validate(table)


MECHANISMS: dict[str, Callable[[int | None], SceneFile]] = {
    "driven four-bar": lambda digits: four_bar(digits, (1.0, 2.0, 2.0), True, 0.7),
    "falling four-bar": lambda digits: four_bar(digits, (-0.4, 1.3, 0.9), False, 2.0),
    "two hinges": lambda digits: door(digits, "revolute"),
    "hinge and sleeve": lambda digits: door(digits, "cylindrical"),
    "three cranks": linkage,
}


@cache
def exact_motion(mechanism: str) -> Result:
    return simulate(compile_scene(MECHANISMS[mechanism](None)), rtol=1e-9)


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_the_advised_joints_move_the_same_without_contradiction(mechanism: str) -> None:
    """No constraint is too many, and no singular configuration comes with them."""
    digits = 4
    content = MECHANISMS[mechanism](digits)
    first = simulate(compile_scene(content), rtol=1e-9)
    result = simulate(compile_scene(advised(content, first)), rtol=1e-9)
    assert not {"N232", "N233", "N234", "N329"} & set(codes(result))
    exact = exact_motion(mechanism)
    for name in result.names:
        assert result[name] == pytest.approx(exact[name], abs=100.0 * 0.1**digits)


def test_contradictions_beyond_rounding_are_refused() -> None:
    content = four_bar(6, (1.0, 2.0, 2.0), True, 0.7)
    text = content.model_dump(by_alias=True, exclude_none=True, mode="json")
    text["joints"]["jc"]["axis"] = [0.33, 0.67, 0.64]
    with pytest.raises(InputError, match="cannot be assembled"):
        simulate(compile_scene(SceneFile.model_validate(text)))


def small_linkage(far: float) -> SceneFile:
    """A four-bar linkage of 6 mm that falls, and a pendulum some way [m] beside it."""
    A, B, C, D = 1e-3 * np.array([[0.0, 0.0], [1.0, 2.0], [5.0, 3.0], [6.0, 0.0]])
    P, Q = np.array([[far, 0.0], [far + 1e-3, 0.0]])

    def bar(p: np.ndarray, q: np.ndarray) -> dict[str, Any]:
        middle = (p + q) / 2.0
        ends = {"p": p - middle, "q": q - middle}
        return {
            "mass": 1.0,
            "inertia": float(np.sum((q - p) ** 2)) / 12.0,
            "markers": {k: {"position": v.tolist()} for k, v in ends.items()},
            "initial": {"position": middle.tolist()},
        }

    hinges = {
        "ja": ["ground.A", "crank.p"],
        "jb": ["crank.q", "coupler.p"],
        "jc": ["coupler.q", "rocker.q"],
        "jd": ["ground.D", "rocker.p"],
        "je": ["ground.P", "pendulum.p"],
    }
    places = {"A": A, "D": D, "P": P}
    bars = {"crank": (A, B), "coupler": (B, C), "rocker": (D, C), "pendulum": (P, Q)}
    return scene(
        {name: bar(*ends) for name, ends in bars.items()},
        {k: {"type": "revolute", "markers": ends} for k, ends in hinges.items()},
        end=0.05,
        steps=10,
        gravity=[0.0, -9.81],
        ground={
            "markers": {k: {"position": v.tolist()} for k, v in places.items()},
        },
        record=["rocker.angle", "crank.angle"],
    )


def test_a_small_loop_is_no_rounding_of_a_large_mechanism() -> None:
    """Its links hardly turn a line of the length of the whole, and all of its
    constraints hold nevertheless, wherever other bodies are."""
    near, far = (
        simulate(compile_scene(small_linkage(far)), rtol=1e-8) for far in (0.01, 300.0)
    )
    assert far.values == pytest.approx(near.values, abs=1e-7)
    assert "N232" not in codes(far)
