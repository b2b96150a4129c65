"""What a run keeps of factors, and the kernels that it calls."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import complex128, float64, int64, types

from sidtool.formats.sid import Array

from ..compiler.tables import Table, TableType
from ..compiler.views import PointerType
from ..space.coordinates import RATE, RETRACT
from ..space.layout import (
    C1,
    C2,
    C3,
    F1,
    F2,
    F3,
    I1,
    I2,
    SYSTEM,
    WORK,
)
from .lapack import LAPACK, Lapack


class Factors(Table):
    """Factored saddle-point systems, one after another, see `saddle_factor`.

    x, p, g : scratch of one entry per velocity, and per row of the Newton matrix
    lapack : for large blocks
    """

    A: np.ndarray
    G: np.ndarray
    Y: np.ndarray
    S: np.ndarray
    pivots: np.ndarray
    row_pivots: np.ndarray
    x: np.ndarray
    p: np.ndarray
    g: np.ndarray
    lapack: Lapack


class ComplexFactors(Factors):
    """The same of complex systems."""


REAL_FACTORS = TableType(Factors, [F2] * 3 + [F3, I2, I2] + [F1] * 3 + [LAPACK])
COMPLEX_FACTORS = TableType(
    ComplexFactors, [C2] * 3 + [C3, I2, I2] + [C1] * 3 + [LAPACK]
)


class Memory(Table):
    """Factors and vectors of one run.

    real, complex : of Newton matrices: one, and one for each pair of complex
        eigenvalues of a method
    mass_* : factors for accelerations and projections, see `mass_factor`
    M, C, frame : the mass matrix, constraint Jacobian and body frames at the state
        where the Newton matrix was made
    metric : blocks of tau^2 K, the stiffness part of the projection metric
    acceleration, multiplier : solution of eq. (3) at the last evaluated state
    dx, dmu : scratch of one entry per velocity and per constraint row
    counters : see `N_COUNTERS`
    rub_* : scratch for friction of joints, see `friction`
    """

    real: Factors
    complex: Factors
    mass_A: Array
    mass_W: Array
    mass_S: Array
    M: Array
    C: Array
    frame: Array
    metric: Array
    acceleration: Array
    multiplier: Array
    dx: Array
    dmu: Array
    counters: np.ndarray
    rub_X: Array
    rub_L: Array
    rub_P: Array
    rub_A: Array
    rub_t: Array
    rub_pivots: np.ndarray


MEMORY = TableType(
    Memory,
    [REAL_FACTORS, COMPLEX_FACTORS]
    + [F1, F1, F2]
    + [F1, F1, F2, F1, F1, F1, F1, F1, I1]
    + [F2] * 4
    + [F1, I1],
)

#: evaluate(system, work, t, z_I, z_II)
EVALUATE = types.void(SYSTEM, WORK, float64, F1, F1)
#: linearise(system, work, t, z_I, z_II, z_II', lambda), after evaluate at that state
LINEARISE = types.void(SYSTEM, WORK, float64, F1, F1, F1, F1)
#: complete(system, work, z_II'), after evaluate at that state
COMPLETE = types.void(SYSTEM, WORK, F1)
SOLVE_ACCELERATIONS = int64(SYSTEM, WORK, MEMORY)
PROJECT_ONCE = int64(SYSTEM, WORK, MEMORY, float64, F1, F1)
REMEMBER = types.void(SYSTEM, WORK, MEMORY)
FACTOR_REAL = int64(SYSTEM, WORK, MEMORY, REAL_FACTORS, int64, float64)
FACTOR_COMPLEX = int64(SYSTEM, WORK, MEMORY, COMPLEX_FACTORS, int64, complex128)
SOLVE_REAL = types.void(*FACTOR_REAL.args, F1, F1)
SOLVE_COMPLEX = types.void(*FACTOR_COMPLEX.args, C1, C1)


class Kernels(Table):
    """Pointers to the kernels of a run, so that each is compiled once and alone."""

    evaluate: Any
    linearise: Any
    solve_accelerations: Any
    project_once: Any
    remember: Any
    factor_real: Any
    factor_complex: Any
    solve_real: Any
    solve_complex: Any
    rate: Any
    retract: Any
    complete: Any


SIGNATURES = (
    EVALUATE,
    LINEARISE,
    SOLVE_ACCELERATIONS,
    PROJECT_ONCE,
    REMEMBER,
    FACTOR_REAL,
    FACTOR_COMPLEX,
    SOLVE_REAL,
    SOLVE_COMPLEX,
    RATE,
    RETRACT,
    COMPLETE,
)
KERNELS = TableType(Kernels, [PointerType(sig) for sig in SIGNATURES])

# Columns of Memory.counters
STEPS, REJECTED, EVALUATIONS, JACOBIANS, FACTORISATIONS, ITERATIONS, PROJECTIONS = (
    range(7)
)
N_COUNTERS = 7
