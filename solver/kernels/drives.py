"""Functions of time and their first two derivatives, for drives and forces."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .layout import (
    D_DATA,
    D_KIND,
    D_PIECES,
    D_TERMS,
    HARMONIC,
    POLYNOMIAL,
    SYSTEM,
)


@inner(types.UniTuple(float64, 3)(SYSTEM, int64, float64, float64))
def drive_value(system, drive, clock, t):
    """Value and two time derivatives at t.

    Of pieces that need not join smoothly, the one that holds `clock` is taken.
    """
    kind = system.drive[drive, D_KIND]
    pieces = system.drive[drive, D_PIECES]
    terms = system.drive[drive, D_TERMS]
    start = system.drive[drive, D_DATA]
    pool = system.pool
    if kind == HARMONIC:
        omega = pool[start + 2]
        phase = omega * t + pool[start + 3]
        swing = pool[start + 1] * math.sin(phase)
        rate = pool[start + 1] * math.cos(phase) * omega
        return pool[start] + swing, rate, -omega * omega * swing
    when = clock if kind == POLYNOMIAL else t
    k, last = 0, pieces
    while last - k > 1:
        middle = (k + last) // 2
        if pool[start + middle] <= when:
            k = middle
        else:
            last = middle
    x, scale = t - pool[start + k], 1.0
    first = start + pieces + k * terms
    if kind != POLYNOMIAL:
        scale = 2.0 / (pool[start + k + 1] - pool[start + k])
        x = scale * x - 1.0
        first += 1
    value = 0.0
    rate = 0.0
    curvature = 0.0
    for i in range(terms - 1, -1, -1):
        curvature = curvature * x + 2.0 * rate
        rate = rate * x + value
        value = value * x + pool[first + i]
    return value, scale * rate, scale * scale * curvature
