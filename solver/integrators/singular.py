"""Singular positions: foreseen, approached and passed by steps of any method.

In a singular position some constraints follow from others, and motions cross. What
goes through it is smooth all the same: of the motions that meet there only one goes on
with the velocities. Three things keep steps from it. Stages close to it get
accelerations that are quotients of small numbers, so that errors of one stage grow in
the others; rounding of positions, divided by the distance, appears in velocities; and
where both motions are met to rounding nothing tells them apart.

So no step may end there and no stage may come close. The independence of the
constraints falls linearly towards it, which tells when it comes; steps before it are
chosen so that one passes it well inside. Errors there, and corrections, are those of
the free motion; what constraints open beside it is left until they are clear again.
"""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ..compiler.compiling import inner
from ..linear.mass import independence
from ..linear.memory import KERNELS, MEMORY
from ..linear.saddle import REGULARISATION
from ..space.layout import C_RATE, C_VALUE, F1, SYSTEM, WORK
from .projection import accelerate, rates_of_rows
from .step_sizes import scaled_norm
from .stepping import CONTROL

#: How a step lies to a singular position: it may be before it, or behind.
FAR, BEYOND, NEAR = range(3)
#: The part of a step that lies before a singular position when it passes it; the least
#: and the most with which it does; and the most of which it is near.
PASSING_SHARE, AT_LEAST, AT_ONCE, NEAR_SHARE = 0.43, 0.2, 0.5, 4.0
#: Constraints of which so much is independent are far from a singular position; with
#: less than the second one a step has to take care before it fails.
INDEPENDENT, DEPENDENT = 0.5, 0.12
#: A start in a singular position leaves less independence than this; the first step is
#: so many times as long as the way on which rounding is seen.
SINGULAR_START, LEAVING = 1e-6, 10.0
#: Near a singular position: projections, their regularisation times the tolerance, and
#: the largest change of velocities, relative to the largest ones.
PROJECTIONS_NEAR, SOFT, LARGEST_JUMP = 2, 1e-14, 0.1
#: Part of the independence that is left where a singular position is certain.
LOST = 0.01
#: Motions are alike, within what projection leaves open, with less independence than
#: this; and with less than this part of that at which rounding is seen.
ALIKE, TOO_NEAR = 1e-5, 0.03


@inner(float64(CONTROL))
def noisy(control):
    """The independence below which rounding is seen, where it has been much larger."""
    noise = math.sqrt(SOFT / control.tolerance)
    return min(LOST * control.clearest, noise)


@inner(float64(CONTROL, float64, float64))
def beside_singular(control, h, reach):
    """A step, h or less, that keeps its ends and stages away from a singular position.

    It passes it, or is one of a few equal steps before one that does. Each is at most
    as long as the one before, the passing one times `reach`.
    """
    left, old = control.singular - control.time, control.old_step
    control.crossing = BEYOND if control.independence < noisy(control) else FAR
    warned = control.independence < DEPENDENT or control.failures > 0
    if abs(left) < NEAR_SHARE * h and warned:
        control.crossing = NEAR if left >= 0.0 else BEYOND
    if control.fixed_step == 1 or control.crossing != NEAR:
        return h
    if old == 0.0:
        return min(h, left / NEAR_SHARE) if left > 0.0 else h
    passing, longest = min(h, reach * old), min(h, 2.0 * reach * old)
    if left < AT_LEAST * passing:
        return passing
    if left < AT_ONCE * longest:
        return min(longest, left / PASSING_SHARE)
    longest = min(h, old if left < NEAR_SHARE * old else 2.0 * old)
    before = max(1.0, math.ceil(left / longest - AT_ONCE * reach))
    return min(h, left / (before + PASSING_SHARE * reach))


@inner(boolean(CONTROL, float64))
def is_near(control, h):
    """Whether a step ends where rounding of positions would spoil velocities."""
    left = abs(control.singular - control.time - h)
    if left < NEAR_SHARE * h and control.independence < DEPENDENT:
        return True
    return control.independence < noisy(control)


