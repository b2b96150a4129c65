"""Rows of the constraints: one primitive alone, a weighted sum, or left out."""

from __future__ import annotations

import math

from numba import types

from ..compiler.compiling import inner
from ..compiler.values import formula
from ..space.layout import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    SYSTEM,
    TERM_PLANAR,
    TERM_SPATIAL,
    W_CONSTANT,
    W_FIRST,
    W_PERIOD,
    W_WEIGHT,
    WORK,
)
from .marker_rows import segment


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
    return kind in (COUPLED_ANGLE, COUPLED_ALONG)


@inner()
def write_row(work, r, value, rate, gamma):
    row = work.row[r]
    row.value, row.rate, row.gamma = value, rate, gamma


@inner()
def add_jacobian(system, work, con, i, force, torque_a, torque_b):
    """Row i of a constraint in C: `force` on B, its reverse on A, and two torques."""
    if con.seg_a >= 0:
        o = system.segment[con.seg_a + i].offset
        segment(system, work, work.C, o, con.a, -force, torque_a)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b + i].offset
        segment(system, work, work.C, o, con.b, force, torque_b)


@inner()
def add_term(system, work, r, term, value, rate, gamma):
    """Adds one weighted coordinate of a coupling to its row.

    Angles are known up to whole turns; the sum is known up to its period, and the
    value nearest to zero is taken.
    """
    pool, row = system.pool, work.row[r]
    if pool[term + W_FIRST] > 0.0:
        write_row(work, r, 0.0, 0.0, 0.0)
    weight, period = pool[term + W_WEIGHT], pool[term + W_PERIOD]
    total = row.value + weight * value - pool[term + W_CONSTANT]
    if period > 0.0:
        total -= period * math.floor(total / period + 0.5)
    row.value = total
    row.rate += weight * rate
    row.gamma += weight * gamma


@inner(types.void(SYSTEM, WORK))
def drop_rows(system, work):
    """Constraint rows that are left out are zero, whatever the state."""
    for k in range(len(system.dropped)):
        piece = system.dropped[k]
        for column in (C_VALUE, C_RATE, C_GAMMA):
            work.row[piece.row, column] = 0.0
        for i in range(piece.offset, piece.offset + piece.size):
            work.C[i] = 0.0


@inner(types.void(SYSTEM, WORK))
def drop_derivatives(system, work):
    """The same of their derivatives, after the constraints were linearised."""
    for k in range(len(system.dropped)):
        piece = system.dropped[k]
        for i in range(piece.offset, piece.offset + piece.size):
            work.Gp[i] = 0.0
            work.Gv[i] = 0.0
