"""Functions of time for the kernels, in one table.

Drives and forces add their functions to one `FunctionTable` and keep the row, which
`kernels.drives.drive_value` evaluates with two derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyval

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
from .features import Features
from .pool import Pool

#: A jump of a value or a rate counts as none below this part of the largest one.
SAME = 1e-9
#: Part of its period in which a polynomial of `features` follows a harmonic.
WELL_FOLLOWED = 0.5


@dataclass(frozen=True, eq=False)
class Pieces:
    """Polynomials in powers of (t - start), lowest first.

    starts : (n,) growing; the first piece also holds before, the last one after
    terms : (n, terms) coefficients
    """

    starts: Array
    terms: Array

    kind = at.POLYNOMIAL

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.starts), self.terms.shape[1]

    def data(self) -> Array:
        return np.concatenate([self.starts, self.terms.ravel()])

    def breaks(self) -> list[float]:
        return [float(t) for t in self.starts[1:]]

    def features(self, span: tuple[float, float]) -> Features:
        return features.of_polynomials(self.starts, self.terms, span)


@dataclass(frozen=True, eq=False)
class Curve:
    """A smooth function in pieces, each a polynomial in x from -1 to 1.

    edges : (n + 1,) growing
    terms : (n, terms) coefficients of powers of x, lowest first
    kinks : times at which the curve is not smooth
    """

    edges: Array
    terms: Array
    kinks: tuple[float, ...]

    kind = at.SMOOTH

    @property
    def shape(self) -> tuple[int, int]:
        return self.terms.shape[0], self.terms.shape[1]

    def data(self) -> Array:
        return np.concatenate([self.edges, self.terms.ravel()])

    def breaks(self) -> list[float]:
        return list(self.kinks)

    def features(self, span: tuple[float, float]) -> Features:
        return features.of_curve(self._values, self.edges, self.kinks, span)

    def _values(self, t: Array) -> Array:
        k = np.searchsorted(self.edges, t, side="right") - 1
        k = np.clip(k, 0, len(self.terms) - 1)
        x = 2.0 * (t - self.edges[k]) / np.diff(self.edges)[k] - 1.0
        return np.asarray(polyval(x, self.terms[k].T, tensor=False))


@dataclass(frozen=True)
class Sine:
    """offset + amplitude sin(omega t + phase)."""

    offset: float
    amplitude: float
    omega: float
    phase: float

    kind = at.HARMONIC
    shape = (1, 0)

    def data(self) -> Array:
        return np.array([self.offset, self.amplitude, self.omega, self.phase])

    def breaks(self) -> list[float]:
        return []

    def features(self, span: tuple[float, float]) -> Features:
        if self.amplitude == 0.0 or self.omega == 0.0:
            return features.NONE
        part = np.array([WELL_FOLLOWED * 2.0 * math.pi / abs(self.omega)])
        return Features(features.NONE.starts, part)


@dataclass(frozen=True)
class Ramp:
    """A sine ramp, see `formats.scene.SineRamp`."""

    ramp: SineRamp

    kind = at.RAMP
    shape = (2, 0)

    def data(self) -> Array:
        ramp = self.ramp
        of_rate = ramp.of == "rate"
        before, rate = (ramp.offset, ramp.start) if of_rate else (ramp.start, 0.0)
        change = ramp.end - ramp.start
        return np.array(
            [ramp.from_, ramp.to, before, change, float(of_rate), rate], float
        )

    def breaks(self) -> list[float]:
        return [self.ramp.from_, self.ramp.to]

    def features(self, span: tuple[float, float]) -> Features:
        part = WELL_FOLLOWED * (self.ramp.to - self.ramp.from_)
        starts = np.array([-np.inf, self.ramp.from_, self.ramp.to])
        return Features(starts, np.array([np.inf, part, np.inf]))


Compiled = Pieces | Curve | Sine | Ramp


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
    compiled = compile_function(function, place)
    if isinstance(compiled, Pieces):
        check_jumps(compiled, span, place, joined)
    return _parts(compiled, span)


def compile_function(function: ForceFunction, place: str) -> Compiled:
    """A function of time in the form that kernels evaluate.

    Raises
    ------
    InputError : its values are left to a program.
    """
    return _COMPILERS[type(function)](function, place)


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
    curves = [np.polynomial.Polynomial(c) for c in pieces.terms]
    for order, what in enumerate(("jumps", "jumps in its rate")[:joined]):
        ends = [*pieces.starts[1:], max(span[1], pieces.starts[-1])]
        values = [
            (float(p.deriv(order)(0.0)), float(p.deriv(order)(end - start)))
            for p, start, end in zip(curves, pieces.starts, ends, strict=True)
        ]
        largest = max(
            float(np.max(np.abs(p.deriv(order)(np.linspace(0.0, end - start, 5)))))
            for p, start, end in zip(curves, pieces.starts, ends, strict=True)
        )
        for t, (left, right) in zip(pieces.starts[1:], pairwise(values), strict=True):
            jump = right[0] - left[1]
            if span[0] < t < span[1] and abs(jump) > SAME * largest:
                raise InputError(
                    f"{what} by {jump:.6g} at t = {t:.9g} s",
                    place=place,
                    expected="a drive whose value and rate are continuous; "
                    "a jump in acceleration is fine",
                )


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


def _harmonic(function: Harmonic, place: str) -> Sine:
    omega = function.angular_frequency
    if omega is None:
        assert function.frequency is not None
        omega = 2.0 * math.pi * function.frequency
    return Sine(function.offset, function.amplitude, omega, function.phase)


def _ramp(function: SineRamp, place: str) -> Ramp:
    return Ramp(function)


def _given(function: Given, place: str) -> Curve:
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
    Spline: _spline,
    Given: _given,
}


def _as_given(curve: Curve) -> Given:
    """To the last bit."""
    terms = tuple(tuple(map(float, piece)) for piece in curve.terms)
    edges, kinks = tuple(map(float, curve.edges)), tuple(map(float, curve.kinks))
    return Given(edges=edges, terms=terms, kinks=kinks)


def _padded(starts: list[float], terms: list[Array]) -> Pieces:
    longest = max(map(len, terms))
    padded = [np.pad(term, (0, longest - len(term))) for term in terms]
    return Pieces(np.array(starts), np.array(padded))
