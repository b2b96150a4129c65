"""Functionals: numbers that a motion gives, such as `max_abs(rod.q1)`.

A functional is written NAME(OUTPUT) or NAME(OUTPUT, ARGUMENT). Those of a motion are
evaluated on the dense output of the steps: integrals by the quadrature of each step,
extrema at their exact instant, where the output is stationary.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from scipy.optimize import brentq

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, parse_output, unit_of
from sidtool.formats.toml.expressions import evaluate_number, split_at_commas
from sidtool.solver.output.dense_output import StepPoints
from sidtool.solver.simulation.frozen_run import Motion, StructureChange
from sidtool.solver.system.system import System

from .measurements import Measurement, read_measurements

if TYPE_CHECKING:
    from sidtool.solver.analyses.linearisation import Linearisation

#: A peak within this part of the range of an output is a rival of the largest one.
RIVAL_PEAK = 1e-3
#: Steps whose points come within this part of the range of the largest value are
#: searched for a peak between the points.
NEAR_PEAK = 0.1
#: Parts of a step about a peak in which it is sought as the vertex of a parabola, the
#: second about the first one.
VERTEX_FRACTIONS = (0.02, 3e-4)
#: An output jumps between two steps by more than this part of its range.
JUMP = 1e-6

_FORM = re.compile(r"(\w+)\((.*)\)")
_EXPECTED = "NAME(OUTPUT), such as max_abs(rod.q1); `sidtool sensitivity -h` lists all"


class Peak(NamedTuple):
    """Where a largest value lies.

    Attributes
    ----------
    step : number of the step of the grid
    at_point : point of the step if it is an end of the motion or a jump, or -1
    sign : 1 for a maximum, -1 for a minimum
    """

    step: int
    at_point: int
    sign: float


class History:
    """A motion with the outputs of the scene at the points of its steps."""

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.points, self.t = motion.points, motion.steps.t
        self._values: dict[str, Array] = {}

    def values(self, output: str) -> Array:
        """An output at the points of all steps, (nt,)."""
        if output not in self._values:
            blocks = self.points.batches([self.motion.steps])
            parts = [self.motion.output(output, b.t, b.z, b.v) for b in blocks]
            self._values[output] = np.concatenate(parts)
        return self._values[output]

    def at(self, times: Array, output: str) -> Array:
        """An output at times of the motion, (nt,)."""
        return self.motion.output_at(output, times)

    def _climb(self, output: str, step: int, sign: float) -> tuple[float, float, float]:
        """Time of a peak, sought uphill from a step, and the ends of its step [s]."""
        count, fractions = self.points.count, self.points.fractions
        n_steps = len(self.t) // count
        known: dict[int, tuple[float, float]] = {}
        while True:
            around = range(max(0, step - 1), min(n_steps, step + 2))
            missing = [k for k in around if k not in known]
            if missing:
                y = self._values_in_steps(output, missing[0], missing[-1] + 1)
                for k, row in zip(range(missing[0], missing[-1] + 1), y, strict=True):
                    known[k] = _polynomial_peak(sign * row, fractions)
            best = max(around, key=lambda k: known[k][0])
            if known[best][0] <= known[step][0]:
                break
            step = best
        begin, end = self.t[step * count], self.t[(step + 1) * count - 1]
        return begin + known[step][1] * (end - begin), begin, end

    def _values_in_steps(self, output: str, first: int, last: int) -> Array:
        """An output at the points of some steps, (last - first, count)."""
        rows = slice(first * self.points.count, last * self.points.count)
        if output in self._values:
            found = self._values[output][rows]
        else:
            steps = self.motion.steps
            parts = (steps.t[rows], steps.z[rows], steps.v[rows])
            found = self.motion.output(output, *parts)
        return found.reshape(last - first, -1)

    def integral(self, values: Array) -> float:
        """Integral over the motion of values at the points of all steps."""
        end = np.array([self.motion.end_time])
        return float(self.points.integral(self.t, values, end)[0])

    @property
    def duration(self) -> float:
        return self.motion.end_time - self.motion.system.scene.time.start

    # Peaks

    def find_peaks(self, output: str, signs: Sequence[float]) -> list[Peak]:
        """The largest value of an output, and the largest other peak if it is almost
        as large.

        Parameters
        ----------
        signs : 1 for maxima, -1 for minima, both for the absolute value
        """
        table = self.values(output).reshape(-1, self.points.count)
        fractions = self.points.fractions
        found: list[tuple[float, Peak]] = []
        for sign in signs:
            heights = (sign * table).max(axis=1)
            near = np.flatnonzero(heights >= heights.max() - NEAR_PEAK * np.ptp(table))
            largest = {
                int(k): _polynomial_peak(sign * table[k], fractions) for k in near
            }
            heights[near] = [value for value, _ in largest.values()]
            for _ in range(2):
                top = int(np.argmax(heights))
                if top not in largest:
                    break
                end = self._end_point(table, top, largest[top][1])
                place = int(np.searchsorted(self.motion.places, top))
                found.append((float(heights[top]), Peak(place, end, sign)))
                low, high = _hill(heights, top)
                heights[low : high + 1] = -np.inf
        found.sort(key=lambda pair: -pair[0])
        height, first = found[0]
        close = height - RIVAL_PEAK * np.ptp(table)
        return [first, *(peak for other, peak in found[1:2] if other > close)]

    def _end_point(self, table: Array, step: int, fraction: float) -> int:
        """Point of a step with its largest value if that is an end of the motion or
        lies at a jump of the output, else -1.
        """
        if 0.0 < fraction < 1.0:
            return -1
        point, neighbour = (0, step - 1) if fraction == 0.0 else (-1, step + 1)
        is_end = not 0 <= neighbour < len(table)
        if not is_end:
            jump = abs(table[step, point] - table[neighbour, -1 - point])
            is_end = bool(jump > JUMP * np.ptp(table))
        return point % table.shape[1] if is_end else -1

    def peak_value(self, output: str, peak: Peak) -> float:
        """The output at a peak, sought where it was in another motion."""
        times, weights = self.peak_weights(output, peak)
        if peak.at_point >= 0:
            step = int(self.motion.places[peak.step])
            values = self._values_in_steps(output, step, step + 1)
            return float(values[0, peak.at_point])
        return float(weights @ self.at(times, output))

    def peak_weights(self, output: str, peak: Peak) -> tuple[Array, Array]:
        """Times about a peak [s], and the weights of the output there in its value.

        The value is the vertex of a parabola, which is homogeneous in the values that
        it goes through: the weights are its derivatives by these, too.

        Raises
        ------
        StructureChange : the peak lies in another step.
        """
        count = self.points.count
        step = int(self.motion.places[min(peak.step, len(self.motion.places) - 1)])
        if step >= len(self.t) // count:
            raise StructureChange(f"the peak of {output} lies in another step")
        if peak.at_point >= 0:
            place = step * count + peak.at_point
            return self.t[place : place + 1], np.ones(1)
        t, begin, end = self._climb(output, step, peak.sign)
        times, weights = np.array([t]), np.ones(1)
        for fraction in VERTEX_FRACTIONS:
            distance = fraction * (end - begin)
            around = np.array([t - distance, t, t + distance])
            if around[0] < self.t[0] or around[-1] > self.t[-1]:
                break
            low, middle, high = self.at(around, output)
            curvature = low + high - 2.0 * middle
            slope = (high - low) / curvature if peak.sign * curvature < 0.0 else np.inf
            if abs(slope) > 2.0:
                break
            even, odd = slope**2 / 8.0, slope / 4.0
            times = around
            weights = np.array([even + odd, 1.0 - 2.0 * even, even - odd])
            t -= 0.5 * slope * distance
        return times, weights

    # Settling

    def settling(self, output: str, band: float) -> tuple[float, float]:
        """Time [s] from which on an output stays within a band about its last value,
        and its rate there; the start of the motion and infinity if it never leaves it.

        Raises
        ------
        InputError : the output jumps into the band.
        """
        count, fractions = self.points.count, self.points.fractions
        last = float(self.values(output)[-1])
        table = self.values(output).reshape(-1, count) - last
        heights = np.abs(table).max(axis=1)
        for step in np.flatnonzero(heights >= (1.0 - NEAR_PEAK) * band)[::-1]:
            peaks = [_polynomial_peak(s * table[step], fractions) for s in (1.0, -1.0)]
            x = np.append(
                fractions, [where for height, where in peaks if height > band]
            )
            t = self.t[step * count] + x * self._length(step)
            outside = np.abs(self.at(t, output) - last) > band
            if outside.any():
                break
        else:
            return float(self.motion.system.scene.time.start), math.inf
        x_out = float(x[outside].max())
        inside = fractions[fractions > x_out]
        if not len(inside):  # between the points of two steps
            step, x_out, inside = step + 1, 0.0, fractions[1:]
            if abs(table[step, 0]) <= (1.0 - JUMP) * band:
                raise InputError(
                    f"{output} jumps at {self.t[step * count]:g} s",
                    place="settling_time",
                    expected="an output that is continuous where it settles",
                )
        begin, length = float(self.t[step * count]), self._length(step)

        def beyond(x: float) -> float:
            y = float(self.at(np.array([begin + x * length]), output)[0])
            return abs(y - last) - band

        x_in = float(inside[0])
        root = brentq(beyond, x_out, x_in, xtol=1e-14) if beyond(x_out) > 0.0 else x_out
        terms = (_to_powers(count) @ table[step]).tolist()
        slope = _with_derivatives(terms, 2.0 * root - 1.0)[1]
        return begin + root * length, 2.0 * slope / length

    def _length(self, step: int) -> float:
        """Of a step [s]."""
        count = self.points.count
        return float(self.t[(step + 1) * count - 1] - self.t[step * count])


def _hill(heights: Array, top: int) -> tuple[int, int]:
    """First and last step of the hill with a top, down to the valleys beside it."""
    low = high = top
    while low > 0 and heights[low - 1] <= heights[low]:
        low -= 1
    while high + 1 < len(heights) and heights[high + 1] <= heights[high]:
        high += 1
    return low, high


def _polynomial_peak(values: Array, fractions: Array) -> tuple[float, float]:
    """Largest value of the polynomial through the points of a step, and where."""
    k = int(np.argmax(values))
    best = float(values[k]), float(fractions[k])
    terms = (_to_powers(len(values)) @ values).tolist()
    low = float(fractions[max(k - 1, 0)])
    high = float(fractions[min(k + 1, len(fractions) - 1)])
    at = best[1]
    for _ in range(20):
        value, slope, curvature = _with_derivatives(terms, 2.0 * at - 1.0)
        if not curvature < 0.0:
            return best
        change = -0.5 * slope / curvature
        at += change
        if not low <= at <= high:
            return best
        if abs(change) < 1e-14:
            break
    value = _with_derivatives(terms, 2.0 * at - 1.0)[0]
    return (value, at) if value >= best[0] else best


@cache
def _to_powers(count: int) -> Array:
    """Coefficients of powers of x in -1 to 1 from values at the points of a step."""
    x = 2.0 * StepPoints(count - 2).fractions - 1.0
    return np.asarray(np.linalg.inv(np.vander(x, increasing=True)))


def _with_derivatives(terms: Sequence[float], x: float) -> tuple[float, float, float]:
    """Value, slope and second derivative of a polynomial, by Horner's scheme."""
    value = slope = half_curvature = 0.0
    for term in reversed(terms):
        half_curvature = half_curvature * x + slope
        slope = slope * x + value
        value = value * x + term
    return value, slope, 2.0 * half_curvature


