"""The state of a step loop, and why one returned."""

from __future__ import annotations

from numba import types

from ..compiler.compiling import inner
from ..compiler.tables import Table, TableType
from ..space.layout import F1, Integers, Reals, Reals2

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


#: Part of a step whose end was refused that is tried next.
RETRY = 0.5

# Why a loop returned
REACHED, CHUNK, TOO_SMALL, OFF_CONSTRAINTS, NOT_FINITE, NO_CONVERGENCE = range(6)
CRAWLING, BLURRED, BESIDE, FULL = 6, 7, 8, 9


class Control(Table):
    """State of a step loop.

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
    corners : 1 where a start is a corner of a force, at which steps end
    measured : (forces, 5) measures of the forces and their rates at the beginning of a
        step, then at its end, and the whole turn of those that tell no turns, else 0
    passed : (2 forces, 2) how often fixed steps passed a feature of a force over its
        measure and over its rate, and when first [s]
    crossed : steps that may have passed a singular configuration, see `bifurcations`
    """

    time: float  # current time
    stop: float  # end of the smooth interval
    step: float  # proposed step
    old_step: float  # last accepted step, 0 at a start
    old_error: float  # its error estimate
    tolerance: float  # relative tolerance
    length: float  # size of the mechanism [m]
    period: float  # duration of the run [s]
    independence: float  # of the constraints, see `kernels.mass`
    singular: float  # when they become dependent if it goes on falling
    speed: float  # largest speed so far
    spin: float  # largest angular velocity so far
    drift: float  # largest |c| met at the end of a step, after projection
    drift_rate: float
    largest_step: float  # largest allowed step
    contraction: float  # of the last Newton iteration
    factored_step: float  # step of the factors at hand, 0 for none
    stage_step: float  # step that the stages at hand belong to
    radius: (
        float  # wanted spectral radius at infinite frequency, of methods that have one
    )
    unturned: float  # step in which nothing turns or moves too far to be followed
    clearest: float  # largest independence so far
    decline: float  # mean slope of the independence in the last step, 0 for unknown
    part: float  # of the tolerance, that the present step may use up
    missed: float  # errors of all steps, in units of the tolerated one
    begin: float  # of the run
    frontier: float  # step beyond which Newton's iteration has failed lately
    motion: float  # largest displacement so far [m]
    motion_rate: float  # its speed now
    motion_push: float  # its acceleration now
    rotation: float  # largest rotation so far [rad]
    rotation_rate: float
    rotation_push: float
    noise: float  # what rounding may be of tolerated errors, at most
    fixed_step: int  # 1: no error control
    output: int  # next entry of `Control.times`
    needs_jacobian: int
    predict: int  # stages at hand: 0 useless, 1 of the last step, 2 of a rejected one
    share: int  # next entry of the shares
    stiff_steps: int  # steps that stability, not accuracy, has limited
    failures: int  # attempts of the present step that failed
    corner_tries: int  # those of them that looked for a corner of a force
    retry: float  # part of a step whose end was refused that is tried next
    crossing: int  # how the step lies to a singular position, see `singular`
    jacobian: int  # the one at hand, see below
    same: int  # steps of the same length before this one
    well: int  # steps since one with which Newton's iteration failed
    crossings: int  # steps that may have passed a singular configuration
    accumulates: int  # 1: errors of rigid motions last, 0: drives prescribe all of them
    adding: int  # 1: steps may err by their share of what the run may
    many: float  # radians in a run from which on errors of free motions add up
    most: float  # times that steps are held to less for that, in runs of some turns
    z: Reals
    v: Reals
    start: Reals
    extent: Reals
    elastic: Reals
    coming: Reals2
    amplitude: Reals
    frequency: Reals
    pace: Reals
    scale_z: Reals
    scale_v: Reals
    closed: Reals2
    times: Reals
    shares: Reals
    moments: Reals
    out_z: Reals2
    out_v: Reals2
    features: Integers
    starts: Reals
    reaches: Reals
    corners: Reals
    measured: Reals2
    passed: Reals2
    crossed: Reals2


CONTROL = TableType(Control)


@inner(types.void(F1, F1))
def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]
