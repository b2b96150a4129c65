"""Instants of steps at which joints with friction change between stick and slip."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic

from ..integrators import loop_state
from ..integrators.output_sampling import (
    OUTPUT_CONTACT_FORCE,
    OUTPUT_FRICTION,
    OUTPUT_LOAD,
    OUTPUT_RATE,
)
from ..spatial import system_arrays as at
from ..system.system import System
from .dense_output import StepPoints, StepStates, join_steps
from .events import LocatedEvent
from .stick_slip import LIMIT_TOLERANCE, StatesOfMotion, StickSlipDecision

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
        for j, bound in enumerate(bounds):
            negative = np.flatnonzero(margins[:, j] < -bound)
            if not len(negative):
                continue
            before = np.flatnonzero(margins[: negative[0], j] > 0.0)
            time = self._change_time(
                steps, j, before[-1] if len(before) else 0, negative[0]
            )
            if time < first:
                first, changing = time, []
            if time <= first:
                changing.append(j)
        count = len(self.friction_state)
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

    def _change_time(self, steps: StepStates, j: int, low: int, high: int) -> float:
        from scipy.optimize import brentq

        def margin(t: float) -> float:
            z, v = self.points.interpolate_state(steps, t)
            states = np.array([t]), z[None], v[None]
            return float(self._margins(states, self.friction_output(*states))[0, j])

        begin, end = float(steps.t[low]), float(steps.t[high])
        if begin == end or margin(begin) <= 0.0:
            return begin
        rounding = float(np.finfo(float).eps)
        smallest = rounding * max(abs(begin), abs(end), end - begin)
        return float(brentq(margin, begin, end, xtol=smallest, rtol=4.0 * rounding))

    def _project(self, t: float, z: Array, v: Array) -> None:
        """Project a state onto all constraints, with sticking joints at rest."""
        self.sampler.sample(np.array([np.nextafter(t, np.inf)]), z[None], v[None])
