"""Derivatives of the outputs of a scene by its state and by its inputs.

Outputs are evaluated by the kernels that evaluate those of a run: accelerations and
multipliers of the displaced state are solved for, so that their derivatives hold all
terms. Differences are central and of fourth order.
"""

from collections.abc import Sequence

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import parse_output

from ..diagnostics.result_notes import OutputNotes
from ..output.columns import evaluate_outputs
from ..output.energies import INTEGRATED
from ..output.samples import StateSampler
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.system import System
from .dense_equations import DenseEquations

#: Largest displacement, in sizes of the mechanism or radians, and largest change of a
#: velocity, in those per second.
PERTURBATION = 1e-5
#: Change of an input, relative to its value or to 1.
INPUT_PERTURBATION = 1e-4
#: Points and weights of the difference, in perturbations.
POINTS = np.array([-2.0, -1.0, 1.0, 2.0])
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0


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
    InputError
        An output is an integral along a run.
    SimulationError
        An output is not a number at the state.
    """

    def __init__(self, mechanics: DenseEquations, z: Array, v: Array) -> None:
        self.mechanics, self.z, self.v = mechanics, z, v
        self.system: System = mechanics.system
        self.names = self.system.scene.outputs.record
        for text in self.names:
            name = parse_output(text)
            if name.owner == "energy" and name.quantity in INTEGRATED:
                raise InputError(
                    f"{text} is an integral along a run",
                    place="outputs",
                    expected="an output that follows from the state",
                )
        closed = np.full((self.system.n_rows, 2), np.inf)
        self._sampler = StateSampler(self.system, closed)
        self._sizes = coordinate_sizes(self.system) / mechanics.scale
        values = self._evaluate([z], [v])
        self.values = values[0]

    def _evaluate(self, z: Sequence[Array], v: Sequence[Array]) -> Array:
        times = np.full(len(z), self.mechanics.t)
        states = np.array(z), np.array(v)
        outputs = evaluate_outputs(self._sampler, times, *states)
        remarks = OutputNotes(self.system)
        remarks.add(times, outputs)
        for undefined in remarks.undefined_notes():
            raise SimulationError(undefined)
        return outputs.values

    def by_states(self, displacements: Array, velocities: Array) -> Array:
        """Derivatives (outputs, k) along scaled changes (n, k) of the state."""
        z, v, steps = [], [], []
        for x, change in zip(displacements.T, velocities.T, strict=True):
            step = self._step(x, change)
            steps.append(step)
            for point in POINTS * step:
                z.append(self.mechanics.displaced(self.z, point * x))
                v.append(self.v + point * change * self.mechanics.scale)
        if not steps:
            return np.zeros((len(self.names), 0))
        values = self._evaluate(z, v).reshape(len(steps), len(POINTS), -1)
        return np.einsum("kpo,p->ok", values, WEIGHTS) / np.array(steps)

    def by_input(self, coefficient: int, displacement: Array, velocity: Array) -> Array:
        """Derivatives (outputs,) by a number of the real data, with which the state
        changes by scaled vectors (n,)."""
        numbers = self.system.arrays.real_data
        value = float(numbers[coefficient])
        step = INPUT_PERTURBATION * max(abs(value), 1.0)
        largest = self._largest(displacement, velocity)
        if largest > 0.0:
            step = min(step, PERTURBATION / largest)
        total = np.zeros(len(self.names))
        try:
            for point, weight in zip(POINTS * step, WEIGHTS / step, strict=True):
                numbers[coefficient] = value + point
                z = self.mechanics.displaced(self.z, point * displacement)
                v = self.v + point * velocity * self.mechanics.scale
                total += weight * self._evaluate([z], [v])[0]
        finally:
            numbers[coefficient] = value
        return total

    def _step(self, x: Array, change: Array) -> float:
        return PERTURBATION / max(self._largest(x, change), 1e-300)

    def _largest(self, x: Array, change: Array) -> float:
        """Largest change in sizes of the mechanism, or in those per second."""
        both = np.abs(np.concatenate([x, change])) / np.tile(self._sizes, 2)
        return float(both.max(initial=0.0))
