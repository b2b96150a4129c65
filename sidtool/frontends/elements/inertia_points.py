"""Particles with rotary inertia: lumped masses and quadrature points of beams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InertiaPoints:
    """Rigid particles that the degrees of freedom carry along.

    Attributes
    ----------
    positions : (p, 3) in the axes of the model [m]
    masses : (p,) [kg]
    inertias : (p, 3, 3) about the particles themselves, axes of the model [kg m^2]
    displacement : (3 p, ndof) sparse; displacements of the particles = rows @ u
    rotation : (3 p, ndof) sparse; their small rotations = rows @ u
    """

    positions: Array
    masses: Array
    inertias: Array
    displacement: sp.csr_matrix
    rotation: sp.csr_matrix

    def mass_matrix(self) -> sp.csr_matrix:
        """(ndof, ndof) their share of the mass matrix."""
        weights = sp.diags_array(np.repeat(self.masses, 3))
        tensors = sp.block_diag([sp.csr_array(J) for J in self.inertias], format="csr")
        moved = self.displacement.T @ weights @ self.displacement
        return sp.csr_matrix(moved + self.rotation.T @ tensors @ self.rotation)
