"""Derivatives of a frozen run by numbers of its scene: direct and adjoint, eq. (46).

What a number changes at fixed states comes from two neighbouring systems: residuals of
the equations at the stages, of the constraints at the ends of steps, the start, and the
times of the grid. No neighbour is integrated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.sid import Array

from ..analyses.output_derivatives import POINTS, WEIGHTS
from ..integrators import batch_evaluation
from ..output.dense_output import StepStates
from ..spatial import system_arrays as at
from ..system.system import System
from .frozen_run import Motion, frozen_start, grid_times
from .linearised_run import LinearisedRun, NotLinearisable, States, lagrange_matrix
from .position_rates import position_rates

#: Factor of the estimated truncation error of a central difference.
SAFETY = 10.0
#: Changes of residuals that matter not, relative to the forces, for a change of a
#: number by its own size.
NEGLIGIBLE = 1e-3
#: Step of differences along the motion, in steps of the run or their mean.
RATE_STEP = 1e-3
#: Rounding of residuals, relative to the forces.
ROUNDING = 10.0 * float(np.finfo(float).eps)
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class ParameterChange:
    """What a number changes at the fixed states of a run, per unit of the number.

    Attributes
    ----------
    residual : (stages, nv + m) of the equations of motion
    rates : (stages, nz) of positions, None where there is no change
    stretch : (steps,) relative change of the lengths of the steps
    constraint : (steps - 1, 2 m) values and rates at ends of steps
    start : (nz + nv,) initial state
    step : of the number
    systems, times, end_times : of the neighbours above and below
    relative_error : estimate of that of the residual
    """

    residual: Array
    rates: Array | None
    stretch: Array
    constraint: Array
    start: Array
    step: float
    systems: tuple[System, System]
    times: tuple[Array, Array]
    relative_error: float


class _Neighbour(NamedTuple):
    """A neighbouring system at the states of a run, as in `ParameterChange`."""

    system: System
    times: Array
    residual: Array
    constraint: Array
    start: Array
    rates: Array | None


@dataclass(frozen=True, eq=False)
class _Projection:
    """Derivatives of the projections of some steps, see `linearise_projections`.

    Attributes
    ----------
    C, G : (steps, m, nv)
    rates : (steps, nv, m) derivatives of the rates of the constraints by tangent
        vectors of positions
    to_tangent : (steps, nv, nz) of the states before them
    Z : (steps, nz, nv) of the states after them
    """

    C: Array
    G: Array
    rates: Array
    to_tangent: Array
    Z: Array


@dataclass(frozen=True, eq=False)
class AdjointGradient:
    """Gradients of functionals by what `ParameterChange` holds, a column for each."""

    residual: Array
    rates: Array
    stretch: Array
    constraint: Array
    start: Array

    def along(self, change: ParameterChange) -> Array:
        """Derivatives of the functionals by a number through the motion, (columns,)."""
        total = np.einsum("nr,nrc->c", change.residual, self.residual)
        total += np.einsum("n,nc->c", change.stretch, self.stretch)
        total += np.einsum("nr,nrc->c", change.constraint, self.constraint)
        if change.rates is not None:
            total += np.einsum("nr,nrc->c", change.rates, self.rates)
        return np.asarray(total + change.start @ self.start)


class MotionDerivatives:
    """Direct and adjoint derivatives about one run.

    Attributes
    ----------
    run : linearised
    """

    def __init__(self, run: LinearisedRun) -> None:
        self.run = run
        nodes = np.append(0.0, run.c)
        #: values at the points of a step from its start and its stages
        self._points = lagrange_matrix(nodes, run.motion.points.fractions)

    @cached_property
    def ends(self) -> States:
        """States after the projections of all steps but the last one."""
        run = self.run
        z, v = run.starts
        clocks = run.step_clocks(run.intervals)[:-1]
        parts = clocks, run.times[1:-1], z[1:], v[1:]
        return States(*map(np.ascontiguousarray, parts))

    @cached_property
    def _projection(self) -> _Projection:
        run, ends = self.run, self.ends
        n, shape = run.n_steps - 1, (run.n_steps - 1, run.m, run.nv)
        C, G, C_dot = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        own = position_rates(run.system, ends.z, ends.v)
        lengths = np.diff(run.times)
        steps = RATE_STEP * np.maximum(lengths[:-1], lengths.mean())
        copies = ends.selected(slice(None))
        status = batch_evaluation.linearise_projections(
            *(run.kernels, run.system.arrays, run.work, run.memory),
            *(*copies.arguments, own.rate, steps, POINTS, WEIGHTS, C, G, C_dot),
        )
        if status != 0:
            raise NotLinearisable("a singular configuration")
        Z_dot = np.zeros_like(own.Z)
        for point, weight in zip(POINTS, WEIGHTS, strict=True):
            moved = copies.z.copy()
            moved[:, : run.nz] += point * steps[:, None] * own.rate
            Z = position_rates(run.system, moved, ends.v).Z
            Z_dot += weight / steps[:, None, None] * Z
        turned = own.to_tangent @ (own.by_position @ own.Z - Z_dot)
        rates = np.ascontiguousarray((C_dot + C @ turned).transpose(0, 2, 1))
        before = run.stages.selected(slice(run.s - 1, (n + 1) * run.s - 1, run.s))
        to_tangent = position_rates(run.system, before.z, before.v).to_tangent
        return _Projection(C, G, rates, to_tangent, own.Z)

    # Parameters

    def parameter_change(
        self, systems: tuple[System, System], step: float, size: float
    ) -> ParameterChange:
        """What a number changes, from the systems with the number plus and minus a
        step; the number has some size.

        Raises
        ------
        StructureChange : a neighbour has other constraints or breaks.
        InputError : a neighbour has no start.
        """
        plus, minus = (self._neighbour(system) for system in systems)

        def difference(above: Array, below: Array) -> Array:
            return np.asarray((above - below) / (2.0 * step))

        residual = difference(plus.residual, minus.residual)
        second = np.abs(plus.residual + minus.residual - 2.0 * self._own_residual)
        rounding = ROUNDING * self._force_size / step
        least = NEGLIGIBLE * self._force_size / size
        largest = max(float(np.abs(residual).max(initial=0.0)), least, TINY)
        error = SAFETY * second.max(initial=0.0) / size + rounding
        rates = None
        if plus.rates is not None or minus.rates is not None:
            own = self._own_rates
            rates = difference(
                own if plus.rates is None else plus.rates,
                own if minus.rates is None else minus.rates,
            )
        times = difference(plus.times, minus.times)
        return ParameterChange(
            residual=residual,
            rates=rates,
            stretch=np.diff(times) / np.diff(self.run.times),
            constraint=difference(plus.constraint, minus.constraint),
            start=difference(plus.start, minus.start),
            step=step,
            systems=(plus.system, minus.system),
            times=(plus.times, minus.times),
            relative_error=min(1.0, float(error / largest)),
        )

    def _neighbour(self, system: System) -> _Neighbour:
        """A neighbouring system at the states of this run."""
        run = self.run
        start = frozen_start(system, run.grid)
        times, intervals = run.times, run.intervals
        if start.system.breaks != run.system.breaks or (
            start.system.scene.time.start != times[0]
        ):
            times, intervals = grid_times(start.system, run.grid)
        clocks = run.step_clocks(intervals)
        stages = run.stages.moved(
            np.repeat(clocks, run.s), run.stage_times(times).ravel()
        )
        ends = self.ends.moved(clocks[:-1].copy(), times[1:-1].copy())
        rates = None
        if self._orientations(start.system) != self._orientations(run.system):
            rates = position_rates(start.system, stages.z, stages.v).rate
        return _Neighbour(
            start.system,
            times,
            run.residuals(start.system, stages),
            run.constraints(start.system, ends),
            np.concatenate([start.begin.z[: run.nz], start.begin.v]),
            rates,
        )

    @cached_property
    def _force_size(self) -> float:
        """Largest entry of the forces and of gamma at the stages."""
        run, states = self.run, self.run.stages
        out = np.zeros_like(self._own_residual)
        none = np.zeros_like(run.accelerations), np.zeros_like(run.multipliers)
        batch_evaluation.residuals_of_states(
            run.kernels, run.system.arrays, run.work, *states.arguments, *none, out
        )
        return float(np.abs(out).max(initial=0.0))

    def _orientations(self, system: System) -> list[float]:
        """Constant orientations of frames that do not rotate."""
        first = system.arrays.body[:, at.FRAME][self.run.has_fixed_orientation]
        count = 1 if system.planar else 4
        return [
            float(system.arrays.real_data[k + i]) for k in first for i in range(count)
        ]

    @cached_property
    def _own_rates(self) -> Array:
        """Rates of positions at the stages."""
        states = self.run.stages
        return position_rates(self.run.system, states.z, states.v).rate

    @cached_property
    def _own_residual(self) -> Array:
        return self.run.residuals(self.run.system, self.run.stages)

    # Direct

    def direct(self, changes: Sequence[ParameterChange]) -> tuple[Array, Array]:
        """Derivatives of the states at the points of all steps by some numbers,
        (steps * points, n_positions, numbers) and (steps * points, nv, numbers).
        """
        run = self.run
        n_columns, nz, nv = len(changes), run.nz, run.nv
        current = np.stack([change.start for change in changes], axis=1)
        parts: list[Array] = []
        for steps in run.blocks():
            stages, current = self._direct_block(steps, changes, current)
            parts.append(np.einsum("pk,nkrc->nprc", self._points, stages))
        table = np.concatenate(parts).reshape(-1, nz + nv, n_columns)
        counters = np.zeros((len(table), run.system.n_rotation_counters, n_columns))
        z = np.concatenate([table[:, :nz], counters], axis=1)
        return z, table[:, nz:]

    def _direct_block(
        self, steps: slice, changes: Sequence[ParameterChange], current: Array
    ) -> tuple[Array, Array]:
        """Changes of starts and stages of some steps (steps, s + 1, nz + nv, columns),
        and of the start of the next one.
        """
        run, count = self.run, len(changes)
        s, nz, nv, n = run.s, run.nz, run.nv, steps.stop - steps.start
        matrices = run.step_matrices(steps)
        rows = run.stage_rows(steps)
        forcing = np.stack([c.residual[rows] for c in changes], axis=1)
        slopes = -run.solve(rows, forcing)[:, :, :nv].transpose(0, 2, 1)
        slopes = slopes.reshape(n, s, nv, count)
        stretch = np.stack([c.stretch[steps] for c in changes], axis=1)
        own = run.accelerations[rows].reshape(n, s, nv, 1)
        slopes = slopes + own * stretch[:, None, None, :]
        rates = self._rate_changes(steps, changes, stretch)
        moved = None
        if rates is not None:
            moved = matrices.rates.positions(matrices.weighted(rates))
            slopes = slopes + matrices.by_position @ moved
        right = matrices.weighted(slopes).reshape(n, s * nv, count)
        ones = np.broadcast_to(np.tile(np.eye(nv), (s, 1)), (n, s * nv, nv))
        columns = np.concatenate([matrices.start, ones, right], axis=2)
        V = np.linalg.solve(matrices.system, columns)
        last = matrices.response[:, -nz:] @ V
        last[..., :nz] += matrices.position_start[:, -1]
        if moved is not None:
            last[..., nz + nv :] += moved[:, -1]
        ends = self._projected(steps, last, V[:, -nv:], changes)
        starts = np.zeros((n, nz + nv, count))
        for k in range(n):
            starts[k] = current
            if k < len(ends):
                current = ends[k, :, : nz + nv] @ current + ends[k, :, nz + nv :]
        V = V[..., : nz + nv] @ starts + V[..., nz + nv :]
        Z = (matrices.response @ V).reshape(n, s, nz, count)
        Z += matrices.position_start @ starts[:, None, :nz]
        if moved is not None:
            Z += moved
        stages = np.concatenate([Z, V.reshape(n, s, nv, count)], axis=2)
        return np.concatenate([starts[:, None], stages], axis=1), current

    def _rate_changes(
        self, steps: slice, changes: Sequence[ParameterChange], stretch: Array
    ) -> Array | None:
        """Direct changes of the rates of positions (steps, s, nz, columns)."""
        run, rows = self.run, self.run.stage_rows(steps)
        own = [change.rates for change in changes]
        if not stretch.any() and all(part is None for part in own):
            return None
        rate = self._own_rates[rows].reshape(len(stretch), run.s, run.nz, 1)
        total = rate * stretch[:, None, None, :]
        for k, part in enumerate(own):
            if part is not None:
                total[..., k] += part[rows].reshape(total.shape[:3])
        return np.asarray(total)

    def _projected(
        self, steps: slice, Z: Array, V: Array, changes: Sequence[ParameterChange]
    ) -> Array:
        """Changes of the starts of the next steps from those of the last stages."""
        projection, part = self._projection, slice(steps.start, steps.stop)
        C, G, rates = (x[part] for x in (projection.C, projection.G, projection.rates))
        n, m = len(C), self.run.m
        Z, V = Z[:n], V[:n]
        tangent = projection.to_tangent[part] @ Z
        given = np.stack([c.constraint[part] for c in changes], axis=2)
        values, speeds = C @ tangent, C @ V
        values[:, :, -len(changes) :] += given[:, :m]
        tangent = tangent - G.transpose(0, 2, 1) @ values
        speeds += rates.transpose(0, 2, 1) @ tangent
        Z = projection.Z[part] @ tangent
        speeds[:, :, -len(changes) :] += given[:, m:]
        V = V - G.transpose(0, 2, 1) @ speeds
        return np.concatenate([Z, V], axis=1)

    # Adjoint

    def adjoint(self, seeds: Array) -> AdjointGradient:
        """Gradients of functionals by everything that numbers change.

        Parameters
        ----------
        seeds : (steps * points, nz + nv, functionals) derivatives by the states at the
            points of all steps
        """
        run, count = self.run, seeds.shape[2]
        nz, nv = run.nz, run.nv
        table = seeds.reshape(run.n_steps, -1, nz + nv, count)
        parts = np.einsum("pk,nprc->nkrc", self._points, table)
        gradient = AdjointGradient(
            residual=np.zeros((run.n_steps * run.s, nv + run.m, count)),
            rates=np.zeros((run.n_steps * run.s, nz, count)),
            stretch=np.zeros((run.n_steps, count)),
            constraint=np.zeros((run.n_steps - 1, 2 * run.m, count)),
            start=np.zeros((nz + nv, count)),
        )
        current = np.zeros((nz + nv, count))
        for steps in reversed(run.blocks()):
            current = self._adjoint_block(steps, parts[steps], current, gradient)
        gradient.start[:] = current
        return gradient

    def _adjoint_block(
        self, steps: slice, seeds: Array, current: Array, gradient: AdjointGradient
    ) -> Array:
        """Fill the gradients of some steps; returns that by their first state.

        Parameters
        ----------
        seeds : (steps, s + 1, nz + nv, columns) by starts and stages
        current : (nz + nv, columns) by the start of the next step
        """
        run, count = self.run, seeds.shape[3]
        s, nz, nv, n = run.s, run.nz, run.nv, steps.stop - steps.start
        matrices = run.step_matrices(steps)
        by_z = np.zeros((n, s, nz, nz + nv + count))
        by_v = np.zeros((n, s, nv, nz + nv + count))
        by_z[:, -1, :, :nz], by_v[:, -1, :, nz : nz + nv] = np.eye(nz), np.eye(nv)
        by_z[..., nz + nv :], by_v[..., nz + nv :] = (
            seeds[:, 1:, :nz],
            seeds[:, 1:, nz:],
        )
        right = by_v.reshape(n, s * nv, -1)
        response = matrices.response.transpose(0, 2, 1)
        right[..., :nz] += response[..., -nz:]
        own = np.ascontiguousarray(by_z[..., nz + nv :]).reshape(n, s * nz, count)
        right[..., nz + nv :] += response @ own
        psi = np.linalg.solve(matrices.system.transpose(0, 2, 1), right)
        start_back = matrices.position_start.reshape(n, s * nz, nz).transpose(0, 2, 1)
        by_start = np.zeros((n, nz, nz + nv + count))
        by_start[..., :nz] = start_back[..., -nz:]
        by_start[..., nz + nv :] = start_back @ own
        by_start += matrices.start.transpose(0, 2, 1) @ psi
        ends = np.concatenate([by_start, psi.reshape(n, s, nv, -1).sum(axis=1)], axis=1)
        back = self._projection_back(steps)
        nexts, after = np.zeros((2, n, nz + nv, count))
        for k in range(n - 1, -1, -1):
            nexts[k] = after[k] = current
            if k < len(back):
                after[k] = back[k] @ current
            current = ends[k, :, : nz + nv] @ after[k] + ends[k, :, nz + nv :]
            current += seeds[k, 0]
        self._add_constraints(steps, nexts, gradient)
        psi = psi[..., : nz + nv] @ after + psi[..., nz + nv :]
        by_z = by_z[..., : nz + nv] @ after[:, None] + by_z[..., nz + nv :]
        rows = run.stage_rows(steps)
        slopes = matrices.weighted_back(np.asarray(psi).reshape(n, s, nv, count))
        moved = by_z + matrices.by_position.transpose(0, 1, 3, 2) @ slopes
        rates = matrices.weighted_back(matrices.rates.positions_back(moved))
        columns = np.zeros((n * s, count, nv + run.m))
        columns[:, :, :nv] = slopes.reshape(n * s, nv, count).transpose(0, 2, 1)
        own = run.accelerations[rows].reshape(n, s, nv)
        own_rates = self._own_rates[rows]
        stretch = np.einsum("nsr,nsrc->nc", own, slopes)
        stretch += np.einsum("nsr,nsrc->nc", own_rates.reshape(n, s, nz), rates)
        gradient.stretch[steps] = stretch
        gradient.rates[rows] = rates.reshape(n * s, nz, count)
        solved = run.solve_transposed(rows, columns)
        gradient.residual[rows] = -solved.transpose(0, 2, 1)
        return current

    def _projection_back(self, steps: slice) -> Array:
        """Transposed derivatives of the projections at the ends of steps by the states
        before them, (steps, nz + nv, nz + nv).
        """
        projection, nz = self._projection, self.run.nz
        C, G, rates, to_tangent, Z = (
            part[steps.start : steps.stop]
            for part in (
                projection.C,
                projection.G,
                projection.rates,
                projection.to_tangent,
                projection.Z,
            )
        )
        n, size = len(C), nz + self.run.nv
        one, Ct = np.eye(self.run.nv), C.transpose(0, 2, 1)
        keeps = one - Ct @ G
        by_tangent = to_tangent.transpose(0, 2, 1) @ keeps
        back = np.zeros((n, size, size))
        back[:, :nz, :nz] = by_tangent @ Z.transpose(0, 2, 1)
        back[:, :nz, nz:] = -by_tangent @ rates @ G
        back[:, nz:, nz:] = keeps
        return back

    def _add_constraints(
        self, steps: slice, nexts: Array, gradient: AdjointGradient
    ) -> None:
        """Fill the gradients by residuals of constraints at the ends of steps."""
        projection, nz, m = self._projection, self.run.nz, self.run.m
        part = slice(steps.start, min(steps.stop, self.run.n_steps - 1))
        G, nexts = projection.G[part], nexts[: part.stop - part.start]
        by_speed = -G @ nexts[:, nz:]
        by_tangent = projection.Z[part].transpose(0, 2, 1) @ nexts[:, :nz]
        by_tangent += projection.rates[part] @ by_speed
        gradient.constraint[part, m:] = by_speed
        gradient.constraint[part, :m] = -G @ by_tangent

    def neighbours(
        self, change: ParameterChange, z: Array | float = 0.0, v: Array | float = 0.0
    ) -> tuple[Motion, Motion]:
        """Motions of both neighbours of a number, to first order.

        Parameters
        ----------
        z, v : derivatives of the states at all points, 0 for fixed states

        Raises
        ------
        StructureChange : the event that ends the run lies in another step.
        """
        run, found = self.run, list[Motion]()
        states = run.steps
        pairs = zip((1, -1), change.systems, change.times, strict=True)
        for sign, system, times in pairs:
            share = sign * change.step
            t = states.t
            if (times != run.times).any():
                t = self._point_times(times)
            moved = StepStates(t, states.z + share * z, states.v + share * v)
            own = replace(run.motion, system=system, end_time=float(times[-1]))
            found.append(own.ended_by_event(moved))
        return found[0], found[1]

    def _point_times(self, times: Array) -> Array:
        """Times of the points of all steps, inside of these by rounding."""
        fractions = self.run.motion.points.fractions
        t = times[:-1, None] + np.diff(times)[:, None] * fractions
        t[:, 0] = np.nextafter(times[:-1], np.inf)
        t[:, -1] = np.nextafter(times[1:], -np.inf)
        return np.asarray(t.ravel())
