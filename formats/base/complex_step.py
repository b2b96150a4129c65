"""Functions that complex-step differentiation needs in place of those of NumPy.

The derivative of an analytic function f is Im f(x + i h) / h, exact to rounding for a
tiny step h (W. Squire, G. Trapp, "Using complex variables to estimate derivatives of
real functions", SIAM Review 40, 1998). Functions that are not analytic lose it:
absolute values and norms of NumPy drop the imaginary part. Those here keep it, and are
the usual ones for real numbers. Comparisons are those of real parts.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError

#: Arrays of real numbers, or of complex ones that carry a step.
Numbers = NDArray[Any]

#: Imaginary step relative to the size of a variable.
STEP = 1e-30


def number_type(*arrays: Any) -> np.dtype[Any]:
    """Return complex if one of the arrays is complex, else float."""
    parts = [
        getattr(array, "dtype", None) or np.asarray(array)
        for array in arrays
        if type(array) is not float
    ]
    return np.result_type(np.float64, *parts)


def numbers(values: Any) -> Numbers:
    """Return values as an array of floats, or of complex numbers that carry a step."""
    array = np.asarray(values)
    return array if np.iscomplexobj(array) else np.asarray(array, float)


def analytic_norm(
    vectors: ArrayLike, axis: int | None = None, keepdims: bool = False
) -> Any:
    """Return the root of the sum of squares, along an axis or of all entries."""
    array = np.asarray(vectors)
    if not np.iscomplexobj(array):
        return np.linalg.norm(array, axis=axis, keepdims=keepdims)
    return np.sqrt((array * array).sum(axis=axis, keepdims=keepdims))


def analytic_abs(values: ArrayLike) -> Any:
    """Return values with the sign that makes their real parts positive."""
    array = np.asarray(values)
    if not np.iscomplexobj(array):
        return np.abs(array)
    return np.where(array.real < 0, -array, array)


def without_rounding(values: Numbers, limit: float) -> Numbers:
    """Return values whose real parts are zero where they are below a limit."""
    small = np.abs(values.real) < limit
    if not np.iscomplexobj(values):
        return np.where(small, 0.0, values)
    return np.where(small, 1j * values.imag, values)


def is_nonzero(values: Numbers) -> NDArray[np.bool_]:
    """Return where values differ from zero in their real parts."""
    return np.asarray(values.real != 0.0)


def null_space_with_step(rows: Numbers, null: NDArray[np.float64]) -> Numbers:
    """Return the null space of rows with a step, given that of their real parts.

    With A N = 0, the change of N is -A^+ dA N.

    Parameters
    ----------
    rows : (k, n)
    null : (n, r) columns that the real parts of the rows annihilate
    """
    if not np.iscomplexobj(rows):
        return null
    change = np.linalg.pinv(rows.real) @ (rows.imag @ null)
    return null - 1j * change


def analytic_arctan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y)."""
    angle = np.arctan2(np.real(y), np.real(x))
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return angle
    square = np.real(x) ** 2 + np.real(y) ** 2
    turned = np.real(x) * np.imag(y) - np.real(y) * np.imag(x)
    return angle + 1j * turned / square


def analytic_pinv(matrices: Numbers, rcond: float = 1e-15) -> Numbers:
    """Return the pseudo-inverse A of matrices P (..., m, n) of constant rank.

    dA = -A dP A + A A^T dP^T (I - P A) + (I - A P) dP^T A^T A (G. Golub, V. Pereyra,
    SIAM J. Numer. Anal. 10, 1973).
    """
    inverse = np.linalg.pinv(matrices.real, rcond=rcond)
    if not np.iscomplexobj(matrices):
        return inverse
    p, change = matrices.real, matrices.imag
    transposed, turned = np.swapaxes(inverse, -1, -2), np.swapaxes(change, -1, -2)
    beside = np.eye(p.shape[-2]) - p @ inverse
    within = np.eye(p.shape[-1]) - inverse @ p
    step = (
        -inverse @ change @ inverse
        + inverse @ transposed @ turned @ beside
        + within @ turned @ transposed @ inverse
    )
    return np.asarray(inverse + 1j * step)


def check_joined_points(joined: Numbers, separate: Numbers) -> None:
    """Check that points that are one move together.

    Parameters
    ----------
    joined : (n, d) positions after points were joined
    separate : (n, d) those of the same points before

    Raises
    ------
    InputError : a step moves them apart.
    """
    apart = np.abs((joined - separate).imag).max(initial=0.0)
    if apart > 1e-9 * np.abs(separate.imag).max(initial=0.0):
        raise InputError(
            "the variable moves one of several control points that are one",
            place="geometry",
            expected="a shape variable that moves all of them",
        )


def weighted_squares(columns: Numbers, weights: Numbers) -> Numbers:
    """Return F^T diag(w) F of stacks F (..., g, n) with weights w (..., g).

    With a step, two products of real parts: of F = A + i B and w = r + i s, the step is
    the symmetric part of A^T diag(s) A + 2 A^T diag(r) B.
    """
    if np.isrealobj(columns) and np.isrealobj(weights):
        return np.swapaxes(columns, -1, -2) @ (columns * weights[..., None])
    real = np.ascontiguousarray(columns.real)  # BLAS takes no parts of pairs
    turned = np.swapaxes(real, -1, -2)
    value = turned @ (real * weights.real[..., None])
    change = real * weights.imag[..., None]
    if np.iscomplexobj(columns):
        change += 2 * columns.imag * weights.real[..., None]
    step = turned @ change
    return np.asarray(value + 0.5j * (step + np.swapaxes(step, -1, -2)))


def product_with_step(a: Numbers, b: Numbers) -> Numbers:
    """Return a @ b by products of real parts, without those of two steps."""
    if np.isrealobj(a) and np.isrealobj(b):
        return np.asarray(a @ b)
    first, second = np.ascontiguousarray(a.real), np.ascontiguousarray(b.real)
    step: Any = 0.0
    if np.iscomplexobj(a):
        step = step + np.ascontiguousarray(a.imag) @ second
    if np.iscomplexobj(b):
        step = step + first @ np.ascontiguousarray(b.imag)
    return np.asarray(first @ second + 1j * step)
