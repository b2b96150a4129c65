"""What stiffened bodies in plane and space share: theory, section 12."""

from __future__ import annotations

import math

from numba import int64, types

from .compiling import inner
from .layout import BLOCK, F1, I1, NQ, NV, RD, WORK

#: Moments of inertia below this part of the largest one are rounding: there are none.
NOTHING = 1e-13


@inner(types.void(WORK, I1, F1, int64))
def begin_mass(work, row, pool, at):
    """Begins the elastic block of the mass matrix with the one that stands at `at`."""
    nq, nv, corner = row[NQ], row[NV], row[BLOCK] + row[RD] * (row[NV] + 1)
    for k in range(nq):
        for i in range(nq):
            work.M[corner + k * nv + i] = pool[at + k * nq + i]


@inner(types.void(WORK, I1))
def spoil_mass(work, row):
    """Tells that a moment of inertia is not positive: see `stopping`."""
    nv = row[NV]
    work.M[row[BLOCK] + nv * nv - 1] = -math.inf
