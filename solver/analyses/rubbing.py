"""Joints with friction in analyses: how they move in a state, and what that asks.

What sticks is held, like a constraint. What slides has a force t that follows from the
multipliers, eq. (32), and with them from all that changes the load of the joint.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from ..errors import SimulationError
from ..integrators.recording import RUB_LOAD, RUB_RATE
from ..linear.accelerations import solve_prescribed_friction
from ..linear.friction import limit
from ..recording.grip_choice import JAMMED, Grip, with_grips
from ..space import layout as at
from ..start.assembly import Start
from ..start.loads import with_prescribed_friction
from ..system.scene import System
from ..system.sizes import resting_rates, sliding_sizes
from .mechanics import Mechanics, null_space

#: Joints with less load are not loaded, relative to the largest multiplier.
UNLOADED = 1e-12


def with_all_prescribed(system: System, start: Start, driven: Array) -> System:
    """The system in which no joint with friction is free to stick.

    driven : (n,) True for the velocity coordinates that move

    Raises
    ------
    InputError : the load of a joint is statically indeterminate.
    """
    if not system.rubbing:
        return system
    system = with_prescribed_friction(system, start, driven)
    grip = system.arrays.grip.copy()
    grip[:, at.LED] = resting_rates(system)
    return replace(system, arrays=system.arrays.replaced(grip=grip))


def prescribed_friction(
    mechanics: Mechanics, multipliers: Array, responses: Array
) -> Array:
    """Forces of friction (frictions,) of a known motion at the state evaluated last.

    multipliers : (rows,) without friction
    responses : (frictions, rows) what unit forces along the coordinates add to them

    Raises
    ------
    SimulationError : friction has no solution, or several.
    """
    mechanics.memory.rub_X[:] = 0.0
    return friction_of(mechanics, multipliers, responses)


def friction_of(mechanics: Mechanics, multipliers: Array, responses: Array) -> Array:
    """Forces of friction (frictions,), of accelerations and what unit forces add to
    them that stand in the memory of the mechanics.

    Parameters and errors as of `prescribed_friction`.
    """
    system, work, memory = mechanics.system, mechanics.work, mechanics.memory
    memory.multiplier[:], memory.rub_L[:] = multipliers, responses
    if solve_prescribed_friction(system.arrays, work, memory) != 0:
        raise SimulationError(f"stopped at t = {mechanics.t:.9g} s: {JAMMED}")
    return np.array(work.rub)


def gripped(system: System, t: float, start: Start) -> System:
    """The system with joints that stick and slide as they do in a state.

    Raises
    ------
    InputError : the load of a joint is statically indeterminate.
    SimulationError : friction has no solution there.
    """
    system = with_grips(with_prescribed_friction(system, start))
    chosen = Grip(system)
    why = chosen.settle(t, start.z, start.v)
    if why:
        raise SimulationError(f"at t = {t:.9g} s: {why}")
    return system


class RubbingMechanics(Mechanics):
    """The equations near a state in which joints stick or slide.

    held, sliding : joints with friction that do, the latter with a load

    Raises
    ------
    InputError : a joint breaks loose in the state, or carries no load.
    SimulationError : friction has no solution there.
    """

    def __init__(
        self, system: System, t: float, clock: float, z: Array, v: Array
    ) -> None:
        system = with_grips(with_prescribed_friction(system, Start(z, v)))
        super().__init__(system, t, clock)
        self._settle(z, v)

    def _settle(self, z: Array, v: Array) -> None:
        system = self.system
        chosen = Grip(system)
        why = chosen.settle(self.t, z, v)
        if why:
            raise SimulationError(f"at t = {self.t:.9g} s: {why}")
        told = chosen.told(np.array([self.t]), z[None], v[None])[0]
        self._loads = told[:, RUB_LOAD]
        largest = np.abs(chosen.memory.multiplier).max(initial=0.0)
        self._changes = np.array(chosen.work.rubbing)
        rests = np.abs(told[:, RUB_RATE]) <= resting_rates(system)
        self._sense = np.where(chosen.led & rests, 0.0, chosen.grip[:, at.SENSE])
        unloaded = ~chosen.led & (self._loads <= UNLOADED * largest)
        self._refuse_undecided(rests, unloaded)
        self.held = np.flatnonzero((self._sense == 0.0) & ~chosen.led)
        self.sliding = np.flatnonzero(self._sense)

    def _refuse_undecided(self, rests: Array, unloaded: Array) -> None:
        """States beside which friction has no derivative."""
        for j, rub in enumerate(self.system.rubbing):
            place = f"joints.{rub.joint}.friction"
            if unloaded[j]:
                raise InputError(
                    f"{rub.joint} carries no load in this state: its friction holds "
                    "nothing, and has no derivative",
                    place=place,
                    expected="a state in which it is loaded, or no friction",
                )
            if rests[j] and self._sense[j] != 0.0:
                raise InputError(
                    f"{rub.joint} rests in this state, but its friction cannot hold it "
                    "there: where it breaks loose friction has no derivative",
                    place=place,
                    expected="a state in which it sticks or slides, such as the static "
                    "equilibrium, or a state of a run",
                )

    @property
    def jacobian(self) -> Array:
        return np.vstack([super().jacobian, self.directions[self.held]])

    @property
    def rates(self) -> Array:
        return np.append(super().rates, self._of_held(at.C_RATE))

    @property
    def gamma(self) -> Array:
        return np.append(super().gamma, self._of_held(at.C_GAMMA))

    def _of_held(self, column: int) -> Array:
        return np.asarray(self.work.sliding.row[self.held, column])

    @property
    def sizes(self) -> Array:
        return np.append(super().sizes, sliding_sizes(self.system)[self.held])

    @property
    def force(self) -> Array:
        """With that of what slides, of the loads in the state."""
        return super().force + self._friction @ self.directions[self.sliding]

    @property
    def _friction(self) -> Array:
        arrays, found = self.system.arrays, []
        for j in self.sliding:
            rate = float(self.work.sliding.row[j, at.C_RATE])
            size = self._sense[j] * limit.py_func(arrays, j, rate)[0]
            viscous = arrays.pool[arrays.friction[j, at.R_LAW] + at.L_VISCOUS]
            found.append(-size * self._loads[j] - viscous * rate)
        return np.array(found)

    def unconstrained(self, motion: Array) -> Array:
        """With friction t = -R lambda, those along which C^T - B^T R has no part."""
        if not len(self.sliding):
            return motion
        C = self.jacobian
        for j, along in zip(self.sliding, self.directions[self.sliding], strict=True):
            row = self.system.arrays.friction[j]
            for r in range(row[at.R_COUNT]):
                C[row[at.R_ROWS + r]] -= self._changes[j, r] * along
        found = null_space(C)
        if found.shape != motion.shape:
            raise SimulationError(f"at t = {self.t:.9g} s: {JAMMED}")
        return found

    def solve_inertia(self, inertia: Array, right: Array) -> Array:
        """Of the directions `unconstrained`, along which it is not symmetric."""
        if not len(self.sliding):
            return super().solve_inertia(inertia, right)
        return np.asarray(np.linalg.solve(inertia, right), np.float64)

    def notes(self) -> tuple[str, ...]:
        """What has to be known of friction in the state."""
        names = [rub.joint for rub in self.system.rubbing]
        held = ", ".join(names[j] for j in self.held)
        sliding = ", ".join(names[j] for j in self.sliding)
        told = []
        if held:
            told.append(
                f"friction holds {held} in this state: modes are those of motions too "
                "small to break that loose"
            )
        if sliding:
            told.append(
                f"{sliding} slides in this state: modes tell of motions too small to "
                "stop it"
            )
        return tuple(told)


def mechanics_at(system: System, t: float, z: Array, v: Array) -> Mechanics:
    """The equations near a state, with what sticks there held.

    Raises as `RubbingMechanics`.
    """
    clock = float(system.clocks(np.array([t]))[0])
    if system.rubbing:
        return RubbingMechanics(system, t, clock, z, v)
    return Mechanics(system, t, clock)
