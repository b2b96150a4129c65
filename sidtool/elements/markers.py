"""Markers at points of patches.

Markers of a mesh: the elements that contain them, and the rows of their motion.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import number_type, numbers, without_rounding
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import ModelFile, NodeMarker

from ..geometry.nurbs_patch import NurbsPatch, PointBasis, point_basis
from ..geometry.patch_evaluation import locate
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import ReferenceElement, reference_element
from .finite_element_model import (
    FiniteElementModel,
    MarkerRows,
    moving_dofs,
    offset_marker,
)
from .material_points import Continuum, half_curl
from .solid_elements import (
    ElementBatch,
    extrapolation,
    internal_amplitudes,
    internal_gradients,
    internal_values,
)
from .solid_mesh import element_batches

Indices = NDArray[np.int64]

_ITERATIONS = 30
#: Slack in reference coordinates within which a point counts as inside an element.
_PARAMETER_TOLERANCE = 1e-6
#: Number of candidate elements for the nearest point of the mesh.
_CANDIDATE_ELEMENTS = 48
#: Number of a block, row of an element in it, point in the reference element.
_Holder = tuple[int, int, Array]


def markers_with_position(
    markers: Mapping[str, NodeMarker],
) -> Iterator[tuple[str, NodeMarker]]:
    """Return the markers with a position on the body; ties define the others."""
    for name, marker in markers.items():
        own = (marker.edge, marker.parameters, marker.mesh_node)
        in_frame = (marker.point, marker.member)
        if any(way is not None for way in (*own, *in_frame)) or (
            marker.position is not None and marker.tie is None
        ):
            yield name, marker


@contextmanager
def name_marker_in_errors(name: str) -> Iterator[None]:
    """Name a marker in errors that are raised inside the context."""
    try:
        yield
    except InputError as error:
        place = f"markers.{name}" + (f".{error.place}" if error.place else "")
        raise InputError(error.problem, place=place, expected=error.expected) from None


def marker_parameters(
    marker: NodeMarker, edges: Mapping[str, tuple[int, int]], exact: NurbsPatch
) -> Array:
    """The parameters (k,) of a marker on a patch.

    Raises
    ------
    InputError : it lies outside, or its numbers do not fit the patch.
    """
    k = len(exact.degrees)
    if marker.mesh_node is not None:
        raise InputError("is for meshes", place="mesh_node", expected="another place")
    if marker.position is not None:
        check_length(marker.position, k, "position")
        return locate(exact, marker.position)
    if marker.parameters is not None:
        check_length(marker.parameters, k, "parameters")
        return numbers(marker.parameters)
    assert marker.edge is not None and not isinstance(marker.at, str | None)
    direction, end = edges[marker.edge]
    at = marker.at if isinstance(marker.at, tuple) else (marker.at,)
    check_length(at, k - 1, "at")
    return np.insert(numbers(at), direction, end)


def check_length(values: tuple[float, ...], count: int, place: str) -> None:
    """Check that a marker has as many coordinates as the body has directions."""
    if len(values) != count:
        raise InputError(
            f"has {len(values)} numbers", place=place, expected=f"{count} of them"
        )


def rows_at(name: str, node: int, patch: NurbsPatch, where: Array) -> MarkerRows:
    """The rows of a marker at parameters (k,) of a patch."""
    basis = point_basis(patch, where)
    gradient = _gradient_rows(patch, where)
    position = basis.values @ patch.points[basis.nodes]
    return MarkerRows(
        name=name,
        node=node,
        position=np.pad(position, (0, 3 - position.size)),
        displacement=_displacement_rows(basis, patch),
        rotation=half_curl(gradient),
        gradient=gradient,
    )


def _displacement_rows(basis: PointBasis, patch: NurbsPatch) -> sp.csr_matrix:
    d = patch.points.shape[1]
    rows = np.zeros((3, basis.nodes.size, d), basis.values.dtype)
    rows[range(d), :, range(d)] = basis.values
    return _sparse_matrix(rows, basis.nodes, patch)


def _gradient_rows(patch: NurbsPatch, where: Array) -> sp.csr_matrix:
    """(9, ndof) row 3 a + b: derivative of u_a by x_b, averaged over adjacent spans."""
    sides = [(False, True) if 0 < x < 1 else (False,) for x in where]
    choices = np.array(np.meshgrid(*sides)).reshape(len(sides), -1).T
    total = sp.csr_matrix((9, patch.points.size))
    for lefts in choices:
        basis = point_basis(patch, where, tuple(lefts))
        total = total + _span_gradient(basis, patch)
    return sp.csr_matrix(total / len(choices))


def _degenerates(jacobian: Array) -> bool:
    """Whether its columns, tangents of the geometry, are dependent or one has no length
    beside the others.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    least = 1e-10 * lengths.max()
    flat = abs(np.linalg.det(jacobian)) <= 1e-10 * lengths.prod()
    return bool(flat or lengths.min() <= least)


