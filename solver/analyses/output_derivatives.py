"""Derivatives of the outputs of a scene by its state and by its inputs.

Outputs are evaluated by the functions that evaluate those of a run, along changes of
positions, velocities, accelerations and multipliers that belong together. So outputs of
accelerations agree with the state matrix to rounding: at low frequencies they are small
differences of large terms. Differences are central and of fourth order. They are
sums of changes from the values at the state, so that an output that does not change has
a derivative of exactly zero. Outputs that
are curved within a step (von Mises stress by a high mode, a stiff contact that is
pressed lightly) get the shorter step at which they agree best with the next one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.sid import Array

from ..diagnostics.result_notes import OutputNotes
from ..output.columns import evaluate_outputs
from ..output.samples import StateSampler, sample_known_motion
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.system import System
from .dense_equations import DenseEquations
from .power_laws import power_law_limit
from .state_matrix import LinearEquations, Responses

#: Largest displacement, in sizes of the mechanism or radians, and largest change of a
#: velocity, in those per second.
PERTURBATION = 1e-5
#: Factor between steps that are compared, and how many are.
REFINEMENT, MAX_REFINEMENTS = 16.0, 5
#: Differences agree within this part of the largest change of their output.
AGREEMENT = 1e-8
#: Points and weights of the difference, in perturbations.
POINTS = np.array([-2.0, -1.0, 1.0, 2.0])
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0


class _State(NamedTuple):
    """z_I, z_II, z_II' and multipliers."""

    z: Array
    v: Array
    a: Array
    multipliers: Array


class OutputEvaluation:
    """Outputs of a scene near a state.

    Attributes
    ----------
    values : (outputs,)
        At the state.
    names
        Of the outputs.

    Raises
    ------
    SimulationError
        An output is not a number at the state.
    """

    def __init__(self, equations: LinearEquations, mechanics: DenseEquations) -> None:
        self.mechanics, self.equations = mechanics, equations
        self.z, self.v = equations.z, equations.v
        self.system: System = mechanics.system
        self.names = self.system.scene.outputs.record
        closed = np.full((self.system.n_rows, 2), np.inf)
        self._sampler = StateSampler(self.system, closed)
        self._sizes = coordinate_sizes(self.system) / mechanics.scale
        self.values = self._evaluate([self._at(0.0, None, 0)])[0]

    def _at(self, size: float, changes: Responses | None, k: int) -> _State:
        """The state with a multiple of some changes."""
        equations, scale = self.equations, self.mechanics.scale
        if changes is None or size == 0.0:
            motion = equations.accelerations * scale, equations.multipliers
            return _State(self.z, self.v, *motion)
        return _State(
            self.mechanics.displaced(self.z, size * changes.displacements[:, k]),
            self.v + size * changes.velocities[:, k] * scale,
            (equations.accelerations + size * changes.accelerations[:, k]) * scale,
            equations.multipliers + size * changes.multipliers[:, k],
        )

    def _evaluate(self, states: Sequence[_State], is_known: bool = True) -> Array:
        """Outputs (states, outputs).

        Parameters
        ----------
        is_known
            Accelerations and multipliers of the states are; else, and where joints
            have friction, they are solved for.
        """
        system, times = self.system, np.full(len(states), self.mechanics.t)
        z, v, a, multipliers = (np.array(part) for part in zip(*states, strict=True))
        samples = None
        if is_known and not system.friction_joints:
            samples = sample_known_motion(
                *(system, self._sampler.work, times, z, v, a, multipliers),
                np.zeros((len(states), 0)),
            )
        outputs = evaluate_outputs(self._sampler, times, z, v, samples=samples)
        remarks = OutputNotes(system)
        remarks.add(times, outputs)
        for undefined in remarks.undefined_notes():
            raise SimulationError(undefined)
        return outputs.values

    def by_states(self, changes: Responses) -> Array:
        """Derivatives (outputs, k) by changes of the state, with what follows."""
        return self._by_states(changes, True)

    def by_coordinates(self, displacements: Array, velocities: Array) -> Array:
        """Derivatives (outputs, k) by any scaled changes (n, k) of positions and
        velocities; accelerations and multipliers are solved for."""
        n, k = displacements.shape
        none, rows = np.zeros((n, k)), np.zeros((len(self.equations.multipliers), k))
        unused = np.zeros((0, k))
        changes = Responses(unused, unused, displacements, velocities, none, rows)
        return self._by_states(changes, False)

    def _by_states(self, changes: Responses, is_known: bool) -> Array:
        count = changes.displacements.shape[1]
        if not count:
            return np.zeros((len(self.names), 0))
        largest = [self._largest(changes, k) for k in range(count)]
        steps = PERTURBATION / np.maximum(largest, 1e-300)
        best = coarse = self._differences(changes, steps, is_known)
        sizes = np.abs(coarse * steps).max(axis=1, keepdims=True)
        tolerance, error = AGREEMENT * sizes / steps, np.full(coarse.shape, np.inf)
        found = [coarse]
        for k in range(1, MAX_REFINEMENTS + 1):
            fine = self._differences(changes, steps / REFINEMENT**k, is_known)
            change = np.abs(fine - coarse)
            better = (change < error) & (error > tolerance)
            best = np.where(better, coarse, best)
            error = np.where(better, change, error)
            found.append(fine)
            if (error <= tolerance).all():
                return best
            coarse = fine
        return np.where(error <= tolerance, best, power_law_limit(found, best))

    def _differences(self, changes: Responses, steps: Array, is_known: bool) -> Array:
        """Differences (outputs, k) over steps (k,) of the changes."""
        states = [
            self._at(point * step, changes, k)
            for k, step in enumerate(steps)
            for point in POINTS
        ]
        values = self._evaluate(states, is_known) - self.values
        values = values.reshape(len(steps), len(POINTS), -1)
        return np.einsum("kpo,p->ok", values, WEIGHTS) / steps

    def by_input(
        self,
        coefficient: int,
        factor: float,
        changes: Responses,
        k: int,
        steps: Sequence[float],
    ) -> Array:
        """Derivatives (outputs,) by an input, which changes a number of the real data
        by a factor, and the state as column k of some changes, at most half a step
        away. Several steps are those of a power law."""
        numbers = self.system.arrays.real_data
        value = float(numbers[coefficient])
        largest = self._largest(changes, k)
        shorter = 0.25  # the points are farther away, and fourth order needs less
        if largest > 0.0:
            shorter = min(shorter, PERTURBATION / largest / steps[0])
        found = []
        try:
            for step in shorter * np.array(steps):
                found.append(np.zeros(len(self.names)))
                for point, weight in zip(POINTS * step, WEIGHTS / step, strict=True):
                    numbers[coefficient] = value + factor * point
                    state = self._at(point, changes, k)
                    found[-1] += weight * (self._evaluate([state])[0] - self.values)
        finally:
            numbers[coefficient] = value
        return power_law_limit(found, found[-1])

    def _largest(self, changes: Responses, k: int) -> float:
        """Largest change in sizes of the mechanism, or in those per second."""
        parts = changes.displacements[:, k], changes.velocities[:, k]
        both = np.abs(np.concatenate(parts)) / np.tile(self._sizes, 2)
        return float(both.max(initial=0.0))
