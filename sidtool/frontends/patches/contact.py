"""Whether elements meet only where they share nodes: no overlap, no hanging nodes.

Only faces that belong to one element need to be looked at: across a face that two
elements share from both sides the number of elements that cover a point does not
change.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ..elements.finder import ElementFinder
from ..elements.reference import all_edges, faces, reference_element
from ..mesh.data import ElementBlock, Mesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_NONE = np.zeros(0, np.int64)
#: How far samples of a face lie inside its element, of the way to the centre.
_INWARD = 0.05
#: How far samples lie from the centre of a face towards its corners.
_TOWARDS = (0.0, 0.8)
#: How far outside an element a node on its face may seem to be, in its parameters.
_SLACK = 1e-5


@dataclass(frozen=True, eq=False)
class _Faces:
    """Faces (in the plane: edges) of the elements of one block.

    Attributes
    ----------
    rows : (k,) elements
    corners : (k, m) nodes
    local : (k, m) the same as numbers within the element
    """

    block: int
    rows: Indices
    corners: Indices
    local: Indices


def check_contact(mesh: Mesh, place: str, held: Indices = _NONE) -> None:
    """Whether elements touch each other only in whole faces, edges and nodes.

    Parameters
    ----------
    held : nodes that equations hold, which may lie on elements

    Raises
    ------
    InputError : two elements cover the same place, or a node lies on an element that
        does not use it.
    """
    outer = list(_free_faces(mesh, place))
    finder = ElementFinder(mesh)
    _check_overlap(mesh, outer, finder, place)
    _check_hanging(mesh, outer, finder, place, held)


def _element_faces(mesh: Mesh) -> Iterator[_Faces]:
    for number, block in enumerate(mesh.blocks):
        found: list[tuple[int, ...]] = [*faces(block.kind, 3), *faces(block.kind, 4)]
        if mesh.dimension == 2:
            found = [edge[:2] for edge in all_edges(block.kind)]
        rows = np.arange(len(block.nodes))
        for face in found:
            local = np.array(face)
            corners = block.nodes[:, local]
            yield _Faces(number, rows, corners, np.tile(local, (len(rows), 1)))


def _free_faces(mesh: Mesh, place: str) -> Iterator[_Faces]:
    """The faces that belong to one element.

    Raises
    ------
    InputError : a face belongs to three elements, or to two on the same side of it.
    """
    every = list(_element_faces(mesh))
    width = max(part.corners.shape[1] for part in every)
    keys = np.vstack([_key(part.corners, width) for part in every])
    sizes = np.cumsum([0, *(len(part.rows) for part in every)])
    _, first, inverse, counts = np.unique(
        keys, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    inverse = inverse.ravel()
    crowded = np.flatnonzero(counts > 2)
    if crowded.size:
        raise _covered_twice(mesh, every, inverse == crowded[0], place)
    sides = np.concatenate([_side(mesh, part, keys[s:]) for s, part in _at(every)])
    total = np.zeros(len(counts))
    np.add.at(total, inverse, sides)
    same = np.flatnonzero((counts == 2) & (np.abs(total) == 2))
    if same.size:
        raise _covered_twice(mesh, every, inverse == same[0], place)
    alone = counts[inverse] == 1
    for i, part in enumerate(every):
        kept = alone[sizes[i] : sizes[i + 1]]
        yield _Faces(part.block, part.rows[kept], part.corners[kept], part.local[kept])


def _covered_twice(
    mesh: Mesh, parts: list[_Faces], chosen: NDArray[np.bool_], place: str
) -> InputError:
    names = []
    for start, part in _at(parts):
        rows = part.rows[chosen[start : start + len(part.rows)]]
        names += [_label(mesh, part.block, row) for row in rows]
    return _overlapping(names[0], names[1], place)


def _at(parts: list[_Faces]) -> Iterator[tuple[int, _Faces]]:
    start = 0
    for part in parts:
        yield start, part
        start += len(part.rows)


def _key(corners: Indices, width: int) -> Indices:
    """Sorted corners, as many columns for every kind of face."""
    key = np.full((len(corners), width), -1, np.int64)
    key[:, width - corners.shape[1] :] = np.sort(corners, axis=1)
    return np.sort(key, axis=1)


def _side(mesh: Mesh, part: _Faces, keys: Indices) -> Array:
    """On which side of each face its element lies: the same for the same corners."""
    block = mesh.blocks[part.block]
    count = reference_element(block.kind).corners
    centre = mesh.positions[block.nodes[part.rows][:, :count]].mean(axis=1)
    own = keys[: len(part.rows), -part.corners.shape[1] :]
    points = mesh.positions[own]
    middle = points.mean(axis=1)
    if mesh.dimension == 2:
        along = points[:, 1] - points[:, 0]
        normal = np.column_stack([-along[:, 1], along[:, 0]])
    else:
        normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    return np.sign(np.einsum("ij,ij->i", centre - middle, normal))


def _check_overlap(
    mesh: Mesh, outer: list[_Faces], finder: ElementFinder, place: str
) -> None:
    """No point just inside a free face lies in another element."""
    for part in outer:
        points, owners = _samples(mesh, part)
        for block in range(len(mesh.blocks)):
            rows = np.arange(len(mesh.blocks[block].nodes))
            own = owners if block == part.block else np.full(len(owners), -1)
            others = partial(_not_equal, own)
            for point, row in finder.holders(points, block, rows, -1e-3, others):
                if len(row):
                    owner = _label(mesh, part.block, owners[point[0]])
                    raise _overlapping(owner, _label(mesh, block, row[0]), place)


def _not_equal(owners: Indices, point: Indices, row: Indices) -> NDArray[np.bool_]:
    return np.asarray(owners[point] != row)


def _samples(mesh: Mesh, part: _Faces) -> tuple[Array, Indices]:
    """Points just inside some faces, and the rows of their elements."""
    block = mesh.blocks[part.block]
    if not len(part.rows):
        return np.zeros((0, mesh.dimension)), part.rows
    element = reference_element(block.kind)
    corners = element.nodes[part.local[0]]
    middle = corners.mean(axis=0)
    on_face = np.array([middle + t * (c - middle) for t in _TOWARDS for c in corners])
    on_face = np.unique(np.round(on_face, 12), axis=0)
    centre = element.nodes[: element.corners].mean(axis=0)
    values, _ = element.at(on_face + _INWARD * (centre - on_face))
    nodes = mesh.positions[block.nodes[part.rows]]
    points = np.einsum("gm,kmd->kgd", values, nodes)
    return points.reshape(-1, mesh.dimension), np.repeat(part.rows, len(on_face))


def _check_hanging(
    mesh: Mesh,
    outer: list[_Faces],
    finder: ElementFinder,
    place: str,
    held: Indices,
) -> None:
    """No node of a free face lies on another element without being its node."""
    nodes = np.unique(
        np.concatenate([_all_nodes(mesh, part).ravel() for part in outer])
    )
    nodes = np.setdiff1d(nodes, held)
    for number, block in enumerate(mesh.blocks):
        rows = np.unique(np.concatenate([p.rows for p in outer if p.block == number]))
        apart = partial(_apart, mesh, block, nodes, finder.radii[number])
        points = mesh.positions[nodes]
        for point, row in finder.holders(points, number, rows, _SLACK, apart):
            if len(row):
                _refuse(mesh, nodes[point], block, row, place)


def _apart(
    mesh: Mesh,
    block: ElementBlock,
    nodes: Indices,
    size: Array,
    i: Indices,
    row: Indices,
) -> NDArray[np.bool_]:
    """Whether a node is none of an element, and none of these is at its place."""
    own, node = block.nodes[row], nodes[i]
    other = (own != node[:, None]).all(axis=1)
    gaps = mesh.positions[own[other]] - mesh.positions[node[other]][:, None]
    near = np.linalg.norm(gaps, axis=2) < 1e-4 * size[row[other]][:, None]
    other[other] = ~near.any(axis=1)
    return other


def _all_nodes(mesh: Mesh, part: _Faces) -> Indices:
    """The nodes of the elements behind some faces; those inside are found as well."""
    return mesh.blocks[part.block].nodes[part.rows]


def _refuse(
    mesh: Mesh, nodes: Indices, block: ElementBlock, rows: Indices, place: str
) -> None:
    first = int(nodes[0])
    label = mesh.labels[first] if mesh.labels.size else first + 1
    raise InputError(
        f"node {label} lies on element {block.labels[rows[0]]} ({block.kind}), which "
        f"does not use it: a hanging node ({len(np.unique(nodes))} of them), where "
        "the mesh would gape",
        place=place,
        expected="elements that meet in whole faces",
    )


def _overlapping(one: str, other: str, place: str) -> InputError:
    return InputError(
        f"elements {one} and {other} cover the same place, which would count twice",
        place=place,
        expected="every place covered once",
    )


def _label(mesh: Mesh, block: int, row: int) -> str:
    found = mesh.blocks[block]
    return f"{found.labels[row]} ({found.kind})"
