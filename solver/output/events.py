"""Events of a run: crossings found on its dense output, and breaks.

Every step is evaluated at the points of `dense_output`. Between two points on different
sides of the value the crossing is found to rounding; two crossings between two points
are missed.

Instants of steps at which joints with friction change between stick and slip.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.result import Event
from sidtool.formats.scene import Event as Wanted, Outputs, parse_output
from sidtool.formats.scene.outputs import is_joint_output, is_section_force

from ..integrators import loop_state
from ..integrators.output_sampling import (
    OUTPUT_CONTACT_FORCE,
    OUTPUT_FRICTION,
    OUTPUT_LOAD,
    OUTPUT_RATE,
)
from ..spatial import system_arrays as at
from ..system.body_table import needs_reactions
from ..system.system import System
from . import columns
from .dense_output import StepPoints, StepStates, join_steps
from .samples import StateSampler
from .stick_slip import LIMIT_TOLERANCE, StatesOfMotion, StickSlipDecision

#: A quantity closer to the value than this part of its size is on it.
VALUE_TOLERANCE = 1e-13
#: Events are at one instant when they lie closer than this part of the time span.
TIME_TOLERANCE = 1e-14

#: What changes of `StickSlipEvents` during a run; none of it is changed in place.
_CHANGING = (
    "largest_rate",
    "largest_contact_force",
    "largest_acceleration",
    "largest_compliance",
    "sliding_acceleration",
    "changing_joints",
    "reversing_contacts",
    "changed_joints",
    "groups",
    "is_started",
    "stride",
    "steps_since_change",
    "_last",
    "_since",
    "_count",
)
#: Steps that may be lost at once, and which share of those since the last change.
MAX_STRIDE, MAX_LOST_FRACTION = 4, 0.25


@dataclass(frozen=True, eq=False)
class LocatedEvent:
    """An event before its outputs are known."""

    name: str
    kind: str
    t: float
    z: Array
    v: Array


class EventDetector:
    """Looks for the events of a scene in the steps of a run.

    Attributes
    ----------
    events_found
        What was found, in the order of time.
    stopping_event
        Name of the event that ends the run, or empty.
    """

    def __init__(self, system: System, closed: Array, points: StepPoints) -> None:
        self.points = points
        self.span = system.scene.time.end - system.scene.time.start
        self.wanted: dict[str, Wanted] = dict(system.scene.events)
        record = tuple(event.quantity for event in self.wanted.values())
        scene = system.scene.model_copy(update={"outputs": Outputs(record=record)})
        system = replace(system, scene=scene)
        if not needs_reactions(scene, system.eliminated):
            system = replace(system, full_system=None)
        self._sampler = StateSampler(system, closed)
        #: whether any multipliers do that hold the mechanism
        self._any_multipliers = not any(
            is_joint_output(name.quantity) or is_section_force(name)
            for name in map(parse_output, record)
        )
        self.levels = np.array([event.value for event in self.wanted.values()])
        self.sides = np.zeros(len(self.levels))
        self.sizes = np.abs(self.levels)
        self.counts = dict.fromkeys(self.wanted, 0)
        self.events_found: list[LocatedEvent] = []
        self.stopping_event = ""

    def save(self) -> dict[str, Any]:
        """Return what changes during a run."""
        return {
            "sides": self.sides.copy(),
            "sizes": self.sizes.copy(),
            "counts": dict(self.counts),
            "events_found": tuple(self.events_found),
            "stopping_event": self.stopping_event,
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` has returned."""
        self.sides[:], self.sizes[:] = saved["sides"], saved["sizes"]
        self.counts = dict(saved["counts"])
        self.events_found = list(saved["events_found"])
        self.stopping_event = saved["stopping_event"]

    def find_events(self, steps: StepStates) -> bool:
        """Detect events in steps; True if one of them ends the run.

        Events after the end are dropped.
        """
        if not len(steps.t):
            return False
        heights = self._distances_to_values(steps.t, steps.z.copy(), steps.v.copy())
        changed = [
            self._locate_event(steps, heights, k, low, high)
            for k in range(len(self.levels))
            for low, high in self._crossings(k, heights[:, k])
        ]
        latest = np.inf
        for event in sorted(changed, key=lambda m: m.t):
            if event.t > latest:
                break
            self._record_event(event)
            if self.stopping_event:
                latest = min(
                    latest, event.t + TIME_TOLERANCE * (abs(event.t) + self.span)
                )
        return bool(self.stopping_event)

    def is_without_events(self, steps: StepStates) -> bool:
        """True if no quantity crosses its value in steps, which then are done with."""
        before = self.sides.copy()
        heights = self._distances_to_values(steps.t, steps.z.copy(), steps.v.copy())
        if any(self._crossings(k, heights[:, k]) for k in range(len(self.levels))):
            self.sides[:] = before
            return False
        return True

    def _distances_to_values(self, t: Array, z: Array, v: Array) -> Array:
        """Distances of the quantities to the values of the events, (nt, n_events).

        Projects z and v onto the constraints.
        """
        samples = self._sampler.sample(t, z, v) if self._any_multipliers else None
        recorded = columns.evaluate_outputs(self._sampler, t, z, v, samples=samples)
        return recorded.values - self.levels

    def _crossings(self, k: int, heights: Array) -> list[tuple[int, int]]:
        """Points before and after each change of the side; -1 for before the first."""
        self.sizes[k] = max(self.sizes[k], np.abs(heights + self.levels[k]).max())
        off_value = np.flatnonzero(np.abs(heights) > VALUE_TOLERANCE * self.sizes[k])
        if not len(off_value):
            return []
        sides = np.sign(heights[off_value])
        before = np.array([self.sides[k], *sides[:-1]])
        points = np.array([-1, *off_value[:-1]])
        self.sides[k] = sides[-1]
        changed = np.flatnonzero(before * sides < 0.0)
        return [(int(points[i]), int(off_value[i])) for i in changed]

    def _locate_event(
        self, steps: StepStates, heights: Array, k: int, low: int, high: int
    ) -> LocatedEvent:
        """The crossing between two points."""
        name = list(self.wanted)[k]
        t = self._crossing_time(steps, k, max(low, 0), high) if high > 0 else steps.t[0]
        z, v = (y[None] for y in self.points.interpolate_state(steps, t))
        self._distances_to_values(np.array([t]), z, v)
        kind = "rising" if heights[high, k] > 0.0 else "falling"
        return LocatedEvent(name, kind, float(t), z[0], v[0])

    def _crossing_time(self, steps: StepStates, k: int, low: int, high: int) -> float:
        """Time of a crossing [s]; it is at the first point if that is on the value."""
        from scipy.optimize import brentq

        def height(t: float) -> float:
            z, v = self.points.interpolate_state(steps, t)
            return float(
                self._distances_to_values(np.array([t]), z[None], v[None])[0, k]
            )

        begin, end = float(steps.t[low]), float(steps.t[high])
        if begin == end or height(begin) * height(end) >= 0.0:
            return begin
        rounding = float(np.finfo(float).eps)
        smallest = rounding * max(abs(begin), abs(end), end - begin)
        return float(brentq(height, begin, end, xtol=smallest, rtol=4.0 * rounding))

    def _record_event(self, event: LocatedEvent) -> None:
        """Count and store a crossing in a requested direction."""
        specification = self.wanted[event.name]
        if specification.direction not in ("both", event.kind):
            return
        self.counts[event.name] += 1
        count = self.counts[event.name]
        stops = specification.action == "stop"
        if stops or specification.count is None or count <= specification.count:
            self.events_found.append(event)
        if stops and count == (specification.count or 1):
            self.stopping_event = event.name


