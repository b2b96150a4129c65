"""Several patches joined along matching sides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from formats.errors import InputError

from .patch import NurbsPatch, evaluate_grid, side_nodes

Indices = NDArray[np.int64]

SIDE_NAMES = {
    (0, 0): "left",
    (0, 1): "right",
    (1, 0): "bottom",
    (1, 1): "top",
    (2, 0): "back",
    (2, 1): "front",
}


@dataclass(frozen=True, eq=False)
class Joined:
    """A common numbering of the control points of several patches.

    Attributes
    ----------
    numbers : patch -> (n,) common number of each of its control points
    count : of common control points
    """

    numbers: Mapping[str, Indices]
    count: int


def joined(patches: Mapping[str, NurbsPatch], tolerance: float = 1e-9) -> Joined:
    """Control points of sides at the same place with the same weight become one.

    Parameters
    ----------
    tolerance : distance at which points are the same, relative to the size of the part

    Raises
    ------
    InputError : two sides share their corners but do not match, or the patches do not
        hang together.
    """
    names = list(patches)
    offsets = np.cumsum([0, *(p.weights.size for p in patches.values())])
    points = np.concatenate([p.points for p in patches.values()])
    weights = np.concatenate([p.weights.ravel() for p in patches.values()])
    sides = {
        (name, side): offset + side_nodes(patch, *side)
        for (name, patch), offset in zip(patches.items(), offsets, strict=False)
        for side in product(range(len(patch.degrees)), (0, 1))
    }
    near = tolerance * float(np.ptp(points, axis=0).max())
    outside = np.unique(np.concatenate(list(sides.values())))
    pairs = cKDTree(points[outside]).query_pairs(near, output_type="ndarray")
    i, j = outside[pairs[:, 0]], outside[pairs[:, 1]]
    graph = csr_matrix((np.ones(len(i)), (i, j)), shape=(len(points),) * 2)
    count, classes = connected_components(graph, directed=False)
    number = _in_order(classes.astype(np.int64))
    _check_sides(sides, patches, number, weights)
    parts = {
        name: number[a:b]
        for name, a, b in zip(names, offsets, offsets[1:], strict=False)
    }
    _check_one_part(parts, count)
    return Joined(parts, int(count))


def _in_order(number: Indices) -> Indices:
    """The same classes, numbered as they first appear."""
    _, first, inverse = np.unique(number, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


def _check_sides(
    sides: Mapping[tuple[str, tuple[int, int]], Indices],
    patches: Mapping[str, NurbsPatch],
    number: Indices,
    weights: NDArray[np.float64],
) -> None:
    by_corners: dict[tuple[int, ...], list[tuple[str, tuple[int, int]]]] = {}
    for key, nodes in sides.items():
        corners = tuple(sorted(set(number[nodes[_corners(patches[key[0]], key[1])]])))
        by_corners.setdefault(corners, []).append(key)
    for keys in by_corners.values():
        for key in keys[1:]:
            _check_match(keys[0], key, sides, patches, number, weights)


def _check_match(
    a: tuple[str, tuple[int, int]],
    b: tuple[str, tuple[int, int]],
    sides: Mapping[tuple[str, tuple[int, int]], Indices],
    patches: Mapping[str, NurbsPatch],
    number: Indices,
    weights: NDArray[np.float64],
) -> None:
    if a[0] == b[0] and a[1][0] == b[1][0] and len(set(number[sides[a]])) == 1:
        return
    pairs = []
    for key in (a, b):
        order = np.argsort(number[sides[key]], kind="stable")
        pairs.append((number[sides[key]][order], weights[sides[key]][order]))
    (na, wa), (nb, wb) = pairs
    same = na.shape == nb.shape and bool((na == nb).all())
    if same:
        ratio = wa / wb
        same = bool(np.ptp(ratio) <= 1e-9 * ratio.max())
    if not same and _overlap(patches, a, b):
        names = " and ".join(f"{name}.{SIDE_NAMES[side]}" for name, side in (a, b))
        raise InputError(
            f"the sides {names} share their corners but not their control points",
            place="geometry",
            expected="the same control points, weights, degrees and knots on both "
            "sides",
        )


def _overlap(
    patches: Mapping[str, NurbsPatch],
    a: tuple[str, tuple[int, int]],
    b: tuple[str, tuple[int, int]],
) -> bool:
    """Whether two sides with common corners lie on each other in the middle.

    The two arcs of a disc made of two halves, for example, do not.
    """
    middle = _side_points(patches[a[0]], a[1], 3)
    middle = middle[len(middle) // 2]
    others = _side_points(patches[b[0]], b[1], 101)
    size = float(np.linalg.norm(np.ptp(others, axis=0)))
    return bool(np.linalg.norm(others - middle, axis=1).min() < 0.02 * size)


def _side_points(
    patch: NurbsPatch, side: tuple[int, int], count: int
) -> NDArray[np.float64]:
    axes = [np.linspace(0, 1, count) for _ in patch.degrees]
    axes[side[0]] = np.array([float(side[1])])
    return evaluate_grid(patch, tuple(axes)).reshape(-1, patch.points.shape[1])


def _corners(patch: NurbsPatch, side: tuple[int, int]) -> Indices:
    shape = [n for i, n in enumerate(patch.shape) if i != side[0]]
    grid = np.arange(int(np.prod(shape))).reshape(shape)
    return grid[np.ix_(*((0, -1) for _ in shape))].ravel()


def _check_one_part(parts: Mapping[str, Indices], count: int) -> None:
    names = list(parts)
    members = [(i, n) for i, name in enumerate(names) for n in np.unique(parts[name])]
    rows, columns = np.array(members).T
    graph = csr_matrix(
        (np.ones(len(rows)), (rows, len(names) + columns)),
        shape=(len(names) + count,) * 2,
    )
    _, label = connected_components(graph, directed=False)
    lost = [n for n, x in zip(names, label, strict=False) if x != label[0]]
    if lost:
        raise InputError(
            f"patch {lost[0]} is not joined to patch {names[0]}",
            place="geometry",
            expected="patches that share whole sides",
        )