def _span_gradient(basis: PointBasis, patch: NurbsPatch) -> sp.csr_matrix:
    nodes = patch.points[basis.nodes]
    jacobian = nodes.T @ basis.gradients
    if _degenerates(jacobian):
        raise InputError(
            "the geometry degenerates here, so that a rotation is not defined",
            expected="a place where the two parameter lines cross at an angle",
        )
    gradients = basis.gradients @ np.linalg.inv(jacobian)
    d = nodes.shape[1]
    rows = np.zeros((3, 3, basis.nodes.size, d), gradients.dtype)
    for axis in range(d):
        rows[axis, :d, :, axis] = gradients.T
    return _sparse_matrix(rows.reshape(9, -1, d), basis.nodes, patch)


def _sparse_matrix(rows: Array, nodes: Indices, patch: NurbsPatch) -> sp.csr_matrix:
    """(k, m, d) coefficients at some nodes as (k, ndof)."""
    k, _, d = rows.shape
    columns = (nodes[:, None] * d + np.arange(d)).ravel()
    index = (np.repeat(np.arange(k), columns.size), np.tile(columns, k))
    matrix = sp.csr_matrix((rows.ravel(), index), shape=(k, patch.points.size))
    matrix.eliminate_zeros()
    return matrix


def position_of(mesh: Mesh, marker: NodeMarker) -> Array:
    """Return the position of a marker of an imported mesh.

    Raises
    ------
    InputError : the marker is given by parameters or a side, or by an unknown node.
    """
    if marker.mesh_node is not None:
        return mesh.positions[_row_of_node(mesh, marker.mesh_node)]
    if marker.position is None:
        raise InputError("a mesh has no parameters", expected="position or mesh_node")
    check_length(marker.position, mesh.dimension, "position")
    return np.array(marker.position)


def _row_of_node(mesh: Mesh, label: int) -> int:
    rows = np.flatnonzero(mesh.labels == label)
    if not rows.size:
        raise InputError(
            f"the mesh has no node {label}",
            place="mesh_node",
            expected="a node that an element uses; of a tied marker any node",
        )
    return int(rows[0])


