"""Ends of steps: on the constraints."""

from __future__ import annotations

from numba import float64, int64

from ..compiler.compiling import inner
from ..linear.memory import KERNELS, MEMORY
from ..space.layout import F1, SYSTEM, WORK
from .bifurcations import note_crossing
from .passing import check_ways
from .projection import count_turns, note_drift, project
from .singular import foresee, is_near, project_near
from .stepping import CONTROL


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1, F1, F1))
def close_step(kernels, system, work, memory, control, h, z1, v1, dz, dv):
    """Projects the end of a step onto the constraints and notes what is left open.

    dz and dv are scratch. Returns 0, or the code of `project`, `count_turns` or
    `check_ways`.
    """
    at, closed = control.time + h, control.closed
    if is_near(control, h):
        status = project_near(
            kernels, system, work, memory, control, at, z1, v1, dz, dv
        )
    else:
        status = project(kernels, system, work, memory, at, z1, v1, dz, dv, closed)
    if status == 0:
        note_drift(system, work, control)
        status = count_turns(system, work, control, h, z1)
    if status == 0:
        status = check_ways(work, control, h)
    if status == 0:
        before, slope = control.independence, control.decline
        status = foresee(system, memory, control, h)
        if status == 0:
            note_crossing(control, h, before, slope, z1, v1)
    return status
