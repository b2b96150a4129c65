"""Cases that break solvers, and what happens here.

Never a NaN in a result and never a silent wrong answer: a run that cannot meet its
tolerance stops with the time, the body and the cause, and keeps what was computed.
Singular positions are in `test_singular_positions`, units in `test_invariance`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.sid_files import read_sid
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import simulate
from sidtool.solver.system.errors import SimulationError
from tests.places import SLIDER_CRANK
from tests.sidtool.beams import beam
from tests.solver.scenes import GRAVITY, compiled, polynomial, scene, slender_rod
from tests.solver.transformed import BLOCKS, first_modes

FULL_SPEED = 12.0 * math.pi
CRANK = 0.1
INERTIA = ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe")
STIFF = ("radau5", "radau9", "radau13")


@pytest.fixture(scope="module")
def rod() -> SID:
    return read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")


def slider_crank(end: float = 3.0, speed: float = 1.0, **more: Any) -> SceneFile:
    """The founding scene with its crank `speed` times as fast."""
    table = read_scene(SLIDER_CRANK / "slider_crank.toml").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    w = speed * FULL_SPEED
    start, later = {"from": 0.0, "to": 2.0}, {"from": 2.0, "coefficients": [w, w]}
    run_up = {**start, "start": [0, 0, 0, 0], "end": [w, w, 0, 0]}
    table["drives"]["crank_angle"]["function"]["pieces"] = [run_up, later]
    table["time"]["end"] = end
    return SceneFile.model_validate(table | more)


def steady(end: float, step: float, **more: Any) -> SceneFile:
    """The founding scene at full speed from the start, with consistent velocities."""
    table = slider_crank(end).model_dump(mode="json", by_alias=True, exclude_none=True)
    drive = table["drives"]["crank_angle"]["function"]
    drive["pieces"] = [{"from": 0.0, "coefficients": [0.0, FULL_SPEED]}]
    table["time"] = {"end": end, "output_step": step}
    return SceneFile.model_validate(table | more)


def rigid_piston(t: Array) -> Array:
    """Where the piston would be with a rigid rod, while the founding crank turns."""
    s = np.minimum(t, 2.0) / 2.0
    coefficients = np.linalg.solve(
        [[1, 1, 1, 1], [4, 5, 6, 7], [12, 20, 30, 42], [24, 60, 120, 210]],
        [FULL_SPEED, 2.0 * FULL_SPEED, 0.0, 0.0],
    )
    angle = sum(c * s ** (4 + k) for k, c in enumerate(coefficients))
    angle = angle + FULL_SPEED * np.maximum(t - 2.0, 0.0)
    lever = CRANK * np.sin(angle)
    return CRANK * np.cos(angle) + np.sqrt(1.0 - lever**2)


# --- stiffness --------------------------------------------------------------------


@pytest.mark.parametrize("integrator", STIFF)
@pytest.mark.parametrize("damped", [True, False], ids=["damped", "undamped"])
@pytest.mark.parametrize("factor", [1e2, 1e6])
def test_a_rod_of_growing_stiffness_becomes_rigid(
    rod: SID, factor: float, damped: bool, integrator: str
) -> None:
    """E to 2.1e17 N/m2, modes to 1.3 MHz. The methods damp what they do not resolve:
    the deformation is the quasi-static one, its effect falls with the stiffness, and
    the steps get no shorter than those for the soft rod: at most 1 350."""
    De = rod.De.m0 if damped else 0.0 * rod.De.m0
    stiff = replace(rod, Ke=Taylor(factor * rod.Ke.m0), De=Taylor(De))
    system = compiled(slider_crank(), rod=stiff)
    result = simulate(system, integrator=integrator, rtol=1e-6)
    away = np.abs(result["piston.x"] - rigid_piston(result.t)).max()
    assert away == pytest.approx(1.169e-5 / factor, rel=1e-2, abs=2e-12)
    assert factor * np.abs(result["rod.q1"]).max() == pytest.approx(9.902e-4, rel=2e-4)
    assert result.counters["steps"] < 1.3 * 1350
    assert result.drift["position"] < 1e-12


# --- masses -----------------------------------------------------------------------


@pytest.mark.parametrize("integrator", STIFF)
@pytest.mark.parametrize("masses", [(1e-4, 1e4), (1e4, 1e-4)], ids=["light", "heavy"])
def test_a_mass_ratio_of_1e8(integrator: str, masses: tuple[float, float]) -> None:
    """A double pendulum, whose motion depends on the ratio alone: beyond 1e4 it no
    longer does, and its energy is kept."""

    def run(first: float, second: float) -> Result:
        bodies = {
            "upper": slender_rod(1.0, first),
            "lower": slender_rod(1.0, second, position=[1.0, 0.0]),
        }
        joints = {
            "top": {"type": "revolute", "markers": ["ground", "upper.a"]},
            "middle": {"type": "revolute", "markers": ["upper.b", "lower.a"]},
        }
        record = ["upper.angle", "lower.angle", "energy.kinetic", "energy.potential"]
        described = scene(
            bodies, joints, end=1.0, gravity=[0.0, -GRAVITY], record=record
        )
        return simulate(compiled(described), integrator=integrator, rtol=1e-8)

    result, scaled = run(*masses), run(1e4 * masses[0], 1e4 * masses[1])
    energy = result["energy.kinetic"] + result["energy.potential"]
    assert np.ptp(energy) < 1e-7 * result["energy.kinetic"].max()
    for name in ("upper.angle", "lower.angle"):
        assert scaled[name] == pytest.approx(result[name], abs=1e-6)


def lightened(rod: SID, factor: float) -> SID:
    """The rod with another density."""
    parts = {}
    for name in INERTIA:
        term: Taylor = getattr(rod, name)
        m1 = None if term.m1 is None else factor * term.m1
        parts[name] = Taylor(factor * term.m0, m1)
    assert set(parts) < set(BLOCKS)
    return replace(rod, mass=factor * rod.mass, **parts)


@pytest.mark.parametrize("integrator", ["radau5", "radau9"])
def test_a_nearly_massless_rod_only_passes_on_forces(rod: SID, integrator: str) -> None:
    """1e-8 of its density, modes to 13 MHz: the piston's inertia alone strains it, and
    the force along it is that of the piston."""
    described = slider_crank(outputs={"record": ["piston.ax", "piston_pin.fx"]})
    system = compiled(described, rod=lightened(rod, 1e-8))
    result = simulate(system, integrator=integrator, rtol=1e-6)
    force = 5.0 * result["piston.ax"]
    largest = np.abs(force).max()
    assert result["piston_pin.fx"] == pytest.approx(force, abs=1e-6 * largest)
    rigid = CRANK * FULL_SPEED**2 * 5.0 * (1.0 + CRANK)
    assert largest == pytest.approx(rigid, rel=1e-4)


def test_a_mass_that_the_numbers_cannot_hold_is_refused() -> None:
    """1e-20 of the others: its compliance hides theirs, and a joint does its work."""
    table = slider_crank().model_dump(mode="json", by_alias=True, exclude_none=True)
    table["bodies"]["rod"] = slender_rod(1.0, 1e-20, position=[CRANK, 0.0])
    joints = table["joints"]
    joints["crank_pin"]["markers"] = ["crank.pin", "rod.a"]
    joints["piston_pin"]["markers"] = ["rod.b", "piston"]
    table["outputs"]["record"] = ["piston.x"]
    with pytest.raises(InputError, match="2e-22 of that of piston") as refused:
        simulate(compiled(SceneFile.model_validate(table)), rtol=1e-6)
    assert refused.value.place == "bodies.rod"
    assert "type distance" in str(refused.value)


# --- fast and slow ----------------------------------------------------------------


def ringing(rod: SID) -> SID:
    """The rod with one undamped mode of 20 kHz."""
    one = first_modes(rod, 1)
    stiffness = (2.0 * math.pi * 20e3) ** 2 * one.Me.m0
    return replace(one, Ke=Taylor(stiffness), De=Taylor(np.zeros((1, 1))))


@pytest.mark.parametrize("integrator", STIFF)
def test_an_undamped_mode_of_20_khz_at_rest_costs_nothing(
    rod: SID, integrator: str
) -> None:
    """60 000 periods: only what the motion asks of it, quasi-static, is seen."""
    record = ["piston.x", "rod.q1"]
    system = compiled(slider_crank(outputs={"record": record}), rod=ringing(rod))
    result = simulate(system, integrator=integrator, rtol=1e-6)
    assert result.counters["steps"] < 1350
    assert result["piston.x"] == pytest.approx(rigid_piston(result.t), abs=1e-10)
    assert np.abs(result["rod.q1"]).max() == pytest.approx(2.4877e-9, rel=1e-4)


@pytest.mark.parametrize("integrator", ["radau9", "radau13"])
def test_an_undamped_mode_of_20_khz_that_rings_keeps_its_energy(
    rod: SID, integrator: str
) -> None:
    """100 periods of a deformation of 1 micrometre, on the moving rod."""
    record = ["piston.x", "rod.q1", "energy.elastic", "energy.kinetic"]
    table = slider_crank(outputs={"record": record}).model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    table["time"] = {"end": 0.005, "output_step": 1e-6}
    table["bodies"]["rod"]["initial"]["elastic"] = [1e-6]
    described = SceneFile.model_validate(table)
    result = simulate(
        compiled(described, rod=ringing(rod)), integrator=integrator, rtol=1e-6
    )
    energy = result["energy.elastic"] + result["energy.kinetic"]
    assert np.ptp(energy) < 1e-3 * energy[0]
    last = np.abs(result["rod.q1"][-100:]).max()
    assert last == pytest.approx(1e-6, rel=5e-4)
    assert np.abs(result["piston.x"] - 1.1).max() < 1e-11


def test_a_hundred_revolutions_end_where_the_first_one_did(rod: SID) -> None:
    """Once the start is damped out every revolution is the same, so that any drift of
    constraints or angles would show; 10 000 are in `benchmarks.revolutions`."""
    record = ["piston.x", "rod.q1", "rod.q2"]
    turn = 2.0 * math.pi / FULL_SPEED
    described = steady(100.0 * turn, turn / 8.0, outputs={"record": record})
    result = simulate(compiled(described, rod=rod), integrator="radau9", rtol=1e-7)
    for name in record:
        turns = result[name][:-1].reshape(100, 8)
        size = np.abs(turns).max()
        assert np.ptp(turns[50:], axis=0).max() < 2e-6 * size, name
    assert result.drift["position"] < 1e-12
    assert result.drift["velocity"] < 1e-12


# --- beyond what the model holds --------------------------------------------------


def test_a_crank_twenty_times_as_fast_tells_why_the_model_ends(rod: SID) -> None:
    """7200 revolutions a minute press 280 kN through a rod that buckles at 46 kN. The
    SID of first order loses its positive inertia on the way: every run stops there,
    says where and why, and keeps what was computed before."""
    table = slider_crank(speed=20.0).model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    table["bodies"]["rod"]["quadratic_inertia"] = False
    system = compiled(SceneFile.model_validate(table), rod=rod)
    fine = simulate_until_stop(system, "radau9", 1e-6)
    assert not fine.completed
    assert fine.message.startswith("stopped at t = 0.640761")
    (lost,) = (each for each in fine.diagnostics if each.code == "N307")
    assert lost.subject == "rod" and "quadratic_inertia" in lost.remedy
    assert len(fine.t) == 66 and np.isfinite(fine.values).all()
    for integrator in ("radau5", "radau9", "trapezoidal", "generalised_alpha"):
        coarse = simulate_until_stop(system, integrator, 1e-4)
        assert coarse.message.startswith("stopped at t = 0.6407")
        for name in ("piston.x", "rod.q1"):
            before = fine[name][:-1]
            size = np.abs(before).max()
            assert coarse[name][:-1] == pytest.approx(before, abs=1e-2 * size)


def simulate_until_stop(system: Any, integrator: str, rtol: float) -> Result:
    with pytest.raises(SimulationError) as failure:
        simulate(system, integrator=integrator, rtol=rtol)
    assert failure.value.result is not None
    return failure.value.result


def test_with_the_exact_inertia_the_fast_crank_turns_on(rod: SID) -> None:
    """The term q.Me.q keeps the inertia positive, whatever the deformation."""
    table = slider_crank(speed=20.0).model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    table["bodies"]["rod"]["quadratic_inertia"] = True
    table["time"]["end"] = 1.0
    described = SceneFile.model_validate(table)

    def reached(rtol: float) -> Result:
        """To the end; what comes of such deformations has no meaning."""
        with pytest.raises(SimulationError, match="N414 rod") as failure:
            simulate(compiled(described, rod=rod), integrator="radau9", rtol=rtol)
        assert failure.value.result is not None
        return failure.value.result

    fine, coarse = reached(1e-9), reached(1e-6)
    assert fine.t[-1] == described.time.end
    early = fine.t < 0.7
    for name in ("piston.x", "rod.q1"):
        size = np.abs(fine[name][early]).max()
        assert coarse[name][early] == pytest.approx(fine[name][early], abs=1e-4 * size)


@pytest.mark.parametrize("integrator", ["trapezoidal", "generalised_alpha", "radau9"])
def test_a_load_on_a_mode_damped_far_above_critical(integrator: str) -> None:
    """m q'' + d q' + k q = f from rest has two times that lie far apart."""
    undamped = sid_from_model(beam())
    m, k = float(undamped.Me.m0[0, 0]), float(undamped.Ke.m0[0, 0])
    stiff = 1e8 * k
    d = 1e3 * 2.0 * math.sqrt(stiff * m)
    sid = replace(undamped, Ke=Taylor([[stiff]]), De=Taylor([[d]]))
    described = scene(
        {"rod": {"sid": "rod", "markers": {"root": 1}}},
        {"root": {"type": "fixed", "markers": ["ground", "rod.root"]}},
        gravity=[0.0, -GRAVITY],
        record=["rod.q1"],
    )
    result = simulate(compiled(described, rod=sid), integrator=integrator, rtol=1e-4)
    fast, slow = np.roots([m, d, stiff])
    t, static = result.t, -GRAVITY * float(undamped.Ct.m0[0, 1]) / stiff
    rest = (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)
    assert result["rod.q1"] == pytest.approx(
        static * (1.0 - rest), abs=2e-4 * abs(static)
    )