class MeshPoints:
    """Search for the elements of a mesh around given points."""

    def __init__(self, mesh: Mesh, continua: tuple[Continuum, ...] = ()) -> None:
        """`continua` are the materials of the blocks, for their internal modes."""
        self.mesh = mesh
        self._continua = continua
        positions = mesh.positions.real
        self._size = float(np.ptp(positions, axis=0).max())
        self._boxes = [_bounding_boxes(positions[block.nodes]) for block in mesh.blocks]

    def rows(self, name: str, node: int, position: ArrayLike) -> MarkerRows:
        """The rows of a marker: displacement there, and half the curl of the
        displacement, averaged over the elements that meet there.

        Internal modes move and turn the marker, too: without them an arm would be a
        chain of straight pieces between its nodes, and where only one element is, as
        at a loaded end, rotations would be of first order in its size.

        Raises
        ------
        InputError : no element holds the point.
        """
        target = numbers(position)
        holders = self._holding_elements(target)
        if not holders:
            raise self._outside(target)
        return self._rows(name, node, target, holders)

    def rows_of_nearest_point(
        self, name: str, node: int, position: ArrayLike
    ) -> MarkerRows:
        """Return the rows of a marker of a geometry that the mesh approximates.

        Facets cut corners of curved faces. A marker outside the mesh keeps its position
        and moves as a rigid arm of the nearest point of the mesh.
        """
        target = numbers(position)
        holders = self._holding_elements(target)
        if holders:
            return self._rows(name, node, target, holders)
        foot = self._nearest_point(target)
        return offset_marker(
            self._rows(name, node, foot, self._holding_elements(foot)), target
        )

    def _rows(
        self, name: str, node: int, target: Array, holders: list[_Holder]
    ) -> MarkerRows:
        d, ndof = self.mesh.dimension, self.mesh.positions.size
        gradient, strain = sp.csr_matrix((9, ndof)), sp.csr_matrix((9, ndof))
        nodal, inside = self._nodal_rows(*holders[0]), sp.csr_matrix((3, ndof))
        for holder in holders:
            own = self._gradient(*holder)
            gradient = gradient + own
            strain = strain + self._strain_gradient(*holder, own)
            inside = inside + self._internal_rows(*holder)
        share = 1 / len(holders)
        return MarkerRows(
            name=name,
            node=node,
            position=np.pad(target, (0, 3 - d)),
            displacement=sp.csr_matrix(nodal + inside * share),
            rotation=half_curl(sp.csr_matrix(gradient * share)),
            gradient=sp.csr_matrix(strain * share),
            nodal=nodal if inside.nnz else None,
        )

    def _holding_elements(self, target: Array) -> list[_Holder]:
        holders = []
        for number, block in enumerate(self.mesh.blocks):
            element = reference_element(block.kind)
            for row in np.flatnonzero(self._box_distances(number, target) == 0):
                corners = self.mesh.positions[block.nodes[row]]
                where, distance = _invert_map(element, corners, target)
                if (
                    distance < 1e-9 * self._size
                    and element.excess(where) < _PARAMETER_TOLERANCE
                ):
                    holders.append((number, int(row), where))
        return holders

    def _box_distances(self, number: int, target: Array) -> Array:
        """(ne,) distances to the boxes around the elements of a block."""
        low, high = self._boxes[number]
        gaps: Array = np.linalg.norm(
            np.maximum(np.maximum(low - target, target - high), 0), axis=1
        )
        return gaps

    def _nearest_point(self, target: Array) -> Array:
        """A point of the mesh that is nearest, or nearly so."""
        gaps = [self._box_distances(i, target) for i in range(len(self.mesh.blocks))]
        limit = np.sort(np.concatenate(gaps))[:_CANDIDATE_ELEMENTS][-1]
        best, distance = target, np.inf
        for block, gap in zip(self.mesh.blocks, gaps, strict=True):
            element = reference_element(block.kind)
            for row in np.flatnonzero(gap <= limit):
                corners = self.mesh.positions[block.nodes[row]]
                where = element.clamped(_invert_map(element, corners, target)[0])
                foot = element.at(where[None])[0][0] @ corners
                if np.linalg.norm(foot - target) < distance:
                    best, distance = foot, float(np.linalg.norm(foot - target))
        return best

    def _outside(self, target: Array) -> InputError:
        text = ", ".join(f"{x:.6g}" for x in target)
        off = ((self.mesh.positions - target) ** 2).sum(axis=1)
        closest = ", ".join(f"{x:.6g}" for x in self.mesh.positions[off.argmin()])
        return InputError(
            f"({text}) lies in no element",
            expected=f"a point of the mesh; the nearest node is at ({closest})",
        )

    def _nodal_rows(self, number: int, row: int, where: Array) -> sp.csr_matrix:
        """(3, ndof) displacement by the nodes of one element."""
        block, d = self.mesh.blocks[number], self.mesh.dimension
        values, _ = reference_element(block.kind).at(where[None])
        rows = np.zeros((3, block.nodes.shape[1], d), values.dtype)
        rows[range(d), :, range(d)] = values[0]
        return _sparse_rows(rows, block.nodes[row], self.mesh.positions.size)

    def _internal_rows(self, number: int, row: int, where: Array) -> sp.csr_matrix:
        """(3, ndof) displacement by the internal modes of one element."""
        nodes, d = self.mesh.blocks[number].nodes[row], self.mesh.dimension
        values = internal_values(self.mesh.blocks[number].kind, where[None])[0]
        rows = np.zeros((3, len(nodes), d), number_type(self.mesh.positions, where))
        if (
            self._has_incompatible_modes(number)
            and np.abs(values).max() > _PARAMETER_TOLERANCE
        ):
            amplitudes = self._amplitudes(number, self._element(number, row))
            amplitudes = amplitudes[: len(values)]
            rows = rows.astype(number_type(rows, amplitudes))
            rows[:d] = np.einsum("k,kcmd->cmd", values, amplitudes)
        return _sparse_rows(rows, nodes, self.mesh.positions.size)

    def _gradient(self, number: int, row: int, where: Array) -> sp.csr_matrix:
        nodes = self.mesh.blocks[number].nodes[row]
        element = reference_element(self.mesh.blocks[number].kind)
        _, gradients = element.at(where[None])
        jacobian = self.mesh.positions[nodes].T @ gradients[0]
        if _degenerates(jacobian):
            raise InputError(
                "the geometry degenerates here, so that a rotation is not defined",
                expected="a place where the edges of the element cross at an angle",
            )
        inverse, inside = np.linalg.inv(jacobian), None
        if self._has_incompatible_modes(number):
            one = self._element(number, row)
            slopes = internal_gradients(element.name, where[None])[0] @ inverse
            inside = slopes, self._amplitudes(number, one)[: len(slopes)]
        rows = _mesh_gradient_rows(gradients[0] @ inverse, inside)
        return _sparse_rows(rows, nodes, self.mesh.positions.size)

    def _strain_gradient(
        self, number: int, row: int, where: Array, plain: sp.csr_matrix
    ) -> sp.csr_matrix:
        """Return the gradient (9, ndof) of the stiffness of one element."""
        block, relieved = self.mesh.blocks[number], self._has_incompatible_modes(number)
        shares = extrapolation(block.kind, where, relieved=relieved)
        if shares is None:
            return plain
        one, inside = self._element(number, row), None
        if one.internal is not None:
            slopes = np.einsum("g,gkb->kb", shares, one.internal[0])
            inside = slopes, self._amplitudes(number, one)
        slopes = np.einsum("g,gmd->md", shares, one.gradients[0])
        rows = _mesh_gradient_rows(slopes, inside)
        return _sparse_rows(rows, block.nodes[row], self.mesh.positions.size)

    def _has_incompatible_modes(self, number: int) -> bool:
        """Whether the elements of a block have internal modes."""
        return bool(self._continua) and self._continua[number].internal_modes

    def _element(self, number: int, row: int) -> ElementBatch:
        """One element at the points of its stiffness."""
        block = self.mesh.blocks[number]
        alone = ElementBlock(block.kind, block.nodes[[row]], block.labels[[row]])
        relieved = self._has_incompatible_modes(number)
        laws = self._continua[number].laws_at if self._continua else None
        (one,) = element_batches(self.mesh, alone, relieved=relieved, laws=laws)
        return one

    def _amplitudes(self, number: int, one: ElementBatch) -> Array:
        """(k, d, m, d) internal modes of an element by its nodes."""
        flat = internal_amplitudes(one, self._continua[number].law)[0]
        *_, m, d = one.gradients.shape
        return flat.reshape(-1, d, m, d)


