"""What a run says of its flexible bodies is true, and looks between output times."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.geometric_stiffening import SIGNIFICANT_CHANGE
from sidtool.formats.result import Result
from sidtool.formats.sid_mass import body_size
from sidtool.solver import simulate
from sidtool.solver.diagnostics.body_loads import expected_bodies
from sidtool.solver.diagnostics.excitation import drive_history, excitation
from sidtool.solver.diagnostics.geometric_stiffening import Loads, largest_stiffening
from sidtool.solver.system.system import System

from ..scenes import compiled, polynomial, scene
from .test_body_measures import cantilever, fixed, rotor


def swinging(output_step: float, **more: Any) -> Result:
    """The cantilever released from a bent shape, without damping."""
    sid = replace(cantilever(), De=Taylor(np.zeros((3, 3))))
    start = {"elastic": [1e-3, -2e-4, 1e-4]}
    described = scene(
        {"beam": {"sid": "b", "markers": {"root": 1, "tip": 2}, "initial": start}},
        {"hub": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        end=10.0,
        record=["beam.q*"],
        **more,
    )
    time = described.time.model_copy(update={"output_step": output_step})
    described = described.model_copy(update={"time": time})
    return simulate(compiled(described, beam=sid), rtol=1e-8)


def test_few_output_times_tell_the_same_of_a_body() -> None:
    fine, coarse = (swinging(step).bodies["beam"] for step in (0.001, 5.0))
    assert coarse.amplitudes == pytest.approx(fine.amplitudes, rel=1e-2)
    assert coarse.deflection == pytest.approx(fine.deflection, rel=1e-2)
    assert coarse.energy_shares == pytest.approx(fine.energy_shares, abs=0.05)


def test_parts_of_the_energy_add_up_to_one() -> None:
    """Also where Ke couples the coordinates."""
    sid = cantilever()
    mix = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -0.4], [0.3, 0.0, 1.0]])
    mixed = replace(
        sid,
        Ke=Taylor(mix.T @ sid.Ke.m0 @ mix),
        Me=Taylor(mix.T @ sid.Me.m0 @ mix),
    )
    assert abs(mixed.Ke.m0[0, 1]) > 1e-2 * mixed.Ke.m0[0, 0]
    system = fixed(mixed, end=0.5, gravity=[0.0, -1e-3])
    assert simulate(system).bodies["beam"].energy_shares.sum() == pytest.approx(1.0)


def test_the_deflection_is_that_of_the_node_that_moves_most() -> None:
    """Over all output times and nodes, relative to the length of 1 m."""
    result = swinging(0.001)
    shapes = np.array([node.phi.m0 for node in cantilever().nodes])
    u = np.linalg.norm(np.einsum("tl,nal->tna", result.values, shapes), axis=2)
    assert result.bodies["beam"].deflection == pytest.approx(u.max(), rel=5e-3)


@pytest.mark.parametrize("shift", [0.0, 30.0])
def test_the_length_of_a_body_does_not_depend_on_its_frame(shift: float) -> None:
    """A bar of 1 m: from its moment of inertia, wherever its frame stands."""
    sid, d = cantilever(), np.array([shift, 0.0, 0.0])
    centre = sid.mdCM.m0[:, 0] + sid.mass * d
    J = sid.J.m0[:, 0].copy()
    J[1:3] += 2 * shift * sid.mdCM.m0[0, 0] + sid.mass * shift**2
    nodes = tuple(
        replace(node, origin=replace(node.origin, m0=node.origin.m0 + d[:, None]))
        for node in sid.nodes
    )
    moved = replace(
        sid,
        mdCM=replace(sid.mdCM, m0=centre[:, None]),
        J=replace(sid.J, m0=J[:, None]),
        nodes=nodes,
    )
    assert body_size(moved) == pytest.approx(1.0, rel=5e-3)


def pulled_rotor(pull: float) -> SID:
    """Jeffcott's rotor whose z direction the acceleration along x stiffens."""
    ct1 = np.zeros((2, 2, 3))
    ct1[1, 1, 0] = pull
    return replace(rotor(4.0, 16.0), Ct=Taylor(np.zeros((2, 3)), ct1))


