"""Runs that cannot go on: what they say, and what they keep."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.solver import compile_scene, inverse_dynamics, simulate
from sidtool.solver.analyses.dense_equations import DenseEquations
from sidtool.solver.analyses.static_equilibrium import _check_equilibrium
from sidtool.solver.diagnostics import failure_causes
from sidtool.solver.initial_state.given_state import initial_estimate
from sidtool.solver.initial_state.integrator_start import run_settings
from sidtool.solver.integrators import loop_state
from sidtool.solver.simulation import simulate as simulate_module
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.system import work_arrays
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays
from tests.places import ROOT
from tests.solver.scenes import compiled, polynomial, scene, slender_rod


def stopped(system: System, **settings: Any) -> Result:
    with pytest.raises(SimulationError) as failure:
        simulate(system, **settings)
    result = failure.value.result
    assert result is not None and not result.completed
    assert str(failure.value) == result.message
    assert result.diagnostics[: len(failure.value.diagnostics)] == (
        failure.value.diagnostics
    )
    assert failure.value.diagnostics[0].severity == "error"
    assert np.isfinite(result.values).all()
    return result


def flywheel(speed: float) -> System:
    """A wheel of 1 kg m2 that winds up a spring of 1 N m / rad: speed cos t."""
    wheel = {
        "mass": 1.0,
        "inertia": [0.5, 0.5, 1.0],
        "initial": {"angular_velocity": [0.0, 0.0, speed]},
    }
    axle = {"type": "revolute", "markers": ["ground", "wheel"]}
    spring = {"type": "spring_damper", "joint": "axle", "stiffness": 1.0}
    described = scene(
        {"wheel": wheel},
        {"axle": axle},
        dimension="spatial",
        forces={"spring": spring},
        record=["wheel.wz", "energy.balance", "energy.supplied"],
    )
    return compiled(described)


def test_a_run_that_fails_in_its_first_step_keeps_the_start() -> None:
    """60 rad/s in steps of 0.05 s are 3 rad each, more than can be counted."""
    result = stopped(flywheel(60.0), step=0.05)
    assert result.diagnostics[0].code == "N318"
    assert result.diagnostics[0].data["limit"] == 2.5
    assert result.t == pytest.approx([0.0], abs=0)
    assert result["wheel.wz"] == pytest.approx([60.0])
    assert result["energy.supplied"] == pytest.approx([0.0], abs=0)


def test_the_last_state_before_a_stop_is_kept() -> None:
    """A point between two rods, one of which grows, until both are stretched."""
    ground = {"markers": {"p": {"position": [1.5, 0.0]}}}
    joints = {
        "rod": {"type": "distance", "markers": ["ground.p", "a"], "length": 1.2},
        "growing": {"type": "distance", "markers": ["ground", "a"]},
    }
    pieces = [{"from": 0.0, "coefficients": [0.5, 1.0]}]
    growth = {"joint": "growing", "function": {"type": "polynomial", "pieces": pieces}}
    described = scene(
        {"a": {"mass": 1.0, "initial": {"position": [0.35, 0.35]}}},
        joints,
        {"growth": growth},
        end=5.0,
        steps=5,
        ground=ground,
        record=["a.x", "a.y"],
    )
    result = stopped(compiled(described))
    assert result.t[:-1] == pytest.approx([0.0, 1.0, 2.0], abs=0)
    assert result.t[-1] == pytest.approx(2.2, abs=1e-6)
    length = 0.5 + result.t
    assert np.hypot(result["a.x"], result["a.y"]) == pytest.approx(length, abs=1e-9)


def test_an_interval_that_cannot_be_entered_keeps_what_was_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a push that ends after 0.5 s, where the equations become singular."""
    begin = simulate_module.Run._evaluate_start

    def fails_later(self: simulate_module.Run) -> int:
        return 2 if self.current_time > 0.0 else begin(self)

    monkeypatch.setattr(simulate_module.Run, "_evaluate_start", fails_later)
    pieces = [
        {"from": 0.0, "to": 0.5, "coefficients": [3.0]},
        {"from": 0.5, "coefficients": [0.0]},
    ]
    push = {
        "type": "force",
        "marker": "block",
        "force": [2.0, 0.0],
        "function": {"type": "polynomial", "pieces": pieces},
    }
    joints = {"rail": {"type": "prismatic", "markers": ["ground", "block.a"]}}
    described = scene(
        {"block": slender_rod(1.0, 4.0)},
        joints,
        forces={"push": push},
        steps=4,
        record=["block.x", "block.ax"],
    )
    result = stopped(compiled(described))
    assert (result.diagnostics[0].code, result.diagnostics[0].t) == ("N310", 0.5)
    assert result.t == pytest.approx([0.0, 0.25, 0.5])
    assert result["block.x"] == pytest.approx(0.75 * result.t**2, abs=1e-9)
    assert result["block.ax"] == pytest.approx([1.5] * 3)


