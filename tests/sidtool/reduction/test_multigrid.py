"""Multigrid gives the responses, modes and SIDs of factors, of bodies that are hard."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sidtool.eigensolvers import factorisation, multigrid
from sidtool.eigensolvers.lanczos import ACCURATE, Pencil
from sidtool.eigensolvers.multigrid import MultigridFactors, NodalUnknowns
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model

from ..bodies import beam, volume_data

pytestmark = pytest.mark.needs("pyamg")


@pytest.fixture(autouse=True)
def many_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small bodies, too, get several levels."""
    monkeypatch.setattr(multigrid, "_COARSEST", 20)
    monkeypatch.setattr(factorisation, "_WORTH_LEVELS", 300)


def block(kind: str, elements: list[int], length: float = 4.0, nu: float = 0.3) -> Any:
    """A square bar of width 1, clamped at its left end, as plain data."""
    data = copy.deepcopy(volume_data({"type": kind, "elements": elements}, modes=6))
    corners = [
        [[[x, y, -0.5], [x, y, 0.5]] for y in (-0.5, 0.5)] for x in (0.0, length)
    ]
    data["geometry"] = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": corners,
    }
    data["material"]["poissons_ratio"] = nu
    return data


def tied(kind: str, elements: list[int]) -> Any:
    """The bar with a rigid piece at either end, of which the left one is the frame."""
    data = block(kind, elements)
    data["frame"] = {"type": "tangent", "marker": "crank_pin"}
    for name, face in (("crank_pin", "left"), ("piston_pin", "right")):
        data["markers"][name]["tie"] = {"type": "rigid", "to": face}
    data["reduction"] = {
        "method": "craig_bampton",
        "modes": 5,
        "interfaces": ["piston_pin"],
    }
    return data


def frequencies(sid: SID) -> NDArray[Any]:
    ratio = np.linalg.solve(sid.Me.m0, sid.Ke.m0)
    return np.sqrt(np.sort(np.abs(np.linalg.eigvals(ratio))))


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(block("hex20", [10, 3, 3]), id="quadratic"),
        pytest.param(tied("tet10", [8, 2, 2]), id="ties"),
        pytest.param(tied("hex8", [12, 3, 3]), id="square"),
        pytest.param(block("hex8", [120, 2, 2], length=80.0), id="slender"),
        pytest.param(block("hex8", [16, 5, 5], nu=0.49), id="incompressible"),
    ],
)
def test_the_sid_is_that_of_factors(data: Any) -> None:
    model = validate_data(data, ModelFile)
    expected = sid_from_model(model, engine="superlu")
    heard: list[str] = []
    found = sid_from_model(model, heard.append, engine="multigrid")
    assert any("by multigrid" in text for text in heard)
    assert_allclose(frequencies(found), frequencies(expected), rtol=1e-7)
    for ours, theirs in zip(found.nodes, expected.nodes, strict=True):
        # of modes of one frequency the axes, of others the sign may differ
        sizes = [np.abs(x.phi.m0 @ x.phi.m0.T) for x in (ours, theirs)]
        assert_allclose(sizes[0], sizes[1], atol=1e-6 * sizes[1].max() + 1e-20)


def bar_with_supports() -> tuple[FiniteElementModel, NDArray[np.int64]]:
    """The bar and its free displacements: the lower side slides along x, the left end
    along y.
    """
    body = finite_element_model(validate_data(block("hex8", [12, 4, 4]), ModelFile))
    x, y, _ = body.positions.T
    left, low = np.flatnonzero(x == 0.0), np.flatnonzero(y < -0.49)
    held = np.concatenate([3 * left, 3 * left + 2, 3 * low + 1, 3 * low + 2])
    return body, np.setdiff1d(np.arange(body.ndof), held)


def levels_of(
    body: FiniteElementModel, free: NDArray[np.int64]
) -> tuple[MultigridFactors, Pencil]:
    stiffness, mass = (
        sp.csr_matrix(x[free][:, free]) for x in (body.stiffness, body.mass)
    )
    unknowns = NodalUnknowns(
        free // 3, free % 3, body.rigid_body_modes()[free], np.zeros((3, 0), np.int64)
    )
    none = np.zeros((free.size, 0))
    pencil = Pencil(stiffness, mass, 0.0, none.T, none)
    return MultigridFactors(stiffness, unknowns), pencil


def test_nodes_that_are_held_in_part_and_the_same_bits_again() -> None:
    body, free = bar_with_supports()
    loads = np.random.default_rng(0).standard_normal((free.size, 3))
    factors, pencil = levels_of(body, free)
    answers = factors.solve(loads)
    expected = sp.linalg.spsolve(sp.csc_matrix(pencil.stiffness), loads)
    assert_allclose(answers, expected, atol=1e-8 * np.abs(expected).max())
    again, _ = levels_of(body, free)
    assert (again.solve(loads) == answers).all()


def test_modes_under_conditions() -> None:
    """Also conditions that lie far from the directions of the unknowns."""
    body, free = bar_with_supports()
    factors, pencil = levels_of(body, free)
    rows = np.random.default_rng(1).standard_normal((2, free.size))
    vectors = multigrid.multigrid_eigenvectors(
        Pencil(pencil.stiffness, pencil.mass, 0.0, rows, pencil.rigid),
        3,
        factors,
        factors.solve(rows.T),
        ACCURATE,
    )
    assert_allclose(rows @ vectors, 0.0, atol=1e-9 * np.abs(vectors).max())
    # with multipliers l, K v - w^2 M v + C^T l = 0
    forces, momenta = pencil.stiffness @ vectors, pencil.mass @ vectors
    values = np.einsum("ij,ij->j", vectors, forces)
    values /= np.einsum("ij,ij->j", vectors, momenta)
    rest = forces - momenta * values
    rest -= rows.T @ np.linalg.lstsq(rows.T, rest, rcond=None)[0]
    assert_allclose(rest, 0.0, atol=1e-6 * np.abs(forces).max())
    # below the third lies no other: the inertia of the bordered matrix
    between = values[2] * (1 + 1e-6)
    scaled = rows * pencil.stiffness.diagonal().mean()
    shifted = sp.bmat(
        [[pencil.stiffness - between * pencil.mass, scaled.T], [scaled, None]]
    )
    signs = np.linalg.eigvalsh(shifted.toarray())
    assert (signs < 0).sum() == 3 + len(rows)


def test_cycles_do_not_grow_with_the_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = list[int]()
    cycle = multigrid.Levels.precondition

    def counted(levels: multigrid.Levels, load: NDArray[Any]) -> NDArray[Any]:
        counts[-1] += 1
        return cycle(levels, load)

    monkeypatch.setattr(multigrid.Levels, "precondition", counted)
    for side in (4, 8):
        data = block("hex8", [4 * side, side, side])
        body = finite_element_model(validate_data(data, ModelFile))
        free = np.flatnonzero(np.repeat(body.positions[:, 0] > 0.0, 3))
        counts.append(0)
        levels_of(body, free)[0].solve(body.mass[free].toarray()[:, free[:2]])
    # conjugate gradients without levels take twice as many on the finer mesh
    assert counts[0] <= 20
    assert counts[1] <= 1.3 * counts[0]


def test_beams_are_refused() -> None:
    with pytest.raises(InputError, match="solids") as refused:
        sid_from_model(beam({"type": "beam", "elements": 100}), engine="multigrid")
    assert refused.value.place == "--engine"
