"""The steps of a run over its smooth intervals, and what is looked at between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Sink

from .account import failure_of
from .advice.dead_points import undecided
from .advice.prepared import Prepared
from .advice.stopping import singular
from .equations.pointers import kernels
from .integrators import INTEGRATORS, Advance, newton_steps, recording, stepping
from .integrators.singular import NEAR
from .linear.memory import Memory
from .recorder import Recorder
from .recording import dense, events
from .recording.energy_history import History, is_wanted
from .recording.grip_choice import with_grips
from .recording.resuming import Past, rows_before
from .recording.sampling import Sampler
from .recording.stick_slip import StickSlip
from .recording.window import Window
from .space.layout import Work
from .start.new_control import closed_below, new_control
from .start.settings import Settings
from .start.turn_counts import keep_turns
from .system.forces.lapses import lapse
from .system.forces.samples import SampledTimes, Samplers
from .system.kernel_calls import go_on
from .system.storage import new_memory, new_work

#: Steps between two reports of progress.
CHUNK = 500

Progress = Callable[[float], None]


class Run:
    """Storage and step function of one run."""

    def __init__(
        self,
        ready: Prepared,
        settings: Settings,
        told: Iterable[str],
        sink: Sink,
        past: Past | None,
    ) -> None:
        system = with_grips(ready.system)
        self.system, self.settings, self.start = system, settings, ready.start
        self.ready, self.told = ready, told
        methods = [INTEGRATORS[name] for name in settings.possible]
        self.method, self.switched = methods[0], math.nan
        self.work: Work = new_work(system)
        self.memory: Memory = new_memory(system, max(m.pairs for m in methods))
        self.kernels = kernels(system.planar)
        self.times = SampledTimes(system)
        self.samplers = Samplers(system)
        self.closed = closed_below(system, settings)
        points = dense.points(max(m.dense for m in methods))
        self.watch = None
        if system.scene.events:
            self.watch = events.Watch(system, self.closed, points)
        history = None
        if is_wanted(system.scene):
            sums = None if past is None else past.sums
            history = History(Sampler(system, self.closed), points, sums)
        self.stick = None
        if system.rubbing:
            self.stick = StickSlip(system, self.closed, points, settings.rtol)
        self.inside = not (self.watch is self.stick is history is None)
        most = len(self.times) + 1
        self.recorder = Recorder(
            system,
            self.closed,
            lambda: ready.expected,
            history,
            sink,
            most,
        )
        shares, self.limit = np.zeros(0), CHUNK
        if self.inside:
            shares, self.limit = points.wanted(), dense.CHUNK
        elif system.flexible:
            shares = dense.wanted_ends(fixed=settings.step is not None)
            self.limit = dense.END_CHUNK
        self.points = points
        self.window = Window(self.times, system.n_positions + system.n_velocities)
        begin = ready.start if past is None else past.start
        self.control = new_control(
            system, settings, begin, self.window.size, shares, self.closed
        )
        if past is not None:
            self._go_on_from(past)
        self.window.fill(self.control)
        self.breaks: list[events.Moment] = []
        self.taken = [0, 0]
        self.enters = False
        self.advance = self._prepare()

    def _prepare(self) -> Advance:
        return self.method.prepare(
            self.system, self.kernels, self.work, self.memory, self.control
        )

    def _go_on_from(self, past: Past) -> None:
        """The rows, times and events of an unfinished run are behind this one."""
        self.control.time = self.control.begin = past.t
        rows = rows_before(past)
        self.window.skip(sum(len(part.t) for part in rows))
        for part in rows:
            self.recorder.recall(part)
        if self.watch is not None:
            for event in past.done.events:
                if event.name in self.watch.counts:
                    self.watch.counts[event.name] += 1

    def go(
        self, progress: Progress | None, asked: Callable[[], str] | None = None
    ) -> str:
        """Integrates over all smooth intervals; the reason if one is not finished.

        asked : why to end before, if at all
        """
        self.asked = asked
        for stop in self.system.breaks:
            if stop <= self.now:
                continue
            failure = self._enter(stop)
            code = stepping.CHUNK
            while code == stepping.CHUNK and not failure:
                code = self._steps()
                if self.watch is not None and self.watch.ended:
                    return ""
                if self._is_hard(code):
                    self._switch()
                    self.enters = True
                if self.enters:
                    failure, code = self._enter(stop), stepping.CHUNK
                if progress is not None:
                    progress(self.now)
                why = asked() if asked is not None and code == stepping.CHUNK else ""
                if why and not failure:
                    return f"{why} at t = {self.now:.9g} s"
            if failure:
                return failure
            if code != stepping.REACHED:
                return failure_of(self, code)
            self._note_breaks(stop)
        return ""

    def _steps(self) -> int:
        """Makes some steps, however many output times lie in them; why they end."""
        left = self.limit
        while True:
            before = self.memory.steps
            most = left if self.stick is None else min(left, self.stick.stride)
            code = self.advance(self.control, most)
            go_on(self.system)
            left -= self.memory.steps - before
            self._look_inside()
            if self.enters or (self.watch is not None and self.watch.ended):
                return code
            full = code == stepping.FULL
            if full or self.recorder.is_waiting:
                rows = self.window.reached(self.control)
                self.recorder.take(*rows, self._moments())
                self.control = self.window.go_on(self.control, full)
            if not full:
                return code
            if self.asked is not None and self.asked():
                left = 1  # so many rows may lie in all of them that it lasts minutes

    def _moments(self) -> list[events.Moment]:
        """Breaks and events that were not asked for before."""
        kinds = self.breaks, self.watch.moments if self.watch else []
        new = [m for kind, k in zip(kinds, self.taken, strict=True) for m in kind[k:]]
        self.taken = [len(kind) for kind in kinds]
        return sorted(new, key=lambda moment: moment.t)

    def end(self, failed: bool) -> None:
        """Hands over the rest, and last the state where the run ended early."""
        t, z, v = self.window.reached(self.control)
        last = None
        if self.watch is not None and self.watch.ended:
            last = self.watch.moments[-1]
        elif failed and np.isfinite([*self.control.z, *self.control.v]).all():
            last = events.Moment("", "stop", self.now, self.control.z, self.control.v)
        if last is not None:
            self.recorder.forget_after(last.t)
            count = int(np.searchsorted(t, last.t))
            t, z, v = (
                np.concatenate([rows[:count], np.array([end])])
                for rows, end in ((t, last.t), (z, last.z), (v, last.v))
            )
        if failed:
            t, z, v = self.recorder.known(t, z, v)
        self.recorder.take(t, z, v, self._moments())

    @property
    def now(self) -> float:
        """Time that was reached [s]."""
        return self.control.time

    def _is_hard(self, code: int) -> bool:
        """Whether another method has to go on: stiffness, or a singular position."""
        waits = self.settings.when_stiff and math.isnan(self.switched)
        if not waits or code not in (stepping.CHUNK, stepping.CRAWLING):
            return False
        if self.control.crossing == NEAR:
            return True
        stiff = self.control.stiff_steps
        return bool(stepping.STIFF_PART * stiff > self.memory.steps)

    def _switch(self) -> None:
        """Goes on from here with the method for hard scenes."""
        self.method, self.switched = INTEGRATORS[self.settings.when_stiff], self.now
        self.advance = self._prepare()

    def _note_breaks(self, t: float) -> None:
        """Keeps the state where drives or forces are not smooth."""
        z, v = self.control.z.copy(), self.control.v.copy()
        for name in self.system.causes.get(t, ()):
            self.breaks.append(events.Moment(name, "break", t, z, v))

    def _look_inside(self) -> None:
        """Keeps what is wanted of the last steps, and looks for events in them."""
        if not self.inside:
            self.recorder.visit(dense.taken_ends(self.control))
            return
        steps = dense.taken(self.control)
        if self.stick is not None:
            steps = self.stick.until_change(self.control, steps)
            self.enters = self.stick.waits
        self.recorder.visit(self.points.ends(steps))
        if self.recorder.history is not None:
            self.recorder.history.add(steps)
        if self.watch is not None:
            self.watch.look(steps)

    def _enter(self, end: float) -> str:
        """Starts a smooth interval, with no memory of steps before; why it cannot, or
        nothing."""
        self.enters = False
        failure = self._grip()
        if failure:
            return failure
        control, begin = self.control, self.now
        control.stop = end
        control.old_step = 0.0
        control.factored_step = 0.0
        control.frontier = np.inf
        control.well = newton_steps.OFTEN
        control.needs_jacobian = 1
        control.predict = 0
        self.work.clock[0] = 0.5 * (begin + end)
        if self.settings.step is not None:
            count = max(1, int(np.ceil((end - begin) / self.settings.step - 1e-9)))
            control.step = (end - begin) / count
        status = self._begin()
        if status == 0 and self.samplers.take(self.work, begin, control.v):
            failure = self._grip()
            if failure:
                return failure
            status = self._begin()
        said = lapse(self.system, self.work, since=begin)
        if said and begin == self.system.scene.time.start:
            raise InputError(said, place="forces", expected="a number at the start")
        if said:
            return f"stopped at t = {begin:.9g} s: {said}"
        if status != 0:
            return singular(self.system, self.work, begin, status)
        keep_turns(self.system, self.work, control.z)
        control.measured[:, :2] = self.work.measure
        return ""

    def _grip(self) -> str:
        """Chooses what sticks from now on; why there is no choice, or nothing."""
        if self.stick is None:
            return ""
        why, moments = self.stick.enter(self.now, self.control.z, self.control.v)
        self.breaks += moments
        if why:
            why += undecided(self.system, self.now, self.control.z, self.control.v)
        return f"stopped at t = {self.now:.9g} s: {why}" if why else ""

    def _begin(self) -> int:
        """Evaluates the state in hand; 0, or the code of a singular system."""
        status: int = recording.begin(
            self.kernels,
            self.system.arrays,
            self.work,
            self.memory,
            self.now,
            self.control.z,
            self.control.v,
        )
        go_on(self.system)
        return status
