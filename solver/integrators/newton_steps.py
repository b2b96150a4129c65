"""Newton's iteration in a step: when it is done, and when its matrix is renewed."""

from __future__ import annotations

import math

from numba import float64, int64, types

from ..compiler.compiling import inner
from ..linear.memory import KERNELS, MEMORY
from ..space.layout import F1, SYSTEM, WORK
from .projection import accelerate
from .stepping import AHEAD, CONTROL, FRESH, KEPT

NEWTON_LIMIT = 8
#: Trust in a known contraction of Newton's iteration fades from step to step.
FADING = 0.8
LEAST_CONTRACTION = 1e-10
#: With a fixed step there is no smaller one to fall back to: more iterations, and the
#: first ones may go astray.
PATIENT_NEWTON_LIMIT = 40
PATIENCE = 4
#: Corrections below this part of the tolerance that do not shrink are rounding.
STAGNATION = 0.03
#: Corrections are finished where they are so many times what rounding makes of them.
ROUNDING = 3.0
#: Part of a step with which Newton's iteration failed that the next ones may have, and
#: the factor by which each step that succeeds has this limit grow. It is set where
#: the iteration has failed so few steps before: that is no single event.
RETREAT, ADVANCE, OFTEN = 0.8, 1.05, 4


@inner(int64(CONTROL))
def newton_limit(control):
    """Iterations after which Newton's iteration is given up."""
    if control.fixed_step == 1:
        return PATIENT_NEWTON_LIMIT
    return NEWTON_LIMIT


@inner(float64(CONTROL))
def newton_goal(control):
    """What Newton's iteration may leave of the tolerance (Hairer, Wanner, IV.8)."""
    return max(ROUNDING * control.noise, min(0.03, math.sqrt(control.tolerance)))


@inner(int64(CONTROL, float64, int64, float64, float64))
def judge(control, goal, iteration, norm, old_norm):
    """What a Newton correction of scaled size `norm` says: 1 done, 0 go on, -1 stop.

    The contraction of the iteration is kept in the control; 1 or more is unknown.
    """
    if not math.isfinite(norm):
        return -1
    if norm == 0.0:
        control.contraction = 0.0
        return 1
    if iteration > 0:
        control.contraction = norm / old_norm
    contraction = control.contraction
    if contraction < 1.0 and contraction / (1.0 - contraction) * norm < goal:
        return 1
    if iteration == 0:
        return 0
    if contraction >= 1.0 and norm < max(STAGNATION, goal):
        return 1
    if control.fixed_step == 1 and iteration < PATIENCE:
        return 0
    left = newton_limit(control) - 1 - iteration
    if (
        contraction >= 1.0
        or math.pow(contraction, float(left)) / (1.0 - contraction) * norm > goal
    ):
        return -1
    return 0


@inner(types.void(CONTROL))
def fade_contraction(control):
    """Lets a single iteration do as long as the contraction was seen lately."""
    known = max(control.contraction, LEAST_CONTRACTION)
    control.contraction = known**FADING


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1))
def take_jacobian(kernels, system, work, memory, control, t, z, v):
    """Linearises at a state that was just evaluated and solved."""
    kernels.linearise(system, work, t, z, v, memory.acceleration, memory.multiplier)
    kernels.remember(system, work, memory)
    memory.jacobians += 1
    control.factored_step = 0.0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL))
def look_back(kernels, system, work, memory, control):
    """Linearises at the current state again, after others were evaluated."""
    t, z, v = control.time, control.z, control.v
    accelerate(kernels, system, work, memory, t, z, v)
    take_jacobian(kernels, system, work, memory, control, t, z, v)
    control.jacobian = FRESH


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64))
def after_divergence(kernels, system, work, memory, control, h):
    """Factor for the step after Newton's iteration failed; 0 when nothing helps.

    A Jacobian that is not fresh is renewed first; then the step is halved, and the next
    ones are limited if this happens often. A fixed one is tried with the Jacobian of
    its end.
    """
    if control.fixed_step == 1 and control.jacobian == AHEAD:
        return 0.0
    if control.fixed_step == 1 and control.jacobian == FRESH:
        control.jacobian = AHEAD
        return 1.0
    if control.jacobian != KEPT:
        memory.rejected += 1
        again = 0 < control.well < OFTEN
        if again or 2.0 * h > control.frontier:
            control.frontier = RETREAT * h
        control.well = 0
        return 0.5
    look_back(kernels, system, work, memory, control)
    return 1.0
