"""Tolerated errors, and the length of steps."""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ..compiler.compiling import inner
from ..space.layout import F1
from .newton_steps import ADVANCE, NEWTON_LIMIT
from .passing import unpassed
from .stepping import CONTROL, STUB

SAFETY = 0.9
#: For methods that a change of the step disturbs: the factor by which steps grow, and
#: the number of steps after which the last change has died out.
LONGER, SETTLED = 1.5, 10


@inner(float64(F1, F1, F1, F1))
def scaled_norm(dz, dv, scale_z, scale_v):
    """Root mean square of an error relative to the tolerated one, eq. (22)."""
    total = 0.0
    for i in range(len(scale_z)):
        part = dz[i] / scale_z[i]
        total += part * part
    for i in range(len(dv)):
        part = dv[i] / scale_v[i]
        total += part * part
    return math.sqrt(total / max(1, len(scale_z) + len(dv)))


@inner(boolean(F1, F1))
def all_finite(z, v):
    total = 0.0
    for i in range(len(z)):
        total += abs(z[i])
    for i in range(len(v)):
        total += abs(v[i])
    return math.isfinite(total)


@inner(float64(CONTROL, float64))
def time_resolution(control, t):
    """The shortest step that numbers resolve near a time; at time zero a part of the
    run that is far below any step."""
    return max(1e-13 * abs(t), 1e-16 * control.period)


@inner(float64(CONTROL))
def next_step(control):
    """Proposed step, stretched or halved so that the interval ends without a stub,
    and short enough to see what functions of time do.

    Zero when the end of the interval is reached.
    """
    remaining = control.stop - control.time
    if remaining <= time_resolution(control, control.stop):
        return 0.0
    fixed = control.fixed_step == 1
    h = control.step
    if not fixed:
        h = unpassed(
            control, control.time, min(h, control.largest_step, control.unturned)
        )
    if h >= remaining * (1.0 - (STUB if fixed else 1e-9)):
        return remaining
    if h > 0.5 * remaining and not fixed:
        return 0.5 * remaining
    return h


@inner(boolean(CONTROL, float64))
def too_small(control, h):
    """Whether the time does not resolve a step."""
    return h <= time_resolution(control, control.time)


@inner(float64(int64, float64, int64))
def growth(order, error, iterations):
    """Factor for the next step from an error estimate of size h^(order + 1)."""
    if not math.isfinite(error):
        return 0.1
    safety = SAFETY * (2 * NEWTON_LIMIT + 1) / (2 * NEWTON_LIMIT + iterations)
    return min(8.0, max(0.15, safety * max(error, 1e-10) ** (-1.0 / (order + 1))))


@inner(types.void(CONTROL, int64, float64, float64, float64, int64, int64))
def finish_step(control, order, serves, h, error, iterations, failures):
    """Chooses the next step (Gustafsson); says whether the Jacobian still serves.

    It does while Newton's iteration contracts the error by `serves`.
    """
    control.needs_jacobian = 1 if control.contraction > serves else 0
    if control.fixed_step == 1:
        control.old_step = h
        return
    factor = growth(order, error, iterations)
    if control.old_step > 0.0 and control.old_error > 0.0:
        ratio = h / control.old_step
        change = (control.old_error / max(error, 1e-10)) ** (1.0 / (order + 1))
        factor = min(factor, max(0.15, factor * ratio * change))
    if failures > 0:
        factor = min(factor, 1.0)
    factor = min(factor, control.frontier / h)
    control.frontier *= ADVANCE
    control.well += 1
    control.old_step = h
    control.old_error = max(1e-2, error)
    if control.needs_jacobian == 0 and 1.0 <= factor < 1.2:
        factor = 1.0
    control.step = h * factor


@inner(types.void(CONTROL, int64, float64, float64, float64, int64, int64))
def keep_step(control, order, serves, h, error, iterations, failures):
    """`finish_step` of methods that a change of the step disturbs.

    Steps are lengthened when the last change has died out, by one factor or not at all.
    """
    control.needs_jacobian = 1 if control.contraction > serves else 0
    same = abs(h - control.old_step) <= STUB * h
    control.same = control.same + 1 if same else 0
    control.old_step = h
    if control.fixed_step == 1:
        return
    control.step = h
    if control.same >= SETTLED and growth(order, error, iterations) > LONGER:
        control.step = LONGER * h
