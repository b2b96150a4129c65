"""Parts made of every kind of element: blocks, turned and bent, distorted inside."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sidtool.formats.model import Material, ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.mesh.mesh import ElementBlock, Mesh
from sidtool.mesh.reference_elements import edge_nodes, reference_element, shape_of
from tests.sidtool.models import rod_data

Array = NDArray[np.float64]

STEEL = Material(youngs_modulus=2.1e11, poissons_ratio=0.3, density=7850.0)
_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))


def block(
    kind: str,
    counts: tuple[int, ...],
    size: tuple[float, ...],
    *,
    seed: int | None = None,
    shift: float = 0.18,
    bend: Callable[[Array], Array] | None = None,
) -> Mesh:
    """A box of elements of one kind with its lower corner at the origin.

    Parameters
    ----------
    counts : cells per direction; simplices, prisms and pyramids share a cell
    seed : of the random places of the nodes inside, relative to the cell `shift` off;
        the surface stays flat, but middle nodes inside bow the edges
    bend : maps the nodes, middle ones included, once they are placed
    """
    axes = [np.arange(n + 1.0) for n in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(counts))
    numbers = np.arange(len(points)).reshape([n + 1 for n in counts])
    cells = [
        [int(numbers[tuple(np.add(at, step))]) for step in _steps(len(counts))]
        for at in product(*map(range, counts))
    ]
    points = _shaken(points, counts, seed, shift)
    points, rows = split(points, cells, shape_of(kind))
    points, rows = with_middles(points, rows, kind)
    if len(points) > numbers.size:
        points = _shaken(points, counts, seed, 0.03)
    points = points * (np.array(size) / counts)
    labels = np.arange(1, len(rows) + 1)
    mesh = Mesh(
        points if bend is None else bend(points),
        (ElementBlock(kind, np.array(rows), labels),),
    )
    assert len(np.unique(mesh.blocks[0].nodes)) == len(points)
    return mesh


def _steps(d: int) -> list[tuple[int, ...]]:
    layers: list[tuple[int, ...]] = [()] if d == 2 else [(0,), (1,)]
    return [(*s, *z) for z in layers for s in _SQUARE]


def _shaken(
    points: Array, counts: tuple[int, ...], seed: int | None, shift: float
) -> Array:
    """Nodes inside moved at will, those on a face or an edge left on it."""
    if seed is None:
        return points
    random = np.random.default_rng(seed).uniform(-shift, shift, points.shape)
    free = (points > 1e-9) & (points < np.array(counts) - 1e-9)
    return points + random * free


def split(
    points: Array, cells: list[list[int]], shape: str
) -> tuple[Array, list[list[int]]]:
    if shape in ("quad", "hex"):
        return points, cells
    if shape == "tri":
        return points, [[c[i] for i in t] for c in cells for t in _HALVES]
    if shape == "wedge":
        prisms = [(*t, *(i + 4 for i in t)) for t in _HALVES]
        return points, [[c[i] for i in p] for c in cells for p in prisms]
    if shape == "tet":
        return points, [[c[i] for i in t] for c in cells for t in _kuhn()]
    centres = np.array([points[c].mean(axis=0) for c in cells])
    bases = (
        (0, 1, 2, 3),
        (7, 6, 5, 4),
        (4, 5, 1, 0),
        (5, 6, 2, 1),
        (6, 7, 3, 2),
        (7, 4, 0, 3),
    )
    rows = [
        [*(c[i] for i in base), len(points) + n]
        for n, c in enumerate(cells)
        for base in bases
    ]
    return np.vstack([points, centres]), rows


_HALVES = ((0, 1, 2), (0, 2, 3))


def _kuhn() -> list[list[int]]:
    """Six tetrahedra along the diagonal of a box, which match across boxes."""
    steps = _steps(3)
    result = []
    for order in permutations(range(3)):
        path = np.cumsum(
            [np.zeros(3, int), *(np.eye(3, dtype=int)[i] for i in order)], 0
        )
        row = [steps.index(tuple(int(x) for x in at)) for at in path]
        edges = (path[1:] - path[0]).astype(float)
        result.append(
            row if np.linalg.det(edges) > 0 else [row[i] for i in (0, 2, 1, 3)]
        )
    return result


def with_middles(
    points: Array, rows: list[list[int]], kind: str
) -> tuple[Array, list[list[int]]]:
    known: dict[tuple[int, ...], int] = {}
    more, result = list(points), []
    for row in rows:
        full = list(row)
        for a, b in edge_nodes(kind):
            key = tuple(sorted((row[a], row[b])))
            if key not in known:
                known[key] = len(more)
                more.append((points[row[a]] + points[row[b]]) / 2)
            full.append(known[key])
        result.append(full)
    return np.array(more), result


def turned(mesh: Mesh, seed: int) -> Mesh:
    """The mesh turned and moved at will."""
    random = np.random.default_rng(seed)
    d = mesh.dimension
    if d == 3:
        turn = Rotation.random(random_state=seed).as_matrix()
    else:
        c, s = np.cos(1.1 + seed), np.sin(1.1 + seed)
        turn = np.array([[c, -s], [s, c]])
    return Mesh(mesh.positions @ turn.T + random.normal(size=d), mesh.blocks)


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The mesh with its nodes and elements in another order."""
    random = np.random.default_rng(seed)
    order = random.permutation(len(mesh.positions))
    number = np.argsort(order)
    blocks = []
    for part in mesh.blocks:
        rows = random.permutation(len(part.nodes))
        blocks.append(
            ElementBlock(part.kind, number[part.nodes[rows]], part.labels[rows])
        )
    return Mesh(mesh.positions[order], tuple(blocks))


