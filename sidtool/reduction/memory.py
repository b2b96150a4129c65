"""How much memory an eigenproblem will take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .factors import engine_name

Array = NDArray[np.float64]

#: Bytes per unknown of the matrices and vectors, and of the factors: in the plane times
#: log2(n), in space times n^(1/3). Fitted to benchmarks/scale.py.
_MATRICES = {2: 1100.0, 3: 1900.0}
_FACTORS = {
    "superlu": {2: 100.0, 3: 500.0},
    "cholmod": {2: 50.0, 3: 180.0},
    "pardiso": {2: 75.0, 3: 190.0},
    "slepc": {2: 70.0, 3: 180.0},
}
#: Interpreter and libraries.
_BASE = 0.15e9


def expected_gigabytes(positions: Array, ndof: int) -> float:
    """Peak memory of a reduction, to about a tenth for SuperLU and solids.

    Separators of slender and flat parts are small: the factors grow with the cube root
    of what a cube would have times that of its thickness. Herting's method on hex8 by
    SuperLU, measured: 22 x 22 x 22 elements 0.80 GB (0.83 expected), 60 x 24 x 8
    0.84 GB (0.83), 120 x 12 x 8 0.77 GB (0.79).

    Parameters
    ----------
    positions : (n, d) nodes [m]
    """
    dimension = positions.shape[1]
    growth = np.log2(ndof)
    if dimension == 3:
        growth = (ndof * _thickness(positions)) ** (1 / 3)
    per_unknown = _MATRICES[dimension] + _FACTORS[engine_name()][dimension] * growth
    return float(_BASE + ndof * per_unknown) / 1e9


def _thickness(positions: Array) -> float:
    """Of a part beside a cube of its volume: 1 for a cube, 0.4 for 15 x 1.5 x 1."""
    if len(positions) < 2:
        return 1.0
    spread = np.linalg.eigvalsh(np.cov(positions.T))
    thin, middle, long = np.sqrt(np.maximum(spread, 1e-12 * spread[-1]))
    return float((thin * middle) ** (1 / 6) / long ** (1 / 3))
