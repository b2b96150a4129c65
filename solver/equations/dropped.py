"""Constraint rows that are left out: zero, whatever the state."""

from __future__ import annotations

from numba import types

from ..compiler.compiling import inner
from ..space.layout import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    SYSTEM,
    WORK,
    X_OFFSET,
    X_ROW,
    X_SIZE,
)


@inner(types.void(SYSTEM, WORK))
def drop_rows(system, work):
    """After the constraints were evaluated."""
    for k in range(len(system.dropped)):
        piece = system.dropped[k]
        for column in (C_VALUE, C_RATE, C_GAMMA):
            work.row[piece[X_ROW], column] = 0.0
        for i in range(piece[X_OFFSET], piece[X_OFFSET] + piece[X_SIZE]):
            work.C[i] = 0.0


@inner(types.void(SYSTEM, WORK))
def drop_derivatives(system, work):
    """After the constraints were linearised."""
    for k in range(len(system.dropped)):
        piece = system.dropped[k]
        for i in range(piece[X_OFFSET], piece[X_OFFSET] + piece[X_SIZE]):
            work.Gp[i] = 0.0
            work.Gv[i] = 0.0
