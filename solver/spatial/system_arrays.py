"""Constants, columns and arrays of a compiled scene, as kernels see them.

`SystemArrays` is read only, `WorkArrays` is written by every evaluation, and
`OutputArrays` is written by the kernels of output quantities.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..compiler.arrays import ViewType
from ..compiler.kernels import inner
from ..compiler.records import RecordType, RowsType
from ..compiler.tables import Table, TableType
from ..compiler.types import boolean, complex128, float64, int64


def _integers(name: str, *fields: str) -> RowsType:
    return RowsType(RecordType(name, **dict.fromkeys(fields, int64)))


# In the order of the columns below.
BODY = _integers(
    "Body", "nq", "nv", "rd", "pos", "vel", "np", "block", "seg0", "seg1", "data",
    "flags", "motion", "base", "tip", "drive", "frame",
)  # fmt: skip
MARKER = _integers("Marker", "body", "data", "phi", "phi1", "psi1")
CONSTRAINT = _integers(
    "Constraint", "kind", "row", "a", "b", "seg_a", "seg_b", "data", "drive", "law",
)  # fmt: skip
SEGMENT = _integers("Segment", "row", "body", "offset")
FORCE = _integers(
    "Force", "kind", "a", "b", "seg_a", "seg_b", "data", "law", "time", "rotation",
    "code", "owner", "sampled",
)  # fmt: skip
ROTATION_COUNTER = _integers("Turn", "kind", "a", "b", "data", "entry")
INACTIVE_SEGMENT = _integers("Dropped", "row", "offset", "size")


IntTable = NDArray[np.int64]
F1, F2, F3 = (ViewType(float64, ndim) for ndim in (1, 2, 3))
C1, C2, C3 = (ViewType(complex128, ndim) for ndim in (1, 2, 3))
I1, I2 = (ViewType(int64, ndim) for ndim in (1, 2))
# Fields of tables
Reals = Annotated[Array, F1]
Reals2 = Annotated[Array, F2]
Reals3 = Annotated[Array, F3]
Complexes = Annotated[NDArray[np.complex128], C1]
Complexes2 = Annotated[NDArray[np.complex128], C2]
Complexes3 = Annotated[NDArray[np.complex128], C3]
Integers = Annotated[IntTable, I1]
Integers2 = Annotated[IntTable, I2]

# --- columns of System.body -----------------------------------------------
NQ = 0  # number of elastic coordinates
NV = 1  # number of velocity coordinates: RD + NQ
RD = 2  # rigid velocities: planar 3, 2 (no rotation), 0 (prescribed frame)
POS = 3  # first position coordinate in z_I
VEL = 4  # first velocity coordinate in z_II
NP = 5  # number of position coordinates
BLOCK = 6  # first entry of the body's NV x NV blocks
SEG0 = 7  # first and one past the last constraint segment of the body
SEG1 = 8
DATA = 9  # inertia and elasticity in the pool
FLAGS = 10  # which optional terms are present
MOTION = 11  # prescribed frame: kind of the joint to the base marker, else FREE
BASE = 12  # prescribed frame: marker on the base body
TIP = 13  # prescribed frame: marker on this body
DRIVE = 14  # prescribed frame: drive of the joint, -1 for none
FRAME = 15  # pool offset of the constant orientation of a body without rotation
N_BODY = 16

# --- kinds of prescribed frame --------------------------------------------
FREE = 0
GROUND = 1
FIXED = 2
REVOLUTE = 3
PRISMATIC = 4

# --- optional terms and shapes of matrices (bits of FLAGS) ----------------
HAS_CR1 = 1
HAS_OE1 = 4
HAS_CT1 = 8
HAS_QUADRATIC_J = 16
DIAGONAL_ME = 32
HAS_KE1 = 64
STIFFENED = 128  # Ct and Cr have terms of a displacement field of second order
LAW_STATE = 256  # no body: its velocity is a state of a law
DIAGONAL_KE = 512
DIAGONAL_DE = 1024

# --- columns of System.marker ---------------------------------------------
M_BODY = 0
M_DATA = 1  # pool: undeformed position, orientation, Phi, Psi
M_PHI = 2  # Work.phi: Phi, then Psi, at the current elastic coordinates
M_PHI1 = 3  # pool: derivative of Phi (geometric stiffening), -1 for none
M_PSI1 = 4  # pool: derivative of Psi, likewise
N_MARKER = 5

# --- columns of System.constraint -----------------------------------------
KIND = 0
ROW = 1  # first row of c
MARKER_A = 2
MARKER_B = 3
SEG_A = 4  # first segment of marker A and B, -1 where the body has no coordinates
SEG_B = 5
C_DATA = 6  # pool: direction or offset
C_DRIVE = 7  # drive of the prescribed value, -1 for none
C_LAW = 8  # row of the table of forces whose law gives it instead, -1 for none
N_CONSTRAINT = 9

# --- kinds of primitive constraints between marker A and marker B ---------
COINCIDENT = 0  # positions agree: planar 2 rows, spatial 3 rows
DISPLACEMENT = 1  # n_A . (x_B - x_A) = s(t), direction n fixed in marker A
ANGLE = 2  # angle from A to B about their common axis = s(t)
DISTANCE = 3  # |x_B - x_A| = L(t)
PERPENDICULAR = 4  # a_A . b_B = 0, directions fixed in the markers (spatial)
# Terms of one row: a weighted sum of angles and displacements is constant. The
# constraints that share a row follow each other in System.constraint.
COUPLED_ANGLE = 5
COUPLED_DISPLACEMENT = 6

# --- numbers of a term of a coupling, after those of the direction in the pool
W_WEIGHT = 0
W_CONSTANT = 1  # subtracted
W_PERIOD = 2  # the sum is known up to multiples of it, 0 for exactly
W_FIRST = 3  # 1: the first term of its row
TERM_PLANAR = 2  # index of the term in the data of a constraint
TERM_SPATIAL = 6

# --- columns of System.segment: the entries of one row of C that belong to
S_ROW = 0
S_BODY = 1
S_OFFSET = 2  # first entry in Work.C and its likes
N_SEGMENT = 3

# --- columns of System.drive: functions of time ---------------------------
D_PIECES = 0
D_TERMS = 1  # coefficients per piece
D_DATA = 2  # pool, see the kinds
D_KIND = 3
N_DRIVE = 4

# --- kinds of functions of time -------------------------------------------
POLYNOMIAL = 0  # starts of the pieces, coefficients of (t - start), lowest power first
SMOOTH = 1  # edges of the pieces, coefficients on each as on [-1, 1]: one smooth curve
HARMONIC = 2  # offset, amplitude, angular frequency, phase
RAMP = 3  # begin, end, value before, change by the ramp, 1 for that of the rate, rate
SUM = 4  # of D_PIECES rows from D_DATA on, see `FunctionTable.table`

# --- columns of System.force ----------------------------------------------
F_KIND = 0
F_A = 1  # markers: the force acts on B, and backwards on A; -1 for none
F_B = 2
F_SEG_A = 3  # entries of WorkArrays.C of the force row, -1 where there is none
F_SEG_B = 4
F_DATA = 5  # pool: direction, or components of a given force
F_LAW = 6  # pool: force law, see `forces`
F_TIME = 7  # function of time that scales what is applied, -1 for none
F_ROTATION = 8  # row of rotation_counter of a torque about an axis, -1 for none
F_CODE = 9  # pool: its law, see `control_laws`; -1 for none
F_OWNER = 10  # row of the law that reads this measure, which is no force; -1 for forces
F_SAMPLED = 11  # 1: its law is asked at samples only, see `law_value_at`
N_FORCE = 12

# --- kinds of forces: each belongs to a scalar measure of the markers' motion -----
INERTIAL_LOAD = 0  # force and torque on marker B, components along inertial axes
FOLLOWER_LOAD = 1  # the same, components along the axes of the marker
DISTANCE_MEASURE = 2  # along the line between the markers; their distance
DISPLACEMENT_MEASURE = (
    3  # along a direction fixed in marker A; the displacement of B along it
)
ANGLE_MEASURE = 4  # torque about an axis fixed in marker A; the angle from A to B
ROTATION_VECTOR_MEASURE = 5  # component of the rotation vector from A to B (spatial)
DIRECTION_COSINE_MEASURE = (
    6  # scalar product of a direction of A and one of B (spatial)
)
ANGULAR_VELOCITY_MEASURE = (
    7  # rate only: of the rotation from A to B along a direction of A (spatial)
)
COMBINED_MEASURE = (
    8  # a weighted sum of the measures of the rows before it, see `dynamics.forces`
)
COORDINATE_MEASURE = 9  # elastic coordinate F_DATA of the body F_B
PRESCRIBED_VALUE = (
    10  # no force: value of a drive; rows F_A and F_B are its derivatives
)

# --- columns of SystemArrays.rotation_counter: rotations from marker A to B in space.
# Orientations give them up to full turns. Those that are counted continue from the end
# of z_I, which holds their values at the begin of the step.
# Columns: kind of the measure, markers A and B, place of its directions in the pool,
# first row of WorkArrays.rotation_counter (a rotation vector has three rows, others
# one). The counted ones come first.
N_ROTATION_COUNTER = 5

# --- columns of SystemArrays.friction: joints with friction, see `friction` ------
R_LAW = 0  # pool, see below
R_LOAD = 1  # pool: for each place of contact two rows of weights, one per load row
R_CONTACTS = 2
R_COUNT = 3  # constraint rows that make the load
R_ROWS = 4  # those rows
R_NEWTON = 9  # its row in Newton matrices, then those of its load
MAX_LOAD_ROWS = 5
N_FRICTION = R_NEWTON + 1 + MAX_LOAD_ROWS

# --- numbers of a friction law in the pool
L_SLIDING = 0  # coefficients of sliding and of rest
L_STATIC = 1
L_SPEED = 2  # of the surfaces, over which one becomes the other; 0: at once
L_VISCOUS = 3
L_RADIUS = 4  # radius of the pin, 1 for what slides
L_PERIOD = 5  # the coordinate is known up to multiples of it, 0 for exactly

# --- columns of SystemArrays.friction_state, which a run changes
SLIP_DIRECTION = 0  # 1 or -1: slides with a growing or a falling coordinate; 0: sticks
STICK_POSITION = 1  # the coordinate where it sticks
SHARES_MOTION = (
    2  # 1: others stick that hold the same motion, and share what that takes
)
REST_RATE = (
    3  # above 0: joints and drives prescribe its motion, which rests below that rate
)
AT_LIMIT = 4  # 1: slides with the coefficient of rest, as what breaks loose
CONTACT_SIDE = (
    5  # of each place of contact, 1 or -1: where it is pressed; 0: on any side
)
MAX_CONTACTS = 2
N_FRICTION_STATE = CONTACT_SIDE + MAX_CONTACTS

# --- columns of WorkArrays.row: one constraint row ------------------------------
C_VALUE = 0  # c(z_I, t)
C_RATE = 1  # dc/dt
C_GAMMA = 2  # right-hand side of C z_II' = gamma
N_ROW = 3

# --- columns of SystemArrays.inactive_segments: row, first entry in WorkArrays.C, size
N_INACTIVE_SEGMENT = 3

# --- columns of WorkArrays.rotation_counter ---------------------------------
ROTATION_VALUE = 0
ROTATION_RATE = 1
N_ROTATION_STATE = (
    5  # behind them the inertial torque on marker B that works on the angle
)

#: Fields that the parts of a system have of their own.
OWN_FIELDS_OF_SUBSYSTEMS = {
    "newton_subsystem": (
        "body",
        "segment",
        "regularisation",
        "n_rows",
        "bandwidth",
    ),
    "friction_subsystem": (
        "constraint",
        "segment",
        "regularisation",
        "inactive_segments",
        "n_rows",
    ),
}


class SystemArrays(Table):
    """Arrays of a compiled scene, read by the kernels.

    Attributes
    ----------
    body, marker, constraint, segment, drive, force, friction
        Integer tables; their columns are listed at the head of the module.
    planar
        1 in the plane, 0 in space.
    n_positions, n_velocities, n_rows
        Lengths of z_I and of z_II, number of constraint rows.
    bandwidth
        Bandwidth of the Schur complement of the constraints.
    n_phi
        Number of entries of `WorkArrays.phi`.
    n_entries
        Number of entries of `WorkArrays.C` that belong to constraints; the rows of
        friction follow.
    n_sliding
        Number of entries of `WorkArrays.C` before those of the force rows.
    n_rotation_counters
        Number of rotations that are counted over full turns, the last entries of z_I.
    real_data
        All real data of bodies, markers, forces and functions.
    gravity : (3,)
        Acceleration of gravity in the inertial frame [m/s2].
    regularisation : (n_rows,)
        Added to the diagonal of the Schur complement; positive for constraints that
        depend on each other, see `initial_state.redundant_constraints`.
    rotation_counter
        Integer table of the rotations between markers in space.
    inactive_segments
        Segments of constraint rows that are left out, see
        `initial_state.overconstraint`.
    newton_subsystem
        The arrays of the Newton matrix, whose rows are constraints and forces: other
        body, segment, regularisation, number of rows and bandwidth.
    friction_state : (n_frictions, N_FRICTION_STATE)
        Stick, slip direction and contact sides of joints with friction; each run
        changes a copy of its own.
    friction_subsystem
        The arrays with the coordinates of joints with friction as constraints: other
        constraint, segment and number of rows.
    """

    body: Annotated[IntTable, BODY]
    marker: Annotated[IntTable, MARKER]
    constraint: Annotated[IntTable, CONSTRAINT]
    segment: Annotated[IntTable, SEGMENT]
    drive: Integers2
    planar: int
    n_positions: int
    n_velocities: int
    n_rows: int
    bandwidth: int
    n_phi: int
    n_entries: int
    n_sliding: int
    n_rotation_counters: int
    real_data: Reals
    gravity: Reals
    regularisation: Reals
    force: Annotated[IntTable, FORCE]
    rotation_counter: Annotated[IntTable, ROTATION_COUNTER]
    inactive_segments: Annotated[IntTable, INACTIVE_SEGMENT]
    newton_subsystem: SystemArrays
    friction: Integers2
    friction_state: Reals2
    friction_subsystem: SystemArrays

    def replaced(self, **changes: Any) -> SystemArrays:
        """Copy with other values of some fields, also in the two subsystems."""
        given = {k: v for k, v in changes.items() if k not in OWN_FIELDS_OF_SUBSYSTEMS}
        for subsystem, own_fields in OWN_FIELDS_OF_SUBSYSTEMS.items():
            shared = {k: v for k, v in given.items() if k not in own_fields}
            inner = getattr(self, subsystem)
            if shared and inner is not None and subsystem not in changes:
                changes[subsystem] = inner.replaced(**shared)
        return super().replaced(**changes)


class WorkArrays(Table):
    """Work arrays of one evaluation; kernels write them.

    Attributes
    ----------
    frame : (n_bodies, .)
        State of the body frames.
    point : (n_markers, .)
        State of the markers.
    phi
        Phi and Psi of the markers at the current elastic coordinates.
    M, Rp, Rv
        Square blocks of the bodies: mass matrix, whose elastic part changes for
        stiffened bodies only, and derivatives of M z_II' - f - C^T lambda by positions
        and by velocities.
    f : (n_velocities,)
        Generalised forces.
    C, Gp, Gv
        Segments of the constraint Jacobian and of the derivatives of the constraint
        accelerations by positions and velocities; then those of the force rows: the
        direction of a force, and the negative derivatives of its value.
    row : (n_rows, N_ROW)
        Values, rates and right-hand sides of the constraints.
    rotation_counter : (n_rotations, N_ROTATION_STATE)
        Rotations between markers in space.
    measure : (n_forces, 2)
        Measures that forces act on, and their rates.
    force_scale : (n_forces,)
        Value of the function of time or of the law that scales an applied force.
    law_derivative : (n_forces, 2)
        Derivatives of the value of a law by a measure that it reads, and by its rate.
    stack, law_failure
        Stack of the interpreter of control laws, and its first failure.
    interval_time : (1,)
        A time inside the smooth interval that is integrated [s].
    friction_force, joint_load : (n_frictions,)
        Force or torque along the coordinates of joints with friction, and the loads
        that cause it.
    friction_limit_derivative : (n_frictions, MOST_LOADS)
        Derivatives of the friction limit by the multipliers that make the load.
    friction_subsystem
        The work arrays of `SystemArrays.friction_subsystem`: other rows.
    scratch, modal_scratch, stiffened_scratch, rotation_scratch
        Intermediate results of one body.
    """

    frame: Reals2
    point: Reals2
    phi: Reals
    M: Reals
    Rp: Reals
    Rv: Reals
    f: Reals
    C: Reals
    Gp: Reals
    Gv: Reals
    row: Reals2
    rotation_counter: Reals2
    measure: Reals2
    force_scale: Reals
    law_derivative: Reals2
    stack: Reals
    law_failure: Reals
    interval_time: Reals
    scratch: Reals
    modal_scratch: Reals
    stiffened_scratch: Reals
    rotation_scratch: Reals
    friction_force: Reals
    joint_load: Reals
    friction_limit_derivative: Reals2
    friction_subsystem: WorkArrays


class OutputArrays(Table):
    """Output arrays of some states in sequence; fields as in `dimension`.

    Attributes
    ----------
    wrench
        Wrenches of all constraints, joint frictions and forces.
    force
        Values of all forces.
    body
        Energies and momenta of all bodies.
    """

    wrench: Reals2
    force: Reals2
    body: Reals2


SYSTEM, WORK, OUTPUT_ARRAYS = (
    TableType(SystemArrays),
    TableType(WorkArrays),
    TableType(OutputArrays),
)


@inner(boolean(SYSTEM, int64))
def is_sticking(system, j):
    """True if friction holds a joint; never one whose motion is prescribed."""
    return (
        system.friction_state[j, SLIP_DIRECTION] == 0.0
        and system.friction_state[j, REST_RATE] == 0.0
    )


@inner(float64(SYSTEM, WORK, int64))
def slip_direction(system, work, j):
    """1 or -1 of a joint that slides; 0 where a prescribed motion rests."""
    direction, rest_rate = (
        system.friction_state[j, SLIP_DIRECTION],
        system.friction_state[j, REST_RATE],
    )
    rate = work.friction_subsystem.row[j, C_RATE]
    if rest_rate == 0.0:
        return direction
    if abs(rate) <= rest_rate:
        return 0.0
    if direction == 0.0:
        return 1.0 if rate > 0.0 else -1.0
    return direction
