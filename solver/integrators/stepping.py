"""The state of a step loop, and why one returned."""

from __future__ import annotations

import numpy as np
from numba import types

from sidtool.formats.sid import Array

from ..compiler.compiling import inner
from ..compiler.tables import Table, TableType
from ..space.layout import F1, F2, I1

# Entries of Control.real
TIME = 0  # current time
STOP = 1  # end of the smooth interval
STEP = 2  # proposed step
OLD_STEP = 3  # last accepted step, 0 at a start
OLD_ERROR = 4  # its error estimate
TOLERANCE = 5  # relative tolerance
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
UNTURNED = 19  # step in which nothing turns or moves too far to be followed
CLEAREST = 20  # largest independence so far
DECLINE = 21  # mean slope of the independence in the last step, 0 for unknown
PART = 22  # of the tolerance, that the present step may use up
MISSED = 23  # errors of all steps, in units of the tolerated one
BEGIN = 24  # of the run
FRONTIER = 25  # step beyond which Newton's iteration has failed lately
MOTION = 26  # largest displacement so far [m]
MOTION_RATE = 27  # its speed now
MOTION_PUSH = 28  # its acceleration now
ROTATION = 29  # largest rotation so far [rad]
ROTATION_RATE = 30
ROTATION_PUSH = 31
NOISE = 32  # what rounding may be of tolerated errors, at most
N_REAL = 33

# Entries of Control.whole
FIXED_STEP = 0  # 1: no error control
OUTPUT = 1  # next entry of `Control.times`
NEEDS_JACOBIAN = 2
PREDICT = 3  # stages at hand: 0 useless, 1 of the last step, 2 of a rejected one
SHARE = 4  # next entry of the shares
STIFF = 5  # steps that stability, not accuracy, has limited
FAILURES = 6  # attempts of the present step that failed
CROSSING = 7  # how the step lies to a singular position, see `singular`
JACOBIAN = 8  # the one at hand, see below
SAME = 9  # steps of the same length before this one
WELL = 10  # steps since one with which Newton's iteration failed
CROSSED = 11  # steps that may have passed a singular configuration
ADDING = 12  # 1: steps may err by their share of what the run may
N_WHOLE = 13

#: Of a step before, of the beginning of this step, or of its end.
KEPT, FRESH, AHEAD = range(3)

#: A scene is stiff when stability limits more than one step in so many; between such
#: steps the error control tries longer ones.
STIFF_PART = 4

#: Sums of fixed steps miss the end of an interval by less than this part of a step.
STUB = 1e-3

#: Steps may miss the tolerance on average so many times where it is hidden in rounding.
MOST_MISSED = 2.0

#: The least tolerance that numbers resolve where errors add up.
FINEST = 5e-10


# Why a loop returned
REACHED, CHUNK, TOO_SMALL, OFF_CONSTRAINTS, NOT_FINITE, NO_CONVERGENCE = range(6)
CRAWLING, BLURRED, BESIDE, FULL = 6, 7, 8, 9


class Control(Table):
    """State of a step loop.

    real, whole : see the entries above
    z, v : current z_I and z_II
    start : z at the beginning of the run
    extent : (bodies,) of each body [m]
    elastic : (bodies,) largest elastic displacement so far [m]
    coming : (bodies, 4) speed and acceleration of the deformation [m/s, m/s2], and how
        far each can go in a vibration [m]
    amplitude : per velocity coordinate, displacement per unit of an elastic coordinate
    frequency : per velocity coordinate, its angular frequency [rad/s]
    pace : per velocity coordinate, the largest so far of its kind
    scale_z, scale_v : tolerated error per coordinate
    closed : (rows, 2) |c| and |dc/dt| below which each constraint is met
    times : the next output times; the last one lies beyond a step that is made, or is
        infinite
    shares : of steps, at which dense output is wanted beside the output times; a
        negative one ends the list of a step
    moments : the times of the shares
    out_z, out_v : states at the output times, then at the moments
    features : (2 forces + 2,) where in starts and reaches those of the functions of
        time begin, then those of each force over its measure and over its rate, and
        where the last end
    starts, reaches : pieces that steps may not pass unseen, see `features`
    measured : (forces, 5) measures of the forces and their rates at the beginning of a
        step, then at its end, and the whole turn of those that tell no turns, else 0
    passed : (2 forces, 2) how often fixed steps passed a feature of a force over its
        measure and over its rate, and when first [s]
    crossed : steps that may have passed a singular configuration, see `bifurcations`
    """

    real: Array
    whole: np.ndarray
    z: Array
    v: Array
    start: Array
    extent: Array
    elastic: Array
    coming: Array
    amplitude: Array
    frequency: Array
    pace: Array
    scale_z: Array
    scale_v: Array
    closed: Array
    times: Array
    shares: Array
    moments: Array
    out_z: Array
    out_v: Array
    features: np.ndarray
    starts: Array
    reaches: Array
    measured: Array
    passed: Array
    crossed: Array


CONTROL = TableType(
    Control,
    [F1, I1]
    + [F1] * 5
    + [F2]
    + [F1] * 5
    + [F2]
    + [F1] * 3
    + [F2, F2]
    + [I1, F1, F1, F2, F2, F2],
)


@inner(types.void(F1, F1))
def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]
