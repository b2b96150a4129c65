"""What the step loops of all integrators share: control, scaling, dense output."""

from __future__ import annotations

import math

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
    N_TURNS,
    NP,
    NQ,
    PLANAR,
    POS,
    RD,
    SYSTEM,
    TURN_RATE,
    TURNED,
    VEL,
    WORK,
)
from ..kernels.newton import (
    EVALUATIONS,
    JACOBIANS,
    KERNELS,
    MEMORY,
    PROJECTIONS,
    REJECTED,
)
from ..kernels.saddle import REGULARISATION
from ..kernels.tables import Table, TableType

# Entries of Control.real
TIME = 0  # current time
STOP = 1  # end of the smooth interval
STEP = 2  # proposed step
OLD_STEP = 3  # last accepted step, 0 at a start
OLD_ERROR = 4  # its error estimate
TOLERANCE = 5  # relative tolerance per step
LENGTH = 6  # size of the mechanism [m]
PERIOD = 7  # duration of the run [s]
INDEPENDENCE = 8  # of the constraints, see `kernels.mass`
SINGULAR = 9  # when they become dependent if it goes on falling
SPEED = 10  # largest speed so far
SPIN = 11  # largest angular velocity so far
DRIFT = 12  # largest |c| met at the end of a step, after projection
DRIFT_RATE = 13
LARGEST = 14  # largest allowed step
CONTRACTION = 15  # of the last Newton iteration
FACTORED_STEP = 16  # step of the factors at hand, 0 for none
STAGE_STEP = 17  # step that the stages at hand belong to
RADIUS = 18  # wanted spectral radius at infinite frequency, of methods that have one
UNTURNED = 19  # step in which nothing turns too far to count its turns
CLEAREST = 20  # largest independence so far
DECLINE = 21  # mean slope of the independence in the last step, 0 for unknown
REQUEST = 22  # what TOLERANCE is for methods of high order, whose errors hardly add up
MISSED = 23  # mean error of steps over the run, in units of the tolerated one
BEGIN = 24  # of the run
FRONTIER = 25  # step beyond which Newton's iteration has failed lately
N_REAL = 26

# Entries of Control.whole
FIXED_STEP = 0  # 1: no error control
OUTPUT = 1  # next entry of the output times
NEEDS_JACOBIAN = 2
PREDICT = 3  # stages at hand: 0 useless, 1 of the last step, 2 of a rejected one
SHARE = 4  # next entry of the shares
STIFF = 5  # steps that stability, not accuracy, has limited
FAILURES = 6  # attempts of the present step that failed
CROSSING = 7  # how the step lies to a singular position, see `singular`
JACOBIAN = 8  # the one at hand, see below
SAME = 9  # steps of the same length before this one
WELL = 10  # steps since one with which Newton's iteration failed
N_WHOLE = 11

#: Of a step before, of the beginning of this step, or of its end.
KEPT, FRESH, AHEAD = range(3)

#: A scene is stiff when stability limits more than one step in so many; between such
#: steps the error control tries longer ones.
STIFF_PART = 4

#: Sums of fixed steps miss the end of an interval by less than this part of a step.
STUB = 1e-3

#: Steps may miss the tolerance on average so many times where it is hidden in rounding.
MOST_MISSED = 2.0

#: The least tolerance per step that numbers resolve.
FINEST = 1e-15

#: Most attempts of a projection.
PROJECTIONS_LIMIT = 6
#: Attempts after which positions that meet the constraints are not moved any more.
SETTLING = 3

# Why a loop returned
REACHED, CHUNK, TOO_SMALL, OFF_CONSTRAINTS, NOT_FINITE, NO_CONVERGENCE = range(6)
CRAWLING, BLURRED, BESIDE = 6, 7, 8


