"""All functions of time of a scene as rows of one table, with their real data.

Each function becomes pieces of polynomials or a harmonic function. Jumps of values and
rates that the solver cannot integrate over are refused.

Tables of formulas: as rows of functions, as grids, and evaluated in Python.
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import ArrayLike

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Constant,
    ForceFunction,
    Given,
    Harmonic,
    Input,
    InputFunction,
    LookupTable,
    Polynomial,
    SineRamp,
    SmoothStep,
    Spline,
    Sum,
    coefficients,
)

from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .callables import (
    ArrayFunction,
    Derivatives,
    interpolate_callable,
    shortest_resolved_feature,
)
from .piecewise import (
    CompiledFunction,
    Features,
    HarmonicFunction,
    PiecewisePolynomial,
    SineRampFunction,
    SmoothCurve,
    input_pieces,
    merge_features,
)

#: What of an input jumps between its values.
_JUMP = {"hold": "value", "linear": "rate"}
#: What drives can take of inputs, by the derivatives that must not jump, plus one.
_CONTINUOUS_INPUTS = {
    1: 'interpolation = "linear" or "smooth" of the input; or of = "acceleration" of '
    "the drive, which may jump",
    2: 'interpolation = "smooth" of the input; of = "acceleration" of the drive, which '
    'may jump; of = "rate" with a linear input; or a formula whose state follows the '
    "input with a lag",
}
#: A jump of a value or a rate counts as none below this part of the largest one.
EQUAL_VALUES = 1e-9


class RealData:
    """Collects arrays; `add` says where each begins."""

    def __init__(self) -> None:
        self._parts: list[Array] = []
        self._size = 0

    def add(self, values: ArrayLike) -> int:
        part = np.asarray(values, float).ravel()
        start = self._size
        self._parts.append(part)
        self._size += len(part)
        return start

    def array(self) -> Array:
        return np.concatenate([*self._parts, np.zeros(1)])


class FunctionTable:
    """Collects functions of time; rows in the order of `add`.

    Parameters
    ----------
    span
        Times [s] between which functions of a program are evaluated.
    inputs
        Of the scene, by name; all functions that are an input share its numbers.

    Attributes
    ----------
    required_continuity
        Continuous derivatives that drives need of each input, plus one.
    shortest_features
        By the drives and forces that a program gives, the duration of the shortest
        feature that is surely seen [s].
    given_functions
        What was seen of their functions, by the places of these in the scene.
    """

    def __init__(
        self,
        pool: RealData,
        span: tuple[float, float],
        inputs: Mapping[str, Input] | None = None,
    ) -> None:
        self._pool = pool
        self._span = span
        self._rows: list[tuple[int, int, int, int]] = []
        self._parts: list[tuple[int, int, int, int]] = []
        self._breaks: dict[float, list[str]] = {}
        self._features: dict[str, list[Features]] = {}
        self._inputs = inputs or {}
        self._input_rows: dict[str, tuple[int, int, int, int]] = {}
        self._lookups: dict[str, int] = {}
        self._grids: dict[str, int] = {}
        self.required_continuity = dict.fromkeys(self._inputs, 0)
        self.shortest_features: dict[str, float] = {}
        self.given_functions: dict[str, Given] = {}

    def add(
        self,
        function: ForceFunction,
        place: str,
        program: Derivatives | None = None,
        continuity: int = 0,
    ) -> int:
        """Row of a function of time; `place` is its key in the scene.

        Parameters
        ----------
        program
            Callables for value and derivatives that replace the function.
        continuity
            1 if the value must not jump, 2 if the rate must not, either.

        Raises
        ------
        InputError
            It jumps, or its values are left to a program that has none.
        """
        if isinstance(function, Sum) and program is None:
            parts = [
                self._add(part, f"{place}.parts[{i}]", None, continuity)
                for i, part in enumerate(function.parts)
            ]
            row = len(parts), 0, len(self._parts), at.SUM
            self._parts += parts
        else:
            row = self._add(function, place, program, continuity)
        self._rows.append(row)
        return len(self._rows) - 1

    def _add(
        self,
        function: ForceFunction,
        place: str,
        program: Derivatives | None,
        continuity: int,
    ) -> tuple[int, int, int, int]:
        """The row of a function that is no sum."""
        name = place.split(".")[1]
        if isinstance(function, InputFunction) and program is None:
            return self._add_input(function.name, place, continuity)
        if program is not None:
            curve = SmoothCurve(
                *interpolate_callable(program, self._span, place, continuity == 2)
            )
            self.given_functions[place] = _to_sampled(curve)
            entry = _table_entry(curve, self._span)
            self.shortest_features[name] = shortest_resolved_feature(
                program, self._span
            )
        else:
            entry = _checked_entry(function, self._span, place, continuity)
        data = self._pool.add(entry.data)
        self._features.setdefault(name, []).append(entry.features)
        for t in entry.breaks:
            self._breaks.setdefault(t, []).append(name)
        return (*entry.shape, data, entry.kind)

    def _add_input(
        self, name: str, place: str, continuity: int
    ) -> tuple[int, int, int, int]:
        """The row of an input, which is smooth enough for what takes it.

        Raises
        ------
        InputError
            It jumps where a drive would have to follow.
        """
        signal = self._inputs[name]
        if place.startswith("drives") and signal.continuity < continuity:
            raise InputError(
                f"the input {name} has a {_JUMP[signal.interpolation]} that jumps",
                place=place,
                expected=_CONTINUOUS_INPUTS[continuity],
            )
        known = self.required_continuity
        if place.startswith("drives"):
            known[name] = max(known[name], continuity)
        if name not in self._input_rows:
            compiled: CompiledFunction | None = input_pieces(signal, self._span[0])
            if compiled is None:
                table = Spline.model_construct(
                    times=signal.times, values=signal.values, interpolation=None
                )
                compiled = _compile_spline(table, "", signal.continuity - 1)
            entry = _table_entry(compiled, self._span)
            for t in entry.breaks:
                self._breaks.setdefault(t, [])
            self._features[f"inputs.{name}"] = [entry.features]
            self._input_rows[name] = (
                *entry.shape,
                self._pool.add(entry.data),
                entry.kind,
            )
        return self._input_rows[name]

    def add_lookup(self, name: str, curve: PiecewisePolynomial) -> int:
        """Row of a table of one variable, which is no function of time."""
        if name not in self._lookups:
            self._rows.append((*curve.shape, self._pool.add(curve.data()), curve.kind))
            self._lookups[name] = len(self._rows) - 1
        return self._lookups[name]

    @property
    def lookup_rows(self) -> tuple[int, ...]:
        """Rows of tables of one variable."""
        return tuple(self._lookups.values())

    def add_grid(self, name: str, data: Array) -> int:
        """Where the numbers of a table of two variables begin."""
        if name not in self._grids:
            self._grids[name] = self._pool.add(data)
        return self._grids[name]

    def add_law_features(self, program: Callable[[Array], Array], name: str) -> None:
        """Has steps look at what a law makes of time; what jumps is left to them."""
        try:
            curve = SmoothCurve(
                *interpolate_callable(
                    ArrayFunction(program), self._span, name, smooth=False
                )
            )
            features_ = curve.features(self._span)
        except InputError:
            return
        self._features.setdefault(name, []).append(features_)
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
        return (*self.break_causes(), self._span[1])

    def features(self) -> dict[str, Features]:
        """What no step may pass, by drives and forces."""
        parts = self._features.items()
        return {name: merge_features(parts_of_drive) for name, parts_of_drive in parts}

    def break_causes(self) -> dict[float, tuple[str, ...]]:
        """Drives and forces by the times inside the span at which they break."""
        start, end = self._span
        inside = sorted(t for t in self._breaks if start < t < end)
        return {t: tuple(self._breaks[t]) for t in inside}


class _TableEntry(NamedTuple):
    """What becomes of a function of time in a scene."""

    shape: tuple[int, int]
    kind: int
    data: Array
    features: Features
    breaks: list[float]


def _table_entry(compiled: CompiledFunction, span: tuple[float, float]) -> _TableEntry:
    shape, kind, data = compiled.shape, compiled.kind, compiled.data()
    return _TableEntry(shape, kind, data, compiled.features(span), compiled.breaks())


@lru_cache(maxsize=64)
def _checked_entry(
    function: ForceFunction, span: tuple[float, float], place: str, continuity: int
) -> _TableEntry:
    """Of a function of the scene; known where a scene is compiled again."""
    compiled = compile_function(function, place, continuity)
    if isinstance(compiled, PiecewisePolynomial):
        check_jumps(compiled, span, place, continuity)
    return _table_entry(compiled, span)


def replacement_entry(
    known: ForceFunction,
    function: ForceFunction,
    span: tuple[float, float],
    place: str,
    continuity: int,
) -> _TableEntry | None:
    """What becomes of a function that takes the place of a known one in a table; None
    where it does not fit there, or steps have to end at other times."""
    if type(function) is not type(known) or type(function) not in _COMPILERS:
        return None
    new, old = (_checked_entry(f, span, place, continuity) for f in (function, known))
    fits = new.shape == old.shape and len(new.data) == len(old.data)
    return new if fits and new.breaks == old.breaks else None


def compile_function(
    function: ForceFunction, place: str, continuity: int = 0
) -> CompiledFunction:
    """A function of time in the form that kernels evaluate.

    Parameters
    ----------
    continuity
        See `FunctionTable.add`; what may have corners joins tables by lines.

    Raises
    ------
    InputError
        Its values are left to a program.
    """
    return _COMPILERS[type(function)](function, place, continuity)


def check_jumps(
    pieces: PiecewisePolynomial,
    span: tuple[float, float],
    place: str,
    continuity: int = 2,
) -> None:
    """Refuses jumps of the value and of the rate, or (1) of the value alone, inside a
    time span.

    A jump of a prescribed position cannot be followed; a jump of its rate would need an
    impact, which no smooth equation of motion describes.

    Raises
    ------
    InputError
        Names the time and the size of the jump.
    """
    if len(pieces.starts) == 1:
        return
    terms, powers = pieces.terms, np.arange(pieces.terms.shape[1])
    ends = np.append(pieces.starts[1:], max(span[1], pieces.starts[-1]))
    fractions = np.linspace(0.0, 1.0, 5)[:, None] * (ends - pieces.starts)
    basis = fractions[:, :, None] ** powers
    for order, what in enumerate(("jumps", "jumps in its rate")[:continuity]):
        values = (basis[:, :, : len(powers) - order] * terms).sum(axis=2)
        terms = terms[:, 1:] * powers[1 : terms.shape[1]]
        largest = np.abs(values).max()
        jumps = values[0, 1:] - values[-1, :-1]
        for k in np.flatnonzero(np.abs(jumps) > EQUAL_VALUES * largest):
            t = pieces.starts[k + 1]
            if span[0] < t < span[1]:
                raise InputError(
                    f"{what} by {jumps[k]:.6g} at t = {t:.9g} s",
                    place=place,
                    expected="a drive whose value and rate are continuous; "
                    "a jump in acceleration is fine",
                )


def _compile_constant(
    function: Constant, place: str, continuity: int
) -> PiecewisePolynomial:
    return PiecewisePolynomial(np.zeros(1), np.full((1, 1), function.value))


def _compile_polynomial(
    function: Polynomial, place: str, continuity: int
) -> PiecewisePolynomial:
    return _pad_pieces(
        [piece.from_ for piece in function.pieces],
        [np.array(coefficients(piece)) for piece in function.pieces],
    )


def _compile_smooth_step(
    function: SmoothStep, place: str, continuity: int
) -> PiecewisePolynomial:
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
    return _pad_pieces(starts, [before, rise, after])


def _compile_spline(
    function: Spline, place: str, continuity: int
) -> PiecewisePolynomial:
    if function.interpolation == "hold":
        return _held_values(function)
    smooth = (
        function.interpolation == "smooth" if function.interpolation else continuity > 0
    )
    return _cubic_spline(function) if smooth else _linear_interpolation(function)


def _held_values(function: Spline) -> PiecewisePolynomial:
    """Each value until the next time, the first one also before."""
    values = np.array(function.values)
    return PiecewisePolynomial(np.array(function.times), values[:, None])


def _linear_interpolation(function: Spline) -> PiecewisePolynomial:
    """Straight lines between the points, constant beyond them."""
    t, values = np.array(function.times), np.array(function.values)
    slopes = np.append(np.diff(values) / np.diff(t), 0.0)
    terms = np.stack([values, slopes], axis=1)
    before = [values[0], 0.0]
    return PiecewisePolynomial(np.append(t[0] - 1.0, t), np.vstack([before, terms]))


def _cubic_spline(function: Spline) -> PiecewisePolynomial:
    """A cubic spline, straight beyond its ends."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(function.times, function.values, bc_type=function.ends)
    t, slopes = spline.x, spline(spline.x[[0, -1]], 1)
    before = [function.values[0] - slopes[0], slopes[0], 0.0, 0.0]
    after = [function.values[-1], slopes[1], 0.0, 0.0]
    terms = np.vstack([before, spline.c[::-1].T, after])
    return PiecewisePolynomial(np.append(t[0] - 1.0, t), terms)


