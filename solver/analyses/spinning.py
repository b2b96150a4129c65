"""Starts in steady spin: bodies deformed by the loads of the velocities stated.

Elastic coordinates have neither velocity nor acceleration; the rigid motion of bodies
goes on as forces, joints and their friction make it. Of a body that spins steadily that
is its relative equilibrium, in other motions it is the start without vibration.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import Array

from ..errors import SimulationError
from ..space import layout as at
from ..start.assembly import Start, assemble
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .held import with_integrated_rates
from .inverse import Motion, refuse_states
from .mechanics import Mechanics, least_squares, null_space
from .resting import scene_at, with_bodies
from .rubbing import friction_of, gripped

#: Rounds in which what sticks and slides has to agree with the deformation.
ROUNDS = 8


def spinning(system: System) -> tuple[SceneFile, tuple[str, ...]]:
    """The scene of a system with its bodies deformed by the loads of its motion at the
    start, and why they are not where that cannot be had.

    system : with all of its joints
    """
    flexible = [data.name for data in system.bodies if data.of_scene and data.sid.nq]
    assembled, start = assemble(with_integrated_rates(system))
    if not flexible or not _moves(assembled, start.v):
        return system.scene, ()
    try:
        refuse_states(assembled)
        found = _deformed(assembled, start)
    except (InputError, SimulationError) as error:
        return system.scene, (
            f"{', '.join(flexible)} start deformed as at rest, without the loads of "
            f"the velocities at the start: {error}",
        )
    return with_bodies(system, scene_at(assembled, found.z)), ()


def _deformed(system: System, start: Start) -> Start:
    """The start with its bodies deformed, what sticks and slides there decided.

    Raises
    ------
    InputError : the load of a joint with friction is not determined.
    SimulationError : there is no such state.
    """
    t = system.scene.time.start
    clock = float(system.clocks(np.array([t]))[0])
    if system.rubbing:
        system = gripped(system, t, start)
    for _ in range(ROUNDS):
        mechanics = Mechanics(system, t, clock)
        mechanics.scale = coordinate_sizes(system)
        found = _Stated(mechanics, start.v).deformed(start.z)
        if found is None:
            raise SimulationError("joints come apart without the deformation of bodies")
        if not system.rubbing:
            return found
        again = gripped(system, t, found)
        if (again.arrays.grip[:, at.SENSE] == system.arrays.grip[:, at.SENSE]).all():
            return found
        system = again
    raise SimulationError("joints with friction find no way to stick or slide")


def _moves(system: System, v: Array) -> bool:
    """Whether a body has a velocity, other than that of its elastic coordinates."""
    rows = zip(system.arrays.body, system.bodies, strict=True)
    return any(
        v[row[at.VEL] : row[at.VEL] + row[at.RD]].any()
        for row, data in rows
        if data.of_scene
    )


class _Stated(Motion):
    """States with given velocities of bodies, as far as joints and drives leave them.

    v : (n velocities,) of which those of the elastic coordinates count as zero
    friction : (frictions,) forces of joints in the accelerations found last
    """

    def __init__(self, mechanics: Mechanics, v: Array) -> None:
        super().__init__(mechanics, quasi_static=True)
        self.stated = np.where(self.driven, v / mechanics.scale, 0.0)
        self.friction = np.zeros(len(self.system.rubbing))

    def velocities(self, z: Array) -> Array:
        mechanics = self.mechanics
        mechanics.evaluate(z, np.zeros(self.system.n_velocities))
        missed = mechanics.rates + mechanics.jacobian @ self.stated
        return (self.stated + self.driven_solution(-missed)) * mechanics.scale

    def accelerations(self, state: Start) -> Array:
        """Scaled accelerations of bodies whose elastic coordinates have none."""
        mechanics, driven = self.mechanics, self.driven
        mechanics.evaluate(state.z, state.v)
        C, f = mechanics.jacobian[:, driven], mechanics.force[driven]
        M = mechanics.mass[np.ix_(driven, driven)]
        demanded, N = least_squares(C, mechanics.gamma), null_space(C)

        def whole(a: Array, f: Array) -> Array:
            """Of a that constraints demand, and forces f."""
            found = np.zeros(self.system.n_velocities)
            found[driven] = a
            if N.shape[1]:
                free = mechanics.solve_inertia(N.T @ M @ N, N.T @ (f - M @ a))
                found[driven] += N @ free
            return found

        a = whole(demanded, f)
        if self.system.rubbing:
            along = mechanics.directions[:, driven]
            unit = np.array([whole(np.zeros(len(M)), row) for row in along])
            multipliers = mechanics.multipliers(M @ a[driven] - f, driven)
            responses = np.array(
                [
                    mechanics.multipliers(M @ x[driven] - row, driven)
                    for x, row in zip(unit, along, strict=True)
                ]
            )
            memory, scale = mechanics.memory, mechanics.scale
            memory.acceleration[:], memory.rub_X[:] = a * scale, unit * scale
            self.friction = friction_of(mechanics, multipliers, responses)
            a = a + self.friction @ unit
        return a

    def forces(self, a: Array) -> tuple[Array, Array]:
        """Multipliers and friction of accelerations that were just found."""
        mechanics, driven = self.mechanics, self.driven
        unbalanced = mechanics.mass @ a - mechanics.force
        unbalanced -= self.friction @ mechanics.directions
        return mechanics.multipliers(unbalanced[driven], driven), self.friction