def test_divergence_is_seen_beside_a_larger_stiffening() -> None:
    """At 3 rad/s y sinks, -9/4 of its stiffness, while z is stiffened sixfold."""
    spin, push = np.array([[3.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    loads = Loads(spin, push, 0.0 * spin)
    found = largest_stiffening(pulled_rotor(6.0 * 16.0), loads, np.zeros(1))
    assert found.diverges and found.ratio == pytest.approx(-9.0 / 4.0)


def test_what_else_loads_a_shaft_is_seen_beside_its_whirl() -> None:
    """An acceleration along x stiffens z by 3 of 16, whatever whirls."""
    sid = pulled_rotor(3.0)
    spin, pull = np.array([[1.9, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    found = largest_stiffening(sid, Loads(spin, pull, 0.0 * spin), np.zeros(1))
    assert found.ratio == pytest.approx(3.0 / 16.0)
    assert found.load == "acceleration of 1 m/s2"


@pytest.mark.parametrize("seed", range(20))
def test_a_shaft_diverges_between_its_critical_speeds_and_nowhere_else(
    seed: int,
) -> None:
    """Jeffcott's rotor of two stiffnesses, at random speeds."""
    random = np.random.default_rng(seed)
    first, second = np.sort(random.uniform(2.0, 6.0, 2))
    speed = random.uniform(1.0, 8.0)
    spin = np.array([[speed, 0.0, 0.0]])
    loads = Loads(spin, 0 * spin, 0 * spin)
    found = largest_stiffening(rotor(first**2, second**2), loads, np.zeros(1))
    assert found.diverges == (first < speed < second)


def test_a_shaft_about_its_long_axis_is_not_sent_for_stiffening() -> None:
    """The rotor's mass lies on its axis: nothing pulls on the shaft."""
    for stiffness, speed, words in (
        ((4.0, 4.0), 3.0, "none"),
        ((4.0, 16.0), 3.0, "between critical speeds"),
    ):
        sid = rotor(*stiffness)
        far = replace(sid.nodes[0], id="2")
        origin = replace(far.origin, m0=np.array([[2.0], [0.0], [0.0]]))
        sid = replace(sid, nodes=(sid.nodes[0], replace(far, origin=origin)))
        spin = np.array([[speed, 0.0, 0.0]])
        loads = Loads(spin, 0 * spin, 0 * spin)
        sentence = largest_stiffening(sid, loads, np.zeros(1)).sentence()
        assert words in sentence and "[stiffening]" not in sentence


def test_stiffening_is_not_advised_where_there_is_none() -> None:
    """A body that came as matrices has no elements that could be stiffened."""
    spin = np.array([[0.0, 0.0, 1.0]])
    loads = Loads(spin, 0 * spin, 0 * spin)
    for known, advised in ((False, True), (True, False)):
        sid = replace(cantilever(False), from_matrices=known)
        for speed in (1.0, 6.0):
            turning = replace(loads, angular_velocity=speed * spin)
            found = largest_stiffening(sid, turning, np.zeros(1))
            assert abs(found.ratio) > SIGNIFICANT_CHANGE and found.lacks_stiffening
            assert ("[stiffening]" in found.sentence()) == advised


def pushed(*functions: dict[str, Any]) -> System:
    forces = {
        f"push{i}": {
            "type": "force",
            "marker": "beam.tip",
            "force": [0.0, 1e-3],
            "function": function,
        }
        for i, function in enumerate(functions)
    }
    return fixed(cantilever(), end=2.0, forces=forces)


def table_of(frequency: float) -> dict[str, Any]:
    t = np.linspace(0.0, 2.0, 400)
    values = np.sin(2 * np.pi * frequency * t)
    points = {"times": t.tolist(), "values": values.tolist()}
    return {"type": "table", "interpolation": "smooth", **points}


@pytest.mark.parametrize("frequency", [3.0, 11.0])
def test_a_table_excites_as_what_it_holds(frequency: float) -> None:
    """Also beside a slower harmonic."""
    slow = {"type": "harmonic", "amplitude": 1.0, "frequency": 0.01}
    system = pushed(slow, table_of(frequency))
    found = excitation(system, drive_history(system))
    assert found.frequency == pytest.approx(frequency, rel=0.02)
    assert found.by == "push1"


def test_a_smooth_step_excites_by_its_length() -> None:
    """A rise in T is half a swing of 2 T, somewhat faster in its bends."""
    rise = {"type": "smooth_step", "from": 0.5, "to": 0.6, "start": 0.0, "end": 1.0}
    system = pushed(rise)
    found = excitation(system, drive_history(system))
    assert 0.5 / 0.1 <= found.frequency <= 1.0 / 0.1


def test_a_jump_excites_all_frequencies() -> None:
    pieces = [
        {"from": 0.0, "to": 1.0, "coefficients": [0.0]},
        {"from": 1.0, "to": 2.0, "coefficients": [1.0]},
    ]
    system = pushed({"type": "polynomial", "pieces": pieces})
    found = expected_bodies(system, _start(system))["beam"]
    assert "excitation at all frequencies (push0 jumps)" in found.before


def _start(system: System) -> Any:
    from sidtool.solver.initial_state.assembly import assemble

    return assemble(system)[1]


def test_constants_excite_nothing() -> None:
    system = pushed(polynomial(0.0, 3.0))
    assert excitation(system, drive_history(system)).frequency == 0.0


def test_an_output_grid_that_misses_the_end_says_so() -> None:
    assert swinging(5.0).diagnostics == ()
    (found,) = swinging(3.0).diagnostics
    assert found.code == "N327"
    assert (found.data["last"], found.data["end"]) == (9.0, 10.0)
