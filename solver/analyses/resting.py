"""Scenes that start in their static equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import Array

from ..errors import SimulationError
from ..space import layout as at
from ..system.scene import System
from .held import is_state, with_integrated_rates
from .inverse import relative_equilibrium
from .static import static_equilibrium


def resting(system: System) -> tuple[SceneFile, dict[str, float], tuple[str, ...]]:
    """The scene of a system with its bodies in equilibrium, states of its laws there
    by name, and what is told of it.

    Gravity and loads are those at the start, drives hold their values there. Stated
    velocities stay as they are; see `spinning` for what they do. Where drives
    prescribe all motion and move at once, as in steady spin, bodies are in equilibrium
    with the loads of that motion, too.

    system : with all of its joints

    Raises
    ------
    InputError : there is no equilibrium near the start.
    """
    try:
        moved = with_integrated_rates(system)
        z = relative_equilibrium(moved)
        if z is not None:
            return with_bodies(system, scene_at(moved, z)), {}, ()
        found = static_equilibrium(system)
    except SimulationError as error:
        raise InputError(
            str(error), place="initial.state", expected="a scene that can rest"
        ) from None
    system = found.system
    states = {
        data.name: float(found.v[system.arrays.body[b, at.VEL]])
        for b, data in enumerate(system.bodies)
        if is_state(system, b)
    }
    return scene_at(system, found.z), states, found.notes


def with_bodies(system: System, other: SceneFile) -> SceneFile:
    """The scene of a system with bodies that start as those of another scene, and do
    not deform further where nothing else is stated."""
    bodies = dict(other.bodies)
    for data in system.flexible:
        start = bodies[data.name].initial
        if getattr(start, "elastic_velocity", None) is None:
            still = start.model_copy(update={"elastic_velocity": (0.0,) * data.sid.nq})
            bodies[data.name] = bodies[data.name].model_copy(update={"initial": still})
    return system.scene.model_copy(update={"bodies": bodies})


def scene_at(system: System, z: Array) -> SceneFile:
    """The scene with its bodies at some positions."""
    bodies = dict(system.scene.bodies)
    for b, data in enumerate(system.bodies):
        if data.name in bodies:
            start = bodies[data.name].initial
            place = _placed(system, z, b)
            moved = start.model_copy(update=place)
            bodies[data.name] = bodies[data.name].model_copy(update={"initial": moved})
    return system.scene.model_copy(update={"bodies": bodies})


def _placed(system: System, z: Array, b: int) -> dict[str, Any]:
    """Position, orientation and elastic coordinates of a body, as a scene says them."""
    row = system.arrays.body[b]
    first, count, nq = int(row[at.POS]), int(row[at.NP]), int(row[at.NQ])
    own = [float(x) for x in z[first : first + count]]
    rigid, elastic = own[: count - nq], tuple(own[count - nq :])
    place: dict[str, Any] = {"elastic": elastic} if nq else {}
    if not rigid:
        return place
    axes = 2 if system.planar else 3
    place["position"] = tuple(rigid[:axes])
    if len(rigid) == 3 and system.planar:
        place["angle"] = rigid[2]
    elif len(rigid) == 7:
        turn = np.array(rigid[3:])
        place |= {"axis_angle": None, "matrix": None}
        place["quaternion"] = tuple(float(x) for x in turn / np.linalg.norm(turn))
    return place
