"""Points of a mesh: which element holds them, and the rows of markers there."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from formats.errors import InputError
from formats.model import Marker

from .continuum import half_curl
from .finite_element_model import MarkerRows
from .mesh import ElementBlock, Mesh
from .reference_elements import ReferenceElement, reference_element

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_ITERATIONS = 30
#: Slack in reference coordinates within which a point counts as inside an element.
_SLACK = 1e-6


class MeshPoints:
    """Finds the elements of a mesh around given points."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._tree = cKDTree(mesh.positions)
        self._size = float(np.ptp(mesh.positions, axis=0).max())

    def node(self, label: int) -> int:
        """The row of a node by its number in the file.

        Raises
        ------
        InputError : there is none.
        """
        found = np.flatnonzero(self.mesh.labels == label)
        if not found.size:
            raise InputError(
                f"the mesh has no node {label}",
                place="mesh_node",
                expected="a node that an element uses",
            )
        return int(found[0])

    def position_of(self, marker: Marker) -> Array:
        """Where a marker of an imported mesh is.

        Raises
        ------
        InputError : it is given by parameters or a side, or by an unknown node.
        """
        if marker.mesh_node is not None:
            return self.mesh.positions[self.node(marker.mesh_node)]
        if marker.position is None:
            raise InputError(
                "a mesh has no parameters", expected="position or mesh_node"
            )
        if len(marker.position) != self.mesh.dimension:
            raise InputError(
                f"has {len(marker.position)} numbers",
                place="position",
                expected=f"{self.mesh.dimension} of them",
            )
        return np.array(marker.position)

    def rows(self, name: str, node: int, position: ArrayLike) -> MarkerRows:
        """The rows of a marker: displacement there, and half the curl of the
        displacement, averaged over the elements that meet there.

        Raises
        ------
        InputError : no element holds the point.
        """
        target = np.asarray(position, float)
        found = self._holders(target)
        d, ndof = self.mesh.dimension, self.mesh.positions.size
        block, row, where = found[0]
        values, _ = reference_element(block.kind).at(where[None])
        nodes = block.nodes[row]
        coefficients = np.zeros((3, len(nodes), d))
        coefficients[range(d), :, range(d)] = values[0]
        gradient = sp.csr_matrix((9, ndof))
        for holder in found:
            gradient = gradient + _gradient(self.mesh, *holder)
        gradient = sp.csr_matrix(gradient * (1 / len(found)))
        return MarkerRows(
            name=name,
            node=node,
            position=np.pad(values[0] @ self.mesh.positions[nodes], (0, 3 - d)),
            displacement=_sparse(coefficients, nodes, ndof),
            rotation=half_curl(gradient),
            gradient=gradient,
        )

    def _holders(self, target: Array) -> list[tuple[ElementBlock, int, Array]]:
        _, near = self._tree.query(target, k=min(8, len(self.mesh.positions)))
        found = []
        best = np.inf
        for block in self.mesh.blocks:
            element = reference_element(block.kind)
            touching = np.isin(block.nodes, np.atleast_1d(near)).any(axis=1)
            for row in np.flatnonzero(touching):
                corners = self.mesh.positions[block.nodes[row]]
                where, distance = _inverse(element, corners, target)
                best = min(best, distance)
                if distance < 1e-9 * self._size and element.excess(where) < _SLACK:
                    found.append((block, int(row), where))
        if not found:
            text = ", ".join(f"{x:.6g}" for x in target)
            closest = self.mesh.positions[np.atleast_1d(near)[0]]
            raise InputError(
                f"({text}) lies in no element",
                expected="a point of the mesh; the nearest node is at ("
                + ", ".join(f"{x:.6g}" for x in closest)
                + ")",
            )
        return found

    def snapped(self, target: Array) -> Array:
        """The point itself, or the nearest node if the mesh only comes near to it.

        Meshes sample curved faces, so that points on these may lie outside.
        """
        try:
            self._holders(target)
        except InputError:
            return self.mesh.positions[self._tree.query(target)[1]]
        return target


def _inverse(
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


def _gradient(mesh: Mesh, block: ElementBlock, row: int, where: Array) -> sp.csr_matrix:
    nodes = block.nodes[row]
    _, gradients = reference_element(block.kind).at(where[None])
    jacobian = mesh.positions[nodes].T @ gradients[0]
    slopes = gradients[0] @ np.linalg.inv(jacobian)
    d = mesh.dimension
    rows = np.zeros((3, 3, len(nodes), d))
    for axis in range(d):
        rows[axis, :d, :, axis] = slopes.T
    return _sparse(rows.reshape(9, -1, d), nodes, mesh.positions.size)


def _sparse(rows: Array, nodes: Indices, ndof: int) -> sp.csr_matrix:
    """(k, m, d) coefficients at some nodes as (k, ndof)."""
    k, _, d = rows.shape
    rows = np.where(np.abs(rows) < 1e-12 * np.abs(rows).max(), 0.0, rows)
    columns = (nodes[:, None] * d + np.arange(d)).ravel()
    index = (np.repeat(np.arange(k), columns.size), np.tile(columns, k))
    matrix = sp.csr_matrix((rows.ravel(), index), shape=(k, ndof))
    matrix.eliminate_zeros()
    return matrix
