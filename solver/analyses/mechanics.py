"""The equations of an assembled scene, for analyses in dense linear algebra."""

from __future__ import annotations

import numpy as np

from formats.errors import InputError
from formats.result import Result
from formats.sid import Array

from .. import kernel_calls, outputs
from ..assembly import Start, dense_jacobian
from ..energy_history import history_between, is_wanted
from ..integrators import recording
from ..kernels import layout as at
from ..kernels.coordinates import retract
from ..kernels.pointers import kernels
from ..new_control import CLOSED
from ..run import versions
from ..scene import System
from ..sizes import row_sizes
from ..storage import new_memory, new_work
from ..turn_counts import keep_turns

#: Singular values of the scaled constraint Jacobian count as zero below this.
RANK_TOLERANCE = 1e-9


class Mechanics:
    """Forces, constraints and accelerations at any state of an assembled system.

    scale : (n,) size of each velocity coordinate in units of equal kinetic and elastic
        energy, so that what is small can be said of all of them
    """

    def __init__(self, system: System, t: float, clock: float) -> None:
        self.system, self.t = system, t
        self.work, self.memory = new_work(system), new_memory(system, 0)
        self.kernels = kernels(system.planar)
        self.work.clock[0] = clock
        self.scale = np.ones(system.n_velocities)

    def evaluate(self, z: Array, v: Array) -> None:
        kernel_calls.evaluate(self.system, self.work, self.t, z, v)

    def set_scale(self, z: Array) -> None:
        """Takes the scale from the masses and stiffnesses at a position."""
        self.evaluate(z, np.zeros(self.system.n_velocities))
        for row in self.system.arrays.body:
            n, o, u = row[at.NV], row[at.BLOCK], row[at.VEL]
            entries = self.work.M[o : o + n * n] + self.memory.metric[o : o + n * n]
            diagonal = np.diag(entries.reshape(n, n))
            self.scale[u : u + n] = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))

    @property
    def jacobian(self) -> Array:
        """(rows, n) at the state last evaluated, its columns scaled."""
        return dense_jacobian(self.system, self.work.C) * self.scale

    @property
    def residual(self) -> Array:
        return self.work.row[:, at.C_VALUE].copy()

    @property
    def opening(self) -> float:
        """How far the constraints are open, relative to their sizes."""
        sizes = row_sizes(self.system)
        return float(np.max(np.abs(self.residual) / sizes, initial=0.0))

    @property
    def rates(self) -> Array:
        return self.work.row[:, at.C_RATE].copy()

    @property
    def force(self) -> Array:
        """Scaled generalised forces (n,) at the state last evaluated."""
        return self.work.f * self.scale

    @property
    def weight(self) -> float:
        """Size of the scaled weights of all bodies."""
        gravity = float(np.linalg.norm(self.system.arrays.gravity))
        squares = 0.0
        for row, data in zip(self.system.arrays.body, self.system.bodies, strict=True):
            if row[at.RD] > 0:
                squares += (data.sid.mass * self.scale[row[at.VEL]]) ** 2
        return gravity * float(np.sqrt(squares))

    def turn_rates(self, state: Start) -> Array:
        """Rates of counted rotations (n_turns,) at a state, which is evaluated."""
        self.evaluate(state.z, state.v)
        return self.work.turn[: self.system.n_turns, at.TURN_RATE].copy()

    def moved(self, z: Array, x: Array) -> Array:
        """z moved by the scaled tangent vector x; frames and turns are those of z."""
        self.evaluate(z, np.zeros(self.system.n_velocities))
        result = z.copy()
        keep_turns(self.system, self.work, result)
        retract(self.system.arrays, self.work.frame.copy(), result, x * self.scale)
        return result

    def accelerations(self, z: Array, v: Array) -> tuple[Array, Array]:
        """z_II' (n,) and multipliers (rows,)."""
        arguments = (self.kernels, self.system.arrays, self.work, self.memory)
        recording.begin(*arguments, self.t, z, v)
        return self.memory.acceleration.copy(), self.memory.multiplier.copy()

    def closed(self, z: Array) -> Array:
        """z moved onto the constraints; where they cannot be met it stays open."""
        rest = np.zeros(self.system.n_velocities)
        for _ in range(20):
            self.evaluate(z, rest)
            if self.opening < 1e-14:
                break
            step = least_squares(self.jacobian, -self.residual)
            z = self.moved(z, step)
        return z


def least_squares(matrix: Array, right: Array) -> Array:
    """The smallest x with least |matrix x - right|; dependent rows are allowed."""
    solution = np.linalg.lstsq(matrix, right, rcond=RANK_TOLERANCE)[0]
    return np.asarray(solution, np.float64)


def null_space(matrix: Array) -> Array:
    """Orthonormal columns that a matrix maps to zero."""
    if len(matrix) == 0:
        return np.eye(matrix.shape[1])
    norms = np.linalg.norm(matrix, axis=1, keepdims=True)
    _, sizes, right = np.linalg.svd(matrix / np.where(norms > 0.0, norms, 1.0))
    rank = int(np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))))
    return right[rank:].T


def recorded(
    system: System, kind: str, times: Array, states: list[Start], message: str = ""
) -> Result:
    """The scene's outputs at some states, as a result.

    message : why later states are missing, if they are
    """
    z = np.array([s.z for s in states]).reshape(len(states), system.n_positions)
    v = np.array([s.v for s in states]).reshape(len(states), system.n_velocities)
    span = system.scene.time.end - system.scene.time.start
    closed = np.outer(row_sizes(system), [1.0, 1.0 / span]) * CLOSED[0]
    calls, history = kernels(system.planar), None
    if is_wanted(system.scene):
        history = history_between(system, calls, times, z, v, closed)
    found = outputs.record(
        system,
        calls,
        new_work(system),
        new_memory(system, 0),
        times,
        z,
        v,
        closed,
        history,
    )
    return Result(
        title=system.scene.title,
        names=found.names,
        t=times,
        values=found.values,
        positions=z,
        velocities=v,
        multipliers=found.multipliers,
        position_names=outputs.position_names(system),
        velocity_names=outputs.velocity_names(system),
        multiplier_names=outputs.multiplier_names(system),
        settings={"analysis": kind},
        scene=system.scene.model_dump_json(by_alias=True, exclude_none=True),
        versions=versions(),
        completed=not message,
        message=message,
    )


def refuse_prescribed(system: System) -> None:
    """Analyses need the forces of all joints.

    Raises
    ------
    InputError : joints were eliminated when the scene was compiled.
    """
    if system.eliminated:
        raise InputError(
            "was compiled without the constraints of its prescribed joints",
            expected="compile_scene(..., keep_joints=True)",
        )
