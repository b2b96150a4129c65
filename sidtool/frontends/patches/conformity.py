"""Whether elements of different kinds fit each other where they meet."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ..elements.reference import all_edges, faces
from ..mesh.data import Mesh

Indices = NDArray[np.int64]


def check_conforming(mesh: Mesh, place: str, straight: Indices | None = None) -> None:
    """Whether a mixed mesh has no gaps: the patch test tells if it had.

    Linear and quadratic elements must not share an edge, nor may triangular faces lie
    on a quadrilateral one, which needs a pyramid between them.

    Parameters
    ----------
    straight : nodes in the middle of edges that move by the mean of the ends, as those
        of linear elements do

    Raises
    ------
    InputError : they do.
    """
    if len({block.kind for block in mesh.blocks}) < 2:
        return
    _check_edges(mesh, place, np.zeros(0, int) if straight is None else straight)
    _check_faces(mesh, place)


def _check_edges(mesh: Mesh, place: str, straight: Indices) -> None:
    """All elements at an edge agree on its node in the middle."""
    rows = []
    for block in mesh.blocks:
        for a, b, middle in all_edges(block.kind):
            ends = np.sort(block.nodes[:, [a, b]], axis=1)
            between = block.nodes[:, middle] if middle >= 0 else np.full(len(ends), -1)
            between = np.where(np.isin(between, straight), -1, between)
            rows.append(np.column_stack([ends, between]))
    table = np.unique(np.concatenate(rows), axis=0)
    bad = np.flatnonzero((table[1:, :2] == table[:-1, :2]).all(axis=1))
    if bad.size:
        raise InputError(
            "linear and quadratic elements meet at the edge between nodes "
            f"{_labels(mesh, table[bad[0], :2])}",
            place=place,
            expected="elements of one order, or linear ones apart from quadratic ones",
        )


def _check_faces(mesh: Mesh, place: str) -> None:
    """No triangular face has three corners of a quadrilateral one."""
    squares = np.concatenate([*_faces(mesh, 4), np.zeros((0, 4), np.int64)])
    triangles = np.concatenate([*_faces(mesh, 3), np.zeros((0, 3), np.int64)])
    parts = [squares[:, list(corners)] for corners in combinations(range(4), 3)]
    covered = np.unique(np.sort(np.concatenate(parts), axis=1), axis=0)
    alone = np.unique(np.sort(triangles, axis=1), axis=0)
    both, counts = np.unique(np.vstack([covered, alone]), axis=0, return_counts=True)
    bad = both[counts > 1]
    if bad.size:
        raise InputError(
            "a triangular face lies on a quadrilateral one at nodes "
            f"{_labels(mesh, bad[0])}",
            place=place,
            expected="pyramids or wedges between hexahedra and tetrahedra, or elements "
            "of one kind",
        )


def _faces(mesh: Mesh, corners: int) -> Iterable[Indices]:
    for block in mesh.blocks:
        for face in faces(block.kind, corners):
            yield block.nodes[:, list(face)]


def _labels(mesh: Mesh, nodes: Indices) -> str:
    known = mesh.labels if mesh.labels.size else np.arange(len(mesh.positions)) + 1
    return ", ".join(str(known[node]) for node in nodes)
