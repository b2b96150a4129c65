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
from ..system.work_arrays import new_work_arrays
from .frozen_run import Motion, frozen_start, grid_times
from .linearised_run import (
    COMPARED_STATES,
    LinearisedRun,
    NotLinearisable,
    States,
    lagrange_matrix,
)
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
    """Gradients of functionals by what `ParameterChange` holds, a column for each.

    Attributes
    ----------
    slopes : (stages, columns, nz + nv) by the slopes at the stages
    stretch : (steps, columns)
    """

    slopes: Array
    residual: Array
    constraint: Array
    start: Array
    derivatives: "MotionDerivatives"

    @cached_property
    def stretch(self) -> Array:
        products = np.einsum("nr,ncr->nc", self.derivatives.slopes, self.slopes)
        stages = self.derivatives.run.s
        return np.asarray(products.reshape(-1, stages, products.shape[1]).sum(axis=1))

    def along(self, change: ParameterChange) -> Array:
        """Derivatives of the functionals by a number through the motion, (columns,)."""
        total = np.einsum("nr,nrc->c", change.residual, self.residual)
        total += np.einsum("nr,nrc->c", change.constraint, self.constraint)
        if change.stretch.any():
            total += change.stretch @ self.stretch
        if change.rates is not None:
            nz = change.rates.shape[1]
            total += np.einsum("nr,ncr->c", change.rates, self.slopes[..., :nz])
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
        second = np.abs(plus.residual + minus.residual)  # the own one is rounding
        rounding = ROUNDING * self._force_size / step
        least = NEGLIGIBLE * self._force_size / size
        largest = max(float(np.abs(residual).max(initial=0.0)), least, TINY)
        error = SAFETY * second.max(initial=0.0) / size + rounding
        rates = None
        if plus.rates is not None or minus.rates is not None:
            own = self.slopes[:, : self.run.nz]
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
        system, start = frozen_start(system, run.grid)
        times, intervals = run.times, run.intervals
        if system.breaks != run.system.breaks or (system.scene.time.start != times[0]):
            times, intervals = grid_times(system, run.grid)
        clocks = run.step_clocks(intervals)
        stages = run.stages.moved(
            np.repeat(clocks, run.s), run.stage_times(times).ravel()
        )
        ends = self.ends.moved(clocks[:-1].copy(), times[1:-1].copy())
        rates = None
        if self._orientations(system) != self._orientations(run.system):
            rates = position_rates(system, stages.z, stages.v).rate
        work = new_work_arrays(system)
        return _Neighbour(
            system,
            times,
            run.residuals(system, stages, work),
            run.constraints(system, ends, work),
            np.concatenate([start.z[: run.nz], start.v]),
            rates,
        )

    @cached_property
    def _force_size(self) -> float:
        """Largest entry of the forces and of gamma at some stages."""
        run = self.run
        states = run.stages.selected(run.rows_between(COMPARED_STATES))
        none = (
            np.zeros((len(states.times), run.nv)),
            np.zeros((len(states.times), run.m)),
        )
        out = np.zeros((len(states.times), run.nv + run.m))
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
    def slopes(self) -> Array:
        """Slopes at the stages, (stages, nz + nv)."""
        run, states = self.run, self.run.stages
        rate = position_rates(run.system, states.z, states.v).rate
        return np.concatenate([rate, run.accelerations], axis=1)

    # Direct

    def direct(self, changes: Sequence[ParameterChange]) -> tuple[Array, Array]:
        """Derivatives of the states at the points of all steps by some numbers,
        (steps * points, n_positions, numbers) and (steps * points, nv, numbers).
        """
        run = self.run
        n_columns, nz, nv = len(changes), run.nz, run.nv
        current = np.stack([change.start for change in changes])
        parts: list[Array] = []
        for steps in run.blocks():
            stages, starts = run.march(
                *(steps, self._projection_derivatives(steps)),
                *(self._forcing(steps, changes), self._shifts(steps, changes)),
                current,
            )
            states = np.concatenate([starts[:, :, None], stages], axis=2)
            parts.append(self._points @ states)
        table = np.concatenate(parts).transpose(1, 0, 2, 3)
        table = table.reshape(n_columns, -1, nz + nv)
        counters = np.zeros((*table.shape[:2], run.system.n_rotation_counters))
        z = np.concatenate([table[..., :nz], counters], axis=2)
        return np.moveaxis(z, 0, 2), np.moveaxis(table[..., nz:], 0, 2)

    def _forcing(self, steps: slice, changes: Sequence[ParameterChange]) -> Array:
        """Direct changes of the slopes at the stages of some steps, (steps, s, columns,
        nz + nv).
        """
        run, rows = self.run, self.run.stage_rows(steps)
        residual = np.stack([c.residual[rows] for c in changes], axis=1)
        slopes = np.zeros((*residual.shape[:2], run.nz + run.nv))
        slopes[..., run.nz :] = -run.solve(rows, residual)[..., : run.nv]
        for k, change in enumerate(changes):
            if change.rates is not None:
                slopes[:, k, : run.nz] = change.rates[rows]
            if change.stretch.any():
                stretch = np.repeat(change.stretch[steps], run.s)
                slopes[:, k] += stretch[:, None] * self.slopes[rows]
        return slopes.reshape(-1, run.s, *slopes.shape[1:])

    def _shifts(self, steps: slice, changes: Sequence[ParameterChange]) -> Array:
        """Direct changes of the states after the projections of some steps, (steps,
        columns, nz + nv).
        """
        run, projection = self.run, self._projection
        shifts = np.zeros((steps.stop - steps.start, len(changes), run.nz + run.nv))
        G, rates, Z = (x[steps] for x in (projection.G, projection.rates, projection.Z))
        given = np.stack([c.constraint[steps] for c in changes], axis=1)
        tangent = -given[..., : run.m] @ G
        speeds = given[..., run.m :] + tangent @ rates
        shifts[: len(G), :, : run.nz] = tangent @ Z.transpose(0, 2, 1)
        shifts[: len(G), :, run.nz :] = -speeds @ G
        return shifts

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
        parts = np.einsum("pk,nprc->nkcr", self._points, table)
        gradient = AdjointGradient(
            slopes=np.zeros((run.n_steps * run.s, count, nz + nv)),
            residual=np.zeros((run.n_steps * run.s, nv + run.m, count)),
            constraint=np.zeros((run.n_steps - 1, 2 * run.m, count)),
            start=np.zeros((nz + nv, count)),
            derivatives=self,
        )
        current = np.zeros((count, nz + nv))
        for steps in reversed(run.blocks()):
            if not (current.any() or parts[steps].any()):
                continue  # after the last time of a functional
            self._adjoint_block(steps, parts[steps], current, gradient)
        gradient.start[:] = current.T
        return gradient

    def _adjoint_block(
        self, steps: slice, seeds: Array, current: Array, gradient: AdjointGradient
    ) -> None:
        """Fill the gradients of some steps.

        Parameters
        ----------
        seeds : (steps, s + 1, columns, nz + nv) by starts and stages
        current : (columns, nz + nv) by the start of the next step, which is replaced by
            that of the first one
        """
        run, rows, nz = self.run, self.run.stage_rows(steps), self.run.nz
        by_slopes, nexts = run.march(
            *(steps, self._projection_derivatives(steps), seeds[:, 1:]),
            *(seeds.sum(axis=1), current),
            backward=True,
        )
        self._add_constraints(steps, nexts.transpose(0, 2, 1), gradient)
        by_slopes = by_slopes.transpose(0, 2, 1, 3).reshape(-1, *current.shape)
        gradient.slopes[rows] = by_slopes
        columns = np.zeros((len(by_slopes), len(current), run.nv + run.m))
        columns[..., : run.nv] = by_slopes[..., nz:]
        solved = run.solve_transposed(rows, columns)
        gradient.residual[rows] = -solved.transpose(0, 2, 1)

    def _projection_derivatives(self, steps: slice) -> Array:
        """Derivatives of the projections at the ends of steps by the states before
        them, (steps, nz + nv, nz + nv).
        """
        projection, nz = self._projection, self.run.nz
        parts = projection.C, projection.G, projection.rates
        C, G, rates = (part[steps] for part in parts)
        Z, to_tangent = projection.Z[steps], projection.to_tangent[steps]
        size = nz + self.run.nv
        keeps = np.eye(self.run.nv) - G.transpose(0, 2, 1) @ C
        by_tangent = keeps @ to_tangent
        found = np.zeros((len(C), size, size))
        found[:, :nz, :nz] = Z @ by_tangent
        found[:, nz:, :nz] = -(rates @ G).transpose(0, 2, 1) @ by_tangent
        found[:, nz:, nz:] = keeps
        return found

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
