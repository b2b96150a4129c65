"""Markers at points of patches.

Markers of a mesh: the elements that contain them, and the rows of their motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import number_type, numbers, without_rounding
from sidtool.formats.base.errors import InputError, errors_inside
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


def name_marker_in_errors(name: str) -> AbstractContextManager[None]:
    """Name a marker in errors that are raised inside the context."""
    return errors_inside(f"markers.{name}")


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
    return _sparse_rows([rows], [basis.nodes], patch.points.size)


def _gradient_rows(patch: NurbsPatch, where: Array) -> sp.csr_matrix:
    """(9, ndof) row 3 a + b: derivative of u_a by x_b, averaged over adjacent spans."""
    sides = [(False, True) if 0 < x < 1 else (False,) for x in where]
    choices = np.array(np.meshgrid(*sides)).reshape(len(sides), -1).T
    spans = [point_basis(patch, where, tuple(lefts)) for lefts in choices]
    rows = [_span_gradient(basis, patch) for basis in spans]
    total = _sparse_rows(rows, [basis.nodes for basis in spans], patch.points.size)
    return sp.csr_matrix(total / len(spans))


def _degenerates(jacobian: Array) -> bool:
    """Whether its columns, tangents of the geometry, are dependent or one has no length
    beside the others.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    least = 1e-10 * lengths.max()
    flat = abs(np.linalg.det(jacobian)) <= 1e-10 * lengths.prod()
    return bool(flat or lengths.min() <= least)


def _span_gradient(basis: PointBasis, patch: NurbsPatch) -> Array:
    """(9, m, d) by the control points of one span."""
    nodes = patch.points[basis.nodes]
    jacobian = nodes.T @ basis.gradients
    if _degenerates(jacobian):
        raise InputError(
            "the geometry degenerates here, so that a rotation is not defined",
            expected="a place where the two parameter lines cross at an angle",
        )
    return _gradient_by_nodes(basis.gradients @ np.linalg.inv(jacobian), None)


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
        self, name: str, node: int, target: Array, holders: list[_HoldingElement]
    ) -> MarkerRows:
        ndof, share = self.mesh.positions.size, 1 / len(holders)
        gradients = [holder.gradient() for holder in holders]
        strains = [
            holder.strain_gradient(gradient)
            for holder, gradient in zip(holders, gradients, strict=True)
        ]
        nodes = [holder.nodes for holder in holders]
        inner = [holder.internal_displacement() for holder in holders]
        nodal = _sparse_rows(_rounded([holders[0].displacement()]), nodes[:1], ndof)
        inside, gradient, strain = (
            _sparse_rows(_rounded(parts), nodes, ndof)
            for parts in (inner, gradients, strains)
        )
        return MarkerRows(
            name=name,
            node=node,
            position=np.pad(target, (0, 3 - self.mesh.dimension)),
            displacement=sp.csr_matrix(nodal + inside * share),
            rotation=half_curl(gradient * share),
            gradient=strain * share,
            nodal=nodal if inside.nnz else None,
        )

    def _holding_elements(self, target: Array) -> list[_HoldingElement]:
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
                    continuum = self._continua[number] if self._continua else None
                    own = self.mesh, continuum, block, int(row), where
                    holders.append(_HoldingElement(*own))
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


