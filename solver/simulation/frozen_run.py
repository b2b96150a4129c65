"""Runs on the grid of another run: what derivatives by differences of runs need.

The error control chooses steps by the numbers of a scene, in jumps. Two runs of nearby
scenes differ by these jumps more than by the change of the scene. So the steps of a
nominal run are recorded, and neighbours are integrated with the same steps: the same
ends, the same method in each, the same friction states in the same order. Newton's
iteration goes on until rounding ends it. Such a run is a smooth function of its
numbers.

What moves with the numbers:

- a break of a drive or of a force, and the end of the run: grid points between two
  breaks keep their fraction of the interval; breaks that coincide may come apart;
- a change of a friction state and an event that ends the run: the step before it keeps
  its end and is left at the change, the step after it ends at the next grid point;
- a corner of a force at which a step ends: that step ends where the neighbour meets the
  corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Outputs

from ..initial_state.assembly import StateVectors, assemble
from ..initial_state.initial_friction import with_prescribed_friction
from ..initial_state.integrator_start import RunSettings
from ..integrators import loop_state
from ..integrators.singular_configurations import NEAR_SINGULAR
from ..integrators.step_limits import CORNER_DISTANCE, RESOLVED_PATH
from ..output import columns, dense_output
from ..output.dense_output import StepPoints, StepStates
from ..output.energies import EnergyIntegrals
from ..output.events import EventDetector
from ..output.samples import StateSampler
from ..output.stick_slip import with_friction_states
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from ..system.body_table import needs_reactions
from ..system.errors import SimulationError
from ..system.system import System
from ..system.work_arrays import raise_pending
from .preparation import (
    RunStart,
    allocate,
    compile_kernels,
    plan_whole_steps,
    prepare_run,
)
from .result import stop_causes
from .run_loop import Stepper, Stop

#: Tolerances of Newton's iteration in frozen runs, the first with which it converges.
#: The iteration leaves a small part of them. Tighter ones are rounding: it fails in a
#: quarter of the runs of the founding slider-crank, and the others jump by 1e-10.
TOLERANCES = (1e-8, 1e-7, 1e-6)
#: Steps that a run without events makes at once.
STEPS_AT_ONCE = 200
#: Secant steps that search the end of a step at a corner of a force.
CORNER_ITERATIONS = 12


class GridStep(NamedTuple):
    """One step of a grid.

    Attributes
    ----------
    interval : number of the interval between two breaks in which it lies
    fraction : of this interval that has passed at its end, before a change cuts it
    method : integrator
    begins : True if a smooth interval begins with it
    decisions : slip directions and contact sides, if a smooth interval begins with it
    corner : row of the force whose measure meets a corner at its end, or -1
    feature : number of the corner among the features of all functions
    """

    interval: int
    fraction: float
    method: str
    begins: bool
    decisions: tuple[float, ...] = ()
    corner: int = -1
    feature: int = 0


@dataclass(frozen=True)
class Grid:
    """Steps of a nominal run.

    Attributes
    ----------
    steps : in sequence
    settings : of the nominal run
    stopping_event : name of the event that ended it, or empty
    singular_time : first time near a singular configuration [s], or NaN
    structure : equations of the run, see `_structure`
    break_causes : drives and forces that are not smooth at each break
    """

    steps: tuple[GridStep, ...]
    settings: RunSettings
    stopping_event: str
    singular_time: float
    structure: tuple[Any, ...]
    break_causes: tuple[frozenset[str], ...]


class StructureChange(Exception):
    """A neighbour of a run has other events, in another order, or other equations.

    Attributes
    ----------
    reason : what differs, as a phrase
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class CutStep(NamedTuple):
    """A step in which an event ends the run.

    Attributes
    ----------
    states : at the points of the whole step
    detector : of events, as it was before the step, see `EventDetector.save`
    """

    states: StepStates
    detector: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Motion:
    """States of a run at the points of all of its steps.

    Attributes
    ----------
    system : with the friction states of the run
    points : of a step, see `StepPoints`
    steps : (n_steps * points.count) states
    end_time : time at which the run ends [s]
    tolerances : of the constraints, for events
    energies : dissipated and supplied energy, if an output needs them
    places : number of the step of each step of the grid
    cut : the last step, if an event ends the run in it
    """

    system: System
    points: StepPoints
    steps: StepStates
    end_time: float
    tolerances: Array
    energies: EnergyIntegrals | None
    places: IntTable
    cut: CutStep | None = None
    _samplers: dict[str, StateSampler] = field(default_factory=dict)

    def output(self, name: str, t: Array, z: Array, v: Array) -> Array:
        """An output of the scene at states, (nt,)."""
        if columns.is_elastic_coordinate(self.system, name):
            return columns.elastic_column(self.system, z, v, name)
        sampler = self._samplers.get(name)
        if sampler is None:
            sampler = self._samplers[name] = self._sampler(name)
        t, z, v = t.copy(), z.copy(), v.copy()
        found = columns.evaluate_outputs(sampler, t, z, v, self.energies)
        return np.asarray(found.values[:, 0])

    def output_at(self, name: str, times: Array) -> Array:
        """An output of the scene at times [s] of the run, (nt,)."""
        times = np.clip(times, self.steps.t[0], self.steps.t[-1])
        states = [self.points.interpolate_state(self.steps, t) for t in times]
        z, v = (np.array(part) for part in zip(*states, strict=True))
        return self.output(name, times, z, v)

    @property
    def whole_steps(self) -> StepStates:
        """States with those of the whole last step."""
        if self.cut is None:
            return self.steps
        last, t = self.cut.states, self.steps.t
        kept = int(np.searchsorted(t, last.t[0]))
        parts = self.steps.t[:kept], self.steps.z[:kept], self.steps.v[:kept]
        return dense_output.join_steps([StepStates(*parts), last])

    def ended_by_event(self, states: StepStates) -> Motion:
        """The motion with other states of its whole steps, cut at the event.

        Raises
        ------
        StructureChange : the event is not in the last step.
        """
        if self.cut is None:
            return replace(self, steps=states, _samplers={})
        count = self.points.count
        parts = states.t, states.z, states.v
        before = StepStates(*(part[:-count] for part in parts))
        last = StepStates(*(part[-count:] for part in parts))
        detector = EventDetector(self.system, self.tolerances, self.points)
        detector.restore(self.cut.detector)
        if not detector.find_events(last):
            raise StructureChange("the event lies in another step")
        end = detector.events_found[-1].t
        if end > last.t[0]:
            last = self.points.restrict(last, last.t[0], end)
        steps = dense_output.join_steps([before, last])
        return replace(self, steps=steps, end_time=end, _samplers={})

    def _sampler(self, name: str) -> StateSampler:
        """Evaluates one output; joints that became frames only where it needs them.

        States are not projected again: that would be a jump at a tolerance.
        """
        outputs = Outputs(record=(name,))
        scene = self.system.scene.model_copy(update={"outputs": outputs})
        system = replace(self.system, scene=scene)
        if not needs_reactions(scene, system.eliminated):
            system = replace(system, full_system=None)
        return StateSampler(system, np.full((system.n_rows, 2), np.inf))


