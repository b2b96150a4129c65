"""What runs say of flexible bodies: stiffening, excitation, contributions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.sid import SID, Node, Taylor, block_shape
from sidtool.formats.geometric_stiffening import stiffening_ratio
from sidtool.formats.result import FlexibleBody, Result
from sidtool.formats.sid_subset import select_shape_functions
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import simulate
from sidtool.solver.diagnostics.geometric_stiffening import Loads, largest_stiffening
from sidtool.solver.diagnostics.run_summary import describe_bodies, initialise
from sidtool.solver.system.errors import SimulationError
from tests.bodies import particle_body
from tests.references.spin_up import blade, spin_up
from tests.sidtool.beams import IGA, beam

from ..scenes import compiled, polynomial, scene

#: Euler's load of the cantilever with L = EI = 1.
EULER = np.pi**2 / 4
COARSE = {**IGA, "elements": [12, 1]}
MODES = {"method": "modal", "modes": 3}


@cache
def cantilever(stiffened: bool = True) -> SID:
    """L = m = EI = 1, three modes."""
    table = {"stiffening": {}} if stiffened else {}
    damping = {"type": "rayleigh", "alpha": 1.0, "beta": 0.0}
    return sid_from_model(beam(COARSE, reduction=MODES, damping=damping, **table))


@cache
def spin_up_beam(stiffened: bool) -> SID:
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [16, 1]}
    return sid_from_model(blade(mesh, MODES, stiffened=stiffened))


def fixed(sid: SID, joint: str = "fixed", **more: Any) -> Any:
    """The cantilever on the ground, its root fixed or turned."""
    return compiled(
        scene(
            {"beam": {"sid": "beam.SID_FEM", "markers": {"root": 1, "tip": 2}}},
            {"hub": {"type": joint, "markers": ["ground", "beam.root"]}},
            **more,
        ),
        beam=sid,
    )


def body(result: Result, name: str = "beam") -> FlexibleBody:
    return result.bodies[name]


def test_equal_instants_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """4000 instants of one speed, but for rounding, need one group of eigenvalues."""
    sid, count, find = particle_body(4, 8, seed=0), [0], np.linalg.eigh
    random = np.random.default_rng(0)
    w = np.array([[3.0, -2.0, 5.0]]) * (1.0 + 1e-15 * random.normal(size=(4000, 1)))
    expected = stiffening_ratio(sid, angular_velocity=w[0])

    def eigh(matrices: Any) -> Any:
        count[0] += 1
        return find(matrices)

    monkeypatch.setattr(np.linalg, "eigh", eigh)
    found = largest_stiffening(sid, Loads(w, 0.0 * w, 0.0 * w), np.arange(4000.0))
    assert found.ratio == pytest.approx(expected, rel=1e-9) and count[0] <= 4


@pytest.mark.parametrize("seed", range(3))
def test_the_worst_instant_is_that_of_all(seed: int) -> None:
    """Eigenvalues at every instant, one by one, find nothing worse."""
    sid = particle_body(4, 8, seed=seed, stiffening=True)
    random = np.random.default_rng(seed)
    w, a, alpha, f = random.normal(size=(4, 60, 3)) * [[[9.0]], [[40.0]], [[20]], [[8]]]
    found = largest_stiffening(sid, Loads(w, a, alpha, {"1": f}), np.arange(60.0))
    ratios = [
        stiffening_ratio(
            sid,
            angular_velocity=w[i],
            acceleration=a[i],
            angular_acceleration=alpha[i],
            forces={"1": f[i]},
        )
        for i in range(60)
    ]
    worst = int(np.abs(ratios).argmax())
    assert found.ratio == pytest.approx(ratios[worst], rel=1e-9)
    assert found.time == worst
    assert found.carried


def test_loads_that_are_nothing_or_not_finite_change_nothing() -> None:
    sid, zero = cantilever(), np.zeros((2, 3))
    assert largest_stiffening(sid, Loads(zero, zero, zero), np.arange(2)).ratio == 0
    spin = np.array([[0, 0, 0.1], [np.nan, 0, 0]])
    found = largest_stiffening(sid, Loads(spin, zero, zero), np.arange(2))
    assert found.time == 0 and 0 < found.ratio < 1e-3


def rotor(first: float, second: float) -> SID:
    """A point mass of 1 kg on a shaft along x that bends in y and z, as a SID."""
    phi = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    blocks = {
        name: Taylor(np.zeros(block_shape(name, 2)))
        for name in ("mdCM", "J", "Ct", "Cr", "Gr", "Ge", "ksigma", "De")
    }
    cr1, oe1 = np.zeros((2, 2, 3)), np.zeros((2, 2, 6))
    for i in range(2):
        for k in range(2):
            cr1[k, i] = np.cross(phi[:, k], phi[:, i])
            oe1[k, i, 0] = -float(i == k)
    node = Node(
        "1",
        Taylor(np.zeros((3, 1)), phi.T[:, :, None]),
        Taylor(phi),
        Taylor(np.zeros((3, 2))),
        Taylor(np.eye(3)),
    )
    return SID(
        1.0,
        ("y", "z"),
        (node,),
        Me=Taylor(np.eye(2)),
        Ke=Taylor(np.diag([first, second])),
        Oe=Taylor(np.zeros((2, 6)), oe1),
        **{**blocks, "Cr": Taylor(np.zeros((2, 3)), cr1)},
    )


@pytest.mark.parametrize(
    ("stiffness", "speed", "diverges"),
    [((4.0, 4.0), 3.0, False), ((4.0, 16.0), 3.0, True), ((4.0, 16.0), 5.0, False)],
)
def test_coriolis_forces_hold_a_shaft_above_its_critical_speed(
    stiffness: tuple[float, float], speed: float, diverges: bool
) -> None:
    """Jeffcott's rotor: unstable between its two critical speeds, 2 and 4 rad/s.

    Elsewhere its frequencies in axes at rest are those without rotation (or between
    those of both planes): nothing softens it.
    """
    spin = np.array([[speed, 0.0, 0.0]])
    loads = Loads(spin, 0 * spin, 0 * spin)
    found = largest_stiffening(rotor(*stiffness), loads, np.zeros(1))
    lost = -(speed**2) / 4 if diverges else 0.0
    assert found.ratio == pytest.approx(lost, abs=1e-12)
    assert found.diverges == diverges
    assert ("diverges" in found.sentence()) == diverges


def test_a_shaft_that_bends_in_one_plane_is_softened() -> None:
    """No second plane, no Coriolis force: 4 - 1 is left of 4 at 1 rad/s."""
    spin = np.array([[1.0, 0.0, 0.0]])
    loads = Loads(spin, 0 * spin, 0 * spin)
    sid = select_shape_functions(rotor(4.0, 4.0), [0])
    found = largest_stiffening(sid, loads, np.zeros(1))
    assert found.ratio == pytest.approx(-1 / 4) and not found.diverges


def test_a_spun_up_beam_with_stiffening() -> None:
    result = simulate(compiled(spin_up(16.0), beam=spin_up_beam(True)), rtol=1e-4)
    beam = body(result)
    assert beam.expected.ratio == pytest.approx(beam.found.ratio, rel=1e-6)
    speed = stiffening_ratio(spin_up_beam(True), angular_velocity=(0, 0, 6.0))
    assert beam.found.ratio == pytest.approx(speed, rel=1e-6)
    assert beam.before.endswith(
        "expected: stiffening matters and is in the SID, +71.1 % of the stiffness by "
        "rotation of 6 rad/s"
    )
    assert beam.found.time == pytest.approx(15.0, abs=0.02)
    assert not beam.diverges and beam.deflection == pytest.approx(0.0574, rel=0.01)


def test_a_spun_up_beam_without_stiffening_is_explained() -> None:
    """-(6 / w1)^2 of the stiffness: foreseen, found, and told of its deflection."""
    with pytest.raises(SimulationError) as stop:
        simulate(compiled(spin_up(16.0), beam=spin_up_beam(False)), rtol=1e-4)
    beam = body(stop.value.result)
    assert (stop.value.code, stop.value.data["deflection"]) == ("N414", beam.deflection)
    first = np.sqrt(1.4e4 / 1.2) / 100 * 3.516015
    assert beam.found.ratio == pytest.approx(-((6 / first) ** 2), rel=5e-3)
    assert beam.expected.diverges and beam.found.diverges
    for text in (beam.before, beam.after):
        assert "diverges, -250 % of the stiffness by rotation of 6 rad/s" in text
        assert "lacks the geometric stiffening" in text
    assert "beyond the small deformations" in beam.after


def test_a_run_that_stops_for_want_of_stiffening_says_so() -> None:
    """The deformation grows until numbers end."""
    described = spin_up(400.0)
    time = described.time.model_copy(update={"output_step": 10.0})
    described = described.model_copy(update={"time": time})
    system = compiled(described, beam=spin_up_beam(False))
    with pytest.raises(SimulationError) as stop:
        simulate(system, rtol=1e-3)
    assert stop.value.result is not None
    found = {each.code: each for each in stop.value.result.diagnostics}
    assert found["N405"].subject == "beam"
    assert found["N405"].data["ratio"] == pytest.approx(-2.5, abs=0.01)


def test_what_is_expected_is_told_before_the_first_step() -> None:
    system = fixed(cantilever(), end=0.1)
    expected = system.cached(initialise).expected_bodies["beam"]
    result = simulate(system)
    assert expected.found is None
    assert expected.expected == result.bodies["beam"].expected
    (described,) = describe_bodies(system)
    assert described.expected is not None
    assert described.expected.before == expected.before


def test_the_description_names_markers_that_stiffen() -> None:
    """By forces or by moments, where the SID carries it."""
    push = {"type": "force", "marker": "beam.tip", "force": [0.0, 0.1]}
    sid = cantilever()
    root, tip, *others = sid.nodes
    turned = replace(tip, phi=root.phi, psi=replace(tip.psi, m1=tip.phi.m1))
    for body, markers in (
        (sid, ("tip",)),
        (replace(sid, nodes=(root, turned, *others)), ("tip",)),
        (cantilever(False), ()),
    ):
        (described,) = describe_bodies(fixed(body, forces={"push": push}))
        assert described.stiffened == markers


def test_a_column_under_a_given_load_buckles_as_euler_says() -> None:
    """Half of Euler's load; given forces are foreseen."""
    push = {"type": "force", "marker": "beam.tip", "force": [-EULER / 2, 0.0]}
    result = simulate(fixed(cantilever(), end=0.1, forces={"push": push}))
    for stage in (body(result).expected, body(result).found):
        assert stage.ratio == pytest.approx(-0.5, rel=5e-3)
        assert stage.load == "a force of 1.23 N at node 2"
        assert not stage.diverges


