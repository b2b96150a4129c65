"""The material behind the stiffness of beams: strains at their quadrature points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BeamMaterial:
    """Points on the axes of beams, in the axes of the section there.

    Attributes
    ----------
    weights : (p,) length of each point [m]
    strains : (6 p, ndof) sparse; stretch, shears xy and xz, twist and curvatures about
        y and z of every point = rows @ u
    turns : (3 p, ndof) sparse; rotation of the cross-section
    resultants : (6 p, ndof) sparse; N, Qy, Qz [N], T, My, Mz [N m]
    gyration : (p, 2) Iy / A and Iz / A [m^2]
    curvatures : (p, 3) of the beam at rest: twist, about y and z [rad/m]
    """

    weights: Array
    strains: sp.csr_matrix
    turns: sp.csr_matrix
    resultants: sp.csr_matrix
    gyration: Array
    curvatures: Array

    def strains_of(self, fields: Array) -> Array:
        """(p, 6, n) of displacements (ndof, n)."""
        return self._by_point(self.strains @ fields)

    def turns_of(self, fields: Array) -> Array:
        """(p, 3, n) of displacements (ndof, n)."""
        return self._by_point(self.turns @ fields)

    def resultants_of(self, fields: Array) -> Array:
        """(p, 6, n) of displacements (ndof, n)."""
        return self._by_point(self.resultants @ fields)

    def _by_point(self, rows: Array) -> Array:
        return rows.reshape(len(self.weights), -1, rows.shape[1])