class Control(Table):
    """State of a step loop.

    real, whole : see the entries above
    z, v : current z_I and z_II
    elastic : (bodies,) largest elastic displacement so far [m]
    amplitude : per velocity coordinate, displacement per unit of an elastic coordinate
    frequency : per velocity coordinate, its angular frequency [rad/s]
    scale_z, scale_v : tolerated error per coordinate
    closed : (rows, 2) |c| and |dc/dt| below which each constraint is met
    times : output times
    shares : of steps, at which dense output is wanted beside the output times; a
        negative one ends the list of a step
    moments : the times of the shares
    out_z, out_v : states at the output times, then at the moments
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
    closed: Array
    times: Array
    shares: Array
    moments: Array
    out_z: Array
    out_v: Array


CONTROL = TableType(Control, [F1, I1] + [F1] * 7 + [F2] + [F1] * 3 + [F2, F2])

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
SAFETY = 0.9
#: Part of a step with which Newton's iteration failed that the next ones may have, and
#: the factor by which each step that succeeds has this limit grow. It is set where
#: the iteration has failed so few steps before: that is no single event.
RETREAT, ADVANCE, OFTEN = 0.8, 1.05, 4

#: For methods that a change of the step disturbs: the factor by which steps grow, and
#: the number of steps after which the last change has died out.
LONGER, SETTLED = 1.5, 10

#: Most that one marker turns against another in a step where turns are counted, of the
#: half turn that two orientations tell [rad].
LARGEST_TURN = 2.5

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


@inner(types.void(F1, F1))
def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]


@inner(float64(CONTROL))
def next_step(control):
    """Proposed step, stretched or halved so that the interval ends without a stub.

    Zero when the end of the interval is reached.
    """
    real = control.real
    remaining = real[STOP] - real[TIME]
    if remaining <= 1e-13 * max(abs(real[STOP]), real[PERIOD]):
        return 0.0
    fixed = control.whole[FIXED_STEP] == 1
    h = real[STEP] if fixed else min(real[STEP], real[LARGEST], real[UNTURNED])
    if h >= remaining * (1.0 - (STUB if fixed else 1e-9)):
        return remaining
    if h > 0.5 * remaining and not fixed:
        return 0.5 * remaining
    return h


@inner(boolean(CONTROL, float64))
def too_small(control, h):
    """Whether the time does not resolve a step."""
    return h <= 1e-13 * max(abs(control.real[TIME]), control.real[PERIOD])


@inner(int64(CONTROL))
def newton_limit(control):
    """Iterations after which Newton's iteration is given up."""
    if control.whole[FIXED_STEP] == 1:
        return PATIENT_NEWTON_LIMIT
    return NEWTON_LIMIT


@inner(float64(CONTROL))
def newton_goal(control):
    """What Newton's iteration may leave of the tolerance (Hairer, Wanner, IV.8)."""
    tolerance = control.real[TOLERANCE]
    return max(1e-14 / tolerance, min(0.03, math.sqrt(tolerance)))


@inner(int64(CONTROL, float64, int64, float64, float64))
def judge(control, goal, iteration, norm, old_norm):
    """What a Newton correction of scaled size `norm` says: 1 done, 0 go on, -1 stop.

    The contraction of the iteration is kept in the control; 1 or more is unknown.
    """
    real = control.real
    if not math.isfinite(norm):
        return -1
    if norm == 0.0:
        real[CONTRACTION] = 0.0
        return 1
    if iteration > 0:
        real[CONTRACTION] = norm / old_norm
    contraction = real[CONTRACTION]
    if contraction < 1.0 and contraction / (1.0 - contraction) * norm < goal:
        return 1
    if iteration == 0:
        return 0
    if contraction >= 1.0 and norm < STAGNATION:
        return 1
    if control.whole[FIXED_STEP] == 1 and iteration < PATIENCE:
        return 0
    left = newton_limit(control) - 1 - iteration
    if (
        contraction >= 1.0
        or math.pow(contraction, left) / (1.0 - contraction) * norm > goal
    ):
        return -1
    return 0


@inner(types.void(CONTROL))
def fade_contraction(control):
    """Lets a single iteration do as long as the contraction was seen lately."""
    known = max(control.real[CONTRACTION], LEAST_CONTRACTION)
    control.real[CONTRACTION] = known**FADING


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
    real, whole = control.real, control.whole
    whole[NEEDS_JACOBIAN] = 1 if real[CONTRACTION] > serves else 0
    if whole[FIXED_STEP] == 1:
        real[OLD_STEP] = h
        return
    factor = growth(order, error, iterations)
    if real[OLD_STEP] > 0.0 and real[OLD_ERROR] > 0.0:
        ratio = h / real[OLD_STEP]
        change = (real[OLD_ERROR] / max(error, 1e-10)) ** (1.0 / (order + 1))
        factor = min(factor, max(0.15, factor * ratio * change))
    if failures > 0:
        factor = min(factor, 1.0)
    factor = min(factor, real[FRONTIER] / h)
    real[FRONTIER] *= ADVANCE
    whole[WELL] += 1
    real[OLD_STEP] = h
    real[OLD_ERROR] = max(1e-2, error)
    if whole[NEEDS_JACOBIAN] == 0 and 1.0 <= factor < 1.2:
        factor = 1.0
    real[STEP] = h * factor