# --- what is not smooth -----------------------------------------------------------


@pytest.mark.parametrize(
    ("integrator", "bound"), [("radau5", 1e-7), ("radau9", 1e-7), ("trapezoidal", 1e-5)]
)
def test_a_step_force_is_stepped_to(integrator: str, bound: float) -> None:
    """An oscillator is pushed from 0.3 s on: its answer is 1 - cos from then."""
    pieces = [
        {"from": 0.0, "to": 0.3, "coefficients": [0.0]},
        {"from": 0.3, "coefficients": [1.0]},
    ]
    forces = {
        "push": {
            "type": "force",
            "marker": "block",
            "force": [8.0, 0.0],
            "function": {"type": "polynomial", "pieces": pieces},
        },
        "spring": {
            "type": "spring_damper",
            "joint": "rail",
            "stiffness": 200.0,
        },
    }
    joints = {"rail": {"type": "prismatic", "markers": ["ground", "block.a"]}}
    described = scene(
        {"block": slender_rod(1.0, 2.0)}, joints, forces=forces, record=["block.x"]
    )
    result = simulate(compiled(described), integrator=integrator, rtol=1e-8)
    since = np.maximum(result.t - 0.3, 0.0)
    exact = 0.04 * (1.0 - np.cos(10.0 * since))
    assert result["block.x"] == pytest.approx(exact, abs=bound)
    assert np.abs(result["block.x"][result.t <= 0.3]).max() < 1e-15


