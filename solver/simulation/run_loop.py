"""Step loop of a run over smooth intervals; events and friction between steps."""

from collections.abc import Callable, Iterator

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose

from ..integrators import loop_state
from ..output import dense_output, events
from ..output.resume import ResumeState, previous_rows
from ..system.work_arrays import raise_pending
from .preparation import OutputPlan, RunArrays, RunStart
from .recorder import Recorder
from .stepping import Stepper, Stop

Progress = Callable[[float], None]


class Run(Stepper):
    """Step loop of one run, with its rows and events."""

    def __init__(
        self, start: RunStart, plan: OutputPlan, arrays: RunArrays, recorder: Recorder
    ) -> None:
        super().__init__(start, plan, arrays)
        self.recorder, self.window = recorder, arrays.window
        if start.resume is not None:
            self._skip_previous_rows(start.resume)
        self.window.fill_next(self.control)
        self.step_counts = [0, 0]

    def _skip_previous_rows(self, resume: ResumeState) -> None:
        """Take the rows, times and events of an unfinished run as done."""
        rows = previous_rows(resume)
        self.window.skip(sum(len(part.t) for part in rows))
        for part in rows:
            self.recorder.add_previous_rows(part)
        counts = {} if self.event_detector is None else self.event_detector.counts
        for event in resume.done.events:
            if event.name in counts:
                counts[event.name] += 1

    def integrate(
        self, progress: Progress | None, stop_requested: Callable[[], str] | None = None
    ) -> Stop | None:
        """Integrate over all smooth intervals.

        Parameters
        ----------
        stop_requested
            Returns why to stop early, or an empty string.

        Returns
        -------
        why an interval is not finished, None if all are or an event ends the run
        """
        self.stop_requested = stop_requested
        for stop in self.system.breaks:
            if stop <= self.current_time:
                continue
            failure = self.enter_interval(stop)
            code = loop_state.STEPS_DONE
            while code == loop_state.STEPS_DONE and not failure:
                code = self._make_steps()
                if self._last_event is not None:
                    return None
                if self.needs_stiff_method(code):
                    self.switch_method()
                    self.needs_new_interval = True
                if self.needs_new_interval:
                    failure, code = self.enter_interval(stop), loop_state.STEPS_DONE
                if progress is not None:
                    progress(self.current_time)
                why = (
                    stop_requested()
                    if stop_requested is not None and code == loop_state.STEPS_DONE
                    else ""
                )
                if why and not failure:
                    ended = diagnose("N319", t=self.current_time, reason=why)
                    return Stop((ended,))
            if failure:
                return Stop(failure)
            if code != loop_state.INTERVAL_END:
                return Stop(code=code)
            self._record_breaks(stop)
        return None

    def _make_steps(self) -> int:
        """Make some steps, however many output times they contain; returns why they
        end.
        """
        left = self.plan.step_limit
        while True:
            before = self.memory.steps
            most = (
                left
                if self.stick_slip_events is None
                else min(left, self.stick_slip_events.stride)
            )
            code = self.step_function.advance(self.control, most)
            raise_pending(self.system)
            left -= self.memory.steps - before
            self._process_steps()
            if self.needs_new_interval or self._last_event is not None:
                return code
            full = code == loop_state.OUTPUT_FULL
            if full or self.recorder.has_pending:
                rows = self.window.reached_states(self.control)
                self.recorder.take_rows(*rows, self._new_events())
                self.control = self.window.continue_after(self.control, full)
            if not full:
                return code
            if self.stop_requested is not None and self.stop_requested():
                left = 1  # so many rows may lie in all of them that it lasts minutes

    def _new_events(self) -> list[events.LocatedEvent]:
        """Breaks and events that were not requested before."""
        kinds = (
            self.breaks,
            self.event_detector.events_found if self.event_detector else [],
        )
        new = [
            m for kind, k in zip(kinds, self.step_counts, strict=True) for m in kind[k:]
        ]
        self.step_counts = [len(kind) for kind in kinds]
        return sorted(new, key=lambda moment: moment.t)

    def finish(self, failed: bool) -> None:
        """Hands over the rest, and last the state where the run ended early."""
        t, z, v = self.window.reached_states(self.control)
        last = self._last_event
        if (
            last is None
            and failed
            and np.isfinite([*self.control.z, *self.control.v]).all()
        ):
            last = events.LocatedEvent(
                "", "stop", self.current_time, self.control.z, self.control.v
            )
        if last is not None:
            self.recorder.discard_after(last.t)
            count = int(np.searchsorted(t, last.t))
            t, z, v = (
                np.concatenate([rows[:count], np.array([end])])
                for rows, end in ((t, last.t), (z, last.z), (v, last.v))
            )
        if failed:
            t, z, v = self.recorder.finite_rows(t, z, v)
        self.recorder.take_rows(t, z, v, self._new_events())

    def known_states(self) -> Iterator[tuple[Array, Array]]:
        """Positions and velocities of known states, the last one first."""
        yield self.control.z, self.control.v
        _, z, v = self.window.reached_states(self.control)
        yield from zip(z[::-1], v[::-1], strict=True)
        yield self.recorder.sound or (self.start.initial.z, self.start.initial.v)

    @property
    def _last_event(self) -> events.LocatedEvent | None:
        """The last event if an event of the scene has ended the run, else None."""
        detector = self.event_detector
        if detector is None or not detector.stopping_event:
            return None
        return detector.events_found[-1]

    def _record_breaks(self, t: float) -> None:
        """Store the state where drives or forces are not smooth."""
        z, v = self.control.z.copy(), self.control.v.copy()
        for name in self.system.break_causes.get(t, ()):
            self.breaks.append(events.LocatedEvent(name, "break", t, z, v))

    def _process_steps(self) -> None:
        """Stores what is wanted of the last steps, and looks for events in them."""
        if not self.plan.looks_inside_steps:
            self.recorder.add_step_ends(dense_output.take_step_ends(self.control))
            return
        steps = dense_output.take_steps(self.control)
        if self.stick_slip_events is not None:
            steps = self.stick_slip_events.steps_until_change(self.control, steps)
            self.needs_new_interval = self.stick_slip_events.needs_decision
        self.recorder.add_step_ends(self.points.step_ends(steps))
        if self.recorder.history is not None:
            self.recorder.history.add(steps)
        if self.event_detector is not None:
            self.event_detector.find_events(steps)
