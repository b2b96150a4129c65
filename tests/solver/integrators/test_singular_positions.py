"""Positions in which a mechanism could move on in several ways, or in none.

Crank and rod of the same length: with the crank upright the piston passes its pivot and
two motions cross, the rod folding back (piston at 2 cos) and crank and rod turning
together (piston at rest). A four-bar whose shortest and longest bar are together as
long as the others has such a position, its change point, without any symmetry.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.codes import with_code
from tests.solver.scenes import (
    GRAVITY,
    Probe,
    compiled,
    polynomial,
    scene,
    slender_rod,
)

QUARTER = 0.5 * math.pi
#: Tightest tolerances of methods whose steps would be very many.
TIGHTEST = {"trapezoidal": 1e-7, "generalised_alpha": 1e-7, "dop853": 1e-7}


def slider_crank(
    start: float,
    rod: float = 1.0,
    speeds: tuple[float, float] = (0.0, 0.0),
    drive: dict[str, Any] | None = None,
    end: float = 4.0,
    **more: Any,
) -> System:
    """Crank of 1 m at the angle `start`; speeds of crank and rod.

    drive : function of the crank angle or, with a key `marker`, a whole drive
    """
    tip = [math.cos(start), math.sin(start)]
    lean = -math.asin(tip[1] / rod)
    crank, turning = speeds
    pin = [-crank * tip[1], crank * tip[0]]
    piston = pin[0] - turning * rod * math.sin(lean)
    bodies = {
        "crank": slender_rod(1.0, 0.3, angle=start, angular_velocity=crank),
        "rod": slender_rod(
            rod, 0.3, position=tip, angle=lean, velocity=pin, angular_velocity=turning
        ),
        "piston": {
            "mass": 1.0,
            "initial": {
                "position": [tip[0] + rod * math.cos(lean), 0.0],
                "velocity": [piston, 0.0],
            },
        },
    }
    joints = {
        "bearing": {"type": "revolute", "markers": ["ground", "crank.a"]},
        "pin": {"type": "revolute", "markers": ["crank.b", "rod.a"]},
        "tip": {"type": "revolute", "markers": ["rod.b", "piston"]},
        "guide": {"type": "point_on_line", "markers": ["ground", "piston"]},
    }
    drives = {}
    if drive is not None:
        turn = {"joint": "bearing", "function": drive}
        drives["drive"] = drive if "marker" in drive else turn
    record = ["piston.x", "crank.angle", "rod.angle", "guide.f1"]
    return compiled(
        scene(bodies, joints, drives, end=end, steps=100, record=record, **more)
    )


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-10])
@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
def test_a_driven_crank_passes_the_dead_point(integrator: str, rtol: float) -> None:
    """Momentum carries the rod through; no force is large on the way."""
    system = slider_crank(0.0, speeds=(1.0, -1.0), drive=polynomial(0.0, 1.0))
    rtol = max(rtol, TIGHTEST.get(integrator, 0.0))
    result = simulate(system, integrator=integrator, rtol=rtol)
    assert result["piston.x"] == pytest.approx(2.0 * np.cos(result.t), abs=1e-6)
    assert np.abs(result["guide.f1"]).max() < 5.0
    assert result.drift["position"] < 1e-11


def test_a_free_crank_passes_the_dead_point_with_its_energy() -> None:
    """Folding back, by gravity alone, several times."""
    system = slider_crank(0.3, speeds=(5.0, -5.0), gravity=[0.0, -GRAVITY])
    result = simulate(system, integrator="radau9", rtol=1e-7)
    angle = result["crank.angle"]
    assert np.ptp(angle) > math.pi
    energy = [
        0.5 * v @ Probe(system, t, z, v).mass @ v + 0.3 * GRAVITY * math.sin(a)
        for t, z, v, a in zip(
            result.t, result.positions, result.velocities, angle, strict=True
        )
    ]
    assert np.ptp(energy) < 1e-5
    assert result["rod.angle"] == pytest.approx(-angle, abs=1e-6)


#: Ground, crank, coupler and rocker; all in line when the crank points along x.
GROUND, CRANK, COUPLER, ROCKER = 4.0, 2.0, 3.0, 5.0


def closures(crank: float) -> list[tuple[float, float]]:
    """Angles of coupler and rocker: those before and those after the change point."""
    pin = CRANK * np.array([math.cos(crank), math.sin(crank)])
    span = np.array([GROUND, 0.0]) - pin
    length = float(np.hypot(*span))
    cosine = (COUPLER**2 + length**2 - ROCKER**2) / (2.0 * COUPLER * length)
    found = []
    for side in (1.0, -1.0):
        coupler = math.atan2(span[1], span[0]) + side * math.acos(max(-1.0, cosine))
        tip = COUPLER * np.array([math.cos(coupler), math.sin(coupler)]) - span
        found.append((coupler, math.atan2(tip[1], tip[0])))
    return found


def four_bar(crank: float = -0.7, speed: float = 3.0, end: float = 1.0) -> System:
    """Falling through its change point, and through it again on its way back."""
    coupler, rocker = closures(crank)[0]
    ahead, behind = closures(crank + 1e-6)[0], closures(crank - 1e-6)[0]
    slopes = (np.array(ahead) - np.array(behind)) / 2e-6
    pin = [CRANK * math.cos(crank), CRANK * math.sin(crank)]
    velocity = [-speed * pin[1], speed * pin[0]]
    bodies = {
        "crank": slender_rod(CRANK, angle=crank, angular_velocity=speed),
        "coupler": slender_rod(
            COUPLER,
            angle=coupler,
            position=pin,
            velocity=velocity,
            angular_velocity=speed * slopes[0],
        ),
        "rocker": slender_rod(
            ROCKER,
            angle=rocker,
            position=[GROUND, 0.0],
            angular_velocity=speed * slopes[1],
        ),
    }
    hinges = {
        "foot": ["ground", "crank.a"],
        "pin": ["crank.b", "coupler.a"],
        "tip": ["coupler.b", "rocker.b"],
        "far": ["ground.far", "rocker.a"],
    }
    joints = {n: {"type": "revolute", "markers": m} for n, m in hinges.items()}
    record = ["crank.angle", "coupler.angle", "rocker.angle"]
    far = {"markers": {"far": {"position": [GROUND, 0.0]}}}
    more: dict[str, Any] = {"ground": far}
    more["gravity"] = [0.0, -GRAVITY]
    return compiled(scene(bodies, joints, end=end, steps=50, record=record, **more))


def branches(result: Result) -> list[int]:
    """Which closure each recorded position is, checked to be one."""
    found = []
    for crank, *angles in result.values[:, :3]:
        off = np.array([np.subtract(pair, angles) for pair in closures(crank)])
        away = np.abs((off + math.pi) % (2.0 * math.pi) - math.pi).max(axis=1)
        assert away.min() < 1e-6
        found.append(int(np.argmin(away)))
    return found


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-9])
@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
def test_a_change_point_is_passed_straight_on(integrator: str, rtol: float) -> None:
    """The other motion would keep coupler and rocker on their side of the line."""
    rtol = max(rtol, TIGHTEST.get(integrator, 0.0))
    result = simulate(four_bar(), integrator=integrator, rtol=rtol)
    crank, branch = result["crank.angle"], branches(result)
    assert crank.max() > 0.1 and crank[-1] < -0.3
    assert branch == [int(angle > 0.0) for angle in crank]


@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
@pytest.mark.parametrize("driven", [True, False], ids=["driven", "free"])
@pytest.mark.parametrize("turning", [-1.0, 1.0], ids=["folding", "together"])
def test_velocities_choose_the_motion_out_of_a_singular_start(
    integrator: str, driven: bool, turning: float
) -> None:
    system = slider_crank(
        QUARTER,
        speeds=(1.0, turning),
        drive=polynomial(QUARTER, 1.0) if driven else None,
        end=1.0,
    )
    result = simulate(system, integrator=integrator, rtol=1e-6)
    angle = result["crank.angle"]
    straight = 2.0 * np.cos(angle) if turning < 0.0 else 0.0 * angle
    assert result["piston.x"] == pytest.approx(straight, abs=1e-6)
    rod = -angle if turning < 0.0 else angle - math.pi
    assert result["rod.angle"] == pytest.approx(rod, abs=1e-6)
    assert np.isnan(result.multipliers[0]).all()
    assert np.isfinite(result.multipliers[1:]).all()


@pytest.mark.parametrize("driven", [True, False], ids=["driven", "free"])
def test_velocities_of_neither_motion_are_refused(driven: bool) -> None:
    drive = polynomial(QUARTER, 1.0) if driven else None
    system = slider_crank(QUARTER, speeds=(1.0, 0.3), drive=drive)
    with pytest.raises(InputError, match="starts in a singular position.*lead nowhere"):
        simulate(system)


@pytest.mark.parametrize("sideways", [0.0, 1.0], ids=["balanced", "pushed"])
def test_rest_in_a_singular_position_is_refused(sideways: float) -> None:
    """Forces alone do not say which way it gives."""
    system = slider_crank(QUARTER, gravity=[sideways, -GRAVITY])
    with pytest.raises(InputError, match="rests in a singular position") as failure:
        simulate(system)
    assert "initial velocities" in str(failure.value)


def test_a_piston_that_is_pulled_out_of_its_dead_centre_is_refused() -> None:
    """The crank may turn either way: cos, from the outermost place and at rest."""
    pull = {"type": "harmonic", "amplitude": 0.1, "offset": 2.4, "phase": QUARTER}
    drive = {
        "marker": "piston",
        "coordinate": "x",
        "function": {**pull, "angular_frequency": 1.0},
    }
    with pytest.raises(InputError, match="rests in a singular position"):
        simulate(slider_crank(0.0, rod=1.5, drive=drive))


@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
def test_a_drive_beyond_reach_stops_where_the_mechanism_is_stretched(
    integrator: str,
) -> None:
    """The piston at 0.1 m/s gets to 2.5 m, no farther: what was computed is kept."""
    start = math.cos(0.4) + math.sqrt(1.5**2 - math.sin(0.4) ** 2)
    drive = {
        "marker": "piston",
        "coordinate": "x",
        "function": polynomial(start, 0.1),
    }
    system = slider_crank(0.4, rod=1.5, drive=drive)
    with pytest.raises(SimulationError, match="stopped at t = ") as failure:
        order = INTEGRATORS[integrator].order
        simulate(system, integrator=integrator, rtol=1e-6 if order > 2 else 1e-4)
    result = failure.value.result
    assert result is not None and not result.completed
    assert failure.value.code in {"N302", "N303"} and failure.value.data["fastest"]
    reached = (2.5 - start) / 0.1
    stopped = float(result.message.split("t = ")[1].split(" s")[0])
    assert stopped == pytest.approx(reached, abs=1e-6)
    assert result.t[-1] == pytest.approx(stopped, abs=1e-8)
    assert result["piston.x"] == pytest.approx(start + 0.1 * result.t, abs=1e-9)
    assert np.isfinite(result.values[:-1]).all()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_forces_near_a_singular_position_are_right_or_missing(integrator: str) -> None:
    """A parallelogram whose bars lie on one line at t = 0.5 s.

    The coupler moves on a circle without rotation, so that its pins share its inertia;
    nothing turns the rocker, whose pin force -(m_rocker + m_coupler) r w^2 / 2 points
    along it. Beside it the ends of a bar glide along x and y, its centre c moves on a
    circle, and the forces there are those of -m w^2 c, always.
    """
    bodies = {
        "crank": slender_rod(1.0, angle=QUARTER),
        "rocker": slender_rod(1.0, position=[2.0, 0.0], angle=QUARTER),
        "coupler": slender_rod(2.0, position=[0.0, 1.0]),
        "bar": slender_rod(
            1.0,
            position=[-math.cos(2.0), 0.0],
            angle=2.0,
            velocity=[2.0 * math.sin(2.0), 0.0],
            angular_velocity=2.0,
        ),
    }
    hinges = {
        "motor": ["ground", "crank.a"],
        "foot": ["ground.far", "rocker.a"],
        "head": ["crank.b", "coupler.a"],
        "end": ["coupler.b", "rocker.b"],
    }
    glide: dict[str, dict[str, Any]] = {
        "floor": {"markers": ["ground", "bar.a"], "axis": [1.0, 0.0]},
        "wall": {"markers": ["ground", "bar.b"], "axis": [0.0, 1.0]},
    }
    joints = {n: {"type": "revolute", "markers": m} for n, m in hinges.items()}
    joints |= {n: {"type": "point_on_line", **joint} for n, joint in glide.items()}
    drives = {"drive": {"joint": "motor", "function": polynomial(QUARTER, math.pi)}}
    distances = np.array([1e-1, 1e-2, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6, 1e-8, 0.0])
    times = np.concatenate([[0.0], 0.5 - distances, [0.75]])
    system = compiled(
        scene(
            bodies,
            joints,
            drives,
            record=["foot.fx", "foot.fy", "rocker.ax", "wall.fx", "floor.fy"],
            ground={"markers": {"far": {"position": [2.0, 0.0]}}},
            time={"end": 0.75, "output_times": times.tolist()},
        )
    )
    result = simulate(system, integrator=integrator, rtol=1e-6)
    angle = QUARTER + math.pi * times
    force = np.column_stack([result["foot.fx"], result["foot.fy"]])
    exact = -(math.pi**2) * np.column_stack([np.cos(angle), np.sin(angle)])
    has_value = np.isfinite(force).all(axis=1)
    assert force[has_value] == pytest.approx(exact[has_value], abs=1e-3 * math.pi**2)
    assert has_value[[0, 1, 2, 3, -1]].all() and not has_value[-2]
    assert np.isfinite(result["rocker.ax"]).all()
    direction = 2.0 + 2.0 * times
    assert result["wall.fx"] == pytest.approx(2.0 * np.cos(direction), abs=1e-4)
    assert result["floor.fy"] == pytest.approx(-2.0 * np.sin(direction), abs=1e-4)
    (note,) = (d for d in result.diagnostics if d.code == "N234")
    assert {"foot.fx", "foot.fy"} <= set(note.subject.split(", "))
    assert note.data["count"] == np.count_nonzero(~has_value)
    assert note.t == times[~has_value][0]


@pytest.mark.parametrize("is_beside_friction", [False, True])
def test_a_load_that_begins_at_zero_has_forces_from_the_start(
    is_beside_friction: bool,
) -> None:
    """A heavy body (2 kg m^2 about its centre, 1.36 kg m^2 more about the pin) on a
    light one in a pin, whose constraints are nearly dependent in the metric of masses.
    A block beside it breaks loose at the start.
    """
    ramp = {
        "type": "actuator",
        "function": {"type": "table", "times": [0.0, 0.1], "values": [0.0, 10.0]},
    }
    bodies: dict[str, Any] = {
        "light": {"mass": 1e-6, "inertia": 1.0},
        "heavy": {
            "mass": 4.0,
            "inertia": 2.0,
            "markers": {"seat": {"position": [-0.5, -0.3]}},
            "initial": {"position": [0.5, 0.3]},
        },
    }
    joints: dict[str, Any] = {
        "pin": {"type": "revolute", "markers": ["ground", "light"]},
        "seat": {"type": "fixed", "markers": ["light", "heavy.seat"]},
    }
    forces: dict[str, Any] = {"torque": {**ramp, "joint": "pin"}}
    if is_beside_friction:
        bodies["block"] = {"mass": 1.0, "inertia": 0.1}
        rub = {"friction": {"coefficient": 0.3}}
        joints["rail"] = {"type": "prismatic", "markers": ["ground", "block"], **rub}
        forces["push"] = {**ramp, "joint": "rail"}
    tables = {"record": ["seat.mz"], "forces": forces}
    result = simulate(compiled(scene(bodies, joints, end=0.1, steps=2, **tables)))
    wanted = 3.36 / 4.36 * np.array([0.0, 5.0, 10.0])
    assert result["seat.mz"] == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert with_code(result, "N234") == []


def test_joints_that_contradict_each_other_are_refused() -> None:
    """A bar pinned at both ends to points that are too far apart."""
    bar = slender_rod(1.0)
    joints = {
        "left": {"type": "revolute", "markers": ["ground", "bar.a"]},
        "right": {"type": "revolute", "markers": ["ground.far", "bar.b"]},
    }
    far = {"markers": {"far": {"position": [1.1, 0.0]}}}
    with pytest.raises(
        InputError, match="left and right contradict.* come no nearer than 0.1 m"
    ):
        simulate(compiled(scene({"bar": bar}, joints, ground=far)))


def test_drives_that_contradict_each_other_later_stop_the_run() -> None:
    """Two cranks of a parallelogram turn alike until one of them goes faster."""
    bodies: dict[str, Any] = {
        "left": slender_rod(1.0, angle=QUARTER),
        "right": slender_rod(1.0, position=[2.0, 0.0], angle=QUARTER),
        "bar": slender_rod(2.0, position=[0.0, 1.0]),
    }
    hinges = {
        "foot": ["ground", "left.a"],
        "other": ["ground.far", "right.a"],
        "head": ["left.b", "bar.a"],
        "end": ["bar.b", "right.b"],
    }
    joints = {n: {"type": "revolute", "markers": m} for n, m in hinges.items()}
    pieces = [
        {"from": 0.0, "to": 0.5, "coefficients": [QUARTER, 0.2]},
        {"from": 0.5, "coefficients": [QUARTER + 0.1, 0.2, 1.0]},
    ]
    drives = {
        "slow": {"joint": "foot", "function": polynomial(QUARTER, 0.2)},
        "fast": {
            "joint": "other",
            "function": {"type": "polynomial", "pieces": pieces},
        },
    }
    far = {"markers": {"far": {"position": [2.0, 0.0]}}}
    record = ["left.angle", "slow.f1", "fast.f1"]
    system = compiled(scene(bodies, joints, drives, record=record, ground=far))
    with pytest.raises(SimulationError, match="stopped at t = 0.5") as failure:
        simulate(system)
    result = failure.value.result
    assert result is not None
    names = "foot, slow, other, fast, head and end contradict each other"
    assert names in result.message
    assert result.t[-1] == pytest.approx(0.5)
    assert np.isfinite(result.values).all()
