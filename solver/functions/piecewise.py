"""Functions of time in the forms that kernels evaluate: data, breaks and features."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Input, SineRamp

from ..spatial import system_arrays as at
from . import features
from .features import Features

#: Part of its period in which a polynomial of `features` follows a harmonic.
RESOLVED_PERIOD = 0.5
#: Coefficients of a piece of an input, as of the cubic between values of a smooth one.
N_INPUT_TERMS = 4


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """Polynomials in powers of (t - start), lowest first.

    Attributes
    ----------
    starts : (n,)
        Growing; the first piece also holds before, the last one after.
    terms : (n, terms)
        Coefficients.
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
        return features.polynomial_features(self.starts, self.terms, span)


@dataclass(frozen=True, eq=False)
class SmoothCurve:
    """A smooth function in pieces, each a polynomial in x from -1 to 1.

    Attributes
    ----------
    edges : (n + 1,)
        Growing.
    terms : (n, terms)
        Coefficients of powers of x, lowest first.
    kinks
        Times at which the curve is not smooth.
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
        return features.curve_features(self._values, self.edges, self.kinks, span)

    def _values(self, t: Array) -> Array:
        k = np.searchsorted(self.edges, t, side="right") - 1
        k = np.clip(k, 0, len(self.terms) - 1)
        x = 2.0 * (t - self.edges[k]) / np.diff(self.edges)[k] - 1.0
        return np.asarray(polyval(x, self.terms[k].T, tensor=False))


@dataclass(frozen=True)
class HarmonicFunction:
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
            return features.NO_FEATURES
        part = np.array([RESOLVED_PERIOD * 2.0 * math.pi / abs(self.omega)])
        return Features(features.NO_FEATURES.starts, part)


@dataclass(frozen=True)
class SineRampFunction:
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
        part = RESOLVED_PERIOD * (self.ramp.to - self.ramp.from_)
        starts = np.array([-np.inf, self.ramp.from_, self.ramp.to])
        return Features(starts, np.array([np.inf, part, np.inf]))


def input_pieces(signal: Input, start: float) -> PiecewisePolynomial | None:
    """Constant pieces of an input from the start of a run on, which a plant rewrites;
    None if the input has a table that is no sequence of constants."""
    times, values = signal.times or (), signal.values or ()
    if times and signal.interpolation != "hold":
        return None
    before = np.searchsorted(times, start, side="right")
    first = values[before - 1] if before else signal.initial
    held = np.array([first, *values[before:]])
    terms = np.column_stack([held, np.zeros((len(held), N_INPUT_TERMS - 1))])
    return PiecewisePolynomial(np.array([start, *times[before:]]), terms)


CompiledFunction = (
    PiecewisePolynomial | SmoothCurve | HarmonicFunction | SineRampFunction
)
