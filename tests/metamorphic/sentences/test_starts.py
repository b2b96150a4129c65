"""What runs say of their start, their output times and their settings is true.

Places and velocities are those that a run records first; random scenes are run with
what they say and with something else.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from tests.codes import codes, only, with_code
from tests.metamorphic.generator import functions
from tests.metamorphic.generator.case import Case, compiled, measured
from tests.metamorphic.generator.said import as_spin, copied, with_table
from tests.metamorphic.generator.scenes import random_scene

SEEDS = range(6)
MOVED = "N221"
BENT = "N222"
REPLACED = "N223"
RTOL = 1e-6


def started(case: Case) -> Result:
    """A run of an instant, with all joints."""
    table = copied(case)
    table["time"] = {"start": 0.0, "end": 1e-3, "output_step": 1e-3}
    return simulate(compiled(with_table(case, table), keep_joints=True), rtol=RTOL)


def told(result: Result, code: str) -> dict[str, list[float]]:
    """Body -> linear and angular change of the diagnostic; empty without one."""
    if not with_code(result, code):
        return {}
    data: Any = only(result, code).data
    columns = [data[kind] for kind in ("linear", "angular") if kind in data]
    rows = zip(*columns, strict=True)
    return dict(zip(data["bodies"], map(list, rows), strict=True))


def replaced(case: Case, result: Result) -> dict[str, list[float]]:
    """Changes of velocities that the scene states, by what is recorded first."""
    values, found = measured(case, result), {}
    for name, body in case.table["bodies"].items():
        initial, size = body["initial"], 2 if case.planar else 3
        linear = values[f"{name}.v"][0][:size] - initial["velocity"]
        angular = values[f"{name}.w"][0] - as_spin(initial["angular_velocity"])
        way = float(np.linalg.norm(linear))
        if name in case.sids and "elastic_velocity" in initial:
            change = values[f"{name}.vq"][0] - initial["elastic_velocity"]
            shapes = np.array([node.phi.m0 for node in case.sids[name].nodes])
            way = max(way, float(np.linalg.norm(shapes @ change, axis=1).max()))
        found[name] = [way, float(np.linalg.norm(angular))]
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_velocities_that_joints_allow_are_kept_without_a_word(seed: int) -> None:
    result = started(random_scene(seed))
    assert not told(result, REPLACED) and not told(result, MOVED)
    assert not told(result, BENT)


@pytest.mark.parametrize("seed", SEEDS)
def test_velocities_that_joints_replace_are_told_with_the_change(seed: int) -> None:
    """Of the same scenes, with velocities at random."""
    case = random_scene(seed)
    table, random = copied(case), np.random.default_rng([24, seed])
    for name, body in table["bodies"].items():
        velocity, spin = 0.5 * random.normal(size=3), random.normal(size=3)
        body["initial"]["velocity"] = velocity[: 2 if case.planar else 3].tolist()
        body["initial"]["angular_velocity"] = (
            float(spin[2]) if case.planar else spin.tolist()
        )
        if name in case.sids:
            pushed = random.normal(size=case.sids[name].nq)
            body["initial"]["elastic_velocity"] = pushed.tolist()
    case = with_table(case, table)
    result = started(case)
    found, known = told(result, REPLACED), replaced(case, result)
    largest = max(max(sizes) for sizes in known.values())
    assert found if largest > 1e-2 else (largest > 1e-4 or not found)
    for name, sizes in found.items():
        assert sizes == pytest.approx(known[name], rel=1e-2, abs=1e-4)


@pytest.mark.parametrize("seed", SEEDS)
def test_resting_starts_of_moving_scenes_are_no_replaced_velocities(seed: int) -> None:
    """All at rest, with drives held: what rounding leaves of zero is not spoken of."""
    case = random_scene(seed)
    table = copied(case)
    table["drives"] = {}
    for name, body in table["bodies"].items():
        body["initial"] |= {"velocity": [0.0] * (2 if case.planar else 3)}
        body["initial"]["angular_velocity"] = 0.0 if case.planar else [0.0] * 3
        if name in case.sids:
            body["initial"]["elastic_velocity"] = [0.0] * case.sids[name].nq
    assert not told(started(with_table(case, table)), REPLACED)


@pytest.mark.parametrize("seed", SEEDS)
def test_bodies_that_the_assembly_moves_are_told_with_how_far(seed: int) -> None:
    """Bodies put beside their places, by much more than the tolerance or much less."""
    case = random_scene(seed)
    random = np.random.default_rng([25, seed])
    for size in (0.03, 1e-9):
        table = copied(case)
        for name, body in table["bodies"].items():
            place = body["initial"]["position"]
            aside = size * random.normal(size=len(place))
            body["initial"]["position"] = (np.array(place) + aside).tolist()
            if name in case.sids:
                body["initial"]["elastic"] = (
                    size * random.normal(size=case.sids[name].nq)
                ).tolist()
        result = started(with_table(case, table))
        values, known, bent = measured(case, result), {}, {}
        for name, body in table["bodies"].items():
            place = np.zeros(3)
            place[: 2 if case.planar else 3] = body["initial"]["position"]
            known[name] = float(np.linalg.norm(values[f"{name}.x"][0] - place))
            if name in case.sids:
                change = values[f"{name}.q"][0] - body["initial"]["elastic"]
                shapes = np.array([node.phi.m0 for node in case.sids[name].nodes])
                bent[name] = float(np.linalg.norm(shapes @ change, axis=1).max())
        for about, truth in ((MOVED, known), (BENT, bent)):
            found = told(result, about)
            largest = max(truth.values(), default=0.0)
            assert found if largest > 1e-3 else (size > 1e-3 or not found)
            for name, sizes in found.items():
                assert sizes[0] == pytest.approx(truth[name], rel=1e-2, abs=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_output_times_that_miss_the_end_of_the_run_are_told(seed: int) -> None:
    """Not where an event ends the run: then the last time is that of the event."""
    random = np.random.default_rng([26, seed])
    case = random_scene(seed)
    end = case.table["time"]["end"]
    step = (
        end / int(random.integers(2, 9))
        if seed % 2
        else float(random.uniform(0.1, 0.4))
    )
    stop = {"quantity": "time", "value": 0.4 * end, "action": "stop"}
    for events in ({}, {"enough": stop}):
        table: dict[str, Any] = copied(case)
        table["time"] = {"start": 0.0, "end": end, "output_step": step}
        if events:
            body = next(iter(table["bodies"]))
            middle = simulate(compiled(case, keep_joints=True))[f"{body}.x"]
            if np.ptp(middle) < 1e-6:
                return
            level = float(middle[len(middle) // 3])
            if level == middle[0]:
                return
            stop |= {"quantity": f"{body}.x", "value": level}
            table["events"] = events
        result = simulate(
            compiled(with_table(case, table), keep_joints=True), rtol=1e-8
        )
        ended = "ended the run" in result.message
        missed = not ended and result.t[-1] < end * (1.0 - 1e-9)
        assert ("N327" in codes(result)) == missed
        if missed:
            data = only(result, "N327").data
            assert data["last"] == result.t[-1] and data["end"] == end
        assert bool(events) == ended


@pytest.mark.parametrize("seed", range(3))
def test_a_result_holds_the_scene_that_it_was_made_with(seed: int) -> None:
    """Run again, as it stands in the result, it gives the same numbers."""
    random = np.random.default_rng([27, seed])
    case = random_scene(seed)
    name = str(
        random.choice(["radau5", "radau9", "generalised_alpha", "dop853", "auto"])
    )
    asked: dict[str, Any] = {"integrator": name}
    if name == "generalised_alpha":
        asked |= {"step": 0.004, "spectral_radius": 0.7}
    else:
        asked["rtol"] = float(10.0 ** random.uniform(-7.0, -4.0))
    first = simulate(compiled(case), **asked)
    plain = simulate(compiled(case))
    again = simulate(
        compile_scene(SceneFile.model_validate_json(first.scene), sids=case.sids)
    )
    assert np.array_equal(first.values, again.values)
    assert first.settings == again.settings
    assert not np.array_equal(first.values, plain.values)


def test_a_function_that_a_program_gives_is_told() -> None:
    """What is short may be missed; the scene in the result has what was seen."""
    case = random_scene(next(s for s in range(40) if random_scene(s).table["drives"]))
    name, drive = next(iter(case.table["drives"].items()))
    given = {name: functions.value(drive["function"])}
    system = compile_scene(
        SceneFile.model_validate(case.table | {"outputs": {"record": []}}),
        sids=case.sids,
        drives=given,
    )
    result = simulate(system)
    assert only(result, "N328").subject == name
    kept = json.loads(result.scene)["drives"][name]["function"]
    assert kept["type"] == "callable" != drive["function"]["type"]
    assert "N328" not in codes(simulate(compiled(case)))
