"""A frozen run linearised about itself: its stages, their Jacobians, its projections.

With the states y of a step, its stages Y_i and the slopes F = (Z z_II, z_II') a change
obeys, eq. (46),

    dY = 1 dy + h (A x J) dY + h (A x I) F_p,    dy_1 = P dY_s - G c_p .

The steps are solved one after the other, see `integrators.linearised_steps`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..analyses.output_derivatives import POINTS, WEIGHTS
from ..dynamics import control_laws as laws
from ..dynamics.equations_of_motion import kernel_pointers
from ..integrators import batch_evaluation, linearised_steps
from ..integrators.radau_stages import collocation_matrix, radau_tableau
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable, WorkArrays
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System
from ..system.work_arrays import new_memory, new_work_arrays, raise_pending
from .frozen_run import Grid, Motion, grid_times
from .position_rates import position_rates

#: Stages of the methods whose runs can be linearised.
STAGES = {"radau5": 3, "radau9": 5, "radau13": 7}
#: Steps of differences by coordinates, relative to their sizes: less than a stiff
#: contact gives way.
PERTURBATION = 1e-6
#: Derivatives are compared with differences over another step, this part of it, and
#: over a wide one: rounding hides small rows in the first, curved forces spoil the
#: second, and a missing term differs from both.
CHECK_STEP, WIDE_STEP = 0.1, 100.0
#: Derivatives of `linearise` count as complete when a difference along a random change
#: of the state agrees with them to this part; and states that are compared.
COMPLETE, COMPARED_STATES = 1e-7, 40
#: Points and weights of differences of fourth and of second order.
FOURTH_ORDER = POINTS, WEIGHTS
SECOND_ORDER = np.array([-1.0, 1.0]), np.array([-0.5, 0.5])
#: States at which each coordinate is tried, and sizes of the rows of residuals,
#: relative to the largest one, below which they count as that.
TRIED_STATES, SMALL_ROW = 10, 1e-5
#: Singular values of rotations of markers, relative to the largest, that are rounding.
RANK = 1e-12
#: Numbers in the matrices of the steps that are treated together.
BLOCK_NUMBERS = 400_000


#: Instructions of laws whose value or slope may jump; terms of smooth tables.
_WITH_CORNERS = frozenset(
    (
        laws.MINIMUM,
        laws.MAXIMUM,
        laws.ABS,
        laws.SIGN,
        laws.LOOKUP_GRID,
        laws.CALL,
        laws.CALL_GIVEN,
    )
)
_CUBIC = 4


class NotLinearisable(Exception):
    """A run has something that is not linearised.

    Attributes
    ----------
    reason : what, as a phrase
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass(frozen=True, eq=False)
class States:
    """States of a run with their times, (n, .).

    Attributes
    ----------
    clocks : a time inside the smooth interval of each state [s]
    """

    clocks: Array
    times: Array
    z: Array
    v: Array

    def selected(self, rows: slice | IntTable) -> "States":
        """Some of the states, as copies."""
        parts = (self.clocks, self.times, self.z, self.v)
        return States(*(np.ascontiguousarray(part[rows]) for part in parts))

    def moved(self, clocks: Array, times: Array) -> "States":
        """The same coordinates at other times."""
        return States(clocks, times, self.z, self.v)

    @property
    def arguments(self) -> tuple[Array, Array, Array, Array]:
        return self.clocks, self.times, self.z, self.v