@inner(types.void(CONTROL, int64, float64, float64, float64, int64, int64))
def keep_step(control, order, serves, h, error, iterations, failures):
    """`finish_step` of methods that a change of the step disturbs.

    Steps are lengthened when the last change has died out, by one factor or not at all.
    """
    real, whole = control.real, control.whole
    whole[NEEDS_JACOBIAN] = 1 if real[CONTRACTION] > serves else 0
    same = abs(h - real[OLD_STEP]) <= STUB * h
    whole[SAME] = whole[SAME] + 1 if same else 0
    real[OLD_STEP] = h
    if whole[FIXED_STEP] == 1:
        return
    real[STEP] = h
    if whole[SAME] >= SETTLED and growth(order, error, iterations) > LONGER:
        real[STEP] = LONGER * h


@inner(int64(CONTROL, float64))
def output_due(control, h):
    """The row of the next state that is wanted inside the step, or -1."""
    k, t = control.whole[OUTPUT], control.real[TIME]
    slack = 1e-12 * max(h, abs(t))
    if k < len(control.times) and control.times[k] <= t + h + slack:
        control.whole[OUTPUT] += 1
        return k
    i = control.whole[SHARE]
    if i == len(control.shares):
        return -1
    control.whole[SHARE] += 1
    if control.shares[i] < 0.0:
        return -1
    control.moments[i] = t + control.shares[i] * h
    return len(control.times) + i


@inner(float64(CONTROL, int64, float64))
def share_of_step(control, k, h):
    """Where the state of row k lies in the step, from 0 to 1."""
    count = len(control.times)
    if k < count:
        return (control.times[k] - control.real[TIME]) / h
    return control.shares[k - count]


@inner(types.void(SYSTEM, WORK, CONTROL))
def note_drift(system, work, control):
    """Keeps the largest residuals of the constraints, just evaluated."""
    real = control.real
    for i in range(system.dims[N_ROWS]):
        real[DRIFT] = max(real[DRIFT], abs(work.row[i, C_VALUE]))
        real[DRIFT_RATE] = max(real[DRIFT_RATE], abs(work.row[i, C_RATE]))


@inner(int64(SYSTEM, WORK, CONTROL, float64, F1))
def count_turns(system, work, control, h, z):
    """Lets z, at the end of a step and just evaluated, say how far its markers turned.

    Returns 0, or 4 when they turned too far in the step to be sure.
    """
    count = system.dims[N_TURNS]
    first, fastest = len(z) - count, 0.0
    for i in range(count):
        way = abs(work.turn[i, TURNED] - z[first + i])
        fastest = max(fastest, way / h, abs(work.turn[i, TURN_RATE]))
    if h * fastest > LARGEST_TURN:
        return 4
    control.real[UNTURNED] = 0.8 * LARGEST_TURN / max(fastest, 1e-300)
    for i in range(count):
        z[first + i] = work.turn[i, TURNED]
    return 0


@inner(types.void(CONTROL, float64, F1, F1))
def move(control, h, z, v):
    """Makes the state at the end of a step the current one."""
    real = control.real
    copy(z, control.z)
    copy(v, control.v)
    real[TIME] += h
    if real[STOP] - real[TIME] <= 1e-13 * max(abs(real[STOP]), real[PERIOD]):
        real[TIME] = real[STOP]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def accelerate(kernels, system, work, memory, t, z, v):
    """z_II' and lambda of eq. (3) with the constraints differentiated twice (index 1).

    Returns 0, or the code of a singular system.
    """
    kernels.evaluate(system, work, t, z, v)
    memory.counters[EVALUATIONS] += 1
    return kernels.solve_accelerations(system, work, memory)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1, F1, F1, F2))
def project(kernels, system, work, memory, t, z, v, dz, dv, closed):
    """Brings z and v onto the constraints, then solves for accelerations.

    Done when every |c| and |dc/dt| is below those in `closed`, at the last attempt a
    hundred times that. dz and dv are scratch.
    Quaternions get unit length even where no constraint moves their body. Positions
    that meet the constraints stay in the last attempts: near a singular position, to
    move them by rounding spoils velocities.
    Returns 0, or a code when the constraints are singular or cannot be met.
    """
    m = system.dims[N_ROWS]
    if system.dims[PLANAR] == 0:
        for i in range(len(dz)):
            dz[i] = 0.0
        kernels.retract(system, work.frame, z, dz)
    for attempt in range(PROJECTIONS_LIMIT):
        kernels.evaluate(system, work, t, z, v)
        memory.counters[EVALUATIONS] += 1
        loose = 1.0 if attempt + 1 < PROJECTIONS_LIMIT else 100.0
        placed = still = True
        for i in range(m):
            placed = placed and abs(work.row[i, C_VALUE]) <= loose * closed[i, 0]
            still = still and abs(work.row[i, C_RATE]) <= loose * closed[i, 1]
        if placed and still:
            return kernels.solve_accelerations(system, work, memory)
        memory.counters[PROJECTIONS] += 1
        status = kernels.project_once(system, work, memory, REGULARISATION, dz, dv)
        if status != 0:
            return status
        if attempt < SETTLING or not placed:
            kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
    return 3


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1))
def take_jacobian(kernels, system, work, memory, control, t, z, v):
    """Linearises at a state that was just evaluated and solved."""
    kernels.linearise(system, work, t, z, v, memory.acceleration, memory.multiplier)
    kernels.remember(system, work, memory)
    memory.counters[JACOBIANS] += 1
    control.real[FACTORED_STEP] = 0.0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL))
