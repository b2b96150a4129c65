"""Callables of a program: functions of time as polynomials, laws as native functions.

A function of time is interpolated by piecewise Chebyshev polynomials; its rate and
acceleration are those of the polynomials, so that they are consistent. Only values of
the callable are known, and features shorter than the spacing of the samples are not
seen. A law is compiled by numba where possible; otherwise kernels call Python.

Numbers that callables of a program return.
"""

import ctypes
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .chebyshev import ChebyshevSeries, FitSamples, bisected_fit
from .kink_positions import fit_with_kinks
from .piecewise import KINK_PIECE, check_rates, kink_times

DEGREE = 14
#: Tolerated error relative to the largest value.
RELATIVE_ERROR = 1e-13
#: Part of the run that the shortest feature lasts which is surely seen, and the number
#: of times that it is looked at.
RESOLVED_FRACTION, SAMPLES_PER_FEATURE = 1.0 / 4096.0, 4
#: The shortest feature that can be requested, as a part of the run.
MIN_RESOLVED_FRACTION = 1e-6
#: Tolerated difference of given derivatives from those of the interpolant.
DERIVATIVE_TOLERANCES = (1e-10, 1e-7, 1e-4)
Interpolant = tuple[Array, Array, tuple[float, ...]]
VALUE_INDEX = -1


def real_number(value: Any) -> float:
    """The value as a float; texts and truth values, which `float` takes, are none.

    Raises
    ------
    TypeError, ValueError
        It is no real number, or an array of several.
    """
    if type(value) is float:
        return value
    kind = np.asarray(value).dtype.kind
    if kind not in "iufO" or isinstance(value, str | bytes):
        raise TypeError(f"{value!r} is no real number")
    return float(value)


@dataclass(frozen=True)
class ArrayFunction:
    """A function of time that gives values (nt,) at times (nt,)."""

    values: Callable[[Array], Array]

    def __call__(self, t: float) -> float:
        return float(self.values(np.array([t]))[0])


#: A function of time, or one with its first derivative, or with its first two.
TimeFunctions = Callable[[float], float] | tuple[Callable[[float], float], ...]


@dataclass(frozen=True)
class Timed:
    """A function of time, and what is known of its features.

    A program can be requested values only, so that nothing shorter than the distance
    between two looks at it can be known. It is looked at often enough to see, wherever
    it lies, whatever lasts at least `shortest`; what is seen at all is then followed to
    rounding. Shorter features are surely seen only at the `times` that are named.

    Attributes
    ----------
    function
        f(t), or a tuple of f and its first, or first two, derivatives.
    times
        Where features of any width begin, end or have their largest value [s].
    shortest
        Duration of the shortest feature [s], 1/4096 of the run by default; a callable
        is requested 4 values in that time.
    """

    function: TimeFunctions
    times: Sequence[float] = ()
    shortest: float | None = None


#: What replaces a function of time.
Derivatives = TimeFunctions | Timed


def interpolate_callable(
    program: Derivatives, span: tuple[float, float], place: str, smooth: bool = True
) -> Interpolant:
    """Edges (n + 1,), coefficients on [-1, 1] (n, terms), and the times of kinks.

    Kinks are jumps of the first three derivatives: all of 900 at random places, in
    functions of five kinds, were found, to 1e-7 of the span. Of jumps of the fourth
    derivative a tenth is not found, of later ones more; there pieces follow the
    function to 1e-13, but no step ends at the kink.

    Parameters
    ----------
    smooth
        The rate must not jump.

    Raises
    ------
    InputError
        Values that are no numbers, a jump of the value or, of smooth ones, of the rate,
        derivatives that belong to another function, or features that cannot be looked
        for.
    """
    timed = program if isinstance(program, Timed) else Timed(program)
    given = timed.function
    functions = given if isinstance(given, tuple) else (given,)
    if not 1 <= len(functions) <= 3:
        raise InputError(
            f"has {len(functions)} callables",
            place=place,
            expected="a function of time, and at most two derivatives",
        )

    def evaluate(times: Array) -> Array:
        return _evaluate_callable(functions[0], times, place)

    inside = {float(t) for t in timed.times if span[0] < t < span[1]}
    edges = np.array([span[0], *sorted(inside), span[1]])
    times = _sample_times(program, span, place)
    scan = FitSamples(times, evaluate(times))

    def fit(kinks: Sequence[float]) -> ChebyshevSeries:
        ends = np.unique([*edges, *kinks])
        return bisected_fit(evaluate, ends, scan, DEGREE, RELATIVE_ERROR, place)

    series, known = fit_with_kinks(fit, evaluate)
    if smooth:
        check_rates(series, place)
    _check_derivatives(functions[1:], series, place)
    powers = np.array([_monomial_coefficients(unit) for unit in np.eye(DEGREE + 1)])
    return series.edges, series.terms @ powers, kink_times(series, known)


