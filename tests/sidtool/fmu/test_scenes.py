"""Units of arms in space, of controllers, and of what is refused."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.fmu.supported import UNIT_INTEGRATORS
from tests.places import EXAMPLES
from tests.sidtool.fmu.conftest import Export, slider_crank
from tests.sidtool.fmu.importer import DISCARD, ERROR, OK, Instance
from tests.sidtool.fmu.test_units import difference
from tests.steel_bars import steel_bar

needs_cc = pytest.mark.needs("cc")
TORQUES = {"yaw": 20.0, "shoulder": -90.0, "elbow": -20.0}


@pytest.fixture(scope="session")
def tube() -> sidtool.SID:
    """An arm of 1 m, with the markers 1 and 2 at its ends."""
    model = sidtool.Model.load(EXAMPLES / "controlled_arm" / "arm.toml")
    return sidtool.convert(model)


def spatial_arm(tube: sidtool.SID, **changes: Any) -> sidtool.Scene:
    """Turntable, two flexible arms and a payload, with torques of motors as inputs."""
    y = {"type": "revolute", "axis": [0.0, 1.0, 0.0]}
    markers = {"base": 1, "tip": 2}
    bodies: dict[str, Any] = {
        "turntable": {
            "mass": 30.0,
            "inertia": [0.4, 0.4, 0.6],
            "markers": {"top": {"position": [0.0, 0.0, 0.4]}},
        },
        "upper": {
            "sid": tube,
            "markers": markers,
            "initial": {"position": [0.0, 0.0, 0.4]},
        },
        "fore": {
            "sid": tube,
            "markers": markers,
            "initial": {"position": [1.0, 0.0, 0.4]},
        },
        "payload": {
            "mass": 2.0,
            "inertia": [0.02, 0.02, 0.02],
            "initial": {"position": [2.0, 0.0, 0.4]},
        },
    }
    scene = sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        time={"end": 0.2, "output_step": 0.02},
        accuracy={"integrator": "radau9", "rtol": 1e-7},
        bodies=bodies,
        joints={
            "yaw": {"type": "revolute", "markers": ["ground", "turntable"]}
            | {"axis": [0.0, 0.0, 1.0]},
            "shoulder": y | {"markers": ["turntable.top", "upper.base"]},
            "elbow": y | {"markers": ["upper.tip", "fore.base"]},
            "flange": {"type": "fixed", "markers": ["fore.tip", "payload"]},
        },
        inputs={name: {"initial": value} for name, value in TORQUES.items()},
        forces={
            f"{name}_motor": {
                "type": "actuator",
                "joint": name,
                "function": {"type": "input", "name": name},
            }
            for name in TORQUES
        },
        outputs={
            "record": [
                *("payload.x", "payload.vz", "fore.tip.ax", "fore.tip.uz", "fore.q*"),
                *("yaw.angle", "elbow.angle_rate", "energy.kinetic", "flange.fz"),
                *("shoulder_motor.power", "payload.wy", "elbow_motor.torque"),
                *("payload.quaternion_0", "payload.quaternion_2", "fore.rotation_y"),
                *("fore.tip.angle", "upper.tip.rotation_z", "upper.momentum_z"),
            ]
        },
    )
    return scene.with_(changes)


@needs_cc
def test_an_arm_in_space_moves_as_its_run(tube: sidtool.SID, export: Export) -> None:
    scene = spatial_arm(tube)
    result, library = scene.simulate(), export(scene)
    for length in (1e-1, 1e-2):
        rows = np.array(Instance(library).run(0.2, length))
        times = np.linspace(0.0, 0.2, len(rows))
        common = [k for k, t in enumerate(times) if np.isclose(result.t, t).any()]
        for column, name in zip(rows[common].T, result.names, strict=True):
            expected = result[name][np.isin(result.t.round(9), times.round(9))]
            size = max(np.abs(result[name]).max(), 1e-6)
            assert np.abs(column - expected).max() < 1e-9 * size, name


@needs_cc
def test_motors_of_an_arm_follow_their_inputs(
    tube: sidtool.SID, export: Export
) -> None:
    """Torques that jump every 20 ms, as tables of held values in a run."""
    scene = spatial_arm(tube, **{"accuracy.rtol": 1e-9})
    times = [0.02 * k for k in range(10)]
    tables = {
        name: (times, [value * np.cos(9.0 * t + value) for t in times])
        for name, value in TORQUES.items()
    }
    result, instance = scene.simulate(inputs=tables), Instance(export(scene))
    for k, time in enumerate(times):
        for name, (_, values) in tables.items():
            assert instance.set(name, values[k]) == OK
        assert instance.step(time, 0.02) == OK
    names = ["payload.x", "fore.q1", "yaw.angle", "energy.kinetic"]
    for name, value in zip(names, instance.get(names), strict=True):
        assert abs(value - result[name][-1]) < 1e-7 * np.abs(result[name]).max()


@needs_cc
@pytest.mark.parametrize("file", ["scene.toml", "sampled.toml"])
def test_controllers_move_as_in_a_run(
    file: str, tube: sidtool.SID, export: Export
) -> None:
    """A PID controller with limits and states, continuous and sampled each 2 ms.

    Communication points between the samples change nothing.
    """
    scene = sidtool.Scene.load(EXAMPLES / "controlled_arm" / file)
    scene = scene.with_(
        {"bodies.arm.sid": tube, "time.end": 0.5, "accuracy.integrator": "radau9"}
    )
    result, library = scene.simulate(), export(scene)
    for length in (1e-2, 2.5e-3):
        rows = Instance(library).run(0.5, length)
        assert difference(rows, result, round(1e-2 / length)) < 1e-10


@needs_cc
def test_a_sample_at_the_start_knows_the_rate_of_its_reference(export: Export) -> None:
    """A reference along a straight line, which the importer sets after the start."""
    law = {"type": "pid", "measured": "pivot.angle", "p": 60.0, "d": 2.0}
    law |= {"filter": 0.01, "sample_time": 0.05}
    scene = sidtool.Scene(
        dimension="planar",
        time={"end": 0.3, "output_step": 0.1},
        inputs={"goal": {"unit": "rad", "interpolation": "linear"}},
        bodies={"arm": {"mass": 1.0, "inertia": 0.3}},
        joints={"pivot": {"type": "revolute", "markers": ["ground", "arm"]}},
        forces={
            "motor": {
                "type": "actuator",
                "joint": "pivot",
                "function": law | {"reference": {"type": "input", "name": "goal"}},
            }
        },
        outputs={"record": ["pivot.angle", "motor.value"]},
    )
    result = scene.simulate(inputs={"goal": ([0.0, 0.1], [0.0, 0.3])})
    instance, rows = Instance(export(scene)), []
    for time in (0.0, 0.1, 0.2):
        assert instance.set("goal", 0.3) == OK
        assert instance.step(time, 0.1) == OK
        rows.append(instance.get())
    errors = np.abs(rows - result.values[1:]).max(axis=0)
    assert np.all(errors < 1e-7 * np.abs(result.values).max(axis=0))


def test_roots_and_products_are_outputs(tube: sidtool.SID) -> None:
    """Polynomials of the second degree, found from the writer of columns, have its
    values; its own function is the reference."""
    from sidtool.fmu.plant_table import output_terms, plant_tables
    from sidtool.fmu.supported import unit_settings
    from sidtool.solver import compile_scene
    from sidtool.solver.initial_state.integrator_start import run_settings

    names = ("payload.vx", "payload.ay", "shoulder_motor.power", "upper.vy_body")
    scene = spatial_arm(tube, **{"outputs.record": list(names)})
    system = compile_scene(scene, sids={"upper": tube, "fore": tube})
    tables = plant_tables(system, unit_settings(run_settings(system, *[None] * 4)))
    found = {terms.name: terms for terms in output_terms(tables, names)}
    assert all(t.second for t in found["payload.vx"].terms)
    assert len(found["payload.vx"].terms) == 3
    assert [t.weight for t in found["upper.vy_body"].terms] == [1.0]


UNSUPPORTED = {
    "integrator": ({"accuracy.integrator": "dop853"}, "accuracy.integrator"),
    "stick-slip": (
        {"joints.crank_pin.friction": {"coefficient": 0.1, "radius": 0.01}},
        "joints",
    ),
    "integral": ({"outputs.record": ["energy.dissipated"]}, "outputs"),
    "residual": ({"outputs.record": ["constraint.position"]}, "outputs"),
    "name": (
        {
            "inputs.time": {"initial": 0.0},
            "forces.load.function": {"type": "input", "name": "time"},
        },
        "inputs",
    ),
}


@pytest.mark.parametrize("case", UNSUPPORTED)
def test_what_a_unit_cannot_do_is_refused_by_name(case: str, tmp_path: Path) -> None:
    changes, place = UNSUPPORTED[case]
    with pytest.raises(sidtool.InputError) as refused:
        slider_crank(**changes).fmu(tmp_path / "machine.fmu")
    assert place in (refused.value.place or "")


def test_without_a_compiler_the_way_to_one_is_said(tmp_path: Path) -> None:
    with pytest.raises(sidtool.InputError) as refused:
        slider_crank().fmu(tmp_path / "machine.fmu")
    assert "sidtool[fmu]" in str(refused.value)


def test_integrators_of_units_exist() -> None:
    from sidtool.solver.integrators.registry import INTEGRATORS

    for name in UNIT_INTEGRATORS:
        assert INTEGRATORS[name].singular_loop and not INTEGRATORS[name].explicit


@needs_cc
def test_what_has_no_effect_in_a_unit_gets_a_note(
    without_library: None, tmp_path: Path
) -> None:
    """Events that only record (N601), and tables of inputs (N602)."""
    event = {"quantity": "piston.x", "value": 1.05}
    table = {"initial": 5.0, "times": [0.0, 0.1], "values": [0.0, 1.0]}
    scene = slider_crank(**{"events.pass": event, "inputs.load": table})
    unit = scene.fmu(tmp_path / "machine.fmu")
    found = {(each.code, each.subject) for each in unit.diagnostics}
    assert found >= {("N601", "pass"), ("N602", "load")}
    assert [v.start for v in unit.inputs] == [5.0]


@needs_cc
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_an_event_ends_the_motion_where_it_ends_a_run(
    export: Export, version: str
) -> None:
    """The second time that the piston passes a position, within and over steps."""
    event = {"quantity": "piston.x", "value": 1.05, "action": "stop", "count": 2}
    scene = slider_crank(**{"events.pass": event, "outputs.record": ["piston.x"]})
    end = scene.simulate().t[-1]
    assert 0.1 < end < 0.5
    library = export(scene, version=version)
    for length in (1e-1, 1e-2, 1e-4):
        _check_end(Instance(library), end, length)


def _check_end(instance: Instance, end: float, length: float) -> None:
    """Advance to the event, which ends a step early."""
    step, status = 0, OK
    while status == OK and instance.get(["time"])[0] < end - 1e-9:
        status = instance.step(step * length, length)
        step += 1
    time, position = instance.get(["time", "piston.x"])
    assert abs(time - end) < 1e-11 and abs(position - 1.05) < 1e-12
    if instance.library.version == "2.0":
        terminated = ctypes.c_int()
        assert status == DISCARD
        assert instance.call("GetBooleanStatus", 3, ctypes.byref(terminated)) == OK
        assert terminated.value == 1
    else:
        assert status == OK and instance.ends and instance.early
    assert instance.step(time, length) == ERROR


@needs_cc
def test_large_blocks_are_factored_without_lapack(export: Export) -> None:
    """A rod of 26 modes: kernels call LAPACK from 24 rows on, a unit its own LU."""
    rod = steel_bar(elements=16, modes=26)
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -9.81],
        time={"end": 0.02, "output_step": 0.01},
        accuracy={"integrator": "radau9", "rtol": 1e-6},
        bodies={"rod": {"sid": rod, "markers": {"root": 1, "tip": 2}}},
        joints={"pin": {"type": "revolute", "markers": ["ground", "rod.root"]}},
        outputs={"record": ["rod.tip.y", "rod.q1", "pin.angle"]},
    )
    rows = Instance(export(scene)).run(0.02, 1e-3)
    assert difference(rows, scene.simulate(), 10) < 1e-9


@needs_cc
def test_dead_points_are_passed(export: Export) -> None:
    """A four-bar with equal opposite sides, which another step loop takes through."""
    arm = {"mass": 1.0, "inertia": 0.1, "centre_of_mass": [0.5, 0.0]}
    ends = {"a": {"position": [0.0, 0.0]}, "b": {"position": [1.0, 0.0]}}
    start = {"angle": 1.0, "velocity": [0.0, 0.0], "angular_velocity": 3.0}
    x, y = np.cos(1.0), np.sin(1.0)
    coupler = {
        "mass": 1.0,
        "inertia": 0.4,
        "centre_of_mass": [1.0, 0.0],
        "initial": {"position": [x, y], "velocity": [-3.0 * y, 3.0 * x]},
        "markers": {"a": {"position": [0.0, 0.0]}, "b": {"position": [2.0, 0.0]}},
    }
    pairs = {
        "o1": ["ground", "crank.a"],
        "o2": ["crank.b", "coupler.a"],
        "o3": ["rocker.b", "coupler.b"],
        "o4": ["ground.p", "rocker.a"],
    }
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, 0.0],
        time={"end": 2.0, "output_step": 0.1},
        accuracy={"integrator": "radau9", "rtol": 1e-8},
        ground={"markers": {"p": {"position": [2.0, 0.0]}}},
        bodies={
            "crank": arm | {"markers": ends, "initial": start | {"position": [0, 0]}},
            "coupler": coupler,
            "rocker": arm | {"markers": ends, "initial": start | {"position": [2, 0]}},
        },
        joints={n: {"type": "revolute", "markers": m} for n, m in pairs.items()},
        outputs={"record": ["crank.angle", "rocker.angle", "energy.kinetic"]},
    )
    rows = Instance(export(scene)).run(2.0, 0.05)
    assert difference(rows, scene.simulate(), 2) < 1e-9
