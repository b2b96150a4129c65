"""Functions of time for the kernels, in one table.

Drives and forces add their functions to one `FunctionTable` and keep the row, which
`kernels.drives.drive_value` evaluates with two derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    Constant,
    ForceFunction,
    Given,
    Harmonic,
    Polynomial,
    SineRamp,
    SmoothStep,
    Spline,
    Sum,
    coefficients,
)
from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.layout import IntTable
from . import features
from .callables import Derivatives, interpolate, shortest_seen
from .curves import Compiled, Curve, Pieces, Ramp, Sine
from .features import Features
from .pool import Pool

#: A jump of a value or a rate counts as none below this part of the largest one.
SAME = 1e-9


class FunctionTable:
    """Collects functions of time; rows in the order of `add`.

    Parameters
    ----------
    span : times [s] between which functions of a program are evaluated

    Attributes
    ----------
    seen : by the drives and forces that a program gives, the duration of the shortest
        feature that is surely seen [s]
    given : what was seen of their functions, by the places of these in the scene
    """

    def __init__(self, pool: Pool, span: tuple[float, float]) -> None:
        self._pool = pool
        self._span = span
        self._rows: list[tuple[int, int, int, int]] = []
        self._parts: list[tuple[int, int, int, int]] = []
        self._breaks: dict[float, list[str]] = {}
        self._features: dict[str, list[Features]] = {}
        self.seen: dict[str, float] = {}
        self.given: dict[str, Given] = {}

    def add(
        self,
        function: ForceFunction,
        place: str,
        program: Derivatives | None = None,
        joined: int = 0,
    ) -> int:
        """Row of a function of time; `place` is its key in the scene.

        Parameters
        ----------
        program : callables for value and derivatives that replace the function
        joined : 1 if the value must not jump, 2 if the rate must not, either

        Raises
        ------
        InputError : it jumps, or its values are left to a program that has none.
        """
        if isinstance(function, Sum) and program is None:
            parts = [
                self._add(part, f"{place}.parts[{i}]", None, joined)
                for i, part in enumerate(function.parts)
            ]
            row = len(parts), 0, len(self._parts), at.SUM
            self._parts += parts
        else:
            row = self._add(function, place, program, joined)
        self._rows.append(row)
        return len(self._rows) - 1

    def _add(
        self,
        function: ForceFunction,
        place: str,
        program: Derivatives | None,
        joined: int,
    ) -> tuple[int, int, int, int]:
        """The row of a function that is no sum."""
        name = place.split(".")[1]
        if program is not None:
            curve = Curve(*interpolate(program, self._span, place, joined == 2))
            self.given[place] = _as_given(curve)
            found = _parts(curve, self._span)
            self.seen[name] = shortest_seen(program, self._span)
        else:
            found = _checked(function, self._span, place, joined)
        data = self._pool.add(found.data)
        self._features.setdefault(name, []).append(found.features)
        for t in found.breaks:
            self._breaks.setdefault(t, []).append(name)
        return (*found.shape, data, found.kind)

    def watch(self, program: Callable[[float], float], name: str) -> None:
        """Has steps look at what a law makes of time; what jumps is left to them."""
        try:
            curve = Curve(*interpolate(program, self._span, name, smooth=False))
            found = curve.features(self._span)
        except InputError:
            return
        self._features.setdefault(name, []).append(found)
        for t in curve.breaks():
            self._breaks.setdefault(t, []).append(name)

    def table(self) -> IntTable:
        """What kernels read: all functions, then the parts of sums."""
        rows = [*self._rows, *self._parts]
        table = np.array(rows, np.int64).reshape(-1, at.N_DRIVE)
        table[table[:, at.D_KIND] == at.SUM, at.D_DATA] += len(self._rows)
        return table

    def breaks(self) -> tuple[float, ...]:
        """Times inside the span at which a function is not smooth, then its end."""
        return (*self.causes(), self._span[1])

    def features(self) -> dict[str, Features]:
        """What no step may pass, by drives and forces."""
        parts = self._features.items()
        return {name: features.together(found) for name, found in parts}

    def causes(self) -> dict[float, tuple[str, ...]]:
        """Drives and forces by the times inside the span at which they break."""
        start, end = self._span
        inside = sorted(t for t in self._breaks if start < t < end)
        return {t: tuple(self._breaks[t]) for t in inside}


class _Parts(NamedTuple):
    """What becomes of a function of time in a scene."""

    shape: tuple[int, int]
    kind: int
    data: Array
    features: Features
    breaks: list[float]


def _parts(compiled: Compiled, span: tuple[float, float]) -> _Parts:
    shape, kind, data = compiled.shape, compiled.kind, compiled.data()
    return _Parts(shape, kind, data, compiled.features(span), compiled.breaks())


@lru_cache(maxsize=64)
def _checked(
    function: ForceFunction, span: tuple[float, float], place: str, joined: int
) -> _Parts:
    """Of a function of the scene; known where a scene is compiled again."""
    compiled = compile_function(function, place, joined)
    if isinstance(compiled, Pieces):
        check_jumps(compiled, span, place, joined)
    return _parts(compiled, span)


def with_other_numbers(
    known: ForceFunction,
    function: ForceFunction,
    span: tuple[float, float],
    place: str,
    joined: int,
) -> _Parts | None:
    """What becomes of a function that takes the place of a known one in a table; None
    where it does not fit there, or steps have to end at other times."""
    if type(function) is not type(known) or type(function) not in _COMPILERS:
        return None
    new, old = (_checked(f, span, place, joined) for f in (function, known))
    fits = new.shape == old.shape and len(new.data) == len(old.data)
    return new if fits and new.breaks == old.breaks else None


def compile_function(function: ForceFunction, place: str, joined: int = 0) -> Compiled:
    """A function of time in the form that kernels evaluate.

    Parameters
    ----------
    joined : see `FunctionTable.add`; what may have corners joins tables by lines

    Raises
    ------
    InputError : its values are left to a program.
    """
    return _COMPILERS[type(function)](function, place, joined)


def check_jumps(
    pieces: Pieces, span: tuple[float, float], place: str, joined: int = 2
) -> None:
    """Refuses jumps of the value and of the rate, or (1) of the value alone, inside a
    time span.

    A jump of a prescribed position cannot be followed; a jump of its rate would need
    an impact, which no smooth equation of motion describes.

    Raises
    ------
    InputError : names the time and the size of the jump.
    """
    if len(pieces.starts) == 1:
        return
    terms, powers = pieces.terms, np.arange(pieces.terms.shape[1])
    ends = np.append(pieces.starts[1:], max(span[1], pieces.starts[-1]))
    places = np.linspace(0.0, 1.0, 5)[:, None] * (ends - pieces.starts)
    basis = places[:, :, None] ** powers
    for order, what in enumerate(("jumps", "jumps in its rate")[:joined]):
        values = (basis[:, :, : len(powers) - order] * terms).sum(axis=2)
        terms = terms[:, 1:] * powers[1 : terms.shape[1]]
        largest = np.abs(values).max()
        jumps = values[0, 1:] - values[-1, :-1]
        for k in np.flatnonzero(np.abs(jumps) > SAME * largest):
            t = pieces.starts[k + 1]
            if span[0] < t < span[1]:
                raise InputError(
                    f"{what} by {jumps[k]:.6g} at t = {t:.9g} s",
                    place=place,
                    expected="a drive whose value and rate are continuous; "
                    "a jump in acceleration is fine",
                )


def _constant(function: Constant, place: str, joined: int) -> Pieces:
    return Pieces(np.zeros(1), np.full((1, 1), function.value))


def _polynomial(function: Polynomial, place: str, joined: int) -> Pieces:
    return _padded(
        [piece.from_ for piece in function.pieces],
        [np.array(coefficients(piece)) for piece in function.pieces],
    )


def _smooth_step(function: SmoothStep, place: str, joined: int) -> Pieces:
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


def _table(function: Spline, place: str, joined: int) -> Pieces:
    smooth = (
        function.interpolation == "smooth" if function.interpolation else joined > 0
    )
    return _spline(function) if smooth else _lines(function)


def _lines(function: Spline) -> Pieces:
    """Straight lines between the points, constant beyond them."""
    t, values = np.array(function.times), np.array(function.values)
    slopes = np.append(np.diff(values) / np.diff(t), 0.0)
    terms = np.stack([values, slopes], axis=1)
    before = [values[0], 0.0]
    return Pieces(np.append(t[0] - 1.0, t), np.vstack([before, terms]))


def _spline(function: Spline) -> Pieces:
    """A cubic spline, straight beyond its ends."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(function.times, function.values, bc_type=function.ends)
    t, slopes = spline.x, spline(spline.x[[0, -1]], 1)
    before = [function.values[0] - slopes[0], slopes[0], 0.0, 0.0]
    after = [function.values[-1], slopes[1], 0.0, 0.0]
    terms = np.vstack([before, spline.c[::-1].T, after])
    return Pieces(np.append(t[0] - 1.0, t), terms)


