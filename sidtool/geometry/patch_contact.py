"""Patches that meet without a seam: sides on parts of other sides, and overlaps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .multipatch import (
    CollapsedSide,
    CommonNumbering,
    Seam,
    Side,
    Topology,
    find_topology,
    incompatible_sides,
    largest_extent,
    number_control_points,
    side_net,
    sides_of,
)
from .nurbs_patch import (
    NurbsPatch,
    PatchContent,
    evaluate_grid,
    evaluate_points,
    scattered_basis,
)
from .patch_evaluation import may_be_inside, nearest_parameters

#: Points per direction at which sides and patches are compared, by the dimension.
_SAMPLES_PER_DIRECTION = {2: 65, 3: 13}
#: Distance at which a point is on a side, or inside a patch, relative to the part.
_CONTACT_TOLERANCE = 1e-6
#: Sides with common corners and a smaller distance, relative to their size, are
#: reported as intended to be equal.
_NEARLY_EQUAL_TOLERANCE = 0.02


@dataclass(frozen=True)
class WeakTie:
    """A side that lies wholly on another one."""

    slave: Side
    master: Side


@dataclass(frozen=True)
class _Geometry:
    """Patches and their topology, equal to others of the same numbers.

    Attributes
    ----------
    content : names, degrees, knots, control points and weights of all patches
    """

    content: tuple[object, ...]
    seams: tuple[Seam, ...]
    collapsed: tuple[CollapsedSide, ...]
    tolerance: float
    patches: Mapping[str, NurbsPatch] = field(compare=False)


def weak_ties(
    patches: Mapping[str, NurbsPatch], topology: Topology, tolerance: float
) -> list[WeakTie]:
    """The sides without a seam that lie on another one.

    Raises
    ------
    InputError : two sides touch and neither lies wholly on the other, or they are
        nearly the same.
    """
    content = [
        (name, p.degrees, p.control_points.shape, *map(np.ndarray.tobytes, arrays))
        for name, p in patches.items()
        for arrays in [(*p.knots, p.control_points, p.weights)]
    ]
    seams, collapsed = topology.seams, topology.collapsed
    geometry = _Geometry(tuple(content), seams, collapsed, tolerance, dict(patches))
    return list(_weak_ties(geometry))


@lru_cache(maxsize=64)
def _weak_ties(geometry: _Geometry) -> tuple[WeakTie, ...]:
    """Compare the sides; searches for a mesh discretise one geometry many times."""
    patches, tolerance = geometry.patches, geometry.tolerance
    seamed = {side for seam in geometry.seams for side in (seam.first, seam.second)}
    seamed |= {
        Side(part.patch, *part.fixed[0])
        for part in geometry.collapsed
        if len(part.fixed) == 1
    }
    free_sides = [side for side in sides_of(patches) if side not in seamed]
    near = max(tolerance, _CONTACT_TOLERANCE) * largest_extent(patches)
    ties: list[WeakTie] = []
    for a, b in combinations(free_sides, 2):
        if not _boxes_overlap(patches, a, b, near):
            continue
        there = _side_distances(patches, a, b, near)
        back = _side_distances(patches, b, a, near)
        on_a, on_b = back <= near, there <= near
        if on_b.all():
            ties.append(WeakTie(a, b))
        elif on_a.all():
            ties.append(WeakTie(b, a))
        elif on_a.any() or on_b.any():
            raise InputError(
                f"the sides {a.name} and {b.name} touch in part, and neither lies "
                "wholly on the other",
                place="geometry",
                expected="sides that are the same, or one that lies wholly on the "
                "other, which is tied weakly: split one of the patches",
            )
        elif a.patch != b.patch and _are_nearly_equal_sides(patches, a, b, there, near):
            raise incompatible_sides(a, b)
    return tuple(ties)


def grid_numbers(
    exact: NurbsPatch, grid: NurbsPatch, *, same_sense: bool = False
) -> CommonNumbering:
    """A common numbering of points of one patch, under the name "geometry".

    Points of sides that are the same are one, as are those of collapsed sides.

    Parameters
    ----------
    grid : the points, as control points of a bilinear or trilinear patch
    same_sense : whether seams must join opposite sides without a turn

    Raises
    ------
    InputError : sides touch otherwise, or their points do not match.
    """
    patches = {"geometry": exact}
    topology = find_topology(patches)
    ties = weak_ties(patches, topology, 0.0)
    if ties:
        raise InputError(
            f"the side {ties[0].slave.name} lies on a part of {ties[0].master.name}",
            place="geometry",
            expected='sides that are the same, or discretisation.type = "iga", which '
            "ties them",
        )
    for seam in topology.seams:
        crosses = seam.first.direction != seam.second.direction
        if same_sense and (crosses or any(seam.turn.reversed)):
            raise InputError(
                f"the sides {seam.first.name} and {seam.second.name} are the same in "
                "another sense, so that the faces of tetrahedra do not match",
                place="geometry",
                expected="hexahedra or iga",
            )
    return number_control_points({"geometry": grid}, topology)


def check_overlaps(patches: Mapping[str, NurbsPatch]) -> None:
    """Check that patches do not overlap.

    Raises
    ------
    InputError : points of one patch lie inside another.
    """
    _check_overlaps(PatchContent.of(patches))


@lru_cache(maxsize=16)
def _check_overlaps(content: PatchContent) -> None:
    patches = content.patches
    size = largest_extent(patches)
    slack = _CONTACT_TOLERANCE * size
    every = {
        name: evaluate_grid(p, _parameter_samples(p)) for name, p in patches.items()
    }
    for a, b in permutations(patches, 2):
        low, high = patches[b].points.min(axis=0), patches[b].points.max(axis=0)
        points = every[a].reshape(-1, len(low))
        points = points[((points > low + slack) & (points < high - slack)).all(axis=1)]
        points = points[may_be_inside(patches[b], points)]
        if not len(points):
            continue
        parameters, nearest = nearest_parameters(patches[b], points)
        there = np.linalg.norm(nearest - points, axis=1) <= 1e-9 * size
        inside = there & (_distance_to_sides(patches[b], parameters) > slack)
        if inside.any():
            where = ", ".join(f"{x:.4g}" for x in points[inside][0])
            raise InputError(
                f"patches {a} and {b} overlap near ({where}): mass and stiffness "
                "would count twice there",
                place="geometry",
                expected="patches that meet at their sides only",
            )


def check_connected(numbering: CommonNumbering, ties: list[WeakTie]) -> None:
    """Check that all patches are connected.

    Raises
    ------
    InputError : a patch is not connected; the error names it.
    """
    names = list(numbering.numbers)
    pairs = [
        (i, len(names) + n)
        for i, name in enumerate(names)
        for n in np.unique(numbering.numbers[name])
    ]
    pairs += [(names.index(t.slave.patch), names.index(t.master.patch)) for t in ties]
    rows, columns = np.array(pairs).T
    graph = csr_matrix(
        (np.ones(len(rows)), (rows, columns)), shape=(len(names) + numbering.count,) * 2
    )
    _, label = connected_components(graph, directed=False)
    separate = [n for n, x in zip(names, label, strict=False) if x != label[0]]
    if separate:
        raise InputError(
            f"patch {separate[0]} is not joined to patch {names[0]}",
            place="geometry",
            expected="patches that share whole sides, or of which one has a side that "
            "lies wholly on one of the other",
        )


def _parameter_samples(patch: NurbsPatch) -> tuple[Array, ...]:
    """Parameters all over a patch, by direction."""
    count = _SAMPLES_PER_DIRECTION[len(patch.degrees)]
    return tuple(np.linspace(0, 1, count) for _ in patch.degrees)


@lru_cache(maxsize=8)
def _side_samples(patch: NurbsPatch, side: Side) -> tuple[Array, Array]:
    """Parameters (n, k) inside one side, and their points (n, d)."""
    axes = [axis[1:-1] for axis in _parameter_samples(patch)]
    axes[side.direction] = np.array([float(side.end)])
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
    return grid, evaluate_points(patch, grid)


def _side_distances(
    patches: Mapping[str, NurbsPatch], a: Side, b: Side, near: float
) -> Array:
    """Return distances of points inside side a from side b; infinite where they cross,
    and where they are farther than `near` and than sides that are nearly equal.
    """
    reach = max(near, _NEARLY_EQUAL_TOLERANCE * _side_size(patches, a))
    first, second = patches[a.patch], patches[b.patch]
    grid, points = _side_samples(first, a)
    distances = np.full(len(points), np.inf)
    hull = _side_control_points(patches, b)
    low, high = hull.min(axis=0) - reach, hull.max(axis=0) + reach
    close = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    if not close.size:
        return distances
    parameters, nearest = nearest_parameters(
        second, points[close], (b.direction, b.end), reach
    )
    off = np.linalg.norm(nearest - points[close], axis=1)
    across = b.along(range(parameters.shape[1]))
    inside = ((parameters[:, across] > 0) & (parameters[:, across] < 1)).all(axis=1)
    kept = inside & (off <= reach)
    if not kept.any():
        return distances
    close, parameters = close[kept], parameters[kept]
    normals = _normals(first, grid[close], a), _normals(second, parameters, b)
    along = np.abs(np.einsum("nd,nd->n", *normals)) > 0.5
    distances[close[along]] = off[kept][along]
    return distances


def _normals(patch: NurbsPatch, parameters: Array, side: Side) -> Array:
    """Unit normals (n, d) of a side at parameters (n, k)."""
    basis = scattered_basis(patch, parameters)
    corners = patch.points[basis.nodes]
    jacobians = np.einsum("nmd,nmk->ndk", corners, basis.gradients)
    normals = np.linalg.pinv(jacobians)[:, side.direction]
    lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return np.asarray(normals / lengths)


def _boxes_overlap(
    patches: Mapping[str, NurbsPatch], a: Side, b: Side, near: float
) -> bool:
    boxes = []
    for side in (a, b):
        points = _side_control_points(patches, side)
        boxes.append((points.min(axis=0) - near, points.max(axis=0) + near))
    (low, high), (other_low, other_high) = boxes
    return bool((low <= other_high).all() and (other_low <= high).all())


def _side_control_points(patches: Mapping[str, NurbsPatch], side: Side) -> Array:
    patch = patches[side.patch]
    net = side_net(patch, side, patch.points)
    return net.reshape(-1, net.shape[-1])


def _are_nearly_equal_sides(
    patches: Mapping[str, NurbsPatch], a: Side, b: Side, there: Array, near: float
) -> bool:
    """Whether two sides share their corners and run close to each other."""
    corners = []
    for side in (a, b):
        net = side_net(patches[side.patch], side, patches[side.patch].points)
        ends = np.ix_(*((0, -1) for _ in net.shape[:-1]))
        corners.append(net[ends].reshape(-1, net.shape[-1]))
    off = np.linalg.norm(corners[0][:, None] - corners[1], axis=2).min(axis=1)
    limit = _NEARLY_EQUAL_TOLERANCE * _side_size(patches, a)
    return bool(off.max() <= near and there.max() < limit)


def _side_size(patches: Mapping[str, NurbsPatch], side: Side) -> float:
    return float(np.ptp(_side_control_points(patches, side), axis=0).max())


def _distance_to_sides(patch: NurbsPatch, parameters: Array) -> Array:
    """About how far points are from the sides of the patch."""
    basis = scattered_basis(patch, parameters)
    corners = patch.points[basis.nodes]
    lengths = np.linalg.norm(
        np.einsum("nmd,nmk->ndk", corners, basis.gradients), axis=1
    )
    depths: Array = (np.minimum(parameters, 1 - parameters) * lengths).min(axis=1)
    return depths