@pytest.mark.parametrize("axes", ["inertial", "marker"])
def test_the_largest_value_of_a_given_force_is_foreseen(axes: str) -> None:
    """It swings about nothing: what it will be, not what it is at the start."""
    push = {
        "type": "force",
        "marker": "beam.tip",
        "force": [-EULER / 2, 0.0],
        "axes": axes,
        "function": {"type": "harmonic", "amplitude": 1.0, "frequency": 25.0},
    }
    stage = body(simulate(fixed(cantilever(), end=0.1, forces={"push": push}))).expected
    assert abs(stage.ratio) == pytest.approx(0.5, rel=1e-2)


def test_a_column_beyond_its_load_buckles() -> None:
    push = {"type": "force", "marker": "beam.tip", "force": [-1.2 * EULER, 0.0]}
    found = body(simulate(fixed(cantilever(), end=0.01, forces={"push": push})))
    assert found.expected.diverges
    assert found.after.startswith("buckles, -12")


def test_a_standing_column_under_its_own_weight() -> None:
    """Greenhill: it would buckle at q L^3 / EI = 7.8373."""
    system = fixed(cantilever(), end=0.1, gravity=[-0.5 * 7.8373, 0.0])
    stage = body(simulate(system)).expected
    assert stage.ratio == pytest.approx(-0.5, rel=5e-3)
    assert stage.load == "acceleration of 3.92 m/s2"


