"""State of a step loop, and the codes with which one returns."""

from ..compiler.kernels import inner
from ..compiler.tables import Table, TableType
from ..compiler.types import void
from ..spatial.system_arrays import F1, Integers, Reals, Reals2

#: Of a step before, of the beginning of this step, or of its end.
OLD_JACOBIAN, CURRENT_JACOBIAN, STEP_END_JACOBIAN = range(3)

#: A scene is stiff when stability limits more than one step in so many; between such
#: steps the error control tries longer ones.
STIFF_STEP_FRACTION = 4

#: Sums of fixed steps miss the end of an interval by less than this part of a step.
END_TOLERANCE = 1e-3

#: Steps may miss the tolerance on average so many times where it is hidden in rounding.
MAX_ACCUMULATED_ERROR = 2.0

#: The least tolerance that numbers resolve where errors add up.
MIN_TOLERANCE = 5e-10


#: Part of a step whose end was refused that is tried next.
RETRY_FRACTION = 0.5

# Why a loop returned
INTERVAL_END, STEPS_DONE, TOO_SMALL, OFF_CONSTRAINTS, NOT_FINITE, NO_CONVERGENCE = (
    range(6)
)
TOO_STIFF, BELOW_ROUNDING, NEAR_SINGULARITY, OUTPUT_FULL = 6, 7, 8, 9


class StepLoopState(Table):
    r"""State of a step loop, shared by all integrators.

    Attributes
    ----------
    z, v : (n_positions,), (n_velocities,)
        Current z_I and z_II.
    initial_position : (n_positions,)
        z_I at the beginning of the run.
    extent : (n_bodies,)
        Size of each body [m].
    largest_deformation : (n_bodies,)
        Largest elastic displacement so far [m].
    deformation_rates : (n_bodies, 4)
        Speed and acceleration of the deformation [m/s, m/s2], and how far each can go
        in a vibration [m].
    amplitude : (n_velocities,)
        Displacement per unit of an elastic coordinate.
    frequency : (n_velocities,)
        Angular frequency of the coordinate [rad/s].
    largest_velocity : (n_velocities,)
        Largest velocity so far of the kind of the coordinate.
    scale_z, scale_v
        Tolerated error of each coordinate.
    constraint_tolerance : (n_rows, 2)
        \|c\| and \|dc/dt\| below which each constraint is met.
    output_times
        The next output times; the last one lies beyond a step that is made, or is
        infinite.
    output_fractions
        Fractions of a step at which dense output is wanted besides the output times; a
        negative one ends the list of a step.
    fraction_times
        The times of these fractions.
    output_z, output_v
        States at the output times, then at the fractions.
    feature_offsets : (2 n_forces + 2,)
        Where the features of the functions of time begin in `feature_starts`, then
        those of each force over its measure and over its rate; last the end.
    feature_starts, feature_lengths
        Features that steps must not skip.
    feature_corners
        1 where a feature begins with a corner of a force, at which steps end.
    force_measures : (n_forces, 5)
        Measures of the forces and their rates at the beginning and at the end of a
        step, and a full turn for those that are not counted over full turns, else 0.
    passed_features : (2 n_forces, 2)
        How often fixed steps skipped a feature of a force over its measure and over its
        rate, and the time of the first one [s].
    crossing_steps
        Steps that may have passed a singular configuration.
    """

    time: float  # current time
    stop: float  # end of the smooth interval
    step: float  # proposed step
    old_step: float  # last accepted step, 0 at a start
    old_error: float  # its error estimate
    relative_tolerance: float  # relative tolerance
    mechanism_length: float  # size of the mechanism [m]
    duration: float  # duration of the run [s]
    independence: float  # of the constraints, see `linear.mass_matrix`
    singular_time: float  # when they become dependent if it goes on falling
    largest_speed: float  # largest speed so far
    largest_angular_velocity: float  # largest angular velocity so far
    position_drift: float  # largest |c| met at the end of a step, after projection
    velocity_drift: float
    largest_step: float  # largest allowed step
    contraction: float  # of the last Newton iteration
    factored_step: float  # step of the factors at hand, 0 for none
    stage_step: float  # step that the stages at hand belong to
    spectral_radius: (
        float  # wanted spectral radius at infinite frequency, of methods that have one
    )
    rotation_step_limit: (
        float  # step in which nothing turns or moves too far to be followed
    )
    largest_independence: float  # largest independence so far
    independence_slope: (
        float  # mean slope of the independence in the last step, 0 for unknown
    )
    tolerance_share: float  # of the tolerance, that the present step may use up
    accumulated_error: float  # errors of all steps, in units of the tolerated one
    start_time: float  # of the run
    newton_step_limit: float  # step beyond which Newton's iteration has failed lately
    largest_motion: float  # largest displacement so far [m]
    motion_speed: float  # its speed now
    motion_acceleration: float  # its acceleration now
    largest_rotation: float  # largest rotation so far [rad]
    rotation_speed: float
    rotation_acceleration: float
    rounding_noise: float  # what rounding may be of tolerated errors, at most
    fixed_step: int  # 1: no error control
    next_output: int  # next entry of `Control.times`
    needs_jacobian: int
    stage_prediction: (
        int  # stages at hand: 0 useless, 1 of the last step, 2 of a rejected one
    )
    fraction_index: int  # next entry of the shares
    stiff_steps: int  # steps that stability, not accuracy, has limited
    step_failures: int  # attempts of the present step that failed
    corner_tries: int  # those of them that looked for a corner of a force
    retry_fraction: float  # part of a step whose end was refused that is tried next
    singular_proximity: int  # how the step lies to a singular position, see `singular`
    jacobian: int  # the one at hand, see below
    equal_steps: int  # steps of the same length before this one
    steps_since_failure: int  # steps since one with which Newton's iteration failed
    n_crossings: int  # steps that may have passed a singular configuration
    errors_accumulate: (
        int  # 1: errors of rigid motions last, 0: drives prescribe all of them
    )
    shares_tolerance: int  # 1: the tolerance of a step is its share of that of the run
    accumulation_radians: (
        float  # radians in a run from which on errors of free motions add up
    )
    max_reduction: (
        float  # times that steps are held to less for that, in runs of some turns
    )
    z: Reals
    v: Reals
    initial_position: Reals
    extent: Reals
    largest_deformation: Reals
    deformation_rates: Reals2
    amplitude: Reals
    frequency: Reals
    largest_velocity: Reals
    scale_z: Reals
    scale_v: Reals
    constraint_tolerance: Reals2
    output_times: Reals
    output_fractions: Reals
    fraction_times: Reals
    output_z: Reals2
    output_v: Reals2
    feature_offsets: Integers
    feature_starts: Reals
    feature_lengths: Reals
    feature_corners: Reals
    force_measures: Reals2
    passed_features: Reals2
    crossing_steps: Reals2


CONTROL = TableType(StepLoopState)


@inner(void(F1, F1))
def copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]
