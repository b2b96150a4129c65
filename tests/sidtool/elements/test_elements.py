"""Every registered element: quadrature, mass, stiffness and order against the exact."""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
import pytest
import scipy.sparse.linalg
from numpy.testing import assert_allclose
from scipy.special import beta

from sidtool.elements import matrix_sums
from sidtool.elements.matrix_sums import MatrixSum
from sidtool.elements.mesh_contact import ElementFinder
from sidtool.elements.solid_elements import elasticity
from sidtool.elements.solid_mesh import mesh_matrices
from sidtool.mesh.mesh import Mesh, check_mesh
from sidtool.mesh.reference_elements import (
    ELEMENT_KINDS,
    LINEAR_KINDS,
    element_edges,
    element_faces,
    quadrature_rule,
    reference_element,
    shape_of,
)
from tests.metamorphic.parts.meshes import STEEL, block, dimension, state, turned

#: Kinds with and, where there are any, incompatible modes.
CASES = [(kind, False) for kind in ELEMENT_KINDS] + [("quad4", True), ("hex8", True)]


def monomial(shape: str, e: tuple[int, ...]) -> float:
    """The integral of x^i y^j z^k over the reference element."""
    if shape in ("quad", "hex"):
        return float(np.prod([1 / (k + 1) for k in e]))
    if shape == "wedge":
        return monomial("tri", e[:2]) / (e[2] + 1)
    if shape == "pyramid":
        i, j, k = e
        return float(beta(k + 1, i + j + 3)) / ((i + 1) * (j + 1))
    return float(np.prod([factorial(k) for k in e])) / factorial(sum(e) + len(e))


@pytest.mark.parametrize("integral", ["stiffness", "mass"])
@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_quadrature_is_exact_to_its_degree(kind: str, integral: str) -> None:
    """Rules of scikit-fem 12 summed to half the volume on prisms; of tetrahedra those
    of degree 5 and more are off by percents."""
    element = reference_element(kind, integral)
    shape, d = shape_of(kind), element.dimension
    order = 1 if kind in LINEAR_KINDS else 2
    degree = 2 * order
    assert element.weights.sum() == pytest.approx(monomial(shape, (0,) * d), rel=1e-13)
    for e in product(range(degree + 1), repeat=d):
        if sum(e) <= degree:
            found = element.weights @ np.prod(element.points ** np.array(e), axis=1)
            assert found == pytest.approx(monomial(shape, e), rel=1e-12), e
    assert max(element.excess(point) for point in element.points) < 0


@pytest.mark.parametrize("shape", ["tri", "quad", "tet", "hex", "wedge", "pyramid"])
@pytest.mark.parametrize("degree", [2, 3, 4, 5, 7, 9])
def test_rules_of_every_degree(shape: str, degree: int) -> None:
    points, weights = quadrature_rule(shape, degree)
    for e in product(range(degree + 1), repeat=points.shape[1]):
        if sum(e) <= degree:
            found = weights @ np.prod(points ** np.array(e), axis=1)
            assert found == pytest.approx(monomial(shape, e), rel=1e-11), e


@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_complete_polynomials_are_reproduced(kind: str) -> None:
    element = reference_element(kind)
    order = 1 if kind in LINEAR_KINDS else 2
    points = np.random.default_rng(1).uniform(0.05, 0.3, (9, element.dimension))
    values, gradients = element.at(points)
    assert_allclose(
        element.at(element.nodes)[0], np.eye(len(element.nodes)), atol=1e-13
    )
    for e in product(range(order + 1), repeat=element.dimension):
        if sum(e) > order:
            continue
        at_nodes = np.prod(element.nodes ** np.array(e), axis=1)
        assert_allclose(
            values @ at_nodes, np.prod(points ** np.array(e), axis=1), atol=1e-13
        )
        for axis, power in enumerate(e):
            lower = np.array(e) - np.eye(len(e), dtype=int)[axis]
            slope = power * np.prod(points ** np.maximum(lower, 0), axis=1)
            assert_allclose(gradients[..., axis] @ at_nodes, slope, atol=1e-12)


