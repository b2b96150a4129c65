"""Functions of time and their first two derivatives, for drives and forces."""

import math

from ..compiler.kernels import entry, inner
from ..compiler.types import UniTuple, float64, int64, void
from ..spatial.system_arrays import (
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


@inner(UniTuple(float64, 3)(SYSTEM, int64, float64, float64))
def function_value(system, drive, interval_time, t):
    """Value and two time derivatives at t.

    Of pieces that need not join smoothly, the one that holds `interval_time` is taken.
    """
    first, last = drive, drive + 1
    if system.drive[drive, D_KIND] == SUM:
        first = system.drive[drive, D_DATA]
        last = first + system.drive[drive, D_PIECES]
    real_data = system.real_data
    total, total_rate, total_curvature = 0.0, 0.0, 0.0
    for row in range(first, last):
        kind = system.drive[row, D_KIND]
        pieces = system.drive[row, D_PIECES]
        terms = system.drive[row, D_TERMS]
        start = system.drive[row, D_DATA]
        if kind == HARMONIC:
            omega = real_data[start + 2]
            phase = omega * t + real_data[start + 3]
            sine = real_data[start + 1] * math.sin(phase)
            total += real_data[start] + sine
            total_rate += real_data[start + 1] * math.cos(phase) * omega
            total_curvature -= omega * omega * sine
            continue
        if kind == RAMP:
            length, change = (
                real_data[start + 1] - real_data[start],
                real_data[start + 3],
            )
            progress = (t - real_data[start]) / length
            x = min(max(progress, 0.0), 1.0)
            two_pi = 2.0 * math.pi
            rise = x - math.sin(two_pi * x) / two_pi
            rise_rate = (1.0 - math.cos(two_pi * x)) / length
            if real_data[start + 4] == 0.0:
                rise_curvature = two_pi * math.sin(two_pi * x) / (length * length)
                total += real_data[start + 2] + change * rise
                total_rate += change * rise_rate
                total_curvature += change * rise_curvature
                continue
            area = 0.5 * x * x + (math.cos(two_pi * x) - 1.0) / (two_pi * two_pi)
            area += max(progress - 1.0, 0.0)
            rate = real_data[start + 5]
            total += real_data[start + 2] + length * (rate * progress + change * area)
            total_rate += rate + change * rise
            total_curvature += change * rise_rate
            continue
        piece_time = interval_time if kind == POLYNOMIAL else t
        k, end = 0, pieces
        while end - k > 1:
            middle = (k + end) // 2
            if real_data[start + middle] <= piece_time:
                k = middle
            else:
                end = middle
        x, scale = t - real_data[start + k], 1.0
        lowest = start + pieces + k * terms
        if kind != POLYNOMIAL:
            scale = 2.0 / (real_data[start + k + 1] - real_data[start + k])
            x = scale * x - 1.0
            lowest += 1
        value, rate, curvature = 0.0, 0.0, 0.0
        for i in range(terms - 1, -1, -1):
            curvature = curvature * x + 2.0 * rate
            rate = rate * x + value
            value = value * x + real_data[lowest + i]
        total += value
        total_rate += scale * rate
        total_curvature += scale * scale * curvature
    return total, total_rate, total_curvature


@inner()
def prescribed_value(system, work, con, t):
    """Value that a drive prescribes, with two derivatives; laws must be evaluated
    before.
    """
    if con.law >= 0:
        row = system.force[con.law]
        return (
            work.force_scale[con.law],
            work.force_scale[row.a],
            work.force_scale[row.b],
        )
    if con.drive >= 0:
        return function_value(system, con.drive, work.interval_time[0], t)
    return 0.0, 0.0, 0.0


@entry(void(SYSTEM, int64, F1, F1, F2))
def function_values(system, drive, interval_times, times, values):
    """`function_value` at many times, into the rows of `values`."""
    for k in range(len(times)):
        value, rate, curvature = function_value(
            system, drive, interval_times[k], times[k]
        )
        values[k, 0], values[k, 1], values[k, 2] = value, rate, curvature