@pytest.mark.parametrize("swapped", [False, True])
def test_joint_forces_stiffen(swapped: bool) -> None:
    """A mass hangs at the tip: its weight pulls, known by the multipliers alone."""
    ends = ["beam.tip", "load"]
    system = compiled(
        scene(
            {
                "beam": {"sid": "beam.SID_FEM", "markers": {"root": 1, "tip": 2}},
                "load": {"mass": 0.5, "initial": {"position": [1.0, 0.0]}},
            },
            {
                "hub": {"type": "fixed", "markers": ["ground", "beam.root"]},
                "hook": {
                    "type": "coincident",
                    "markers": ends[::-1] if swapped else ends,
                },
            },
            end=0.02,
            gravity=[2.0, 0.0],
        ),
        beam=cantilever(),
    )
    # one axial shape is missing: the beam does not stretch, the mass just hangs
    found = body(simulate(system)).found
    weight = np.array([0.5 * 2.0, 0.0, 0.0])
    expected = stiffening_ratio(
        cantilever(), acceleration=(-2.0, 0, 0), forces={"2": weight}
    )
    assert found.ratio == pytest.approx(expected, rel=1e-6)
    assert expected > stiffening_ratio(cantilever(), acceleration=(-2.0, 0, 0))


def test_forces_of_springs_stiffen() -> None:
    """A stretched spring pulls the tip outwards by k (2 - 1.5)."""
    spring = {
        "type": "spring_damper",
        "markers": ["beam.tip", "ground.post"],
        "stiffness": 3.0,
        "rest": 1.5,
    }
    ground = {"markers": {"post": {"position": [3.0, 0.0]}}}
    system = fixed(cantilever(), end=0.02, forces={"pull": spring}, ground=ground)
    found = body(simulate(system)).found
    expected = stiffening_ratio(cantilever(), forces={"2": (1.5, 0, 0)})
    assert found.ratio == pytest.approx(expected, rel=1e-6)
    assert found.load == "a force of 1.5 N at node 2"