def complete_events(
    located: Sequence[LocatedEvent],
    record: Callable[[Array, Array, Array], columns.RecordedOutputs],
) -> tuple[Event, ...]:
    """Located events with the outputs of the scene, which `record` evaluates."""
    t = np.array([m.t for m in located])
    z, v = np.array([m.z for m in located]), np.array([m.v for m in located])
    values = record(t, z, v).values
    return tuple(
        Event(m.name, m.kind, m.t, *states)
        for m, *states in zip(located, values, z, v, strict=True)
    )


class StickSlipEvents(StickSlipDecision):
    """Looks at the steps of a run for instants at which friction states change.

    Attributes
    ----------
    stride
        Steps to make before they are looked at; those behind a change are lost.
    steps_since_change
        Steps since the last change.
    """

    def __init__(
        self, system: System, closed: Array, points: StepPoints, rtol: float
    ) -> None:
        super().__init__(system, rtol, closed)
        self.points, self.stride, self.steps_since_change = points, 1, 0

    def save(self) -> dict[str, Any]:
        """Return what changes during a run, but for `friction_state`."""
        return self.history.save() | {name: getattr(self, name) for name in _CHANGING}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` has returned."""
        self.history.restore(saved)
        for name in _CHANGING:
            setattr(self, name, saved[name])

    def discard_changes(self) -> None:
        """Forget changes that were located: the motion takes another way before."""
        self.changing_joints, self.reversing_contacts = [], []

    @property
    def needs_decision(self) -> bool:
        """True if friction states must be decided before the run continues."""
        return bool(self.changing_joints or self.reversing_contacts)

    def enter_interval(
        self, t: float, z: Array, v: Array
    ) -> tuple[Diagnostic | None, list[LocatedEvent]]:
        """Decide friction from an instant on, and set sticking coordinates of z and v
        to rest.

        Returns why there is no decision, if so; and the joints that changed.
        """
        if self.is_started:
            self._project(t, z, v)
        why = self.choose_states(t, z, v)
        self.history.store(t)
        self._project(t, z, v)
        state = t, z.copy(), v.copy()
        slip_direction, joints = (
            self.friction_state[:, at.SLIP_DIRECTION],
            self.system.friction_joints,
        )
        kinds = [
            (j, "slip" if slip_direction[j] else "stick")
            for j in sorted(self.changed_joints)
        ]
        return why, [LocatedEvent(joints[j].joint, kind, *state) for j, kind in kinds]

    def steps_before(self, steps: StepStates, end: float) -> StepStates:
        """The parts of steps before an instant."""
        count = self.points.count
        n_complete = count * int(np.searchsorted(steps.t[count - 1 :: count], end))
        before = StepStates(
            steps.t[:n_complete], steps.z[:n_complete], steps.v[:n_complete]
        )
        begin = steps.t[n_complete]
        if not end > begin:
            return before
        return join_steps([before, self.points.restrict(steps, begin, end)])

    def steps_until_change(
        self, control: loop_state.StepLoopState, steps: StepStates
    ) -> StepStates:
        """The steps as far as no friction state changes; there the control
        goes back.
        """
        t = self.first_state_change(steps) if len(steps.t) else None
        self.steps_since_change += len(steps.t) // self.points.count
        self.stride = max(
            min(2 * self.stride, MAX_STRIDE),
            int(MAX_LOST_FRACTION * self.steps_since_change),
        )
        if t is None:
            return steps
        self.stride, self.steps_since_change = 1, 0
        control.time = t
        control.z[:], control.v[:] = self.points.interpolate_state(steps, t)
        known = control.output_times[: control.next_output]
        control.next_output = int(np.searchsorted(known, t, "right"))
        return self.steps_before(steps, t)

    def first_state_change(self, steps: StepStates) -> float | None:
        """The first instant in some steps at which a friction state changes."""
        states = steps.t, steps.z, steps.v
        output = self.friction_output(*states)
        margins, bounds = self._margins(states, output), self._margin_bounds(output)
        first, changing = np.inf, list[int]()
        count = len(self.friction_state)
        moves = margins[0, :count] < -self.is_at_rest  # with a rate that is rounding
        leaves_bound = np.flatnonzero(self._is_sticking | moves)
        for j, bound in enumerate(bounds):
            negative = np.flatnonzero(margins[:, j] < -bound)
            if not len(negative):
                continue
            last = int(negative[0])
            before = np.flatnonzero(margins[:last, j] > 0.0)
            if len(before) or last == 0 or j not in leaves_bound:
                begin = int(before[-1]) if len(before) else 0
                time = self._change_time(steps, j, begin, last)
            else:  # a joint without load, whose limit and force are zero until then
                time = self._change_time(steps, j, last - 1, last, float(bound))
            if time < first:
                first, changing = time, []
            if time <= first:
                changing.append(j)
        self.changing_joints = [j for j in changing if j < count]
        self.reversing_contacts = [j - count for j in changing if j >= count]
        return first if changing else None

    def _margins(self, states: StatesOfMotion, output: Array) -> Array:
        """How far joints are from another friction state, negative beyond: (nt,
        frictions).

        Of sliding ones the rate, of sticking ones what their load holds beyond what
        they need, of those that drives keep at rest how much slower they are than what
        counts as motion. Joints that hold one motion together have one margin, the
        force that would brake it. Behind them the forces that press their places of
        contact.
        """
        slip_direction, rate = (
            self.friction_state[:, at.SLIP_DIRECTION],
            output[:, :, OUTPUT_RATE],
        )
        margin_of_sticking = self.rest_speed * output[:, :, OUTPUT_LOAD] - np.abs(
            output[:, :, OUTPUT_FRICTION]
        )
        margin_of_sticking = np.where(
            self.prescribed, 2.0 * self.is_at_rest - np.abs(rate), margin_of_sticking
        )
        own = np.where(slip_direction == 0.0, margin_of_sticking, slip_direction * rate)
        own[:, self.is_without_limit] = np.inf
        for group in self.groups:
            own[:, group.joints] = np.inf
            own[:, group.joints[0]] = -self.released_forces(states, group).max(axis=0)
        side = self.friction_state[:, at.CONTACT_SIDE :]
        contact_margin = np.where(
            side == 0.0, np.inf, side * output[:, :, OUTPUT_CONTACT_FORCE:]
        )
        return np.hstack([own, contact_margin.reshape(len(output), -1)])

    def _margin_bounds(self, output: Array) -> Array:
        """How far beyond is certain, of each of `_margins`."""
        self.largest_rate = np.fmax(
            self.largest_rate, np.abs(output[:, :, OUTPUT_RATE]).max(axis=0)
        )
        moving = self.is_at_rest + self.rtol * self.largest_rate
        load = np.abs(output[:, :, OUTPUT_LOAD]).max(axis=0)
        bound_of_sticking = (
            LIMIT_TOLERANCE * self.rest_speed * load + self._negligible()
        )
        own = np.where(self._is_sticking, bound_of_sticking, moving)
        for group in self.groups:
            own[group.joints[0]] = self.group_bound(group, load)
        return np.concatenate([own, self._certain_contact_force(output).ravel()])

    def _change_time(
        self, steps: StepStates, j: int, low: int, high: int, bound: float = 0.0
    ) -> float:
        """The instant between two states at which a margin is that far below zero."""
        from scipy.optimize import brentq

        def margin(t: float) -> float:
            z, v = self.points.interpolate_state(steps, t)
            states = np.array([t]), z[None], v[None]
            output = self.friction_output(*states)
            return float(self._margins(states, output)[0, j]) + bound

        begin, end = float(steps.t[low]), float(steps.t[high])
        if begin == end or margin(begin) <= 0.0:
            return begin
        rounding = float(np.finfo(float).eps)
        smallest = rounding * max(abs(begin), abs(end), end - begin)
        return float(brentq(margin, begin, end, xtol=smallest, rtol=4.0 * rounding))

    def _project(self, t: float, z: Array, v: Array) -> None:
        """Project a state onto all constraints, with sticking joints at rest."""
        self.sampler.sample(np.array([np.nextafter(t, np.inf)]), z[None], v[None])