def ring(radius: float, width: float, angle: float) -> Callable[[Array], Array]:
    """Bends a box of unit length in x and y: x runs outwards, y around."""

    def bend(points: Array) -> Array:
        r, turn = radius + width * points[:, 0], angle * points[:, 1]
        plane = [r * np.cos(turn), r * np.sin(turn)]
        return np.column_stack([*plane, *points[:, 2:].T])

    return bend


def dimension(kind: str) -> int:
    return reference_element(kind).dimension


def state(kind: str) -> str:
    return "solid" if dimension(kind) == 3 else "plane_stress"


def quarter_ring(
    discretisation: dict[str, Any],
    inner: float,
    outer: float,
    width: float | None = None,
    **changes: Any,
) -> ModelFile:
    """A quarter of a ring about the origin, exact; plane if it has no width."""
    w = np.sqrt(0.5)
    arcs = [[[r, 0.0], [r, r], [0.0, r]] for r in (inner, outer)]
    weights: Any = [[1, w, 1], [1, w, 1]]
    data = rod_data(discretisation)
    geometry: dict[str, Any] = {
        "type": "nurbs",
        "degrees": [1, 2],
        "knots": [[0, 0, 1, 1], [0, 0, 0, 1, 1, 1]],
        "control_points": arcs,
        "weights": weights,
        "thickness": 0.1,
    }
    if width is not None:
        del geometry["thickness"]
        geometry |= {
            "type": "nurbs_volume",
            "degrees": [1, 2, 1],
            "knots": [*geometry["knots"], [0, 0, 1, 1]],
            "control_points": [
                [[[*p, z] for z in (0.0, width)] for p in arc] for arc in arcs
            ],
            "weights": [[[x, x] for x in row] for row in weights],
        }
    data["geometry"] = geometry
    at: Any = 0.5 if width is None else [0.5, 0.5]
    data["frame"] = {"type": "tangent", "marker": "foot", "clamp": "bottom"}
    data["markers"] = {"foot": {"node": 1, "edge": "bottom", "at": at}}
    data["markers"] |= changes.pop("markers", {})
    data["reduction"]["modes"] = 3
    return validate_data(data | changes, ModelFile)
