"""Bodies that rotate together at the start, about axes that are nearly the same.

Velocities that a scene states tell which bodies turn about which axis. Bodies that rest
and whose velocities are not stated may turn with those that they are connected to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..start.assembly import Start
from ..system.bodies.embedded import embedded, matrices
from ..system.scene import GROUND_NAME, System
from .axes import owners, spins_of_bodies
from .mechanics import Mechanics, null_space

#: Angular velocities that differ by less than this part are the same, axes that are
#: less apart in sizes of the mechanism likewise.
SAME_RATE, SAME_AXIS = 1e-6, 0.05


@dataclass(frozen=True, eq=False)
class Axis:
    """The axis about which a body turns.

    spin : (3,) angular velocity in inertial axes
    point : (3,) a point of the axis
    """

    spin: Array
    point: Array

    @property
    def rate(self) -> float:
        """The angular speed."""
        return float(np.linalg.norm(self.spin))

    def changed(self, x: Array) -> Axis:
        """Displaced and tilted by two components each, across it, (4,)."""
        across = null_space(self.spin[None] / self.rate).T
        spin = self.spin + self.rate * (x[2:] @ across)
        spin *= self.rate / np.linalg.norm(spin)
        return Axis(spin, self.point + x[:2] @ across)


@dataclass(frozen=True, eq=False)
class Group:
    """Bodies that turn together, about axes that are nearly the same.

    axes : by the rows of the bodies
    drift : (3,) velocity of the axes, of bodies that nothing connects to the ground
    acceleration : angular acceleration about them
    """

    axes: dict[int, Axis]
    drift: Array
    acceleration: float = 0.0

    @property
    def first(self) -> Axis:
        """That of the body that decides."""
        return next(iter(self.axes.values()))

    @property
    def unknowns(self) -> int:
        """Of all axes four, and the angular acceleration."""
        return 4 * len(self.axes) + 1

    def joined(self, bodies: Iterable[int]) -> Group:
        """With other bodies that turn about the first axis."""
        return replace(self, axes=self.axes | dict.fromkeys(bodies, self.first))

    def at(self, time: float) -> Group:
        """With resting axes where they are at a time."""
        axes = {
            b: Axis(axis.spin, axis.point + time * self.drift)
            for b, axis in self.axes.items()
        }
        return Group(axes, np.zeros(3), self.acceleration)

    def changed(self, x: Array) -> Group:
        """With other axes and acceleration, changed by x (unknowns,)."""
        axes = {
            b: axis.changed(x[4 * k : 4 * k + 4])
            for k, (b, axis) in enumerate(self.axes.items())
        }
        return Group(axes, self.drift, self.acceleration + float(x[-1]))


def hypotheses(mechanics: Mechanics, start: Start) -> Iterator[tuple[Group, ...]]:
    """Groups of bodies that may rotate, the more likely ones first.

    Bodies whose velocities are not stated, and that rest, either turn with those that
    they are connected to, or go on resting.
    """
    groups, followers = _groups(mechanics, start)
    if not groups:
        return
    if followers:
        yield tuple(
            group.joined(more) for group, more in zip(groups, followers, strict=True)
        )
    yield groups


def _groups(
    mechanics: Mechanics, start: Start
) -> tuple[tuple[Group, ...], tuple[tuple[int, ...], ...]]:
    """Groups of bodies that rotate at the start, and who may follow each of them; no
    followers at all where there are none, no groups where other bodies move."""
    system = mechanics.system
    mechanics.evaluate(start.z, start.v)
    positions, turns = places(mechanics, start.z)
    frames = system.frames(mechanics.work.frame)
    spins = spins_of_bodies(mechanics)
    velocities = (turns @ embedded(frames["v"])[..., None])[..., 0]
    fastest = float(np.linalg.norm(spins, axis=1).max(initial=0.0))
    found: list[Group] = []
    free: dict[int, int] = {}
    for part, is_grounded in components(system):
        mine = [b for b in part if np.linalg.norm(spins[b]) > SAME_RATE * fastest]
        mine.sort(key=lambda b: not _is_stated(system, b))
        first = len(found)
        drift = np.zeros(3)
        if mine and not is_grounded:
            if system.arrays.gravity.any():
                return (), ()  # it falls
            drift = _drift(system, part, turns, spins, velocities)
        for b in mine:
            moving = velocities[b] - drift
            point = positions[b] + np.cross(spins[b], moving) / (spins[b] @ spins[b])
            for k in range(first, len(found)):
                axis = found[k].first
                apart = np.linalg.norm(axis.spin - spins[b])
                way = np.cross(axis.spin, point - axis.point) / axis.rate
                near = np.linalg.norm(way) < SAME_AXIS * system.length
                if apart < SAME_RATE * fastest and (near or not _is_placed(system, b)):
                    found[k] = found[k].joined([b])
                    break
            else:
                found.append(Group({b: Axis(spins[b], point)}, drift))
        for b in part:
            if b in mine or not (found[first:] or velocities[b].any()):
                continue
            for k in range(first, len(found)):
                axis = found[k].first
                way = drift + np.cross(axis.spin, positions[b] - axis.point)
                missed = np.linalg.norm(velocities[b] - way)
                if velocities[b].any() and missed < SAME_AXIS * np.linalg.norm(way):
                    found[k] = found[k].joined([b])
                    break
            else:
                if velocities[b].any():
                    return (), ()
                if len(found) == first + 1 and not _is_stated(system, b):
                    free[b] = first
    if not free:
        return tuple(found), ()
    more = [tuple(b for b, k in free.items() if k == g) for g in range(len(found))]
    return tuple(found), tuple(more)


def _drift(
    system: System, part: list[int], turns: Array, spins: Array, velocities: Array
) -> Array:
    """Velocity (3,) of the common centre of mass of undeformed bodies."""
    mass, momentum = 0.0, np.zeros(3)
    for b in part:
        sid = system.bodies[b].sid
        arm = turns[b] @ sid.mdCM.m0[:, 0]
        mass += sid.mass
        momentum += sid.mass * velocities[b] + np.cross(spins[b], arm)
    return momentum / mass


def _is_stated(system: System, b: int) -> bool:
    """Whether the scene states a velocity of a body."""
    initial = system.scene.initial_of(system.bodies[b].name)
    return initial.velocity is not None or initial.angular_velocity is not None


def _is_placed(system: System, b: int) -> bool:
    """Whether the scene states the velocity of a body's origin."""
    return system.scene.initial_of(system.bodies[b].name).velocity is not None