@inner(int64(SYSTEM, MEMORY, CONTROL, float64))
def foresee(system, memory, control, h):
    """When constraints become dependent: the next zero of a parabola.

    It goes through the independence at the ends of the last three steps, of which this
    is one. A singular position that was passed is kept. Returns 0, or 5 when the step
    ends where the motions that meet there cannot be told apart.
    """
    old, now = control.old_step, independence(system, memory)
    ahead = control.singular > control.time
    too_near = min(LOST * control.clearest, max(ALIKE, TOO_NEAR * noisy(control)))
    if ahead and control.crossing == NEAR and now < min(control.independence, too_near):
        return 5
    mean = (now - control.independence) / h
    known = control.decline < 0.0
    bend = (mean - control.decline) / (h + old) if known else 0.0
    slope = mean + bend * h
    root = slope * slope - 4.0 * bend * now
    falls = max(mean, slope) < 0.0 and (known or ahead and control.singular < math.inf)
    control.independence, control.clearest = now, max(now, control.clearest)
    control.decline = mean
    if falls and now < INDEPENDENT and root >= 0.0:
        left = 2.0 * now / (math.sqrt(root) - slope)
        control.singular = control.time + h + left
    elif control.singular > control.time + h:
        control.singular = math.inf
    return 0


@inner(float64(SYSTEM, MEMORY, CONTROL, float64))
def leave_start(system, memory, control, h):
    """The first step, h or what leads out of a singular position.

    There it ends where rounding does not spoil velocities. A fixed step stays.
    """
    least = _least_start(system, memory, control)
    if control.fixed_step == 1:
        return h
    return max(h, min(least, 0.1 * (control.stop - control.time)))


@inner(float64(SYSTEM, MEMORY, CONTROL))
def _least_start(system, memory, control):
    """Looks for a singular position at a start; returns the least step out of it."""
    control.independence = independence(system, memory)
    control.decline = 0.0
    if control.independence > SINGULAR_START:
        return 0.0
    control.singular, control.clearest = control.time, 1.0
    fast = max(control.speed / control.length, control.spin, 1.0 / control.period)
    return LEAVING * math.sqrt(SOFT / control.tolerance) / fast


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1, F1, F1))
def project_near(kernels, system, work, memory, control, t, z, v, dz, dv):
    """`project` near a singular position, where some constraints hardly add to others.

    What these leave open is rounding, which velocities would get multiplied with large
    numbers: so much is left as it is. Returns 0, or a code also when velocities would
    have to change too much: then the step has left the motion.
    """
    soft = SOFT / control.tolerance
    for _ in range(PROJECTIONS_NEAR):
        kernels.evaluate(system, work, t, z, v)
        memory.evaluations += 1
        memory.projections += 1
        status = kernels.project_once(system, work, memory, soft, dz, dv)
        jump = scaled_norm(dv, dv, control.pace, control.pace)
        if status != 0 or not jump < LARGEST_JUMP:
            return max(status, 4)
        kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
    return accelerate(kernels, system, work, memory, t, z, v)


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1, F1, F1, F1))
def keep_free_part(kernels, system, work, memory, control, h, z1, v1, error, dz, dv):
    """Takes from an error of velocities what projection takes at the end of the step.

    Far from singular positions all of it counts. dz and dv are scratch.
    """
    if control.crossing == FAR:
        return
    kernels.evaluate(system, work, control.time + h, z1, v1)
    memory.evaluations += 1
    for i in range(system.n_rows):
        work.row[i, C_VALUE] = 0.0
    rates_of_rows(system, work, error, C_RATE)
    rates_of_rows(system.sliding, work.sliding, error, C_RATE)
    if kernels.project_once(system, work, memory, REGULARISATION, dz, dv) == 0:
        for i in range(len(error)):
            error[i] += dv[i]