class Kind(NamedTuple):
    """A kind of functional.

    Attributes
    ----------
    argument : what stands behind the output: "", "time", "power", "band" or "file"
    text : one line for `--help`
    unit : unit of a value, from the unit of the output
    """

    argument: str
    text: str
    unit: Callable[[str], str] = lambda unit: unit


def _times_second(unit: str) -> str:
    return f"{unit} s".strip()


#: Functionals of a motion, with an output.
MOTION_KINDS = {
    "max": Kind("", "largest value, at its exact instant"),
    "min": Kind("", "least value"),
    "max_abs": Kind("", "largest absolute value"),
    "mean": Kind("", "mean over time"),
    "rms": Kind("", "root of the mean square over time"),
    "integral": Kind("", "integral over time", _times_second),
    "norm": Kind("power", "norm(y, p): (mean of |y|^p)^(1/p), a smooth max_abs"),
    "final": Kind("", "value at the end of the motion"),
    "value": Kind("time", "value(y, t): value at the time t"),
    "settling_time": Kind(
        "band",
        "settling_time(y, b): time from which on y stays within b of its last value",
        lambda _: "s",
    ),
    "error": Kind("file", "error(y, FILE.csv): root mean square distance to a table"),
}
#: Functionals of the scene without a motion.
SCENE_KINDS = {
    "end_time": Kind(
        "", "time at which the motion ends, as by an event", lambda _: "s"
    ),
    "mass": Kind(
        "", "mass(BODY): mass of a body; mass(*) of all bodies", lambda _: "kg"
    ),
    "frequency": Kind("", "frequency(k): k-th natural frequency", lambda _: "Hz"),
    "damping_ratio": Kind("", "damping_ratio(k): of that mode", lambda _: ""),
    "static": Kind("", "static(y): value in the static equilibrium"),
}
KINDS = MOTION_KINDS | SCENE_KINDS


