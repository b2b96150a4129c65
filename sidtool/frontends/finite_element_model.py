"""What every frontend yields: a discretised body before its reduction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MarkerRows:
    """A named point and the rows that evaluate the motion there.

    Attributes
    ----------
    name, node : its name in the model file and its node number in the SID
    position : (3,) in the axes of the model [m]
    displacement : (3, ndof) sparse; displacement of the point = rows @ u
    rotation : (3, ndof) sparse; right-handed small rotation of the point = rows @ u
    """

    name: str
    node: int
    position: Array
    displacement: sp.csr_matrix
    rotation: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class FiniteElementModel:
    """Nodes (or control points) with mass and stiffness.

    Degree of freedom ``d * i + a`` is the displacement of node i along axis a. The
    field of positions lies in the space of the displacements: a point of the body is
    sum_i N_i X_i, its displacement sum_i N_i u_i.

    Attributes
    ----------
    positions : (n, d) with d = 2 or 3 [m]
    scalar_mass : (n, n) sparse, integral of rho N_i N_j dV [kg]; the mass matrix is
        the Kronecker product with the d x d identity
    stiffness : (d n, d n) sparse, symmetric [N/m]
    node_sets : name -> node numbers; the edges among them
    markers : in the order of the model file
    """

    positions: Array
    scalar_mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    node_sets: Mapping[str, Indices]
    markers: tuple[MarkerRows, ...]

    @property
    def dimension(self) -> int:
        """Number of displacement components of a node."""
        return self.positions.shape[1]

    @property
    def ndof(self) -> int:
        """Number of degrees of freedom."""
        return self.positions.size

    @property
    def mass(self) -> sp.csr_matrix:
        """(ndof, ndof) mass matrix."""
        return sp.csr_matrix(sp.kron(self.scalar_mass, sp.eye_array(self.dimension)))

    def marker(self, name: str) -> MarkerRows:
        """The marker with this name."""
        return next(marker for marker in self.markers if marker.name == name)

    def dofs(self, nodes: Indices) -> Indices:
        """The degrees of freedom of some nodes, node by node."""
        axes = np.arange(self.dimension)
        return (nodes[:, None] * self.dimension + axes).ravel()