class _GridRun(Stepper):
    """A run that makes one step after the other, or some at once."""

    def __init__(self, start: RunStart, count: int = 1) -> None:
        plan = plan_whole_steps(start, count)
        arrays = allocate(start, plan, np.zeros(0))
        super().__init__(start, plan, arrays)
        arrays.window.fill_next(self.control)
        self.parts: list[StepStates] = []
        self.places: list[int] = []
        self.cut: CutStep | None = None
        self.energies = plan.energy_integrals

    @property
    def edges(self) -> Array:
        """Start, breaks and end of the scene [s]."""
        return np.array([self.system.scene.time.start, *self.system.breaks])

    def begin_interval(self, end: float) -> tuple[float, ...]:
        """Begin a smooth interval; returns slip directions and contact sides in it.

        Raises
        ------
        SimulationError : it cannot begin.
        """
        failure = self.enter_interval(end)
        if failure:
            raise SimulationError(stop_causes(self, Stop(failure)))
        if self.stick_slip_events is None:
            return ()
        state = self.stick_slip_events.friction_state
        sides = state[:, [at.SLIP_DIRECTION, *range(at.CONTACT_SIDE, state.shape[1])]]
        return tuple(np.sign(sides).ravel().tolist())

    def make_step(self) -> int:
        """Make one step; returns the code of the step loop.

        Raises
        ------
        SimulationError : the step fails.
        """
        self.control.fraction_index = 0
        code = self.step_function.advance(self.control, 1)
        raise_pending(self.system)
        if code not in (loop_state.STEPS_DONE, loop_state.INTERVAL_END):
            raise SimulationError(stop_causes(self, Stop(code=code)))
        return code

    def take_step(self) -> bool:
        """Take the states of the last step, to a change of a friction state or to the
        event that ends the run. Returns True if an event ends it.
        """
        steps = dense_output.take_steps(self.control)
        if self.stick_slip_events is not None and len(steps.t):
            steps = self.stick_slip_events.steps_until_change(self.control, steps)
            self.needs_new_interval = self.stick_slip_events.needs_decision
        detector, ended = self.event_detector, False
        saved = {} if detector is None else detector.save()
        if detector is not None and detector.find_events(steps):
            end, ended = detector.events_found[-1].t, True
            self.cut = CutStep(steps, saved)
            if end > steps.t[0]:
                steps = self.points.restrict(steps, steps.t[0], end)
        if len(steps.t):
            self.parts.append(steps)
            if self.energies is not None:
                self.energies.add(steps)
        return ended

    def motion(self, end_time: float) -> Motion:
        """Return the states so far."""
        return Motion(
            system=self.system,
            points=self.points,
            steps=dense_output.join_steps(self.parts),
            end_time=end_time,
            tolerances=self.start.tolerances,
            energies=self.energies,
            places=np.array(self.places, int),
            cut=self.cut,
        )

    def measures(self) -> Array:
        """Measures of the forces at the end of the last step, (n_forces,)."""
        return np.array(self.control.force_measures[:, 0])


