"""Storage of the factors of a run, and pointers to the kernels that it calls."""

from typing import Annotated, Any

from ..compiler.arrays import PointerType
from ..compiler.tables import Table, TableType
from ..compiler.types import complex128, float64, int64, void
from ..spatial.coordinates import RATE, RETRACT
from ..spatial.system_arrays import (
    C1,
    F1,
    SYSTEM,
    WORK,
    Complexes,
    Complexes2,
    Complexes3,
    Integers,
    Integers2,
    Reals,
    Reals2,
    Reals3,
)
from .block_factors import Lapack


class Factors(Table):
    """Factored saddle-point systems, see `saddle_factor`.

    Attributes
    ----------
    x, p, g
        Scratch of one entry per velocity, and per row of the Newton matrix.
    lapack
        LAPACK routines for large blocks.
    """

    A: Reals2
    G: Reals2
    Y: Reals2
    S: Reals3
    pivots: Integers2
    row_pivots: Integers2
    x: Reals
    p: Reals
    g: Reals
    lapack: Lapack


class ComplexFactors(Table):
    """The same of complex systems."""

    A: Complexes2
    G: Complexes2
    Y: Complexes2
    S: Complexes3
    pivots: Integers2
    row_pivots: Integers2
    x: Complexes
    p: Complexes
    g: Complexes
    lapack: Lapack


REAL_FACTORS, COMPLEX_FACTORS = TableType(Factors), TableType(ComplexFactors)


class Memory(Table):
    """Factors, vectors and counters of one run.

    Attributes
    ----------
    real, complex
        Factors of the Newton matrices: a real one, and a complex one for each pair of
        complex eigenvalues of the method.
    mass_A, mass_W, mass_S
        Factors for accelerations and projections, see `mass_factor`.
    M, C, frame
        Mass matrix, constraint Jacobian and body frames at the state of the last Newton
        matrix.
    metric
        Blocks of tau^2 K, the stiffness part of the projection metric.
    acceleration, multiplier
        Solution of eq. (3) at the state evaluated last.
    dx, dmu
        Scratch, one entry per velocity and per constraint row.
    steps, rejected, ...
        Counters of the run.
    friction_X, friction_L, friction_P, friction_A, friction_t, friction_pivots
        Scratch of the friction of joints, see `joint_friction`.
    """

    real: Factors
    complex: ComplexFactors
    mass_A: Reals
    mass_W: Reals
    mass_S: Reals2
    M: Reals
    C: Reals
    frame: Reals2
    metric: Reals
    acceleration: Reals
    multiplier: Reals
    dx: Reals
    dmu: Reals
    steps: int
    rejected: int
    evaluations: int
    jacobians: int
    factorisations: int
    newton_iterations: int
    projections: int
    friction_X: Reals2
    friction_L: Reals2
    friction_P: Reals2
    friction_A: Reals2
    friction_t: Reals
    friction_pivots: Integers


MEMORY = TableType(Memory)

#: evaluate(system, work, t, z_I, z_II)
EVALUATE = void(SYSTEM, WORK, float64, F1, F1)
#: linearise(system, work, t, z_I, z_II, z_II', lambda), after evaluate at that state
LINEARISE = void(SYSTEM, WORK, float64, F1, F1, F1, F1)
#: complete(system, work, z_II'), after evaluate at that state
COMPLETE = void(SYSTEM, WORK, F1)
SOLVE_ACCELERATIONS = int64(SYSTEM, WORK, MEMORY)
PROJECT_ONCE = int64(SYSTEM, WORK, MEMORY, float64, F1, F1)
STORE_LINEARISATION = void(SYSTEM, WORK, MEMORY)
FACTOR_REAL = int64(SYSTEM, WORK, MEMORY, REAL_FACTORS, int64, float64)
FACTOR_COMPLEX = int64(SYSTEM, WORK, MEMORY, COMPLEX_FACTORS, int64, complex128)
SOLVE_REAL = void(*FACTOR_REAL.args, F1, F1)
SOLVE_COMPLEX = void(*FACTOR_COMPLEX.args, C1, C1)


class Kernels(Table):
    """Pointers to the kernels of a run, so that each is compiled once and alone."""

    evaluate: Annotated[Any, PointerType(EVALUATE)]
    linearise: Annotated[Any, PointerType(LINEARISE)]
    solve_accelerations: Annotated[Any, PointerType(SOLVE_ACCELERATIONS)]
    project_once: Annotated[Any, PointerType(PROJECT_ONCE)]
    store_linearisation: Annotated[Any, PointerType(STORE_LINEARISATION)]
    factor_real: Annotated[Any, PointerType(FACTOR_REAL)]
    factor_complex: Annotated[Any, PointerType(FACTOR_COMPLEX)]
    solve_real: Annotated[Any, PointerType(SOLVE_REAL)]
    solve_complex: Annotated[Any, PointerType(SOLVE_COMPLEX)]
    rate: Annotated[Any, PointerType(RATE)]
    retract: Annotated[Any, PointerType(RETRACT)]
    complete: Annotated[Any, PointerType(COMPLETE)]


KERNELS = TableType(Kernels)
