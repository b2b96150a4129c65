"""Checks that elements meet only in common nodes: overlaps, hanging nodes, conformity.

Only faces that belong to one element are examined: across a face that two elements
share from both sides, the number of elements that cover a point does not change.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import element_edges, element_faces, reference_element

Indices = NDArray[np.int64]
PairFilter = Callable[[Indices, Indices], NDArray[np.bool_]]

_ITERATIONS = 12
#: Tolerance of the search, relative to the radius of an element.
_INSIDE_TOLERANCE = 1e-6
#: Factor for the sums of shape functions between the points at which they are known.
_BETWEEN_POINTS = 1.1
#: Number of pairs of points and elements that are examined together.
_PAIRS_PER_BATCH = 200_000

#: Depth of samples of a face inside its element, as a fraction of the way to the
#: centre.
_SAMPLE_DEPTH = 0.05
#: Positions of samples between the centre of a face and its corners.
_SAMPLE_POSITIONS = (0.0, 0.8)
#: Tolerance in parameters for nodes on the face of an element.
_CONTACT_TOLERANCE = 1e-5


class ElementFinder:
    """Search for the elements that contain given points."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self.centres: list[Array] = []
        self.radii: list[Array] = []
        self._affine: list[_AffineMaps] = []
        for block in mesh.blocks:
            corners = mesh.positions[block.nodes]
            centre = corners.mean(axis=1)
            self.centres.append(centre)
            radii = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
            self.radii.append(radii)
            self._affine.append(
                _AffineMaps(block.kind, corners, _INSIDE_TOLERANCE * radii)
            )

    def holders(
        self,
        points: Array,
        block: int,
        rows: Indices,
        slack: float,
        is_requested: PairFilter,
    ) -> Iterator[tuple[Indices, Indices]]:
        """Yield pairs of a point and an element of a block that contains it.

        Parameters
        ----------
        rows : elements that are searched
        slack : in the parameters of the element, negative for its interior only
        is_requested : returns which pairs of points and elements need an answer
        """
        from scipy.spatial import cKDTree

        if not len(rows) or not len(points):
            return
        tree = cKDTree(points)
        reach = self.radii[block][rows] * (1 + 1e-6)
        centres = self.centres[block][rows]
        near = tree.query_ball_point(centres, reach, return_sorted=False)
        counts = np.fromiter(map(len, near), np.int64, len(near))
        element = np.repeat(rows, counts)
        point = np.fromiter(chain.from_iterable(near), np.int64, counts.sum())
        for start in range(0, len(point), _PAIRS_PER_BATCH):
            i, row = (
                point[start : start + _PAIRS_PER_BATCH],
                element[start : start + _PAIRS_PER_BATCH],
            )
            near = self._affine[block].may_contain(points[i], row, slack)
            i, row = i[near], row[near]
            is_wanted = is_requested(i, row)
            i, row = i[is_wanted], row[is_wanted]
            held = self._pairs_inside(points[i], block, row, slack)
            yield i[held], row[held]

    def _pairs_inside(
        self, points: Array, block: int, rows: Indices, slack: float
    ) -> NDArray[np.bool_]:
        kind = self._mesh.blocks[block].kind
        elements = self._mesh.blocks[block].nodes
        held = np.zeros(len(rows), bool)
        for i in np.array_split(np.arange(len(rows)), 1 + len(rows) // 20_000):
            nodes = self._mesh.positions[elements[rows[i]]]
            where, miss = _invert_maps(kind, nodes, points[i])
            inside = reference_element(kind).excess(where) <= slack
            close = miss < _INSIDE_TOLERANCE * self.radii[block][rows[i]]
            held[i] = inside & close
        return held


class _AffineMaps:
    """Affine maps that are tangent to elements of a kind at their centres. The
    deviation of a point of an element is that of its nodes, interpolated by the shape
    functions: the sum of their sizes bounds it.
    """

    def __init__(self, kind: str, nodes: Array, close: Array) -> None:
        """Make the maps of nodes (k, m, d), for points that may be `close` (k,) to
        elements.
        """
        self._element = reference_element(kind)
        self._centre = self._element.nodes.mean(axis=0)
        values, gradients = self._element.at(self._centre[None])
        self._middle = _interpolate(values, nodes)
        jacobians = np.swapaxes(nodes, 1, 2) @ gradients
        flat = ~(np.abs(np.linalg.det(jacobians)) > 0)
        jacobians[flat] = np.eye(nodes.shape[2])
        self._inverses = np.linalg.inv(jacobians)
        local_nodes = (nodes - self._middle[:, None]) @ np.swapaxes(
            self._inverses, 1, 2
        )
        off = np.abs(local_nodes + self._centre - self._element.nodes).max(axis=(1, 2))
        off += close * np.linalg.norm(self._inverses, axis=(1, 2))
        self._margins = np.where(flat, np.inf, self._deviation_bound() * off)

    def _deviation_bound(self) -> float:
        """How much more a point may lie outside for each deviation 1 of the nodes:
        `excess` adds up to d components.
        """
        element = self._element
        points = np.vstack([element.nodes, element.points, self._centre[None]])
        sums = np.abs(element.at(points)[0]).sum(axis=1)
        return float(element.dimension * _BETWEEN_POINTS * sums.max())

    def may_contain(
        self, points: Array, rows: Indices, slack: float
    ) -> NDArray[np.bool_]:
        """Whether points (k, d) may lie in elements (k,); False if they cannot."""
        arms = points - self._middle[rows]
        where = self._centre + (self._inverses[rows] @ arms[..., None])[..., 0]
        return np.asarray(self._element.excess(where) <= slack + self._margins[rows])


def _invert_maps(kind: str, nodes: Array, points: Array) -> tuple[Array, Array]:
    """Return parameters (k, d) of points (k, d) in elements (k, m, d), and the residual
    distance.
    """
    element = reference_element(kind)
    where = np.tile(element.nodes.mean(axis=0), (len(points), 1))
    values, gradients = element.at(where[:1])
    active = np.arange(len(points))
    for _ in range(_ITERATIONS):
        corners = nodes[active]
        jacobians = np.swapaxes(corners, 1, 2) @ gradients
        safe = np.abs(np.linalg.det(jacobians)) > 0
        jacobians[~safe] = np.eye(nodes.shape[2])
        miss = points[active] - _interpolate(values, corners)
        step = np.linalg.solve(jacobians, miss[..., None])[..., 0]
        before = where[active]
        where[active] = np.clip(before + step, -0.5, 1.5)
        active = active[np.abs(where[active] - before).max(axis=1) > 1e-10]
        if not active.size:
            break
        values, gradients = element.at(where[active])
    values, _ = element.at(where)
    return where, np.linalg.norm(points - _interpolate(values, nodes), axis=1)


def _interpolate(values: Array, nodes: Array) -> Array:
    """(k, d) of nodes (k, m, d) by shape functions (k or 1, m)."""
    return np.asarray((values[:, None] @ nodes)[:, 0])


_NO_INDICES = np.zeros(0, np.int64)


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


def check_contact(mesh: Mesh, place: str, held: Indices = _NO_INDICES) -> None:
    """Check that elements touch each other only in whole faces, edges and nodes.

    Parameters
    ----------
    held : nodes in equations, which may lie on elements

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
        faces: list[tuple[int, ...]] = [
            *element_faces(block.kind, 3),
            *element_faces(block.kind, 4),
        ]
        if mesh.dimension == 2:
            faces = [edge[:2] for edge in element_edges(block.kind)]
        rows = np.arange(len(block.nodes))
        for face in faces:
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
    keys = np.vstack([_face_key(part.corners, width) for part in every])
    sizes = np.cumsum([0, *(len(part.rows) for part in every)])
    inverse, counts = _equal_rows(keys, len(mesh.positions))
    crowded = np.flatnonzero(counts > 2)
    if crowded.size:
        raise _raise_shared_face(mesh, every, inverse == crowded[0], place)
    sides = np.concatenate(
        [_face_sides(mesh, part, keys[s:]) for s, part in _face_position(every)]
    )
    total = np.bincount(inverse, sides)
    same = np.flatnonzero((counts == 2) & (np.abs(total) == 2))
    if same.size:
        raise _raise_shared_face(mesh, every, inverse == same[0], place)
    alone = counts[inverse] == 1
    for i, part in enumerate(every):
        is_free = alone[sizes[i] : sizes[i + 1]]
        yield _Faces(
            part.block, part.rows[is_free], part.corners[is_free], part.local[is_free]
        )


def _equal_rows(keys: Indices, count: int) -> tuple[Indices, Indices]:
    """Numbers of the groups of equal rows (k, 3 or 4), and the size of each group.

    Parameters
    ----------
    keys : from -1 to `count` - 1; two of them make one number, which sorts faster
    """
    first, second = (
        (keys[:, i] + 1) * (count + 1) + keys[:, j] for i, j in ((0, 1), (-2, -1))
    )
    order = np.lexsort((first, second))
    is_other = (np.diff(first[order]) != 0) | (np.diff(second[order]) != 0)
    group = np.concatenate([[0], np.cumsum(is_other)])
    inverse = np.empty_like(group)
    inverse[order] = group
    return inverse, np.bincount(group)


def _raise_shared_face(
    mesh: Mesh, parts: list[_Faces], chosen: NDArray[np.bool_], place: str
) -> InputError:
    names = []
    for start, part in _face_position(parts):
        rows = part.rows[chosen[start : start + len(part.rows)]]
        names += [_element_label(mesh, part.block, row) for row in rows]
    return _raise_overlap(names[0], names[1], place)


def _face_position(parts: list[_Faces]) -> Iterator[tuple[int, _Faces]]:
    start = 0
    for part in parts:
        yield start, part
        start += len(part.rows)


def _face_key(corners: Indices, width: int) -> Indices:
    """Sorted corners, as many columns for every kind of face."""
    key = np.full((len(corners), width), -1, np.int64)
    key[:, width - corners.shape[1] :] = np.sort(corners, axis=1)
    return np.sort(key, axis=1)


def _face_sides(mesh: Mesh, part: _Faces, keys: Indices) -> Array:
    """Return the side of each face on which its element lies, for sorted corners."""
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
    """Check that no point just inside a free face lies in another element."""
    for number in range(len(mesh.blocks)):
        faces = [part for part in outer if part.block == number and len(part.rows)]
        if not faces:
            continue
        found = [_points_inside_faces(mesh, part) for part in faces]
        points, owners = (np.concatenate(parts) for parts in zip(*found, strict=True))
        for block in range(len(mesh.blocks)):
            rows = np.arange(len(mesh.blocks[block].nodes))
            own = owners if block == number else np.full(len(owners), -1)
            others = partial(_is_other_node, own)
            for point, row in finder.holders(points, block, rows, -1e-3, others):
                if len(row):
                    owner = _element_label(mesh, number, owners[point[0]])
                    raise _raise_overlap(
                        owner, _element_label(mesh, block, row[0]), place
                    )


def _is_other_node(owners: Indices, point: Indices, row: Indices) -> NDArray[np.bool_]:
    return np.asarray(owners[point] != row)


def _points_inside_faces(mesh: Mesh, part: _Faces) -> tuple[Array, Indices]:
    """Points just inside some faces, and the rows of their elements."""
    block = mesh.blocks[part.block]
    values = _functions_inside_face(block.kind, tuple(part.local[0].tolist()))
    nodes = mesh.positions[block.nodes[part.rows]]
    points = np.einsum("gm,kmd->kgd", values, nodes)
    return points.reshape(-1, mesh.dimension), np.repeat(part.rows, len(values))


@cache
def _functions_inside_face(kind: str, face: tuple[int, ...]) -> Array:
    """(g, m) shape functions at points just inside a face, by its corners."""
    element = reference_element(kind)
    corners = element.nodes[list(face)]
    middle = corners.mean(axis=0)
    on_face = np.array(
        [middle + t * (c - middle) for t in _SAMPLE_POSITIONS for c in corners]
    )
    on_face = np.unique(np.round(on_face, 12), axis=0)
    centre = element.nodes[: element.corners].mean(axis=0)
    values, _ = element.at(on_face + _SAMPLE_DEPTH * (centre - on_face))
    return values


def _check_hanging(
    mesh: Mesh,
    outer: list[_Faces],
    finder: ElementFinder,
    place: str,
    held: Indices,
) -> None:
    """Check that no node of a free face lies on another element without belonging to
    it.
    """
    is_outer = np.zeros(len(mesh.positions), bool)
    for part in outer:
        is_outer[_all_nodes(mesh, part)] = True
    is_outer[held] = False
    nodes = np.flatnonzero(is_outer)
    for number, block in enumerate(mesh.blocks):
        rows = np.unique(np.concatenate([p.rows for p in outer if p.block == number]))
        is_hanging = partial(_is_hanging, mesh, block, nodes, finder.radii[number])
        points = mesh.positions[nodes]
        for point, row in finder.holders(
            points, number, rows, _CONTACT_TOLERANCE, is_hanging
        ):
            if len(row):
                _raise_hanging(mesh, nodes[point], block, row, place)


def _is_hanging(
    mesh: Mesh,
    block: ElementBlock,
    nodes: Indices,
    size: Array,
    i: Indices,
    row: Indices,
) -> NDArray[np.bool_]:
    """Return whether a node does not belong to an element and coincides with none of
    its nodes.
    """
    own, node = block.nodes[row], nodes[i]
    other = (own != node[:, None]).all(axis=1)
    gaps = mesh.positions[own[other]] - mesh.positions[node[other]][:, None]
    near = np.linalg.norm(gaps, axis=2) < 1e-4 * size[row[other]][:, None]
    other[other] = ~near.any(axis=1)
    return other


def _all_nodes(mesh: Mesh, part: _Faces) -> Indices:
    """The nodes of the elements behind some faces; those inside are found as well."""
    return mesh.blocks[part.block].nodes[part.rows]


def _raise_hanging(
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


def _raise_overlap(one: str, other: str, place: str) -> InputError:
    return InputError(
        f"elements {one} and {other} cover the same place, which would count twice",
        place=place,
        expected="every place covered once",
    )


def _element_label(mesh: Mesh, block: int, row: int) -> str:
    block_of_element = mesh.blocks[block]
    return f"{block_of_element.labels[row]} ({block_of_element.kind})"


def check_conforming(mesh: Mesh, place: str, straight: Indices | None = None) -> None:
    """Check that a mixed mesh conforms, as the patch test requires.

    Linear and quadratic elements must not share an edge, nor may triangular faces lie
    on a quadrilateral one, which needs a pyramid between them.

    Parameters
    ----------
    straight : mid-side nodes that move by the mean of the ends, as edges of linear
        elements do

    Raises
    ------
    InputError : the mesh does not conform.
    """
    if len({block.kind for block in mesh.blocks}) < 2:
        return
    _check_edges(mesh, place, np.zeros(0, int) if straight is None else straight)
    _check_faces(mesh, place)


def _check_edges(mesh: Mesh, place: str, straight: Indices) -> None:
    """Check that all elements at an edge have the same mid-side node."""
    rows = []
    for block in mesh.blocks:
        for a, b, middle in element_edges(block.kind):
            ends = np.sort(block.nodes[:, [a, b]], axis=1)
            between = block.nodes[:, middle] if middle >= 0 else np.full(len(ends), -1)
            between = np.where(np.isin(between, straight), -1, between)
            rows.append(np.column_stack([ends, between]))
    table = np.unique(np.concatenate(rows), axis=0)
    bad = np.flatnonzero((table[1:, :2] == table[:-1, :2]).all(axis=1))
    if bad.size:
        raise InputError(
            "linear and quadratic elements meet at the edge between nodes "
            f"{_node_labels(mesh, table[bad[0], :2])}",
            place=place,
            expected="elements of one order, or linear ones apart from quadratic ones",
        )


def _check_faces(mesh: Mesh, place: str) -> None:
    """Check that no triangular face has three corners of a quadrilateral one."""
    squares = np.concatenate([*_triangular_faces(mesh, 4), np.zeros((0, 4), np.int64)])
    triangles = np.concatenate(
        [*_triangular_faces(mesh, 3), np.zeros((0, 3), np.int64)]
    )
    parts = [squares[:, list(corners)] for corners in combinations(range(4), 3)]
    covered = np.unique(np.sort(np.concatenate(parts), axis=1), axis=0)
    alone = np.unique(np.sort(triangles, axis=1), axis=0)
    both, counts = np.unique(np.vstack([covered, alone]), axis=0, return_counts=True)
    bad = both[counts > 1]
    if bad.size:
        raise InputError(
            "a triangular face lies on a quadrilateral one at nodes "
            f"{_node_labels(mesh, bad[0])}",
            place=place,
            expected="pyramids or wedges between hexahedra and tetrahedra, or elements "
            "of one kind",
        )


def _triangular_faces(mesh: Mesh, corners: int) -> Iterable[Indices]:
    for block in mesh.blocks:
        for face in element_faces(block.kind, corners):
            yield block.nodes[:, list(face)]


def _node_labels(mesh: Mesh, nodes: Indices) -> str:
    known = mesh.labels if mesh.labels.size else np.arange(len(mesh.positions)) + 1
    return ", ".join(str(known[node]) for node in nodes)
