"""Bodies that are carried: where joints and drives that prescribe frames put them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.layout import IntTable
from ..system import kernel_calls
from ..system.bodies.embedded import matrices
from ..system.bodies.packing import quaternion
from ..system.scene import System
from ..system.storage import new_work


def place_carried(system: System, z: Array, v: Array) -> None:
    """Gives carried bodies the coordinates that their joints prescribe at the start.

    The assembly then leaves them alone, and a scene with all of its joints starts where
    the one without them does.
    """
    if system.carrying is None:
        return
    work = new_work(system)
    work.clock[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    kernel_calls.evaluate(carrying(system), work, system.scene.time.start, z, v)
    for b in carried_rows(system.carrying):
        keep_frame(system, b, work.frame[b], z, v)


def carrying(system: System) -> System:
    """The system in which frames that joints prescribe have no coordinates."""
    if system.carrying is None:
        return system
    return replace(system, arrays=system.arrays.replaced(body=system.carrying))


def carried_rows(body: IntTable) -> list[int]:
    """Rows of the bodies whose frames a body table prescribes."""
    motion = body[:, at.MOTION]
    return [int(b) for b in np.flatnonzero((motion != at.FREE) & (motion != at.GROUND))]


def keep_frame(system: System, b: int, frame: Array, z: Array, v: Array) -> None:
    """Writes a frame (.) into the coordinates of its body, or frames (nt, .)."""
    row = system.arrays.body[b]
    p, u, rigid = row[at.POS], row[at.VEL], row[at.RD]
    of = system.frames(frame)
    if system.planar:
        turn = np.asarray(of["angle"])[..., None]
    else:
        turn = quaternion(matrices(of["R"]))
    position = np.concatenate([of["x"], turn], axis=-1)
    velocity = np.concatenate([of["v"], of["w"]], axis=-1)
    count = row[at.NP] - row[at.NQ]
    z[..., p : p + count] = position[..., :count]
    v[..., u : u + rigid] = velocity[..., :rigid]
