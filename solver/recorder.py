"""What a run records, block by block: rows for a sink, and what is told of all rows."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from sidtool.formats.result import Event, FlexibleBody
from sidtool.formats.result.bodies import LARGE, LARGE_ROTATION
from sidtool.formats.result.rows import BLOCK, Rows, Sink
from sidtool.formats.sid import Array

from .advice.body_measures import bound_deformation
from .advice.verdicts import Verdicts
from .recording import outputs
from .recording.dense import Steps, joined
from .recording.energy_history import History
from .recording.events import Moment, events_of
from .recording.sampling import Sampler
from .space import layout as at
from .system.scene import System

#: Ends of steps that wait for the rows between them, and coordinates of their states.
MOST_WAITING, MOST_NUMBERS = 4096, 1_000_000


class Recorder:
    """Takes states at output times, ends of steps and events in the order of time.

    Attributes
    ----------
    columns : names of the columns of each table
    events : those so far
    seconds : spent here
    sound : positions and velocities of the last row before any body left linear theory
    """

    def __init__(
        self,
        system: System,
        closed: Array,
        expect: Callable[[], Mapping[str, FlexibleBody]],
        history: History | None,
        sink: Sink,
        most: int,
    ) -> None:
        """expect : what is said of flexible bodies before the run
        most : rows that there may be
        """
        self.system, self.sampler = system, Sampler(system, closed)
        self.history, self.sink = history, sink
        self.verdicts, self._bends = Verdicts(system, expect), bool(system.flexible)
        self.events: list[Event] = []
        self.seconds, self._waiting, self._ends = 0.0, list[Steps](), 0
        self._last = -np.inf
        self.sound: tuple[Array, Array] | None = None
        self._largest = np.zeros(system.n_positions)
        self.columns = system.lasting(_names_of_columns)
        sink.begin(self.columns, most)

    def recall(self, rows: Rows) -> None:
        """Rows that a run before this one recorded."""
        self.sink.add(rows)
        z, v = (rows.tables[name].copy() for name in ("positions", "velocities"))
        self._note_largest(z)
        if len(rows.t) and not self.system.rubbing:
            found = self._record(rows.t.copy(), z, v)
            self.verdicts.recall(found.samples, rows.t)
        self._last = float(rows.t[-1]) if len(rows.t) else self._last

    def visit(self, ends: Steps) -> None:
        """Ends of some steps."""
        if self._bends and len(ends.t):
            self._note_largest(ends.z)
            self.verdicts.visit(ends)
            self._waiting.append(ends)
            self._ends += len(ends.t)

    @property
    def is_waiting(self) -> bool:
        """Whether `take` should be called with what there is."""
        numbers, history = self._ends * self.system.n_positions, self.history
        if self._ends > MOST_WAITING or numbers > MOST_NUMBERS:
            return True
        return history is not None and history.is_long

    def take(self, t: Array, z: Array, v: Array, moments: Sequence[Moment]) -> None:
        """All rows and events until now; z and v are projected."""
        began = time.perf_counter()
        if self.verdicts.waits:
            t, z, v = t.copy(), z.copy(), v.copy()
        for first in range(0, len(t), BLOCK):  # a step may hold any number of rows
            rows = [table[first : first + BLOCK] for table in (t, z, v)]
            self._add(self._record(*rows), *rows)
        self._go_on(t, z, v)
        if moments:
            self.events += events_of(moments, self._record)
        if self.history is not None:
            self.history.forget()
        self.seconds += time.perf_counter() - began

    def forget_after(self, end: float) -> None:
        """The run ended before the end of its last step."""
        self._waiting = [_until(steps, end) for steps in self._waiting]

    def known(self, t: Array, z: Array, v: Array) -> tuple[Array, Array, Array]:
        """Where a run failed: no row twice, and no last one without accelerations."""
        if len(t) and t[-1] > self._last:
            found = self._record(t[-1:], z[-1:], v[-1:])
            if np.isfinite(found.samples.accelerations).all():
                return t, z, v
        return t[:-1], z[:-1], v[:-1]

    def _record(self, t: Array, z: Array, v: Array) -> outputs.Recorded:
        return outputs.record(self.sampler, t, z, v, self.history)

    def _add(self, found: outputs.Recorded, t: Array, z: Array, v: Array) -> None:
        tables = {
            "values": found.values,
            "positions": z,
            "velocities": v,
            "multipliers": found.multipliers,
        }
        self.sink.add(Rows(t, tables))
        self.verdicts.add(found, t)
        self._note_largest(z)
        if self._bends and not self.may_exceed(LARGE, LARGE_ROTATION):
            self.sound = z[-1].copy(), v[-1].copy()
        self._last = float(t[-1])

    def _go_on(self, t: Array, z: Array, v: Array) -> None:
        """Rows and ends of steps together, for what is meant over time."""
        if not self._bends:
            return
        ends = joined(self._waiting) if self._waiting else Steps(t[:0], z[:0], v[:0])
        self._waiting, self._ends = [], 0
        times, states = np.concatenate([t, ends.t]), np.concatenate([z, ends.z])
        order = np.argsort(times, kind="stable")
        for first in range(0, len(order), BLOCK):
            rows = order[first : first + BLOCK]
            self.verdicts.go_on(times[rows], states[rows])

    def _note_largest(self, z: Array) -> None:
        """Keeps the largest coordinates of finite states z (nt, positions)."""
        largest = np.nan_to_num(np.abs(z), posinf=0.0).max(axis=0, initial=0.0)
        np.maximum(self._largest, largest, out=self._largest)

    def may_exceed(self, deflection: float, rotation: float) -> bool:
        """Whether a body may have deformed by more in the run; False is certain.

        deflection : elastic displacement over the size of the body
        rotation : elastic rotation [rad]
        """
        for data in self.system.flexible:
            row = self.system.arrays.body[self.system.index(data.name)]
            end = int(row[at.POS] + row[at.NP])
            largest = self._largest[end - int(row[at.NQ]) : end]
            bounds = bound_deformation(data.sid, largest)
            if bounds[0] > deflection or bounds[1] > rotation:
                return True
        return False

    @cached_property
    def bodies(self) -> dict[str, FlexibleBody]:
        """What flexible bodies met in the run, which has ended, at output times and at
        the ends of steps."""
        reached = self.verdicts.found.reached
        if self._bends and np.isfinite(self._last):
            for ends in self.verdicts.found.visited.until(self._last):
                reached.add(self.sampler.sample(ends.t, ends.z, ends.v), ends.t)
        return reached.all()


def _names_of_columns(system: System) -> dict[str, tuple[str, ...]]:
    """Of the tables of a run, by their names."""
    return {
        "values": system.scene.outputs.record,
        "positions": outputs.position_names(system),
        "velocities": outputs.velocity_names(system),
        "multipliers": outputs.multiplier_names(system),
    }


def _until(steps: Steps, end: float) -> Steps:
    before = steps.t <= end
    return Steps(steps.t[before], steps.z[before], steps.v[before])
