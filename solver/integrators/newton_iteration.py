"""Newton iteration of a step: convergence, and renewal of the Newton matrix."""

import math

from ..compiler.kernels import inner
from ..compiler.types import float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..spatial.system_arrays import F1, SYSTEM, WORK
from .loop_state import CONTROL, CURRENT_JACOBIAN, OLD_JACOBIAN, STEP_END_JACOBIAN
from .projection import evaluate_accelerations

NEWTON_LIMIT = 8
#: Trust in a known contraction of Newton's iteration fades from step to step.
CONTRACTION_DECAY = 0.8
LEAST_CONTRACTION = 1e-10
#: With a fixed step there is no smaller one to fall back to: more iterations, and the
#: first ones may go astray.
PATIENT_NEWTON_LIMIT = 40
UNJUDGED_ITERATIONS = 4
#: Corrections below this part of the tolerance that do not shrink are rounding.
STAGNATION = 0.03
#: Corrections are finished where they are so many times what rounding makes of them.
ROUNDING_FACTOR = 3.0
#: Part of a step with which Newton's iteration failed that the next ones may have, and
#: the factor by which each step that succeeds has this limit grow. It is set where
#: the iteration has failed so few steps before: that is no single event.
LIMIT_FACTOR, LIMIT_GROWTH, FREQUENT_FAILURES = 0.8, 1.05, 4


@inner(int64(CONTROL))
def newton_limit(control):
    """Iterations after which Newton's iteration is given up."""
    if control.fixed_step == 1:
        return PATIENT_NEWTON_LIMIT
    return NEWTON_LIMIT


@inner(float64(CONTROL))
def newton_goal(control):
    """Fraction of the tolerance that the Newton iteration may leave (Hairer, Wanner,
    IV.8).
    """
    return max(
        ROUNDING_FACTOR * control.rounding_noise,
        min(0.03, math.sqrt(control.relative_tolerance)),
    )


@inner(int64(CONTROL, float64, int64, float64, float64))
def check_convergence(control, tolerance, iteration, norm, old_norm):
    """Convergence test of a Newton correction of scaled size `norm`.

    Returns 1 if converged, 0 to continue, -1 to stop. The contraction of the iteration
    is stored in the control; 1 or more is unknown.
    """
    if not math.isfinite(norm):
        return -1
    if norm == 0.0:
        control.contraction = 0.0
        return 1
    if iteration > 0:
        control.contraction = norm / old_norm
    contraction = control.contraction
    if contraction < 1.0 and contraction / (1.0 - contraction) * norm < tolerance:
        return 1
    if iteration == 0:
        return 0
    if contraction >= 1.0 and norm < max(STAGNATION, tolerance):
        return 1
    if control.fixed_step == 1 and iteration < UNJUDGED_ITERATIONS:
        return 0
    iterations_left = newton_limit(control) - 1 - iteration
    if (
        contraction >= 1.0
        or math.pow(contraction, float(iterations_left)) / (1.0 - contraction) * norm
        > tolerance
    ):
        return -1
    return 0


@inner(void(CONTROL))
def decay_contraction_rate(control):
    """Let a single iteration suffice while the contraction was estimated recently."""
    known = max(control.contraction, LEAST_CONTRACTION)
    control.contraction = known**CONTRACTION_DECAY


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1))
def linearise_here(kernels, system, work, memory, control, t, z, v):
    """Linearises at a state that was just evaluated and solved."""
    kernels.linearise(system, work, t, z, v, memory.acceleration, memory.multiplier)
    kernels.store_linearisation(system, work, memory)
    memory.jacobians += 1
    control.factored_step = 0.0


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL))
def relinearise_at_step_start(kernels, system, work, memory, control):
    """Linearises at the current state again, after others were evaluated."""
    t, z, v = control.time, control.z, control.v
    evaluate_accelerations(kernels, system, work, memory, t, z, v)
    linearise_here(kernels, system, work, memory, control, t, z, v)
    control.jacobian = CURRENT_JACOBIAN


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64))
def divergence_step_factor(kernels, system, work, memory, control, h):
    """Step factor after the Newton iteration failed; 0 if the step cannot be continued.

    A Jacobian from an earlier step is renewed first; then the step is halved, and the
    next ones are limited if this happens often. A fixed step is tried with the Jacobian
    of its end.
    """
    if control.fixed_step == 1 and control.jacobian == STEP_END_JACOBIAN:
        return 0.0
    if control.fixed_step == 1 and control.jacobian == CURRENT_JACOBIAN:
        control.jacobian = STEP_END_JACOBIAN
        return 1.0
    if control.jacobian != OLD_JACOBIAN:
        memory.rejected += 1
        is_frequent = 0 < control.steps_since_failure < FREQUENT_FAILURES
        if is_frequent or 2.0 * h > control.newton_step_limit:
            control.newton_step_limit = LIMIT_FACTOR * h
        control.steps_since_failure = 0
        return 0.5
    relinearise_at_step_start(kernels, system, work, memory, control)
    return 1.0
