"""Mass of the part of a solid body beyond a plane, and the section in the plane.

Elements at the plane are divided into simplices (triangles, tetrahedra) in reference
coordinates. Simplices that the plane crosses are clipped there, and their faces in the
plane are the section. This is exact for affine elements; others are subdivided first.
The integrals then do not depend on where the mesh has its nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..geometry.nurbs_patch import NurbsPatch, breakpoints, scattered_basis
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import quadrature_rule, reference_element, shape_of
from .material_points import Continuum
from .matrix_sums import MatrixSum
from .solid_elements import ElementBatch, element_mass, internal_values
from .solid_mesh import InternalInertia, SolidMesh, element_batches, has_internal_modes

Indices = NDArray[np.int64]
#: Values (q, m) and slopes by the reference coordinates (q, m, d) of the functions of
#: an element at reference points (q, d): those of its nodes, and then of its inside.
Functions = Callable[[Array], tuple[Array, Array]]
#: Points (s, d) where edges meet the plane, by their ends (s, d) and the distances (s,)
#: of both ends from it.
Crossing = Callable[[Array, Array, tuple[Array, Array]], Array]

#: Positions this close to the plane lie in it, relative to the size of the body.
_IN_PLANE = 1e-9
#: How often simplices are subdivided where the map of an element is not affine, and
#: steps of the secant method to where an edge meets the plane then.
_SUBDIVISIONS, _SECANTS = {2: 4, 3: 2}, 4
#: Points stay this far from the faces of a knot span, so that they are in it.
_INSET = 1e-12
#: Reference elements as simplices, by their corners.
_SIMPLICES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tri": ((0, 1, 2),),
    "quad": ((0, 1, 2), (0, 2, 3)),
    "tet": ((0, 1, 2, 3),),
    "hex": (
        (0, 1, 2, 6),
        (0, 2, 3, 6),
        (0, 3, 7, 6),
        (0, 7, 4, 6),
        (0, 4, 5, 6),
        (0, 5, 1, 6),
    ),
    "wedge": ((0, 1, 2, 5), (0, 1, 4, 5), (0, 3, 4, 5)),
    "pyramid": ((0, 1, 2, 4), (0, 2, 3, 4)),
}
#: Subdivisions of simplices by their corners and the middles of their edges.
_EDGES = {
    2: ((0, 1), (1, 2), (2, 0)),
    3: ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)),
}
_SUBSIMPLICES = {
    2: ((0, 3, 5), (1, 4, 3), (2, 5, 4), (3, 4, 5)),
    3: (
        (0, 4, 5, 6),
        (1, 4, 7, 8),
        (2, 5, 7, 9),
        (3, 6, 8, 9),
        (4, 5, 6, 8),
        (4, 5, 7, 8),
        (5, 6, 8, 9),
        (5, 7, 8, 9),
    ),
}


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane; for plane bodies a line.

    Attributes
    ----------
    point : (d,) [m]
    normal : (d,) unit vector towards the part beyond
    tolerance : distance of positions that lie in it [m]
    """

    point: Array
    normal: Array
    tolerance: float

    @classmethod
    def through(cls, positions: Array, point: Array, normal: Array) -> Plane:
        """Return the plane through a body with these nodes."""
        size = float(np.ptp(positions, axis=0).max())
        return cls(point, normal / np.linalg.norm(normal), _IN_PLANE * size)

    def signed_distances(self, positions: Array) -> Array:
        """Distances (...) [m] of positions (..., d), positive beyond."""
        return np.asarray((positions - self.point) @ self.normal)

    def snapped_distances(self, positions: Array) -> Array:
        """Signed distances (...) [m] of positions (..., d), zero if in the plane."""
        s = self.signed_distances(positions)
        return np.where(np.abs(s) <= self.tolerance, 0.0, s)


@dataclass(frozen=True, eq=False)
class PartBeyond:
    """The part of a body beyond a plane, and the section in the plane.

    Attributes
    ----------
    scalar_mass : (n, n) integral of rho N_i N_j dV over the part [kg]
    internal_inertia : of internal modes, over the part
    section : (n, n) integral of N_i N_j dA over the section, up to a factor
    """

    scalar_mass: sp.csr_matrix
    internal_inertia: InternalInertia | None
    section: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class ElementGroup:
    """Elements of one kind and density.

    Attributes
    ----------
    batches : yields the elements at the points of the mass, with values (..., m + k) of
        the functions of their m nodes and k internal modes
    density : mass per volume, of a plane body per area
    simplices : (s, d + 1, d) division of the reference element
    degree : of the quadrature on simplices
    functions : those of an element, by its row of `nodes`
    first : number of the first internal mode
    """

    batches: Callable[[], Iterable[ElementBatch]]
    density: float
    simplices: Array
    degree: int
    functions: Callable[[Indices], Functions]
    first: int = 0


