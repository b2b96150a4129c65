"""Drives: every coordinate follows every function of time, with its derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, get_args

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Joint
from sidtool.solver import compile_scene, simulate
from sidtool.solver.dynamics.drives import function_value
from sidtool.solver.system.joints import PLANAR, SPATIAL
from sidtool.solver.system.work_arrays import function_history

from .joint_scenes import PITCH, evaluated, marker, pair, scene, turned

TIMES = np.linspace(-0.1, 1.1, 13)
VALUES = np.sin(5.0 * TIMES) + TIMES

Derivatives = Callable[[Array, int], Any]


def _sine(t: Array, order: int) -> Any:
    phase = 2.0 * np.pi * 1.5 * t + 0.3 + 0.5 * np.pi * order
    return (0.2 if order == 0 else 0.0) + 0.7 * (3.0 * np.pi) ** order * np.sin(phase)


def _smooth(degree: tuple[float, ...]) -> Derivatives:
    """The integral of (x (1 - x))^n from 0.2 s to 0.7 s, from -0.5 to 1."""
    rise = np.polynomial.Polynomial(degree)

    def value(t: Array, order: int) -> Any:
        inside = 1.5 * rise.deriv(order)((t - 0.2) / 0.5) / 0.5**order
        ends = (-0.5, 1.0) if order == 0 else (0.0, 0.0)
        inside = inside - 0.5 if order == 0 else inside
        return np.where(t < 0.2, ends[0], np.where(t > 0.7, ends[1], inside))

    return value


FUNCTIONS: dict[str, tuple[dict[str, Any], Derivatives]] = {
    "constant": (
        {"type": "constant", "value": 0.4},
        lambda t, order: np.full(len(t), 0.4 * (order == 0)),
    ),
    "polynomial": (
        {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [1, 2, 3]}]},
        lambda t, order: np.polynomial.Polynomial([1, 2, 3]).deriv(order)(t),
    ),
    "harmonic": (
        {
            "type": "harmonic",
            "offset": 0.2,
            "amplitude": 0.7,
            "frequency": 1.5,
            "phase": 0.3,
        },
        _sine,
    ),
    "harmonic, rad/s": (
        {
            "type": "harmonic",
            "offset": 0.2,
            "amplitude": 0.7,
            "angular_frequency": 3.0 * np.pi,
            "phase": 0.3,
        },
        _sine,
    ),
    "smooth step": (
        {"type": "smooth_step", "from": 0.2, "to": 0.7, "start": -0.5, "end": 1.0},
        _smooth((0, 0, 0, 10, -15, 6)),
    ),
    "smoother step": (
        {
            "type": "smooth_step",
            "from": 0.2,
            "to": 0.7,
            "start": -0.5,
            "end": 1.0,
            "continuity": 3,
        },
        _smooth((0, 0, 0, 0, 35, -84, 70, -20)),
    ),
    "table": (
        {"type": "table", "times": TIMES.tolist(), "values": VALUES.tolist()},
        lambda t, order: CubicSpline(TIMES, VALUES)(t, order),
    ),
}


def cart(dimension: str, function: dict[str, Any], record: tuple[str, ...] = ()) -> Any:
    """A body on rails, driven."""
    plane = dimension == "planar"
    body = {"mass": 2.0, "inertia": 1.0 if plane else [1.0, 1.0, 1.0]}
    return scene(
        dimension,
        1.0,
        bodies={"cart": body},
        joints={"rail": {"type": "prismatic", "markers": ["ground", "cart"]}},
        drives={"motor": {"joint": "rail", "function": function}},
        outputs={"record": ["cart.x", "cart.vx", "cart.ax", *record]},
    )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_driven_body_follows_its_function(name: str, dimension: str) -> None:
    """Position, speed, acceleration, and the force m s'' of the drive."""
    function, exact = FUNCTIONS[name]
    wanted = [exact(np.linspace(0.0, 1.0, 21), order) for order in range(3)]
    scale = 1.0 + np.abs(wanted[2]).max()
    prescribed = compile_scene(cart(dimension, function))
    assert prescribed.n_velocities == 0
    result = simulate(prescribed)
    assert np.abs(result.values - np.transpose(wanted)).max() < 1e-12 * scale
    recorded = cart(dimension, function, ("motor.f1",))
    for keep, unknowns in ((True, 3 if dimension == "planar" else 6), (False, 0)):
        driven = compile_scene(recorded, keep_joints=keep)
        assert driven.n_velocities == unknowns
        result = simulate(driven, rtol=1e-8)
        assert np.abs(result.values[:, :3] - np.transpose(wanted)).max() < 1e-9 * scale
        assert np.abs(result.values[:, 3] - 2.0 * wanted[2]).max() < 1e-8 * scale


def _cardan(first: float, second: float) -> Array:
    return Rotation.from_euler("XY", [first, second]).as_matrix()


# What the coordinates s, r of a joint mean for the second marker's position d and its
# orientation Q in the frame of the first.
Meaning = Callable[[Array, Array, float, float], Any]
COORDINATES: dict[tuple[str, str], Meaning] = {
    ("revolute", "angle"): lambda d, Q, s, r: Q - turned(s),
    ("prismatic", "displacement"): lambda d, Q, s, r: d[0] - s,
    ("cylindrical", "angle displacement"): lambda d, Q, s, r: [
        d[2] - r,
        *(Q - turned(s)).ravel(),
    ],
    ("screw", "angle"): lambda d, Q, s, r: [
        math.remainder(d[2] - PITCH * s / (2.0 * np.pi), PITCH),
        *(Q - turned(s)).ravel(),
    ],
    ("screw", "displacement"): lambda d, Q, s, r: [
        d[2] - s,
        *(Q - turned(2.0 * np.pi * s / PITCH)).ravel(),
    ],
    ("universal", "angle_1 angle_2"): lambda d, Q, s, r: Q - _cardan(s, r),
    ("planar", "angle"): lambda d, Q, s, r: Q - turned(s),
    ("point_on_line", "displacement"): lambda d, Q, s, r: d[0] - s,
    ("distance", "length"): lambda d, Q, s, r: np.linalg.norm(d) - s,
}
DRIVEN = [
    (dimension, kind, names)
    for (kind, names) in COORDINATES
    for dimension, known in (("planar", PLANAR), ("spatial", SPATIAL))
    if kind in known
]


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
@pytest.mark.parametrize(("dimension", "kind", "names"), DRIVEN)
def test_every_coordinate_can_be_driven(
    dimension: str, kind: str, names: str, flexible: bool
) -> None:
    content, sids = pair(dimension, {"type": kind}, flexible)
    speeds = {"s": (1.0, 7.0), "r": (0.5, -2.0)}
    drives = {
        drive: {
            "joint": "joint",
            "coordinate": name,
            "function": {
                "type": "polynomial",
                "pieces": [{"from": 0.0, "coefficients": speeds[drive]}],
            },
        }
        for drive, name in zip("sr", names.split(), strict=False)
    }
    data = content.model_dump(by_alias=True, exclude_none=True)
    content = type(content).model_validate({**data, "drives": drives})
    system = compile_scene(content, sids=sids)
    result = simulate(system, rtol=1e-7)
    for k in (0, 10, 20):
        t = float(result.t[k])
        work = evaluated(system, t, result.positions[k], result.velocities[k])
        x, R = marker(system, work, ("left", "end"))
        y, S = marker(system, work, ("right", "end"))
        wanted = [speeds[d][0] + speeds[d][1] * t for d in "sr"]
        gap = COORDINATES[kind, names](R.T @ (y - x), R.T @ S, *wanted)
        assert np.abs(gap).max() < 1e-9


def test_every_coordinate_has_its_meaning_stated() -> None:
    stated = {(kind, name) for kind, names in COORDINATES for name in names.split()}
    kinds = get_args(get_args(Joint)[0])
    known = {
        (get_args(kind.model_fields["type"].annotation)[0], name)
        for kind in kinds
        for name in kind.coordinates
    }
    assert stated == known


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
@pytest.mark.parametrize(
    ("dimension", "names"), [("planar", ("x", "y", "angle")), ("spatial", "xyz")]
)
def test_markers_follow_drives_of_their_coordinates(
    dimension: str, names: tuple[str, ...], flexible: bool
) -> None:
    """Seen from a marker of a moving body."""
    content, sids = pair(dimension, {"type": "coincident"}, flexible)
    drives = {
        f"drive_{name}": {
            "marker": "right.end",
            "reference": "left.end",
            "coordinate": name,
            "function": {
                "type": "harmonic",
                "offset": 0.1 * k,
                "amplitude": 0.3,
                "angular_frequency": 2.0 + k,
            },
        }
        for k, name in enumerate(names)
    }
    data = content.model_dump(by_alias=True, exclude_none=True)
    data = {**data, "joints": {}, "drives": drives}
    system = compile_scene(type(content).model_validate(data), sids=sids)
    assert system.n_rows == 3
    result = simulate(system, rtol=1e-7)
    t = float(result.t[-1])
    work = evaluated(system, t, result.positions[-1], result.velocities[-1])
    x, R = marker(system, work, ("left", "end"))
    y, S = marker(system, work, ("right", "end"))
    found = R.T @ (y - x)
    if dimension == "planar":
        Q = R.T @ S
        found[2] = np.arctan2(Q[1, 0], Q[0, 0])
    wanted = [0.1 * k + 0.3 * np.sin((2.0 + k) * t) for k in range(3)]
    assert np.abs(found - wanted).max() < 1e-9


def _pieces(*coefficients: list[float]) -> dict[str, Any]:
    starts = np.linspace(0.0, 1.0, len(coefficients) + 1)
    return {
        "type": "polynomial",
        "pieces": [
            {"from": a, "to": b, "coefficients": c}
            for a, b, c in zip(starts, starts[1:], coefficients, strict=False)
        ],
    }


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (_pieces([0.0, 1.0], [0.7, 1.0]), r"function: jumps by 0.2 at t = 0.5 s"),
        (_pieces([0.0, 1.0], [0.5, 3.0]), r"jumps in its rate by 2 at t = 0.5 s"),
        ({"type": "callable"}, "left to a program; expected a callable"),
    ],
)
def test_what_no_body_can_follow_is_refused(
    function: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        compile_scene(cart("planar", function))


def test_a_jump_in_acceleration_is_stepped_to() -> None:
    system = compile_scene(
        cart("planar", _pieces([0.0, 1.0], [0.5, 1.0, 4.0]), ("motor.f1",))
    )
    assert system.breaks == (0.5, 1.0)
    result = simulate(system, rtol=1e-6)
    assert result.values[-1, 0] == pytest.approx(0.5 + 0.5 + 4.0 * 0.25, abs=1e-9)
    assert result.values[-1, 3] == pytest.approx(16.0, abs=1e-9)


def test_a_smooth_step_breaks_at_its_ends_only() -> None:
    step = {"type": "smooth_step", "from": 0.5, "to": 0.6, "end": 0.2}
    assert compile_scene(cart("planar", step)).breaks == (0.5, 0.6, 1.0)


def _wave(t: float) -> float:
    return float(np.exp(-t) * np.sin(25.0 * t) + 0.2 * np.tanh(8.0 * (t - 0.5)))


def _wave_rate(t: float) -> float:
    swing = np.exp(-t) * (25.0 * np.cos(25.0 * t) - np.sin(25.0 * t))
    return float(swing + 1.6 / np.cosh(8.0 * (t - 0.5)) ** 2)


def _wave_curvature(t: float) -> float:
    swing = np.exp(-t) * (-624.0 * np.sin(25.0 * t) - 50.0 * np.cos(25.0 * t))
    x = 8.0 * (t - 0.5)
    return float(swing - 25.6 * np.tanh(x) / np.cosh(x) ** 2)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_program_gives_any_function(count: int) -> None:
    functions = (_wave, _wave_rate, _wave_curvature)
    given = functions[:count] if count > 1 else _wave
    content = cart("planar", {"type": "callable"})
    system = compile_scene(content, drives={"motor": given})
    assert system.breaks == (1.0,)
    result = simulate(system)
    for order, tolerance in enumerate((2e-12, 1e-9, 1e-6)):
        exact = [functions[order](t) for t in result.t]
        assert np.abs(result.values[:, order] - exact).max() < tolerance


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (lambda t: float(t > 0.3), r"jumps by 1 at t = 0.3"),
        (lambda t: abs(t - 0.3), r"jumps in its rate by 2 at t = 0.(3|29999)"),
        (lambda t: np.nan if t > 0.3 else 0.0, "no finite number at t = 0.3"),
        (lambda t: 1.0 / (t - t), "the callable fails: .*division"),
        (lambda t: "fast", "the callable fails"),
        ((_wave, _wave), "first derivative differs by"),
        ((_wave, _wave_rate, _wave_rate), "second derivative differs by"),
        (np.random.default_rng(0).normal, "callable"),
    ],
)
def test_a_program_with_a_wrong_function_is_told(program: Any, message: str) -> None:
    content = cart("planar", {"type": "callable"})
    with pytest.raises(InputError, match=message):
        compile_scene(content, drives={"motor": program})


def test_a_kink_of_a_program_is_stepped_to() -> None:
    """As near as the function tells it from its neighbours, to 1e-13 of its size."""
    content = cart("planar", {"type": "callable"})
    system = compile_scene(content, drives={"motor": lambda t: max(t - 0.3, 0.0) ** 2})
    assert system.breaks == pytest.approx((0.3, 1.0), abs=1e-5)
    result = simulate(system)
    exact = np.maximum(result.t - 0.3, 0.0) ** 2
    assert np.abs(result.values[:, 0] - exact).max() < 1e-12


def test_a_program_needs_a_drive_of_that_name() -> None:
    content = cart("planar", {"type": "callable"})
    with pytest.raises(InputError, match="no drive 'moter' .*expected motor"):
        compile_scene(content, drives={"moter": _wave})


def turned_top(axis: list[float], start: float, **initial: Any) -> Any:
    """A top whose whole orientation is prescribed, about a skew axis of a skew base."""
    base = {"position": [0.1, 0.2, 0.3], "axis_angle": [0.5, -0.2, 0.8]}
    top = {
        "mass": 3.0,
        "inertia": [0.2, 0.3, 0.4],
        "markers": {"side": {"position": [0.3, 0.0, 0.1], "axis_angle": [0.1, 1.0, 0]}},
        "initial": initial,
    }
    turn = {
        "marker": "top.side",
        "reference": "ground.base",
        "coordinate": "rotation",
        "axis": axis,
        "function": _pieces([start, 3.0, 4.0]),
    }
    record = [f"turn.{name}" for name in ("mx", "my", "mz")]
    record += [f"top.{name}" for name in ("wx", "wy", "wz")]
    return scene(
        "spatial",
        ground={"markers": {"base": base}},
        bodies={"top": top},
        joints={"ball": {"type": "spherical", "markers": ["ground.base", "top.side"]}},
        drives={"turn": turn},
        outputs={"record": record},
    )


@pytest.mark.parametrize(
    "initial", [{}, {"axis_angle": [2.5, 0.0, 0.0]}], ids=["near", "upside down"]
)
def test_a_whole_orientation_is_prescribed(initial: dict[str, Any]) -> None:
    """More than one turn about a skew axis, from any guess of the start."""
    axis = np.array([1.0, -2.0, 0.5])
    system = compile_scene(turned_top(axis.tolist(), 0.4, **initial))
    result = simulate(system, rtol=1e-8)
    base = Rotation.from_rotvec([0.5, -0.2, 0.8])
    side = Rotation.from_rotvec([0.1, 1.0, 0.0])
    direction = axis / np.linalg.norm(axis)
    spins = [base.apply((3.0 + 8.0 * t) * direction) for t in result.t]
    found = np.column_stack([result[f"top.w{a}"] for a in "xyz"])
    assert found == pytest.approx(np.array(spins), abs=1e-7)
    for t, z in zip(result.t, result.positions, strict=True):
        turned = Rotation.from_rotvec((0.4 + 3.0 * t + 4.0 * t * t) * direction)
        wanted = (base * turned * side.inv()).as_quat(canonical=True)
        have = Rotation.from_quat(z[[4, 5, 6, 3]]).as_quat(canonical=True)
        assert have == pytest.approx(wanted, abs=1e-9)


def test_the_torque_of_a_prescribed_rotation_is_that_of_euler() -> None:
    """About the pivot: J' w' + w x J' w, with the inertia J' there."""
    axis = np.array([1.0, -2.0, 0.5])
    result = simulate(compile_scene(turned_top(axis.tolist(), 0.4)), rtol=1e-9)
    base = Rotation.from_rotvec([0.5, -0.2, 0.8])
    arm = np.array([-0.3, 0.0, -0.1])
    J = np.diag([0.2, 0.3, 0.4]) + 3.0 * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    direction = base.apply(axis / np.linalg.norm(axis))
    for k, z in enumerate(result.positions):
        R = Rotation.from_quat(z[[4, 5, 6, 3]]).as_matrix()
        inertia = R @ J @ R.T
        w, alpha = (3.0 + 8.0 * result.t[k]) * direction, 8.0 * direction
        expected = inertia @ alpha + np.cross(w, inertia @ w)
        found = [result[f"turn.m{a}"][k] for a in "xyz"]
        assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axis": None}, "drives.turn.axis: is missing"),
        ({"axis": [0.0, 0.0, 0.0]}, "drives.turn.axis: has no direction"),
        ({"coordinate": "x"}, "drives.turn.axis: is given with x"),
    ],
)
def test_a_rotation_needs_an_axis(change: dict[str, Any], message: str) -> None:
    data = turned_top([1.0, 0.0, 0.0], 0.0).model_dump(by_alias=True, exclude_none=True)
    data["drives"]["turn"] |= change
    with pytest.raises(InputError, match=message):
        type(turned_top([1.0, 0.0, 0.0], 0.0)).model_validate(data)


def test_a_function_at_many_times_is_that_at_each() -> None:
    """Compiled, with times in any order, against the formula read by Python."""
    pieces = _pieces([0.1, 0.0, 0.4], [0.2, 0.4, -0.3])
    system = compile_scene(cart("planar", pieces))
    times = np.array([0.9, 0.1, 0.35, 0.5])[::-1]
    clocks = system.clocks(times)
    found = function_history(system, 0, clocks, times)
    expected = [
        function_value.py_func(system.arrays, 0, clock, t)
        for clock, t in zip(clocks, times, strict=True)
    ]
    assert found == pytest.approx(np.array(expected), rel=1e-14)
    assert np.ptp(found[:, 2]) > 0.0
