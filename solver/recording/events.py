"""Events of a run: crossings found on its dense output, and breaks.

Every step is looked at in the points of `dense`. Between two points on different sides
of the value, the crossing is found as exactly as numbers allow. Two crossings between
two points are missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.result import Event
from sidtool.formats.scene import Event as Wanted
from sidtool.formats.scene import Outputs, parse_output
from sidtool.formats.scene.outputs import is_of_joint
from sidtool.formats.sid import Array

from ..system.bodies.eliminated import asks_for_joints
from ..system.scene import System
from . import outputs
from .dense import Points, Steps
from .sampling import Sampler

#: A quantity closer to the value than this part of its size is on it.
ON_VALUE = 1e-13
#: Events are at one instant when they lie closer than this part of the time span.
TOGETHER = 1e-14


@dataclass(frozen=True, eq=False)
class Moment:
    """An event before its outputs are known."""

    name: str
    kind: str
    t: float
    z: Array
    v: Array


class Watch:
    """Looks for the events of a scene in the steps of a run.

    Attributes
    ----------
    moments : what was found, in the order of time
    ended : name of the event that ends the run, or empty
    """

    def __init__(self, system: System, closed: Array, points: Points) -> None:
        self.points = points
        self.span = system.scene.time.end - system.scene.time.start
        self.wanted: dict[str, Wanted] = dict(system.scene.events)
        record = tuple(event.quantity for event in self.wanted.values())
        scene = system.scene.model_copy(update={"outputs": Outputs(record=record)})
        system = replace(system, scene=scene)
        if not asks_for_joints(scene, system.eliminated):
            system = replace(system, whole=None)
        self._sampler = Sampler(system, closed)
        #: whether any multipliers do that hold the mechanism
        self._any_do = not any(is_of_joint(parse_output(q).quantity) for q in record)
        self.levels = np.array([event.value for event in self.wanted.values()])
        self.sides = np.zeros(len(self.levels))
        self.sizes = np.abs(self.levels)
        self.counts = dict.fromkeys(self.wanted, 0)
        self.moments: list[Moment] = []
        self.ended = ""

    def look(self, steps: Steps) -> bool:
        """Looks at steps; True when one of them ends the run.

        What lies behind the end is forgotten.
        """
        if not len(steps.t):
            return False
        heights = self._heights(steps.t, steps.z.copy(), steps.v.copy())
        found = [
            self._moment(steps, heights, k, low, high)
            for k in range(len(self.levels))
            for low, high in self._crossings(k, heights[:, k])
        ]
        latest = np.inf
        for moment in sorted(found, key=lambda m: m.t):
            if moment.t > latest:
                break
            self._take(moment)
            if self.ended:
                latest = min(latest, moment.t + TOGETHER * (abs(moment.t) + self.span))
        return bool(self.ended)

    def _heights(self, t: Array, z: Array, v: Array) -> Array:
        """How far the quantities lie above their values, (nt, events).

        Projects z and v onto the constraints.
        """
        samples = self._sampler.sample(t, z, v) if self._any_do else None
        recorded = outputs.record(self._sampler, t, z, v, samples=samples)
        return recorded.values - self.levels

    def _crossings(self, k: int, heights: Array) -> list[tuple[int, int]]:
        """Points before and after each change of the side; -1 for before the first."""
        self.sizes[k] = max(self.sizes[k], np.abs(heights + self.levels[k]).max())
        beside = np.flatnonzero(np.abs(heights) > ON_VALUE * self.sizes[k])
        if not len(beside):
            return []
        sides = np.sign(heights[beside])
        before = np.array([self.sides[k], *sides[:-1]])
        points = np.array([-1, *beside[:-1]])
        self.sides[k] = sides[-1]
        changed = np.flatnonzero(before * sides < 0.0)
        return [(int(points[i]), int(beside[i])) for i in changed]

    def _moment(
        self, steps: Steps, heights: Array, k: int, low: int, high: int
    ) -> Moment:
        """The crossing between two points."""
        name = list(self.wanted)[k]
        t = self._zero(steps, k, max(low, 0), high) if high > 0 else steps.t[0]
        z, v = (y[None] for y in self.points.state(steps, t))
        self._heights(np.array([t]), z, v)
        kind = "rising" if heights[high, k] > 0.0 else "falling"
        return Moment(name, kind, float(t), z[0], v[0])

    def _zero(self, steps: Steps, k: int, low: int, high: int) -> float:
        """Time of a crossing [s]; it is at the first point if that is on the value."""
        from scipy.optimize import brentq

        def height(t: float) -> float:
            z, v = self.points.state(steps, t)
            return float(self._heights(np.array([t]), z[None], v[None])[0, k])

        begin, end = float(steps.t[low]), float(steps.t[high])
        if begin == end or height(begin) * height(end) >= 0.0:
            return begin
        rounding = float(np.finfo(float).eps)
        smallest = rounding * max(abs(begin), abs(end), end - begin)
        return float(brentq(height, begin, end, xtol=smallest, rtol=4.0 * rounding))

    def _take(self, moment: Moment) -> None:
        """Counts and keeps a crossing in a direction that is wanted."""
        wanted = self.wanted[moment.name]
        if wanted.direction not in ("both", moment.kind):
            return
        self.counts[moment.name] += 1
        count = self.counts[moment.name]
        stops = wanted.action == "stop"
        if stops or wanted.count is None or count <= wanted.count:
            self.moments.append(moment)
        if stops and count == (wanted.count or 1):
            self.ended = moment.name


def events_of(
    moments: Sequence[Moment], record: Callable[[Array, Array, Array], outputs.Recorded]
) -> tuple[Event, ...]:
    """Moments with the outputs of the scene, which `record` makes."""
    t = np.array([m.t for m in moments])
    z, v = np.array([m.z for m in moments]), np.array([m.v for m in moments])
    found = record(t, z, v).values
    return tuple(
        Event(m.name, m.kind, m.t, *states)
        for m, *states in zip(moments, found, z, v, strict=True)
    )