@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_neighbours_agree_on_their_common_face(kind: str) -> None:
    """On a face or edge only the functions of its nodes are not zero."""
    element = reference_element(kind)
    sides = [*element_faces(kind, 3), *element_faces(kind, 4)] or [
        (a, b) for a, b, _ in element_edges(kind)
    ]
    for side in sides:
        share = np.random.default_rng(3).dirichlet(np.ones(len(side)), 5)
        values, _ = element.at(share @ element.nodes[list(side)])
        own = set(side) | {m for a, b, m in element_edges(kind) if {a, b} <= set(side)}
        others = [i for i in range(len(element.nodes)) if i not in own]
        assert_allclose(values[:, others], 0, atol=1e-12)


def distorted(kind: str, seed: int) -> tuple[Mesh, tuple[float, ...]]:
    size = (1.3, 0.7, 0.45)[: dimension(kind)]
    mesh = block(kind, (3, 2, 2)[: len(size)], size, seed=seed)
    check_mesh(mesh)
    return mesh, size


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_mass_centre_and_inertia_of_a_distorted_block(kind: str, seed: int) -> None:
    """Those of the box, whatever the elements inside look like."""
    mesh, size = distorted(kind, seed)
    mass, _ = mesh_matrices(mesh, {None: STEEL}, state(kind))
    box = STEEL.density * np.prod(size)
    ones, x = np.ones(len(mesh.positions)), mesh.positions
    assert ones @ mass @ ones == pytest.approx(box, rel=1e-12)
    assert_allclose(ones @ mass @ x, box * np.array(size) / 2, rtol=1e-12)
    second = box * (np.outer(size, size) / 4 + np.diag(np.square(size)) / 12)
    assert_allclose(x.T @ mass @ x, second, rtol=1e-12)


@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_points_are_found_in_bent_elements(kind: str) -> None:
    """The block bent to an arc, so that no element is affine."""
    mesh, _ = distorted(kind, 3)
    x, y = mesh.positions[:, 0], 1 + 0.4 * mesh.positions[:, 1]
    bent = np.column_stack([y * np.sin(x), y * np.cos(x), *mesh.positions.T[2:]])
    elements = mesh.blocks[0].nodes
    element = reference_element(kind)
    samples = 0.999 * element.points + 0.001 * element.nodes[: element.corners].mean(0)
    points = np.einsum("gm,emd->egd", element.at(samples)[0], bent[elements])
    points = points.reshape(-1, mesh.dimension)
    finder = ElementFinder(Mesh(bent, mesh.blocks))
    rows = np.arange(len(elements))
    every = finder.holders(points, 0, rows, 1e-9, lambda i, row: np.ones(len(i), bool))
    found = {pair for i, row in every for pair in zip(i, row, strict=True)}
    owners = np.repeat(rows, len(samples))
    assert found == set(enumerate(owners))


@pytest.mark.parametrize(("kind", "relieved"), CASES)
def test_patch_test_on_a_turned_distorted_block(kind: str, relieved: bool) -> None:
    """Held in a linear field at its surface, the inside follows with exact energy."""
    mesh, size = distorted(kind, 4)
    low = (mesh.positions <= 1e-9).any(axis=1)
    surface = low | (mesh.positions >= np.array(size) - 1e-9).any(axis=1)
    mesh = turned(mesh, 2)
    d = mesh.dimension
    _, k = mesh_matrices(mesh, {None: STEEL}, state(kind), incompatible_modes=relieved)
    slope = np.random.default_rng(2).normal(size=(d, d))
    u = (mesh.positions @ slope.T).ravel()
    free = np.flatnonzero(np.repeat(~surface, d))
    held = np.flatnonzero(np.repeat(surface, d))
    assert free.size
    inside = scipy.sparse.linalg.spsolve(
        k[free][:, free].tocsc(), -k[free][:, held] @ u[held]
    )
    assert_allclose(inside, u[free], atol=1e-10 * np.abs(u).max())
    pairs = ((0, 1),) if d == 2 else ((0, 1), (1, 2), (0, 2))
    strain = [slope[i, i] for i in range(d)] + [
        slope[i, j] + slope[j, i] for i, j in pairs
    ]
    energy = np.prod(size) * np.array(strain) @ elasticity(STEEL, state(kind)) @ strain
    assert u @ k @ u == pytest.approx(energy, rel=1e-11)
    values = np.linalg.eigvalsh(k.toarray())
    rigid = d * (d + 1) // 2
    assert np.abs(values[:rigid]).max() < 1e-11 * values[-1] < 1e-6 * values[rigid]