def record_grid(system: System, settings: RunSettings) -> Grid:
    """Integrate a scene with its settings, and return the steps.

    Raises
    ------
    InputError, SimulationError : as `simulate`.
    """
    compile_kernels(system, settings)
    run = _GridRun(prepare_run(system, settings, (), None))
    steps: list[GridStep] = []
    structure, causes = _structure(run.system), _break_causes(run.system)
    singular_time, since_question = np.nan, 0
    for interval, stop in enumerate(run.edges[1:]):
        begin = run.edges[interval]
        decisions, begins = run.begin_interval(stop), True
        while True:
            before = run.measures()
            method = run.method_name
            if run.make_step() == loop_state.INTERVAL_END:
                break
            if run.control.singular_proximity == NEAR_SINGULAR and singular_time != (
                singular_time
            ):
                singular_time = run.current_time
            corner, feature = _corner_at_end(run, before)
            fraction = (run.current_time - begin) / (stop - begin)
            if run.current_time == stop:
                fraction = 1.0
            steps.append(
                GridStep(interval, fraction, method, begins, decisions, corner, feature)
            )
            decisions, begins = (), False
            if run.take_step():
                event = run.event_detector.stopping_event  # type: ignore[union-attr]
                return Grid(
                    tuple(steps), settings, event, singular_time, structure, causes
                )
            since_question += 1
            near = run.control.singular_proximity == NEAR_SINGULAR
            if since_question >= run.plan.step_limit or near:
                since_question = 0
                if run.needs_stiff_method(loop_state.STEPS_DONE):
                    run.switch_method()
                    run.needs_new_interval = True
            if run.needs_new_interval:
                decisions, begins = run.begin_interval(stop), True
    return Grid(tuple(steps), settings, "", singular_time, structure, causes)


def record_motion(system: System, settings: RunSettings) -> tuple[Grid, Motion, int]:
    """Integrate a scene with its settings, and return the steps with their states, and
    the number of runs: two if the states are those of a run on the grid.

    Where nothing looks into the steps of a Radau method, many are made at once.

    Raises
    ------
    InputError, SimulationError : as `simulate`.
    """
    found = _record_many_steps(system, settings)
    if found is None:
        grid = record_grid(system, settings)
        return grid, run_on_grid(system, grid), 2
    return *found, 1


