"""The equations of a scene for solvers of ordinary differential equations.

z_I' = Z z_II and z_II' from the index-1 equations, on sidtool's own kernels; outputs
are evaluated after projection onto the constraints. Called from Python, the kernels
spend most of their time on their arguments: `cost` is the time of a call.
"""

from __future__ import annotations

import time

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import output_times
from sidtool.solver.dynamics.equations_of_motion import kernel_pointers
from sidtool.solver.initial_state import assembly
from sidtool.solver.linear.accelerations import solve_accelerations
from sidtool.solver.output import columns
from sidtool.solver.output.samples import StateSampler
from sidtool.solver.spatial.coordinates import rate
from sidtool.solver.system.characteristic_sizes import constraint_sizes
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import evaluate, new_memory, new_work_arrays


class Equations:
    """Right-hand side f(t, y) of an assembled scene, y = (z_I, z_II).

    Attributes
    ----------
    start : (n,) consistent initial state
    times : output times [s]
    """

    def __init__(self, system: System) -> None:
        self.system, begin = assembly.assemble(system)
        self.work, self.memory = (
            new_work_arrays(self.system),
            new_memory(self.system, 0),
        )
        self.kernels = kernel_pointers(self.system.planar)
        self.start: Array = np.concatenate([begin.z, begin.v])
        self.times = output_times(system.scene)
        duration = system.scene.time.end - system.scene.time.start
        self._closed = np.outer(
            constraint_sizes(self.system), [1e-11, 1e-11 / duration]
        )
        self._edges = np.array([system.scene.time.start, *self.system.breaks])
        self._n = self.system.n_positions

    def intervals(self) -> list[tuple[float, float]]:
        """Begin and end of the smooth pieces of the motion."""
        return list(zip(self._edges[:-1], self._edges[1:], strict=True))

    def enter(self, begin: float, end: float) -> None:
        """Evaluates drives as in the smooth piece from begin to end."""
        self.work.interval_time[0] = 0.5 * (begin + end)

    def __call__(self, t: float, y: Array) -> Array:
        """y', (n,), a new array."""
        slope = np.empty_like(self.start)
        z, v = y[: self._n].copy(), y[self._n :].copy()
        evaluate(self.system, self.work, t, z, v)
        solve_accelerations(self.system.arrays, self.work, self.memory)
        rate(self.system.arrays, z, v, slope[: self._n])
        slope[self._n :] = self.memory.acceleration
        return slope

    def jacobian(self, t: float, y: Array, scale: Array) -> Array:
        """df/dy, (n, n), by forward differences.

        scipy's own widen their step without bound for entries without influence.
        """
        here = self(t, y)
        columns = []
        for i, size in enumerate(np.maximum(np.abs(y), scale)):
            moved = y.copy()
            moved[i] += 1.5e-8 * size
            columns.append((self(t, moved) - here) / (moved[i] - y[i]))
        return np.column_stack(columns)

    def cost(self, calls: int = 200) -> float:
        """Time of one call [s], the least of five tries."""
        self.enter(*self.intervals()[0])
        seconds = []
        for _ in range(5):
            began = time.perf_counter()
            for _ in range(calls):
                self(float(self._edges[0]), self.start)
            seconds.append(time.perf_counter() - began)
        return min(seconds) / calls

    def values(self, states: Array) -> dict[str, Array]:
        """The outputs of the scene at states (nt, n) of the output times."""
        recorded = columns.evaluate_outputs(
            StateSampler(self.system, self._closed),
            self.times,
            np.ascontiguousarray(states[:, : self._n]),
            np.ascontiguousarray(states[:, self._n :]),
        )
        return dict(zip(recorded.names, recorded.values.T, strict=True))


def sizes(result: Result) -> Array:
    """(n,) greatest magnitude of every entry of y in a known motion."""
    states = np.hstack([result.positions, result.velocities])
    found = np.abs(states).max(axis=0)
    return np.where(found > 1e-12 * found.max(), found, found.max())
