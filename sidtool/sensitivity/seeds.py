"""Derivatives of functionals of a motion by its states: seeds of adjoint runs."""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import parse_output
from sidtool.formats.scene.outputs import is_stress
from sidtool.solver.simulation.frozen_run import Motion
from sidtool.solver.simulation.linearised_run import FOURTH_ORDER, SECOND_ORDER
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.system_arrays import IntTable

from .functionals import Functional
from .history import History, Peak

#: Coordinates that change an output by less than this part are not among its states.
NEGLIGIBLE = 1e-14
#: Differences of second order are taken where those of fourth order differ by less than
#: this part of the largest one.
AGREEMENT = 1e-9
#: States that are evaluated together.
STATES_AT_ONCE = 10_000
#: Number of times at which the coordinates are sought that an output depends on.
ASKED_TIMES = 7
#: Steps of elastic coordinates for stresses, which are curved near zero, as parts of
#: the largest deformation of the motion.
STRESS_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class LinearFunctional:
    """A functional about a motion, as a sum of its output with weights.

    Attributes
    ----------
    times : of the output [s], None for those of all points of the steps
    """

    output: str
    times: Array | None
    weights: Array

    def value(self, motion: Motion) -> float:
        """The sum for a motion with the same times."""
        if self.times is None:
            values = History(motion).values(self.output)
        else:
            values = motion.output_at(self.output, self.times)
        return float(self.weights @ values)


def linear_functional(
    functional: Functional, history: History, peak: Peak | None
) -> LinearFunctional | None:
    """The linear functional with the same derivative, None if there is none."""
    if functional.kind == "end_time" or not functional.is_scalar:
        return None
    times, weights = functional.weights(history, peak)
    return LinearFunctional(functional.output, times, weights)


def functional_seeds(
    functional: LinearFunctional | None, history: History, steps: Array, nz: int
) -> Array:
    """Derivatives of a functional by the states at all points, (nt, nz + nv).

    Parameters
    ----------
    functional : None for one that does not depend on states
    steps : (nz + nv,) of differences by the positions, without counted rotations, and
        by the velocities
    """
    states, points = history.motion.steps, history.points
    seeds = np.zeros((len(states.t), len(steps)))
    if functional is None:
        return seeds
    steps = _steps_for(functional.output, history.motion, steps)
    times, weights = functional.times, functional.weights
    if times is None:
        own, difference = _columns(functional.output, history, steps, nz)
        parts, name = (states.t, states.z, states.v), functional.output
        found = _output_derivatives(name, history, parts, steps, own, nz, difference)
        seeds[:, own] = weights[:, None] * found
        return seeds
    times = np.clip(times, states.t[0], states.t[-1])
    rows = [points.interpolation(states.t, t) for t in times]
    z = np.array([w @ states.z[part] for part, w in rows])
    v = np.array([w @ states.v[part] for part, w in rows])
    columns = np.arange(len(steps))
    parts = times, z, v
    found = _output_derivatives(functional.output, history, parts, steps, columns, nz)
    for (part, share), weight, row in zip(rows, weights, found, strict=True):
        seeds[part] += weight * np.outer(share, row)
    return seeds


def _steps_for(output: str, motion: Motion, steps: Array) -> Array:
    """Steps of differences for an output: shorter for stresses of small deformations,
    of whose size the coordinates of a body are together."""
    name = parse_output(output)
    if not is_stress(name.quantity):
        return steps
    row = motion.system.arrays.body[motion.system.index(name.owner)]
    end = row[at.POS] + row[at.NP]
    elastic = slice(end - row[at.NQ], end)
    sizes = np.abs(motion.steps.z[:, elastic]) / steps[elastic]
    shorter = min(1.0, STRESS_STEP * float(sizes.max(initial=0.0)))
    changed = steps.copy()
    if shorter > 0.0:
        changed[elastic] *= shorter
    return changed


def _columns(
    output: str, history: History, steps: Array, nz: int
) -> tuple[IntTable, tuple[Array, Array]]:
    """Coordinates that an output depends on, and the difference that resolves it: of
    second order if one of fourth order agrees.
    """
    states = history.motion.steps
    rows = np.unique(np.linspace(0, len(states.t) - 1, ASKED_TIMES).astype(int))
    parts = output, history, (states.t[rows], states.z[rows], states.v[rows])
    given = *parts, steps, np.arange(len(steps)), nz
    found, other = (
        _output_derivatives(*given, difference) * steps
        for difference in (FOURTH_ORDER, SECOND_ORDER)
    )
    changes = np.abs(found).max(axis=0)
    largest = changes.max(initial=0.0)
    agrees = np.abs(found - other).max(initial=0.0) <= AGREEMENT * largest
    columns = np.flatnonzero(changes > NEGLIGIBLE * largest)
    return columns, SECOND_ORDER if agrees else FOURTH_ORDER


def _output_derivatives(
    output: str,
    history: History,
    states: tuple[Array, Array, Array],
    steps: Array,
    columns: IntTable,
    nz: int,
    difference: tuple[Array, Array] = FOURTH_ORDER,
) -> Array:
    """Derivatives of an output by some coordinates at states, (nt, columns)."""
    (t, z, v), (points, weights) = states, difference
    n, width = len(t), max(1, STATES_AT_ONCE // (len(points) * len(t)))
    found = [np.zeros((n, 0))]
    for first in range(0, len(columns), width):
        group = columns[first : first + width]
        changes = np.zeros((len(group), len(points), 1, len(steps)))
        for index, k in enumerate(group):
            changes[index, :, 0, k] = np.multiply(points, steps[k])
        shape = len(group) * len(points) * n, -1
        moved_z = np.tile(z, (len(group), len(points), 1, 1))
        moved_z[..., :nz] += changes[..., :nz]
        moved_v = v + changes[..., nz:]
        times = np.tile(t, len(group) * len(points))
        parts = moved_z.reshape(shape), moved_v.reshape(shape)
        values = history.motion.output(output, times, *parts)
        values = values.reshape(len(group), len(points), n)
        # In pairs: what an output does not depend on is exactly 0.
        pairs = 0.5 * (values - values[:, ::-1])
        found.append(np.einsum("cpt,p->tc", pairs, weights) / steps[group])
    return np.concatenate(found, axis=1)
