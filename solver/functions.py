"""Functions of time for the kernels: piecewise polynomials, in one table.

Drives and forces add their functions to one `FunctionTable` and keep the row, which
`kernels.drives.drive_value` evaluates with two derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from formats.errors import InputError
from formats.scene import (
    Constant,
    Function,
    Given,
    Harmonic,
    Polynomial,
    SmoothStep,
    Spline,
    coefficients,
)
from formats.sid import Array

from .kernels import layout as at
from .kernels.layout import IntTable
from .pool import Pool


@dataclass(frozen=True, eq=False)
class Pieces:
    """Polynomials in powers of (t - start), lowest first.

    starts : (n,) growing; the first piece also holds before, the last one after
    terms : (n, terms) coefficients
    """

    starts: Array
    terms: Array


class FunctionTable:
    """Collects functions of time; rows in the order of `add`."""

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._rows: list[tuple[int, int, int]] = []
        self._breaks: set[float] = set()

    def add(self, function: Function, place: str) -> int:
        """Row of a function of time; `place` is its key in the scene.

        Raises
        ------
        InputError : its values are left to a program that did not give them.
        """
        pieces = compile_function(function, place)
        data = self._pool.add(np.concatenate([pieces.starts, pieces.terms.ravel()]))
        self._rows.append((*pieces.terms.shape, data))
        self._breaks.update(float(t) for t in pieces.starts)
        return len(self._rows) - 1

    def table(self) -> IntTable:
        """What kernels read."""
        return np.array(self._rows, np.int64).reshape(-1, at.N_DRIVE)

    def breaks(self, start: float, end: float) -> tuple[float, ...]:
        """Times inside (start, end) at which a function is not smooth, then the end."""
        return (*sorted(t for t in self._breaks if start < t < end), end)


def compile_function(function: Function, place: str) -> Pieces:
    """A function of time as pieces of polynomials.

    Raises
    ------
    InputError : its values are left to a program that did not give them.
    """
    return _COMPILERS[type(function)](function, place)


def _constant(function: Constant, place: str) -> Pieces:
    return Pieces(np.zeros(1), np.full((1, 1), function.value))


def _polynomial(function: Polynomial, place: str) -> Pieces:
    return _padded(
        [piece.from_ for piece in function.pieces],
        [np.array(coefficients(piece)) for piece in function.pieces],
    )


def _smooth_step(function: SmoothStep, place: str) -> Pieces:
    """h(x) = sum_k binom(n + k, k) binom(2 n + 1, n - k) (-x)^k x^(n + 1)."""
    n, length = function.continuity, function.to - function.from_
    rise = np.zeros(2 * n + 2)
    for k in range(n + 1):
        weight = math.comb(n + k, k) * math.comb(2 * n + 1, n - k)
        rise[n + 1 + k] = weight * (-1) ** k / length ** (n + 1 + k)
    rise *= function.end - function.start
    rise[0] = function.start
    before, after = np.array([function.start]), np.array([function.end])
    starts = [function.from_ - length, function.from_, function.to]
    return _padded(starts, [before, rise, after])


def _spline(function: Spline, place: str) -> Pieces:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(function.times, function.values, bc_type=function.ends)
    return Pieces(spline.x[:-1], np.ascontiguousarray(spline.c[::-1].T))


def _harmonic(function: Harmonic, place: str) -> Pieces:
    raise InputError("harmonic functions are not compiled", place=place)


def _given(function: Given, place: str) -> Pieces:
    raise InputError(
        "its values are left to a program",
        place=place,
        expected="a callable in `compile_scene(..., drives={name: callable})`",
    )


_COMPILERS: dict[type, Callable[..., Pieces]] = {
    Constant: _constant,
    Polynomial: _polynomial,
    Harmonic: _harmonic,
    SmoothStep: _smooth_step,
    Spline: _spline,
    Given: _given,
}


def _padded(starts: list[float], terms: list[Array]) -> Pieces:
    longest = max(map(len, terms))
    padded = [np.pad(term, (0, longest - len(term))) for term in terms]
    return Pieces(np.array(starts), np.array(padded))
