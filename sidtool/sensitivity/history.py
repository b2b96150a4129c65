"""Histories of outputs over a motion: integrals, peaks, the time of settling.

All are evaluated on the dense output of the steps: integrals by the quadrature of each
step, peaks at their exact instant, where the output is stationary.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver.output.dense_output import StepPoints
from sidtool.solver.simulation.frozen_run import Motion, StructureChange

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
        self._peaks: dict[tuple[str, Peak], tuple[Array, Array, Array]] = {}

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
        _, weights, values = self.peak_samples(output, peak)
        return float(weights @ values)

    def peak_samples(self, output: str, peak: Peak) -> tuple[Array, Array, Array]:
        """Times about a peak [s], and weights and values of the output there.

        The value of the peak is the vertex of a parabola, which is homogeneous in the
        values that it goes through: the weights are its derivatives by these, too.

        Raises
        ------
        StructureChange : the peak lies in another step.
        """
        if (output, peak) not in self._peaks:
            self._peaks[output, peak] = self._sample_peak(output, peak)
        return self._peaks[output, peak]

    def _sample_peak(self, output: str, peak: Peak) -> tuple[Array, Array, Array]:
        count = self.points.count
        step = int(self.motion.places[min(peak.step, len(self.motion.places) - 1)])
        if step >= len(self.t) // count:
            raise StructureChange(f"the peak of {output} lies in another step")
        if peak.at_point >= 0:
            values = self._values_in_steps(output, step, step + 1)[0]
            place = step * count + peak.at_point
            value = values[peak.at_point : peak.at_point + 1]
            return self.t[place : place + 1], np.ones(1), value
        t, begin, end = self._climb(output, step, peak.sign)
        times, weights, values = np.array([t]), np.ones(1), None
        for fraction in VERTEX_FRACTIONS:
            distance = fraction * (end - begin)
            around = np.array([t - distance, t, t + distance])
            if around[0] < self.t[0] or around[-1] > self.t[-1]:
                break
            found = self.at(around, output)
            low, middle, high = found
            curvature = low + high - 2.0 * middle
            slope = (high - low) / curvature if peak.sign * curvature < 0.0 else np.inf
            if abs(slope) > 2.0:
                break
            even, odd = slope**2 / 8.0, slope / 4.0
            times, values = around, found
            weights = np.array([even + odd, 1.0 - 2.0 * even, even - odd])
            t -= 0.5 * slope * distance
        if values is None:
            values = self.at(times, output)
        return times, weights, values

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