class LinearisedRun:
    """Stages of a frozen run, and what changes with its states.

    Attributes
    ----------
    motion, grid : of the run
    steps : states at the points of the whole steps
    times : (steps + 1,) ends of the steps
    nz, nv, m : positions without counted rotations, velocities, constraints
    stages : (steps * s) states
    accelerations, multipliers : of the stages
    directions, duals : changes of the state along which derivatives are differences, as
        `linearise` is not complete, see `batch_evaluation.linearise_states`
    difference : points and weights of these
    """

    def __init__(self, motion: Motion, grid: Grid) -> None:
        self.motion, self.grid = motion, grid
        system = self.system = motion.system
        check_linearisable(motion, grid)
        self.s = STAGES[grid.steps[0].method]
        tableau = radau_tableau(self.s)
        self.c, self.A = tableau.c, collocation_matrix(tableau.c)
        self.nz = system.n_positions - system.n_rotation_counters
        self.nv, self.m = system.n_velocities, system.n_rows
        self.n_steps = len(grid.steps)
        self.times, self.intervals = grid_times(system, grid)
        self.work, self.memory = new_work_arrays(system), new_memory(system, 0)
        self.kernels = kernel_pointers(system.planar)
        points = motion.points
        self.from_points = lagrange_matrix(points.fractions, self.c)
        self.steps = motion.whole_steps
        table = self._table(self.steps.z), self._table(self.steps.v)
        z, v = (np.einsum("ip,npk->nik", self.from_points, part) for part in table)
        self.stages = States(
            np.repeat(self.step_clocks(self.intervals), self.s),
            self.stage_times(self.times).ravel(),
            z.reshape(-1, system.n_positions),
            v.reshape(-1, self.nv),
        )
        self.starts = table[0][:, 0], table[1][:, 0]
        count = len(self.stages.times)
        self.accelerations = np.zeros((count, self.nv))
        self.multipliers = np.zeros((count, self.m))
        self._solve_states(self.stages, self.accelerations, self.multipliers)
        sizes = coordinate_sizes(system)
        self.steps_v = PERTURBATION * np.maximum(
            np.abs(self.stages.v).max(axis=0), sizes / (self.times[-1] - self.times[0])
        )
        self.steps_z = PERTURBATION * self._position_sizes(sizes)
        #: steps of differences by tangent positions and by velocities
        self.tangent_steps = np.concatenate([PERTURBATION * sizes, self.steps_v])
        self.difference = FOURTH_ORDER
        self.directions, self.duals = self._along(np.zeros(0, np.int64))
        self._find_directions()

    def _table(self, values: Array) -> Array:
        """States at the points of all steps, (steps, points, .)."""
        return values.reshape(self.n_steps, self.motion.points.count, -1)

    def step_clocks(self, intervals: Array) -> Array:
        """A time inside the smooth interval of each step [s].

        Parameters
        ----------
        intervals : (steps, 2) begin and end of the intervals
        """
        return np.ascontiguousarray(0.5 * intervals.sum(axis=1))

    def stage_times(self, times: Array) -> Array:
        """Times of the stages (steps, s) of a run with these ends of steps."""
        return times[:-1, None] + np.diff(times)[:, None] * self.c

    def _position_sizes(self, sizes: Array) -> Array:
        """Size of each position, from those of the velocity coordinates.

        A component of a quaternion that does not change at first does so later.
        """
        some = self.stages.selected(self.rows_between(COMPARED_STATES))
        Z = np.abs(position_rates(self.system, some.z, some.v).Z).max(axis=0)
        return np.maximum(Z @ sizes, 1e-3 * sizes.min())

    @property
    def coordinate_steps(self) -> Array:
        """Steps (nz + nv,) of differences by positions and velocities."""
        return np.concatenate([self.steps_z[: self.nz], self.steps_v])

    @cached_property
    def has_fixed_orientation(self) -> NDArray[np.bool_]:
        """Bodies whose frames move and do not rotate."""
        translations = 2 if self.system.planar else 3
        return np.asarray(self.system.arrays.body[:, at.RD] == translations)

    # Kernels

    def _solve_states(self, states: States, a: Array, multipliers: Array) -> None:
        status = batch_evaluation.accelerations_of_states(
            *(self.kernels, self.system.arrays, self.work, self.memory),
            *(*states.arguments, a, multipliers),
        )
        raise_pending(self.system)
        if status != 0:
            raise NotLinearisable("a singular configuration")

    def residuals(self, system: System, states: States, work: WorkArrays) -> Array:
        """(r, g) of a neighbouring system at the stages, with the accelerations and
        multipliers of this run, (states, rows).

        Parameters
        ----------
        work : of the system
        """
        out = np.zeros((len(states.times), self.nv + self.m))
        batch_evaluation.residuals_of_states(
            *(self.kernels, system.arrays, work),
            *(*states.arguments, self.accelerations, self.multipliers, out),
        )
        raise_pending(system)
        return out

    def constraints(self, system: System, states: States, work: WorkArrays) -> Array:
        """Residuals of the constraints and their rates of a system, (states, 2 m)."""
        out = np.zeros((len(states.times), 2 * self.m))
        batch_evaluation.constraints_of_states(
            self.kernels, system.arrays, work, *states.arguments, out
        )
        raise_pending(system)
        return out

    def solve(self, rows: slice, columns: Array) -> Array:
        """K^-1 of some stages times columns (stages, columns, nv + m), in place."""
        states = self.stages.selected(rows)
        status = batch_evaluation.solve_columns(
            *(self.kernels, self.system.arrays, self.work, self.memory),
            *(*states.arguments, columns),
        )
        if status != 0:
            raise NotLinearisable("a singular configuration")
        return columns

    def solve_transposed(self, rows: slice, columns: Array) -> Array:
        """K^-T of some stages times columns, in place: K is symmetric but for signs."""
        columns[:, :, self.nv :] *= -1.0
        self.solve(rows, columns)
        columns[:, :, self.nv :] *= -1.0
        return columns

    def _residual_derivatives(self, rows: slice | IntTable) -> Array:
        """(r, g) of some stages by positions and velocities, (., nz + nv, nv + m)."""
        found = self._tangent_derivatives(rows)
        states = self.stages.selected(rows)
        to_tangent = position_rates(self.system, states.z, states.v).to_tangent
        by_position = to_tangent.transpose(0, 2, 1) @ found[:, : self.nv]
        return np.concatenate([by_position, found[:, self.nv :]], axis=1)

    def _states_with_forces(self, rows: slice | IntTable) -> tuple[Array, ...]:
        """Some stages with accelerations and multipliers, as kernels take them."""
        parts = self.accelerations[rows], self.multipliers[rows]
        states = self.stages.selected(rows)
        return (*states.arguments, *map(np.ascontiguousarray, parts))

    def _tangent_derivatives(
        self,
        rows: slice | IntTable,
        along: tuple[Array, Array] | None = None,
        difference: tuple[Array, Array] | None = None,
    ) -> Array:
        """(r, g) of some stages by tangent positions and velocities, (., 2 nv, nv + m).

        Parameters
        ----------
        along : directions and their duals, default those of the run
        difference : points and weights, default `self.difference`
        """
        given = self._states_with_forces(rows)
        out = np.zeros((len(given[0]), 2 * self.nv, self.nv + self.m))
        batch_evaluation.linearise_states(
            *(self.kernels, self.system.arrays, self.work, *given),
            *(along or (self.directions, self.duals)),
            *(difference or self.difference),
            *(derivative_scratch(self.system), out),
        )
        return out

    def rows_between(self, count: int) -> IntTable:
        """Rows of so many stages."""
        last = len(self.stages.times) - 1
        return np.unique(np.linspace(0, last, count).astype(np.int64))

    def _find_directions(self) -> None:
        """Find directions along which `linearise` leaves something out."""
        if self._agrees():
            return
        rows, steps = self.rows_between(TRIED_STATES), self.tangent_steps[:, None]
        near, wide = self._changes(rows, FOURTH_ORDER)
        sizes = self._row_sizes(np.abs(near).max(axis=(0, 1)))
        known = self._tangent_derivatives(rows) * steps
        error = np.minimum(np.abs(known - near), np.abs(known - wide)).max(axis=0)
        incomplete = (error / sizes).max(axis=1) > COMPLETE / 10
        near2, wide2 = self._changes(rows, SECOND_ORDER)
        away = np.abs(wide2 - wide) / WIDE_STEP**2  # falls with the square of the step
        second = np.minimum(np.abs(near2 - near), away) / sizes
        is_enough = second.max(initial=0.0) <= COMPLETE / 10
        self.difference = SECOND_ORDER if is_enough else FOURTH_ORDER
        for found in self._by_markers(incomplete), self._along(incomplete.nonzero()[0]):
            self.directions, self.duals = found
            if self._agrees():
                return
        self.difference = FOURTH_ORDER
        self.directions, self.duals = self._along(np.arange(2 * self.nv))

    def _along(self, coordinates: IntTable) -> tuple[Array, Array]:
        """Directions and duals of differences by single coordinates."""
        one, steps = np.eye(2 * self.nv)[coordinates], self.tangent_steps
        return one * steps, one / steps

    def _by_markers(self, incomplete: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Directions and duals for incomplete coordinates (2 nv,).

        Elastic coordinates change what `linearise` leaves out by the rotations of the
        markers alone, which are fewer.
        """
        system, rest = self.system, incomplete.copy()
        directions, duals = [np.zeros((0, len(rest)))], [np.zeros((0, len(rest)))]
        for data, row in zip(system.bodies, system.arrays.body, strict=True):
            names = [marker for body, marker in system.markers if body == data.name]
            count = int(row[at.NQ])
            if not count or not names:
                continue
            psi = np.vstack([data.node(name).psi.m0 for name in names])
            last = int(row[at.VEL] + row[at.NV])
            for end in (last, last + self.nv):
                group = slice(end - count, end)
                steps = self.tangent_steps[group]
                _, sizes, V = np.linalg.svd(psi * steps, full_matrices=False)
                V = V[sizes > RANK * sizes.max()]
                if not 0 < len(V) < rest[group].sum():
                    continue
                both = np.zeros((2, len(V), len(rest)))
                both[0][:, group], both[1][:, group] = V * steps, V / steps
                directions.append(both[0])
                duals.append(both[1])
                rest[group] = False
        others = self._along(rest.nonzero()[0])
        return np.vstack([*directions, others[0]]), np.vstack([*duals, others[1]])

    def _changes(
        self, rows: IntTable, difference: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Derivatives by all coordinates at some stages, times steps, by differences
        over these steps and over wide ones.
        """
        (points, weights), found = difference, []
        everything = self._along(np.arange(2 * self.nv))
        for width in (1.0, WIDE_STEP):
            scaled = width * points, weights / width
            changes = self._tangent_derivatives(rows, everything, scaled)
            found.append(changes * self.tangent_steps[:, None])
        return found[0], found[1]

    def _row_sizes(self, changes: Array) -> Array:
        """Sizes of changes of each of (r, g), not far below the others of r or g."""
        sizes = changes.copy()
        for part in (slice(0, self.nv), slice(self.nv, None)):
            largest = changes[part].max(initial=0.0)
            sizes[part] = np.maximum(changes[part], SMALL_ROW * largest)
        return np.maximum(sizes, float(np.finfo(float).tiny))

    def _agrees(self) -> bool:
        """Whether derivatives agree with differences along a random direction."""
        rows = self.rows_between(COMPARED_STATES)
        random = np.random.default_rng(0)
        dz = random.standard_normal((len(rows), self.nz)) * self.steps_z[: self.nz]
        dv = random.standard_normal((len(rows), self.nv)) * self.steps_v
        found = self._residual_derivatives(rows)
        change = np.einsum("nk,nkr->nr", np.concatenate([dz, dv], axis=1), found)
        clocks, times, z, v, *forces = self._states_with_forces(rows)
        errors = []
        for width in (CHECK_STEP, WIDE_STEP):
            difference = np.zeros_like(change)
            for point, weight in zip(*FOURTH_ORDER, strict=True):
                out, moved = np.zeros_like(change), z.copy()
                moved[:, : self.nz] += width * point * dz
                batch_evaluation.residuals_of_states(
                    *(self.kernels, self.system.arrays, self.work),
                    *(clocks, times, moved, v + width * point * dv, *forces, out),
                )
                difference += weight / width * out
            sizes = self._row_sizes(np.abs(difference).max(axis=0))
            errors.append(np.abs(difference - change) / sizes)
        return bool(np.minimum(*errors).max() < COMPLETE)

    # Steps

    @cached_property
    def block_length(self) -> int:
        """Steps that are treated together."""
        states = self.nz + self.nv
        size = 2 * self.s * states * (states + self.nv + self.m)
        return max(1, min(self.n_steps, BLOCK_NUMBERS // size))

    def blocks(self) -> list[slice]:
        """Ranges of steps that are treated together."""
        length = self.block_length
        starts = range(0, self.n_steps, length)
        return [slice(k, min(k + length, self.n_steps)) for k in starts]

    def stage_rows(self, steps: slice) -> slice:
        """Rows of the stages of some steps."""
        return slice(steps.start * self.s, steps.stop * self.s)

    def slope_derivatives(self, rows: slice, *, transposed: bool = False) -> Array:
        """Derivatives of the slopes by the states at some stages, with a row for each
        slope, (stages, nz + nv, nz + nv).
        """
        nz, nv, given = self.nz, self.nv, self._states_with_forces(rows)
        size = nz + nv
        out = np.empty((len(given[0]), size, size))
        status = batch_evaluation.slope_derivatives(
            *(self.kernels, self.system.arrays, self.work, self.memory, *given),
            *(self.directions, self.duals, *self.difference),
            derivative_scratch(self.system),
            *(int(transposed), np.zeros(nv), np.zeros((2 * nv, nv + self.m))),
            *(np.zeros((nv, nz)), np.zeros((nz, nz)), np.zeros((nv, nz))),
            *(np.zeros((size, size)), out),
        )
        if status != 0:
            raise NotLinearisable("a singular configuration")
        return out

    def march(
        self,
        steps: slice,
        projections: Array,
        forcing: Array,
        added: Array,
        current: Array,
        *,
        backward: bool = False,
    ) -> tuple[Array, Array]:
        """Solve linearised steps one after the other, see `linearised_steps`.

        Parameters
        ----------
        projections : (., N, N) derivatives of the projections of the steps
        forcing : (steps, s, columns, N) at the stages, besides the state; it is
            multiplied by A h
        added : (steps, columns, N) to the state after each step
        current : (columns, N) state, which is replaced by that after the last step

        Returns the stages (steps, columns, s, N), backwards u of (49), and the states
        (steps, columns, N) before the steps in the sequence of time.

        Raises
        ------
        NotLinearisable : the iteration does not converge, or has no number as result.
        """
        A, tableau, s = self.A, radau_tableau(self.s), self.s
        pairs, eigenvalues = (tableau.TI, tableau.T), tableau.complex_eigenvalues
        weights, rows = 1.0 / self.coordinate_steps, self.stage_rows(steps)
        derivatives = self.slope_derivatives(rows, transposed=not backward)
        if backward:
            A, eigenvalues, weights = A.T, eigenvalues.conj(), 1.0 / weights
            pairs = tableau.T.T, tableau.TI.T
        else:
            projections = projections.transpose(0, 2, 1)
        n, count, size = len(forcing), *current.shape
        h = np.diff(self.times)[steps]
        given = np.einsum("n,ij,njcr->ncir", h, A, forcing)
        stages = np.ascontiguousarray(given).reshape(-1, s, size)
        starts = np.zeros((n * count, size))
        eigenvalues = np.append(tableau.real_eigenvalue, eigenvalues)
        groups = len(eigenvalues)
        status = linearised_steps.march(
            *(int(backward), self.nz, h),
            *map(np.ascontiguousarray, (A, *pairs, eigenvalues)),
            *(derivatives, np.ascontiguousarray(projections), weights, stages),
            *(np.ascontiguousarray(added.reshape(-1, size)), current, starts),
            *(np.zeros((5, s, size)), np.zeros((self.nv, self.nv))),
            *np.zeros((2, groups, self.nv, self.nv)),
            *(np.zeros(size), np.zeros(self.nv, np.int64)),
        )
        if status != 0:
            raise NotLinearisable("steps in which the equations change too much")
        if not np.isfinite(stages).all():  # the norm of the iteration skips NaN
            raise NotLinearisable("equations whose derivatives are no numbers")
        return stages.reshape(n, count, s, size), starts.reshape(n, count, size)


def derivative_scratch(system: System) -> Array:
    """Scratch of `batch_evaluation.linearise_states`."""
    return np.zeros((4, max(system.n_positions, system.n_velocities + system.n_rows)))


def check_linearisable(motion: Motion, grid: Grid) -> None:
    """Refuse a run with more than smooth intervals of one Radau method.

    Raises
    ------
    NotLinearisable : says why.
    """
    system = motion.system
    methods = {step.method for step in grid.steps}
    problems = {
        f"the integrator {', '.join(sorted(methods))}": len(methods) != 1
        or not methods <= STAGES.keys(),
        "a motion that drives prescribe": system.n_velocities == 0,
        "joint friction": bool(system.friction_joints),
        "a corner of a force": any(step.corner >= 0 for step in grid.steps),
        "a singular configuration": not np.isnan(grid.singular_time),
        "energies": motion.energies is not None,
        "a corner of a force that steps may pass": _has_passed_corners(motion, grid),
        "sampled control laws": any(force.sample_period for force in system.forces),
        "a formula with corners": any(
            _may_have_corners(force.code, system) for force in system.forces
        ),
    }
    for reason, is_there in problems.items():
        if is_there:
            raise NotLinearisable(reason)


def _has_passed_corners(motion: Motion, grid: Grid) -> bool:
    """Whether steps may pass corners of forces: fixed ones, or those over a rate."""
    own_laws = [force.law for force in motion.system.forces]
    over_rate = any(len(law.rate_features().corners) for law in own_laws)
    passed = any(len(law.features().corners) for law in own_laws)
    return over_rate or (grid.settings.step is not None and passed)


def _may_have_corners(code: Sequence[float], system: System) -> bool:
    """Whether a law has a function that is not smooth, a limit, a table without a
    smooth curve, or a function of a program."""
    instructions = np.array(code[laws.HEADER_SIZE :]).reshape(-1, laws.INSTRUCTION_SIZE)
    return any(
        kind in _WITH_CORNERS
        or (kind == laws.LOOKUP and system.arrays.drive[row, at.D_TERMS] < _CUBIC)
        for kind, row in instructions[:, :2].astype(np.int64).tolist()
    )


def lagrange_matrix(nodes: Array, at: Array) -> Array:
    """Values at some places of the polynomials through nodes, (places, nodes)."""
    matrix = np.ones((len(at), len(nodes)))
    for j, node in enumerate(nodes):
        for k, other in enumerate(nodes):
            if k != j:
                matrix[:, j] *= (at - other) / (node - other)
    return matrix
