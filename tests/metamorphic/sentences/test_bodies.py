"""What runs say of flexible bodies is true, from runs with and without it.

Stiffening is judged by natural frequencies with and without the loads, deflections by
finer output times, too few shape functions by more of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.geometric_stiffening import SIGNIFICANT_CHANGE
from sidtool.formats.result import Result
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, linearise, simulate
from sidtool.solver.diagnostics.run_summary import initialise
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.bodies import particle_body
from tests.codes import codes
from tests.metamorphic.generator import case as cases, scenes
from tests.sidtool.beams import IGA, beam
from tests.solver.scenes import compiled, polynomial, scene

#: Euler's load of a cantilever with L = EI = 1.
EULER = np.pi**2 / 4
#: Codes of deformations that grow without bound.
DIVERGENCES = {"N405", "N406", "N407", "N408"}


@cache
def column(modes: int = 3) -> SID:
    """L = m = EI = 1, with stiffening."""
    return sid_from_model(
        beam(
            {**IGA, "elements": [16, 1]},
            reduction={"method": "modal", "modes": modes},
            damping={"type": "rayleigh", "alpha": 1.0, "beta": 0.0},
            stiffening={},
        )
    )


def clamped(sid: SID, forces: dict[str, Any], end: float, **more: Any) -> System:
    described = scene(
        {"beam": {"sid": "b", "markers": {"root": 1, "tip": 2}}},
        {"hub": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        end=end,
        forces={
            n: {"type": "force", "marker": "beam.tip", **f} for n, f in forces.items()
        },
        **more,
    )
    return compile_scene(described, sids={"beam": sid}, keep_joints=True)


def swell(begin: float, width: float, end: float) -> dict[str, Any]:
    """Nothing, but for a rise to one and back within 2 `width`."""
    rest, top = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]
    times = [0.0, begin, begin + width, begin + 2.0 * width, end]
    values = [rest, rest, top, rest, rest]
    pieces = [
        {"from": a, "to": b, "start": x, "end": y}
        for a, b, x, y in zip(times, times[1:], values, values[1:], strict=False)
    ]
    return {"type": "polynomial", "pieces": pieces}


@pytest.mark.parametrize("seed", range(1))
def test_a_short_push_in_a_long_run_is_seen(seed: int) -> None:
    """Euler's column; it begins and ends within few of thousands of steps."""
    random = np.random.default_rng(seed)
    end, width = 800.0, float(random.uniform(0.003, 0.02))
    push = float(random.uniform(0.1, 0.9)) * EULER * random.choice([-1.0, 1.0])
    forces = {
        "sway": {
            "force": [0.0, 1e-3],
            "function": {"type": "harmonic", "amplitude": 1.0, "frequency": 1.7},
        },
        "push": {
            "force": [-push, 0.0],
            "function": swell(float(random.uniform(0.1, 0.9)) * end, width, end),
        },
    }
    result = simulate(clamped(column(), forces, end, steps=2))
    found = result.bodies["beam"].found
    assert result.counters["steps"] > 2500 and found is not None
    assert found.ratio == pytest.approx(-push / EULER, rel=2e-2)
    assert "stiffening matters and is in the SID" in found.sentence()


@pytest.mark.parametrize("seed", range(1))
def test_a_short_spin_in_a_long_run_is_seen_as_in_a_short_run(seed: int) -> None:
    """A torque turns a free hub up and down again; once with a long time around."""
    random = np.random.default_rng(seed)
    width, speed = 1.0, float(random.uniform(1.0, 1.6))

    def spun(begin: float, end: float) -> Result:
        sway = {"type": "harmonic", "amplitude": 1e-3, "frequency": 5.0}
        motors = [("up", begin, 1.0), ("down", begin + 2.0 * width, -1.0)]
        forces = {
            name: {
                "type": "force",
                "marker": "hub",
                "torque": sign * 1e3 * speed / width,
                "function": swell(at, width, end),
            }
            for name, at, sign in motors
        }
        forces["sway"] = {
            "type": "force",
            "marker": "beam.tip",
            "force": [0.0, 1.0],
            "function": sway,
        }
        described = scene(
            {
                "hub": {"mass": 1.0, "inertia": 1e3},
                "beam": {"sid": "b", "markers": {"root": 1, "tip": 2}},
            },
            {
                "axle": {"type": "revolute", "markers": ["ground", "hub"]},
                "clamp": {"type": "fixed", "markers": ["hub", "beam.root"]},
            },
            end=end,
            steps=2,
            forces=forces,
        )
        return simulate(compiled(described, beam=column()), rtol=1e-5)

    long, short = spun(300.0, 700.0), spun(1.0, 8.0)
    ratios = [r.bodies["beam"].found.ratio for r in (long, short)]  # type: ignore[union-attr]
    assert long.counters["steps"] > 2500 and ratios[1] > 0.02
    assert ratios[0] == pytest.approx(ratios[1], rel=5e-2)