def _harmonic(function: Harmonic, place: str, joined: int) -> Sine:
    omega = function.angular_frequency
    if omega is None:
        assert function.frequency is not None
        omega = 2.0 * math.pi * function.frequency
    return Sine(function.offset, function.amplitude, omega, function.phase)


def _ramp(function: SineRamp, place: str, joined: int) -> Ramp:
    return Ramp(function)


def _given(function: Given, place: str, joined: int) -> Curve:
    if function.terms:
        return Curve(np.array(function.edges), np.array(function.terms), function.kinks)
    raise InputError(
        "its values are left to a program",
        place=place,
        expected="a callable in `compile_scene(..., drives={name: callable})`, or in "
        "its `forces`",
    )


_COMPILERS: dict[type, Callable[..., Compiled]] = {
    Constant: _constant,
    Polynomial: _polynomial,
    Harmonic: _harmonic,
    SmoothStep: _smooth_step,
    SineRamp: _ramp,
    Spline: _table,
    Given: _given,
}


def _as_given(curve: Curve) -> Given:
    """To the last bit."""
    terms = tuple(tuple(map(float, piece)) for piece in curve.terms)
    edges, kinks = tuple(map(float, curve.edges)), tuple(map(float, curve.kinks))
    return Given(edges=edges, terms=terms, kinks=kinks)


def _padded(starts: list[float], terms: list[Array]) -> Pieces:
    padded = np.zeros((len(terms), max(map(len, terms))))
    for row, term in zip(padded, terms, strict=True):
        row[: len(term)] = term
    return Pieces(np.array(starts), padded)
