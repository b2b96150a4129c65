"""Equations between the displacements of a body, which its admissible motions meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations that no rigid motion of the body breaks.

    Attributes
    ----------
    matrix : (k, ndof) sparse; ``matrix @ u = 0``
    dependent : (k,) the degree of freedom that each gives if it can
    """

    matrix: sp.csr_matrix
    dependent: NDArray[np.int64]