def shortest_resolved_feature(program: Derivatives, span: tuple[float, float]) -> float:
    """Duration of the shortest feature that is surely seen [s]."""
    requested = program.shortest if isinstance(program, Timed) else None
    return RESOLVED_FRACTION * (span[1] - span[0]) if requested is None else requested


def _sample_times(program: Derivatives, span: tuple[float, float], place: str) -> Array:
    """Times of the scan, (nt,)."""
    length, shortest = span[1] - span[0], shortest_resolved_feature(program, span)
    if not shortest >= MIN_RESOLVED_FRACTION * length:
        raise InputError(
            f"features of {shortest:.6g} s in a run of {length:.6g} s cannot be looked "
            "for",
            place=place,
            expected=f"at least {MIN_RESOLVED_FRACTION * length:.6g} s; of shorter "
            "ones, the `times` at which they are",
        )
    count = max(1, math.ceil(SAMPLES_PER_FEATURE * length / shortest))
    return np.asarray(span[0] + length * (np.arange(count) + 0.5) / count)


def _monomial_coefficients(series: Array) -> Array:
    coefficients = np.zeros(DEGREE + 1)
    powers = chebyshev.cheb2poly(series)
    coefficients[: len(powers)] = powers
    return coefficients


def _evaluate_callable(
    function: Callable[[float], float], times: Array, place: str
) -> Array:
    try:
        if isinstance(function, ArrayFunction):
            values = function.values(times)
        else:
            values = np.array([real_number(function(t)) for t in times.tolist()])
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(
            f"the callable fails: {error}", place=place, expected="a number"
        ) from None
    if not np.isfinite(values).all():
        t = times[~np.isfinite(values)][0]
        raise InputError(
            f"the callable gives no finite number at t = {t:.9g} s", place=place
        )
    return values


def _check_derivatives(
    given: tuple[Callable[[float], float], ...], series: ChebyshevSeries, place: str
) -> None:
    """Compares at a quarter, the middle and three quarters of every long piece."""
    long = series.lengths > KINK_PIECE * series.lengths.max()
    starts, lengths = series.edges[:-1][long], series.lengths[long]
    times = np.add.outer([0.25, 0.5, 0.75], np.zeros(len(starts))) * lengths + starts
    for order, function in enumerate(given, start=1):
        values = _evaluate_callable(function, times.ravel(), place)
        differences = np.abs(values - series.at(times.ravel(), order))
        largest = int(np.argmax(differences))
        if differences[largest] > DERIVATIVE_TOLERANCES[order] * max(
            np.abs(values).max(), 1e-300
        ):
            name = ("first", "second")[order - 1]
            raise InputError(
                f"the {name} derivative differs by {differences[largest]:.3g} from "
                f"that of the function near t = {times.ravel()[largest]:.6g} s",
                place=place,
                expected="derivatives of the same function",
            )


_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_double, ctypes.c_double, ctypes.POINTER(ctypes.c_double), ctypes.c_int64
)


