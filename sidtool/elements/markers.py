"""Markers at points of patches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.model import NodeMarker

from ..geometry.nurbs_patch import NurbsPatch, PointBasis, point_basis
from ..geometry.patch_evaluation import locate
from .finite_element_model import MarkerRows
from .material_points import half_curl

Indices = NDArray[np.int64]


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


def _span_gradient(basis: PointBasis, patch: NurbsPatch) -> sp.csr_matrix:
    nodes = patch.points[basis.nodes]
    jacobian = nodes.T @ basis.gradients
    scale = np.linalg.norm(jacobian, axis=0).prod()
    if abs(np.linalg.det(jacobian)) <= 1e-10 * scale:
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
