"""Four parts as engineers draw them, meshed by elements of any kind.

A connecting rod with two bores, a bracket, a curved arm and the same arm 3 mm thin.
Each has nodes that are fixed, nodes that are loaded and the direction of the load, and
a point on its surface at which every mesh has a node.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidtool.mesh.mesh import ElementBlock, Mesh
from sidtool.mesh.reference_elements import edge_nodes, shape_of
from tests.metamorphic.parts.meshes import split, with_middles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bores of the rod: centre, radius, outer radius.
_EYES = ((0.0, 0.014, 0.026), (0.16, 0.010, 0.020))
_THICK = 0.012


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with its supports and loads."""

    mesh: Mesh
    fixed: Indices
    loaded: Indices
    direction: int
    probe: Array


def drawn_part(name: str, kind: str, n: int) -> Part:
    """One of `PARTS`, with n cells to its least width."""
    return PARTS[name](kind, n)


def _meshed(
    points: Array,
    cells: Indices,
    kind: str,
    bend: Callable[[Array], Array] = lambda x: x,
) -> Mesh:
    keys = np.round(points / 1e-9).astype(np.int64)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    corners, rows = split(points[first], number.ravel()[cells].tolist(), shape_of(kind))
    corners, rows = with_middles(corners, rows, kind)
    nodes = np.array(rows)
    block = ElementBlock(kind, nodes, np.arange(1, len(nodes) + 1))
    return Mesh(bend(corners), (block,))


