"""Axes in which the small motions of point masses are seen.

The coordinates of a body are in axes that turn with it, in which a steady rotation
stands still. A point mass has no axes of its own: its coordinates are inertial, and
those of one on a rotor would go round. It is seen from the body that carries it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import Array
from sidtool.formats.sid_mass import skew

from ..space import layout as at
from ..system.bodies.embedded import embedded, matrices
from .mechanics import Mechanics


def turning_of_points(mechanics: Mechanics, v: Array, a: Array) -> Array:
    """W (n, n), scaled: velocities u in the axes of the carriers have u' = a - W v.

    v, a : scaled velocities and accelerations (n,) at the state evaluated last. Of
        several bodies that are next to a point mass that one carries it in whose axes
        its velocity changes least.
    """
    system, n = mechanics.system, mechanics.system.n_velocities
    frames = system.frames(mechanics.work.frame)
    size = 2 if system.planar else 3
    spins = matrices(frames["R"]) @ embedded(frames["w"])[..., None]
    bodies = [*zip(system.arrays.body, system.bodies, skew(spins[..., 0]), strict=True)]
    points = {b.name: row[at.VEL] for row, b, _ in bodies if _is_point(row, b, size)}
    turns = {b.name: W[:size, :size] for _, b, W in bodies if b.name not in points}
    W = np.zeros((n, n))
    for name, u in points.items():
        own = slice(int(u), int(u) + size)
        carriers = _carriers(system.scene, name, set(points))
        seen = [turns[c] for c in sorted(carriers) if c in turns]
        seen.sort(key=lambda turn: not turn.any())
        if seen:
            lefts = [np.linalg.norm(a[own] - turn @ v[own]) for turn in seen]
            W[own, own] = seen[int(np.argmin(lefts))]
    return W


def _is_point(row: Array, body: object, size: int) -> bool:
    return bool(getattr(body, "of_scene", False)) and row[at.NV] == row[at.RD] == size


def _carriers(scene: SceneFile, name: str, points: set[str]) -> set[str]:
    """The bodies nearest to a point mass along joints and drives, else along forces,
    over other point masses."""
    for tables in ((scene.joints, scene.drives), (scene.joints, scene.forces)):
        links = [_owners(part) for table in tables for part in table.values()]
        reached, new = set[str](), {name}
        while new:
            reached |= new
            near = set().union(*(link for link in links if link & new)) - reached
            if near - points:
                return near - points
            new = near
    return set()


def _owners(part: object) -> set[str]:
    """The bodies whose markers a joint, drive or force names."""
    named: Iterable[str | None] = (
        *(getattr(part, "markers", None) or ()),
        getattr(part, "marker", None),
        getattr(part, "reference", None),
    )
    return {text.partition(".")[0] for text in named if text}
