"""The cross product as arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: (3, 3, 3) permutation symbol: (a x b)_i = LEVI_CIVITA[i, j, k] a_j b_k.
LEVI_CIVITA: Array = np.zeros((3, 3, 3))
LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1
LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1
LEVI_CIVITA.setflags(write=False)
