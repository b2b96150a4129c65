"""Inertia of elements with incompatible modes: sums over points of their field."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, null_space

from sidtool.conversion.inertia_integrals import body_inertia
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.solid_elements import elasticity
from sidtool.elements.solid_mesh import SolidMesh, mesh_matrices
from sidtool.mesh.mesh import ElementBlock, Mesh
from sidtool.mesh.reference_elements import reference_element
from tests.metamorphic.parts.meshes import STEEL

from ..elements.drawn_parts import _box
from .test_gram import assert_defined, definitions

NQ = 3


def shaken(d: int, seed: int) -> Mesh:
    """A row of three cells whose corners are moved by up to 0.15 of a cell."""
    points, cells = _box((3, 1, 1))
    points = points * [3, 1, 1]
    if d == 2:
        flat = points[:, 2] == 0
        number = np.cumsum(flat) - 1
        points, cells = points[flat, :2], number[cells[:, :4]]
    moved = points + np.random.default_rng(seed).uniform(-0.15, 0.15, points.shape)
    kind = "quad4" if d == 2 else "hex8"
    return Mesh(moved, (ElementBlock(kind, cells, np.arange(1, 4)),))


def strains(gradients: np.ndarray) -> np.ndarray:
    """(3 or 6, functions x d) of a unit of every function along every axis."""
    d = gradients.shape[1]
    pairs = [(i, i) for i in range(d)]
    pairs += [(0, 1)] if d == 2 else [(0, 1), (1, 2), (0, 2)]
    rows = np.zeros((len(pairs), len(gradients), d))
    for row, (i, j) in enumerate(pairs):
        rows[row, :, i] += gradients[:, j]
        if i != j:
            rows[row, :, j] += gradients[:, i]
    return rows.reshape(len(pairs), -1)


def inner_slopes(x: np.ndarray) -> np.ndarray:
    """(d d, d) of the internal modes by the reference coordinates."""
    d = len(x)
    line, rows = 1 - 2 * x, list(np.diag(1 - 2 * x))
    for i, j in permutations(range(d), 2):
        rows.append(np.zeros(d))
        rows[-1][i], rows[-1][j] = line[i] * line[j], -2 * x[i] * (1 - x[i])
    return np.array(rows)


def across(jacobian: np.ndarray) -> np.ndarray:
    """(d^3, r) amplitudes: any of the first, of b_i (1 - 2 xi_j) none along axis j."""
    d = len(jacobian)
    planes = [null_space(jacobian[:, [j]].T) for _, j in permutations(range(d), 2)]
    return block_diag(np.eye(d * d), *planes)


def amplitudes(corners: np.ndarray, u: np.ndarray, law: np.ndarray) -> np.ndarray:
    """(d, d, nq) of the modes that move, which the least energy of strain decides."""
    d = corners.shape[1]
    element = reference_element("quad4" if d == 2 else "hex8")
    gauss = np.array(list(product([0.5 - 12**-0.5, 0.5 + 12**-0.5], repeat=d)))
    _, slopes = element.at(gauss)
    _, centre = element.at(np.full((1, d), 0.5))
    jacobians = [corners.T @ s for s in slopes]
    weights = np.array([np.linalg.det(j) for j in jacobians])
    inner = [
        inner_slopes(x) @ np.linalg.inv(j)
        for x, j in zip(gauss, jacobians, strict=True)
    ]
    mean = sum(w * g for w, g in zip(weights, inner, strict=True)) / weights.sum()
    may = across(corners.T @ centre[0])
    energy, load = np.zeros([may.shape[1]] * 2), np.zeros((may.shape[1], u.shape[1]))
    for w, s, j, g in zip(weights, slopes, jacobians, inner, strict=True):
        own, outer = strains(g - mean) @ may, strains(s @ np.linalg.inv(j))
        energy += w * own.T @ law @ own
        load -= w * own.T @ law @ outer @ u
    return np.linalg.solve(energy, load)[: d * d].reshape(d, d, -1)


@pytest.mark.parametrize(("d", "seed"), [(2, 1), (2, 2), (3, 3)])
def test_blocks_are_those_of_the_field_inside(d: int, seed: int) -> None:
    """They were those of the nodal functions: Me of these shapes 5 to 33 % off."""
    mesh, state = shaken(d, seed), "plane_stress" if d == 2 else "solid"
    solids = SolidMesh(mesh, {None: STEEL}, state, incompatible_modes=True)
    mass, k = mesh_matrices(mesh, {None: STEEL}, state, incompatible_modes=True)
    body = FiniteElementModel(
        mesh.positions, mass, k, {}, (), internal_inertia=solids.internal_inertia()
    )
    shapes = np.random.default_rng(seed).normal(size=(body.ndof, NQ))
    origin = np.array([0.3, -0.2, 0.1 * (d == 3)])

    law = elasticity(STEEL, state)
    x, g = np.polynomial.legendre.leggauss(3)  # of hexahedra, squares need one more
    weights, points, fields = [], [], []
    (block,) = mesh.blocks
    for nodes in block.nodes:
        corners, u = mesh.positions[nodes], shapes.reshape(-1, d, NQ)[nodes]
        a = amplitudes(corners, u.reshape(-1, NQ), law)
        for where in product(range(3), repeat=d):
            at = (x[list(where)] + 1) / 2
            values, slopes = reference_element(block.kind).at(at[None])
            jacobian = np.linalg.det(corners.T @ slopes[0])
            weights.append(STEEL.density * np.prod(g[list(where)] / 2) * jacobian)
            points.append(values[0] @ corners - origin[:d])
            inside = np.einsum("k,kal->la", at * (1 - at), a)
            fields.append(np.einsum("n,nal->la", values[0], u) + inside)
    c = np.pad(np.array(points), ((0, 0), (0, 3 - d)))
    phi = np.pad(np.array(fields), ((0, 0), (0, 0), (0, 3 - d)))
    found, blocks = body_inertia(body, origin, shapes)
    assert found == pytest.approx(np.sum(weights), rel=1e-13)
    assert_defined(blocks, definitions(np.array(weights), c, phi), NQ)
    whole = shapes.T @ (body.mass @ shapes)
    assert_allclose(whole, blocks["Me"].m0, rtol=1e-11)