def with_origin(sid: SID) -> SID:
    """With a node "0" that rests at the origin of the frame."""
    first = sid.nodes[0]
    parts = {k: getattr(first, k) for k in ("origin", "phi", "psi")}
    rest = {k: Taylor(0.0 * part.m0) for k, part in parts.items()}
    node = replace(first, id="0", AP=Taylor(np.eye(3)), **rest)
    return replace(sid, nodes=(node, *sid.nodes))


def turning(sid: SID, rate: float, axis: np.ndarray) -> System:
    described = scene(
        {"body": {"sid": "b", "markers": {"origin": "0"}}},
        {
            "axle": {
                "type": "revolute",
                "markers": ["ground", "body.origin"],
                "axis": axis.tolist(),
            }
        },
        {"spin": {"joint": "axle", "function": polynomial(0.0, rate)}},
        dimension="spatial",
        end=0.01,
    )
    return compile_scene(described, sids={"body": sid}, keep_joints=True)


@pytest.mark.parametrize("seed", range(9))
def test_a_body_diverges_where_its_linearisation_grows(seed: int) -> None:
    """Particles that turn about any axis, some of them with stiffening.

    They start undeformed, not in their steady deformation: with stiffening this adds
    growth with the third power of the rate, 3e-4 of a frequency at most.
    """
    random = np.random.default_rng([22, seed])
    sid = particle_body(2, 9, seed=seed, stiffening=seed % 3 == 0)
    stiffness = random.uniform(1.0, 20.0, 2)
    sid = replace(sid, Ke=Taylor(np.diag(stiffness)), De=Taylor(np.zeros((2, 2))))
    sid = with_origin(sid)
    axis = random.normal(size=3)
    rate = float(random.uniform(0.2, 8.0))
    system = turning(sid, rate, axis / np.linalg.norm(axis))
    values = linearise(system, "start", frozen=True).eigenvalues
    expected = system.cached(initialise).expected_bodies["body"]
    result = simulate(system)
    grows = values.real.max() > 1e-2 * np.abs(values).max()
    assert expected.expected.diverges == grows
    assert result.bodies["body"].diverges == grows
    words = expected.before
    assert ("diverges" in words or "buckles" in words) == grows
    found = [each for each in result.diagnostics if each.code in DIVERGENCES]
    assert [each.subject for each in found] == ["body"] * int(grows)
    assert all(each.t is not None and 0.0 <= each.t <= 0.01 for each in found)


@pytest.mark.parametrize("seed", range(4))
def test_stiffening_is_the_change_of_squared_frequencies(seed: int) -> None:
    """A column under a load along it that is small, or not; also as a free verdict."""
    random = np.random.default_rng([23, seed])
    push = float(10.0 ** random.uniform(-4.0, -0.5)) * EULER * random.choice([-1, 1])
    table = {"push": {"force": [-push, 0.0]}}
    squares = []
    for forces in (table, {}):
        system = clamped(column(), forces, 0.01)
        squares.append(linearise(system, "start", frozen=True).frequencies ** 2)
    change = (
        np.min(squares[0] / squares[1]) - 1.0
        if push > 0
        else np.max(squares[0] / squares[1]) - 1.0
    )
    found = simulate(clamped(column(), table, 0.01)).bodies["beam"].found
    assert found is not None
    assert found.ratio == pytest.approx(change, rel=0.1)
    assert found.sentence().startswith("stiffening small") == (
        abs(found.ratio) < SIGNIFICANT_CHANGE
    )


@pytest.mark.parametrize("seed", range(3))
def test_too_few_shape_functions_are_those_that_more_of_them_correct(seed: int) -> None:
    """A shaken cantilever with three shape functions and with nine."""
    share = np.geomspace(0.15, 2.5, 6)[seed]
    shake = {
        "force": [0.0, 1e-3],
        "function": {"type": "harmonic", "amplitude": 1.0, "frequency": share * 9.82},
    }
    few, many = (
        simulate(
            clamped(
                column(n), {"shake": shake}, 1.0, steps=400, record=["beam.tip.uy"]
            ),
            rtol=1e-6,
        )
        for n in (3, 9)
    )
    error = np.ptp(few.values - many.values) / np.ptp(many.values)
    assert ("N412" in codes(few)) == (share > 1.0 / 3.0)
    assert "N412" not in codes(many)
    assert error < 0.02 or share > 1.0 / 3.0
    assert error > 0.1 or share < 1.0


def test_a_drive_that_stretches_a_body_until_its_inertia_is_lost_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The distance of two of its nodes grows from 0.27 m to 0.50 m. The least
    eigenvalue of its mass matrix, 1.4e-2 at the start, is 6e-16 at the stop."""
    monkeypatch.setattr(scenes, "within_reach", lambda case: case)
    case = scenes.random_scene.__wrapped__(61101)
    with pytest.raises(SimulationError) as stop:
        simulate(cases.compiled(case, keep_joints=True), rtol=1e-5)
    assert {"N307", "N313"} <= {each.code for each in stop.value.diagnostics}
