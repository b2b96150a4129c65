"""Events of a run: crossings found on its dense output, and breaks.

Every step is evaluated at the points of `dense_output`. Between two points on different
sides of the value the crossing is found to rounding; two crossings between two points
are missed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Event
from sidtool.formats.scene import Event as Wanted
from sidtool.formats.scene import Outputs, parse_output
from sidtool.formats.scene.outputs import is_joint_output, is_section_force

from ..system.body_frames import needs_reactions
from ..system.system import System
from . import columns
from .dense_output import StepPoints, StepStates
from .samples import StateSampler

#: A quantity closer to the value than this part of its size is on it.
VALUE_TOLERANCE = 1e-13
#: Events are at one instant when they lie closer than this part of the time span.
TIME_TOLERANCE = 1e-14


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
