"""The equations of motion of an assembled scene with dense matrices."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..diagnostics.failure_causes import dependent_row_names, lost_inertia_cause
from ..dynamics.control_laws import FAILED_LAW
from ..initial_state.assembly import StateVectors, dense_jacobian, row_names
from ..initial_state.constraint_jacobian import friction_directions, normalised_rows
from ..initial_state.given_state import store_rotations
from ..spatial import system_arrays as at
from ..spatial.coordinates import retract
from ..system import work_arrays
from ..system.characteristic_sizes import constraint_sizes
from ..system.control_laws import law_failure
from ..system.errors import SimulationError
from ..system.sid_packing import symmetrise
from ..system.system import System
from ..system.work_arrays import new_memory, new_work_arrays

#: Least eigenvalue of an inertia with ones on its diagonal that is no rounding.
MIN_INERTIA = 1e-13
#: Demands of constraints are met when so little of them is left.
DEMAND_TOLERANCE = 1e-7
#: Singular values of the scaled constraint Jacobian count as zero below this.
RANK_TOLERANCE = 1e-9


class DenseEquations:
    """Forces, constraints and accelerations at any state of an assembled system.

    Attributes
    ----------
    scale : (n,)
        Size of each velocity coordinate in units of equal kinetic and elastic energy,
        so that what is small can be said of all of them.
    """

    def __init__(self, system: System, t: float, clock: float) -> None:
        self.system, self.t = system, t
        self.work, self.memory = new_work_arrays(system), new_memory(system, 0)
        self.work.interval_time[0] = clock
        self.scale = np.ones(system.n_velocities)

    def evaluate(self, z: Array, v: Array) -> None:
        """Raises SimulationError where a law or a force gives no finite number."""
        self.work.law_failure[FAILED_LAW] = 0.0
        work_arrays.evaluate(self.system, self.work, self.t, z, v)
        invalid = law_failure(self.system, self.work, self.t)
        if invalid:
            raise SimulationError(invalid)
        self.refuse_infinite(self.work.f)

    def refuse_infinite(self, values: Array) -> None:
        """Raises SimulationError (N301) that names the body of the first row of
        values (n, ...) that is not finite."""
        rows = np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if rows.all():
            return
        first = int(rows.argmin())
        index = int(np.searchsorted(self.system.arrays.body[:, at.VEL], first, "right"))
        fastest = self.system.bodies[index - 1].name
        raise SimulationError(diagnose("N301", t=self.t, fastest=fastest))

    def set_scale(self, z: Array, stiffness: float = 1.0) -> None:
        """Takes the scale from the masses and stiffnesses at a position.

        Parameters
        ----------
        stiffness
            Weight of the elastic energy, 0 to leave it out.
        """
        self.evaluate(z, np.zeros(self.system.n_velocities))
        metric = stiffness * self.memory.metric
        for row in self.system.arrays.body:
            n, o, u = row[at.NV], row[at.BLOCK], row[at.VEL]
            entries = self.work.M[o : o + n * n] + metric[o : o + n * n]
            diagonal = np.diag(entries.reshape(n, n))
            self.scale[u : u + n] = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))

    @property
    def jacobian(self) -> Array:
        """(rows, n) at the state last evaluated, its columns scaled."""
        return dense_jacobian(self.system, self.work.C) * self.scale

    @property
    def directions(self) -> Array:
        """(frictions, n) of the coordinates with friction, their columns scaled."""
        return friction_directions(self.system, self.work.C) * self.scale

    @property
    def constraint_sizes(self) -> Array:
        """(rows,) of the constraints, see `constraint_sizes`."""
        return constraint_sizes(self.system)

    @property
    def residual(self) -> Array:
        return self.work.row[:, at.C_VALUE].copy()

    @property
    def scaled_residual(self) -> float:
        """How far the constraints are open, relative to their sizes."""
        sizes = self.constraint_sizes
        return float(np.max(np.abs(self.residual) / sizes, initial=0.0))

    @property
    def constraint_rates(self) -> Array:
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

    def force_size(self, z: Array) -> float:
        """Size of the single scaled forces at rest at a position, whatever their sum.

        The sum is what is left of them in equilibrium: rounding, if nothing but springs
        and loads acts. The state is evaluated.
        """
        zero = np.zeros(self.system.n_velocities)
        total = self.force_at(z, zero)
        sizes = [self.weight, float(np.linalg.norm(total)), *self._elastic_sizes(z)]
        for k, element in enumerate(self.system.forces):
            if element.is_force:
                others = self.force_at(z, zero, without=k)
                sizes.append(float(np.linalg.norm(total - others)))
        self.evaluate(z, zero)
        return float(np.linalg.norm(sizes))

    def force_size_in_motion(self, z: Array, v: Array) -> float:
        """The same at a state: gyroscopic and centrifugal forces are zero at rest. The
        state is evaluated.
        """
        size = self.force_size(z)
        return max(size, float(np.linalg.norm(self.force_at(z, v))))

    def force_at(self, z: Array, v: Array, without: int | None = None) -> Array:
        """Scaled generalised forces (n,) at a state, which is evaluated; those without
        a force of the scene by its number leave out what else it does."""
        if without is None:
            self.evaluate(z, v)
        else:
            table = self.system.arrays.force.copy()
            table[without, at.F_KIND] = at.PRESCRIBED_VALUE  # no force
            arrays = self.system.arrays.replaced(force=table)
            others = replace(self.system, arrays=arrays)
            work_arrays.evaluate(others, self.work, self.t, z, v)
        return self.force

    def _elastic_sizes(self, z: Array) -> Iterator[float]:
        """Size of the scaled elastic forces Ke q of each body."""
        for row, body in zip(self.system.arrays.body, self.system.bodies, strict=True):
            if row[at.NQ]:
                end = row[at.POS] + row[at.NP]
                scale = self.scale[row[at.VEL] + row[at.RD] : row[at.VEL] + row[at.NV]]
                elastic = symmetrise(body.sid.Ke.m0) @ z[end - row[at.NQ] : end]
                yield float(np.linalg.norm(scale * elastic))

    def rotation_rates(self, state: StateVectors) -> Array:
        """Rates of counted rotations (n_turns,) at a state, which is evaluated."""
        self.evaluate(state.z, state.v)
        return self.work.rotation_counter[
            : self.system.n_rotation_counters, at.ROTATION_RATE
        ].copy()

    def displaced(self, z: Array, x: Array) -> Array:
        """z moved by the scaled tangent vector x; frames and turns are those of z."""
        self.evaluate(z, np.zeros(self.system.n_velocities))
        result = z.copy()
        store_rotations(self.system, self.work, result)
        retract(self.system.arrays, self.work.frame.copy(), result, x * self.scale)
        return result

    @property
    def mass(self) -> Array:
        """M of all bodies (n, n), scaled, at the state evaluated last."""
        n = self.system.n_velocities
        M = np.zeros((n, n))
        for row in self.system.arrays.body:
            k, o, u = row[at.NV], row[at.BLOCK], row[at.VEL]
            block = self.work.M[o : o + k * k].reshape(k, k)
            M[u : u + k, u : u + k] = block
        return M * np.outer(self.scale, self.scale)

    @property
    def gamma(self) -> Array:
        """What constraints demand of accelerations, C z_II' = gamma, (rows,)."""
        return self.work.row[:, at.C_GAMMA].copy()

    def multipliers(self, unbalanced: Array, columns: Array | None = None) -> Array:
        """The smallest lambda (rows,) with C^T lambda = unbalanced, see
        `minimum_norm_multipliers`.

        Parameters
        ----------
        columns
            True for the coordinates along which that is asked, default all.
        """
        sizes = self.constraint_sizes
        C = self.jacobian if columns is None else self.jacobian[:, columns]
        return least_squares((C / sizes[:, None]).T, unbalanced) / sizes

    def accelerations(self) -> tuple[Array, Array]:
        """Scaled z_II' (n,) and multipliers (rows,) at the state evaluated last.

        Along the free directions of the constraints only: a mass matrix that is not
        positive in a direction that they hold does not matter.

        Raises
        ------
        SimulationError
            The constraints demand accelerations that do not exist, or the inertia is
            not positive along what can move.
        """
        C, M, f = self.jacobian, self.mass, self.force
        a = self.solve_demanded(C, self.gamma, 2)
        N = null_space(C)
        a += N @ self.solve_inertia(N.T @ M @ N, N.T @ (f - M @ a))
        return a, self.multipliers(M @ a - f)

    def refuse_singular(self) -> None:
        """Raises a state, evaluated last, whose constraints lose their independence.

        Raises
        ------
        SimulationError
            More of them depend on others than at the start.
        """
        n, n_independent = self.system.n_velocities, self.system.n_rows
        n_independent -= len(self.system.redundant)
        C = dense_jacobian(self.system, self.work.C) * self.scale
        if n - null_space(C).shape[1] < n_independent:
            joints = dependent_row_names(self.system, normalised_rows(C))
            remedy = "Start beside it: the mechanism could move on in several ways."
            raise SimulationError(
                diagnose("N310", t=self.t, joints=joints, remedy=remedy)
            )

    def test_directions(self, motion: Array) -> Array:
        """Directions (n, d) along which multipliers do not count; motion : (n, d) free
        directions of the constraints."""
        return motion

    def notes(self) -> tuple[Diagnostic, ...]:
        """What has to be known of the equations."""
        return ()

    def solve_inertia(self, inertia: Array, right: Array) -> Array:
        """Solves with the inertia (d, d) along what can move.

        Raises
        ------
        SimulationError
            It is not positive; names the body.
        """
        size = np.sqrt(np.maximum(np.abs(inertia.diagonal()), np.finfo(float).tiny))
        scaled = inertia / np.outer(size, size)
        if len(scaled) and not np.linalg.eigvalsh(scaled)[0] > MIN_INERTIA:
            lost = lost_inertia_cause(self.system, self.work)
            none = diagnose("N719", t=self.t)
            raise SimulationError((none, lost) if lost else none)
        shape = size.reshape(-1, *[1] * (right.ndim - 1))
        return np.asarray(np.linalg.solve(scaled, right / shape) / shape, np.float64)

    def solve_demanded(self, C: Array, right: Array, order: int) -> Array:
        """The smallest x with C x = right, a derivative in time of some order.

        Raises
        ------
        SimulationError
            There is none; names joints and drives.
        """
        norms = np.linalg.norm(C, axis=1)
        norms = np.where(norms > 0.0, norms, 1.0)
        x = least_squares(C / norms[:, None], right / norms)
        sizes, time = self.constraint_sizes, self.system.scene.time
        residual = np.abs(C @ x - right) / sizes
        size = np.max(np.abs(right) / sizes, initial=(time.end - time.start) ** -order)
        unmet = np.flatnonzero(residual > DEMAND_TOLERANCE * size)
        if len(unmet):
            rows = tuple(unmet[unmet < self.system.n_rows])
            names = tuple(dict.fromkeys(row_names(self.system, rows)))
            rates = ("velocities", "accelerations")[order - 1]
            raise SimulationError(diagnose("N723", t=self.t, joints=names, rates=rates))
        return x

    def closed(self, z: Array) -> Array:
        """z moved onto the constraints; where they cannot be met it stays open."""
        zero = np.zeros(self.system.n_velocities)
        for _ in range(20):
            self.evaluate(z, zero)
            if self.scaled_residual < 1e-14:
                break
            step = least_squares(self.jacobian, -self.residual)
            z = self.displaced(z, step)
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


def refuse_eliminated_joints(system: System) -> None:
    """Analyses need the forces of all joints.

    Raises
    ------
    InputError
        Joints were eliminated when the scene was compiled.
    """
    if system.eliminated:
        raise InputError(
            "was compiled without the constraints of its prescribed joints",
            expected="compile_scene(..., keep_joints=True)",
        )