def mesh_groups(solids: SolidMesh) -> Iterator[ElementGroup]:
    """The elements of a mesh."""
    first = 0
    for block in solids.mesh.blocks:
        extra = has_internal_modes(block, solids.incompatible_modes)
        element = reference_element(block.kind, "mass")
        corners, d = element.nodes[: element.corners], element.dimension
        order = 1 if len(element.nodes) == element.corners else 2
        simple = shape_of(block.kind) in ("tri", "tet")
        yield ElementGroup(
            batches=_mesh_batches(solids.mesh, block, extra),
            density=solids.materials[block.material].density
            * (block.thickness or solids.thickness),
            simplices=corners[np.array(_SIMPLICES[shape_of(block.kind)])],
            degree=4 * order - 2 if simple else 2 * (order + d),
            functions=_mesh_functions(block.kind, extra),
            first=first,
        )
        if extra:
            modes = internal_values(block.kind, corners).shape[1]
            first += modes * len(block.nodes)


def _mesh_batches(
    mesh: Mesh, block: ElementBlock, extra: bool
) -> Callable[[], Iterable[ElementBatch]]:
    def batches() -> Iterator[ElementBatch]:
        points = reference_element(block.kind, "mass").points
        for batch in element_batches(mesh, block, "mass"):
            if not extra:
                yield batch
                continue
            inner = internal_values(block.kind, points)[None]
            yield replace(batch, values=np.concatenate([batch.values, inner], axis=2))

    return batches


def _mesh_functions(kind: str, extra: bool) -> Callable[[Indices], Functions]:
    def functions(points: Array) -> tuple[Array, Array]:
        values, slopes = reference_element(kind, "mass").at(points)
        if extra:
            values = np.hstack([values, internal_values(kind, points)])
        return values, slopes

    return lambda _: functions


def patch_group(
    patch: NurbsPatch, numbers: Indices, continuum: Continuum, density: float
) -> ElementGroup:
    """The knot spans of a patch.

    Parameters
    ----------
    numbers : of its control points among the nodes of the body
    density : of its material [kg/m^3]
    """
    d = len(patch.degrees)
    ends = [breakpoints(knots) for knots in patch.knots]
    spans = np.array(list(product(*(zip(x[:-1], x[1:], strict=True) for x in ends))))
    basis = scattered_basis(patch, spans.mean(axis=2))
    by_nodes = dict(zip(map(bytes, numbers[basis.nodes]), spans, strict=True))

    def functions(nodes: Indices) -> Functions:
        low, high = by_nodes[bytes(nodes)].T

        def at(points: Array) -> tuple[Array, Array]:
            inside = np.clip(points, _INSET, 1 - _INSET)
            found = scattered_basis(patch, low + inside * (high - low))
            return found.values, found.gradients * (high - low)

        return at

    corners = reference_element("quad4" if d == 2 else "hex8").nodes
    return ElementGroup(
        batches=continuum.batches,
        density=density * continuum.thickness,
        simplices=corners[np.array(_SIMPLICES["quad" if d == 2 else "hex"])],
        degree=2 * d * max(patch.degrees) + 2,
        functions=functions,
    )


def part_beyond(
    groups: Iterable[ElementGroup],
    positions: Array,
    plane: Plane,
    internal: InternalInertia | None,
    chosen: NDArray[np.bool_] | None = None,
) -> PartBeyond:
    """Integrate over the part beyond a plane and over the section.

    Parameters
    ----------
    positions : (n, d) of the nodes [m]
    internal : of the whole body
    chosen : (n,) mask; the elements count that have one of these nodes beyond the plane
    """
    n, d = positions.shape
    mass, section = MatrixSum(n, 1), MatrixSum(n, 1)
    count = 0 if internal is None else internal.own.shape[0]
    mixed, own = sp.csr_matrix((n, count)), sp.csr_matrix((count, count))
    for group in groups:
        start = group.first
        for batch in group.batches():
            masses, which = _batch_beyond(
                group, batch, positions, plane, chosen, section
            )
            nodes, m = batch.nodes[which], batch.nodes.shape[1]
            mass.add(nodes, np.ascontiguousarray(masses[:, :m, :m]))
            k = masses.shape[1] - m
            if k:
                inner = start + which[:, None] * k + np.arange(k)
                mixed = mixed + _scattered(masses[:, :m, m:], nodes, inner, (n, count))
                own = own + _scattered(masses[:, m:, m:], inner, inner, (count, count))
            start += len(batch.nodes) * k
    inner_part = None
    if internal is not None:
        follow, axes = internal.amplitudes, sp.eye_array(d)
        coupled = sp.kron(mixed, axes) @ follow
        square = follow.T @ sp.kron(own, axes) @ follow
        added = sp.csr_matrix(coupled + coupled.T + square)
        inner_part = InternalInertia(follow, mixed, own, added)
    (beyond,), (at_section,) = mass.total(), section.total()
    return PartBeyond(beyond, inner_part, at_section)


