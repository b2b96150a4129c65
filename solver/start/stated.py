"""The state that a scene states, before the assembly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import Initial, as_3d, rotation
from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.bodies.data import BodyData
from ..system.bodies.packing import quaternion
from ..system.scene import System
from .carried import place_carried
from .turn_counts import starting_turns


@dataclass(frozen=True, eq=False)
class Start:
    """A consistent state: z_I and z_II."""

    z: Array
    v: Array


def guess(system: System) -> Start:
    """The state that the scene file states.

    Raises
    ------
    InputError : wrong number of elastic coordinates.
    """
    z, v = np.zeros(system.n_positions), np.zeros(system.n_velocities)
    for row, data in zip(system.arrays.body.tolist(), system.bodies, strict=True):
        if not data.of_scene:
            began = (system.scene.initial.states or {}).get(data.name, data.starts_at)
            v[row[at.VEL] : row[at.VEL] + row[at.NV]] = began
            continue
        initial = system.scene.initial_of(data.name)
        rigid = row[at.NP] - row[at.NQ]
        p, u = row[at.POS], row[at.VEL]
        if row[at.RD] > 0:
            axes = 2 if system.planar else 3
            z[p : p + axes] = initial.position or 0.0
            v[u : u + axes] = _in_frame(initial, initial.velocity)[:axes]
            if system.planar and rigid == 3:
                z[p + 2] = initial.angle or 0.0
                v[u + 2] = float(np.ravel(initial.angular_velocity or 0.0)[-1])
            elif rigid == 7:
                z[p + 3 : p + 7] = _quaternion(system, data.name)
                v[u + 3 : u + 6] = _in_frame(initial, initial.angular_velocity)
        z[p + rigid : p + row[at.NP]] = _elastic(initial, "elastic", data)
        v[u + row[at.RD] : u + row[at.NV]] = _elastic(initial, "elastic_velocity", data)
    place_carried(system, z, v)
    z[len(z) - system.n_turns :] = starting_turns(system)
    return Start(z, v)


def stated_velocities(system: System) -> Array:
    """True for the velocity coordinates that the scene file states, (n,).

    A body of which it states any has elastic velocities of zero unless it says others.
    """
    stated = np.zeros(system.n_velocities, bool)
    for row, data in zip(system.arrays.body.tolist(), system.bodies, strict=True):
        if not data.of_scene:
            continue
        initial = system.scene.initial_of(data.name)
        u, axes = row[at.VEL], 2 if system.planar else 3
        turns, elastic = u + min(axes, row[at.RD]), u + row[at.RD]
        stated[u:turns] = initial.velocity is not None
        stated[turns:elastic] = initial.angular_velocity is not None
        given = getattr(initial, "elastic_velocity", None)
        moves = stated[u:elastic].any() or given is not None
        stated[elastic : u + row[at.NV]] = moves
    return stated


def _quaternion(system: System, body: str) -> Array:
    """The orientation of a body; of a result with its sign, which `angle` counts."""
    initial = system.scene.initial_of(body)
    if initial is system.scene.bodies[body].initial or initial.quaternion is None:
        return quaternion(rotation(initial))
    found = np.array(initial.quaternion)
    return found / np.linalg.norm(found)


def _in_frame(initial: Initial, value: Any) -> Array:
    """Inertial components, as files hold them, in the body frame, (3,)."""
    return np.zeros(3) if value is None else rotation(initial).T @ as_3d(value)


def _elastic(initial: Initial, key: str, data: BodyData) -> Array | float:
    values = getattr(initial, key, None)
    if values is None:
        return 0.0
    if len(values) != data.sid.nq:
        raise InputError(
            f"has {len(values)} values",
            place=f"bodies.{data.name}.initial.{key}",
            expected=f"{data.sid.nq}, one for each elastic coordinate of the SID",
        )
    return np.array(values)