def test_nothing_is_expected_of_a_body_that_no_drive_turns() -> None:
    """A wheel beside it turns, which says nothing of how fast the beam will."""
    system = compiled(
        scene(
            {
                "beam": {
                    "sid": "beam.SID_FEM",
                    "markers": {"root": 1, "tip": 2},
                    "initial": {"position": [0.0, 1.0]},
                },
                "wheel": {"mass": 1.0, "inertia": 1.0},
            },
            {"axle": {"type": "revolute", "markers": ["ground", "wheel"]}},
            {"spin": {"joint": "axle", "function": polynomial(0.0, 6.0)}},
            end=0.1,
        ),
        beam=cantilever(False),
    )
    found = body(simulate(system))
    assert found.expected.ratio == 0.0 and not found.expected.load
    assert "% of the stiffness" not in found.before
    assert not found.diverges and found.found.ratio == 0


def test_a_share_is_that_of_the_load_which_is_named() -> None:
    """Two forces along a column: all of it, and each alone by Euler's load."""
    forces = {
        name: {"type": "force", "marker": "beam.tip", "force": [-part * EULER, *rest]}
        for name, part, rest in (("a", 0.2, [0.0]), ("b", 0.1, [0.0]))
    }
    weight = [-0.1 * 7.8373, 0.0]
    told = simulate(fixed(cantilever(), end=0.02, forces=forces, gravity=weight))
    for stage in (body(told).expected, body(told).found):
        assert stage.load == f"a force of {0.3 * EULER:.3g} N at node 2"
        assert stage.alone == pytest.approx(-0.3, rel=5e-3)
        both = stiffening_ratio(
            cantilever(),
            forces={"2": (-0.3 * EULER, 0.0, 0.0)},
            acceleration=(0.1 * 7.8373, 0.0, 0.0),
        )
        assert stage.ratio == pytest.approx(both, rel=1e-6)
        words = stage.sentence()
        assert f"{100 * stage.ratio:.3g} %" in words
        assert f"{100 * stage.alone:.3g} % by {stage.load}" in words
    alone = simulate(fixed(cantilever(), end=0.02, gravity=weight))
    single = body(alone).found
    assert single.alone == single.ratio and "alone" not in single.sentence()


def test_shape_functions_too_slow_for_the_excitation_are_told() -> None:
    shake = {
        "type": "force",
        "marker": "beam.tip",
        "force": [0.0, 1e-3],
        "function": {"type": "harmonic", "amplitude": 1.0, "frequency": 5.0},
    }
    found = body(simulate(fixed(cantilever(), end=0.1, forces={"shake": shake})))
    highest = 61.6972 / (2 * np.pi)
    assert found.highest_frequency == pytest.approx(highest, rel=5e-3)
    ratio = found.highest_frequency / 5.0
    assert found.before.startswith(
        f"frequencies to {found.highest_frequency:.6g} Hz, {ratio:.3g} times the "
        "excitation of 5 Hz (shake), too few: keep shape functions up to 3 times it"
    )


def test_contributions_of_one_mode_that_swings_alone() -> None:
    """Released in its second mode, the body keeps to it, and all energy is there.

    But for what its inertia has of second order, a share of 1e-9 at 1e-3.
    """
    sid = replace(cantilever(), De=Taylor(np.zeros((3, 3))))
    start = {"elastic": [0.0, 1e-4, 0.0]}
    described = scene(
        {"beam": {"sid": "b", "markers": {"root": 1}, "initial": start}},
        {"hub": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        record=["beam.q*"],
        steps=200,
    )
    result = simulate(compiled(described, beam=sid), rtol=1e-8)
    found = body(result)
    assert_allclose(found.energy_shares, [0, 1, 0], atol=1e-9)
    assert_allclose(found.amplitudes, np.abs(result.values).max(axis=0), atol=1e-12)
    assert_allclose(found.amplitudes, [0, 1e-4, 0], atol=1e-10)
    hertz = np.array([3.516015, 22.0345, 61.6972]) / (2 * np.pi)
    assert_allclose(found.frequencies, hertz, rtol=5e-3)
    assert found.labels == sid.labels
    assert found.deflection == pytest.approx(2e-4, rel=5e-3)


def test_rigid_scenes_have_no_flexible_bodies() -> None:
    described = scene({"rod": {"mass": 1.0, "inertia": 1.0}})
    assert simulate(compiled(described)).bodies == {}
