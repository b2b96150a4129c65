"""Compiled scenes with other numbers: runs of scenes that say them from the start."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.api import prepared_scene
from sidtool.api.compiled_scene import CompiledScene
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.toml.files import File
from tests.codes import codes
from tests.solver.test_renumbered import (
    driven_points,
    other_numbers,
    rubbing_chain,
    turning_links,
)

FOUNDING = Path(__file__).parents[3] / "examples" / "slider_crank"
#: A rubbing arm in space, held by a controller and a spring, with a load at its end.
ARM = """
format = "sidtool scene"
version = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
parameters = { reach = 0.5 }
time = { end = 0.08, output_step = 0.02 }

[bodies.arm]
mass = 2.0
inertia = [0.01, 0.09, 0.09]
centre_of_mass = [0.2, 0.0, 0.0]
markers.shoulder = { position = [0.0, 0.0, 0.0] }
markers.wrist = { position = ["reach", 0.0, 0.0] }
initial = { angular_velocity = [0.0, 0.5, 0.0] }

[bodies.load]
mass = 0.4
inertia = [1e-3, 2e-3, 1e-3]
initial = { position = ["reach", 0.0, 0.0] }

[joints.shoulder]
type = "revolute"
markers = ["ground", "arm.shoulder"]
axis = [0.0, 1.0, 0.0]
friction = { coefficient = 0.2, radius = 0.02 }

[joints.wrist]
type = "spherical"
markers = ["arm.wrist", "load"]

[forces.motor]
type = "actuator"
joint = "shoulder"
[forces.motor.function]
type = "pid"
measured = "shoulder.angle"
p = 30.0
d = 0.4
reference = 0.1

[forces.spring]
type = "spring_damper"
markers = ["ground", "load"]
stiffness = 20.0
damping = 0.3
rest = 0.4