def _record_many_steps(
    system: System, settings: RunSettings
) -> tuple[Grid, Motion] | None:
    """The run without events in its steps; None if there are some."""
    from ..integrators import radau

    compile_kernels(system, settings)
    run = _GridRun(prepare_run(system, settings, (), None), STEPS_AT_ONCE)
    corners = bool(np.any(run.control.feature_corners))
    name = run.method_name
    if run.plan.looks_inside_steps or corners or not name.startswith("radau"):
        return None
    steps: list[GridStep] = []
    for interval, stop in enumerate(run.edges[1:]):
        begin, begins = run.edges[interval], True
        decisions, code = run.begin_interval(stop), loop_state.STEPS_DONE
        while code == loop_state.STEPS_DONE:
            parts = run.kernels, run.system.arrays, run.work, run.memory
            storage = run.step_function.storage
            code = radau.advance(*parts, run.control, storage, STEPS_AT_ONCE)
            raise_pending(run.system)
            states = dense_output.take_steps(run.control)
            last = run.points.step_ends(states).t
            for end in np.nextafter(last, np.inf).tolist():
                fraction = 1.0 if end == stop else (end - begin) / (stop - begin)
                steps.append(GridStep(interval, fraction, name, begins, decisions))
                decisions, begins = (), False
            run.parts.append(states)
        if code != loop_state.INTERVAL_END:
            return None
    run.places = [*range(len(steps))]
    structure, causes = _structure(run.system), _break_causes(run.system)
    grid = Grid(tuple(steps), settings, "", np.nan, structure, causes)
    return grid, run.motion(run.current_time)


def _structure(system: System) -> tuple[Any, ...]:
    """What neighbours must have in common: coordinates and constraints."""
    sizes = system.n_positions, system.n_velocities, system.n_rows
    rows = system.redundant, system.inactive_rows, tuple(system.eliminated)
    constraints = system.arrays.constraint.tobytes()
    return (*sizes, *rows, constraints)


def _break_causes(system: System) -> tuple[frozenset[str], ...]:
    """Drives and forces that are not smooth at each break."""
    return tuple(frozenset(system.break_causes.get(t, ())) for t in system.breaks)


def _match_breaks(system: System, grid: Grid) -> list[list[float]]:
    """Times of each break of a grid [s]: several where breaks that coincide in the
    nominal scene are apart in this one.

    Raises
    ------
    StructureChange : the scene has other breaks, or another order of these.
    """
    groups: list[list[float]] = []
    found = [*zip(system.breaks, _break_causes(system), strict=True)]
    for causes in grid.break_causes:
        group, missing = list[float](), set(causes)
        while found and (missing or not group):
            time, own = found.pop(0)
            if not own <= causes:
                raise StructureChange(f"another break at t = {time:.6g} s")
            group.append(time)
            missing -= own
        if missing or not group:
            raise StructureChange("breaks in another order")
        groups.append(group)
    if found:
        raise StructureChange(f"another break at t = {found[0][0]:.6g} s")
    return groups


def _corner_at_end(run: _GridRun, before: Array) -> tuple[int, int]:
    """Force row and feature of the corner at which the last step ended, or -1 and 0."""
    control = run.control
    if control.fixed_step == 1:
        return -1, 0
    for k, (x, y) in enumerate(zip(before, run.measures(), strict=True)):
        size = max(abs(x), abs(y), 1e-3 * control.mechanism_length)
        tolerance = max(CORNER_DISTANCE * abs(y - x), RESOLVED_PATH * size)
        first, last = control.feature_offsets[2 * k + 1 : 2 * k + 3]
        for i in range(first, last):
            corner = control.feature_starts[i]
            is_corner = last - first > 1 and control.feature_corners[i] != 0.0
            if is_corner and abs(y - corner) <= tolerance < abs(x - corner):
                return k, i
    return -1, 0


def run_on_grid(system: System, grid: Grid) -> Motion:
    """Integrate a scene with the steps of a grid, to rounding.

    Raises
    ------
    InputError : no start position meets the constraints.
    SimulationError : a step fails.
    StructureChange : events or friction states change in another order.
    """
    for last, tolerance in enumerate(TOLERANCES, 1 - len(TOLERANCES)):
        settings = replace(grid.settings, rtol=tolerance, step=1.0)
        try:
            return _follow(_GridRun(prepare_run(system, settings, (), None)), grid)
        except SimulationError:
            if last == 0:
                raise
    raise AssertionError("unreachable")