@pytest.mark.parametrize(
    ("pieces", "problem"),
    [
        ([[0.0], [0.1]], "jumps by 0.1 at t = 0.5 s"),
        ([[0.0, 1.0], [0.5, 3.0]], "jumps in its rate by 2 at t = 0.5 s"),
    ],
    ids=["place", "speed"],
)
def test_a_drive_that_no_finite_force_can_follow_is_refused(
    pieces: list[list[float]], problem: str
) -> None:
    function = {
        "type": "polynomial",
        "pieces": [
            {"from": 0.0, "to": 0.5, "coefficients": pieces[0]},
            {"from": 0.5, "coefficients": pieces[1]},
        ],
    }
    joints = {"rail": {"type": "prismatic", "markers": ["ground", "block.a"]}}
    drives = {"move": {"joint": "rail", "function": function}}
    with pytest.raises(InputError, match=problem):
        compiled(scene({"block": slender_rod(1.0)}, joints, drives))


def test_a_drive_whose_acceleration_jumps_is_stepped_to(rod: SID) -> None:
    """The crank starts at once with 40 rad/s2 and stops accelerating at 0.5 s: fixed
    steps that end at the jumps keep the order of the method, others would not."""
    table = slider_crank(1.0).model_dump(mode="json", by_alias=True, exclude_none=True)
    pieces = [
        {"from": 0.0, "to": 0.5, "coefficients": [0.0, 0.0, 20.0]},
        {"from": 0.5, "coefficients": [5.0, 20.0]},
    ]
    table["drives"]["crank_angle"]["function"]["pieces"] = pieces
    described = SceneFile.model_validate(table)
    exact = simulate(compiled(described, rod=rod), integrator="radau9", rtol=1e-11)
    errors = []
    for step in (0.5 / 512, 0.5 / 1024):
        result = simulate(
            compiled(described, rod=rod), integrator="radau5", rtol=1e-10, step=step
        )
        errors.append(np.abs(result["rod.q1"] - exact["rod.q1"]).max())
    assert math.log2(errors[0] / errors[1]) > 4.5, errors
    found = simulate(compiled(described, rod=rod), rtol=1e-6)
    assert found["rod.q1"] == pytest.approx(
        exact["rod.q1"], abs=1e-5 * np.abs(exact["rod.q1"]).max()
    )