def gradient_of_harmonic(x: np.ndarray) -> np.ndarray:
    """A displacement without divergence and rotation: in equilibrium everywhere."""
    if x.shape[1] == 2:
        wave = np.exp(x[:, 0])
        return np.column_stack([wave * np.sin(x[:, 1]), wave * np.cos(x[:, 1])])
    wave = np.exp(np.sqrt(2) * x[:, 0])
    y, z = x[:, 1], x[:, 2] + 0.4
    parts = [np.sqrt(2) * np.sin(y) * np.cos(z), np.cos(y) * np.cos(z)]
    return wave[:, None] * np.column_stack([*parts, -np.sin(y) * np.sin(z)])


@pytest.mark.parametrize(("kind", "relieved"), CASES)
def test_order_of_convergence_on_distorted_blocks(kind: str, relieved: bool) -> None:
    """The displacement inside converges with one order more than the elements."""
    d, order = dimension(kind), 1 if kind in LINEAR_KINDS else 2
    errors = []
    counts = {(2, 1): (8, 16), (3, 1): (6, 9), (2, 2): (4, 8), (3, 2): (2, 4)}[d, order]
    for n in counts:
        mesh = block(kind, (n,) * d, (1.0,) * d)
        x = mesh.positions
        surface = ((x < 1e-9) | (x > 1 - 1e-9)).any(axis=1)
        wave = np.prod(np.sin(np.pi * x), axis=1)
        x = x + 0.04 * np.column_stack([wave, -wave, wave][:d])
        mesh = Mesh(x, mesh.blocks)
        mass, k = mesh_matrices(
            mesh, {None: STEEL}, state(kind), incompatible_modes=relieved
        )
        exact = gradient_of_harmonic(x)
        free = np.flatnonzero(np.repeat(~surface, d))
        held = np.flatnonzero(np.repeat(surface, d))
        u = exact.ravel().copy()
        u[free] = scipy.sparse.linalg.spsolve(
            k[free][:, free].tocsc(), -k[free][:, held] @ u[held]
        )
        miss = u.reshape(-1, d) - exact
        errors.append(np.sqrt(np.einsum("ia,ia->", miss, mass @ miss)))
    rate = np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0])
    assert rate > order + 0.7, errors


@pytest.mark.parametrize("entries", [50, 10_000])
def test_sums_of_element_matrices(
    entries: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All at once and in many parts, with a node twice in one element, and none in a
    group."""
    monkeypatch.setattr(matrix_sums, "_ENTRIES_PER_BATCH", entries)
    monkeypatch.setattr(matrix_sums, "_BLOCKS_AT_A_TIME", entries // 10)
    random, count = np.random.default_rng(2), 9
    sums, dense = MatrixSum(count, 1, 2), [np.zeros((9, 9)), np.zeros((18, 18))]
    for number in (5, 0, 7, 4):
        nodes = random.integers(0, count - 1, (number, 3))
        groups = []
        for total, d in zip(dense, (1, 2), strict=True):
            half = random.normal(size=(number, 3 * d, 3 * d))
            groups.append(half + np.swapaxes(half, 1, 2))
            dofs = (nodes[..., None] * d + np.arange(d)).reshape(number, 3 * d)
            np.add.at(total, (dofs[:, :, None], dofs[:, None]), groups[-1])
        sums.add(nodes, *groups)
    for found, expected in zip(sums.total(), dense, strict=True):
        assert_allclose(found.toarray(), expected, rtol=1e-14, atol=1e-13)
        assert found.has_canonical_format