[outputs]
record = ["load.*", "shoulder.f*", "shoulder.friction", "motor.value", "energy.kinetic"]
"""


def stiffer(scale: float) -> SID:
    """The rod of the founding scene with another stiffness, as a new object."""
    sid = copy.deepcopy(sidtool.read(FOUNDING / "rod_q4.SID_FEM"))
    return replace(sid, Ke=Taylor(scale * sid.Ke.m0), De=Taylor(1e-6 * sid.Ke.m0))


@pytest.fixture(scope="module")
def founding() -> sidtool.Scene:
    scene = sidtool.Scene.load(FOUNDING / "slider_crank.toml")
    return scene.with_({"time.end": 0.03, "outputs.record": ["piston.x", "rod.q*"]})


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> sidtool.Scene:
    path = tmp_path_factory.mktemp("arm") / "arm.toml"
    path.write_text(ARM, encoding="utf-8")
    return sidtool.Scene.load(path)


def content_without_times(result: sidtool.Result) -> dict[str, Any]:
    """Return the content of a result without measured times."""
    content = asdict(result)
    for name in ("seconds", "seconds_assembly"):
        content["counters"].pop(name)
    return content


def said_anew(scene: sidtool.Scene, changes: dict[str, Any]) -> sidtool.Scene:
    """The scene with other numbers, read as a whole."""
    return File.with_(scene.model_copy(deep=True), changes)


def assert_as_anew(
    compiled: CompiledScene, changes: dict[str, Any], **sids: SID
) -> sidtool.Result:
    """Numbers bit for bit, counters, notes, verdicts and the scene in the result."""
    result = compiled.run(changes, sids=sids)
    fresh = {name: copy.deepcopy(sid) for name, sid in sids.items()}
    expected = said_anew(compiled.scene, changes).simulate(sids=fresh)
    np.testing.assert_equal(
        content_without_times(result), content_without_times(expected)
    )
    return result


def test_numbers_of_a_planar_scene(founding: sidtool.Scene) -> None:
    compiled = founding.compile()
    first = assert_as_anew(compiled, {})
    for changes in (
        {"crank.mass": 0.7},
        {"crank.centre_of_mass": [0.02, 0.01], "crank.inertia": 3e-4},
        {"crank.markers.pin.position": [0.12, 0.0], "gravity": [0.3, -9.81]},
        {"rod.initial": {"position": [0.1, 0.0], "elastic": [1e-5, 0, 0, 0, 0]}},
        {"rod.initial.position": [0.1, 1e-3], "piston.initial.velocity": [0.4, 0]},
        {"crank_angle.function.pieces[0].end": [30.0, 31.0, 0, 0]}
        | {"crank_angle.function.pieces[1].coefficients": [30.0, 31.0]},
        {"time.end": 0.02, "accuracy.rtol": 1e-8, "slider.axis": [1.0, 0.0]},
    ):
        assert (assert_as_anew(compiled, changes).t != first.t[:1]).any()
    np.testing.assert_equal(
        content_without_times(compiled.run()), content_without_times(first)
    )


def test_other_sids_and_rebuilt_structures(founding: sidtool.Scene) -> None:
    compiled = founding.compile(rigid=())
    assert_as_anew(compiled, {"crank.mass": 0.2}, rod=stiffer(2.0))
    iga = sidtool.read(FOUNDING / "rod_iga.SID_FEM")
    assert_as_anew(compiled, {}, rod=iga)
    assert_as_anew(compiled, {"rod.shape_functions": [1, 2]})
    assert_as_anew(compiled, {"rod.sid": "rod_iga.SID_FEM", "crank.mass": 0.2})
    assert_as_anew(compiled, {"rod.rigid": True})
    whole = founding.compile(sids={"rod": stiffer(3.0)})
    result = whole.run({"piston.mass": 4.0})
    changed = said_anew(founding, {"piston.mass": 4.0})
    expected = changed.simulate(sids={"rod": stiffer(3.0)})
    np.testing.assert_equal(
        content_without_times(result), content_without_times(expected)
    )


def test_numbers_of_a_spatial_scene_with_friction_and_a_law(
    arm: sidtool.Scene,
) -> None:
    compiled = arm.compile()
    for changes in (
        {"parameters.reach": 0.6},
        {"arm.inertia": [0.02, 0.1, 0.11], "load.mass": 0.6},
        {"arm.markers.shoulder.position": [0.02, 0.0, 0.01]},
        {"shoulder.friction.coefficient": 0.35, "spring.stiffness": 33.0},
        {"motor.function.p": 44.0, "arm.initial.angular_velocity": [0.0, -0.4, 0.0]},
        {"shoulder.axis": [0.1, 1.0, 0.0]},
    ):
        assert_as_anew(compiled, changes)


@pytest.mark.parametrize("make", [driven_points, turning_links, rubbing_chain])
def test_numbers_in_any_order(make: Any) -> None:
    """Each run is as one made from the start, whatever ran before it: also where a
    function is not curved any more, and where springs and other tables change."""
    content, sids = make()
    times = {"end": 0.02, "output_step": 0.01}
    scene = sidtool.Scene.checked({**content.file_data(), "time": times}, "scene")
    compiled, rng = scene.compile(sids=sids), np.random.default_rng(3)
    for k in range(5):
        changes = other_numbers(scene, rng)
        changes = {k: v for k, v in changes.items() if not k.endswith("position")}
        if k % 3 == 2 and scene.forces:
            changes |= {"spring.stiffness": 30.0 + k, "spring.damping": 0.0}
        if k % 4 == 3:
            changes |= {"gravity": [0.0, 1.0, 2.0][: 2 if make is turning_links else 3]}
        result = compiled.run(changes)
        fresh = {name: copy.deepcopy(sid) for name, sid in sids.items()}
        expected = said_anew(compiled.scene, changes).simulate(sids=fresh)
        np.testing.assert_equal(
            content_without_times(result), content_without_times(expected)
        )


def test_notes_belong_to_the_numbers_of_the_run(arm: sidtool.Scene) -> None:
    """Looked at late, in any order, and after other runs."""
    compiled = arm.compile()
    strange, plain = compiled.run({"gravity": [0, 0, -9810.0]}), compiled.run()
    moved = compiled.run({"load.initial.position": [0.5, 0.0, 0.1]})
    assert "N201" in codes(strange) and "N221" in codes(moved)
    assert not {"N201", "N221"} & set(codes(plain))


def test_copies_of_unread_results_have_their_notes(
    founding: sidtool.Scene,
) -> None:
    run = founding.compile(rigid=["rod"]).run
    stored, other = pickle.loads(pickle.dumps(run())), replace(run(), title="other")
    expected = run()
    assert codes(expected)[0] == "N240"
    assert stored.diagnostics == other.diagnostics == expected.diagnostics
    assert other.title == "other" and stored.bodies == expected.bodies
    with pytest.raises(AttributeError, match="no 'nothing'"):
        _ = expected.nothing


def test_a_compiled_scene_is_independent_of_the_original_scene() -> None:
    scene = sidtool.Scene.load(FOUNDING / "slider_crank.toml").with_({"time.end": 0.01})
    compiled = scene.compile()
    before = compiled.run()
    scene.bodies["crank"] = scene.bodies["crank"].model_copy(update={"mass": 9.0})
    scene.bodies["rod"].markers["crank_pin"] = "2"
    np.testing.assert_equal(
        content_without_times(compiled.run()), content_without_times(before)
    )


def test_scenes_that_cannot_be_compiled_are_refused(founding: sidtool.Scene) -> None:
    with pytest.raises(sidtool.InputError, match=r"accuracy\.wanted: asks for an accu"):
        founding.with_({"accuracy.wanted": 1e-3}).compile()
    compiled = founding.compile()
    for changes, why in (
        ({"accuracy.wanted": 1e-3}, "asks for an accuracy"),
        ({"crank.mas": 1.0}, "not a known key; expected mass"),
        ({"crank.mass": -1.0}, "greater than 0"),
    ):
        with pytest.raises(sidtool.InputError, match=why):
            compiled.run(changes)
    with pytest.raises(sidtool.InputError, match="rod"):
        compiled.run(sids={"crank": stiffer(1.0)})
    with pytest.raises(sidtool.InputError, match="integrator"):
        compiled.run(integrator="none")
    with pytest.raises(sidtool.SimulationError) as stopped:  # the rod has to stretch
        compiled.run({"crank.markers.pin.position": [0.0, 9.0]})
    assert isinstance(stopped.value.result, sidtool.Result)
    assert not stopped.value.result.completed


def test_runs_in_threads_equal_single_runs_to_the_last_bit(tmp_path: Path) -> None:
    """A flexible mechanism, and an arm with friction, a controller and a spring."""
    (tmp_path / "arm.toml").write_text(ARM, encoding="utf-8")
    crank = sidtool.Scene.load(FOUNDING / "slider_crank.toml")
    arm = sidtool.Scene.load(tmp_path / "arm.toml")
    scenes = (
        (crank.with_({"time.end": 0.2}), "piston.mass", 5.0),
        (arm, "arm.mass", 2.0),
    )
    for scene, key, first in scenes:
        compiled = scene.compile()
        changes = [{key: first + 0.1 * k} for k in range(12)]
        found = list(compiled.map(changes, jobs=4))
        for numbers, result in zip(changes, found, strict=True):
            expected = compiled.run(numbers)
            assert np.array_equal(result.positions, expected.positions)
            assert np.array_equal(result.values, expected.values)
        masses = compiled.map(changes, lambda result: float(result.values.max()))
        assert [*masses] == [float(result.values.max()) for result in found]


def test_a_run_that_stops_can_be_returned() -> None:
    scene = sidtool.Scene.load(FOUNDING / "slider_crank.toml")
    compiled = scene.with_({"time.end": 0.05}).compile()
    changes = [{}, {"rod.initial.elastic": [0.1, 0.0, 0.0, 0.0, 0.0]}, {}]
    found = list(compiled.map(changes, return_errors=True))
    stopped = [isinstance(each, sidtool.SimulationError) for each in found]
    assert stopped == [False, True, False]
    assert np.array_equal(found[0].values, found[2].values)
    runs = compiled.map(changes)
    next(runs)
    with pytest.raises(sidtool.SimulationError):
        next(runs)
    with pytest.raises(sidtool.InputError, match="jobs"):
        compiled.map(changes, jobs=0)


def test_changes_of_endless_sequences_are_taken_as_they_are_needed() -> None:
    scene = sidtool.Scene.load(FOUNDING / "slider_crank.toml")
    compiled = scene.with_({"time.end": 0.01}).compile()
    taken = []

    def endless() -> Iterator[dict[str, float]]:
        for k in count():
            taken.append(k)
            yield {"piston.mass": 5.0 + k}

    results = compiled.map(endless(), jobs=2)
    for _ in range(5):
        next(results)
    results.close()
    assert len(taken) < 15


def test_simulate_compiles_the_same_content_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Content and SIDs decide, not objects: changes in place are seen."""
    compiled = list[dict[str, Any]]()

    def compile_scene(*given: Any, **named: Any) -> Any:
        compiled.append(named)
        return find(*given, **named)

    find = prepared_scene.compile_scene
    monkeypatch.setattr(prepared_scene, "compile_scene", compile_scene)
    prepared_scene._compiled.cache_clear()
    scene = sidtool.Scene.load(FOUNDING / "slider_crank.toml", {"time.end": 0.02})
    first = scene.simulate()
    twin = sidtool.Scene.load(FOUNDING / "slider_crank.toml", {"time.end": 0.02})
    np.testing.assert_array_equal(twin.simulate().values, first.values)
    assert len(scene.simulate(rtol=1e-4).t) and len(compiled) == 1
    heavier = scene.with_({"piston.mass": 7.0})
    scene.bodies["piston"] = heavier.bodies["piston"]
    changed = scene.simulate()
    assert len(compiled) == 2 and (changed.values != first.values).any()
    np.testing.assert_array_equal(heavier.simulate().values, changed.values)
    sid = replace(first.sids["rod"], De=Taylor(np.zeros((5, 5))))
    scene.simulate(sids={"rod": sid})
    assert [named["sids"]["rod"] is sid for named in compiled] == [False, False, True]

    class Local(sidtool.Scene):
        """Cannot be pickled."""

    local = Local.load(FOUNDING / "slider_crank.toml", {"time.end": 0.02})
    np.testing.assert_array_equal(local.simulate().values, first.values)
