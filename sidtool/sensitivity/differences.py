"""Central differences of fourth order with an estimate of their own error.

With D(e) = (J(x + e) - J(x - e)) / 2 e the derivative is (4 D(e) - D(2 e)) / 3. Its
difference to D(e), relative to it, is r = O(e^2), and its truncation error is O(e^4):
10 r^2 is the estimate, or r if that is less. The five values of J determine its second
difference twice; what both differ by is of fourth order, or rounding. Rounding is
measured apart, by second differences over tiny distances. Steps that balance both parts
are tried until all derivatives are known well. Where a trial differs from one with a
smaller step by more than that one estimates, its error is the difference.

Reference
---------
P. E. Gill, W. Murray, M. A. Saunders, M. H. Wright: Computing forward-difference
intervals for numerical optimization. SIAM J. Sci. Stat. Comput. 4 (1983).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver.simulation.frozen_run import StructureChange
from sidtool.solver.system.errors import SimulationError

#: First step of a difference, relative to the variable, and where steps end.
FIRST_STEP, LEAST_STEP, LARGEST_STEP = 1e-3, 1e-7, 3e-2
#: Error of a derivative, relative to its size, that is small enough.
GOOD_ERROR = 1e-8
#: Times that the step is changed at most.
MAX_CHANGES = 4
#: A step is changed by this factor at most, and not by less than the other.
LARGEST_FACTOR, LEAST_FACTOR = 100.0, 2.5
#: Factor of the squared difference of second and fourth order in the error estimate.
SAFETY = 10.0
#: Distance over which J is linear, relative to the variable: what is not is rounding.
TINY_STEP = 1e-9
#: Multiples of the step at which J is evaluated: on both sides, or on one.
CENTRAL, FORWARD = (1, -1, 2, -2), (1, 2, 4)

#: Values of J at some values of the variable, one after the other.
Evaluate = Callable[[Sequence[float]], list[Array]]


@dataclass(frozen=True, eq=False)
class Difference:
    """A derivative of some functionals by one variable.

    Attributes
    ----------
    derivatives, errors : (n,)
        With the estimate of their errors.
    runs : evaluations of J
    step : of the difference that most derivatives come from [unit of the variable]
    method : adjoint, direct or differences
    """

    derivatives: Array
    errors: Array
    runs: int
    step: float
    method: str = "differences"


@dataclass(frozen=True, eq=False)
class _Trial:
    """Differences with one step; `best_steps` balance both parts of the errors."""

    derivatives: Array
    errors: Array
    best_steps: Array
    step: float
    runs: int


def differentiate(
    evaluate: Evaluate,
    x: float,
    size: float,
    values: Array,
    least: Array,
    noise: Array,
    step: float = 0.0,
    good: float = GOOD_ERROR,
) -> Difference:
    """Differentiate functionals by one variable.

    Parameters
    ----------
    evaluate : functionals at values of the variable
    x, size : value and size of the variable
    values : functionals at x, (n,)
    least : derivatives that are as good as none, (n,)
    noise : rounding of the functionals, (n,)
    step : of an earlier difference, which is taken as it is; 0 to choose one
    good : error of a derivative, relative to its size, that is small enough

    Raises
    ------
    StructureChange : neighbours as near as rounding allows have other events.
    InputError, SimulationError : the scene has no neighbours.
    """
    trials: list[_Trial] = []
    runs, attempts = 0, 1 if step > 0.0 else 1 + MAX_CHANGES
    next_step = step or FIRST_STEP * size
    tried: list[float] = []
    while next_step > 0.0 and len(tried) < attempts:
        tried.append(next_step)
        try:
            trials.append(_trial(evaluate, x, next_step, values, noise))
        except (StructureChange, SimulationError, InputError):
            runs += len(CENTRAL)
            if next_step <= LEAST_STEP * size and not trials:
                raise
            next_step = max(next_step / LARGEST_FACTOR, LEAST_STEP * size)
            if next_step in tried:
                break
            continue
        runs += trials[-1].runs
        next_step = _next_step(trials, tried, size, least, good)
    if not trials:
        return differentiate(evaluate, x, size, values, least, noise, good=good)
    derivatives, errors, chosen = _best(trials)
    steps = np.array([trial.step for trial in trials])[chosen]
    kinds, counts = np.unique(steps, return_counts=True)
    return Difference(derivatives, errors, runs, float(kinds[np.argmax(counts)]))


def _best(trials: Sequence[_Trial]) -> tuple[Array, Array, NDArray[np.intp]]:
    """Derivatives with the least errors, these errors, the numbers of their trials."""
    steps = np.array([trial.step for trial in trials])
    own = np.array([trial.errors for trial in trials])
    derivatives = np.array([trial.derivatives for trial in trials])
    errors = own.copy()
    for k, step in enumerate(steps):
        for smaller in np.flatnonzero(steps < step):
            difference = np.abs(derivatives[k] - derivatives[smaller])
            errors[k] = np.maximum(errors[k], difference - own[smaller])
    chosen = np.argmin(errors, axis=0)
    columns = np.arange(errors.shape[1])
    return derivatives[chosen, columns], errors[chosen, columns], chosen


def _next_step(
    trials: Sequence[_Trial],
    tried: Sequence[float],
    size: float,
    least: Array,
    good: float,
) -> float:
    """The step that the worst derivative asks for and that was not tried, or 0."""
    derivatives, errors, chosen = _best(trials)
    relative = errors / np.maximum(np.abs(derivatives), least)
    for k in np.argsort(-relative):
        if relative[k] <= good:
            break
        for trial in (trials[chosen[k]], *sorted(trials, key=lambda t: t.step)):
            step = trial.best_steps[k]
            step = float(np.clip(step, LEAST_STEP * size, LARGEST_STEP * size))
            if all(max(step / s, s / step) >= LEAST_FACTOR for s in tried):
                return step
    return 0.0


def rounding_of(evaluate: Evaluate, x: float, size: float, values: Array) -> Array:
    """Rounding of functionals, from second differences over tiny distances, (n,).

    Parameters
    ----------
    evaluate, x, size, values : as of `differentiate`
    """
    plus, minus, plus2, minus2 = evaluate([x + k * TINY_STEP * size for k in CENTRAL])
    near, far = plus - 2.0 * values + minus, plus2 - 2.0 * values + minus2
    odd = (plus2 - minus2) - 2.0 * (plus - minus)
    found = np.abs([near, far, far - near, odd]).max(axis=0)
    return np.asarray(found / 2.0)


def _trial(
    evaluate: Evaluate, x: float, step: float, values: Array, noise: Array
) -> _Trial:
    """A difference with one step, on one side where the other does not exist."""
    try:
        return _central(evaluate, x, step, values, noise)
    except InputError:
        try:
            return _one_sided(evaluate, x, step, values, noise)
        except InputError:
            return _one_sided(evaluate, x, -step, values, noise)


def _central(
    evaluate: Evaluate, x: float, step: float, values: Array, noise: Array
) -> _Trial:
    plus, minus, plus2, minus2 = evaluate([x + k * step for k in CENTRAL])
    near, far = (plus - minus) / (2 * step), (plus2 - minus2) / (4 * step)
    second = (plus - values) - (values - minus), (plus2 - values) - (values - minus2)
    even = np.abs(second[1] - 4.0 * second[0]) / (8.0 * step)
    noise = np.maximum(noise, _representation(values, plus))
    return _extrapolated(near, far, even, noise, step, len(CENTRAL))


def _one_sided(
    evaluate: Evaluate, x: float, step: float, values: Array, noise: Array
) -> _Trial:
    one, two, four = evaluate([x + k * step for k in FORWARD])
    near = (4.0 * one - 3.0 * values - two) / (2.0 * step)
    far = (4.0 * two - 3.0 * values - four) / (4.0 * step)
    noise = np.maximum(noise, _representation(values, one))
    return _extrapolated(near, far, 0.0 * near, noise, abs(step), len(FORWARD))


def _representation(values: Array, other: Array) -> Array:
    """Rounding of numbers, where they change."""
    size = np.maximum(np.abs(values), np.abs(other))
    return np.where(values == other, 0.0, 4.0 * np.finfo(float).eps * size)


def _extrapolated(
    near: Array, far: Array, even: Array, noise: Array, step: float, runs: int
) -> _Trial:
    """The difference with its error.

    Parameters
    ----------
    near, far : differences over one and two steps
    even : what second differences differ by, over the step
    noise : rounding of the functionals
    """
    derivatives = (4.0 * near - far) / 3.0
    change, rounding = np.abs(derivatives - near), 1.5 * noise / step
    tiny = np.finfo(float).tiny
    size = np.maximum(np.abs(derivatives), tiny)
    odd = change * np.minimum(1.0, SAFETY * change / size)
    truncation = odd + np.maximum(0.0, even - rounding)
    factor = (np.maximum(rounding, tiny) / np.maximum(truncation, tiny)) ** 0.25
    factor = np.clip(factor, 1.0 / LARGEST_FACTOR, LARGEST_FACTOR)
    return _Trial(derivatives, truncation + rounding, factor * step, step, runs)
