"""Rows of the constraints: one primitive alone, or a weighted sum of several."""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from .compiling import inner
from .layout import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    SYSTEM,
    W_CONSTANT,
    W_FIRST,
    W_PERIOD,
    W_WEIGHT,
    WORK,
)


@inner(boolean(int64))
def is_coupled(kind):
    return kind in (COUPLED_ANGLE, COUPLED_ALONG)


@inner(types.void(WORK, int64, float64, float64, float64))
def write_row(work, r, value, rate, gamma):
    row = work.row
    row[r, C_VALUE], row[r, C_RATE], row[r, C_GAMMA] = value, rate, gamma


@inner(types.void(SYSTEM, WORK, int64, int64, float64, float64, float64))
def add_term(system, work, r, term, value, rate, gamma):
    """Adds one weighted coordinate of a coupling to its row.

    Angles are known up to whole turns; the sum is known up to its period, and the
    value nearest to zero is taken.
    """
    pool, row = system.pool, work.row
    if pool[term + W_FIRST] > 0.0:
        write_row(work, r, 0.0, 0.0, 0.0)
    weight, period = pool[term + W_WEIGHT], pool[term + W_PERIOD]
    total = row[r, C_VALUE] + weight * value - pool[term + W_CONSTANT]
    if period > 0.0:
        total -= period * math.floor(total / period + 0.5)
    row[r, C_VALUE] = total
    row[r, C_RATE] += weight * rate
    row[r, C_GAMMA] += weight * gamma
