"""Comparison of SIDs: the physics counts, neither the basis nor the frame."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sidtool.comparison.block_differences import Comparison
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor, rigid_sid
from sidtool.formats.sid_files import write_sid
from sidtool.report.sid import describe_sid
from sidtool.validate import change_basis, check, compare, comparison_report
from sidtool.validate.body_modes import free_body, held_body
from tests.bodies import particle_body
from tests.sidtool.networks import clamped, mean_axis, random_network, sid_of

ALL_RIGID = (0, 1, 2, 3, 4, 5)


def _worst(comparison: Comparison) -> float:
    return max(abs(row.deviation) for row in comparison.rows)


# --- the spring network gives the exact solution
# ----------------------------------------


def test_networks_are_consistent_bodies() -> None:
    for basis in (mean_axis, clamped):
        checks = check(sid_of(random_network(5, 1), basis))
        assert not any(c.failed for c in checks)


@pytest.mark.parametrize("basis", [mean_axis, clamped])
def test_free_body_has_the_modes_of_the_network(basis: object) -> None:
    network = random_network(5, 2)
    sid = sid_of(network, basis)
    body = free_body(sid, sid.nodes, ALL_RIGID)
    squares, modes = network.modes()
    assert body.squares == pytest.approx(squares, rel=1e-9)
    assert np.abs(body.shapes) == pytest.approx(np.abs(modes), abs=1e-8)


@pytest.mark.parametrize("basis", [mean_axis, clamped])
def test_inertia_relief(basis: object) -> None:
    """Static deflection of the network under a load that its inertia balances."""
    network = random_network(4, 3)
    sid = sid_of(network, basis)
    M, R = network.mass_matrix, network.rigid
    carried = np.linalg.solve(R.T @ M @ R, R.T)
    relief = np.eye(len(M)) - M @ R @ carried
    expected = relief.T @ np.linalg.pinv(network.stiffness) @ relief
    found = free_body(sid, sid.nodes, ALL_RIGID).flexibility()
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("basis", [mean_axis, clamped])
@pytest.mark.parametrize("omega", [3.0, 90.0, 400.0])
def test_receptance(basis: object, omega: float) -> None:
    network = random_network(4, 4)
    sid = sid_of(network, basis)
    dynamic = network.stiffness + 1j * omega * network.damping
    expected = np.linalg.inv(dynamic - omega**2 * network.mass_matrix)
    found = free_body(sid, sid.nodes, ALL_RIGID).receptance(omega)
    assert np.abs(found - expected).max() <= 1e-8 * np.abs(expected).max()


def test_deflection_of_the_held_network() -> None:
    network = random_network(4, 5)
    sid = sid_of(network, clamped)
    free = np.ones(12, bool)
    free[[0, 1, 2, 4, 5, 8]] = False
    expected = np.zeros((12, 12))
    expected[np.ix_(free, free)] = np.linalg.inv(network.stiffness[np.ix_(free, free)])
    found = held_body(sid, sid.nodes).flexibility()
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


# --- what must not matter -------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), planar=st.booleans())
def test_sign_order_scale_and_mixture_do_not_matter(seed: int, planar: bool) -> None:
    rng = np.random.default_rng(seed)
    body = particle_body(4, 12, planar, seed=seed, nodes=4)
    signs = rng.choice([-1.0, 1.0], 4) * 10.0 ** rng.uniform(-3, 3, 4)
    rotation = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    for T in (np.diag(signs)[:, rng.permutation(4)], rotation * signs):
        comparison = compare(change_basis(body, T), body, tolerance=1e-7)
        assert comparison.passed and not comparison.notes
        assert {row.verdict for row in comparison.rows} == {"passed"}


def test_the_frame_does_not_matter_to_the_free_body() -> None:
    network = random_network(5, 6)
    floating = sid_of(network, mean_axis)
    attached = sid_of(network, clamped, origin=network.points[0])
    comparison = compare(attached, floating, tolerance=1e-7)
    assert comparison.passed
    assert any("different body frames" in note for note in comparison.notes)
    assert any("origins of the two body frames differ" in n for n in comparison.notes)
    assert not comparison.group("frequencies, frame held")
    groups = {row.group.partition(",")[0] for row in comparison.rows}
    assert groups == {
        "mass properties",
        "frequencies",
        "static deflection",
        "frequency response",
        "shapes (MAC)",
    }


def test_nodes_meet_by_position_when_their_names_differ() -> None:
    body = particle_body(3, 9, nodes=3)
    named = replace(body, nodes=tuple(replace(n, id=f"9{n.id}") for n in body.nodes))
    assert _worst(compare(named, body)) < 1e-10
    assert compare(named, body).group("static deflection")


def test_modes_of_equal_frequency_count_as_one_subspace() -> None:
    body = particle_body(3, 12, seed=8, nodes=4)
    double = replace(body, Ke=Taylor(np.diag([4e4, 4e4, 9e6])))
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    rows = compare(change_basis(double, turn), double).group("shapes (MAC), frame held")
    assert [row.value for row in rows] == pytest.approx([1.0, 1.0, 1.0], abs=1e-9)


# --- what must matter -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("block", "factor", "group", "expected"),
    [
        ("Ke", 1.21, "frequencies, frame held", 0.1),
        ("Ke", 1.21, "static deflection, frame held", 1 - 1 / 1.21),
        ("Me", 1.21, "frequencies, frame held", 1 - 1 / 1.1),
        ("J", 1.1, "mass properties", 0.1),
    ],
)
def test_differences_are_found(
    block: str, factor: float, group: str, expected: float
) -> None:
    body = particle_body(3, 9, nodes=3, seed=9)
    entry = getattr(body, block)
    other = replace(body, **{block: replace(entry, m0=factor * entry.m0)})
    rows = compare(other, body, tolerance=1e-3).group(group)
    assert max(abs(row.deviation) for row in rows) == pytest.approx(expected, rel=0.5)
    assert any(row.verdict == "failed" for row in rows)


def test_damping_shows_in_the_frequency_response_only() -> None:
    body = particle_body(3, 9, nodes=3, seed=9)
    other = replace(body, De=Taylor(5.0 * body.De.m0))
    rows = compare(other, body, tolerance=1e-6).rows
    failed = [row for row in rows if row.verdict == "failed"]
    responses = [row for row in failed if row.group.startswith("frequency response")]
    assert responses
    assert [row.quantity for row in failed if row not in responses] == ["De m0"]


def test_a_missing_mode_shows_in_the_deflection() -> None:
    body = particle_body(4, 12, nodes=3, seed=10)
    short = change_basis(body, np.eye(4)[:, 1:])
    assert not compare(short, body, tolerance=1e-3).passed


# --- cases with less to compare -------------------------------------------------------


def test_a_body_that_cannot_move_freely_is_compared_when_held() -> None:
    body = particle_body(2, 9, nodes=2)
    greedy = replace(body, Ct=Taylor(10.0 * body.Ct.m0))
    comparison = compare(greedy, body)
    assert comparison.group("frequencies, frame held")
    assert not comparison.group("frequencies, free body")
    assert any("cannot move freely" in note for note in comparison.notes)


def test_singular_stiffness_has_no_static_deflection() -> None:
    body = particle_body(2, 9, nodes=2)
    unconstrained = replace(body, Ke=Taylor(np.diag([0.0, 1e4])))
    comparison = compare(unconstrained, unconstrained)
    assert not comparison.group("static deflection")
    assert any("Ke is singular" in note for note in comparison.notes)


def test_rigid_bodies_have_mass_properties_only() -> None:
    body = rigid_sid(2.0, [0.1, 0.0, 0.0], np.eye(3))
    groups = {row.group for row in compare(body, body).rows}
    assert groups == {"mass properties"} and _worst(compare(body, body)) == 0.0
    mixed = compare(body, particle_body(2, 9))
    assert any("is rigid" in note for note in mixed.notes)


def test_no_common_nodes() -> None:
    body = particle_body(2, 9, nodes=2)
    comparison = compare(replace(body, nodes=()), body)
    assert comparison.group("frequencies") and not comparison.group("shapes")
    assert any("no common nodes" in note for note in comparison.notes)


def test_modes_that_one_node_cannot_distinguish_are_matched_by_frequency() -> None:
    body = particle_body(5, 12, nodes=1, planar=True)
    along = np.ones((1, 5)) * [[1.0], [0.5], [0.0]]
    first = replace(body.nodes[0], phi=Taylor(along * np.arange(1.0, 6.0)))
    comparison = compare(replace(body, nodes=(first,)), replace(body, nodes=(first,)))
    names = [row.quantity for row in comparison.group("shapes (MAC), frame held")]
    expected = [f"mode {k} and mode {k} of the reference" for k in range(1, 6)]
    assert names == expected
    assert any("too few common nodes" in note for note in comparison.notes)


def test_markers_choose_the_loads() -> None:
    body = particle_body(2, 9, nodes=5)
    rows = compare(body, body, markers=["2"]).group("static deflection, frame held")
    assert {row.quantity.split(",")[0] for row in rows} == {"node 2"}
    with pytest.raises(InputError, match="no common node 77"):
        compare(body, body, markers=["77"])


# --- tables ---------------------------------------------------------------------------


def _table(folder: Path, text: str) -> Path:
    path = folder / "reference.toml"
    path.write_text(
        'format = "sidtool reference"\nversion = 1\n' + text, encoding="utf-8"
    )
    return path


def _body() -> SID:
    body = particle_body(2, 9, nodes=2, seed=11)
    return replace(body, Ke=Taylor(np.diag((2 * np.pi * np.array([10.0, 30.0])) ** 2)))


def test_rows_with_a_tolerance_are_judged_the_others_shown(tmp_path: Path) -> None:
    table = _table(
        tmp_path,
        '[[frequencies]]\nname = "a"\nhertz = [10.1, 30.0]\ntolerance = 0.02\n'
        '[[frequencies]]\nname = "b"\nhertz = [10.1, 30.0]\ntolerance = 0.002\n'
        '[[frequencies]]\nname = "c"\nhertz = [20.0, 20.0, 90.0]\n',
    )
    comparison = compare(_body(), table)
    verdicts = [row.verdict for row in comparison.rows]
    assert verdicts == ["passed", "passed", "failed", "passed", "shown", "shown"]
    assert comparison.rows[2].deviation == pytest.approx(-0.1 / 10.1)
    assert not comparison.passed
    assert comparison.notes == ("c: the SID has no frequency number 3",)
    assert comparison_report(comparison)[2]["verdict"] == "failed"


def test_free_frequencies_in_a_table(tmp_path: Path) -> None:
    network = random_network(4, 12)
    first = np.sqrt(network.modes()[0][0]) / (2 * np.pi)
    table = _table(
        tmp_path,
        f'[[frequencies]]\nname = "a"\nbody = "free"\nhertz = [{first}]\n'
        "tolerance = 1e-8\n",
    )
    assert compare(sid_of(network, clamped), table).passed


def test_block_values(tmp_path: Path) -> None:
    body = _body()
    values = {
        'block = "mass"': body.mass,
        'block = "J"\nrow = 5': body.J.m0[4, 0],
        'block = "Oe"\nrow = 2\nmode = 1\ncolumn = 6': body.Oe.first_order(2)[0, 1, 5],
        'block = "phi"\nnode = "2"\nrow = 3\ncolumn = 2': body.node(2).phi.m0[2, 1],
    }
    text = "".join(
        f"[[blocks]]\n{key}\nvalue = {value}\ntolerance = 1e-12\n"
        for key, value in values.items()
    )
    comparison = compare(body, _table(tmp_path, text))
    assert comparison.passed and len(comparison.rows) == 4
    assert comparison.rows[2].quantity == "Oe m1(2,1,6)"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('block = "J"\nrow = 7\nvalue = 1.0\n', "at most row 6"),
        ('block = "Me"\ncolumn = 3\nvalue = 1.0\n', "column 2"),
        ('block = "phi"\nnode = "8"\nvalue = 1.0\n', "no node 8"),
        ('block = "sigma"\nnode = "1"\nvalue = 1.0\n', "not in this SID"),
    ],
)
def test_values_that_the_sid_does_not_have(
    tmp_path: Path, text: str, expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        compare(_body(), _table(tmp_path, "[[blocks]]\n" + text))


def test_frequencies_that_the_sid_does_not_have(tmp_path: Path) -> None:
    table = _table(
        tmp_path, '[[frequencies]]\nname = "a"\nbody = "free"\nhertz = [1.0]\n'
    )
    body = _body()
    with pytest.raises(InputError, match="rigid body"):
        compare(rigid_sid(1.0, np.zeros(3), np.eye(3)), table)
    with pytest.raises(InputError, match="cannot move freely"):
        compare(replace(body, Ct=Taylor(10.0 * body.Ct.m0)), table)


def test_the_reference_may_be_a_sid_file(tmp_path: Path) -> None:
    path = tmp_path / "body.SID_FEM"
    write_sid(path, _body())
    assert _worst(compare(_body(), path)) < 1e-9


@pytest.mark.parametrize("what", ["info", "compare"])
def test_the_cost_grows_with_the_nodes(what: str) -> None:
    """Memory of 900 nodes: a matrix over pairs of nodes would be 58 MB."""
    body = particle_body(3, 900, nodes=900)
    tracemalloc.start()
    if what == "info":
        describe_sid(body)
    else:
        compare(body, body)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    stored = 900 * 8 * (3 + 3 * 3 + 3 * 3 + 3 * 3 + 9 + 27)
    assert peak < 10 * stored


# --- every block, and modes that only turn ------------------------------------------

FIRST_ORDER = ["J", "Ct", "Cr", "Oe"]


def _mixed(body: SID, seed: int) -> SID:
    T = np.random.default_rng(seed).normal(size=(body.nq, body.nq))
    return change_basis(body, T, labels=body.labels)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("stiffening", [False, True])
def test_all_blocks_agree_in_any_basis(seed: int, stiffening: bool) -> None:
    body = particle_body(5, 15, seed=seed, stiffening=stiffening)
    found = compare(_mixed(body, seed), body, tolerance=1e-6)
    assert found.passed
    names = {row.quantity for row in found.group("blocks")}
    assert {"J m1", "Cr m1", "Oe m1", "Ge m0", "Gr m0", "Ke m0"} <= names
    assert ({"Ct m1", "phi m1", "psi m1"} <= names) == stiffening


@pytest.mark.parametrize("name", [*FIRST_ORDER, "Ge", "phi"])
def test_opposite_signs_of_a_block_are_detected(name: str) -> None:
    body = particle_body(4, 15, seed=2, stiffening=True)
    if name == "Ge":
        wrong = replace(body, Ge=Taylor(-body.Ge.m0))
    elif name == "phi":
        nodes = [
            replace(n, phi=Taylor(n.phi.m0, -n.phi.first_order(4))) for n in body.nodes
        ]
        wrong = replace(body, nodes=tuple(nodes))
    else:
        block = getattr(body, name)
        flipped: dict[str, Any] = {name: Taylor(block.m0, -block.first_order(4))}
        wrong = replace(body, **flipped)
    found = compare(_mixed(wrong, 1), body, tolerance=1e-6)
    term = f"{name} m0" if name == "Ge" else f"{name} m1"
    missed = {row.quantity for row in found.rows if row.verdict == "failed"}
    assert missed == {term}
    (row,) = (row for row in found.group("blocks") if row.quantity == term)
    assert row.deviation == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("term", ["origin m1", "AP m0", "AP m1", "sigma m1"])
def test_opposite_signs_of_an_entry_of_nodes_are_detected(term: str) -> None:
    """Positions that q moves, orientations and stresses, at one node of ten."""
    body = particle_body(4, 15, nodes=10, seed=6)
    rng = np.random.default_rng(6)
    nodes = [
        replace(node, sigma=Taylor(np.zeros((6, 1)), rng.normal(size=(4, 6, 1))))
        for node in body.nodes
    ]
    body = replace(body, nodes=tuple(nodes))
    name, part = term.split()
    entry = getattr(nodes[7], name)
    flipped: dict[str, Any] = {
        name: replace(entry, **{part: -getattr(entry, part)}),
    }
    nodes[7] = replace(nodes[7], **flipped)
    found = compare(_mixed(replace(body, nodes=tuple(nodes)), 1), body, tolerance=1e-6)
    assert {row.quantity for row in found.rows if row.verdict == "failed"} == {term}


@pytest.mark.parametrize("turning", [True, False])
def test_a_mode_that_moves_no_node_is_itself(turning: bool) -> None:
    """Torsion about the axis through the nodes; also if no node shows it."""
    body = particle_body(3, 15, seed=5)
    keep = np.array([1.0, 1.0, 0.0])
    nodes = [
        replace(
            node,
            origin=Taylor(node.origin.m0, (node.phi.m0 * keep).T[:, :, None]),
            phi=Taylor(node.phi.m0 * keep),
            psi=Taylor(node.psi.m0 * (1.0 if turning else keep)),
        )
        for node in body.nodes
    ]
    changed = replace(body, nodes=tuple(nodes))
    found = compare(changed, changed, tolerance=1e-9)
    assert found.passed
    rows = [row.quantity for row in found.group("shapes (MAC), frame held")]
    assert len(rows) == (3 if turning else 2)
