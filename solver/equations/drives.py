"""Functions of time and their first two derivatives, for drives and forces."""

from __future__ import annotations

import math

from numba import float64, int64, types

from ..compiler.compiling import entry, inner
from ..space.layout import (
    D_DATA,
    D_KIND,
    D_PIECES,
    D_TERMS,
    F1,
    F2,
    HARMONIC,
    POLYNOMIAL,
    RAMP,
    SUM,
    SYSTEM,
)


@inner(types.UniTuple(float64, 3)(SYSTEM, int64, float64, float64))
def drive_value(system, drive, clock, t):
    """Value and two time derivatives at t.

    Of pieces that need not join smoothly, the one that holds `clock` is taken.
    """
    first, last = drive, drive + 1
    if system.drive[drive, D_KIND] == SUM:
        first = system.drive[drive, D_DATA]
        last = first + system.drive[drive, D_PIECES]
    pool = system.pool
    whole, whole_rate, whole_curvature = 0.0, 0.0, 0.0
    for row in range(first, last):
        kind = system.drive[row, D_KIND]
        pieces = system.drive[row, D_PIECES]
        terms = system.drive[row, D_TERMS]
        start = system.drive[row, D_DATA]
        if kind == HARMONIC:
            omega = pool[start + 2]
            phase = omega * t + pool[start + 3]
            swing = pool[start + 1] * math.sin(phase)
            whole += pool[start] + swing
            whole_rate += pool[start + 1] * math.cos(phase) * omega
            whole_curvature -= omega * omega * swing
            continue
        if kind == RAMP:
            length, change = pool[start + 1] - pool[start], pool[start + 3]
            along = (t - pool[start]) / length
            x = min(max(along, 0.0), 1.0)
            turn = 2.0 * math.pi
            risen = x - math.sin(turn * x) / turn
            pace = (1.0 - math.cos(turn * x)) / length
            if pool[start + 4] == 0.0:
                bend = turn * math.sin(turn * x) / (length * length)
                whole += pool[start + 2] + change * risen
                whole_rate += change * pace
                whole_curvature += change * bend
                continue
            area = 0.5 * x * x + (math.cos(turn * x) - 1.0) / (turn * turn)
            area += max(along - 1.0, 0.0)
            rate = pool[start + 5]
            whole += pool[start + 2] + length * (rate * along + change * area)
            whole_rate += rate + change * risen
            whole_curvature += change * pace
            continue
        when = clock if kind == POLYNOMIAL else t
        k, end = 0, pieces
        while end - k > 1:
            middle = (k + end) // 2
            if pool[start + middle] <= when:
                k = middle
            else:
                end = middle
        x, scale = t - pool[start + k], 1.0
        lowest = start + pieces + k * terms
        if kind != POLYNOMIAL:
            scale = 2.0 / (pool[start + k + 1] - pool[start + k])
            x = scale * x - 1.0
            lowest += 1
        value, rate, curvature = 0.0, 0.0, 0.0
        for i in range(terms - 1, -1, -1):
            curvature = curvature * x + 2.0 * rate
            rate = rate * x + value
            value = value * x + pool[lowest + i]
        whole += value
        whole_rate += scale * rate
        whole_curvature += scale * scale * curvature
    return whole, whole_rate, whole_curvature


@inner()
def prescribed(system, work, con, t):
    """What a drive gives a constraint, with two derivatives; laws were asked before."""
    if con.law >= 0:
        row = system.force[con.law]
        return work.factor[con.law], work.factor[row.a], work.factor[row.b]
    if con.drive >= 0:
        return drive_value(system, con.drive, work.clock[0], t)
    return 0.0, 0.0, 0.0


@entry(types.void(SYSTEM, int64, F1, F1, F2))
def drive_values(system, drive, clocks, times, found):
    """`drive_value` at many times, into the rows of `found`."""
    for k in range(len(times)):
        value, rate, curvature = drive_value(system, drive, clocks[k], times[k])
        found[k, 0], found[k, 1], found[k, 2] = value, rate, curvature
