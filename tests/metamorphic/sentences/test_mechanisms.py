"""What runs and analyses say of mechanisms is true: redundancy, branches, stability."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.solver import (
    compile_scene,
    describe,
    linearise,
    simulate,
    static_equilibrium,
)
from tests.codes import codes, only, with_code
from tests.metamorphic.generator.case import compiled, measured
from tests.metamorphic.generator.said import copied, with_table
from tests.metamorphic.generator.scenes import random_scene, with_measures
from tests.solver.integrators.test_singular_positions import slider_crank
from tests.solver.scenes import (
    compiled as compiled_scene,
    polynomial,
    scene,
    slender_rod,
)

#: Singular configurations, redundant constraints, stiff scenes and rounding.
NEAR_LIMITS = {"N232", "N233", "N234", "N321", "N323", "N324", "N329"}


@pytest.mark.parametrize("seed", range(4))
def test_forces_that_two_equal_joints_share_are_told_and_no_others(seed: int) -> None:
    """Random scenes with a joint said twice: the same motion, the same other forces."""
    case = with_measures(random_scene(seed), forces=True)
    joints = case.table["joints"]
    names = [n for n, j in joints.items() if "markers" in j and j["type"] != "distance"]
    if not names:
        return
    random = np.random.default_rng([33, seed])
    name = str(random.choice(names))
    table = copied(case)
    table["joints"]["again"] = copied(case)["joints"][name]
    twice = with_table(case, table, measures=(*case.measures, "again.f", "again.m"))
    results = [
        simulate(compiled(c, keep_joints=True), rtol=1e-8) for c in (case, twice)
    ]
    exact, found = (measured(c, r) for c, r in zip((case, twice), results, strict=True))
    assert not with_code(results[0], "N233")
    found_forces = only(results[1], "N233")
    assert set(found_forces.subject.split(", ")) == {name, "again"}
    for measure, values in exact.items():
        shared = measure.split(".")[0] == name and measure[-1] in "fm"
        if shared:
            values = 0.5 * values  # the smallest ones, as the markers are the same
        size = max(np.abs(values).max(), 1e-2)
        assert np.abs(found[measure] - values).max() < 1e-4 * size, measure
    count = len(results[1].multiplier_names) - len(results[0].multiplier_names)
    assert found_forces.data["redundant"] == count
    lines = describe(compiled(twice, keep_joints=True))
    assert sum(f"{count} redundant constraints (" in line for line in lines) == (
        count > 1
    )
    assert not any("redundant" in t for t in describe(compiled(case, keep_joints=True)))


@pytest.mark.parametrize("seed", range(5))
def test_where_no_branch_is_told_the_crank_goes_on_as_it_must(seed: int) -> None:
    """A rod longer than its crank by d: the piston stays on its side."""
    random = np.random.default_rng([34, seed])
    longer = float(10.0 ** random.uniform(-9.0, -0.5))
    rod = 1.0 + longer
    system = slider_crank(
        0.0, rod=rod, speeds=(1.0, -1.0 / rod), drive=polynomial(0.0, 1.0)
    )
    result = simulate(system, rtol=1e-6)
    side = math.cos(2.0) + math.sqrt(rod**2 - math.sin(2.0) ** 2)
    at = {name: float(np.interp(2.0, result.t, result[name])) for name in result.names}
    told = with_code(result, "N329")
    as_it_must = any(abs(x - side) < 1e-3 for x in at.values())
    assert as_it_must or told
    assert not told or math.sqrt(2.0 * longer) < 0.05
    assert told or longer > 1e-6


@pytest.mark.parametrize("seed", range(7))
def test_random_scenes_pass_no_singular_configuration(seed: int) -> None:
    """They are away from them; a run of the first third says so."""
    case = random_scene(seed)
    if not case.table["joints"]:
        return
    table = copied(case)
    table["time"] = {"start": 0.0, "end": 0.25, "output_step": 0.25}
    result = simulate(compiled(with_table(case, table), keep_joints=True), rtol=1e-8)
    assert not NEAR_LIMITS & set(codes(result))


def upright(seed: int) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Two rods on end with springs and dampers, some of which push."""
    random = np.random.default_rng([35, seed])
    up = 0.5 * math.pi
    bodies = {
        "low": slender_rod(1.0, angle=up),
        "top": slender_rod(1.0, position=[0.0, 1.0], angle=up),
    }
    joints = {
        "foot": {"type": "revolute", "markers": ["ground", "low.a"]},
        "knee": {"type": "revolute", "markers": ["low.b", "top.a"]},
    }
    forces = {
        f"spring{k}": {
            "type": "spring_damper",
            "joint": joint,
            "coordinate": "angle",
            "stiffness": float(random.uniform(5.0, 60.0)),
            "damping": float(random.uniform(-0.5, 2.0)),
            "rest": rest,
        }
        for k, (joint, rest) in enumerate((("foot", up), ("knee", 0.0)))
    }
    return bodies, joints, forces