def test_a_drive_in_one_polynomial_or_in_two_is_the_same() -> None:
    """A break where nothing jumps only ends a step."""
    rod = slender_rod(1.0)
    joints = {"axle": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    whole = polynomial(0.0, 0.0, 2.0)
    pieces = [
        {"from": 0.0, "to": 0.4, "coefficients": [0.0, 0.0, 2.0]},
        {"from": 0.4, "coefficients": [0.32, 1.6, 2.0]},
    ]
    functions = [whole, {"type": "polynomial", "pieces": pieces}]
    first, second = (
        simulate(
            compiled(
                scene(
                    {"rod": rod},
                    joints,
                    {"turn": {"joint": "axle", "function": function}},
                    record=["rod.b.x", "turn.f1"],
                )
            ),
            rtol=1e-9,
        )
        for function in functions
    )
    assert first.values == pytest.approx(second.values, abs=1e-9)


@pytest.mark.parametrize("integrator", ["radau5", "radau9"])
def test_a_stiff_spring_that_turns_is_followed_without_failures(
    integrator: str,
) -> None:
    """A rod hung to a spring of 1e8 N/m moves as one hung to a massless rod.

    Where the spring turns too far in a step, Newton's iteration diverges: the steps
    stay below that, and do not try it again and again.
    """
    rods = {"rod": slender_rod(1.0, position=[1.0, 0.0])}
    ends = ["ground.o", "rod.a"]
    more: dict[str, Any] = {
        "end": 2.0,
        "record": ["rod.b.x", "rod.b.y"],
        "gravity": [0.0, -GRAVITY],
        "ground": {"markers": {"o": {"position": [0.0, 0.0]}}},
    }
    link = {"link": {"type": "distance", "markers": ends, "length": 1.0}}
    spring = {"type": "spring_damper", "markers": ends, "stiffness": 1e8, "rest": 1.0}
    stiff = simulate(compiled(scene(rods, link, **more)), rtol=1e-8)
    found = simulate(
        compiled(scene(rods, forces={"link": spring}, **more)),
        integrator=integrator,
        rtol=1e-6,
    )
    assert found.values == pytest.approx(stiff.values, abs=1e-5)
    assert found.counters["rejected"] < found.counters["steps"] / 8