@dataclass(frozen=True, eq=False)
class _HoldingElement:
    """An element around a point, and rows of the motion there by its m nodes.

    Attributes
    ----------
    continuum : material of its block, for internal modes
    row : of the element in its block
    where : (d,) the point in the reference element
    """

    mesh: Mesh
    continuum: Continuum | None
    block: ElementBlock
    row: int
    where: Array

    @property
    def nodes(self) -> Indices:
        return self.block.nodes[self.row]

    def displacement(self) -> Array:
        """(3, m, d) by the nodes."""
        values, _ = reference_element(self.block.kind).at(self.where[None])
        d = self.mesh.dimension
        rows = np.zeros((3, len(self.nodes), d), values.dtype)
        rows[range(d), :, range(d)] = values[0]
        return rows

    def internal_displacement(self) -> Array:
        """(3, m, d) by the internal modes."""
        d, values = self.mesh.dimension, np.zeros(0)
        dtype = number_type(self.mesh.positions, self.where)
        rows = np.zeros((3, len(self.nodes), d), dtype)
        if self._has_internal_modes:
            values = internal_values(self.block.kind, self.where[None])[0]
        if np.abs(values).max(initial=0.0) > _PARAMETER_TOLERANCE:
            amplitudes = self._amplitudes[: len(values)]
            rows = rows.astype(number_type(rows, amplitudes))
            rows[:d] = np.einsum("k,kcmd->cmd", values, amplitudes)
        return rows

    def gradient(self) -> Array:
        """(9, m, d) of the displacement gradient.

        Raises
        ------
        InputError : the geometry degenerates.
        """
        element = reference_element(self.block.kind)
        _, gradients = element.at(self.where[None])
        jacobian = self.mesh.positions[self.nodes].T @ gradients[0]
        if _degenerates(jacobian):
            raise InputError(
                "the geometry degenerates here, so that a rotation is not defined",
                expected="a place where the edges of the element cross at an angle",
            )
        inverse, inside = np.linalg.inv(jacobian), None
        if self._has_internal_modes:
            slopes = internal_gradients(element.name, self.where[None])[0] @ inverse
            inside = slopes, self._amplitudes[: len(slopes)]
        return _gradient_by_nodes(gradients[0] @ inverse, inside)

    def strain_gradient(self, plain: Array) -> Array:
        """(9, m, d) of the gradient of its stiffness; by default `plain`."""
        relieved = self._has_internal_modes
        shares = extrapolation(self.block.kind, self.where, relieved=relieved)
        if shares is None:
            return plain
        one, inside = self._batch, None
        if one.internal is not None:
            slopes = np.einsum("g,gkb->kb", shares, one.internal[0])
            inside = slopes, self._amplitudes
        slopes = np.einsum("g,gmd->md", shares, one.gradients[0])
        return _gradient_by_nodes(slopes, inside)

    @property
    def _has_internal_modes(self) -> bool:
        return self.continuum is not None and self.continuum.internal_modes

    @cached_property
    def _batch(self) -> ElementBatch:
        """The element at the points of its stiffness."""
        nodes, labels = self.block.nodes[[self.row]], self.block.labels[[self.row]]
        alone = ElementBlock(self.block.kind, nodes, labels)
        laws = self.continuum.laws_at if self.continuum is not None else None
        relieved = self._has_internal_modes
        (one,) = element_batches(self.mesh, alone, relieved=relieved, laws=laws)
        return one

    @cached_property
    def _amplitudes(self) -> Array:
        """(k, d, m, d) internal modes by the nodes."""
        assert self.continuum is not None
        flat = internal_amplitudes(self._batch, self.continuum.law)[0]
        *_, m, d = self._batch.gradients.shape
        return flat.reshape(-1, d, m, d)


def _gradient_by_nodes(slopes: Array, inside: tuple[Array, Array] | None) -> Array:
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
        before, where = where, np.clip(where + step, -0.5, 1.5)
        if np.abs(where - before).max() < 1e-13:
            break
    values, _ = element.at(where[None])
    return where, float(np.linalg.norm(target - values[0] @ corners))


def _rounded(parts: Sequence[Array]) -> list[Array]:
    """Without entries that are rounding beside the largest one of their part."""
    return [without_rounding(part, 1e-12 * np.abs(part).max()) for part in parts]


def _sparse_rows(
    parts: Sequence[Array], nodes: Sequence[Indices], ndof: int
) -> sp.csr_matrix:
    """(k, ndof) sum of coefficients (k, m, d) at some nodes (m,) each."""
    values, rows, columns = [], [], []
    for part, of_part in zip(parts, nodes, strict=True):
        k, _, d = part.shape
        values.append(part.ravel())
        own = (of_part[:, None] * d + np.arange(d)).ravel()
        rows.append(np.repeat(np.arange(k), own.size))
        columns.append(np.tile(own, k))
    index = np.concatenate(rows), np.concatenate(columns)
    shape = len(parts[0]), ndof
    matrix = sp.csr_matrix((np.concatenate(values), index), shape=shape)
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