@dataclass(frozen=True)
class Functional:
    """A functional of a scene.

    Attributes
    ----------
    text : as it was written
    kind : a key of `KINDS`
    output : output of the scene; body or number of a mode for some kinds
    number : time [s], power or half width of a band; 0 if it has none
    measurement : of `error`
    is_scalar : True if the value is one number
    """

    is_scalar: ClassVar[bool] = True

    text: str
    kind: str
    output: str
    number: float = 0.0
    measurement: Measurement | None = None

    @property
    def needs_motion(self) -> bool:
        return self.kind in MOTION_KINDS or self.kind == "end_time"

    @property
    def recorded(self) -> str:
        """The output that the scene has to evaluate, or empty."""
        return self.output if self.kind in (*MOTION_KINDS, "static") else ""

    def unit(self, scene: SceneFile) -> str:
        """Unit of the value."""
        unit = unit_of(self.recorded, scene) if self.recorded else ""
        return KINDS[self.kind].unit(unit)

    def peaks(self, history: History) -> list[Peak]:
        """Where the value lies in a nominal motion, for extrema, then a rival if there
        is one.
        """
        signs = {"max": (1.0,), "min": (-1.0,), "max_abs": (1.0, -1.0)}
        if self.kind not in signs:
            return []
        return history.find_peaks(self.output, signs[self.kind])

    def scale(self, history: History | None, values: Array) -> Array:
        """Sizes of changes of the values that matter."""
        largest = 0.0
        if history is not None and self.kind == "settling_time":
            largest = history.duration
        elif history is not None and self.kind in MOTION_KINDS:
            largest = float(np.abs(history.values(self.output)).max())
        return np.maximum(np.abs(values), max(largest, float(np.finfo(float).tiny)))

    def of_motion(self, history: History, peak: Peak | None) -> float:
        """The value of a motion.

        Parameters
        ----------
        peak : of the nominal motion

        Raises
        ------
        StructureChange : the motion ends before the time of the value.
        """
        if self.kind == "end_time":
            return history.motion.end_time
        if peak is not None:
            value = history.peak_value(self.output, peak)
            return peak.sign * value if self.kind == "max_abs" else value
        if self.kind == "final":
            return float(history.at(np.array([np.inf]), self.output)[0])
        if self.kind in ("value", "error"):
            times = np.array([self.number])
            if self.measurement is not None:
                times = self.measurement.times
            values = self._values_at(history, times)
            if self.measurement is None:
                return float(values[0])
            return float(np.sqrt(np.mean((values - self.measurement.values) ** 2)))
        if self.kind == "settling_time":
            return history.settling(self.output, self.number)[0]
        y = history.values(self.output)
        if self.kind == "integral":
            return history.integral(y)
        if self.kind == "mean":
            return history.integral(y) / history.duration
        power = 2.0 if self.kind == "rms" else self.number
        mean = history.integral(np.abs(y) ** power) / history.duration
        return float(mean ** (1.0 / power))

    def weights(
        self, history: History, peak: Peak | None
    ) -> tuple[Array | None, Array]:
        """Times [s] and weights w of the derivative sum(w dy(t)) of the value of a
        motion by its output; None for the times of all points of the steps.
        """
        if peak is not None:
            sign = peak.sign if self.kind == "max_abs" else 1.0
            times, weights = history.peak_weights(self.output, peak)
            return times, sign * weights
        if self.kind == "final":
            return history.t[-1:], np.ones(1)
        if self.kind == "value":
            return np.array([self.number]), np.ones(1)
        if self.measurement is not None:
            times = self.measurement.times
            difference = self._values_at(history, times) - self.measurement.values
            root = float(np.sqrt(np.mean(difference**2)))
            return times, difference / (len(times) * max(root, 1e-300))
        if self.kind == "settling_time":  # |y(t) - y(end)| = band
            t, rate = history.settling(self.output, self.number)
            return np.array([t, history.t[-1]]), np.array([-1.0, 1.0]) / rate
        weights = history.points.integration_weights(history.t)
        if self.kind == "integral":
            return None, weights
        weights = weights / history.duration
        if self.kind == "mean":
            return None, weights
        y = history.values(self.output)
        power = 2.0 if self.kind == "rms" else self.number
        value = max(self.of_motion(history, None), 1e-300)
        return None, weights * np.sign(y) * (np.abs(y) / value) ** (power - 1.0)

    def _values_at(self, history: History, times: Array) -> Array:
        start, end = history.motion.system.scene.time.start, history.motion.end_time
        rounding = 1e-9 * (end - start)
        if times.min() < start - rounding or times.max() > end + rounding:
            raise InputError(
                f"the motion lasts from {start:g} to {end:g} s",
                place=self.text,
                expected="times inside",
            )
        return history.at(np.clip(times, start, end), self.output)

    def of_system(self, system: System) -> float:
        """The value of a scene without a motion.

        Raises
        ------
        SimulationError : there is no equilibrium, or there are no modes.
        """
        if self.kind == "mass":
            return self._mass(system)
        if self.kind == "static":
            result = system.cached(_static_result)
            return float(result.values[0, result.names.index(self.output)])
        modes = system.cached(_natural_modes)
        column = modes.frequencies if self.kind == "frequency" else modes.damping_ratios
        k = int(self.output)
        if not 1 <= k <= len(column):
            raise InputError(
                f"the scene has {len(column)} natural modes",
                place=self.text,
                expected="the number of one of them",
            )
        return float(column[k - 1])

    def _mass(self, system: System) -> float:
        masses = {b.name: b.sid.mass for b in system.bodies if b.is_scene_body}
        if self.output == "*":
            return float(sum(masses.values()))
        if self.output not in masses:
            raise InputError(
                f"there is no body {self.output!r}",
                place=self.text,
                expected=f"one of {', '.join(masses)}",
            )
        return float(masses[self.output])


