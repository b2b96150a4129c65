"""The step loop of the implicit methods: Newton iteration, error, next step.

A method provides five inner kernels; what it stores between them is its storage.
"""

import math
from typing import Any

from ..compiler.kernels import Entry, entry, inner
from ..compiler.types import float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.mass_matrix import constraint_independence
from ..spatial.system_arrays import SYSTEM, WORK
from .loop_state import (
    BELOW_ROUNDING,
    CONTROL,
    CURRENT_JACOBIAN,
    INTERVAL_END,
    MAX_ACCUMULATED_ERROR,
    MIN_TOLERANCE,
    NEAR_SINGULARITY,
    NO_CONVERGENCE,
    NOT_FINITE,
    OFF_CONSTRAINTS,
    OUTPUT_FULL,
    STEP_END_JACOBIAN,
    STEPS_DONE,
    TOO_SMALL,
)
from .newton_iteration import (
    divergence_step_factor,
    linearise_here,
    relinearise_at_step_start,
)
from .output_sampling import exceeds_output_rows
from .projection import evaluate_accelerations
from .singular_configurations import (
    FAR_FROM_SINGULAR,
    NEAR_SINGULAR,
    first_step_from_singularity,
    step_avoiding_singularity,
)
from .step_size import (
    all_finite,
    choose_next_step,
    is_below_time_resolution,
    next_step,
    set_error_tolerances,
    step_size_factor,
    update_error_scales,
)

#: Most looks ahead for a singular position.
MAX_PREDICTIONS = 3
#: Where it is seen that a body has lost its inertia, relative to when constraints seem
#: to become dependent.
INERTIA_CHECK_FACTOR = 1.5


