"""What the step loops of all integrators share: control, scaling, dense output."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, types

from formats.sid import Array

from ..kernels.compiling import entry, inner
from ..kernels.layout import (
    C_RATE,
    C_VALUE,
    F1,
    F2,
    F3,
    I1,
    N_ROWS,
    NP,
    NQ,
    POS,
    RD,
    SYSTEM,
    VEL,
    WORK,
)
from ..kernels.newton import EVALUATIONS, JACOBIANS, KERNELS, MEMORY, PROJECTIONS

# Entries of Control.real
TIME = 0  # current time
STOP = 1  # end of the smooth interval
STEP = 2  # proposed step
OLD_STEP = 3  # last accepted step, 0 at a start
OLD_ERROR = 4  # its error estimate
TOLERANCE = 5  # relative tolerance per step
LENGTH = 6  # size of the mechanism [m]
PERIOD = 7  # duration of the run [s]
NEAR = 8  # constraints met when |c| is below
STILL = 9  # and |dc/dt| is below
SPEED = 10  # largest speed so far
SPIN = 11  # largest angular velocity so far
DRIFT = 12  # largest |c| met at the end of a step, after projection
DRIFT_RATE = 13
LARGEST = 14  # largest allowed step
CONTRACTION = 15  # of the last Newton iteration
FACTORED_STEP = 16  # step of the factors at hand, 0 for none
STAGE_STEP = 17  # step that the stages at hand belong to
N_REAL = 18

# Entries of Control.whole
FIXED_STEP = 0  # 1: no error control
OUTPUT = 1  # next entry of the output times
NEEDS_JACOBIAN = 2
PREDICT = 3  # stages at hand: 0 useless, 1 of the last step, 2 of a rejected one
N_WHOLE = 4

# Why a loop returned
REACHED, CHUNK, TOO_SMALL, SINGULAR, OFF_CONSTRAINTS, NOT_FINITE, NO_CONVERGENCE = (
    range(7)
)


class Control(NamedTuple):
    """State of a step loop.

    real, whole : see the entries above
    z, v : current z_I and z_II
    elastic : (bodies,) largest elastic displacement so far [m]
    amplitude : per velocity coordinate, displacement per unit of an elastic coordinate
    frequency : per velocity coordinate, its angular frequency [rad/s]
    scale_z, scale_v : tolerated error per coordinate
    times : output times
    out_z, out_v : states there
    """

    real: Array
    whole: np.ndarray
    z: Array
    v: Array
    elastic: Array
    amplitude: Array
    frequency: Array
    scale_z: Array
    scale_v: Array
    times: Array
    out_z: Array
    out_v: Array


CONTROL = types.NamedTuple([F1, I1, F1, F1, F1, F1, F1, F1, F1, F1, F2, F2], Control)

#: Relative to the size of the mechanism: the elastic displacement below which the
#: error of a deformation is not resolved any further.
SMALLEST_DEFORMATION = 1e-7


@inner(types.void(SYSTEM, CONTROL))
def update_scales(system, control):
    """Tolerated errors: relative to the largest motion of each kind so far.

    Positions are measured against the size of the mechanism, not against their
    coordinates, so that moving the origin changes nothing. The error of elastic
    velocities may be as large as the frequency times that of the deformation.
    """
    real = control.real
    z, v = control.z, control.v
    tolerance = real[TOLERANCE]
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u = row[RD], row[NQ], row[VEL]
        q = row[POS] + row[NP] - nq
        turning = 2 if rd == 3 and row[NP] - nq == 3 else 3
        for k in range(rd):
            entry = SPEED if k < turning else SPIN
            real[entry] = max(real[entry], abs(v[u + k]))
        deformation = 0.0
        for k in range(nq):
            deformation = max(
                deformation, abs(z[q + k]) * control.amplitude[u + rd + k]
            )
        control.elastic[b] = max(control.elastic[b], deformation)
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row[RD], row[NQ], row[VEL], row[POS]
        rigid = row[NP] - nq
        planar_frame = rigid == 3 and rd == 3
        turning = 2 if planar_frame or rd == 2 else 3
        for k in range(rigid):
            control.scale_z[p + k] = tolerance * (real[LENGTH] if k < turning else 1.0)
        for k in range(rd):
            reference = real[SPEED] if k < turning else real[SPIN]
            control.scale_v[u + k] = tolerance * reference
        for k in range(nq):
            i = u + rd + k
            size = max(control.elastic[b], SMALLEST_DEFORMATION * real[LENGTH])
            scale = tolerance * size / control.amplitude[i]
            control.scale_z[p + rigid + k] = scale
            control.scale_v[i] = scale * max(control.frequency[i], 1.0 / real[PERIOD])


@inner(float64(F1, F1, F1, F1))
def scaled_norm(dz, dv, scale_z, scale_v):
    """Root mean square of an error relative to the tolerated one."""
    total = 0.0
    for i in range(len(dz)):
        total += (dz[i] / scale_z[i]) ** 2
    for i in range(len(dv)):
        total += (dv[i] / scale_v[i]) ** 2
    return math.sqrt(total / max(1, len(dz) + len(dv)))


@inner(boolean(F1, F1))
def all_finite(z, v):
    total = 0.0
    for i in range(len(z)):
        total += abs(z[i])
    for i in range(len(v)):
        total += abs(v[i])
    return math.isfinite(total)


@inner(types.void(F1, F1))
def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def accelerate(kernels, system, work, memory, t, z, v):
    """z_II' and lambda of eq. (3) with the constraints differentiated twice (index 1).

    Returns 0, or the code of a singular system.
    """
    kernels.evaluate(system, work, t, z, v)
    memory.counters[EVALUATIONS] += 1
    return kernels.solve_accelerations(system, work, memory)


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1, F1, F1, float64, float64))
def project(kernels, system, work, memory, t, z, v, dz, dv, near, still):
    """Brings z and v onto the constraints, then solves for accelerations.

    Done when every |c| <= near and |dc/dt| <= still. dz and dv are scratch.
    Returns 0, or a code when the constraints are singular or cannot be met.
    """
    m = system.dims[N_ROWS]
    for _ in range(6):
        kernels.evaluate(system, work, t, z, v)
        memory.counters[EVALUATIONS] += 1
        met = True
        for i in range(m):
            met = met and abs(work.row[i, C_VALUE]) <= near
            met = met and abs(work.row[i, C_RATE]) <= still
        if met:
            return kernels.solve_accelerations(system, work, memory)
        memory.counters[PROJECTIONS] += 1
        status = kernels.project_once(system, work, memory, dz, dv)
        if status != 0:
            return status
        kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
    return 3


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def take_jacobian(kernels, system, work, memory, t, z, v):
    """Linearises at the state that was just evaluated and solved."""
    kernels.linearise(system, work, t, z, v, memory.acceleration, memory.multiplier)
    kernels.remember(system, work, memory)
    memory.counters[JACOBIANS] += 1


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def begin(kernels, system, work, memory, t, z, v):
    """`accelerate` for callers in Python."""
    return accelerate(kernels, system, work, memory, t, z, v)


@entry(
    types.void(
        KERNELS, SYSTEM, WORK, MEMORY, F1, F1, F1, F2, F2, F2, F2, F3, F3, F2, F2
    )
)
def sample(
    kernels,
    system,
    work,
    memory,
    closed,
    times,
    edges,
    z,
    v,
    step_z,
    step_v,
    frames,
    points,
    acc,
    lam,
):
    """Projects recorded states onto the constraints and solves eq. (3) there.

    Dense output meets the constraints to the tolerance of the run only; what is
    recorded meets them to `closed` (|c|, |dc/dt|). States that cannot be projected stay
    as they are; accelerations are NaN where eq. (3) is singular. step_z and step_v
    are scratch, of one and three rows.
    """
    for k in range(len(times)):
        i = 0
        while i + 2 < len(edges) and edges[i + 1] < times[k]:
            i += 1
        work.clock[0] = 0.5 * (edges[i] + edges[i + 1])
        copy(z[k], step_z[0])
        copy(v[k], step_v[0])
        status = project(
            kernels,
            system,
            work,
            memory,
            times[k],
            step_z[0],
            step_v[0],
            step_v[1],
            step_v[2],
            closed[0],
            closed[1],
        )
        if status == 0:
            copy(step_z[0], z[k])
            copy(step_v[0], v[k])
        else:
            status = accelerate(kernels, system, work, memory, times[k], z[k], v[k])
        for b in range(work.frame.shape[0]):
            copy(work.frame[b], frames[k, b])
        for m in range(work.point.shape[0]):
            copy(work.point[m], points[k, m])
        copy(memory.acceleration, acc[k])
        copy(memory.multiplier, lam[k])
        if status != 0:
            for n in range(acc.shape[1]):
                acc[k, n] = math.nan
            for n in range(lam.shape[1]):
                lam[k, n] = math.nan