class Term(NamedTuple):
    """A functional, at one of its peaks if it is an extremum.

    Attributes
    ----------
    functional : the functional
    peak : where it lies in the nominal motion
    rival_of : number of the functional of which this is another peak, or -1
    """

    functional: Functional
    peak: Peak | None = None
    rival_of: int = -1

    def value(self, system: System, history: History | None) -> Array:
        """The value of a scene and its motion, (1,), or several values."""
        if self.functional.needs_motion and history is not None:
            return np.atleast_1d(self.functional.of_motion(history, self.peak))
        return np.atleast_1d(self.functional.of_system(system))


def _static_result(system: System) -> Result:
    """Outputs of the static equilibrium."""
    from sidtool.solver.analyses.static_equilibrium import static_equilibrium

    return static_equilibrium(system.full_joint_system).result()


def _natural_modes(system: System) -> Linearisation:
    """Natural modes about the static equilibrium."""
    from sidtool.solver.analyses.linearisation import linearise

    return linearise(system.full_joint_system)


def parse_functionals(
    texts: str | Iterable[str], folder: Path = Path(".")
) -> list[Functional]:
    """Parse functionals of the option `--of`; one text may hold several, with commas.

    Parameters
    ----------
    folder : of relative paths of tables

    Raises
    ------
    InputError : a text has another form.
    """
    given = [texts] if isinstance(texts, str) else [*texts]
    listed = dict.fromkeys(part for text in given for part in split_at_commas(text))
    if not listed:
        raise InputError("there is no functional", place="--of", expected=_EXPECTED)
    return [_parse(text, folder) for text in listed]


