"""Rheonomic drives: piecewise polynomials and their first two derivatives."""

from __future__ import annotations

from numba import float64, int64, types

from .compiling import inner
from .layout import D_DATA, D_PIECES, D_TERMS, SYSTEM


@inner(types.UniTuple(float64, 3)(SYSTEM, int64, float64, float64))
def drive_value(system, drive, clock, t):
    """Value and two time derivatives at t, from the piece that holds `clock`."""
    pieces = system.drive[drive, D_PIECES]
    terms = system.drive[drive, D_TERMS]
    start = system.drive[drive, D_DATA]
    pool = system.pool
    k = 0
    while k + 1 < pieces and pool[start + k + 1] <= clock:
        k += 1
    x = t - pool[start + k]
    first = start + pieces + k * terms
    value = 0.0
    rate = 0.0
    curvature = 0.0
    for i in range(terms - 1, -1, -1):
        curvature = curvature * x + 2.0 * rate
        rate = rate * x + value
        value = value * x + pool[first + i]
    return value, rate, curvature
