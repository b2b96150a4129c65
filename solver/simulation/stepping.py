"""Steps over smooth intervals: the part that runs and plants have in common."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic

from ..diagnostics.failure_causes import dead_point_causes, singular_start_causes
from ..initial_state.given_state import store_rotations
from ..integrators import loop_state, newton_iteration, output_sampling
from ..integrators.registry import INTEGRATORS, StepFunction
from ..integrators.singular_configurations import NEAR_SINGULAR
from ..output import events
from ..system.control_laws import law_failure
from ..system.sensors import SampledLaws
from ..system.work_arrays import raise_pending
from .preparation import OutputPlan, RunArrays, RunStart


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