def _box(counts: tuple[int, int, int]) -> tuple[Array, Indices]:
    """The unit cube in cells, their corners as hexahedra count them."""
    axes = [np.linspace(0, 1, c + 1) for c in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    numbers = np.arange(len(points)).reshape([c + 1 for c in counts])
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    ends = (slice(None, -1), slice(1, None))
    corners = [numbers[ends[i], ends[j], ends[k]] for k in (0, 1) for i, j in square]
    return points, np.stack(corners, -1).reshape(-1, 8)


def _held(
    mesh: Mesh,
    fixed: NDArray[np.bool_],
    loaded: NDArray[np.bool_],
    direction: int,
    probe: Array,
) -> Part:
    distance = np.linalg.norm(mesh.positions - probe, axis=1)
    assert distance.min() < 1e-9
    where = mesh.positions[distance.argmin()]
    return Part(mesh, np.flatnonzero(fixed), np.flatnonzero(loaded), direction, where)


def _rod(kind: str, n: int) -> Part:
    parts, counted, start = [], [], 0
    for patch, layers in _rod_patches(n):
        points, cells = _box((*layers, n))
        grid = patch(points[:, 0], points[:, 1])
        parts.append(np.column_stack([grid, _THICK * points[:, 2]]))
        counted.append(cells + start)
        start += len(points)
    mesh = _meshed(np.vstack(parts), np.vstack(counted), kind)
    positions = mesh.positions.copy()
    (block,) = mesh.blocks
    for x, _, outer in _EYES:
        radius = np.linalg.norm(positions[:, :2] - [x, 0], axis=1)
        _onto_arcs(positions, block, np.array([x, 0]), radius, outer)
    mesh = Mesh(positions, mesh.blocks)
    bores = [
        np.isclose(np.linalg.norm(positions[:, :2] - [x, 0], axis=1), r, rtol=1e-9)
        for x, r, _ in _EYES
    ]
    top = (_EYES[0][2] + _EYES[1][2]) / 2 * np.sqrt(0.5)
    left, right = _EYES[0][2] * np.sqrt(0.5), _EYES[1][0] - _EYES[1][2] * np.sqrt(0.5)
    probe = np.array([(left + right) / 2, top, _THICK])
    return _held(mesh, bores[0], bores[1], 1, probe)


def _rod_patches(n: int) -> list[tuple[Callable[[Array, Array], Array], tuple]]:
    (x0, r0, o0), (x1, r1, o1) = _EYES

    def eye(centre: float, inner: float, outer: float, way: float):
        def patch(s: Array, t: Array) -> Array:
            radius, angle = inner + s * (outer - inner), 2 * np.pi * t
            circle = np.column_stack([np.cos(angle), np.sin(angle)])
            return [centre, 0.0] + way * radius[:, None] * circle

        return patch

    def shank(s: Array, t: Array) -> Array:
        angle = np.pi / 2 * (t - 0.5)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        a, b = o0 * circle, [x1, 0.0] + o1 * circle * [-1, 1]
        return a + s[:, None] * (b - a)

    return [
        (eye(x0, r0, o0, 1.0), (n, 8 * n)),
        (eye(x1, r1, o1, -1.0), (n, 8 * n)),
        (shank, (6 * n, 2 * n)),
    ]


def _onto_arcs(
    positions: Array, block: ElementBlock, centre: Array, radius: Array, outer: float
) -> None:
    """Middle nodes between two nodes on a circle of an eye are put on it."""
    count = block.nodes.shape[1] - len(edge_nodes(block.kind))
    for k, (a, b) in enumerate(edge_nodes(block.kind)):
        first, last = block.nodes[:, a], block.nodes[:, b]
        middle = block.nodes[:, count + k]
        expected = radius[first]
        arc = np.isclose(expected, radius[last], rtol=1e-9) & (
            expected < outer * 1.000001
        )
        near = middle[arc]
        way = positions[near, :2] - centre
        way *= (expected[arc] / np.linalg.norm(way, axis=1))[:, None]
        positions[near, :2] = centre + way


def _bracket(kind: str, n: int) -> Part:
    """Two legs of 80 and 60 mm, 10 mm thick and 24 mm wide, mitred at the corner."""
    long, short, thick, wide = 0.08, 0.06, 0.01, 0.024

    def bend(points: Array) -> Array:
        s, depth = points[:, 0], thick * points[:, 1]
        first = np.column_stack([2 * s * (long - depth), depth])
        second = np.column_stack([long - depth, depth + (2 * s - 1) * (short - depth)])
        plane = np.where((s <= 0.5)[:, None], first, second)
        return np.column_stack([plane, wide * points[:, 2]])

    mesh = _meshed(*_box((12 * n, n, 2 * n)), kind, bend)
    x = mesh.positions
    end = np.isclose(x[:, 1], short, atol=1e-9)
    probe = np.array([(long - thick) / 2, thick, wide / 2])
    return _held(mesh, np.isclose(x[:, 0], 0, atol=1e-9), end, 0, probe)


def _arm(kind: str, n: int, thick: float) -> Part:
    """Three eighths of a ring of 120 mm, 24 mm wide; its load bends it where thin."""
    radius, wide, turn = 0.12, 0.024, 0.75 * np.pi

    def bend(points: Array) -> Array:
        r, angle = radius + wide * (0.5 - points[:, 1]), turn * points[:, 0]
        return np.column_stack(
            [r * np.sin(angle), -r * np.cos(angle), thick * points[:, 2]]
        )

    mesh = _meshed(*_box((12 * n, 2 * n, n)), kind, bend)
    angle = np.arctan2(mesh.positions[:, 0], -mesh.positions[:, 1])
    probe = bend(np.array([[0.5, 0.5, 1.0]]))[0]
    end = np.isclose(angle, turn, atol=1e-9)
    return _held(mesh, np.abs(angle) < 1e-9, end, 2, probe)


def shaken_bar(kind: str, n: int, share: float) -> Part:
    """A square bar of 20 mm, four times as long, pulled along x; its inner nodes are
    off by a share of a cell, so that finer cells are as skew."""
    points, cells = _box((4 * n, n, n))
    shift = np.random.default_rng(5).uniform(-share, share, points.shape)
    inner = (points > 1e-9) & (points < 1 - 1e-9)
    points = points + inner * shift / [4 * n, n, n]
    mesh = _meshed(points * [0.08, 0.02, 0.02], cells, kind)
    ends = [np.isclose(mesh.positions[:, 0], x, atol=1e-9) for x in (0.0, 0.08)]
    return _held(mesh, ends[0], ends[1], 0, np.array([0.08, 0.02, 0.02]))


def twisted_blade(kind: str, n: int, thick: float) -> Part:
    """A blade of 12 by 1.1, turned by a quarter, pushed along z at its tip.

    R. H. MacNeal, R. L. Harder, "A proposed standard set of problems to test finite
    element accuracy", Finite Elem. Anal. Des. 1, 1985.
    """

    def bend(points: Array) -> Array:
        angle = np.pi / 2 * points[:, 0]
        y, z = 1.1 * (points[:, 1] - 0.5), thick * (points[:, 2] - 0.5)
        c, s = np.cos(angle), np.sin(angle)
        return np.column_stack([12 * points[:, 0], y * c - z * s, y * s + z * c])

    mesh = _meshed(*_box((12 * n, 2 * n, 1)), kind, bend)
    x, probe = mesh.positions[:, 0], bend(np.array([[0.5, 0.5, 1.0]]))[0]
    return _held(mesh, np.isclose(x, 0), np.isclose(x, 12), 2, probe)


#: The parts by their names.
PARTS: dict[str, Callable[[str, int], Part]] = {
    "rod": _rod,
    "bracket": _bracket,
    "arm": lambda kind, n: _arm(kind, n, 0.012),
    "thin arm": lambda kind, n: _arm(kind, n, 0.003),
}
