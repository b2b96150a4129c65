"""Numbers that runs tell are true: steps, rounding, deflections, and what `info` says
that is kept or dropped; names and SIDs that are given are used."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.sid_mass import body_size
from sidtool.pipeline.scene_changes import PROGRAM_SID_TEXT
from sidtool.solver import simulate
from sidtool.solver.diagnostics.run_summary import QUADRATIC_INERTIA, describe_bodies
from tests.codes import codes, with_code
from tests.metamorphic.generator.case import Case, compiled, run, scene_of
from tests.metamorphic.generator.said import copied, with_table
from tests.metamorphic.generator.scenes import random_scene
from tests.solver.scenes import (
    compiled as compiled_scene,
    scene,
    slender_rod,
    soft_body,
    with_cubic_energy,
)

#: Random scenes with flexible bodies.
#: Random scenes with flexible bodies.
SOFT = (1, 2, 3, 4, 5)


@pytest.mark.parametrize("seed", SOFT)
def test_amplitudes_deflections_and_energies_do_not_depend_on_output_times(
    seed: int,
) -> None:
    """Random scenes with two output times, and the same with 400."""
    case = random_scene(seed)
    assert case.sids
    results = [simulate(compiled(with_steps(case, n)), rtol=1e-7) for n in (1, 400)]
    warned = {each.subject for each in with_code(results[1], "N411")}
    fine = run(with_steps(case, 400), rtol=1e-7)
    for name, sid in case.sids.items():
        few, many = (found.bodies[name] for found in results)
        size = many.amplitudes.max()
        assert few.amplitudes == pytest.approx(many.amplitudes, abs=0.05 * size)
        assert few.deflection == pytest.approx(many.deflection, rel=0.05)
        assert few.energy_shares.sum() == pytest.approx(1.0)
        assert few.energy_shares == pytest.approx(many.energy_shares, abs=0.05)
        shapes = np.array([node.phi.m0 for node in sid.nodes])
        u = np.linalg.norm(np.einsum("tl,nal->tna", fine[f"{name}.q"], shapes), axis=2)
        seen = u.max() / body_size(sid)
        assert seen * (1.0 - 1e-9) <= many.deflection < 1.01 * seen
        assert (name in warned) == (many.deflection > 0.1)


def with_steps(case: Case, count: int) -> Case:
    table = copied(case)
    end = table["time"]["end"]
    table["time"] = {"start": 0.0, "end": end, "output_step": end / count}
    return with_table(case, table)


@pytest.mark.parametrize("seed", range(3))
def test_a_scene_is_called_stiff_where_radau_takes_fewer_steps(seed: int) -> None:
    """A mass on an overdamped spring that a slow force moves, from soft to stiff."""
    stiffness = float(10.0 ** np.linspace(0.0, 6.0, 6)[seed])
    described = scene(
        {"cart": {"mass": 1.0, "inertia": 1.0}},
        {
            "rail": {
                "type": "prismatic",
                "axis": [1.0, 0.0],
                "markers": ["ground", "cart"],
            }
        },
        forces={
            "spring": {
                "type": "spring_damper",
                "joint": "rail",
                "coordinate": "displacement",
                "stiffness": stiffness,
                "damping": 6.0 * math.sqrt(stiffness),
                "rest": 0.0,
            },
            "push": {
                "type": "force",
                "marker": "cart",
                "force": [1.0, 0.0],
                "function": {"type": "harmonic", "amplitude": 1.0, "frequency": 0.5},
            },
        },
        end=5.0,
    )
    explicit, implicit = (
        simulate(compiled_scene(described), integrator=name, rtol=1e-2)
        for name in ("dop853", "radau9")
    )
    told = "N321" in codes(explicit)
    fewer = implicit.counters["steps"] < explicit.counters["steps"]
    assert fewer or not told
    assert told or explicit.counters["steps"] < 10 * implicit.counters["steps"]
    assert "N321" not in codes(implicit)


@pytest.mark.parametrize("seed", range(6))
def test_rounding_far_from_the_origin_is_told_where_it_hides_errors(seed: int) -> None:
    """A pendulum far away, that swings a little: errors by one at the origin."""
    random = np.random.default_rng([36, seed])
    far = float(10.0 ** random.uniform(0.0, 9.0))
    swing, rtol = float(10.0 ** random.uniform(-4.0, 0.0)), 1e-6
    turns = []
    for x in (0.0, far):
        described = scene(
            {"rod": slender_rod(1.0, position=[x, 0.0], angle=swing - 0.5 * math.pi)},
            {"pin": {"type": "revolute", "markers": ["ground.pivot", "rod.a"]}},
            gravity=[0.0, -9.81],
            ground={"markers": {"pivot": {"position": [x, 0.0]}}},
            record=["rod.angle"],
            steps=50,
        )
        turns.append(simulate(compiled_scene(described), rtol=rtol if x else 1e-11))
    error = np.abs(turns[1].values - turns[0].values).max() / np.ptp(turns[0].values)
    told = with_code(turns[1], "N323")
    assert told or error < 10.0 * rtol
    for diagnostic in told:
        hidden = float(str(diagnostic.data["rounding"]))
        assert error * np.ptp(turns[0].values) < max(10.0 * hidden, 10.0 * rtol * swing)
        assert hidden > rtol * swing


@pytest.mark.parametrize("swing", [0.0, 1e-4])
def test_what_rests_is_said_to_rest(swing: float) -> None:
    """A rod that hangs, from rounding of its angle; and one that swings."""
    rod = slender_rod(1.0, angle=swing - 0.5 * math.pi)
    pin = {"type": "revolute", "markers": ["ground", "rod.a"]}
    described = scene({"rod": rod}, {"pin": pin}, gravity=[0.0, -9.81])
    result = simulate(compiled_scene(described))
    assert ("N324" in codes(result)) == (swing == 0.0)
    assert "N323" not in codes(result)


def test_what_turns_on_the_spot_does_not_rest() -> None:
    """A wheel whose centre rounding alone moves."""
    spin = {"angular_velocity": [3.0, 4.0, 5.0], "position": [0.3, 0.1, 0.7]}
    wheel = {"mass": 1.0, "inertia": [0.3, 0.3, 0.1], "initial": spin}
    spring = {
        "type": "bushing",
        "markers": ["ground.place", "wheel"],
        "stiffness": [9.0] * 3 + [0.0] * 3,
        "damping": [0.0] * 6,
    }
    described = scene(
        {"wheel": wheel},
        dimension="spatial",
        end=20.0,
        ground={"markers": {"place": {"position": [0.1 + 0.2, 0.1, 0.7]}}},
        forces={"mount": spring},
    )
    result = simulate(compiled_scene(described))
    assert "N324" not in codes(result)


TERMS = {"Cr1, Ge1": ("Cr", "Ge"), "Oe1": ("Oe",), "Ct1": ("Ct",), "Ke1": ("Ke",)}


@pytest.mark.parametrize("seed", range(3))
def test_terms_that_info_calls_missing_have_no_effect(
    seed: int,
) -> None:
    """Terms of a falling, turning body, each taken out of its SID."""
    planar, sid = seed % 2 == 0, soft_body(2, seed, seed % 2 == 0, stiffening=seed > 2)
    if seed % 3 == 1:
        sid = with_cubic_energy(sid, seed, 0.3)

    def system(body: SID, quadratic: bool = False) -> Any:
        start = {"elastic": [0.05, -0.03], "angular_velocity": 1.0}
        if not planar:
            start["angular_velocity"] = [0.4, 1.0, 0.3]
        described = scene(
            {"body": {"sid": "b", "initial": start, "quadratic_inertia": quadratic}},
            dimension="planar" if planar else "spatial",
            record=["body.q*", "body.x"],
            end=0.5,
        )
        return compiled_scene(described, body=body)

    (body,) = describe_bodies(system(sid))
    plain = simulate(system(sid)).values
    for term, blocks in TERMS.items():
        without = {name: Taylor(getattr(sid, name).m0) for name in blocks}
        found = simulate(system(replace(sid, **without))).values
        assert np.array_equal(found, plain) == (body.terms[term] == "-"), term
    if sid.Ct.first_order(sid.nq).any():  # a stiffened body always has it
        assert body.terms[QUADRATIC_INERTIA] == "yes"
        assert np.array_equal(simulate(system(sid, True)).values, plain)
        return
    assert body.terms[QUADRATIC_INERTIA] == "off"
    (body,) = describe_bodies(system(sid, True))
    assert body.terms[QUADRATIC_INERTIA] == "yes"
    assert not np.array_equal(simulate(system(sid, True)).values, plain)


@pytest.mark.parametrize(
    "call",
    [
        sidtool.simulate,
        sidtool.static_equilibrium,
        sidtool.linearise,
        sidtool.inverse_dynamics,
    ],
)
def test_names_that_a_scene_does_not_have_are_refused(call: Any) -> None:
    case = random_scene(SOFT[0])
    sids = {**case.sids, "typo": next(iter(case.sids.values()))}
    with pytest.raises(InputError, match="typo"):
        call(scene_of(case), sids=sids)


def test_a_run_says_which_sids_a_program_gave() -> None:
    case = random_scene(SOFT[0])
    found = sidtool.simulate(scene_of(case), sids=case.sids)
    assert found.scene.count(PROGRAM_SID_TEXT) == len(case.sids)
    rest = sidtool.static_equilibrium
    try:
        held = rest(scene_of(case), sids=case.sids).result()
    except sidtool.SimulationError:
        return
    assert held.scene.count(PROGRAM_SID_TEXT) == len(case.sids)