@pytest.mark.parametrize("place", [-1e20, 3e18])
def test_a_mechanism_beyond_all_sizes_stops_with_the_cause(place: float) -> None:
    """Mass matrices of elastic coordinates of 1e20 have no scale, nor eigenvalues."""
    folder = ROOT / "examples" / "slider_crank"
    data = read_scene(folder / "slider_crank.toml").model_dump(exclude_none=True)
    data["bodies"]["crank"]["markers"]["bearing"]["position"] = [place, 0.0]
    data["bodies"]["rod"]["quadratic_inertia"] = False
    result = stopped(compile_scene(SceneFile.model_validate(data), folder), rtol=1e-2)
    assert "stopped at t = 0 s" in result.message


@pytest.mark.parametrize("worst", [-1e300, 0.0, np.nan])
def test_matrices_without_a_scale_are_not_positive(worst: float) -> None:
    M = np.eye(3) * [1.0, 2.0, worst] + 1e200 * np.eye(3)[::-1]
    assert failure_causes._smallest_scaled_eigenvalue(M) == -np.inf
    assert failure_causes._smallest_scaled_eigenvalue(
        np.array([[4.0, 1.0], [1.0, 1.0]])
    ) == pytest.approx(0.5)


@pytest.mark.parametrize("step", [0, 1])
def test_the_integrator_of_a_run_is_not_advised_to_it(step: int) -> None:
    """Methods that pass singular positions themselves are no remedy for themselves."""
    state: dict[str, Any] = {"time": 0.0, "z": np.array([np.nan]), "fixed_step": step}
    near = SimpleNamespace(largest_independence=1.0, independence=1e-3, **state)
    apart = SimpleNamespace(largest_independence=1.0, independence=0.5, **state)
    for passes in (True, False):
        found = failure_causes.near_singular_cause(None, near, passes)
        assert found is not None and found.code == "N310"
        assert ("radau9" in found.remedy) != passes
        assert ("tolerance" in found.remedy) == (step == 0)
        assert failure_causes.near_singular_cause(None, apart, passes) is None


@pytest.mark.parametrize("integrator", ["radau9", "dop853"])
def test_no_step_is_advised_where_none_can_help(integrator: str) -> None:
    """A crank of 1 m on a link of 0.5 m is turned beyond 30 degrees."""
    slider = scene(
        {"rod": slender_rod(1.0), "link": slender_rod(0.5, position=[1.0, 0.0])},
        {
            "a": {"type": "revolute", "markers": ["ground", "rod.a"]},
            "b": {"type": "revolute", "markers": ["rod.b", "link.a"]},
            "c": {"type": "point_on_line", "markers": ["ground", "link.b"]},
        },
        {"turn": {"joint": "a", "function": polynomial(0.0, 1.0)}},
    )
    result = stopped(compiled(slider), integrator=integrator, step=1e-2)
    stop, cause = result.diagnostics[:2]
    assert stop.code in {"N303", "N304"}
    assert cause.code == "N313" and set(cause.data["joints"]) >= {"a", "b", "c"}
    assert cause.data["later"] > stop.t


