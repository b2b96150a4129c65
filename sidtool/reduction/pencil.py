"""An eigenproblem as the eigensolvers take it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pencil:
    """K v = lambda M v with conditions on v.

    Attributes
    ----------
    stiffness, mass : (n, n)
    shift : about which the spectrum is inverted [1/s^2]
    constraints : (k, n) ``constraints @ v = 0``
    rigid : (n, r) known vectors of the eigenvalue 0
    """

    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    shift: float
    constraints: Array
    rigid: Array

    @property
    def shifted(self) -> sp.csr_matrix:
        """K - shift M."""
        if self.shift == 0.0:
            return self.stiffness
        return self.stiffness - self.shift * self.mass