@pytest.mark.parametrize("seed", range(6))
def test_what_is_called_unstable_runs_away_and_nothing_else(seed: int) -> None:
    """The run begins a little beside the equilibrium."""
    bodies, joints, forces = upright(seed)
    more: dict[str, Any] = {"gravity": [0.0, -9.81], "forces": forces}
    described = scene(bodies, joints, **more)
    static = static_equilibrium(compiled_scene(described))
    modes = linearise(compiled_scene(described))
    growth = modes.eigenvalues.real.max()
    bodies["low"]["initial"]["angle"] += 1e-5
    end = min(30.0, 7.0 / max(abs(growth), 1e-9))
    record = ["foot.angle", "knee.angle"]
    begun = scene(bodies, joints, end=end, steps=200, record=record, **more)
    result = simulate(compiled_scene(begun), rtol=1e-8)
    away = np.abs(result.values - [0.5 * math.pi, 0.0]).max(axis=1)
    grows = away[-40:].max() > 3.0 * away[:40].max()
    assert bool(with_code(modes, "N714")) == grows
    if grows:
        assert only(modes, "N714").data["rate"] == pytest.approx(growth)
    stiffness = [f["stiffness"] for f in forces.values()]
    k1, k2, w = *stiffness, 9.81
    K = np.array(
        [[k1 + k2 - 1.5 * w, -k2], [-k2, k2 - 0.5 * w]]
    )  # of both rods' angles
    buckles = np.linalg.eigvalsh(K)[0] < 0.0
    assert bool(with_code(static.result(), "N704")) == buckles
    assert grows or not buckles


@pytest.mark.parametrize("seed", range(4))
def test_modes_about_a_start_that_does_not_stay_there_say_so(seed: int) -> None:
    """A rod that is let go beside the vertical, with and without a spin about it."""
    random = np.random.default_rng([38, seed])
    off = float(np.geomspace(1e-3, 1.0, 8)[seed])
    bodies = {
        "rod": slender_rod(float(random.uniform(0.5, 2.0)), angle=off - 0.5 * math.pi)
    }
    joints = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    for gravity in (9.81, 0.0):
        system = compiled_scene(
            scene(
                bodies,
                joints,
                gravity=[0.0, -gravity],
                record=["rod.angle"],
                end=3.0,
                steps=100,
            )
        )
        modes = linearise(system, "start", frozen=True)
        away = 0.5 * np.ptp(simulate(system).values)
        assert bool(with_code(modes, "N710")) == (away > 0.05)
        assert not linearise(system).diagnostics


@pytest.mark.parametrize("with_law", [False, True])
@pytest.mark.parametrize("state", ["stated", "static"])
def test_a_start_that_a_drive_accelerates_is_not_steady(
    state: str, with_law: bool
) -> None:
    """An arm hangs at a trolley that is shaken: at rest omega^2 = m g l / J.

    A law that vibrates at 3 rad/s drives another trolley by what is measured there.
    """
    function = {
        "type": "harmonic",
        "amplitude": 0.01,
        "frequency": 5.0,
        "phase": 0.5 * math.pi,
    }
    arm = {"mass": 2.0, "inertia": 0.05, "centre_of_mass": [0.0, -0.5]}
    bodies = {"trolley": {"mass": 1.0, "inertia": 0.1}, "arm": arm}
    joints = {
        "rail": {"type": "prismatic", "markers": ["ground", "trolley"]},
        "pin": {"type": "revolute", "markers": ["trolley", "arm"]},
    }
    drives = {"shake": {"joint": "rail", "function": function}}
    if with_law:
        bodies["other"] = {"mass": 1.0, "inertia": 0.1}
        joints["track"] = {"type": "prismatic", "markers": ["ground", "other"]}
        law = {"type": "expression", "value": "trolley.x - 9*value - rate"}
        drives["servo"] = {"joint": "track", "of": "acceleration", "function": law}
    system = compile_scene(
        scene(
            bodies,
            joints,
            drives,
            gravity=[0.0, -9.81],
            initial={"state": state},
        ),
        keep_joints=True,
    )
    modes = linearise(system)
    assert not with_code(modes, "N710")
    frequency = math.sqrt(2.0 * 9.81 * 0.5 / (0.05 + 2.0 * 0.5**2)) / (2.0 * math.pi)
    expected = [1.5 / math.pi, frequency] if with_law else [frequency]
    np.testing.assert_allclose(modes.frequencies, expected, rtol=1e-9)
    found = only(linearise(system, "start", frozen=True), "N710")
    assert ("drives hold" in found.remedy) == (state == "static")
