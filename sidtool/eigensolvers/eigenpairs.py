"""The lowest eigenpairs of K v = lambda M v."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.extremes import first_largest
from sidtool.formats.base.sid import Array

from ..mesh.mesh import Indices
from ..mesh.quadratic_fields import softest_deformation
from .factorisation import begin_stage, engine_name, symmetric_factors
from .lanczos import ACCURATE, Accuracy, Pencil, dominant_vectors, expected_blocks
from .multigrid import MultigridFactors, multigrid_eigenvectors
from .projected_matrix import SymmetricMatrix, products_of_magnitudes
from .slepc import ProgressCounter, notify, slepc_eigenvectors

__all__ = [
    "equal_frequencies",
    "free_body_shift",
    "lowest_eigenpairs",
    "rotation_to_axes",
    "symmetric_factors",
]

Solve = Callable[[Array], Array]

#: Up to this size LAPACK is faster than a factorisation and Lanczos.
_DENSE_SIZE = 300
#: Smallest ratio of the lowest eigenvalue to its rounding error.
_MIN_RESOLUTION = 100.0
#: Eigenvalues that differ by less, relative to their size, are those of one frequency.
SAME_FREQUENCY = 1e-8
#: Those that differ by more are not equal, whatever rounding does to the stiffness.
_NEAR = 1e-5
#: Mean squares of the directions of two modes that differ by less are not distinct.
_DISTINCT = 1e-2


def equal_frequencies(
    values: Array, shapes: Array, stiffness: SymmetricMatrix
) -> list[Indices]:
    """Return the numbers of the modes, in groups of one frequency.

    Eigenvalues are equal if they differ by less than `SAME_FREQUENCY` of their size,
    or by less than the rounding of the stiffness: of thin bodies that is more.

    Parameters
    ----------
    values : (n,) eigenvalues, ascending
    shapes : (ndof, n) eigenvectors
    stiffness : (ndof, ndof)
    """
    gaps, sizes = np.diff(values), np.abs(values[1:])
    equal = gaps <= SAME_FREQUENCY * sizes
    near = np.flatnonzero(~equal & (gaps <= _NEAR * sizes))
    if near.size:
        equal[near] = gaps[near] <= _rounding(stiffness, shapes[:, near])
    return np.split(np.arange(len(values)), np.flatnonzero(~equal) + 1)


def rotation_to_axes(groups: list[Indices], shapes: Array, directions: Array) -> Array:
    """(n, n) the rotation of modes of one frequency to those along the axes.

    Any combination of such modes is a mode, and rounding decides which ones a solver
    finds. Of the two bending modes of a square bar, this gives the one in y and the one
    in z. Where the axes do not distinguish the modes, as those of a square plate, all
    but the first vanish at the place of the largest motion, and so on.

    Parameters
    ----------
    groups : numbers of the modes of one frequency, see `equal_frequencies`
    shapes : (ndof, n) displacements
    directions : (ndof,) 1, 2, 3 of displacements along x, y, z, and 0 of rotations
    """
    turns = np.eye(shapes.shape[1])
    for same in groups:
        if len(same) > 1:
            turns[np.ix_(same, same)] = _distinct_modes(shapes[:, same], directions)
    return turns


def _distinct_modes(shapes: Array, directions: Array) -> Array:
    """(k, k) the rotation of k modes of one frequency, see `rotation_to_axes`."""
    sizes, turn = np.linalg.eigh(shapes.T @ (directions[:, None] * shapes))
    jumps = np.flatnonzero(np.diff(sizes) > _DISTINCT * sizes[-1]) + 1
    for alike in np.split(np.arange(len(sizes)), jumps):
        for first in alike[:-1]:
            rest = turn[:, first : alike[-1] + 1]
            motion = shapes @ rest
            largest = motion[first_largest(np.einsum("ij,ij->i", motion, motion))]
            axes = np.linalg.qr(largest[:, None], mode="complete")[0]
            turn[:, first : alike[-1] + 1] = rest @ axes
    return turn


def _rounding(stiffness: SymmetricMatrix, vectors: Array) -> Array:
    """(n,) the rounding of v^T K v for unit masses [1/s^2].

    Terms of size |v|^T |K| |v| cancel in v^T K v, so that its rounding error is of
    that size times the unit roundoff.
    """
    parts = np.abs(vectors)
    products = products_of_magnitudes(stiffness, parts)
    return np.finfo(float).eps * np.einsum("ij,ij->j", parts, products)


def lowest_eigenpairs(
    stiffness: SymmetricMatrix,
    mass: SymmetricMatrix,
    count: int,
    *,
    shift: float | Callable[[], float] = 0.0,
    constraints: Array | None = None,
    rigid: Array | None = None,
    places: Array | None = None,
    static: Solve | None = None,
    accuracy: Accuracy = ACCURATE,
    multigrid: tuple[MultigridFactors, Array] | None = None,
) -> tuple[Array, Array]:
    """Return the `count` lowest eigenvalues, ascending, and M-orthonormal eigenvectors.

    Shift-invert block Lanczos, then one Rayleigh-Ritz step, which makes the vectors
    orthonormal to rounding. The start is fixed, so that the same matrices give the same
    result.

    Parameters
    ----------
    stiffness, mass : (n, n); mass positive definite, stiffness semidefinite
    shift : negative for a singular stiffness, see `free_body_shift` [1/s^2]; a function
        is called only if the shift is needed
    constraints : (k, n) independent conditions ``constraints @ v = 0``
    rigid : (n, r) known vectors of the eigenvalue 0 that meet the constraints
    places : (n, d) position of each unknown, see `symmetric_factors`
    static : function that returns responses to loads (n, k); they meet the constraints
        and contain no rigid motion (loads are balanced by inertia). By default
        K - shift M is factored, which is not possible with constraints
    accuracy : of the eigenvectors or eigenvalues
    multigrid : in place of `static`, of K with springs against the rigid motions, and
        its responses (n, k) to the constraints

    Returns
    -------
    (count,) and (n, count)

    Raises
    ------
    InputError : more eigenpairs than degrees of freedom are requested, or the matrices
        are no stiffness and mass.
    """
    rows = np.zeros((0, stiffness.shape[0])) if constraints is None else constraints
    n = stiffness.shape[0]
    known = np.zeros((n, 0)) if rigid is None else rigid
    if count > n - len(rows):
        raise InputError(
            f"{count} modes of a model with {n - len(rows)} free degrees of freedom",
            expected=f"at most {n - len(rows)}",
        )
    dense = n <= _DENSE_SIZE or count > n // 3
    value_of_shift = 0.0
    if not callable(shift):
        value_of_shift = shift
    elif static is None or dense or engine_name() == "slepc":
        value_of_shift = shift()
    try:
        pencil = Pencil(stiffness, mass, value_of_shift, rows, known)
        space = (
            _dense_space(pencil, count)
            if dense
            else _invariant_space(pencil, count, places, static, accuracy, multigrid)
        )
        values, vectors = _ritz_pairs(stiffness, mass, space)
    except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"the eigenproblem has no solution ({error})",
            expected="a body of positive mass and of a stiffness of ordinary size, "
            "without hinges between its elements",
        ) from error
    if shift == 0.0 or known.shape[1]:
        first = min(known.shape[1], count - 1)
        _check_resolution(stiffness, values[first], vectors[:, first])
    return values, vectors


def _check_resolution(stiffness: SymmetricMatrix, value: float, vector: Array) -> None:
    """Raise if the lowest eigenvalue of a deformation is lost in rounding."""
    noise = float(_rounding(stiffness, vector[:, None])[0])
    if value < _MIN_RESOLUTION * noise:
        raise InputError(
            f"the lowest eigenvalue, {value:.2e} 1/s^2, is lost in the rounding of "
            f"the stiffness, {noise:.2e} 1/s^2",
            expected="a held body without hinges between its elements, and elements "
            "that are less thin or fewer",
        )


def _dense_space(pencil: Pencil, count: int) -> Array:
    """(n, count) vectors that span the lowest eigenvectors, by LAPACK.

    The mass over the shifted stiffness, whose largest eigenvalues are sought:
    conversely the lowest ones would be lost in the rounding of the largest, and a mass
    matrix that is singular to printed digits could not be used.
    """
    mass, shifted = pencil.mass.tocsr().toarray(), pencil.shifted.toarray()
    basis = None
    if len(pencil.constraints):
        basis = scipy.linalg.null_space(pencil.constraints)
        mass, shifted = (basis.T @ matrix @ basis for matrix in (mass, shifted))
    if len(mass) > _DENSE_SIZE:
        notify(f"eigenvectors: {count} of {len(mass)} equations at once, by LAPACK")
    wanted = [len(mass) - count, len(mass) - 1]
    with suppress(np.linalg.LinAlgError):
        vectors = scipy.linalg.eigh(mass, shifted, subset_by_index=wanted)[1]
        if vectors.shape[1] == count:  # LAPACK may return none for tiny matrices
            return vectors if basis is None else basis @ vectors
    # inverse iteration may fail where many are equal
    vectors = _all_eigenvectors(mass, shifted)[:, len(mass) - count :]
    return vectors if basis is None else basis @ vectors


def _all_eigenvectors(mass: Array, shifted: Array) -> Array:
    try:
        return np.asarray(scipy.linalg.eigh(mass, shifted)[1], float)
    except np.linalg.LinAlgError:
        text = "the stiffness does not resist every deformation"
        raise RuntimeError(text) from None


def _ritz_pairs(
    stiffness: SymmetricMatrix, mass: SymmetricMatrix, vectors: Array
) -> tuple[Array, Array]:
    """The eigenpairs in the space of some vectors."""
    small = [vectors.T @ (matrix @ vectors) for matrix in (stiffness, mass)]
    values, mixing = scipy.linalg.eigh(*small)
    return values, vectors @ mixing


def _invariant_space(
    pencil: Pencil,
    count: int,
    places: Array | None,
    static: Solve | None,
    accuracy: Accuracy,
    multigrid: tuple[MultigridFactors, Array] | None,
) -> Array:
    """(n, count) vectors that span the lowest eigenvectors."""
    if engine_name() == "slepc":
        return slepc_eigenvectors(pencil, count)
    if multigrid is not None:
        notify("eigenvectors")
        return multigrid_eigenvectors(pencil, count, *multigrid, accuracy)
    n, known = pencil.rigid.shape
    solve = static or symmetric_factors(pencil.shifted, places).solve
    begin_stage("eigenvectors", n)
    counter = ProgressCounter(
        "eigenvectors: {} blocks of solutions", expected_blocks(count)
    )

    def counted(load: Array) -> Array:
        answer = solve(load)
        counter()
        return answer

    if static is None:
        return dominant_vectors(counted, pencil.mass, count, pencil.rigid, accuracy)
    none = pencil.rigid[:, :0]
    vectors = dominant_vectors(counted, pencil.mass, count - known, none, accuracy)
    return np.hstack([pencil.rigid, vectors])


def free_body_shift(
    stiffness: sp.csr_matrix,
    mass: sp.csr_matrix,
    positions: Array,
    table: Indices | None = None,
) -> float:
    """A negative shift of the size of the first elastic eigenvalue [1/s^2].

    That of the softest quadratic deformation: it depends on the body, not on the mesh.

    Parameters
    ----------
    positions : (n, d)
    table : (n, 6) degrees of freedom by node as in `FiniteElementModel.table`; by
        default d displacements per node

    Raises
    ------
    InputError : a quadratic field deforms the body without resistance.
    """
    n, d = positions.shape
    if table is None:
        table = np.full((n, 6), -1)
        table[:, :d] = np.arange(n * d).reshape(n, d)
    first, _ = softest_deformation(stiffness, mass, positions, table)
    if first <= 0.0:
        raise InputError(
            "the stiffness does not resist every deformation, or is lost in rounding",
            expected="a body without hinges (elements that share edges in the plane "
            "and faces in space) and of less thin elements",
        )
    return -first
