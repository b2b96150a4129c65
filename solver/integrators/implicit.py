"""The step loop of implicit methods: Newton, error, next step.

A method brings five inner kernels; what it keeps between them is its storage.
"""

from __future__ import annotations

import math
from typing import Any

from numba import float64, int64, types

from ..compiler.compiling import Entry, entry, inner
from ..linear.mass import independence
from ..linear.memory import KERNELS, MEMORY
from ..space.layout import SYSTEM, WORK
from .newton_steps import after_divergence, look_back, take_jacobian
from .projection import accelerate
from .recording import is_full
from .scales import note_motion, set_scales
from .singular import FAR, NEAR, beside_singular, leave_start
from .step_sizes import all_finite, finish_step, growth, next_step, too_small
from .stepping import (
    AHEAD,
    BESIDE,
    BLURRED,
    CHUNK,
    CONTROL,
    FINEST,
    FRESH,
    FULL,
    MOST_MISSED,
    NO_CONVERGENCE,
    NOT_FINITE,
    OFF_CONSTRAINTS,
    REACHED,
    TOO_SMALL,
)

#: Most looks ahead for a singular position.
LOOKS = 3
#: Where it is seen that a body has lost its inertia, relative to when constraints seem
#: to become dependent.
BEHIND = 1.5


def step_loop(
    name: str,
    storage_type: Any,
    begin: Any,
    factor: Any,
    newton: Any,
    error_of: Any,
    accept: Any,
    order_of: Any,
    foretell: Any,
    serves: float,
    first_step: float = 1.0,
    reach: float = 1.0,
    finish: Any = finish_step,
    leaves: bool = False,
) -> Entry:
    """`advance` of an implicit method: the entry kernel of its step loop.

    Parameters
    ----------
    name : tells the cache on disk which method it is
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
    foretell(kernels, system, control, storage, h) : places the end of the step, as it
        seems before, in z1 and v1 of the storage
    serves : a Jacobian is kept while Newton's iteration contracts the error this much
    first_step : part of the proposed step that is taken after a break
    reach : longest step past a singular position, relative to the one before
    finish : chooses the next step, as `finish_step`
    leaves : returns BESIDE near a singular position, which another loop can pass
    """

    def look_ahead(kernels, system, work, memory, control, storage, h):  # type: ignore[no-untyped-def]
        """Linearises at the end of the step, as it seems before."""
        foretell(kernels, system, control, storage, h)
        t, z, v = control.time + h, storage.z1, storage.v1
        accelerate(kernels, system, work, memory, t, z, v)
        take_jacobian(kernels, system, work, memory, control, t, z, v)
        control.jacobian = AHEAD

    look_ahead = inner(
        types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type, float64)
    )(look_ahead)

    def seen(kernels, system, work, memory, control, storage, later):  # type: ignore[no-untyped-def]
        """The independence of the constraints a little later, as it seems before.

        Less than nothing where a mass matrix is not positive.
        """
        foretell(kernels, system, control, storage, later)
        t, z, v = control.time + later, storage.z1, storage.v1
        if accelerate(kernels, system, work, memory, t, z, v) == 1:
            return -1.0
        return independence(system, memory)

    seen = inner(
        float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type, float64)
    )(seen)

    def sharpen(kernels, system, work, memory, control, storage):  # type: ignore[no-untyped-def]
        """Corrects when the next singular position comes, by looks ahead.

        Where a body loses its inertia the model ends: no step may pass that.
        """
        left = control.singular - control.time
        behind = seen(kernels, system, work, memory, control, storage, BEHIND * left)
        rest = seen(kernels, system, work, memory, control, storage, left)
        if min(behind, rest) < 0.0:
            control.singular = math.inf
            return
        for _ in range(LOOKS):
            off = left * rest / control.independence
            later = left + off
            then = seen(kernels, system, work, memory, control, storage, later)
            if not then < rest:
                left -= off
                break
            left, rest = later, then
        control.singular = control.time + left

    def leave(kernels, system, work, memory, control, storage):  # type: ignore[no-untyped-def]
        """In the place of `sharpen` in a loop that does not come so far."""

    sharpen = inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type))(
        leave if leaves else sharpen
    )

    def advance(kernels, system, work, memory, control, storage, limit):  # type: ignore[no-untyped-def]
        """Steps until the end of the smooth interval or for at most `limit` steps.

        Entered and left with (z, v) on the constraints and evaluated, accelerations in
        memory. Returns one of the codes of `stepping`.
        """
        order = order_of(storage)
        if control.adding == 1 and control.tolerance < FINEST:
            return BLURRED
        for _ in range(limit):
            h = next_step(control)
            if h == 0.0:
                return REACHED
            note_motion(system, memory, control)
            t = control.time
            if control.old_step == 0.0:
                part = first_step if control.fixed_step == 0 else 1.0
                h = leave_start(system, memory, control, part * h)
            if is_full(control, h):
                return FULL
            begin(kernels, system, work, memory, control, storage)
            control.jacobian = control.needs_jacobian
            if control.jacobian == FRESH:
                take_jacobian(
                    kernels, system, work, memory, control, t, control.z, control.v
                )
                control.contraction = 1.0
            control.failures, control.crossing = 0, FAR
            while True:
                if too_small(control, h):
                    return TOO_SMALL
                was = control.crossing
                proposed, h = h, beside_singular(control, h, reach)
                if leaves and control.crossing != FAR:
                    return BESIDE
                known = control.old_step > 0.0 and control.fixed_step == 0
                if control.crossing == NEAR and was != NEAR and known:
                    sharpen(kernels, system, work, memory, control, storage)
                    h = beside_singular(control, proposed, reach)
                last_try = control.fixed_step == 1 and control.jacobian == AHEAD
                set_scales(system, control, h)
                if control.crossing == NEAR or last_try:
                    look_ahead(kernels, system, work, memory, control, storage, h)
                elif control.jacobian == AHEAD:
                    look_back(kernels, system, work, memory, control)
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
                    control.failures += 1
                    control.predict = 0
                    shorter = after_divergence(
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
                    control.failures += 1
                    memory.rejected += 1
                    control.predict = 2 if math.isfinite(error) else 0
                    h *= growth(order, error, iterations)
                    continue
                if accept(kernels, system, work, memory, control, storage, h) == 0:
                    break
                control.failures += 1
                memory.rejected += 1
                control.predict = 0
                if control.fixed_step == 1:
                    return OFF_CONSTRAINTS
                h *= control.retry
            control.predict = 1
            finish(control, order, serves, h, error, iterations, control.failures)
            if control.jacobian == AHEAD:
                control.needs_jacobian = 1
                control.step = max(control.step, 0.8 * h)
            memory.steps += 1
            if not all_finite(control.z, control.v):
                return NOT_FINITE
            if control.missed > MOST_MISSED:
                return BLURRED
        return CHUNK

    advance.__qualname__ = f"advance_{name}"
    signature = int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, storage_type, int64)
    compiled: Entry = entry(signature)(advance)
    return compiled