def _mesh_gradient_rows(slopes: Array, inside: tuple[Array, Array] | None) -> Array:
    """(9, m, d) gradient by the displacements of the nodes.

    Parameters
    ----------
    slopes : (m, d) of the functions of the nodes [1/m]
    inside : (k, d) slopes of internal modes, and (k, d, m, d) what these are
    """
    m, d = slopes.shape
    rows = np.zeros((3, 3, m, d), number_type(slopes, *(inside or ())))
    for axis in range(d):
        rows[axis, :d, :, axis] = slopes.T
    if inside is not None:
        rows[:d, :d] += np.einsum("kb,kcmd->cbmd", *inside)
    return rows.reshape(9, m, d)


def _bounding_boxes(corners: Array) -> tuple[Array, Array]:
    """(ne, d) lower and upper ends of boxes around elements, bowed edges included."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = 0.1 * (high - low).max(axis=1, keepdims=True)
    return low - slack, high + slack


def _invert_map(
    element: ReferenceElement, corners: Array, target: Array
) -> tuple[Array, float]:
    """Reference point whose image is nearest to the target, and the distance."""
    where = element.nodes.mean(axis=0)
    for _ in range(_ITERATIONS):
        values, gradients = element.at(where[None])
        miss = target - values[0] @ corners
        jacobian = corners.T @ gradients[0]
        step = np.linalg.lstsq(jacobian, miss, rcond=None)[0]
        where = np.clip(where + step, -0.5, 1.5)
        if np.abs(step).max() < 1e-13:
            break
    values, _ = element.at(where[None])
    return where, float(np.linalg.norm(target - values[0] @ corners))


def _sparse_rows(rows: Array, nodes: Indices, ndof: int) -> sp.csr_matrix:
    """(k, m, d) coefficients at some nodes as (k, ndof)."""
    k, _, d = rows.shape
    rows = without_rounding(rows, 1e-12 * np.abs(rows).max())
    columns = (nodes[:, None] * d + np.arange(d)).ravel()
    index = (np.repeat(np.arange(k), columns.size), np.tile(columns, k))
    matrix = sp.csr_matrix((rows.ravel(), index), shape=(k, ndof))
    matrix.eliminate_zeros()
    return matrix


def markers_as_nodes(body: FiniteElementModel, model: ModelFile) -> FiniteElementModel:
    """Return the body whose markers inside clamped or rigid faces move with these
    faces. The internal modes of an element do not vanish between fixed nodes: a marker
    there would move in the frame that it defines.
    """
    if all(marker.nodal is None for marker in body.markers):
        return body
    fixed = getattr(model.reduction, "fixed_names", ())
    clamped = (*getattr(model.frame, "clamped_edges", ()), *fixed)
    sets = [body.node_sets[name] for name in clamped if name in body.node_sets]
    groups = [np.concatenate(sets)] if sets else []
    held = [np.zeros(body.ndof, bool) for _ in (*groups, *body.rigid_sets)]
    for dofs, nodes in zip(held, (*groups, *body.rigid_sets.values()), strict=True):
        dofs[body.dofs(nodes)] = True
    markers = tuple(_as_nodal_marker(marker, held) for marker in body.markers)
    return replace(body, markers=markers)


def _as_nodal_marker(marker: MarkerRows, held: list[NDArray[np.bool_]]) -> MarkerRows:
    nodal = marker.nodal
    if nodal is None or not any(dofs[moving_dofs(nodal)].all() for dofs in held):
        return marker
    return replace(marker, displacement=nodal, nodal=None)
