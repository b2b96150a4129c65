"""Markers and named edges of a body that is one patch."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from formats.errors import InputError
from formats.model import Marker, ModelFile, NurbsGeometry

from ..geometry.locate import locate
from ..geometry.patch import NurbsPatch, PointBasis, point_basis, side_nodes
from ..vectors import LEVI_CIVITA
from .finite_element_model import MarkerRows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def edge_sets(geometry: NurbsGeometry, patch: NurbsPatch) -> dict[str, Indices]:
    """The nodes of every named edge."""
    names = geometry.edge_names
    return {name: side_nodes(patch, *side) for name, side in names.items()}


def marker_rows(
    model: ModelFile, exact: NurbsPatch, patch: NurbsPatch
) -> tuple[MarkerRows, ...]:
    """Displacement and rotation rows of all markers.

    Parameters
    ----------
    exact : the geometry as given, in which positions are looked up
    patch : the discretised body with the same parameters; its control points carry
        the degrees of freedom

    Raises
    ------
    InputError : a marker lies outside the geometry, or where the patch degenerates.
    """
    rows = []
    for name, marker in model.markers.items():
        try:
            where = _parameters(marker, model.geometry, exact)
            rows.append(_rows(name, marker.node, patch, where))
        except InputError as error:
            raise InputError(
                error.problem, place=f"markers.{name}", expected=error.expected
            ) from None
    return tuple(rows)


def _parameters(marker: Marker, geometry: NurbsGeometry, exact: NurbsPatch) -> Array:
    if marker.position is not None:
        return locate(exact, marker.position)
    if marker.parameters is not None:
        return np.array(marker.parameters)
    assert marker.edge is not None
    direction, end = geometry.edge_names[marker.edge]
    where = np.full(2, marker.at, dtype=float)
    where[direction] = end
    return where


def _rows(name: str, node: int, patch: NurbsPatch, where: Array) -> MarkerRows:
    basis = point_basis(patch, where)
    position = basis.values @ patch.points[basis.nodes]
    return MarkerRows(
        name=name,
        node=node,
        position=np.pad(position, (0, 3 - position.size)),
        displacement=_displacement(basis, patch),
        rotation=_rotation(patch, where),
    )


def _displacement(basis: PointBasis, patch: NurbsPatch) -> sp.csr_matrix:
    d = patch.points.shape[1]
    rows = np.zeros((3, basis.nodes.size, d))
    rows[range(d), :, range(d)] = basis.values
    return _sparse(rows, basis.nodes, patch)


def _rotation(patch: NurbsPatch, where: Array) -> sp.csr_matrix:
    """Half the curl of the displacement, averaged over the spans that meet there."""
    sides = [(False, True) if 0 < x < 1 else (False,) for x in where]
    choices = np.array(np.meshgrid(*sides)).reshape(len(sides), -1).T
    total = sp.csr_matrix((3, patch.points.size))
    for lefts in choices:
        basis = point_basis(patch, where, tuple(lefts))
        total = total + _half_curl(basis, patch)
    return sp.csr_matrix(total / len(choices))


def _half_curl(basis: PointBasis, patch: NurbsPatch) -> sp.csr_matrix:
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
    rows = 0.5 * np.einsum("abc,mb->amc", LEVI_CIVITA[:, :d, :d], gradients)
    return _sparse(rows, basis.nodes, patch)


def _sparse(rows: Array, nodes: Indices, patch: NurbsPatch) -> sp.csr_matrix:
    """(3, m, d) coefficients at some nodes as (3, ndof)."""
    d = rows.shape[2]
    columns = (nodes[:, None] * d + np.arange(d)).ravel()
    index = (np.repeat(np.arange(3), columns.size), np.tile(columns, 3))
    matrix = sp.csr_matrix((rows.ravel(), index), shape=(3, patch.points.size))
    matrix.eliminate_zeros()
    return matrix
