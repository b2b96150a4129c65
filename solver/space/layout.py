"""The flat arrays that kernels read and write, and their compiled types.

`System` is the immutable description of a compiled scene: small integer tables (one
row per body, marker, constraint, ...) whose columns are named below, and one pool of
real numbers that the tables point into. `Work` holds everything that changes during
a run. Kernels are free functions on the two.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numba import float64, int64, types
from numpy.typing import NDArray

from sidtool.formats.sid import Array

from ..compiler.tables import Table, TableType
from ..compiler.views import ViewType
from . import rows

IntTable = NDArray[np.int64]
F1, F2, F3 = (ViewType(float64, ndim) for ndim in (1, 2, 3))
C1, C2, C3 = (ViewType(types.complex128, ndim) for ndim in (1, 2, 3))
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
STATE = 256  # no body: its velocity is a state of a law
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
ALONG = 1  # n_A . (x_B - x_A) = s(t), direction n fixed in marker A
ANGLE = 2  # angle from A to B about their common axis = s(t)
DISTANCE = 3  # |x_B - x_A| = L(t)
PERPENDICULAR = 4  # a_A . b_B = 0, directions fixed in the markers (spatial)
# Terms of one row: a weighted sum of angles and displacements is constant. The
# constraints that share a row follow each other in System.constraint.
COUPLED_ANGLE = 5
COUPLED_ALONG = 6

# --- numbers of a term of a coupling, after those of the direction in the pool
W_WEIGHT = 0
W_CONSTANT = 1  # subtracted
W_PERIOD = 2  # the sum is known up to multiples of it, 0 for exactly
W_FIRST = 3  # 1: the first term of its row
TERM_PLANAR = 2  # where the term stands in the data of a constraint
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
F_SEG_A = 3  # entries of Work.C of the force row, -1 where there is none
F_SEG_B = 4
F_DATA = 5  # pool: direction, or components of a given force
F_LAW = 6  # pool: force law, see `forces`
F_TIME = 7  # function of time that scales what is applied, -1 for none
F_TURN = 8  # entry of Work.turn of a torque about an axis in space, -1 for none
F_CODE = 9  # pool: its law, see `forces.programs`; -1 for none
F_OWNER = 10  # row of the law that reads this measure, which is no force; -1 for forces
F_SAMPLED = 11  # 1: its law is asked at samples only, see `equations.law_at`
N_FORCE = 12

# --- kinds of forces: each belongs to a scalar measure of the markers' motion -----
GIVEN = 0  # force and torque on marker B, components along inertial axes
FOLLOWING = 1  # the same, components along the axes of the marker
SPAN = 2  # along the line between the markers; their distance
SLIDE = 3  # along a direction fixed in marker A; the displacement of B along it
TWIST = 4  # torque about an axis fixed in marker A; the angle from A to B
TILT = 5  # component of the rotation vector from A to B (spatial)
LEAN = 6  # scalar product of a direction of A and one of B (spatial)
SPIN = 7  # rate only: of the rotation from A to B along a direction of A (spatial)
COMBINED = 8  # a weighted sum of the measures of the rows before it, see `forces.all`
COORDINATE = 9  # elastic coordinate F_DATA of the body F_B
PRESCRIBED = 10  # no force: value of a drive; rows F_A and F_B are its derivatives

# --- columns of System.turn: rotations from marker A to B in space, of the kind TWIST,
# TILT or LEAN. Orientations tell them up to full turns; those that are counted go on
# from what stands at the end of z_I: their values where the step began.
# Kind, markers A and B, pool: directions of TWIST and LEAN, first entry of Work.turn:
# TILT has three, others one; the counted first.
N_TURN = 5

# --- columns of System.friction: joints with friction, see `friction` ------
R_LAW = 0  # pool, see below
R_LOAD = 1  # pool: for each place of contact two rows of weights, one per load row
R_PLACES = 2
R_COUNT = 3  # constraint rows that make the load
R_ROWS = 4  # those rows
R_NEWTON = 9  # its row in Newton matrices, then those of its load
MOST_LOADS = 5
N_FRICTION = R_NEWTON + 1 + MOST_LOADS

# --- numbers of a friction law in the pool
L_SLIDING = 0  # coefficients of sliding and of rest
L_STATIC = 1
L_SPEED = 2  # of the surfaces, over which one becomes the other; 0: at once
L_VISCOUS = 3
L_ARM = 4  # radius of the pin, 1 for what slides
L_PERIOD = 5  # the coordinate is known up to multiples of it, 0 for exactly

# --- columns of System.grip: what a run changes
SENSE = 0  # 1 or -1: slides with a growing or a falling coordinate; 0: sticks
HELD = 1  # the coordinate where it sticks
SHARED = 2  # 1: others stick that hold the same motion, and share what that takes
LED = 3  # above 0: joints and drives prescribe its motion, which rests below that rate
SIDE = 4  # of each place of contact, 1 or -1: where it is pressed; 0: on any side
MOST_PLACES = 2
N_GRIP = SIDE + MOST_PLACES

# --- columns of Work.row: one constraint row ------------------------------
C_VALUE = 0  # c(z_I, t)
C_RATE = 1  # dc/dt
C_GAMMA = 2  # right-hand side of C z_II' = gamma
N_ROW = 3

# --- columns of System.dropped: row, first entry in Work.C and its likes, size
N_DROPPED = 3

# --- columns of Work.turn -------------------------------------------------
TURNED = 0
TURN_RATE = 1
N_TURNED = 5  # behind them the inertial torque on marker B that works on the angle

#: Fields that the parts of a system have of their own.
OWN_OF_PARTS = {
    "newton": ("body", "segment", "slack", "n_rows", "bandwidth"),
    "sliding": ("constraint", "segment", "slack", "dropped", "n_rows"),
}


class System(Table):
    """A compiled scene.

    body, marker, constraint, segment, drive : integer tables, columns as above
    planar : 1 in the plane
    n_pos, n_vel, n_rows : of z_I, of z_II and of constraints
    bandwidth : of the Schur complement
    n_phi : entries of Work.phi
    n_entries : of Work.C that belong to constraints; friction rows follow
    n_sliding : entries of Work.C before those of force rows
    n_turns : entries of Work.turn that are counted, the last ones of z_I
    pool : all real data
    gravity : (3,) acceleration in the inertial frame [m/s2]
    slack : (rows,) added to the diagonal of the Schur complement: positive for
        constraints that depend on each other, which share their force, see
        `sidtool.solver.start.minimum_norm`
    force, turn : integer tables, columns as above
    dropped : segments of constraint rows that are left out, see
        `sidtool.solver.start.overconstraint`
    newton : the same for Newton matrices, whose rows are constraints and forces, see
        `newton`: other body, segment, slack, rows and bandwidth
    friction : integer table, columns as above
    grip : (frictions, N_GRIP) how joints with friction move; a run changes a copy of
        its own
    sliding : the same with the coordinates of joints with friction as constraints, each
        a row: other constraint, segment and rows
    """

    body: Annotated[IntTable, rows.BODY]
    marker: Annotated[IntTable, rows.MARKER]
    constraint: Annotated[IntTable, rows.CONSTRAINT]
    segment: Annotated[IntTable, rows.SEGMENT]
    drive: Integers2
    planar: int
    n_pos: int
    n_vel: int
    n_rows: int
    bandwidth: int
    n_phi: int
    n_entries: int
    n_sliding: int
    n_turns: int
    pool: Reals
    gravity: Reals
    slack: Reals
    force: Annotated[IntTable, rows.FORCE]
    turn: Annotated[IntTable, rows.TURN]
    dropped: Annotated[IntTable, rows.DROPPED]
    newton: System
    friction: Integers2
    grip: Reals2
    sliding: System

    def replaced(self, **changes: Any) -> System:
        """The same scene with other values of some fields, also in `newton` and
        `sliding`."""
        given = {k: v for k, v in changes.items() if k not in OWN_OF_PARTS}
        for part, own in OWN_OF_PARTS.items():
            shared = {k: v for k, v in given.items() if k not in own}
            inner = getattr(self, part)
            if shared and inner is not None and part not in changes:
                changes[part] = inner.replaced(**shared)
        return super().replaced(**changes)


class Work(Table):
    """Everything that kernels write.

    frame : (bodies, .) state of the body frames
    point : (markers, .) state of the markers
    phi : Phi and Psi of the markers at the current elastic coordinates
    M, Rp, Rv : NV x NV blocks of the bodies: mass matrix, whose elastic part changes
        only for stiffened bodies, and derivatives of M z_II' - f - C^T lambda by
        positions and velocities
    f : generalised force
    C, Gp, Gv : segments of the constraint Jacobian and of the derivatives of the
        constraint accelerations by positions and velocities; then those of the force
        rows: the direction of a force, and minus the derivatives of its size
    row : (rows, N_ROW) values, rates and right-hand sides of the constraints
    turn : (angles, N_TURNED) rotations between markers in space
    measure : (forces, 2) measures that forces act on, and their rates
    factor : (forces,) functions of time and laws that scale what is applied
    slope : (forces, 2) of a measure that a law reads: the derivatives of what the law
        yields by it and by its rate
    stack, lapse : of laws, see `forces.programs`
    clock : (1,) a time inside the smooth interval that is being integrated
    rub, load : (frictions,) force or torque along the coordinates of joints with
        friction, and the loads that make it
    rubbing : (frictions, MOST_LOADS) derivatives of the limit of friction by the
        multipliers that make the load
    sliding : the same with the rows of `System.sliding`: other row
    scratch, modal, stiffened, turning : intermediate results of one body
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
    turn: Reals2
    measure: Reals2
    factor: Reals
    slope: Reals2
    stack: Reals
    lapse: Reals
    clock: Reals
    scratch: Reals
    modal: Reals
    stiffened: Reals
    turning: Reals
    rub: Reals
    load: Reals
    rubbing: Reals2
    sliding: Work


class Told(Table):
    """What outputs tell of some states, one after the other; rows as in `spaces`.

    wrench : of all constraints, frictions of joints and forces
    force : of all forces
    body : of all bodies
    """

    wrench: Reals2
    force: Reals2
    body: Reals2


SYSTEM, WORK, TOLD = TableType(System), TableType(Work), TableType(Told)
