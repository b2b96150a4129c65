"""How much memory an eigenproblem will take."""

from __future__ import annotations

import numpy as np

from .factors import engine_name

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


def expected_gigabytes(ndof: int, dimension: int) -> float:
    """Peak memory of a reduction, to about a fifth for SuperLU and solids.

    Herting's method on hex8, measured: 22 x 22 x 22 elements 1.00 GB (0.83 expected),
    60 x 24 x 8 0.80 GB (0.94), 82 x 30 x 12 2.27 GB (2.67). Slender parts take less:
    their separators are small.
    """
    growth = np.log2(ndof) if dimension == 2 else ndof ** (1 / 3)
    per_unknown = _MATRICES[dimension] + _FACTORS[engine_name()][dimension] * growth
    return float(_BASE + ndof * per_unknown) / 1e9
