"""Meshes of several kinds of elements: patch tests, rigid motion, what cannot be."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.mesh_contact import check_conforming
from sidtool.elements.solid_elements import elasticity
from sidtool.elements.solid_mesh import mesh_matrices
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import Material
from sidtool.mesh.mesh import ElementBlock, Mesh, check_mesh
from sidtool.mesh.reference_elements import (
    edge_nodes,
    element_edges,
    element_faces,
    reference_element,
)

STEEL = Material(youngs_modulus=2.1e11, poissons_ratio=0.3, density=7850.0)


def grid(*counts: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a box with distorted inside, and their numbers by grid place."""
    shape = tuple(n + 1 for n in counts)
    axes = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    points = np.column_stack([axis.ravel() for axis in axes])
    inside = ((points > 0) & (points < counts)).all(axis=1)
    random = np.random.default_rng(5)
    points[inside] += random.uniform(-0.15, 0.15, (inside.sum(), len(counts)))
    return points, np.arange(len(points)).reshape(shape)


def cell(numbers: np.ndarray, at: tuple[int, ...]) -> list[int]:
    """The corners of a box, counter-clockwise, layer by layer."""
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    layers = [()] if numbers.ndim == 2 else [(0,), (1,)]
    steps = [(*s, *z) for z in layers for s in square]
    return [int(numbers[tuple(np.add(at, step))]) for step in steps]


def middles(points: np.ndarray, kind: str, rows: list[list[int]], known: dict) -> tuple:
    """Quadratic elements from corners; middle nodes are shared."""
    points = list(points)
    result = []
    for row in rows:
        full = list(row)
        for a, b in edge_nodes(kind):
            key = tuple(sorted((row[a], row[b])))
            if key not in known:
                known[key] = len(points)
                points.append((points[row[a]] + points[row[b]]) / 2)
            full.append(known[key])
        result.append(full)
    return np.array(points), result


def blocks(**rows: list[list[int]]) -> tuple[ElementBlock, ...]:
    first = 1
    result = []
    for kind, nodes in rows.items():
        labels = np.arange(first, first + len(nodes))
        result.append(ElementBlock(kind, np.array(nodes), labels))
        first += len(nodes)
    return tuple(result)


def halves(quad: list[int]) -> list[list[int]]:
    a, b, c, d = quad
    return [[a, b, c], [a, c, d]]


def plane(linear: bool) -> Mesh:
    """Quadrilaterals and triangles like a chessboard."""
    points, numbers = grid(3, 3)
    cells = {at: cell(numbers, at) for at in product(range(3), range(3))}
    quads = [c for at, c in cells.items() if sum(at) % 2 == 0]
    triangles = [t for at, c in cells.items() if sum(at) % 2 for t in halves(c)]
    if linear:
        return Mesh(points, blocks(quad4=quads, tri3=triangles))
    known: dict = {}
    points, quads = middles(points, "quad8", quads, known)
    points, triangles = middles(points, "tri6", triangles, known)
    return Mesh(points, blocks(quad8=quads, tri6=triangles))


def solid() -> Mesh:
    """Columns of hexahedra and of wedges, whose quadrilateral faces meet."""
    points, numbers = grid(2, 2, 2)
    hexahedra, wedges = [], []
    for at in product(range(2), repeat=3):
        corners = cell(numbers, at)
        if (at[0] + at[1]) % 2 == 0:
            hexahedra.append(corners)
            continue
        low, high = halves(corners[:4]), halves(corners[4:])
        wedges += [[*a, *b] for a, b in zip(low, high, strict=True)]
    return Mesh(points, blocks(hex8=hexahedra, wedge6=wedges))


def prism_and_tetrahedra() -> Mesh:
    """A wedge whose triangle carries a tetrahedron."""
    points = np.array(
        [
            [0, 0, 0],
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 0, 1],
            [0, 1, 1],
            [0.3, 0.2, 2],
        ],
        float,
    )
    return Mesh(points, blocks(wedge6=[[0, 1, 2, 3, 4, 5]], tet4=[[3, 4, 5, 6]]))


def hexahedron_pyramid_and_tetrahedra(linear: bool) -> Mesh:
    """A cube under one of tetrahedra; the pyramid between them has its base below."""
    points, numbers = grid(1, 1, 2)
    below, (a, b, c, d, e, f, g, h) = (cell(numbers, (0, 0, k)) for k in (0, 1))
    points = np.vstack([points, [0.45, 0.6, 1.4]])
    top = len(points) - 1
    sides = ([e, h, g, f], [a, e, f, b], [b, f, g, c], [c, g, h, d], [d, h, e, a])
    tetrahedra = [[*t, top] for side in sides for t in halves(side)]
    rows = {"hex": [below], "pyramid": [[a, b, c, d, top]], "tet": tetrahedra}
    kinds = {"hex": "hex8", "pyramid": "pyramid5", "tet": "tet4"}
    if linear:
        return Mesh(points, blocks(**{kinds[k]: v for k, v in rows.items()}))
    kinds = {"hex": "hex20", "pyramid": "pyramid13", "tet": "tet10"}
    known: dict = {}
    full = {}
    for shape, kind in kinds.items():
        points, full[kind] = middles(points, kind, rows[shape], known)
    return Mesh(points, blocks(**full))