def components(system: System) -> Iterator[tuple[list[int], bool]]:
    """Bodies that joints and forces connect, but for the ground, and whether they are
    connected to that, too; without bodies whose frames are held."""
    body = system.arrays.body
    rows = {
        data.name: b
        for b, data in enumerate(system.bodies)
        if data.of_scene and data.name != GROUND_NAME and body[b, at.RD] > 0
    }
    scene = system.scene
    links = [
        owners(part)
        for table in (scene.joints, scene.forces)
        for part in table.values()
    ]
    left = set(rows)
    while left:
        reached, new = set[str](), {min(left, key=rows.__getitem__)}
        while new:
            reached |= new
            near = set[str]().union(*(link for link in links if link & new))
            new = (near & set(rows)) - reached
        left -= reached
        apart = all(link <= reached for link in links if link & reached)
        loaded = any(len(link) == 1 for link in links if link & reached)
        yield sorted(rows[name] for name in reached), not apart or loaded


def places(mechanics: Mechanics, z: Array) -> tuple[Array, Array]:
    """Origins (bodies, 3) and rotation matrices of all frames, evaluated last at z."""
    system = mechanics.system
    axes = 2 if system.planar else 3
    positions = np.zeros((len(system.bodies), 3))
    for b, row in enumerate(system.arrays.body):
        if row[at.RD] > 0:
            positions[b, :axes] = z[row[at.POS] : row[at.POS] + axes]
    return positions, matrices(system.frames(mechanics.work.frame)["R"])