def _parse(text: str, folder: Path) -> Functional:
    match = _FORM.fullmatch(text)
    name = match[1] if match else text
    if name not in KINDS or (match is None and name != "end_time"):
        expected = _EXPECTED if match is None else f"one of {', '.join(KINDS)}"
        raise InputError(f"found {text!r}", place="--of", expected=expected)
    arguments = split_at_commas(match[2]) if match else []
    kind = KINDS[name]
    wanted = (1 if name != "end_time" else 0) + bool(kind.argument)
    if len(arguments) != wanted:
        raise InputError(
            f"found {text!r} with {len(arguments)} arguments",
            place="--of",
            expected=kind.text if kind.argument else f"{name}(...): {kind.text}",
        )
    output = arguments[0] if arguments else ""
    if name in MOTION_KINDS or name == "static":
        try:
            parse_output(output)
        except InputError as error:
            raise InputError(
                error.problem, place=f"--of {text}", expected=error.expected
            ) from None
    if name in ("frequency", "damping_ratio") and not output.isdecimal():
        raise InputError(f"found {text!r}", place="--of", expected=kind.text)
    if kind.argument == "file":
        path = folder / arguments[1].strip("'\"")
        return Functional(text, name, output, measurement=_measured(path, output))
    number = _number(arguments[1], text) if kind.argument else 0.0
    if kind.argument == "power" and not number >= 1.0:
        raise InputError(
            f"found {text!r}", place="--of", expected="a power of 1 or more"
        )
    if kind.argument == "band" and not number > 0.0:
        raise InputError(f"found {text!r}", place="--of", expected="a positive width")
    return Functional(text, name, output, number)


def _measured(path: Path, output: str) -> Measurement:
    """The column of an output in a table; the only column may have any name."""
    columns = read_measurements(path)
    if output not in columns and len(columns) > 1:
        raise InputError(
            f"has the columns {', '.join(columns)}", source=path, expected=output
        )
    return columns.get(output) or next(iter(columns.values()))


def _number(argument: str, text: str) -> float:
    try:
        return float(evaluate_number(argument, {}))
    except InputError:
        raise InputError(
            f"found {argument!r} in {text!r}", place="--of", expected="a number"
        ) from None


def recorded_outputs(functionals: Sequence[Functional]) -> list[str]:
    """Outputs that the scene has to evaluate, each once."""
    return list(dict.fromkeys(f.recorded for f in functionals if f.recorded))
