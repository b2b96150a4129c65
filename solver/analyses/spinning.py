"""Starts in steady spin: bodies deformed by the loads of the velocities stated.

Elastic coordinates have neither velocity nor acceleration; the rigid motion of bodies
goes on as forces and joints make it. Of a body that spins steadily that is its relative
equilibrium, in other motions it is the start without vibration.
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
from .inverse import Motion, refuse_states
from .mechanics import Mechanics, least_squares, null_space
from .resting import scene_at


def spinning(system: System) -> tuple[SceneFile, tuple[str, ...]]:
    """The scene of a system with its bodies deformed by the loads of its motion at the
    start, and why they are not where that cannot be had.

    system : with all of its joints
    """
    flexible = [data.name for data in system.bodies if data.of_scene and data.sid.nq]
    assembled, start = assemble(system)
    if not flexible or not _moves(assembled, start.v):
        return system.scene, ()
    t = system.scene.time.start
    mechanics = Mechanics(assembled, t, float(assembled.clocks(np.array([t]))[0]))
    mechanics.scale = coordinate_sizes(assembled)
    try:
        refuse_states(assembled)
        _refuse_friction(assembled)
        found = _Stated(mechanics, start.v).deformed(start.z)
        if found is None:
            raise SimulationError("joints come apart without the deformation of bodies")
    except (InputError, SimulationError) as error:
        return system.scene, (
            f"{', '.join(flexible)} start deformed as at rest, without the loads of "
            f"the velocities at the start: {error}",
        )
    return scene_at(assembled, found.z), ()


def _moves(system: System, v: Array) -> bool:
    """Whether a body has a velocity, other than that of its elastic coordinates."""
    rows = zip(system.arrays.body, system.bodies, strict=True)
    return any(
        v[row[at.VEL] : row[at.VEL] + row[at.RD]].any()
        for row, data in rows
        if data.of_scene
    )


def _refuse_friction(system: System) -> None:
    if system.rubbing:
        raise InputError(
            f"{system.rubbing[0].joint} has friction, which depends on the deformation",
            expected="joints without friction, or drives that prescribe all motion",
        )


class _Stated(Motion):
    """States with given velocities of bodies, as far as joints and drives leave them.

    v : (n velocities,) of which those of the elastic coordinates count as zero
    """

    def __init__(self, mechanics: Mechanics, v: Array) -> None:
        super().__init__(mechanics, quasi_static=True)
        self.stated = np.where(self.driven, v / mechanics.scale, 0.0)

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
        a = least_squares(C, mechanics.gamma)
        N = null_space(C)
        if N.shape[1]:
            a = a + N @ mechanics.solve_inertia(N.T @ M @ N, N.T @ (f - M @ a))
        whole = np.zeros(self.system.n_velocities)
        whole[driven] = a
        return whole
