"""Step loop of a run over smooth intervals; events and friction between steps.

Steps over smooth intervals: the part that runs and plants have in common.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..diagnostics.failure_causes import dead_point_causes, singular_start_causes
from ..initial_state.given_state import store_rotations
from ..integrators import loop_state, newton_iteration, output_sampling
from ..integrators.registry import INTEGRATORS, StepFunction
from ..integrators.singular_configurations import NEAR_SINGULAR
from ..output import dense_output, events
from ..output.resume import ResumeState, previous_rows
from ..system.control_laws import law_failure
from ..system.sensors import SampledLaws
from ..system.work_arrays import raise_pending
from .preparation import OutputPlan, RunArrays, RunStart
from .recorder import Recorder

Progress = Callable[[float], None]


class Stop(NamedTuple):
    """Why a run ends before its time: diagnostics, or the code of a step loop."""

    causes: tuple[Diagnostic, ...] = ()
    code: int | None = None


class Stepper:
    """Steps of one integrator after the other over the smooth intervals of a scene.

    Attributes
    ----------
    control : state of the step loop
    method : integrator in use
    switch_time : time at which the method for stiff scenes took over [s], or NaN
    needs_new_interval : True if a smooth interval has to begin before the next step
    breaks : breaks of functions and changes of friction states so far
    """

    def __init__(self, start: RunStart, plan: OutputPlan, arrays: RunArrays) -> None:
        self.start, self.plan = start, plan
        self.system, self.settings = start.system, start.settings
        self.work, self.memory = arrays.work, arrays.memory
        self.kernels, self.control = arrays.kernels, arrays.control
        self.event_detector, self.points = plan.event_detector, plan.points
        self.stick_slip_events = plan.stick_slip_events
        self.method, self.switch_time = start.methods[0], math.nan
        self.samplers = SampledLaws(self.system)
        self.breaks: list[events.LocatedEvent] = []
        self.needs_new_interval = False
        self.step_function = self._prepare()

    def _prepare(self) -> StepFunction:
        return self.method.prepare(
            self.system, self.kernels, self.work, self.memory, self.control
        )

    @property
    def current_time(self) -> float:
        """Time that was reached [s]."""
        return self.control.time

    def known_states(self) -> Iterator[tuple[Array, Array]]:
        """Positions and velocities of known states, the last one first."""
        yield self.control.z, self.control.v
        yield self.start.initial.z, self.start.initial.v

    def needs_stiff_method(self, code: int) -> bool:
        """True if another method has to go on: stiffness, or a singular
        configuration.
        """
        waits = self.settings.when_stiff and math.isnan(self.switch_time)
        if not waits or code not in (loop_state.STEPS_DONE, loop_state.TOO_STIFF):
            return False
        if self.control.singular_proximity == NEAR_SINGULAR:
            return True
        stiff = self.control.stiff_steps
        return bool(loop_state.STIFF_STEP_FRACTION * stiff > self.memory.steps)

    def switch_method(self) -> None:
        """Continue with the method for stiff scenes."""
        self.switch_time = self.current_time
        self.use_method(self.settings.when_stiff)

    @property
    def method_name(self) -> str:
        """Name of the integrator in use."""
        return next(name for name, m in INTEGRATORS.items() if m is self.method)

    def use_method(self, name: str) -> None:
        """Continue with an integrator, unless it is in use."""
        if INTEGRATORS[name] is not self.method:
            self.method = INTEGRATORS[name]
            self.step_function = self._prepare()

    def contents(self) -> Iterator[np.ndarray]:
        """What kernels may change of the motion and of the integrator."""
        for table in (
            self.control,
            self.work,
            self.memory,
            self.step_function.storage,
        ):
            yield from table.contents()
        if self.stick_slip_events is not None:
            yield self.stick_slip_events.friction_state

    def enter_interval(self, end: float) -> tuple[Diagnostic, ...]:
        """Start a smooth interval without memory of earlier steps.

        Returns why it cannot start, if so.
        """
        self.needs_new_interval = False
        failure = self._decide_friction()
        if failure:
            return failure
        control, begin = self.control, self.current_time
        control.stop = end
        control.old_step = 0.0
        control.factored_step = 0.0
        control.newton_step_limit = np.inf
        control.steps_since_failure = newton_iteration.FREQUENT_FAILURES
        control.needs_jacobian = 1
        control.stage_prediction = 0
        self.work.interval_time[0] = 0.5 * (begin + end)
        self.set_fixed_step(begin, end)
        status = self._evaluate_start()
        if status == 0 and self.samplers.take_samples(self.work, begin, control.v):
            failure = self._decide_friction()
            if failure:
                return failure
            status = self._evaluate_start()
        invalid = law_failure(self.system, self.work, begin, since=begin)
        if invalid and begin == self.system.scene.time.start:
            raise InputError(
                invalid.message, place="forces", expected="a number at the start"
            )
        if invalid:
            return (invalid,)
        if status != 0:
            return singular_start_causes(
                self.system, self.work, begin, control.z, status
            )
        store_rotations(self.system, self.work, control.z)
        control.force_measures[:, :2] = self.work.measure
        return ()

    def set_fixed_step(self, begin: float, end: float) -> None:
        """Choose fixed steps between two times [s], if steps are fixed."""
        if self.settings.step is not None:
            count = max(1, int(np.ceil((end - begin) / self.settings.step - 1e-9)))
            self.control.step = (end - begin) / count

    def _decide_friction(self) -> tuple[Diagnostic, ...]:
        """Decide the friction states; returns why there is no decision, if so."""
        if self.stick_slip_events is None:
            return ()
        reason, located = self.stick_slip_events.enter_interval(
            self.current_time, self.control.z, self.control.v
        )
        self.breaks += located
        if reason is None:
            return ()
        state = self.current_time, self.control.z, self.control.v
        return (reason, *dead_point_causes(self.system, *state))

    def _evaluate_start(self) -> int:
        """Evaluates the state in hand; 0, or the code of a singular system."""
        status: int = output_sampling.evaluate_start(
            self.kernels,
            self.system.arrays,
            self.work,
            self.memory,
            self.current_time,
            self.control.z,
            self.control.v,
        )
        raise_pending(self.system)
        return status


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
