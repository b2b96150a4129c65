"""Patches joined along matching sides: several ones, or one that closes on itself.

What belongs together is decided by the patches as given: two sides with the same
control points are a seam, and a side or edge that shrinks to a point or a line is one.
Refined patches are joined along these seams, however close their control points are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.complex_step import check_joined_points, number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .nurbs_patch import NurbsPatch

Indices = NDArray[np.int64]

SIDE_NAMES = {
    (0, 0): "left",
    (0, 1): "right",
    (1, 0): "bottom",
    (1, 1): "top",
    (2, 0): "back",
    (2, 1): "front",
}
T = TypeVar("T")
#: Distance at which points of refined patches are the same, relative to the part.
_SAME_POINT_TOLERANCE = 1e-9
#: Difference at which knots on [0, 1] are the same.
_SAME_KNOT_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Side:
    """A side of a patch: where a parameter is 0 or 1."""

    patch: str
    direction: int
    end: int

    @property
    def name(self) -> str:
        """Name as in the model file: PATCH.SIDE."""
        return f"{self.patch}.{SIDE_NAMES[self.direction, self.end]}"

    def along(self, values: Sequence[T]) -> list[T]:
        """What a patch has by direction, of the directions along the side."""
        return [value for k, value in enumerate(values) if k != self.direction]


@dataclass(frozen=True)
class Seam:
    """Two sides that are the same; `turn` takes the net of the second to the first."""

    first: Side
    second: Side
    turn: DirectionMap


@dataclass(frozen=True)
class DirectionMap:
    """Another order and sense of the directions of a net of control points."""

    order: tuple[int, ...]
    reversed: tuple[bool, ...]

    def of(self, net: NDArray[Any]) -> NDArray[Any]:
        """The net with its first directions permuted and then reversed."""
        rest = range(len(self.order), net.ndim)
        steps = tuple(slice(None, None, -1 if r else None) for r in self.reversed)
        return np.transpose(net, (*self.order, *rest))[steps]


@dataclass(frozen=True, eq=False)
class Topology:
    """Connectivity of patches.

    Attributes
    ----------
    seams : pairs of sides that are the same
    collapsed : sides and edges along which the points of a direction are one
    """

    seams: tuple[Seam, ...]
    collapsed: tuple[CollapsedSide, ...]


@dataclass(frozen=True)
class CollapsedSide:
    """A side or an edge of a patch whose points do not depend on one direction.

    Attributes
    ----------
    fixed : direction and end of each parameter that is 0 or 1 there
    axis : the direction along which all control points are one
    """

    patch: str
    fixed: tuple[tuple[int, int], ...]
    axis: int

    def lines(self, patch: NurbsPatch, values: NDArray[Any]) -> NDArray[Any]:
        """Values (n, ...) of all control points on it, `axis` first."""
        grid = values.reshape(*patch.shape, *values.shape[1:])
        index: list[Any] = [slice(None)] * len(patch.shape)
        for direction, end in self.fixed:
            index[direction] = slice(-1, None) if end else slice(0, 1)
        return np.moveaxis(grid[tuple(index)], self.axis, 0)


@dataclass(frozen=True, eq=False)
class CommonNumbering:
    """A common numbering of the control points of several patches.

    Attributes
    ----------
    numbers : patch -> (n,) common number of each of its control points
    count : of common control points
    """

    numbers: Mapping[str, Indices]
    count: int


def sides_of(patches: Mapping[str, NurbsPatch]) -> list[Side]:
    """All sides of all patches."""
    return [
        Side(name, *side)
        for name, patch in patches.items()
        for side in product(range(len(patch.degrees)), (0, 1))
    ]


def side_net(patch: NurbsPatch, side: Side, values: NDArray[Any]) -> NDArray[Any]:
    """Values (n, ...) of all control points on the net of one side."""
    grid = values.reshape(*patch.shape, *values.shape[1:])
    return np.take(grid, -side.end, axis=side.direction)


def largest_extent(patches: Mapping[str, NurbsPatch]) -> float:
    """The largest extension of the control points."""
    points = np.concatenate([p.points for p in patches.values()])
    return float(np.ptp(points, axis=0).max())


def find_topology(
    patches: Mapping[str, NurbsPatch], tolerance: float = 1e-9
) -> Topology:
    """Find the connectivity of the patches of a file.

    Parameters
    ----------
    tolerance : distance at which control points are the same, relative to the part
    """
    size, sides = largest_extent(patches), sides_of(patches)
    nets = {s: side_net(patches[s.patch], s, patches[s.patch].points) for s in sides}
    weights = {
        s: side_net(patches[s.patch], s, patches[s.patch].weights.ravel())
        for s in sides
    }
    seams = []
    for a, b in combinations(sides, 2):
        for turn in _direction_maps(nets[a].ndim - 1):
            if (
                _are_equal_nets(nets[a], turn.of(nets[b]), tolerance * size)
                and _are_proportional(weights[a], turn.of(weights[b]))
                and _have_equal_knots(patches, a, b, turn)
            ):
                seams.append(Seam(a, b, turn))
                break
    collapsed = [
        part
        for part in _sides_and_edges(patches)
        if np.ptp(
            part.lines(patches[part.patch], patches[part.patch].points), axis=0
        ).max()
        <= _SAME_POINT_TOLERANCE * size
    ]
    return Topology(tuple(seams), tuple(collapsed))


def _sides_and_edges(patches: Mapping[str, NurbsPatch]) -> Iterator[CollapsedSide]:
    """All sides and edges with each of their directions."""
    for name, patch in patches.items():
        k = len(patch.degrees)
        for count in range(1, k):
            for directions in combinations(range(k), count):
                for ends in product((0, 1), repeat=count):
                    fixed = tuple(zip(directions, ends, strict=True))
                    for axis in set(range(k)) - set(directions):
                        yield CollapsedSide(name, fixed, axis)


def close_gaps(
    patches: Mapping[str, NurbsPatch], topology: Topology, tolerance: float
) -> dict[str, NurbsPatch]:
    """The patches with the control points of their seams in the middle of the gap."""
    real = {name: patch.real for name, patch in patches.items()}
    numbering = number_control_points(real, topology, tolerance)
    d = next(iter(patches.values())).points.shape[1]
    kind = number_type(*(patch.points for patch in patches.values()))
    total, count = np.zeros((numbering.count, d), kind), np.zeros(numbering.count)
    for name, patch in patches.items():
        np.add.at(total, numbering.numbers[name], patch.points)
        np.add.at(count, numbering.numbers[name], 1)
    means = total / count[:, None]
    for name, patch in patches.items():
        check_joined_points(means[numbering.numbers[name]], patch.points)
    return {
        name: replace(
            patch,
            control_points=np.where(
                (count[numbering.numbers[name]] > 1)[:, None],
                means[numbering.numbers[name]],
                patch.points,
            ).reshape(patch.control_points.shape),
        )
        for name, patch in patches.items()
    }


def number_control_points(
    patches: Mapping[str, NurbsPatch],
    topology: Topology,
    tolerance: float = _SAME_POINT_TOLERANCE,
) -> CommonNumbering:
    """A common numbering of patches, refined or not, along their seams.

    Parameters
    ----------
    tolerance : by which seams may gape, relative to the part

    Raises
    ------
    InputError : the control points of a seam differ after refinement.
    """
    ends = np.cumsum([0, *(p.weights.size for p in patches.values())])
    own = {
        name: np.arange(a, b)
        for name, a, b in zip(patches, ends[:-1], ends[1:], strict=True)
    }
    pairs = [
        *_join_along_seams(patches, own, topology, tolerance),
        *_join_collapsed(patches, own, topology),
    ]
    i, j = np.concatenate([np.zeros((2, 0), np.int64), *map(np.array, pairs)], axis=1)
    total = int(ends[-1])
    graph = csr_matrix((np.ones(len(i)), (i, j)), shape=(total, total))
    _, classes = connected_components(graph, directed=False)
    _, first, inverse = np.unique(classes, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    numbers = rank[inverse]
    return CommonNumbering({name: numbers[n] for name, n in own.items()}, len(first))


def _join_along_seams(
    patches: Mapping[str, NurbsPatch],
    own: Mapping[str, Indices],
    topology: Topology,
    tolerance: float,
) -> Iterator[tuple[Indices, Indices]]:
    size = largest_extent(patches)
    for seam in topology.seams:
        p, v, m = _side_data(patches, own, seam.first)
        q, w, n = (seam.turn.of(net) for net in _side_data(patches, own, seam.second))
        if not (_are_equal_nets(p, q, tolerance * size) and _are_proportional(v, w)):
            raise _differently_refined(patches, seam)
        yield m.ravel(), n.ravel()


def _side_data(
    patches: Mapping[str, NurbsPatch], own: Mapping[str, Indices], side: Side
) -> list[NDArray[Any]]:
    """Points, weights and numbers of a side."""
    patch = patches[side.patch]
    values = (patch.points, patch.weights.ravel(), own[side.patch])
    return [side_net(patch, side, value) for value in values]


def _differently_refined(patches: Mapping[str, NurbsPatch], seam: Seam) -> InputError:
    """Two sides have the same control points in their file, but not when refined."""
    counts = []
    for side in (seam.first, seam.second):
        shape = patches[side.patch].shape
        counts.append(" x ".join(map(str, side.along(shape))))
    return InputError(
        f"the sides {seam.first.name} and {seam.second.name} are refined differently: "
        f"{counts[0]} and {counts[1]} functions along them",
        place="discretisation",
        expected="equal degrees and knots of both in the file, and the same number of "
        "elements or functions in all directions",
    )


def incompatible_sides(first: Side, second: Side) -> InputError:
    """Two sides lie on each other but are not the same."""
    return InputError(
        f"the sides {first.name} and {second.name} share their corners but not their "
        "control points",
        place="geometry",
        expected="the same control points, weights, degrees and knots on both sides",
    )


def _join_collapsed(
    patches: Mapping[str, NurbsPatch], own: Mapping[str, Indices], topology: Topology
) -> Iterator[tuple[Indices, Indices]]:
    for part in topology.collapsed:
        lines = part.lines(patches[part.patch], own[part.patch])
        rest = lines[1:].reshape(len(lines) - 1, -1)
        yield np.tile(lines[0].ravel(), len(rest)), rest.ravel()


def _direction_maps(k: int) -> list[DirectionMap]:
    return [
        DirectionMap(order, flips)
        for order in permutations(range(k))
        for flips in product((False, True), repeat=k)
    ]


def _are_equal_nets(a: Array, b: Array, distance: float) -> bool:
    if a.shape != b.shape:
        return False
    return bool(np.linalg.norm(a - b, axis=-1).max() <= distance)


def _have_equal_knots(
    patches: Mapping[str, NurbsPatch], first: Side, second: Side, turn: DirectionMap
) -> bool:
    """Check the knots along two sides of equal nets, and so their degrees."""
    own, others = (side.along(patches[side.patch].knots) for side in (first, second))
    for knots, k, is_reversed in zip(own, turn.order, turn.reversed, strict=True):
        its = 1.0 - others[k][::-1] if is_reversed else others[k]
        if len(knots) != len(its) or np.abs(knots - its).max() > _SAME_KNOT_TOLERANCE:
            return False
    return True


def _are_proportional(a: Array, b: Array) -> bool:
    ratio = a / b
    return bool(np.ptp(ratio) <= 1e-9 * ratio.max())
