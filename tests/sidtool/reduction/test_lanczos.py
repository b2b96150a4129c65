"""Eigenvectors by block Lanczos, and the order in which factors stay small."""

from __future__ import annotations

import tracemalloc
from itertools import combinations

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay

from sidtool.eigensolvers.eigenpairs import lowest_eigenpairs
from sidtool.eigensolvers.factorisation import nested_dissection, symmetric_factors
from sidtool.eigensolvers.lanczos import BLOCK_SIZE, Accuracy, dominant_vectors


def grid(*sizes: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """Laplacian of a regular grid with two unknowns to a point, and their places."""
    total = sp.csr_matrix((1, 1))
    for n in sizes:
        line = sp.diags_array(
            [-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]
        )
        total = sp.kron(total, sp.eye_array(n)) + sp.kron(
            sp.eye_array(total.shape[0]), line
        )
    axes = np.meshgrid(*(np.linspace(0, n / sizes[0], n) for n in sizes), indexing="ij")
    places = np.column_stack([axis.ravel() for axis in axes])
    pair = np.array([[2.0, 1.0], [1.0, 2.0]])
    return sp.csr_matrix(sp.kron(total, pair)), np.repeat(places, 2, axis=0)


def exact(*sizes: int) -> np.ndarray:
    """Eigenvalues of `grid`, rising."""
    lines = [2 - 2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) for n in sizes]
    total = np.zeros(1)
    for line in lines:
        total = (total[:, None] + line).ravel()
    return np.sort(np.concatenate([total, 3 * total]))


@pytest.mark.parametrize("value_error", [0.0, 1e-10, 1e-3])
@pytest.mark.parametrize("sizes", [(30, 30), (12, 12, 12)])
def test_equal_eigenvalues_are_all_found(
    sizes: tuple[int, ...], value_error: float
) -> None:
    """A square has pairs of equal eigenvalues, a cube triples."""
    matrix, places = grid(*sizes)
    mass = sp.csr_matrix(sp.eye_array(matrix.shape[0]))
    values, vectors = lowest_eigenpairs(
        matrix, mass, 11, places=places, accuracy=Accuracy(value_error=value_error)
    )
    assert_allclose(values, exact(*sizes)[:11], rtol=value_error or 1e-12)
    assert_allclose(vectors.T @ vectors, np.eye(11), atol=1e-12)


def test_one_pair_more_needs_no_accuracy() -> None:
    """Of a cube, the 9th value differs from the 8th, and the 10th equals the 9th."""
    matrix, places = grid(12, 12, 12)
    mass = sp.csr_matrix(sp.eye_array(matrix.shape[0]))
    errors = []
    for count in (9, 10):
        values, vectors = lowest_eigenpairs(
            matrix, mass, count, places=places, accuracy=Accuracy(next_is_distinct=True)
        )
        rest = np.linalg.norm(matrix @ vectors - vectors * values, axis=0) / values
        assert_allclose(rest[:-1], 0, atol=1e-11)
        errors.append(rest[-1])
    assert errors[0] > 1e-11 > errors[1]


def test_an_exhausted_space_is_left() -> None:
    """Of an operator with two values the Krylov space of a block ends at once."""
    scale = np.repeat([3.0, 1.0], [7, 393])
    mass = sp.csr_matrix(sp.diags_array(np.linspace(1, 2, 400)))

    def operator(momenta: np.ndarray) -> np.ndarray:
        return (scale / mass.diagonal())[:, None] * momenta

    vectors = dominant_vectors(operator, mass, 7, np.zeros((400, 0)))
    assert_allclose(vectors.T @ (mass @ vectors), np.eye(7), atol=1e-12)
    assert_allclose(vectors[7:], 0, atol=1e-10)


