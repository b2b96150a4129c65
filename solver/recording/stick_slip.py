"""Stick and slip: when joints with friction stop, break loose or turn round.

Theory, section 14. Every step is made with the grips of its beginning, for which the
equations are smooth. It is looked at in the points of `dense`: a sliding joint whose
rate changes its sign stops there; a sticking one whose friction passes what its load
can hold breaks loose; one that is pressed along one direction alone has no load where
that changes its sign. The run goes on from there with other grips.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..integrators import stepping
from ..integrators.recording import (
    RUB_FORCE,
    RUB_LOAD,
    RUB_PRESS,
    RUB_RATE,
)
from ..space import layout as at
from ..system.scene import System
from .dense import Points, Steps, joined
from .events import Moment
from .grip_choice import AT_LIMIT, Grip

#: Steps that may be lost at once, and which share of those since the last change.
STRIDE, LOST = 4, 0.25


class StickSlip(Grip):
    """Looks at the steps of a run for instants at which grips change.

    stride : steps to make before they are looked at; those behind a change are lost
    since : steps since the last change
    """

    def __init__(
        self, system: System, closed: Array, points: Points, rtol: float
    ) -> None:
        super().__init__(system, rtol, closed)
        self.points, self.stride, self.since = points, 1, 0

    @property
    def waits(self) -> bool:
        """Whether grips have to be chosen anew before the run goes on."""
        return bool(self.turning or self.reversing)

    def enter(self, t: float, z: Array, v: Array) -> tuple[str, list[Moment]]:
        """Chooses how joints go on from an instant, and stops what sticks in z and v.

        Returns why there is no choice, or nothing; and what changed.
        """
        if self.begun:
            self._stop(t, z, v)
        why = self.settle(t, z, v)
        self.grips.note(t)
        self._stop(t, z, v)
        state = t, z.copy(), v.copy()
        sense, joints = self.grip[:, at.SENSE], self.system.rubbing
        kinds = [(j, "slip" if sense[j] else "stick") for j in sorted(self.changed)]
        return why, [Moment(joints[j].joint, kind, *state) for j, kind in kinds]

    def cut(self, steps: Steps, end: float) -> Steps:
        """The parts of steps before an instant."""
        count = self.points.count
        whole = count * int(np.searchsorted(steps.t[count - 1 :: count], end))
        before = Steps(steps.t[:whole], steps.z[:whole], steps.v[:whole])
        begin = steps.t[whole]
        if not end > begin:
            return before
        t = begin + self.points.shares * (end - begin)
        t[-1] = np.nextafter(end, -np.inf)
        z, v = zip(*(self.points.state(steps, when) for when in t), strict=True)
        return joined([before, Steps(t, np.array(z), np.array(v))])

    def until_change(self, control: stepping.Control, steps: Steps) -> Steps:
        """The steps as far as no grip changes; there the control goes back."""
        t = self.look(steps) if len(steps.t) else None
        self.since += len(steps.t) // self.points.count
        self.stride = max(min(2 * self.stride, STRIDE), int(LOST * self.since))
        if t is None:
            return steps
        self.stride, self.since = 1, 0
        control.time = t
        control.z[:], control.v[:] = self.points.state(steps, t)
        known = control.times[: control.output]
        control.output = int(np.searchsorted(known, t, "right"))
        return self.cut(steps, t)

    def look(self, steps: Steps) -> float | None:
        """The first instant in some steps at which a grip changes."""
        told = self.told(steps.t, steps.z, steps.v)
        margins, bounds = self._margins(told), self._bounds(told)
        first, changing = np.inf, list[int]()
        for j, bound in enumerate(bounds):
            below = np.flatnonzero(margins[:, j] < -bound)
            if not len(below):
                continue
            before = np.flatnonzero(margins[: below[0], j] > 0.0)
            when = self._zero(steps, j, before[-1] if len(before) else 0, below[0])
            if when < first:
                first, changing = when, []
            if when <= first:
                changing.append(j)
        count = len(self.grip)
        self.turning = [j for j in changing if j < count]
        self.reversing = [j - count for j in changing if j >= count]
        return first if changing else None

    def _margins(self, told: Array) -> Array:
        """How far joints are from another grip, negative beyond: (nt, frictions).

        Of sliding ones the rate, of sticking ones what their load holds beyond what
        they need, of those that drives keep at rest how much slower they are than
        what counts as motion. Behind them the forces that press their places of
        contact.
        """
        sense, rate = self.grip[:, at.SENSE], told[:, :, RUB_RATE]
        held = self.rest * told[:, :, RUB_LOAD] - np.abs(told[:, :, RUB_FORCE])
        held = np.where(self.led, 2.0 * self.still - np.abs(rate), held)
        own = np.where(sense == 0.0, held, sense * rate)
        side = self.grip[:, at.SIDE :]
        press = np.where(side == 0.0, np.inf, side * told[:, :, RUB_PRESS:])
        return np.hstack([own, press.reshape(len(told), -1)])

    def _bounds(self, told: Array) -> Array:
        """How far beyond is certain, of each of `_margins`."""
        self.fastest = np.fmax(self.fastest, np.abs(told[:, :, RUB_RATE]).max(axis=0))
        moving = self.still + self.rtol * self.fastest
        load = np.abs(told[:, :, RUB_LOAD]).max(axis=0)
        held = AT_LIMIT * self.rest * load + self._negligible()
        own = np.where(self._sticking, held, moving)
        return np.concatenate([own, self._certain(told).ravel()])

    def _zero(self, steps: Steps, j: int, low: int, high: int) -> float:
        from scipy.optimize import brentq

        def margin(t: float) -> float:
            z, v = self.points.state(steps, t)
            told = self.told(np.array([t]), z[None], v[None])
            return float(self._margins(told)[0, j])

        begin, end = float(steps.t[low]), float(steps.t[high])
        if begin == end or margin(begin) <= 0.0:
            return begin
        rounding = float(np.finfo(float).eps)
        smallest = rounding * max(abs(begin), abs(end), end - begin)
        return float(brentq(margin, begin, end, xtol=smallest, rtol=4.0 * rounding))

    def _stop(self, t: float, z: Array, v: Array) -> None:
        """Brings a state onto all constraints, with what sticks at rest."""
        self.sampler.sample(np.array([np.nextafter(t, np.inf)]), z[None], v[None])