@pytest.mark.parametrize(
    ("ended", "code"),
    [
        (loop_state.NOT_FINITE, "N301"),
        (loop_state.TOO_SMALL, "N302"),
        (loop_state.OFF_CONSTRAINTS, "N303"),
        (loop_state.NO_CONVERGENCE, "N304"),
        (loop_state.TOO_STIFF, "N305"),
        (loop_state.BELOW_ROUNDING, "N306"),
    ],
)
def test_each_end_of_a_step_loop_has_its_code(ended: int, code: str) -> None:
    system = flywheel(1.0)
    settings = run_settings(system, "radau9", 1e-6, 0.01, None)
    found = failure_causes.step_loop_failure(ended, "wheel", settings, 0.5)
    assert (found.code, found.severity, found.t) == (code, "error", 0.5)


def two_bodies() -> tuple[System, at.WorkArrays, Any]:
    """A ship of 1e6 kg and a fly of 1e-9 kg, evaluated at rest."""
    bodies = {"ship": {"mass": 1e6, "inertia": 1e6}}
    bodies["fly"] = {"mass": 1e-9, "inertia": 1e-9}
    system = compiled(scene(bodies, {}))
    work, start = new_work_arrays(system), initial_estimate(system)
    work_arrays.evaluate(system, work, 0.0, start.z, start.v)
    return system, work, start.z


def test_inertia_that_rounding_hides_is_a_possible_cause() -> None:
    system, work, _ = two_bodies()
    found = failure_causes.mass_rounding_cause(system, work)
    assert found is not None
    assert (found.code, found.subject, found.severity) == ("N309", "fly", "warning")
    assert found.data["heaviest"] == "ship" and float(str(found.data["ratio"])) < 1e-14


def hinged_rod(offset: float) -> DenseEquations:
    """A rod whose hinge is open by an offset [m]."""
    joints = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    system = compiled(scene({"rod": slender_rod(1.0)}, joints))
    mechanics = DenseEquations(system, 0.0, 0.5)
    start = initial_estimate(system)
    start.z[0] += offset
    mechanics.evaluate(start.z, start.v)
    return mechanics


def test_an_open_joint_is_no_equilibrium() -> None:
    with pytest.raises(SimulationError) as failure:
        _check_equilibrium(hinged_rod(0.1), np.zeros((3, 0)))
    assert failure.value.code == "N702" and "pin" in str(failure.value.data["gaps"])


def test_rates_that_do_not_exist_name_their_joints() -> None:
    """A table on two screws: one lifts it by t, the other by t + t^3 (t - 0.1). At
    t = 0.1 s both demand the same height, and rates that differ by 0.001 m/s."""
    markers = {"l": {"position": [-1.0, 0.0]}, "r": {"position": [1.0, 0.0]}}
    table = {"mass": 2.0, "inertia": 1.0, "markers": markers}
    joints, drives = {}, {}
    lifts = {"l": (0.0, 1.0), "r": (0.0, 1.0, 0.0, -0.1, 1.0)}
    for name, coefficients in lifts.items():
        ends = [f"ground.{name}", f"table.{name}"]
        joints[name] = {"type": "prismatic", "markers": ends, "axis": [0.0, 1.0]}
        drives[f"screw_{name}"] = {"joint": name, "function": polynomial(*coefficients)}
    more = {"ground": {"markers": markers}, "end": 0.5, "steps": 5}
    system = compile_scene(
        scene({"table": table}, joints, drives, **more), keep_joints=True
    )
    with pytest.raises(SimulationError) as failure:
        inverse_dynamics(system)
    assert failure.value.code == "N723" and failure.value.data["rates"] == "velocities"
    assert {"screw_l", "screw_r"} <= set(failure.value.data["joints"])
    assert failure.value.result is not None
    assert failure.value.result.t == pytest.approx([0.0], abs=0)
