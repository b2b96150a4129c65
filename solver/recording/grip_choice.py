"""Stick or slip: how joints with friction go on from an instant.

Theory, section 14. What slides goes on, what rests sticks if friction can hold it. A
joint that is pressed along one direction alone has a side on which it is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.sid import Array

from ..integrators import recording
from ..integrators.recording import (
    N_RUB,
    RUB_FORCE,
    RUB_LOAD,
    RUB_PLACE,
    RUB_PRESS,
    RUB_PUSH,
    RUB_RATE,
)
from ..space import layout as at
from ..system import kernel_calls
from ..system.forces.grips import Grips
from ..system.scene import System
from ..system.sizes import resting_rates
from .sampling import Sampler

#: Friction is at its limit within this part of it.
AT_LIMIT = 1e-9
#: Events without progress in time after which a run is given up.
MOST_AT_ONCE = 100
#: Progress in time that is none, relative to the time and the span of a run.
ROUNDED = 4.0 * float(np.finfo(float).eps)
#: A joint that was seen to break loose does so also where its limit seems so far.
SEEN = 1e-6
#: A joint turns round where to stop it would take so many times what its load holds.
CLEARLY = 2.0
#: Joints that stick hold the same motion where so little tells them apart.
DEPENDENT = 1e-8
JAMMED = "friction has no solution, or several: the load that it makes feeds it"


def with_grips(system: System) -> System:
    """The system with grips of its own, for one run."""
    if not system.rubbing:
        return system
    grips = Grips(system.arrays.grip.copy())
    return replace(system, arrays=system.arrays.replaced(grip=grips.now), grips=grips)


State = tuple[Array, Array, Array]


class Grip:
    """Chooses how joints with friction move on.

    Attributes
    ----------
    turning : joints whose grips change next
    reversing : places of contact, in one row, whose force changes its side next
    changed : those whose grips did last
    """

    def __init__(
        self, system: System, rtol: float = 0.0, closed: Array | None = None
    ) -> None:
        """closed : see `Sampler`; default states are taken as they are"""
        assert system.grips is not None
        self.system = system
        self.sampler = Sampler(system, np.zeros((0, 2)) if closed is None else closed)
        self.grips, self.grip = system.grips, system.grips.now
        self.work, self.memory = self.sampler.work, self.sampler.memory
        self.led, self.still = self.grip[:, at.LED] > 0.0, resting_rates(system)
        self.span = system.scene.time.end - system.scene.time.start
        self.rest = np.array([self._static(j) for j in range(len(self.grip))])
        self.fastest, self.rtol = np.zeros(len(self.grip)), rtol
        self.flat = np.array([self._flat(j) for j in range(len(self.grip))])
        self.pressed = np.zeros(self.flat.shape)
        self.pushed, self.eased = np.zeros(len(self.grip)), np.zeros(len(self.grip))
        self.turning: list[int] = []
        self.reversing: list[int] = []
        self.changed = set[int]()
        self.begun, self._last, self._count = False, -np.inf, 0

    def _static(self, j: int) -> float:
        """What a unit load holds."""
        law = self.system.arrays.friction[j, at.R_LAW]
        pool = self.system.arrays.pool
        return float(pool[law + at.L_STATIC] * pool[law + at.L_ARM])

    def _flat(self, j: int) -> list[bool]:
        """Whether what presses each place of a joint has a single direction."""
        across = [bool(place[1].any()) for place in self.system.rubbing[j].weights]
        return [k < len(across) and not across[k] for k in range(at.MOST_PLACES)]

    def told(self, t: Array, z: Array, v: Array) -> Array:
        """What the joints do in states of one smooth interval, (nt, frictions, .)."""
        found = np.zeros((len(t), len(self.grip), N_RUB))
        self.work.clock[0] = self.system.clocks(t[len(t) // 2 :])[0]
        arrays = self.system.arrays
        calls = self.sampler.kernels
        recording.rub(calls, arrays, self.work, self.memory, t, z, v, found)
        kernel_calls.go_on(self.system)
        return found

    def settle(self, t: float, z: Array, v: Array) -> str:
        """Chooses the grips from an instant on.

        What slides goes on. What rests sticks if it can. They stand in `grips.now`.
        Returns why there is no choice, or nothing.
        """
        progress = ROUNDED * max(abs(t), self.span)
        self._count = self._count + 1 if t <= self._last + progress else 0
        self._last = t
        if self._count > MOST_AT_ONCE:
            count = self.flat.shape[1]
            joints = self.turning or [k // count for k in self.reversing]
            return f"{self._names(joints)} change between stick and slip at once"
        states = np.array([t]), z[None], v[None]
        before, turning = self.grip.copy(), self.turning
        sense = self.grip[:, at.SENSE]
        self.grip[:] = 0.0
        self.grip[:, at.LED] = before[:, at.LED]
        told = self.told(*states)[0]
        stops = any(before[j, at.SENSE] != 0.0 for j in turning)
        noise = self.rtol * self.fastest if stops else 0.0
        rests = np.abs(told[:, RUB_RATE]) <= self.still + noise
        rests[turning] = True
        sense[:] = np.where(rests, 0.0, np.sign(told[:, RUB_RATE]))
        self._follow(told)
        rests &= ~self.led
        stuck = (before[:, at.SENSE] == 0.0) & rests & self.begun
        self.grip[:, at.HELD] = np.where(stuck, before[:, at.HELD], told[:, RUB_PLACE])
        for j in np.intersect1d(turning, np.flatnonzero(rests & ~stuck)):
            if self._passes(states, int(j), -before[j, at.SENSE]):
                rests[j] = False
        self.turning = []
        why = self._choose(states, rests, [j for j in turning if stuck[j]])
        self.grip[~self._sticking, at.HELD] = 0.0
        self._take_sides(states, before[:, at.SIDE :])
        changed = (before[:, at.SENSE] != sense) & self.begun
        self.changed = {*np.flatnonzero(changed).tolist(), *turning}
        self.begun = True
        return why

    @property
    def _sticking(self) -> NDArray[np.bool_]:
        """Which joints friction holds, (frictions,)."""
        return (self.grip[:, at.SENSE] == 0.0) & ~self.led

    def _certain(self, told: Array) -> Array:
        """From which force on the side is certain that presses places, (frictions, .).

        Relative to the largest one so far, and to what has moved the joint where it
        moves most easily: at a dead point no force does.
        """
        self.eased = np.fmax(self.eased, self.memory.rub_P.diagonal())
        self.pushed = np.fmax(self.pushed, np.abs(told[:, :, RUB_PUSH]).max(axis=0))
        moving = self.pushed / np.maximum(self.eased, np.finfo(float).tiny)
        moving[self.led] = 0.0
        press = np.abs(told[:, :, RUB_PRESS:]).max(axis=0)
        self.pressed = np.fmax(self.pressed, press)
        return max(AT_LIMIT, self.rtol) * np.fmax(self.pressed, moving[:, None])

    def _follow(self, told: Array) -> None:
        """Takes the sense of motions that are prescribed: where they rest, that in
        which they go on."""
        rate, push = told[:, RUB_RATE], told[:, RUB_PUSH]
        noise = self.rtol * self.fastest
        noise[[j for j in range(len(noise)) if j not in self.turning]] = 0.0
        goes_on = np.where(np.abs(push) * self.span > self.still, push, 0.0)
        ways = np.where(np.abs(rate) > self.still + noise, rate, goes_on)
        self.grip[self.led, at.SENSE] = np.sign(ways[self.led])

    def _take_sides(self, states: State, before: Array) -> None:
        """Keeps the sides on which sliding joints are pressed, until they change."""
        told = self.told(*states)
        press, certain = told[0, :, RUB_PRESS:], self._certain(told)
        sides = np.where(before == 0.0, 1.0, before)
        sides.ravel()[self.reversing] *= -1.0
        sides = np.where(np.abs(press) > certain, np.sign(press), sides)
        slides = self.grip[:, at.SENSE, None] != 0.0
        self.grip[:, at.SIDE :] = np.where(self.flat & slides, sides, 0.0)
        self.reversing = []

    def _passes(self, states: State, j: int, sense: float) -> bool:
        """Whether a joint that turns round does so far above what could stop it.

        To stop it might take any force: where other joints move on, its coordinate may
        have a stationary value. Its sense is the new one then.
        """
        self._mark_shared()
        self.grip[j, at.SENSE] = sense
        told = self.told(*states)[0]
        needed = told[j, RUB_FORCE] * self.memory.rub_P[j, j] - told[j, RUB_PUSH]
        held = self.rest[j] * told[j, RUB_LOAD] * self.memory.rub_P[j, j]
        if sense * told[j, RUB_PUSH] > 0.0 and abs(needed) > CLEARLY * held:
            return True
        self.grip[j, at.SENSE] = 0.0
        return False

    def _mark_shared(self) -> None:
        """Marks joints that stick if some of them hold the same motion."""
        stuck = np.flatnonzero(self._sticking)
        P = self.memory.rub_P[np.ix_(stuck, stuck)]
        size = np.sqrt(np.maximum(P.diagonal(), np.finfo(float).tiny))
        alone = np.linalg.eigvalsh(P / np.outer(size, size)).min(initial=1.0)
        self.grip[:, at.SHARED] = 0.0
        self.grip[stuck, at.SHARED] = float(alone < DEPENDENT)

    def _choose(self, states: State, rests: Array, loose: list[int]) -> str:
        """Lets go, one after another, what friction cannot hold.

        loose : joints that were seen to break loose
        """
        sense, names = self.grip[:, at.SENSE], self._names(np.flatnonzero(rests))
        for _ in range(4 * len(sense) + 1):
            self._mark_shared()
            told = self.told(*states)[0]
            if not np.isfinite(told[:, RUB_FORCE]).all():
                moves = self._moves_at_once(states, rests)
                return "" if moves else f"{JAMMED} ({names})"
            held = self.rest * told[:, RUB_LOAD]
            negligible = self._negligible()
            excess = np.abs(told[:, RUB_FORCE]) - held - negligible
            excess[loose] += SEEN * held[loose] + 2.0 * negligible[loose]
            excess[~self._sticking] = -np.inf
            worst = int(np.argmax(excess - AT_LIMIT * held))
            if excess[worst] > AT_LIMIT * held[worst]:
                sense[worst] = -np.sign(told[worst, RUB_FORCE])
                continue
            least = self.memory.rub_P.diagonal() * (AT_LIMIT * held + negligible)
            back = rests & (sense * told[:, RUB_PUSH] < -least)
            if not back.any():
                return ""
            sense[back] = 0.0
        return f"friction allows neither stick nor slip ({names})"

    def _negligible(self) -> Array:
        """Friction forces that change no rate in the whole run, (frictions,).

        An unloaded joint at rest holds nothing but rounding.
        """
        mobility = np.maximum(self.memory.rub_P.diagonal(), np.finfo(float).tiny)
        return np.asarray(self.still / (self.span * mobility))

    def _moves_at_once(self, states: State, rests: Array) -> bool:
        """Lets go all that rests and holds one motion together, one way or the other.

        Where one after another lets go, what the last of them holds may feed loads
        without bound, though the mechanism can move.
        """
        at_rest, P = np.flatnonzero(rests), self.memory.rub_P.copy()
        if not len(at_rest):
            return False
        first = at_rest[0]
        size = np.sqrt(np.maximum(P.diagonal() * P[first, first], 0.0))
        if (np.abs(P[at_rest, first]) < (1.0 - DEPENDENT) * size[at_rest]).any():
            return False
        ways = np.sign(P[at_rest, first])
        for way in (ways, -ways):
            self.grip[at_rest, at.SENSE] = way
            self._mark_shared()
            push = self.told(*states)[0][at_rest, RUB_PUSH]
            if np.isfinite(push).all() and (way * push > 0.0).all():
                return True
        return False

    def _names(self, joints: Iterable[int]) -> str:
        return ", ".join(self.system.rubbing[j].joint for j in joints)


def regripped(system: System, t: Array, z: Array, v: Array) -> None:
    """Puts the grips of known states into a system `with_grips`, from each time on.

    t, z, v : (nt,), (nt, .), (nt, .)
    """
    if system.grips is None:
        return
    chosen = Grip(system)
    system.grips.forget()
    for when, place, velocity in zip(t, z, v, strict=True):
        chosen.settle(float(when), place, velocity)
        system.grips.note(float(np.nextafter(when, -np.inf)))