def _compile_harmonic(
    function: Harmonic, place: str, continuity: int
) -> HarmonicFunction:
    omega = function.angular_frequency
    if omega is None:
        assert function.frequency is not None
        omega = 2.0 * math.pi * function.frequency
    return HarmonicFunction(function.offset, function.amplitude, omega, function.phase)


def _compile_ramp(function: SineRamp, place: str, continuity: int) -> SineRampFunction:
    return SineRampFunction(function)


def _compile_sampled(function: Given, place: str, continuity: int) -> SmoothCurve:
    if function.terms:
        return SmoothCurve(
            np.array(function.edges), np.array(function.terms), function.kinks
        )
    raise InputError(
        "its values are left to a program",
        place=place,
        expected="a callable in `compile_scene(..., drives={name: callable})`, or in "
        "its `forces`",
    )


_COMPILERS: dict[type, Callable[..., CompiledFunction]] = {
    Constant: _compile_constant,
    Polynomial: _compile_polynomial,
    Harmonic: _compile_harmonic,
    SmoothStep: _compile_smooth_step,
    SineRamp: _compile_ramp,
    Spline: _compile_spline,
    Given: _compile_sampled,
}


def _to_sampled(curve: SmoothCurve) -> Given:
    """To the last bit."""
    terms = tuple(tuple(map(float, piece)) for piece in curve.terms)
    edges, kinks = tuple(map(float, curve.edges)), tuple(map(float, curve.kinks))
    return Given(edges=edges, terms=terms, kinks=kinks)


def _pad_pieces(starts: list[float], terms: list[Array]) -> PiecewisePolynomial:
    padded = np.zeros((len(terms), max(map(len, terms))))
    for row, term in zip(padded, terms, strict=True):
        row[: len(term)] = term
    return PiecewisePolynomial(np.array(starts), padded)


def curve_of_table(table: LookupTable) -> PiecewisePolynomial:
    """The curve of a table of one variable."""
    x, _, values = table.points
    spline = Spline(
        times=x.tolist(), values=values.tolist(), interpolation=table.interpolation
    )
    curve = compile_function(spline, "")
    assert isinstance(curve, PiecewisePolynomial)
    return curve


def grid_data(table: LookupTable) -> Array:
    """Numbers of x and y, x, y and the values row by row, as kernels read them."""
    x, y, values = table.points
    return np.concatenate([[len(x), len(y)], x, y, values.ravel()])


def curve_values(curve: PiecewisePolynomial, x: Array, order: int) -> Array:
    """The values of a curve at places (nx,), or a derivative."""
    k = np.maximum(np.searchsorted(curve.starts, x, side="right") - 1, 0)
    terms = polyder(curve.terms, order, axis=1)[k]
    return np.asarray(polyval(x - curve.starts[k], terms.T, tensor=False))