def step_loop(
    name: str,
    storage_type: Any,
    begin: Any,
    factor: Any,
    newton: Any,
    error_of: Any,
    accept: Any,
    order_of: Any,
    predict_end: Any,
    jacobian_contraction: float,
    first_step: float = 1.0,
    reach: float = 1.0,
    finish: Any = choose_next_step,
    returns_near_singular: bool = False,
) -> Entry:
    """The entry kernel of the step loop of an implicit method.

    Parameters
    ----------
    name : of the method, for the cache on disk
    storage_type : compiled type of its storage
    begin(kernels, system, work, memory, control, storage) : keeps the slopes at the
        beginning of a step
    factor(kernels, system, work, memory, storage, h) : 0 on success
    newton(kernels, system, work, memory, control, storage, h) : iterations, 0 without
        convergence
    error_of(kernels, system, work, memory, control, storage, h) : relative to the
        tolerated one
    accept(kernels, system, work, memory, control, storage, h) : ends the step, 0 on
        success
    order_of(storage) : of the error estimate
    predict_end(kernels, system, control, storage, h) : writes the predicted end of the
        step to z1 and v1 of the storage
    jacobian_contraction : a Jacobian is kept while Newton's iteration contracts the
        error this much
    first_step : part of the proposed step that is taken after a break
    reach : longest step past a singular configuration, relative to the one before
    finish : chooses the next step, as `choose_next_step`
    returns_near_singular : returns NEAR_SINGULARITY, which another loop can pass
    """

    def linearise_at_step_end(kernels, system, work, memory, control, storage, h):  # type: ignore[no-untyped-def]
        """Linearise at the predicted end of the step."""
        predict_end(kernels, system, control, storage, h)
        t, z, v = control.time + h, storage.z1, storage.v1
        evaluate_accelerations(kernels, system, work, memory, t, z, v)
        linearise_here(kernels, system, work, memory, control, t, z, v)
        control.jacobian = STEP_END_JACOBIAN

    linearise_at_step_end = inner(
        void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type, float64)
    )(linearise_at_step_end)

    def independence_at(kernels, system, work, memory, control, storage, later):  # type: ignore[no-untyped-def]
        """The independence of the constraints a little later, as it seems before.

        Less than nothing where a mass matrix is not positive.
        """
        predict_end(kernels, system, control, storage, later)
        t, z, v = control.time + later, storage.z1, storage.v1
        if evaluate_accelerations(kernels, system, work, memory, t, z, v) == 1:
            return -1.0
        return constraint_independence(system, memory)

    independence_at = inner(
        float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type, float64)
    )(independence_at)

    def correct_singular_time(kernels, system, work, memory, control, storage):  # type: ignore[no-untyped-def]
        """Corrects when the next singular position comes, by looks ahead.

        Where a body loses its inertia the model ends: no step may pass that.
        """
        left = control.singular_time - control.time
        independence_behind = independence_at(
            kernels, system, work, memory, control, storage, INERTIA_CHECK_FACTOR * left
        )
        remaining = independence_at(
            kernels, system, work, memory, control, storage, left
        )
        if min(independence_behind, remaining) < 0.0:
            control.singular_time = math.inf
            return
        for _ in range(MAX_PREDICTIONS):
            correction = left * remaining / control.independence
            later = left + correction
            later_independence = independence_at(
                kernels, system, work, memory, control, storage, later
            )
            if not later_independence < remaining:
                left -= correction
                break
            left, remaining = later, later_independence
        control.singular_time = control.time + left

    def keep_singular_time(kernels, system, work, memory, control, storage):  # type: ignore[no-untyped-def]
        """In the place of `correct_singular_time` in a loop that returns before."""

    correct_singular_time = inner(
        void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type)
    )(keep_singular_time if returns_near_singular else correct_singular_time)

    def advance(kernels, system, work, memory, control, storage, limit):  # type: ignore[no-untyped-def]
        """Steps until the end of the smooth interval or for at most `limit` steps.

        Entered and left with (z, v) on the constraints and evaluated, accelerations in
        memory. Returns one of the codes of `loop_state`.
        """
        order = order_of(storage)
        if control.shares_tolerance == 1 and control.relative_tolerance < MIN_TOLERANCE:
            return BELOW_ROUNDING
        for _ in range(limit):
            h = next_step(control)
            if h == 0.0:
                return INTERVAL_END
            update_error_scales(system, memory, control)
            t = control.time
            if control.old_step == 0.0:
                first_fraction = first_step if control.fixed_step == 0 else 1.0
                h = first_step_from_singularity(
                    system, memory, control, first_fraction * h
                )
            if exceeds_output_rows(control, h):
                return OUTPUT_FULL
            begin(kernels, system, work, memory, control, storage)
            control.jacobian = control.needs_jacobian
            if control.jacobian == CURRENT_JACOBIAN:
                linearise_here(
                    kernels, system, work, memory, control, t, control.z, control.v
                )
                control.contraction = 1.0
            control.step_failures, control.singular_proximity = 0, FAR_FROM_SINGULAR
            while True:
                if is_below_time_resolution(control, h):
                    return TOO_SMALL
                crossing_before = control.singular_proximity
                proposed, h = h, step_avoiding_singularity(control, h, reach)
                if (
                    returns_near_singular
                    and control.singular_proximity != FAR_FROM_SINGULAR
                ):
                    return NEAR_SINGULARITY
                known = control.old_step > 0.0 and control.fixed_step == 0
                if (
                    control.singular_proximity == NEAR_SINGULAR
                    and crossing_before != NEAR_SINGULAR
                    and known
                ):
                    correct_singular_time(
                        kernels, system, work, memory, control, storage
                    )
                    h = step_avoiding_singularity(control, proposed, reach)
                last_try = (
                    control.fixed_step == 1 and control.jacobian == STEP_END_JACOBIAN
                )
                set_error_tolerances(system, control, h)
                if control.singular_proximity == NEAR_SINGULAR or last_try:
                    linearise_at_step_end(
                        kernels, system, work, memory, control, storage, h
                    )
                elif control.jacobian == STEP_END_JACOBIAN:
                    relinearise_at_step_start(kernels, system, work, memory, control)
                status = 0
                if control.factored_step != h:
                    status = factor(kernels, system, work, memory, storage, h)
                    control.factored_step = h
                iterations = 0
                if status == 0:
                    iterations = newton(
                        kernels, system, work, memory, control, storage, h
                    )
                control.stage_step = h
                if iterations == 0:
                    control.step_failures += 1
                    control.stage_prediction = 0
                    shorter = divergence_step_factor(
                        kernels, system, work, memory, control, h
                    )
                    if shorter == 0.0:
                        return NO_CONVERGENCE
                    h *= shorter
                    control.contraction = 1.0
                    continue
                error = 0.0
                if control.fixed_step == 0:
                    error = error_of(kernels, system, work, memory, control, storage, h)
                if not error < 1.0:
                    control.step_failures += 1
                    memory.rejected += 1
                    control.stage_prediction = 2 if math.isfinite(error) else 0
                    h *= step_size_factor(order, error, iterations)
                    continue
                if accept(kernels, system, work, memory, control, storage, h) == 0:
                    break
                control.step_failures += 1
                memory.rejected += 1
                control.stage_prediction = 0
                if control.fixed_step == 1:
                    return OFF_CONSTRAINTS
                h *= control.retry_fraction
            control.stage_prediction = 1
            finish(
                control,
                order,
                jacobian_contraction,
                h,
                error,
                iterations,
                control.step_failures,
            )
            if control.jacobian == STEP_END_JACOBIAN:
                control.needs_jacobian = 1
                control.step = max(control.step, 0.8 * h)
            memory.steps += 1
            if not all_finite(control.z, control.v):
                return NOT_FINITE
            if control.accumulated_error > MAX_ACCUMULATED_ERROR:
                return BELOW_ROUNDING
        return STEPS_DONE

    advance.__qualname__ = f"advance_{name}"
    signature = int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type, int64)
    compiled: Entry = entry(signature)(advance)
    return compiled
