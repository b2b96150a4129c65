"""A scene that a program advances step by step: inputs, time, state.

Steps have the length that the integrator chooses: they go over the time at which the
program looks, and the state there follows from the dense output of the step. Where an
input changes, the motion goes back to that time and a new smooth interval begins.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, without
from sidtool.formats.scene import Input

from ..diagnostics.body_loads import (
    deformation_limits,
    find_state_failure,
    find_state_warnings,
)
from ..diagnostics.run_summary import initialise
from ..initial_state.integrator_start import run_settings
from ..integrators import loop_state
from ..integrators.singular_configurations import NEAR_SINGULAR
from ..output import columns, dense_output
from ..output.dense_output import StepStates
from ..output.events import LocatedEvent
from ..output.samples import StateSampler
from ..output.stick_slip import with_friction_states
from ..system.errors import SimulationError
from ..system.system import System
from ..system.work_arrays import raise_pending
from .input_pieces import InputPiece, piece_to_goal
from .preparation import (
    OutputPlan,
    RunArrays,
    RunStart,
    allocate,
    compile_kernels,
    plan_whole_steps,
    prepare_run,
)
from .result import stop_causes
from .run_loop import Stepper, Stop

#: A time is a break of the motion if it lies within this part of the step to it.
BREAK_TOLERANCE = 1e-6
#: Times beyond the end of the scene by less than this part of its span are the end.
END_TOLERANCE = 1e-9


#: Attributes of a plant that are part of its state.
_ATTRIBUTES = (
    "switch_time",
    "needs_new_interval",
    "_input_changed",
    "_interval_end",
    "_unchecked_steps",
    "_steps",
    "_steps_without_events",
    "_failure",
    "_warned",
)


@dataclass(frozen=True, eq=False)
class PlantState:
    """State of a plant: that of the motion and of the integrator.

    Attributes
    ----------
    time : [s]
    contents : what kernels have in memory
    attributes : of the objects between the steps
    """

    time: float
    contents: tuple[np.ndarray, ...]
    attributes: Mapping[str, Any]


class PlantRun(Stepper):
    """Motion of a scene that is advanced to given times.

    Attributes
    ----------
    time : time that the program has reached [s]; the last step may end later
    events : events and changes of friction states until then
    stopping_event : name of the event that has ended the motion, or empty
    pieces : present polynomials of the inputs, by name
    """

    def __init__(
        self,
        start: RunStart,
        plan: OutputPlan,
        arrays: RunArrays,
        emit_warning: Callable[[Diagnostic], None],
    ) -> None:
        super().__init__(start, plan, arrays)
        self._emit_warning = emit_warning
        arrays.window.fill_next(self.control)
        self.sampler = StateSampler(self.system, start.tolerances)
        self.time = self.control.time
        self.pieces = {
            name: InputPiece.constant(self.time, signal.initial)
            for name, signal in self._signals.items()
        }
        self._goals = {name: piece.terms[0] for name, piece in self.pieces.items()}
        self._systems: list[System] = []
        self.follow_inputs(self.system)
        self.needs_new_interval = True
        self._input_changed = False
        self._interval_end = self.time
        self._unchecked_steps = 0
        self._steps: StepStates | None = None
        self._steps_without_events: StepStates | None = None
        self._failure: tuple[Diagnostic, ...] = ()
        self._warned: frozenset[str] = frozenset()
        self._limits = deformation_limits(self.system)

    @property
    def _signals(self) -> Mapping[str, Input]:
        return self.system.scene.inputs

    @property
    def end(self) -> float:
        """End of the scene [s]."""
        return self.system.breaks[-1]

    @property
    def stopping_event(self) -> str:
        detector = self.event_detector
        return "" if detector is None else detector.stopping_event

    @property
    def events(self) -> list[LocatedEvent]:
        detected = self.event_detector.events_found if self.event_detector else []
        located = [*self.breaks, *detected]
        return sorted(
            (e for e in located if e.t <= self.time), key=lambda event: event.t
        )

    # Inputs

    def follow_inputs(self, system: System) -> None:
        """Give the inputs to the tables of another system, too, from now on."""
        self._systems += [system, *([system.full_system] if system.full_system else [])]
        for name in self.pieces:
            self._write(name)

    def _write(self, name: str) -> None:
        """Write the polynomial of an input to the tables of functions."""
        piece = self.pieces[name]
        for system in self._systems:
            entries = system.input_data(name)
            system.arrays.real_data[entries] = piece.start, *piece.terms

    def set(self, name: str, value: float) -> None:
        """Set an input from now on: it jumps to a value if it is held, else it reaches
        the value at the end of the next call of `advance_to`."""
        self._goals[name] = value
        if self._signals[name].continuity > 0:
            return
        if self.pieces[name].terms[0] != value:
            self._input_changed = True
            self.pieces[name] = InputPiece.constant(self.time, value)
            self._write(name)

    def _choose_pieces(self, target: float) -> bool:
        """Choose the pieces of inputs without jumps until a time; returns True if one
        of them moves."""
        moves = False
        for name, signal in self._signals.items():
            before, goal = self.pieces[name], self._goals[name]
            if signal.continuity == 0 or (
                before.is_constant and before.terms[0] == goal
            ):
                continue
            piece = piece_to_goal(signal.continuity, self.time, target, before, goal)
            moves = self._input_changed = True
            self.pieces[name] = piece
            self._write(name)
        return moves

    # Outputs

    def observe(self, system: System) -> "Observer":
        """Return what evaluates the outputs of a system in the states of this one: of
        the same scene with other outputs.

        Raises
        ------
        InputError
            An output counts revolutions, from the start of the motion on.
        """
        if system is not self.system:
            system = system.cached(initialise).system
            if system.n_positions != self.system.n_positions:
                raise InputError(
                    "an output counts revolutions, which has to begin with the motion",
                    place="outputs",
                    expected="its name when the plant is made: plant(outputs=[...])",
                )
            system = with_friction_states(system, self.system.friction_history)
            self.follow_inputs(system)
        return Observer(self, system)

    # Steps

    def advance_to(self, target: float) -> None:
        """Advance the motion to a time [s], or to an event that ends it.

        Raises
        ------
        InputError
            The time lies before the present one or behind the end of the scene, or the
            motion has ended.
        SimulationError
            The motion cannot go on.
        """
        target = self._checked(target)
        ends_there = self.settings.step is not None or self._input_changed
        if target > self.time and self._signals:
            ends_there |= self._choose_pieces(target)
        if self._input_changed:
            self._return_to_present()
        control = self.control
        if self._find_events(target):
            return
        if self.settings.step is not None:
            self.set_fixed_step(control.time, min(target, self._interval_end))
        while control.time < target:
            if self.needs_new_interval:
                self._begin_interval(target)
            self._make_step(min(self._interval_end, target if ends_there else np.inf))
            self._check_deformations()
            if self._find_events(target):
                return
        self.time = target

    def _checked(self, target: float) -> float:
        """The time to advance to: a break of the motion if it is one but for rounding.

        Raises
        ------
        InputError
            See `advance_to`.
        """
        if self._failure:
            raise InputError(
                f"the motion has stopped: {self._failure[0].message}",
                place="advance",
                expected="`restore` or `reset` first",
            )
        if self.stopping_event:
            raise InputError(
                f"event {self.stopping_event} has ended the motion",
                place="advance",
                expected="`restore` or `reset` first",
            )
        if not target >= self.time:
            raise InputError(
                f"to t = {target:.9g} s from t = {self.time:.9g} s",
                place="advance",
                expected="a time that does not lie before the present one",
            )
        breaks, near = self.system.breaks, BREAK_TOLERANCE * (target - self.time)
        k = bisect_left(breaks, target - near)
        if k < len(breaks) and breaks[k] <= target + near:
            return max(breaks[k], self.time)
        if k < len(breaks):
            return target
        span = self.end - self.system.scene.time.start
        if target <= self.end + END_TOLERANCE * span:
            return self.end
        raise InputError(
            f"to t = {target:.9g} s, behind the end of the scene at {self.end:.9g} s",
            place="advance",
            expected="a later end in the scene: time.end",
        )

    def _return_to_present(self) -> None:
        """Go back to the present time, if the last step ends later, and have a new
        interval begin there."""
        control = self.control
        self._input_changed, self.needs_new_interval = False, True
        if self.time >= control.time:
            return
        z, v = self.state_vectors()
        self.sampler.sample(np.array([self.time]), z[None], v[None])
        control.time = self.time
        control.z[:], control.v[:] = z, v
        control.fraction_index, self._steps = 0, None
        if self.stick_slip_events is not None:
            self.stick_slip_events.discard_changes()

    def _begin_interval(self, target: float) -> None:
        """Begin a smooth interval; with fixed steps it ends at a time [s]."""
        breaks = self.system.breaks
        self._interval_end = breaks[bisect_right(breaks, self.control.time)]
        is_fixed = self.settings.step is not None
        end = min(self._interval_end, target) if is_fixed else self._interval_end
        self._unchecked_steps = 0
        failure = self.enter_interval(end)
        if failure:
            self._fail(Stop(failure))

    @contextmanager
    def started(self) -> Iterator[None]:
        """Within, friction states and sampled laws are decided at the start of the
        motion, with the inputs as they are; the plant itself still waits for them."""
        start = self.system.scene.time.start
        if self.time != start or not self.needs_new_interval or self._failure:
            yield
            return
        state = self.save()
        try:
            self._begin_interval(self.end)
            yield
        finally:
            self.restore(state)

    def _make_step(self, stop: float) -> None:
        """Make one step, not beyond a time [s]."""
        control = self.control
        control.stop, control.fraction_index, self._steps = stop, 0, None
        code = self.step_function.advance(control, 1)
        raise_pending(self.system)
        if code == loop_state.INTERVAL_END:
            control.time = stop  # rounding is left
        elif self._must_switch(code):
            self.switch_method()
            self.needs_new_interval = True
        elif code != loop_state.STEPS_DONE:
            self._fail(Stop(code=code))
        if self.stick_slip_events is not None and control.fraction_index:
            steps = dense_output.take_steps(control)
            self._steps = self.stick_slip_events.steps_until_change(control, steps)
            self.needs_new_interval |= self.stick_slip_events.needs_decision
        if control.time >= self._interval_end:
            self.needs_new_interval = True

    def _must_switch(self, code: int) -> bool:
        """True if the method for stiff scenes has to go on; asked as often as in runs,
        so that both make the same steps."""
        self._unchecked_steps += 1
        near_singular = self.control.singular_proximity == NEAR_SINGULAR
        if (
            code == loop_state.STEPS_DONE
            and self._unchecked_steps < self.plan.step_limit
            and not near_singular
        ):
            return False
        self._unchecked_steps = 0
        return self.needs_stiff_method(code)

    def _fail(self, stop: Stop) -> None:
        """End the motion.

        Raises
        ------
        SimulationError
            Always.
        """
        self._failure = stop_causes(self, stop)
        raise SimulationError(self._failure)

    def _find_events(self, target: float) -> bool:
        """Look for events until a time; returns True if one of them ends the motion.

        The time of the plant moves on to where it was looked. A step is looked at as a
        whole, once, and again in parts if there is an event in it.
        """
        detector = self.event_detector
        if detector is None:
            return False
        end = min(self.control.time, target)
        steps = self._last_steps()
        if not end > self.time or not len(steps.t):
            return False
        begin = max(self.time, steps.t[0])
        if steps is not self._steps_without_events:
            rest = steps
            if begin > steps.t[0]:
                rest = self.points.restrict(steps, begin, self.control.time)
            if detector.is_without_events(rest):
                self._steps_without_events = steps
        if steps is self._steps_without_events:
            self.time = end
            return False
        if begin > steps.t[0] or end < self.control.time:
            steps = self.points.restrict(steps, begin, end)
        self.time = end
        if detector.find_events(steps):
            self.time = detector.events_found[-1].t
            return True
        return False

    def _check_deformations(self) -> None:
        """Emit warnings of bodies that have left linear theory in the last step.

        Raises
        ------
        SimulationError
            A body has deformed by more than its size, so that numbers mean nothing.
        """
        z = self.control.z
        if not any(limit.may_exceed(z) for limit in self._limits):
            return
        states = z[None]
        failure = find_state_failure(self.system, states)
        if failure:
            self._failure = failure
            raise SimulationError(failure)
        found = without(
            find_state_warnings(self.system, states),
            self.system.scene.diagnostics.ignore,
        )
        for each in found:
            if each.subject not in self._warned:
                self._warned |= {each.subject}
                self._emit_warning(each)

    # States

    def _last_steps(self) -> StepStates:
        """Points of the last step."""
        if self._steps is None:
            self._steps = dense_output.take_steps(self.control)
        return self._steps

    def state_vectors(self) -> tuple[Array, Array]:
        """Positions and velocities at the present time, to the tolerance of the run."""
        if self.time < self.control.time and len(self._last_steps().t):
            return self.points.interpolate_state(self._last_steps(), self.time)
        return self.control.z.copy(), self.control.v.copy()

    def save(self) -> PlantState:
        """Return a copy of the state, from which `restore` goes on."""
        parts = [self.stick_slip_events, self.event_detector]
        attributes = {name: getattr(self, name) for name in _ATTRIBUTES}
        return PlantState(
            self.time,
            tuple(part.copy() for part in self.contents()),
            attributes
            | {
                "method": self.method_name,
                "breaks": tuple(self.breaks),
                "pieces": dict(self.pieces),
                "goals": dict(self._goals),
                "last_sample": self.samplers.last_time,
                "parts": [None if part is None else part.save() for part in parts],
            },
        )

    def restore(self, state: PlantState) -> None:
        """Go on from a state that `save` of this plant, or of one of the same scene and
        settings, has returned.

        Raises
        ------
        InputError
            It is the state of another scene.
        """
        attributes = dict(state.attributes)
        self.use_method(attributes["method"])
        contents = [*self.contents()]
        if [part.shape for part in contents] != [p.shape for p in state.contents]:
            raise InputError(
                "is of another scene or of other settings",
                place="state",
                expected="one of this plant",
            )
        for content, copy in zip(contents, state.contents, strict=True):
            content[:] = copy
        for name in _ATTRIBUTES:
            setattr(self, name, attributes[name])
        self.time = state.time
        self.breaks = list(attributes["breaks"])
        self.samplers.last_time = attributes["last_sample"]
        parts = [self.stick_slip_events, self.event_detector]
        for part, saved in zip(parts, attributes["parts"], strict=True):
            if part is not None:
                part.restore(saved)
        self.pieces, self._goals = (
            dict(attributes["pieces"]),
            dict(attributes["goals"]),
        )
        for name in self.pieces:
            self._write(name)


class Observer:
    """Outputs of a plant.

    Attributes
    ----------
    names : of the outputs
    """

    def __init__(self, plant: PlantRun, system: System) -> None:
        self._plant = plant
        self._sampler = StateSampler(system, plant.start.tolerances)
        self.names = system.scene.outputs.record

    def values(self) -> Array:
        """Outputs at the present time, (n,)."""
        t = np.array([self._plant.time])
        with self._plant.started():
            z, v = self._plant.state_vectors()
            recorded = columns.evaluate_outputs(self._sampler, t, z[None], v[None])
        return np.asarray(recorded.values[0])


def new_plant(
    system: System,
    emit_warning: Callable[[Diagnostic], None],
    *,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    spectral_radius: float | None = None,
) -> PlantRun:
    """Return a compiled scene at its start, as a plant.

    Parameters
    ----------
    emit_warning : called once for each body that leaves linear theory
    integrator, rtol, step, spectral_radius : as of `simulate`

    Raises
    ------
    InputError : as `simulate`.
    """
    settings = run_settings(system, integrator, rtol, step, spectral_radius)
    compile_kernels(system, settings)
    start = prepare_run(system, settings, system.diagnostics, None)
    plan = plan_whole_steps(start)
    return PlantRun(start, plan, allocate(start, plan, np.zeros(0)), emit_warning)
