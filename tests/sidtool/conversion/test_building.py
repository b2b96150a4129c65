"""SIDs that a Python program makes from its own matrices, shape functions or blocks."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.sid import SID
from tests.bodies import particle_body
from tests.places import ROOT

from ..networks import clamped, mean_axis, random_network, sid_of

PAGE = ROOT / "docs" / "python.md"


def assert_same(found: SID, expected: SID, *without: str) -> None:
    """All blocks and nodes; `without` those first-order terms that need more."""
    assert found.mass == pytest.approx(expected.mass)
    for name, block in expected.blocks.items():
        parts = (block.m0, block.first_order(expected.nq))
        created = getattr(found, name)
        size = max(np.abs(parts[0]).max(), 1e-6)
        assert_allclose(created.m0, parts[0], atol=1e-9 * size, err_msg=name)
        if name not in without:
            first = created.first_order(expected.nq)
            size = max(np.abs(parts[1]).max(), 1e-6)
            assert_allclose(first, parts[1], atol=1e-9 * size, err_msg=name)
    for node in found.nodes:
        twin = expected.node(node.id)
        for name in ("origin", "phi", "psi", "AP"):
            one, other = getattr(node, name), getattr(twin, name)
            assert_allclose(one.m0, other.m0, atol=1e-10)
            assert_allclose(
                one.first_order(found.nq), other.first_order(found.nq), atol=1e-9
            )


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("basis", [mean_axis, clamped])
def test_matrices_and_shape_functions(basis: Any, sparse: bool) -> None:
    """Against the sums over the masses of a network, its rows in any order."""
    network, origin = random_network(9, 3), np.array([0.2, -0.4, 0.1])
    shapes, order = basis(network)[:, :7], np.random.default_rng(1).permutation(27)
    dofs = np.stack([order // 3, order % 3 + 1], axis=1)
    matrices = [
        m[np.ix_(order, order)] for m in (network.mass_matrix, network.stiffness)
    ]
    created = sidtool.sid_from_shapes(
        *(sp.coo_array(m) if sparse else m for m in matrices),
        network.points,
        shapes[order],
        {k + 1: k for k in range(9)},
        dofs=dofs,
        origin=origin,
        damping=(0.0, 1e-4),
    )
    assert_same(created, sid_of(network, lambda _: shapes, origin))
    regular = sidtool.sid_from_shapes(
        network.mass_matrix, network.stiffness, network.points, shapes, {4: 0}
    )
    assert_allclose(
        regular.Me.m0, created.Me.m0, atol=1e-9 * np.abs(created.Me.m0).max()
    )
    assert [node.id for node in regular.nodes] == ["4"]


def test_deformations_relative_to_mean_axes() -> None:
    """Clamped shape functions and a change of the frame against the free modes."""
    network = random_network(6, 5)
    created = sidtool.sid_from_shapes(
        network.mass_matrix,
        network.stiffness,
        network.points,
        clamped(network),
        {k + 1: k for k in range(6)},
        frame="buckens",
    )
    squares, _ = network.modes()
    found = np.linalg.eigvals(np.linalg.solve(created.Me.m0, created.Ke.m0))
    assert_allclose(np.sort(found.real), squares, rtol=1e-8)
    assert np.abs(created.Ct.m0).max() < 1e-9


@pytest.mark.parametrize("planar", [True, False])
def test_omitted_blocks_follow_from_the_others(planar: bool) -> None:
    expected = particle_body(4, 12, planar, seed=8)
    nodes = {
        node.id: {"position": node.position, "phi": node.phi.m0, "psi": node.psi.m0}
        for node in expected.nodes
    }
    blocks = {
        name: (block.m0, block.first_order(4))
        for name, block in expected.blocks.items()
        if name in ("J", "Ct", "Cr", "Oe", "Me", "Ke")
    }
    blocks |= {"mdCM": expected.mdCM.m0[:, 0], "De": expected.De}
    created = sidtool.sid_from_blocks(expected.mass, nodes, **blocks)
    assert_same(created, expected)
    assert_same(
        sidtool.sid_from_blocks(
            expected.mass, nodes, **{n: b for n, b in blocks.items() if n != "Oe"}
        ),
        expected,
        "Oe",
    )


def line() -> dict[str, Any]:
    """Three masses and two springs, in the plane."""
    stiffness = np.zeros((6, 6))
    stiffness[::2, ::2] = [[5.0, -5.0, 0.0], [-5.0, 10.0, -5.0], [0.0, -5.0, 5.0]]
    bend = np.array([1.0, -2.0, 1.0])
    stiffness[1::2, 1::2] = 3.0 * np.outer(bend, bend)
    return {
        "mass": np.eye(6),
        "stiffness": stiffness,
        "positions": [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]],
        "shapes": np.array([[0.0, 1.0, 0.0, -2.0, 0.0, 1.0]]).T,
        "nodes": {1: 0},
    }


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "rigid": ({"shapes": np.ones((6, 1))}, "shapes: contain a motion without strain"),
    "twice": ({"shapes": np.eye(6)[:, [0, 0]]}, "shapes: are not independent"),
    "nothing": ({"shapes": np.full((6, 1), np.nan)}, "shapes: .* not finite"),
    "short": ({"shapes": np.ones((5, 1))}, "dofs: 5 rows do not belong to 3 nodes"),
    "flat": ({"shapes": np.ones(6)}, r"shapes: has shape \(6,\)"),
    "supported": ({"stiffness": np.eye(6)}, "stiffness"),
    "oblong": ({"mass": np.eye(8)}, "mass: is 8 x 8"),
    "lopsided": ({"mass": np.eye(6) + np.eye(6, k=1) - np.eye(6, k=-1)}, "symmetric"),
    "weightless": ({"mass": np.diag([1.0, 1, 0, 0, 1, 1])}, "no mass"),
    "no node": ({"nodes": {1: 3}}, "nodes: has node 1 in row 3"),
    "from zero": ({"nodes": {0: 0}}, "nodes: has node 0"),
    "nowhere": ({"dofs": [[k, 1] for k in range(6)]}, "dofs: row 4"),
}


@pytest.mark.parametrize("case", WRONG)
def test_impossible_bodies_are_refused(case: str) -> None:
    changes, message = WRONG[case]
    with pytest.raises(sidtool.InputError, match=message):
        sidtool.sid_from_shapes(**line() | changes)


def test_blocks_that_cannot_be_those_of_a_body_are_refused() -> None:
    body = particle_body(2, 9, seed=2)
    nodes: dict[str, Any] = {"a": {"position": [0, 0, 0], "phi": np.zeros((3, 2))}}
    blocks: dict[str, Any] = {
        name: getattr(body, name) for name in ("mdCM", "J", "Ct", "Cr", "Me", "Ke")
    }
    for changes, message in (
        ({"Mu": np.eye(2)}, "blocks: Mu is no block"),
        ({"Ct": np.zeros((3, 2))}, r"block Ct: has shape \(3, 2\)"),
        ({"Me": -np.eye(2)}, "I[0-9]+ fails"),
        ({"J": np.full((6, 1), np.inf)}, "block J: .* not finite"),
    ):
        with pytest.raises(sidtool.InputError, match=message):
            sidtool.sid_from_blocks(body.mass, nodes, **blocks | changes)
    with pytest.raises(sidtool.InputError, match="Ke is missing"):
        del blocks["Ke"]
        sidtool.sid_from_blocks(body.mass, nodes, **blocks)
    nodes["a"]["psi"] = np.zeros((2, 3))
    with pytest.raises(sidtool.InputError, match="node a: psi has shape"):
        sidtool.sid_from_blocks(body.mass, nodes, **blocks | {"Ke": body.Ke})


def test_the_beam_of_the_page_vibrates_as_a_free_beam() -> None:
    """f1 = 4.73004^2 / (2 pi) sqrt(EI / mu) / L^2; it is good as a file, too."""
    blocks = re.findall(
        r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    (code,) = (block for block in blocks if "sid_from_shapes" in block)
    names: dict[str, Any] = {}
    exec(code[: code.index("sidtool.write")], names)
    sid = names["sid"]
    found = np.sqrt(np.diag(sid.Ke.m0) / np.diag(sid.Me.m0))[0]
    exact = 4.730041**2 * np.sqrt(names["bending"] / names["line_mass"])
    assert found == pytest.approx(exact / names["length"] ** 2, rel=1e-2)
    assert not any(c.failed for c in sidtool.validate(sid))
