"""Rows of the constraints: one primitive, a weighted sum of primitives, or inactive."""

import math

from ..compiler.kernels import inner
from ..compiler.types import void
from ..compiler.vectors import formula
from ..spatial.system_arrays import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    COUPLED_ANGLE,
    COUPLED_DISPLACEMENT,
    SYSTEM,
    TERM_PLANAR,
    TERM_SPATIAL,
    W_CONSTANT,
    W_FIRST,
    W_PERIOD,
    W_WEIGHT,
    WORK,
)
from .marker_forces import add_generalised_force


@formula
def offset_at(n, data):
    """Where the constant of a direction like n stands: behind an angle or a vector."""
    return data + (1 if len(n) == 2 else 3)


@formula
def term_at(n, data):
    """Where a term of a coupling stands, in the space of vectors like n."""
    return data + (TERM_PLANAR if len(n) == 2 else TERM_SPATIAL)


@inner()
def is_coupled(kind):
    return kind in (COUPLED_ANGLE, COUPLED_DISPLACEMENT)


@inner()
def write_row(work, r, value, rate, gamma):
    row = work.row[r]
    row.value, row.rate, row.gamma = value, rate, gamma


@inner()
def add_jacobian(system, work, con, i, force, torque_a, torque_b):
    """Row i of a constraint in C: `force` on B, its reverse on A, and two torques."""
    if con.seg_a >= 0:
        o = system.segment[con.seg_a + i].offset
        add_generalised_force(system, work, work.C, o, con.a, -force, torque_a)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b + i].offset
        add_generalised_force(system, work, work.C, o, con.b, force, torque_b)


@inner()
def add_term(system, work, r, term, value, rate, gamma):
    """Adds one weighted coordinate of a coupling to its row.

    Angles are known up to whole turns; the sum is known up to its period, and the value
    nearest to zero is taken.
    """
    real_data, row = system.real_data, work.row[r]
    if real_data[term + W_FIRST] > 0.0:
        write_row(work, r, 0.0, 0.0, 0.0)
    weight, period = real_data[term + W_WEIGHT], real_data[term + W_PERIOD]
    total = row.value + weight * value - real_data[term + W_CONSTANT]
    if period > 0.0:
        total -= period * math.floor(total / period + 0.5)
    row.value = total
    row.rate += weight * rate
    row.gamma += weight * gamma


@inner(void(SYSTEM, WORK))
def clear_inactive_rows(system, work):
    """Constraint rows that are left out are zero, whatever the state."""
    for k in range(len(system.inactive_segments)):
        segment_ = system.inactive_segments[k]
        for column in (C_VALUE, C_RATE, C_GAMMA):
            work.row[segment_.row, column] = 0.0
        for i in range(segment_.offset, segment_.offset + segment_.size):
            work.C[i] = 0.0


@inner(void(SYSTEM, WORK))
def clear_inactive_derivatives(system, work):
    """The same of their derivatives, after the constraints were linearised."""
    for k in range(len(system.inactive_segments)):
        segment_ = system.inactive_segments[k]
        for i in range(segment_.offset, segment_.offset + segment_.size):
            work.Gp[i] = 0.0
            work.Gv[i] = 0.0