def test_memory_is_that_of_the_vectors() -> None:
    """M times all of them took as much again."""
    n, count = 10_000, 10
    values = np.arange(1.0, n + 1.0)[:, None] ** 2
    mass = sp.csr_matrix(sp.eye_array(n))
    tracemalloc.start()
    try:
        dominant_vectors(lambda x: x / values, mass, count, np.zeros((n, 0)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.8 * (4 * count + 12 * BLOCK_SIZE) * values.nbytes


def test_an_operator_that_is_not_positive_is_refused() -> None:
    """A mechanism: the factors of its singular stiffness have any sign."""
    scale = np.append(-1e14, 1 / np.linspace(1, 40, 399))[:, None]
    mass = sp.csr_matrix(sp.eye_array(400))
    with pytest.raises(RuntimeError, match="does not resist every deformation"):
        dominant_vectors(lambda x: scale * x, mass, 5, np.zeros((400, 0)))


def test_known_rigid_motions_are_kept() -> None:
    values = np.concatenate([np.zeros(6), np.linspace(1, 40, 394)])
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(400, 400)))
    stiffness = sp.csr_matrix(turn * values @ turn.T)
    mass = sp.csr_matrix(sp.eye_array(400))
    found, _ = lowest_eigenpairs(
        stiffness, mass, 9, shift=-1.0, rigid=turn[:, :6] @ np.diag(np.arange(1, 7))
    )
    assert_allclose(found, values[:9], atol=1e-9)


def test_nested_dissection_orders_everything_once() -> None:
    matrix, places = grid(17, 9)
    order = nested_dissection(matrix, places)
    assert sorted(order) == list(range(len(places)))
    same = np.zeros_like(places)
    assert sorted(nested_dissection(matrix, same)) == list(range(len(places)))


def box(*sizes: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """The neighbourhoods of quadrilaterals or hexahedra: (3^d - 1) around a point."""
    matrix, places = grid(*sizes)
    near = sp.csr_matrix(np.ones((1, 1)))
    for n in sizes:
        line = sp.diags_array(np.ones((3, n)), offsets=[-1, 0, 1], shape=(n, n))
        near = sp.kron(near, line)
    near = sp.kron(near, np.ones((2, 2)))
    return sp.csr_matrix(near + 60 * sp.eye_array(near.shape[0])), places


def entries(matrix: sp.csr_matrix, order: str) -> int:
    factors = splu(
        sp.csc_matrix(matrix),
        permc_spec=order,
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return int(factors.nnz)


@pytest.mark.parametrize(("sizes", "gain"), [((80, 80), 0.95), ((40, 10, 10), 1.2)])
def test_nested_dissection_keeps_factors_small(
    sizes: tuple[int, ...], gain: float
) -> None:
    """Beside minimum degree: like it in the plane, better the larger, and in space."""
    matrix, places = box(*sizes)
    order = nested_dissection(matrix, places)
    found = entries(matrix[order][:, order], "NATURAL")
    assert found * gain < entries(matrix, "MMD_AT_PLUS_A")
    last = order[-2 * int(np.prod(sizes[1:])) :]
    assert np.ptp(places[last, 0]) == 0


def scattered(count: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """The edges of tetrahedra between random points of a cube."""
    places = np.random.default_rng(1).uniform(size=(count, 3))
    corners = Delaunay(places).simplices
    i, j = corners[:, list(combinations(range(4), 2))].reshape(-1, 2).T
    edges = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(count, count))
    near = sp.csr_matrix((edges + edges.T > 0).astype(float))
    return sp.csr_matrix(near + sp.diags_array(near @ np.ones(count) + 1.0)), places


def test_separators_are_small_on_unstructured_meshes() -> None:
    """All points on one side of a cut gave 1.12 times the entries of minimum degree;
    the fewest points that touch all connections give 0.86 times."""
    matrix, places = scattered(4000)
    order = nested_dissection(matrix, places)
    found = entries(matrix[order][:, order], "NATURAL")
    assert found < entries(matrix, "MMD_AT_PLUS_A")


def test_any_order_gives_the_same_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIDTOOL_FACTORS", "superlu")
    matrix, places = grid(25, 20)
    load = np.random.default_rng(0).normal(size=(len(places), 3))
    first = symmetric_factors(matrix).solve(load)
    second = symmetric_factors(matrix, places).solve(load)
    assert_allclose(second, first, rtol=1e-10, atol=1e-12)
    one = symmetric_factors(matrix, places).solve(load[:, 0])
    assert_allclose(one, first[:, 0], rtol=1e-10, atol=1e-12)
