"""Recorder of a run: rows for a sink, block by block, and diagnostics of all rows."""

import time
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Event, FlexibleBody
from sidtool.formats.result.accuracy_report import MAX_DEFLECTION, MAX_ROTATION
from sidtool.formats.result.data import ROWS_PER_BLOCK, Rows, Sink

from ..diagnostics.body_loads import deformation_bounds
from ..diagnostics.geometric_stiffening import softening_bound
from ..diagnostics.run_summary import RunDiagnostics
from ..output import columns
from ..output.dense_output import StepStates, join_steps
from ..output.energies import EnergyIntegrals
from ..output.events import LocatedEvent, complete_events
from ..output.samples import StateSampler
from ..spatial import system_arrays as at
from ..system.system import GROUND_NAME, System
from .preparation import RunStart

#: Ends of steps that wait for the rows between them, and coordinates of their states.
MAX_PENDING_STEPS, MAX_PENDING_NUMBERS = 4096, 1_000_000


class Recorder:
    """Takes states at output times, ends of steps and events in the order of time.

    Attributes
    ----------
    columns
        Names of the columns of each table.
    events
        Those so far.
    seconds
        Spent here.
    sound
        Positions and velocities of the last row before any body left linear theory.
    """

    def __init__(
        self, start: RunStart, history: EnergyIntegrals | None, sink: Sink
    ) -> None:
        system = start.system
        self.system, self.sampler = system, StateSampler(system, start.tolerances)
        self.history, self.sink = history, sink
        self.verdicts, self._has_flexible_bodies = (
            RunDiagnostics(system, lambda: start.initialised.expected_bodies),
            bool(system.flexible),
        )
        self.events: list[Event] = []
        self.seconds, self._waiting, self._ends = 0.0, list[StepStates](), 0
        self._last = -np.inf
        self.sound: tuple[Array, Array] | None = None
        self._largest = np.zeros(system.n_positions), np.zeros(system.n_velocities)
        self.columns = system.cached_by_topology(_column_names)
        sink.begin(self.columns, len(start.times) + 1)

    def add_previous_rows(self, rows: Rows) -> None:
        """Rows that a run before this one recorded."""
        self.sink.add(rows)
        z, v = (rows.tables[name].copy() for name in ("positions", "velocities"))
        self._update_largest(z, v)
        if len(rows.t) and not self.system.friction_joints:
            found = self._record(rows.t.copy(), z, v)
            self.verdicts.add_previous_rows(found.samples, rows.t)
        self._last = float(rows.t[-1]) if len(rows.t) else self._last

    def add_step_ends(self, ends: StepStates) -> None:
        """Ends of some steps."""
        if self._has_flexible_bodies and len(ends.t):
            self._update_largest(ends.z, ends.v)
            self.verdicts.add_step_ends(ends)
            self._waiting.append(ends)
            self._ends += len(ends.t)

    @property
    def has_pending(self) -> bool:
        """True if `take` should be called with what there is."""
        numbers, history = self._ends * self.system.n_positions, self.history
        if self._ends > MAX_PENDING_STEPS or numbers > MAX_PENDING_NUMBERS:
            return True
        return history is not None and history.is_long

    def take_rows(
        self, t: Array, z: Array, v: Array, moments: Sequence[LocatedEvent]
    ) -> None:
        """All rows and events until now; z and v are projected."""
        started = time.perf_counter()
        if self.verdicts.has_pending:
            t, z, v = t.copy(), z.copy(), v.copy()
        for first in range(
            0, len(t), ROWS_PER_BLOCK
        ):  # a step may hold any number of rows
            rows = [table[first : first + ROWS_PER_BLOCK] for table in (t, z, v)]
            self._add(self._record(*rows), *rows)
        self._pass_to_diagnostics(t, z, v)
        if moments:
            self.events += complete_events(moments, self._record)
        if self.history is not None:
            self.history.drop_before()
        self.seconds += time.perf_counter() - started

    def discard_after(self, end: float) -> None:
        """The run ended before the end of its last step."""
        self._waiting = [_steps_until(steps, end) for steps in self._waiting]

    def finite_rows(self, t: Array, z: Array, v: Array) -> tuple[Array, Array, Array]:
        """Where a run failed: no row twice, and no last one without accelerations."""
        if len(t) and t[-1] > self._last:
            found = self._record(t[-1:], z[-1:], v[-1:])
            if np.isfinite(found.samples.accelerations).all():
                return t, z, v
        return t[:-1], z[:-1], v[:-1]

    def _record(self, t: Array, z: Array, v: Array) -> columns.RecordedOutputs:
        return columns.evaluate_outputs(self.sampler, t, z, v, self.history)

    def _add(
        self, found: columns.RecordedOutputs, t: Array, z: Array, v: Array
    ) -> None:
        tables = {
            "values": found.values,
            "positions": z,
            "velocities": v,
            "multipliers": found.multipliers,
        }
        self.sink.add(Rows(t, tables))
        self.verdicts.add(found, t)
        self._update_largest(z, v)
        if self._has_flexible_bodies and not self.may_exceed(
            MAX_DEFLECTION, MAX_ROTATION
        ):
            self.sound = z[-1].copy(), v[-1].copy()
        self._last = float(t[-1])

    def _pass_to_diagnostics(self, t: Array, z: Array, v: Array) -> None:
        """Pass rows and ends of steps together to the diagnostics over time."""
        if not self._has_flexible_bodies:
            return
        ends = (
            join_steps(self._waiting)
            if self._waiting
            else StepStates(t[:0], z[:0], v[:0])
        )
        self._waiting, self._ends = [], 0
        times, states = np.concatenate([t, ends.t]), np.concatenate([z, ends.z])
        order = np.argsort(times, kind="stable")
        for first in range(0, len(order), ROWS_PER_BLOCK):
            rows = order[first : first + ROWS_PER_BLOCK]
            self.verdicts.continue_after(times[rows], states[rows])

    def _update_largest(self, *states: Array) -> None:
        """Update the largest coordinates and velocities by finite states (nt, n)."""
        for known, rows in zip(self._largest, states, strict=True):
            largest = np.abs(rows).max(axis=0, initial=0.0)
            if not np.isfinite(largest).all():
                finite = np.nan_to_num(np.abs(rows), posinf=0.0)
                largest = finite.max(axis=0, initial=0.0)
            np.maximum(known, largest, out=known)

    def may_exceed(self, deflection: float, rotation: float) -> bool:
        """True if a body may have deformed by more in the run; False is certain.

        Parameters
        ----------
        deflection
            Elastic displacement over the size of the body.
        rotation
            Elastic rotation [rad].
        """
        for data in self.system.flexible:
            row = self.system.arrays.body[self.system.index(data.name)]
            end = int(row[at.POS] + row[at.NP])
            largest = self._largest[0][end - int(row[at.NQ]) : end]
            bounds = deformation_bounds(data.sid, largest)
            if bounds[0] > deflection or bounds[1] > rotation:
                return True
        return False

    def may_soften(self, share: float) -> bool:
        """True if loads may have changed the stiffness of a body by more than a part of
        it; False is certain.
        """
        planar, arrays = self.system.planar, self.system.arrays
        ground = self.system.index(GROUND_NAME)
        for data in self.system.flexible:
            row = arrays.body[self.system.index(data.name)]
            if row[at.RD] == (3 if planar else 6):
                end = int(row[at.VEL] + row[at.RD])
                speeds = self._largest[1][end - (1 if planar else 3) : end]
                square = float(speeds @ speeds)
            elif (
                row[at.MOTION] == at.FIXED
                and arrays.marker[row[at.BASE], at.M_BODY] == ground
            ):
                square = 0.0
            else:
                return True
            if not softening_bound(data.sid, planar) * square < share:
                return True
        return False

    @cached_property
    def bodies(self) -> dict[str, FlexibleBody]:
        """Loads and deformations of flexible bodies in the finished run.

        Output times and ends of steps are included.
        """
        extrema = self.verdicts.found.load_extrema
        if self._has_flexible_bodies and np.isfinite(self._last):
            for ends in self.verdicts.found.step_end_states.states_until(self._last):
                extrema.add(self.sampler.sample(ends.t, ends.z, ends.v), ends.t)
        return extrema.results()


def _column_names(system: System) -> dict[str, tuple[str, ...]]:
    """Of the tables of a run, by their names."""
    return {
        "values": system.scene.outputs.record,
        "positions": columns.position_names(system),
        "velocities": columns.velocity_names(system),
        "multipliers": columns.multiplier_names(system),
    }


def _steps_until(steps: StepStates, end: float) -> StepStates:
    before = steps.t <= end
    return StepStates(steps.t[before], steps.z[before], steps.v[before])