def look_back(kernels, system, work, memory, control):
    """Linearises at the current state again, after others were evaluated."""
    t, z, v = control.real[TIME], control.z, control.v
    accelerate(kernels, system, work, memory, t, z, v)
    take_jacobian(kernels, system, work, memory, control, t, z, v)
    control.whole[JACOBIAN] = FRESH


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64))
def after_divergence(kernels, system, work, memory, control, h):
    """Factor for the step after Newton's iteration failed; 0 when nothing helps.

    A Jacobian that is not fresh is renewed first; then the step is halved, and the next
    ones are limited if this happens often. A fixed one is tried with the Jacobian of
    its end.
    """
    whole = control.whole
    if whole[FIXED_STEP] == 1 and whole[JACOBIAN] == AHEAD:
        return 0.0
    if whole[FIXED_STEP] == 1 and whole[JACOBIAN] == FRESH:
        whole[JACOBIAN] = AHEAD
        return 1.0
    if whole[JACOBIAN] != KEPT:
        memory.counters[REJECTED] += 1
        again = 0 < whole[WELL] < OFTEN
        if again or 2.0 * h > control.real[FRONTIER]:
            control.real[FRONTIER] = RETREAT * h
        whole[WELL] = 0
        return 0.5
    look_back(kernels, system, work, memory, control)
    return 1.0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64))
def factor_real(kernels, system, work, memory, mu):
    """Factors mu - J for a real mu; 0 on success."""
    return kernels.factor_real(
        system,
        work,
        memory,
        memory.real_lapack,
        mu,
        memory.real_A,
        memory.real_G,
        memory.real_Y,
        memory.real_S,
        memory.real_pivots,
        memory.real_row_pivots,
    )


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1, F1, F1, F1))
def solve_real(kernels, system, work, memory, mu, rz, rv, x, p, g):
    """Solves (mu - J) (dz, dv) = (rz, rv) in place with that factor."""
    kernels.solve_real(
        system,
        work,
        memory,
        memory.real_lapack,
        mu,
        memory.real_A,
        memory.real_G,
        memory.real_Y,
        memory.real_S,
        memory.real_pivots,
        memory.real_row_pivots,
        rz,
        rv,
        x,
        p,
        g,
    )


@inner(types.void(KERNELS, SYSTEM, MEMORY, CONTROL, float64, F1, F1, F1, F1, F1))
def write_cubic(kernels, system, memory, control, h, z1, v1, rate0, acc0, rate1):
    """Dense output: the cubic with the states and slopes at both ends of the step."""
    k = output_due(control, h)
    if k < 0:
        return
    kernels.rate(system, z1, v1, rate1)
    acc1 = memory.acceleration
    while k >= 0:
        s = share_of_step(control, k, h)
        end = s * s * (3.0 - 2.0 * s)
        first, last = h * s * (1.0 - s) * (1.0 - s), h * s * s * (s - 1.0)
        for i in range(len(z1)):
            control.out_z[k, i] = (1.0 - end) * control.z[i] + end * z1[i]
            control.out_z[k, i] += first * rate0[i] + last * rate1[i]
        for i in range(len(v1)):
            control.out_v[k, i] = (1.0 - end) * control.v[i] + end * v1[i]
            control.out_v[k, i] += first * acc0[i] + last * acc1[i]
        k = output_due(control, h)


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def begin(kernels, system, work, memory, t, z, v):
    """`accelerate` for callers in Python."""
    return accelerate(kernels, system, work, memory, t, z, v)


@entry(
    types.void(
        KERNELS, SYSTEM, WORK, MEMORY, F2, F1, F1, F2, F2, F2, F2, F3, F3, F2, F2
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
    recorded meets them to `closed`, see `Control`. States that cannot be projected stay
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
            closed,
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
        first = z.shape[1] - system.dims[N_TURNS]
        for i in range(system.dims[N_TURNS]):
            z[k, first + i] = work.turn[i, TURNED]
        copy(memory.acceleration, acc[k])
        copy(memory.multiplier, lam[k])
        if status != 0:
            for n in range(acc.shape[1]):
                acc[k, n] = math.nan
            for n in range(lam.shape[1]):
                lam[k, n] = math.nan