class NativeCallable:
    """A function f(t, y) and, if they are given, its derivatives by y.

    Kernels call `double f(double t, double *y, long i)`: the value for i = -1, else the
    derivative by y[i].

    Attributes
    ----------
    address
        Of that function.
    compiled_function
        Whether numba could compile what was given.
    pending
        An exception that has to go on as soon as the kernel returns, or None.
    failure
        The last time [s] at which it gave no number, and why; None if it always did,
        and of what numba compiled.
    """

    def __init__(
        self,
        function: Callable[[float, Array], float],
        count: int,
        derivatives: Callable[[float, Array], Sequence[float]] | None = None,
    ) -> None:
        self.function, self.count = function, count
        self.derivatives = derivatives
        self.pending: BaseException | None = None
        self.failure: tuple[float, str] | None = None
        self._kept: Any = _compile_callback(function, derivatives, count)
        self.compiled_function = self._kept is not None
        if self._kept is None:
            self._kept = _SIGNATURE(self._call)
            address = ctypes.cast(self._kept, ctypes.c_void_p).value
        else:
            address = self._kept.address
        assert address is not None
        self.address = int(address)

    def raise_pending(self) -> None:
        """Raises what has to go on, such as KeyboardInterrupt."""
        if self.pending is not None:
            error, self.pending = self.pending, None
            raise error

    def _call(self, t: float, y: Any, i: int) -> float:
        if self.pending is not None:
            return math.nan
        try:
            values = np.array(y[: self.count])
            if i == VALUE_INDEX:
                return real_number(self.function(t, values))
            assert self.derivatives is not None
            return real_number(self.derivatives(t, values)[i])
        except Exception as error:
            what = "" if i == VALUE_INDEX else "has derivatives that "
            self.failure = t, what + _fails(error, plural=i != VALUE_INDEX)
            return math.nan
        except BaseException as error:
            self.pending = error
            return math.nan

    def failure_text(self, t: float, y: Array) -> str:
        """Why it gives no number at a time and for outputs."""
        if self.failure is not None and self.failure[0] == t:
            return self.failure[1]
        try:
            value = real_number(self.function(t, np.array(y)))
        except Exception as error:
            return _fails(error)
        return f"gives {value}"


def _fails(error: Exception, plural: bool = False) -> str:
    return f"fail{'' if plural else 's'} with {type(error).__name__}: {error}"


def _compile_callback(function: Any, derivatives: Any, count: int) -> Any:
    """What numba makes of them, or None."""
    import numba

    f = _dispatcher(numba, function)
    g = f if derivatives is None else _dispatcher(numba, derivatives)
    has_derivatives = derivatives is not None
    if f is None or g is None:
        return None

    def value(t, y, i):  # type: ignore[no-untyped-def]
        if i < 0:
            return float(f(t, numba.carray(y, (count,))))
        if has_derivatives:
            return float(g(t, numba.carray(y, (count,)))[i])
        return math.nan

    kinds = numba.types
    arguments = kinds.double, kinds.CPointer(kinds.double), kinds.int64
    signature = kinds.double(*arguments)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            compiled = numba.njit(signature)(value)
            number = _without_exceptions(compiled.overloads[arguments], signature)
            made = numba.cfunc(signature)(lambda t, y, i: number(t, y, i))
    except Exception:
        return None
    return made if _gives_numbers(f) else None


def _without_exceptions(compiled: Any, signature: Any) -> Any:
    """A function for compiled code: what numba compiled, and NaN where that raises.

    A `try` in compiled code says the same and takes twice as long to compile.
    """
    from numba.extending import intrinsic

    @intrinsic  # type: ignore[untyped-decorator]
    def number(typing: Any, t: Any, y: Any, i: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            context.active_code_library.add_linking_library(compiled.library)
            status, value = context.call_internal_no_propagate(
                builder, compiled.fndesc, signature, arguments
            )
            nan = context.get_constant(signature.return_type, math.nan)
            return builder.select(status.is_ok, value, nan)

        return signature, build

    return number


def _gives_numbers(function: Any) -> bool:
    """True if what numba compiled gives numbers; `float` of numba takes truth values
    and texts, too.
    """
    from numba import types

    overloads = getattr(function, "overloads", {}).values()
    kinds = [types.unliteral(each.signature.return_type) for each in overloads]
    return all(isinstance(kind, types.Number) for kind in kinds)


def _dispatcher(numba: Any, function: Any) -> Any:
    if hasattr(function, "py_func"):
        return function
    try:
        return numba.njit(function)
    except Exception:
        return None
