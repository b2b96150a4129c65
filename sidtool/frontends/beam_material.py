"""The material behind the stiffness of beams: strains at their quadrature points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BeamMaterial:
    """Points on the axes of beams, in the axes of the beam there.

    Attributes
    ----------
    weights : (p,) length of each point [m]
    strains : (6 p, ndof) sparse; stretch, shears xy and xz, twist and curvatures about
        y and z of every point = rows @ u
    turns : (3 p, ndof) sparse; rotation of the cross-section
    shear_forces : (2 p, ndof) sparse; along y and z, from the change of the moments [N]
    stretching, twisting : (p,) E A [N] and G It [N m^2]
    bending : (p, 2) E Iy and E Iz [N m^2]
    gyration : (p, 2) Iy / A and Iz / A [m^2]
    """

    weights: Array
    strains: sp.csr_matrix
    turns: sp.csr_matrix
    shear_forces: sp.csr_matrix
    stretching: Array
    twisting: Array
    bending: Array
    gyration: Array

    def strains_of(self, fields: Array) -> Array:
        """(p, 6, n) of displacements (ndof, n)."""
        return self._by_point(self.strains @ fields)

    def turns_of(self, fields: Array) -> Array:
        """(p, 3, n) of displacements (ndof, n)."""
        return self._by_point(self.turns @ fields)

    def shear_forces_of(self, fields: Array) -> Array:
        """(p, 2, n) of displacements (ndof, n)."""
        return self._by_point(self.shear_forces @ fields)

    def _by_point(self, rows: Array) -> Array:
        return rows.reshape(len(self.weights), -1, rows.shape[1])