def _follow(run: _GridRun, grid: Grid) -> Motion:
    if _structure(run.system) != grid.structure:
        raise StructureChange("other constraints are active")
    groups = [[run.system.scene.time.start], *_match_breaks(run.system, grid)]
    interval, control = 0, run.control
    for index, step in enumerate(grid.steps):
        if step.interval != interval:
            interval = step.interval
            _pass_breaks(run, groups[interval])
        begin, stop = groups[interval][-1], groups[interval + 1][0]
        run.use_method(step.method)
        if run.needs_new_interval and not step.begins:
            raise StructureChange(_changed("a change of a friction state", run))
        if step.begins and run.begin_interval(stop) != step.decisions:
            raise StructureChange(_changed("other friction states", run))
        end = stop if step.fraction == 1.0 else begin + step.fraction * (stop - begin)
        if not end > control.time:
            raise StructureChange(_changed("an event in another step", run))
        if step.corner >= 0:
            _step_to_corner(run, step, end)
        else:
            _step_to(run, end)
        run.places.append(len(run.parts))
        if run.take_step():
            detector = run.event_detector
            assert detector is not None
            if index + 1 < len(grid.steps) or (
                detector.stopping_event != grid.stopping_event
            ):
                raise StructureChange(_changed(f"event {detector.stopping_event}", run))
            return run.motion(detector.events_found[-1].t)
    if grid.stopping_event:
        raise StructureChange(f"event {grid.stopping_event} is not reached")
    return run.motion(run.current_time)


def frozen_start(system: System, grid: Grid) -> tuple[System, StateVectors]:
    """The system of a run on a grid, and the state in which it begins.

    Raises
    ------
    InputError : no start position meets the constraints.
    StructureChange : other constraints are active.
    """
    assembled, start = assemble(system)
    prepared = with_friction_states(with_prescribed_friction(assembled, start))
    if _structure(prepared) != grid.structure:
        raise StructureChange("other constraints are active")
    return prepared, start


def grid_times(system: System, grid: Grid) -> tuple[Array, Array]:
    """Ends of the steps (steps + 1,) of a run on a grid without events, and begin and
    end of the smooth interval of each step (steps, 2) [s].

    Raises
    ------
    StructureChange : the scene has other breaks.
    """
    groups = [[system.scene.time.start], *_match_breaks(system, grid)]
    if any(len(group) > 1 for group in groups):
        raise StructureChange("breaks that coincide come apart")
    edges = np.array([group[0] for group in groups])
    number = np.array([step.interval for step in grid.steps])
    fraction = np.array([step.fraction for step in grid.steps])
    begins, ends = edges[number], edges[number + 1]
    times = np.where(fraction == 1.0, ends, begins + fraction * (ends - begins))
    return np.append(edges[0], times), np.stack([begins, ends], axis=1)


def _pass_breaks(run: _GridRun, times: Sequence[float]) -> None:
    """Make a step between two breaks each that coincide in the nominal scene."""
    for end in times[1:]:
        run.begin_interval(end)
        _step_to(run, end)
        if run.take_step() or run.needs_new_interval:
            raise StructureChange(_changed("an event between two breaks", run))


def _changed(what: str, run: _GridRun) -> str:
    return f"{what} at t = {run.current_time:.6g} s"


def _step_to(run: _GridRun, end: float) -> None:
    """Make one step that ends at a time [s]."""
    control = run.control
    control.stop, control.step = end, end - control.time
    run.make_step()


def _step_to_corner(run: _GridRun, step: GridStep, end: float) -> None:
    """Make one step that ends where the measure of a force meets a corner."""
    saved = [part.copy() for part in run.contents()]
    begin, position = run.control.time, run.control.feature_starts[step.feature]

    def distance(t: float) -> float:
        for part, copy in zip(run.contents(), saved, strict=True):
            part[:] = copy
        _step_to(run, t)
        return float(run.measures()[step.corner] - position)

    t0, t1 = end, end - 1e-4 * (end - begin)
    y1, y0 = distance(t1), distance(t0)
    for _ in range(CORNER_ITERATIONS):
        if y1 == y0:
            break
        t2 = t0 - y0 * (t0 - t1) / (y0 - y1)
        if abs(t2 - t0) <= 4e-16 * max(abs(t2), end - begin):
            break
        t1, y1 = t0, y0
        t0, y0 = t2, distance(t2)
