"""Derivatives of forces and constraints by the state, as central differences.

Forces with a corner or a jump at the state have no slope, and are named.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..system.characteristic_sizes import coordinate_sizes
from .dense_equations import DenseEquations
from .power_laws import LIMIT_TOLERANCE, POWER_LAW, ZERO_SLOPE, limits

#: Perturbation, relative to the size of the mechanism.
PERTURBATION = 1e-6
#: A force has a corner where its changes to both sides differ by more than this part of
#: their sum, and than rounding of all forces.
CORNER, CORNER_ROUNDING = 0.02, 1e-11
#: A force is curved within a step where they differ by more. Shorter steps are this
#: part of the one before, and so many.
CURVED, SHORTER_STEP, MAX_SHORTER_STEPS = 1e-5, 0.125, 5
#: The asymmetry of a corner falls as the step, that of a curve by less than this part
#: of it.
SMOOTH = 0.25
#: Changes of forces are known where they are larger than rounding by so much.
RESOLVED = 100.0


class Direction(NamedTuple):
    """A scaled coordinate of which the position or else the velocity changes."""

    coordinate: int
    is_position: bool


class _Differences(NamedTuple):
    """Derivatives by one direction, as differences over a step.

    Attributes
    ----------
    curvature
        How much forces are curved within the step.
    is_known
        Whether rounding leaves that known.
    columns
        Of the force, and of the constraints their values, rates and gamma.
    bend
        How much forces change alike to both sides, by the step.
    """

    curvature: float
    is_known: bool
    columns: list[Array]
    bend: Array

    @property
    def force(self) -> Array:
        return self.columns[0]

    @property
    def size(self) -> float:
        """Largest derivative of a force."""
        return float(np.abs(self.force).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class StateDerivatives:
    """By the n scaled coordinates: f + C^T lambda - M a (n, n), and of the constraints
    their values, rates and gamma - C a (rows, n)."""

    force: Array
    value: Array
    rate: Array
    gamma: Array


def state_derivatives(
    mechanics: DenseEquations, z: Array, v: Array, a: Array, multipliers: Array
) -> tuple[StateDerivatives, StateDerivatives, tuple[Direction, ...]]:
    """Central differences by positions and by velocities, at fixed a and lambda, and
    directions in which forces seem to have a corner.

    Forces that are curved within a step, such as those of a stiff contact that is
    pressed lightly, get shorter steps; a corner stays one, and keeps its step. Where
    both sides are curved alike, as friction that tanh rounds, the derivative changes
    with the step.
    """
    rows = len(multipliers)
    least = CORNER_ROUNDING * mechanics.force_size_in_motion(z, v)
    middle = mechanics.force.copy()

    def differences(direction: Direction, delta: float) -> _Differences:
        ends = []
        for step in (delta, -delta):
            mechanics.evaluate(*_neighbour(mechanics, z, v, direction, step))
            C, value = mechanics.jacobian, np.zeros(rows)
            value[: len(mechanics.residual)] = mechanics.residual
            left = mechanics.force + C.T @ multipliers - mechanics.mass @ a
            rates, gamma = mechanics.constraint_rates.copy(), mechanics.gamma - C @ a
            ends.append((left, value, rates, gamma, mechanics.force.copy()))
        columns = [(f - g) / (2.0 * delta) for f, g in zip(*ends, strict=True)]
        after, before = ends[0][-1], ends[1][-1]
        bend = after + before - 2.0 * middle
        change = float(np.abs(after - before).max(initial=0.0))
        asymmetry = float(np.abs(bend).max(initial=0.0))
        curvature = asymmetry / max(change, 1e-300) if asymmetry > least else 0.0
        is_known = change > RESOLVED * least
        return _Differences(curvature, is_known, columns[:-1], bend / (2.0 * delta))

    derivatives, corners = [], []
    for moves in (True, False):
        found = []
        for k, delta in enumerate(_perturbations(mechanics)):
            direction = Direction(k, moves)
            steps = [differences(direction, delta)]
            best = steps[0]
            is_odd = jumps = converges = False
            for _ in range(MAX_SHORTER_STEPS):
                delta *= SHORTER_STEP
                shorter = differences(direction, delta)
                if not shorter.is_known:
                    break
                change = np.abs(shorter.force - steps[-1].force).max(initial=0.0)
                size, last_size = shorter.size, steps[-1].size
                was_odd, is_odd = (
                    is_odd,
                    change > max(CURVED * size, RESOLVED * least / delta),
                )
                jumps = is_odd and size - last_size > SMOOTH * size
                if was_odd or is_odd:
                    best = shorter
                steps.append(shorter)
                converges = best.curvature <= CURVED and not is_odd
                if converges:
                    break
                best = min(best, shorter, key=itemgetter(0))
            if not converges and (limit := _with_limit(steps)) is not None:
                best, jumps = limit, False
            if best.curvature > CORNER or jumps:
                best = steps[0]
                corners.append(direction)
            found.append(best.columns)
        parts = [np.column_stack(part) for part in zip(*found, strict=True)]
        derivatives.append(StateDerivatives(*parts))
    return derivatives[0], derivatives[1], tuple(corners)


def _with_limit(steps: Sequence[_Differences]) -> _Differences | None:
    """The limit of differences that fall as a power of the step; None for others, and
    where a corner is left."""
    if len(steps) < POWER_LAW:
        return None
    force, error = limits([one.force for one in steps])
    bend, bend_error = limits([one.bend for one in steps])
    unknown = max(error.max(initial=0.0), (np.abs(bend) + bend_error).max(initial=0.0))
    size = max(np.abs(force).max(initial=0.0), ZERO_SLOPE * steps[0].size)
    if unknown > LIMIT_TOLERANCE * size:
        return None
    first = steps[0]  # constraints are smooth, and have less rounding there
    return first._replace(curvature=0.0, columns=[force, *first.columns[1:]])


def _perturbations(mechanics: DenseEquations) -> Array:
    """Steps (n,) of the scaled coordinates for differences."""
    return PERTURBATION * coordinate_sizes(mechanics.system) / mechanics.scale


def _neighbour(
    mechanics: DenseEquations, z: Array, v: Array, direction: Direction, step: float
) -> tuple[Array, Array]:
    """The state a step away in a direction."""
    change = np.zeros(len(v))
    change[direction.coordinate] = step
    if direction.is_position:
        return mechanics.displaced(z, change), v
    return z, v + change * mechanics.scale


def corner_notes(
    mechanics: DenseEquations, z: Array, v: Array, corners: Sequence[Direction]
) -> Iterator[Diagnostic]:
    """Forces with a corner or a jump at the state, where they have no slope (N745).

    Changes to both sides differ by a part of themselves at a corner, by a part that
    vanishes with the step where a force is smooth; across a jump a force changes by as
    much over a shorter step. A force of the scene is named where what it alone does has
    a corner or a jump.
    """
    if not corners:
        return
    deltas = _perturbations(mechanics)
    least = CORNER_ROUNDING * mechanics.force_size_in_motion(z, v)
    numbers = [k for k, one in enumerate(mechanics.system.forces) if one.is_force]

    def differences(direction: Direction, step: float, without: int | None) -> Array:
        """f(+h) - f(-h) and f(+h) + f(-h) - 2 f(0), (2, n)."""
        after, middle, before = (
            mechanics.force_at(*_neighbour(mechanics, z, v, direction, h), without)
            for h in (step, 0.0, -step)
        )
        return np.array([after - before, after + before - 2.0 * middle])

    names, found = set(), False
    for direction in corners:
        step = deltas[direction.coordinate]
        whole = differences(direction, step, None)
        short_step = SHORTER_STEP * step
        shorter = differences(direction, short_step, None)
        sizes, short_sizes = (np.abs(d).max(axis=1) for d in (whole, shorter))
        jumps = short_sizes[0] > max(SMOOTH * sizes[0], least)
        if not jumps and short_sizes[1] < SMOOTH * SHORTER_STEP * sizes[1]:
            continue
        found = True
        for k in numbers:
            alone = np.abs(whole - differences(direction, step, k)).max(axis=1)
            left = np.abs(shorter - differences(direction, short_step, k)).max(axis=1)
            has_jump = jumps and left[0] > max(SMOOTH * alone[0], least)
            if has_jump or alone[1] > max(CORNER * alone[0], least):
                names.add(mechanics.system.forces[k].name)
    mechanics.evaluate(z, v)
    if found:
        yield diagnose("N745", ", ".join(sorted(names)) or "forces")