#: With their volumes.
MESHES = {
    "quad4 and tri3": (plane(True), 9.0),
    "quad8 and tri6": (plane(False), 9.0),
    "hex8 and wedge6": (solid(), 8.0),
    "wedge6 and tet4": (prism_and_tetrahedra(), 2 / 3),
    "hex8, pyramid5 and tet4": (hexahedron_pyramid_and_tetrahedra(True), 2.0),
    "hex20, pyramid13 and tet10": (hexahedron_pyramid_and_tetrahedra(False), 2.0),
}


@pytest.mark.parametrize("name", MESHES)
def test_patch_test_and_rigid_motion(name: str) -> None:
    """A linear field needs no force inside and has the exact energy."""
    mesh, size = MESHES[name]
    check_mesh(mesh)
    check_conforming(mesh, "mesh")
    d = mesh.dimension
    state = "solid" if d == 3 else "plane_stress"
    mass, k = mesh_matrices(mesh, {None: STEEL}, state)
    slope = np.random.default_rng(2).normal(size=(d, d))
    u = (mesh.positions @ slope.T).ravel()
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    inside = ((mesh.positions > low) & (mesh.positions < high)).all(axis=1)
    force = (k @ u).reshape(-1, d)
    if name != "wedge6 and tet4":
        assert inside.any()
        assert_allclose(force[inside], 0, atol=1e-11 * np.abs(force).max())
    pairs = ((0, 1),) if d == 2 else ((0, 1), (1, 2), (0, 2))
    strain = [slope[i, i] for i in range(d)]
    strain += [slope[i, j] + slope[j, i] for i, j in pairs]
    assert mass.sum() == pytest.approx(STEEL.density * size, rel=1e-12)
    energy = size * np.array(strain) @ elasticity(STEEL, state) @ strain
    assert u @ force.ravel() == pytest.approx(energy, rel=1e-11)
    rank = np.linalg.matrix_rank(k.toarray(), tol=1e-9 * k.max())
    assert rank == k.shape[0] - d * (d + 1) // 2


def test_tetrahedra_on_a_hexahedron_are_refused() -> None:
    """Two triangles on a quadrilateral: forces inside under a constant stress."""
    points, numbers = grid(1, 1, 2)
    below, above = cell(numbers, (0, 0, 0)), cell(numbers, (0, 0, 1))
    a, b, c, d, e, f, g, h = above
    tetrahedra = [[a, b, d, e], [b, c, d, g], [b, g, d, e], [b, f, g, e], [d, g, h, e]]
    mesh = Mesh(points, blocks(hex8=[below], tet4=tetrahedra))
    check_mesh(mesh)
    with pytest.raises(InputError, match="triangular face lies on a quadrilateral"):
        check_conforming(mesh, "mesh")
    mass, k = mesh_matrices(mesh, {None: STEEL}, "solid")
    shear = mesh.positions @ np.array([[0, 0, 1.0], [0, 0, 0], [1.0, 0, 0]])
    force = (k @ shear.ravel()).reshape(-1, 3)[np.array(below[4:])]
    assert np.abs(force[:, 2]).max() > 1e8


def test_adjacent_linear_and_quadratic_elements_are_refused() -> None:
    points, numbers = grid(2, 1)
    known: dict = {}
    points, right = middles(points, "quad8", [cell(numbers, (1, 0))], known)
    mesh = Mesh(points, blocks(quad4=[cell(numbers, (0, 0))], quad8=right))
    check_mesh(mesh)
    with pytest.raises(InputError, match="linear and quadratic elements meet.*3, 4"):
        check_conforming(mesh, "mesh")


def test_faces_and_edges_are_those_of_the_element() -> None:
    for kind, (edges, triangles, squares) in {
        "tet10": (6, 4, 0),
        "hex20": (12, 0, 6),
        "wedge6": (9, 2, 3),
        "wedge15": (9, 2, 3),
        "pyramid13": (8, 4, 1),
        "quad8": (4, 0, 0),
        "tri3": (3, 0, 0),
    }.items():
        nodes = reference_element(kind).nodes
        assert len(element_edges(kind)) == edges
        for a, b, middle in element_edges(kind):
            if middle >= 0:
                assert_allclose(nodes[middle], (nodes[a] + nodes[b]) / 2)
        assert (len(element_faces(kind, 3)), len(element_faces(kind, 4))) == (
            triangles,
            squares,
        )
        for face in element_faces(kind, 4):
            a, b, c, d = nodes[list(face)]
            assert_allclose(a + c, b + d)
