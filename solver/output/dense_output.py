"""Dense output of whole steps: states at points of a step, and their polynomial.

The points of a step are Chebyshev's extrema, at which a polynomial interpolates well.
The module also holds the buffer of output times and the states at ends of steps.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import chebyshev

from sidtool.formats.base.sid import Array
from sidtool.formats.result.data import ROWS_PER_BLOCK
from sidtool.formats.scene import OutputTimes

from ..integrators.loop_state import StepLoopState
from ..spatial import system_arrays as at
from ..system.system import System

#: Steps that a control keeps the points of.
STEPS_PER_CHUNK = 20
#: The same where only ends of steps are wanted; of fixed steps, which are short, those
#: of so many ones.
ENDS_PER_CHUNK, FIXED_STEPS_PER_END = 500, 10
#: Steps that are evaluated together.
STEPS_PER_BATCH = 500

#: Numbers in the states of a window, and the fewest output times that it holds.
MAX_WINDOW_NUMBERS, MIN_TIMES = 1 << 19, 64
#: At most twice as many states are kept; of longer runs every second, fourth, ... one.
MAX_STATES = 500
#: Coordinates of states that are handed on together.
MAX_NUMBERS = 500_000


@dataclass(frozen=True, eq=False)
class StepStates:
    """States at the points of some steps, in sequence.

    The first and the last time of a step lie inside it by one rounding error, so that
    they belong to the smooth interval of the step.
    """

    t: Array
    z: Array
    v: Array


def join_steps(parts: Sequence[StepStates]) -> StepStates:
    """Some steps after others."""
    return StepStates(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("t", "z", "v"))
    )


class StepPoints:
    """The points of a step.

    Attributes
    ----------
    count
        Their number.
    fractions
        Where they lie, 0 to 1.
    """

    def __init__(self, degree: int) -> None:
        self.count = degree + 2
        k = np.arange(self.count)
        self.fractions = 0.5 - 0.5 * np.cos(np.pi * k / (self.count - 1))
        self._weights = (-1.0) ** k
        self._weights[[0, -1]] *= 0.5

    def fractions_of_steps(self, count: int) -> Array:
        """`StepLoopState.output_fractions` for so many steps."""
        return np.tile([*self.fractions, -1.0], count)

    def step_ends(self, steps: StepStates) -> StepStates:
        """The last point of each step."""
        last = slice(self.count - 1, None, self.count)
        return StepStates(steps.t[last], steps.z[last], steps.v[last])

    def interpolate_state(self, steps: StepStates, t: float) -> tuple[Array, Array]:
        """z and v at a time inside the steps."""
        part, weights = self.interpolation(steps.t, t)
        return weights @ steps.z[part], weights @ steps.v[part]

    def restrict(self, steps: StepStates, begin: float, end: float) -> StepStates:
        """States between two times inside one step, as those of a shorter step."""
        t = begin + self.fractions * (end - begin)
        t[-1] = np.nextafter(end, -np.inf)
        states = [self.interpolate_state(steps, time) for time in t]
        z, v = zip(*states, strict=True)
        return StepStates(t, np.array(z), np.array(v))

    def integral(self, t: Array, values: Array, until: Array) -> Array:
        """Integral of values at all points from the first until some times, (nt,)."""
        starts = t[:: self.count]
        lengths = t[self.count - 1 :: self.count] - starts
        basis = chebyshev.chebvander(2.0 * self.fractions - 1.0, self.count - 1)
        terms = np.linalg.solve(basis, values.reshape(-1, self.count).T)
        sums = 0.5 * lengths * chebyshev.chebint(terms, lbnd=-1)
        before = np.concatenate([[0.0], np.cumsum(chebyshev.chebval(1.0, sums))])
        k = np.clip(np.searchsorted(starts, until, "right") - 1, 0, len(starts) - 1)
        share = np.clip((until - starts[k]) / lengths[k], 0.0, 1.0)
        return before[k] + chebyshev.chebval(2.0 * share - 1.0, sums[:, k], False)

    def integration_weights(self, t: Array) -> Array:
        """Weights of values at the points of all steps in their integral, (nt,)."""
        basis = chebyshev.chebvander(2.0 * self.fractions - 1.0, self.count - 1)
        sums = chebyshev.chebint(np.linalg.inv(basis), lbnd=-1)
        weights = 0.5 * chebyshev.chebval(1.0, sums)
        lengths = t[self.count - 1 :: self.count] - t[:: self.count]
        return np.asarray(np.outer(lengths, weights).ravel())

    def interpolation(self, t: Array, at: float) -> tuple[slice, Array]:
        """Points of the step with a time, and their weights in its state."""
        ends = t[self.count - 1 :: self.count]
        first = self.count * min(int(np.searchsorted(ends, at)), len(ends) - 1)
        part = slice(first, first + self.count)
        distance = at - t[part]
        if (distance == 0.0).any():
            return part, (distance == 0.0).astype(float)
        weights = self._weights / distance
        return part, weights / weights.sum()

    def batches(self, parts: Sequence[StepStates]) -> Iterator[StepStates]:
        """The same steps in groups that are neither many nor large."""
        steps, size = join_steps(parts), STEPS_PER_BATCH * self.count
        t, z, v = steps.t, steps.z, steps.v
        for i in range(0, len(t), size):
            yield StepStates(t[i : i + size], z[i : i + size], v[i : i + size])


@cache
def step_points(degree: int) -> StepPoints:
    """Points of steps whose dense output has the given degree."""
    return StepPoints(degree)


@cache
def end_fractions(fixed: bool) -> Array:
    """`StepLoopState.shares` for `ENDS_PER_CHUNK` steps, of which the ends
    are wanted.
    """
    if fixed:
        return np.tile(
            [1.0] + [-1.0] * FIXED_STEPS_PER_END, ENDS_PER_CHUNK // FIXED_STEPS_PER_END
        )
    return np.tile([1.0, -1.0], ENDS_PER_CHUNK)


def take_step_ends(control: StepLoopState) -> StepStates:
    """Ends of steps since the last call, by `end_fractions`; the control
    forgets them.
    """
    used = control.fraction_index
    control.fraction_index = 0
    inside = np.flatnonzero(control.output_fractions[:used] > 0.0)
    rows = len(control.output_times) + inside
    return StepStates(
        control.fraction_times[inside], control.output_z[rows], control.output_v[rows]
    )


def take_steps(control: StepLoopState) -> StepStates:
    """The steps since the last call, which the control forgets."""
    used = control.fraction_index
    control.fraction_index = 0
    shares = control.output_fractions[:used]
    inside = np.flatnonzero(shares >= 0.0)
    t = control.fraction_times[inside]
    first, last = shares[inside] == 0.0, shares[inside] == 1.0
    starts = t[first]
    ends = [*starts[1:], control.time] if used else []
    t[first] = np.nextafter(starts, np.inf)
    t[last] = np.nextafter(ends, -np.inf)
    rows = len(control.output_times) + inside
    return StepStates(t, control.output_z[rows], control.output_v[rows])


class OutputTimeBuffer:
    """Which output times come next."""

    def __init__(self, times: OutputTimes | Array, state: int) -> None:
        """Parameters
        ----------
        state
            Numbers in a state.
        """
        self.times = times
        self._first = 0
        rows = max(MIN_TIMES, min(ROWS_PER_BLOCK, MAX_WINDOW_NUMBERS // max(state, 1)))
        self.size = min(rows, len(times)) + 1

    def skip(self, count: int) -> None:
        """The first output times are behind the start."""
        self._first = count

    def fill_next(self, control: StepLoopState) -> None:
        """Has the next times in the control, from its first row on."""
        control.next_output = 0
        next_times = self.times[self._first : self._first + len(control.output_times)]
        control.output_times[: len(next_times)] = next_times
        control.output_times[len(next_times) :] = np.inf

    def reached_states(self, control: StepLoopState) -> tuple[Array, Array, Array]:
        """Times and states of the rows so far; see `go_on`."""
        count = control.next_output
        return (
            control.output_times[:count],
            control.output_z[:count],
            control.output_v[:count],
        )

    def continue_after(self, control: StepLoopState, full: bool) -> StepLoopState:
        """Continue after the rows so far.

        Parameters
        ----------
        full
            The rows are all that the buffer holds within a step; without rows the step
            needs a larger buffer.
        """
        count = control.next_output
        self._first += count
        if full and count == 0:
            control = _with_more_rows(control)
        self.fill_next(control)
        return control


def _with_more_rows(control: StepLoopState) -> StepLoopState:
    """For twice as many output times; the rows are lost."""
    more = len(control.output_times)
    z, v = (
        np.zeros((len(rows) + more, rows.shape[1]))
        for rows in (control.output_z, control.output_v)
    )
    return control.replaced(
        output_times=np.full(2 * more, np.inf), output_z=z, output_v=v
    )


class StepEndStates:
    """Stores states at the ends of steps, and those that verdicts must not miss.

    These are the states of the largest elastic coordinates, of the largest angular
    velocity and accelerations of the frame of each flexible body, of the largest
    acceleration of all, by differences of velocities, and about some times.

    Attributes
    ----------
    times : (n,)
        [s].
    """

    def __init__(self, system: System, times: Iterable[float] = ()) -> None:
        self._elastic: list[int] = []
        #: of each frame its velocity and its angular velocity, in all velocities
        self._frames: list[tuple[slice, slice]] = []
        axes = 2 if system.planar else 3
        for row in system.arrays.body[system.arrays.body[:, at.NQ] > 0]:
            last, u, rd = row[at.POS] + row[at.NP], row[at.VEL], row[at.RD]
            self._elastic += range(last - row[at.NQ], last)
            if rd:
                self._frames.append((slice(u, u + axes), slice(u + axes, u + rd)))
        empty = np.zeros((0, system.n_positions)), np.zeros((0, system.n_velocities))
        self._parts = [StepStates(np.zeros(0), *empty)]
        #: of each signal; signals that are largest at the same time share a state
        self._peaks: dict[int, StepStates] = {}
        self._named: list[StepStates] = []
        self._largest = np.zeros(len(self._elastic) + 3 * len(self._frames) + 1)
        self._count, self._seen, self._stride = 0, 0, 1
        self._last = self._parts[0]
        self._times = np.array(sorted({*times}), float)

    def add(self, ends: StepStates) -> None:
        """Takes the ends of some steps, in the order of time."""
        if not len(ends.t):
            return
        self._keep_extrema(join_steps([self._last, ends]))
        self._last = _select_states(ends, slice(-1, None))
        first = -self._seen % self._stride
        self._seen += len(ends.t)
        part = _select_states(ends, slice(first, None, self._stride))
        self._parts.append(part)
        self._count += len(part.t)
        if self._count > 2 * MAX_STATES:
            thinned = _select_states(join_steps(self._parts), slice(None, None, 2))
            self._parts, self._count = [thinned], len(thinned.t)
            self._stride *= 2

    def _keep_extrema(self, ends: StepStates) -> None:
        """Keeps the state of the largest of each signal, and those about the times."""
        signals = self._signals(ends)
        largest = signals.max(axis=0)
        columns = np.flatnonzero(largest > self._largest)
        rows = signals[:, columns].argmax(axis=0)
        places = rows.tolist()
        states = {k: _select_states(ends, slice(k, k + 1)) for k in {*places}}
        for column, row in zip(columns.tolist(), places, strict=True):
            self._peaks[column] = states[row]
        self._largest = np.maximum(largest, self._largest)
        for row in np.searchsorted(ends.t, self._times):
            if 0 < row < len(ends.t):
                self._named.append(_select_states(ends, slice(row - 1, row + 1)))

    def _signals(self, ends: StepStates) -> Array:
        """(nt, n): elastic coordinates, motion of frames, largest acceleration."""
        rates = np.diff(ends.v, axis=0, prepend=ends.v[:1])
        lengths = np.diff(ends.t, prepend=-np.inf)
        rates /= np.where(lengths > 0.0, lengths, np.inf)[:, None]
        columns = [*np.abs(ends.z[:, self._elastic]).T]
        for linear, angular in self._frames:
            parts = ends.v[:, angular], rates[:, linear], rates[:, angular]
            columns += [np.linalg.norm(part, axis=1) for part in parts]
        return np.column_stack([*columns, np.abs(rates).max(axis=1, initial=0.0)])

    def states_until(self, end: float) -> Iterator[StepStates]:
        """All stored states up to a time [s], in the order of time, in blocks."""
        peaks = {id(part): part for part in self._peaks.values()}
        parts = [*self._parts, *peaks.values(), *self._named]
        ends = np.cumsum([len(part.t) for part in parts])
        times, places = np.unique(
            np.concatenate([part.t for part in parts]), return_index=True
        )
        places = places[times <= end]
        block = max(1, MAX_NUMBERS // parts[0].z.shape[1])
        for first in range(0, len(places), block):
            selected = np.sort(places[first : first + block])
            cuts = np.searchsorted(selected, ends)
            rows = np.split(selected, cuts[:-1])
            begins = ends - [len(part.t) for part in parts]
            blocks = zip(parts, rows, begins, strict=True)
            states = join_steps(
                [_select_states(part, k - begin) for part, k, begin in blocks]
            )
            yield _select_states(states, np.argsort(states.t, kind="stable"))


def _select_states(steps: StepStates, selection: slice | np.ndarray) -> StepStates:
    return StepStates(
        steps.t[selection].copy(), steps.z[selection].copy(), steps.v[selection].copy()
    )
