"""Springs about axes in space end a run before they lose count of their turns.

Two orientations tell a rotation below half a turn only. Beyond it the torque of a
spring would jump to that of the rotation the other way round.
"""

from __future__ import annotations

import math

import numpy as np

from formats.sid import Array

from . import kernel_calls
from .dense import Steps
from .force_measures import deflection
from .kernels import layout as at
from .sampling import Samples
from .scene import GROUND_NAME, System
from .storage import new_work

#: Part of the way to half a turn that speeds are trusted to have not passed.
TRUSTED = 0.8


def springs_about_axes(system: System) -> list[int]:
    """Rows of the force table with different rotations in space that laws depend on."""
    found: dict[tuple[object, ...], int] = {}
    for k, element in enumerate(system.forces):
        if element.kind == at.TILT:
            found.setdefault((element.a, element.b), k)
        elif element.kind == at.TWIST and len(element.law.stiffness.starts):
            found[(k,)] = k
    return [] if system.planar else list(found.values())


class HalfTurns:
    """Looks at the rotations of springs in the steps of a run.

    Attributes
    ----------
    t : time at which one passed half a turn [s], infinite as long as none did
    name : of its force
    """

    def __init__(self, system: System) -> None:
        self.system, self.work = system, new_work(system)
        self.rows = springs_about_axes(system)
        self.last: dict[int, Array] = {}
        self.left = dict.fromkeys(self.rows, 0.0)
        self.now = system.scene.time.start
        self.t, self.name = math.inf, ""

    def look(self, steps: Steps) -> bool:
        """Looks at steps; True when a spring passed half a turn in them.

        Most springs are too slow to get there before they are looked at again, and
        few points are enough to follow those that are not.
        """
        if not len(steps.t):
            return False
        duration, self.now = float(steps.t[-1]) - self.now, float(steps.t[-1])
        ways = {k: duration * self._speed(steps, k) for k in self.rows}
        near = [k for k in self.rows if ways[k] >= self.left[k]]
        for k in self.rows:
            self.left[k] -= ways[k]
        if near:
            few = _spread(steps, max(ways[k] for k in near))
            turned = self._turned(few, near)
            if any(_jumps(turned[k]).any() for k in near):
                self._stop(steps, self._turned(steps, near))
            for k in near:
                self.last[k] = turned[k][-1:]
                angle = float(np.linalg.norm(turned[k][-1]))
                self.left[k] = TRUSTED * (math.pi - angle)
        return bool(self.name)

    def _speed(self, steps: Steps, k: int) -> float:
        """Bound of the relative angular velocity of two markers."""
        row = self.system.arrays.force[k]
        return sum(self._marker_speed(steps, int(row[e])) for e in (at.F_A, at.F_B))

    def _marker_speed(self, steps: Steps, m: int) -> float:
        """Of frame and deformation; unknown, and infinite, of a driven frame."""
        b = int(self.system.arrays.marker[m, at.M_BODY])
        row, data = self.system.arrays.body[b], self.system.bodies[b]
        if row[at.RD] == 0 and data.name != GROUND_NAME:
            return math.inf
        u = int(row[at.VEL])
        frame = np.linalg.norm(steps.v[:, u + 3 : u + row[at.RD]], axis=1)
        reference = next(ref for ref, i in self.system.markers.items() if i == m)
        psi = np.linalg.norm(data.node(reference[1]).psi.m0, axis=0)
        bend = np.abs(steps.v[:, u + row[at.RD] : u + row[at.NV]]) @ psi
        return float((frame + bend).max())

    def _turned(self, steps: Steps, rows: list[int]) -> dict[int, Array]:
        """Rotations (1 + nt, .) by row, beginning with the one known last."""
        clocks = self.system.clocks(steps.t)
        frames, points = [], []
        for t, z, v, clock in zip(steps.t, steps.z, steps.v, clocks, strict=True):
            self.work.clock[0] = clock
            kernel_calls.evaluate(self.system, self.work, t, z, v)
            frames.append(self.work.frame.copy())
            points.append(self.work.point.copy())
        nothing = np.zeros((len(steps.t), 0))
        states = steps.z, steps.v, np.array(frames), np.array(points)
        samples = Samples(*states, nothing, nothing)
        found = {}
        for k in rows:
            turned = deflection(self.system, samples, k)
            found[k] = np.vstack([self.last.get(k, turned[:1]), turned])
        return found

    def _stop(self, steps: Steps, turned: dict[int, Array]) -> None:
        """Takes the first of the jumps."""
        for k, history in turned.items():
            jumps = _jumps(history)
            t = float(steps.t[jumps.argmax()])
            if jumps.any() and t < self.t:
                self.t, self.name = t, self.system.forces[k].name

    def sentence(self) -> str:
        """Why the run stopped."""
        return (
            f"stopped at t = {self.t:.9g} s: {self.name} is half a turn away from "
            "rest; beyond, a spring in a spatial scene does not know its torque"
        )


def _jumps(turned: Array) -> Array:
    """Where a rotation goes over to the one the other way round, (nt,)."""
    return np.asarray(np.linalg.norm(np.diff(turned, axis=0), axis=1) > math.pi)


def _spread(steps: Steps, way: float) -> Steps:
    """Points between which less than a radian is turned, as far as there are, and the
    last one; `way` is turned in all."""
    count = min(way + 1.0, float(len(steps.t)))
    wanted = np.linspace(steps.t[0], steps.t[-1], math.ceil(count) + 1)[1:]
    chosen = np.unique(np.searchsorted(steps.t, wanted))
    return Steps(steps.t[chosen], steps.z[chosen], steps.v[chosen])