def _batch_beyond(
    group: ElementGroup,
    batch: ElementBatch,
    positions: Array,
    plane: Plane,
    chosen: NDArray[np.bool_] | None,
    section: MatrixSum,
) -> tuple[Array, Indices]:
    """Masses (e, m + k, m + k) of the elements with a part beyond, and their rows; the
    integrals over their faces in the plane go to `section`.
    """
    distances = plane.snapped_distances(positions[batch.nodes])
    low, high = distances.min(axis=1), distances.max(axis=1)
    taken: NDArray[np.bool_] = np.ones(len(distances), bool)
    if chosen is not None:
        taken = np.any(chosen[batch.nodes] & (distances > 0), axis=1)
    whole = taken & (low >= 0) & (high > 0)
    rows = [np.flatnonzero(whole)]
    masses = [element_mass(_rows(batch, whole), group.density)]
    for i in np.flatnonzero(taken & (low <= 0) & (high >= 0)):
        functions = group.functions(batch.nodes[i])
        cut = _Cut(functions, positions[batch.nodes[i]], plane, group)
        if cut.meets:
            section.add(batch.nodes[i][None], cut.section()[None])
        if cut.reaches_beyond and not whole[i]:
            masses.append(cut.mass()[None])
            rows.append(np.array([i]))
    return np.concatenate(masses), np.concatenate(rows)


def _rows(batch: ElementBatch, mask: NDArray[np.bool_]) -> ElementBatch:
    values = batch.values if len(batch.values) == 1 else batch.values[mask]
    nodes, measures = batch.nodes[mask], batch.measures[mask]
    return replace(batch, nodes=nodes, values=values, measures=measures)


def _scattered(
    values: Array, rows: Indices, columns: Indices, shape: tuple[int, int]
) -> sp.csr_matrix:
    """Element matrices (e, r, c) at their rows (e, r) and columns (e, c)."""
    first = np.broadcast_to(rows[:, :, None], values.shape).ravel()
    second = np.broadcast_to(columns[:, None], values.shape).ravel()
    return sp.csr_matrix((values.ravel(), (first, second)), shape=shape)


class _Cut:
    """An element that a plane touches or passes through."""

    def __init__(
        self, functions: Functions, nodes: Array, plane: Plane, group: ElementGroup
    ) -> None:
        self._functions, self._nodes, self._group = functions, nodes, group
        self._plane, self._d = plane, nodes.shape[1]
        self._is_curved = False
        simplices = self._divided(group.simplices)
        distances = self._distances_of(simplices)
        self._beyond, ahead = _clipped(simplices, distances, self._crossing)
        _, behind = _clipped(simplices, -distances, self._crossing)
        self._faces = np.concatenate([ahead, behind])

    @property
    def reaches_beyond(self) -> bool:
        """Whether a part of the element lies beyond the plane."""
        return len(self._beyond) > 0

    @property
    def meets(self) -> bool:
        """Whether the element has faces in the plane."""
        return len(self._faces) > 0

    def mass(self) -> Array:
        """(m + k, m + k) integral of density N_i N_j beyond the plane."""
        d, group, inside = self._d, self._group, self._beyond
        rule, weights = quadrature_rule("tri" if d == 2 else "tet", group.degree)
        edges = np.abs(np.linalg.det(inside[:, 1:] - inside[:, :1]))
        points = _points_in(inside, rule)
        values, slopes = self._functions(points)
        jacobians = np.swapaxes(slopes, 1, 2) @ self._nodes
        measures = np.outer(edges, weights).ravel() * np.linalg.det(jacobians)
        return np.asarray(values.T @ (values * (group.density * measures)[:, None]))

    def section(self) -> Array:
        """(m, m) integral of N_i N_j over the section, half of it for each side that
        the element has of the plane.
        """
        d, group, m = self._d, self._group, len(self._nodes)
        faces = self._faces
        rule, weights = quadrature_rule("line" if d == 2 else "tri", group.degree)
        points = _points_in(faces, rule)
        values, slopes = self._functions(points)
        edges = np.repeat(faces[:, 1:] - faces[:, :1], len(rule), axis=0)
        tangents = edges @ (np.swapaxes(slopes, 1, 2) @ self._nodes)
        normals = tangents[:, 0] if d == 2 else np.cross(*np.moveaxis(tangents, 1, 0))
        measures = np.tile(weights, len(faces)) * np.linalg.norm(normals, axis=1)
        nodal = values[:, :m]
        return np.asarray(nodal.T @ (nodal * measures[:, None]) / 2)

    def _positions_at(self, points: Array) -> Array:
        values, _ = self._functions(points)
        return np.asarray(values[:, : len(self._nodes)] @ self._nodes)

    def _distances_of(self, simplices: Array) -> Array:
        positions = self._positions_at(simplices.reshape(-1, self._d))
        return self._plane.snapped_distances(positions).reshape(simplices.shape[:2])

    def _crossing(self, first: Array, last: Array, ends: tuple[Array, Array]) -> Array:
        """(s, d) points of edges in the plane.

        Parameters
        ----------
        first, last : (s, d) ends of the edges
        ends : distances (s,) of both, of different signs
        """
        edge, before, share = last - first, np.zeros(len(first)), _root(0.0, 1.0, *ends)
        distance, sign = np.abs(ends[0]), np.sign(ends[0])
        for _ in range(_SECANTS if self._is_curved and len(first) else 0):
            points = first + share[:, None] * edge
            here = sign * self._plane.signed_distances(self._positions_at(points))
            done = (here == 0) | (here == distance)
            ahead = _root(before, share, distance, np.where(done, distance - 1, here))
            before, distance = share, here
            share = np.where(done, share, np.clip(ahead, 0.0, 1.0))
        return np.asarray(first + share[:, None] * edge)

    def _divided(self, simplices: Array) -> Array:
        """Simplices, subdivided where the distance from the plane is not linear."""
        done, d = [], self._d
        for _ in range(_SUBDIVISIONS[d]):
            ends = self._distances_of(simplices)
            pairs = np.array(_EDGES[d])
            middles = simplices[:, pairs].mean(axis=2)
            deviation = self._distances_of(middles) - ends[:, pairs].mean(axis=2)
            mixed = (ends.min(axis=1) < 0) & (ends.max(axis=1) > 0)
            split = mixed & (np.abs(deviation).max(axis=1) > 3 * self._plane.tolerance)
            self._is_curved |= bool(split.any())
            done.append(simplices[~split])
            every = np.concatenate([simplices, middles], axis=1)[split]
            simplices = every[:, np.array(_SUBSIMPLICES[d])].reshape(-1, d + 1, d)
            if not len(simplices):
                break
        return np.concatenate([*done, simplices])


