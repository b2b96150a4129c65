"""Tables of forces and of functions of time are those that the file gives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile, Spline
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.functions.function_table import compile_function
from sidtool.solver.functions.piecewise import PiecewisePolynomial
from tests.solver.scenes import scene

MASS, STIFFNESS, GAP = 2.0, 1e5, 1e-3
#: A stop on both sides, with play.
STOP = {
    "deflection": [-2 * GAP, -GAP, GAP, 2 * GAP],
    "force": [-STIFFNESS * GAP, 0.0, 0.0, STIFFNESS * GAP],
}


def slider(
    table: dict[str, Any], speed: float = 0.0, push: float = 0.0, **drives: Any
) -> SceneFile:
    """A block on a rail, held by a spring whose force is a table."""
    block = {"mass": MASS, "inertia": 1.0, "initial": {"velocity": [speed, 0.0]}}
    spring = {"type": "spring_damper", "joint": "rail", "table": table}
    pushed = {"type": "force", "marker": "block", "force": [push, 0.0]}
    rail = {"type": "prismatic", "markers": ["ground", "block"], "axis": [1.0, 0.0]}
    return scene(
        {"block": block},
        {"rail": rail},
        drives,
        0.5,
        500,
        ["block.x"],
        forces={"stop": spring, "push": pushed},
    )


def bounced(t: Array, speed: float) -> Array:
    """Free flight from the middle to a stop, half a vibration there, and back."""
    omega = math.sqrt(STIFFNESS / MASS)
    flight, contact = GAP / speed, math.pi / omega
    half = 2.0 * flight + contact
    side = np.where(np.floor(t / half) % 2 == 0, 1.0, -1.0)
    s = t % half
    inside = GAP + speed / omega * np.sin(omega * (s - flight))
    back = GAP - speed * (s - flight - contact)
    x = np.where(s < flight, speed * s, np.where(s < flight + contact, inside, back))
    return side * x


@pytest.mark.parametrize("force", [100.0, 500.0])
def test_a_stop_gives_way_by_its_stiffness_behind_its_play(force: float) -> None:
    """The second force lies beyond the table, whose last line goes on."""
    found = static_equilibrium(compile_scene(slider(STOP, push=force))).result()
    assert found["block.x"][0] == pytest.approx(GAP + force / STIFFNESS, rel=1e-9)


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "dop853"])
@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_bounces_between_two_stops(method: str, rtol: float) -> None:
    """Steps end at the corners of the force: 200 are passed within the tolerance."""
    result = simulate(compile_scene(slider(STOP, 1.0)), integrator=method, rtol=rtol)
    exact = bounced(result.t, 1.0)
    error = np.abs(result["block.x"] - exact).max() / np.ptp(exact)
    assert error < rtol


def test_a_smooth_table_has_no_corners_and_no_overshoot() -> None:
    """No force in the play, and less behind it than along the lines."""
    table = STOP | {"interpolation": "smooth"}
    result = simulate(compile_scene(slider(table, 0.1)), rtol=1e-8)
    x = result["block.x"]
    speeds = np.abs(np.diff(x) / np.diff(result.t))
    free = np.abs(x) < GAP
    assert speeds[free[:-1] & free[1:]] == pytest.approx(0.1, rel=1e-6)
    straight = GAP + 0.1 * math.sqrt(MASS / STIFFNESS)
    assert straight * 1.01 < np.abs(x).max() < 2.0 * GAP


TIMES, VALUES = (0.5, 1.0, 2.5, 3.0), (1.0, -2.0, 4.0, 3.0)


def value(pieces: PiecewisePolynomial, t: float) -> float:
    k = max(int(np.searchsorted(pieces.starts, t, side="right")) - 1, 0)
    return float(np.polyval(pieces.terms[k][::-1], t - pieces.starts[k]))


def compiled(joined: int, **settings: Any) -> PiecewisePolynomial:
    table = Spline(times=TIMES, values=VALUES, **settings)
    found = compile_function(table, "forces.f.function", joined)
    assert isinstance(found, PiecewisePolynomial)
    return found


@pytest.mark.parametrize("settings", [{}, {"interpolation": "linear"}])
def test_forces_follow_straight_lines_and_hold_their_ends(
    settings: dict[str, str],
) -> None:
    pieces = compiled(0, **settings)
    for t in (-7.0, 0.4, 0.5, 0.8, 1.0, 1.9, 2.7, 3.0, 12.0):
        assert value(pieces, t) == pytest.approx(np.interp(t, TIMES, VALUES), abs=1e-12)


@pytest.mark.parametrize("ends", ["not-a-knot", "clamped", "natural"])
@pytest.mark.parametrize(
    ("joined", "settings"), [(2, {}), (0, {"interpolation": "smooth"})]
)
def test_motions_follow_a_spline_that_goes_on_straight(
    joined: int, settings: dict[str, str], ends: str
) -> None:
    pieces, spline = (
        compiled(joined, ends=ends, **settings),
        CubicSpline(TIMES, VALUES, bc_type=ends),
    )
    for t in (0.5, 0.8, 1.0, 1.9, 2.7, 3.0):
        assert value(pieces, t) == pytest.approx(spline(t), rel=1e-12)
    for t, end in ((-7.0, TIMES[0]), (0.4, TIMES[0]), (12.0, TIMES[-1])):
        line = spline(end) + spline(end, 1) * (t - end)
        assert value(pieces, t) == pytest.approx(line, rel=1e-12)


def test_a_position_with_corners_is_refused() -> None:
    """Its rate would jump, which takes an impact."""
    function: dict[str, Any] = {
        "type": "table",
        "times": [0.0, 0.2, 0.5],
        "values": [0.0, 1.0, 1.0],
    }
    motor = {"joint": "rail", "function": function}
    compile_scene(slider(STOP, motor=motor))
    function["interpolation"] = "linear"
    with pytest.raises(InputError, match="jumps in its rate"):
        compile_scene(slider(STOP, motor=motor))