def _points_in(simplices: Array, rule: Array) -> Array:
    """(s q, d) points of a rule (q, k) on simplices (s, k + 1, d)."""
    shares = np.column_stack([1 - rule.sum(axis=1), rule])
    return np.asarray((shares @ simplices).reshape(-1, simplices.shape[2]))


def _root(a: Any, b: Any, at_a: Array, at_b: Array) -> Array:
    """Zero of the line through values at a and b."""
    return np.asarray(a + (b - a) * at_a / (at_a - at_b))


def _clipped(
    simplices: Array, distances: Array, crossing: Crossing
) -> tuple[Array, Array]:
    """What lies beyond the plane, and its faces in the plane.

    Parameters
    ----------
    simplices : (s, d + 1, d)
    distances : (s, d + 1) of their corners from the plane
    crossing : points of edges in the plane, by their ends and distances

    Returns
    -------
    simplices (v, d + 1, d) and faces (f, d, d)
    """
    d = simplices.shape[2]
    order = np.argsort(-distances, axis=1)
    corners = np.take_along_axis(simplices, order[:, :, None], axis=1)
    ordered = np.take_along_axis(distances, order, axis=1)
    beyond = (ordered > 0).sum(axis=1)
    volumes, faces = [corners[beyond == d + 1]], [np.zeros((0, d, d))]
    for count in range(1, d + 1):
        v, s = (x[beyond == count].swapaxes(0, 1) for x in (corners, ordered))

        def at(i: int, j: int, v: Array = v, s: Array = s) -> Array:
            return crossing(v[i], v[j], (s[i], s[j]))

        below = range(count, d + 1)
        if count == 1:
            cut = [at(0, j) for j in below]
            pieces, sides = [[v[0], *cut]], [cut]
        elif count == d:
            cut = [at(i, d) for i in range(d)]
            pieces, sides = _prism([*v[:d]], cut), [cut]
        else:
            first, second = ([at(i, j) for j in below] for i in range(2))
            pieces = _prism([v[0], *first], [v[1], *second])
            sides = [[*first, second[1]], [first[0], second[1], second[0]]]
        volumes += [np.stack(piece, axis=1) for piece in pieces]
        faces += [np.stack(side, axis=1) for side in sides]
    return np.concatenate(volumes), np.concatenate(faces)


def _prism(first: list[Array], second: list[Array]) -> list[list[Array]]:
    """Simplices of a prism, or in the plane of a quadrilateral, by opposite faces."""
    return [[*first[: k + 1], *second[k:]] for k in range(len(first))]
