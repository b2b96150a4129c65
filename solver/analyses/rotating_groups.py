"""Groups of bodies that rotate together at the start, about nearly the same axis.

The velocities that a scene states give the axes. Bodies at rest whose velocities are
not stated may rotate with the bodies that they are connected to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from sidtool.formats.base.sid import Array

from ..initial_state.assembly import StateVectors
from ..spatial import system_arrays as at
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.system import GROUND_NAME, System
from .dense_equations import DenseEquations, null_space
from .reference_axes import axis_angular_velocities, marker_owners

#: Angular velocities that differ by less than this part are the same, axes that are
#: less apart in sizes of the mechanism likewise.
EQUAL_RATE, EQUAL_AXIS = 1e-6, 0.05


@dataclass(frozen=True, eq=False)
class RotationAxis:
    """The axis about which a body turns.

    Attributes
    ----------
    omega : (3,)
        Angular velocity in inertial axes.
    point : (3,)
        A point of the axis.
    """

    omega: Array
    point: Array

    @property
    def speed(self) -> float:
        """The angular speed."""
        return float(np.linalg.norm(self.omega))

    def displaced(self, x: Array) -> RotationAxis:
        """Displaced and tilted by two components each, across it, (4,)."""
        normals = null_space(self.omega[None] / self.speed).T
        spin = self.omega + self.speed * (x[2:] @ normals)
        spin *= self.speed / np.linalg.norm(spin)
        return RotationAxis(spin, self.point + x[:2] @ normals)


@dataclass(frozen=True, eq=False)
class RotatingGroup:
    """Bodies that turn together, about axes that are nearly the same.

    Attributes
    ----------
    axes
        By the rows of the bodies.
    drift : (3,)
        Velocity of the axes, of bodies that nothing connects to the ground.
    acceleration
        Angular acceleration about them.
    """

    axes: dict[int, RotationAxis]
    drift: Array
    acceleration: float = 0.0

    @property
    def leading_axis(self) -> RotationAxis:
        """That of the body that decides."""
        return next(iter(self.axes.values()))

    @property
    def unknowns(self) -> int:
        """Of all axes four, and the angular acceleration."""
        return 4 * len(self.axes) + 1

    def with_bodies(self, bodies: Iterable[int]) -> RotatingGroup:
        """With other bodies that rotate about the first axis."""
        return replace(self, axes=self.axes | dict.fromkeys(bodies, self.leading_axis))

    def displaced(self, x: Array) -> RotatingGroup:
        """With other axes and acceleration, changed by x (unknowns,)."""
        axes = {
            b: axis.displaced(x[4 * k : 4 * k + 4])
            for k, (b, axis) in enumerate(self.axes.items())
        }
        return RotatingGroup(axes, self.drift, self.acceleration + float(x[-1]))


def candidate_groups(
    mechanics: DenseEquations, start: StateVectors
) -> Iterator[tuple[RotatingGroup, ...]]:
    """Groups of bodies that may rotate, the more likely ones first.

    Bodies whose velocities are not stated, and that rest, either turn with those that
    they are connected to, or go on resting: those that the ground holds, as a tower
    does below a jib and its load, or all of them. If the assembly turns them about
    another axis, as a load on a universal joint, they turn with these, or about that
    axis.
    """
    found = [_find_groups(mechanics, start, tilted) for tilted in (False, True)]
    if len(found[0][0]) == len(found[1][0]):
        del found[0]
    for groups, followers in found:
        standing = _standing_bodies(mechanics.system, chain.from_iterable(followers))
        hanging = tuple(
            tuple(b for b in bodies if b not in standing) for bodies in followers
        )
        for more in dict.fromkeys((hanging, followers)):
            if any(more):
                pairs = zip(groups, more, strict=True)
                yield tuple(group.with_bodies(bodies) for group, bodies in pairs)
        if groups and groups is found[-1][0]:
            yield groups


def _find_groups(
    mechanics: DenseEquations, start: StateVectors, tilted: bool
) -> tuple[tuple[RotatingGroup, ...], tuple[tuple[int, ...], ...]]:
    """Groups of bodies that rotate at the start, and who may follow each of them; no
    followers at all where there are none, no groups where other bodies move.

    Parameters
    ----------
    tilted
        Whether bodies whose velocities are not stated may have an axis that is not
        parallel to that of the first body.
    """
    system = mechanics.system
    mechanics.evaluate(start.z, start.v)
    positions, rotations = frame_positions(mechanics, start.z)
    frames = system.frames(mechanics.work.frame)
    omegas = axis_angular_velocities(mechanics)
    velocities = (rotations @ to_3d(frames["v"])[..., None])[..., 0]
    fastest = float(np.linalg.norm(omegas, axis=1).max(initial=0.0))
    slow = EQUAL_RATE * fastest * system.length
    moves = np.linalg.norm(velocities, axis=1) > slow
    groups: list[RotatingGroup] = []
    free: dict[int, int] = {}
    following = set[int]()
    for part, is_grounded in connected_components(system):
        rotating = [b for b in part if np.linalg.norm(omegas[b]) > EQUAL_RATE * fastest]
        rotating.sort(key=lambda b: not _has_specified_velocity(system, b))
        first = len(groups)
        drift = np.zeros(3)
        if rotating and not is_grounded:
            if system.arrays.gravity.any():
                return (), ()  # it falls
            drift = _mean_velocity(system, part, rotations, omegas, velocities)
        for b in rotating:
            moving = velocities[b] - drift
            point = positions[b] + np.cross(omegas[b], moving) / (omegas[b] @ omegas[b])
            for k in range(first, len(groups)):
                axis = groups[k].leading_axis
                difference = np.linalg.norm(axis.omega - omegas[b])
                offset = np.cross(axis.omega, point - axis.point) / axis.speed
                is_near = np.linalg.norm(offset) < EQUAL_AXIS * system.length
                if difference < EQUAL_RATE * fastest and (
                    is_near or not _has_specified_origin_velocity(system, b)
                ):
                    groups[k] = groups[k].with_bodies([b])
                    break
            else:
                leads = groups[first:] == [] or tilted
                if not leads and not _has_specified_velocity(system, b):
                    axis = groups[first].leading_axis
                    across = np.cross(omegas[b], axis.omega) / axis.speed
                    leads = bool(np.linalg.norm(across) < EQUAL_AXIS * axis.speed)
                if leads or _has_specified_velocity(system, b):
                    axis = RotationAxis(omegas[b], point)
                    groups.append(RotatingGroup({b: axis}, drift))
                else:
                    following.add(b)
        nearest = _nearest_groups(system, part, groups[first:])
        for b in part:
            if (b in rotating and b not in following) or not (
                groups[first:] or moves[b]
            ):
                continue
            for k in range(first, len(groups)):
                axis = groups[k].leading_axis
                offset = drift + np.cross(axis.omega, positions[b] - axis.point)
                residual = np.linalg.norm(velocities[b] - offset)
                if moves[b] and residual < EQUAL_AXIS * np.linalg.norm(offset):
                    groups[k] = groups[k].with_bodies([b])
                    break
            else:
                if groups[first:] and not _has_specified_velocity(system, b):
                    free[b] = first + nearest[b]
                elif moves[b]:
                    return (), ()
    if not free:
        return tuple(groups), ()
    more = [tuple(b for b, k in free.items() if k == g) for g in range(len(groups))]
    return tuple(groups), tuple(more)


def _standing_bodies(system: System, bodies: Iterable[int]) -> set[int]:
    """Those of some bodies that joints or forces connect to the ground, through others
    of them."""
    left = {system.bodies[b].name: b for b in bodies}
    links = _links(system)
    standing, new = set[int](), {GROUND_NAME}
    while new:
        near = set[str]().union(*(link for link in links if link & new))
        new = near & left.keys()
        standing |= {left.pop(name) for name in new}
    return standing


def _nearest_groups(
    system: System, part: Iterable[int], groups: Sequence[RotatingGroup]
) -> dict[int, int]:
    """The group that each body of a part is connected to by the fewest links."""
    links = _links(system)
    nearest = {b: k for k, group in enumerate(groups) for b in group.axes}
    new = list(nearest)
    while new:
        reached = new
        new = []
        for b in reached:
            name = system.bodies[b].name
            near = set[str]().union(*(link for link in links if name in link))
            for other in part:
                if other not in nearest and system.bodies[other].name in near:
                    nearest[other] = nearest[b]
                    new.append(other)
    return nearest


def _mean_velocity(
    system: System, part: list[int], rotations: Array, omegas: Array, velocities: Array
) -> Array:
    """Velocity (3,) of the common centre of mass of undeformed bodies."""
    mass, momentum = 0.0, np.zeros(3)
    for b in part:
        sid = system.bodies[b].sid
        arm = rotations[b] @ sid.mdCM.m0[:, 0]
        mass += sid.mass
        momentum += sid.mass * velocities[b] + np.cross(omegas[b], arm)
    return momentum / mass


def _has_specified_velocity(system: System, b: int) -> bool:
    """True if the scene states a velocity of a body."""
    initial = system.scene.initial_of(system.bodies[b].name)
    return initial.velocity is not None or initial.angular_velocity is not None


def _has_specified_origin_velocity(system: System, b: int) -> bool:
    """True if the scene states the velocity of a body's origin."""
    return system.scene.initial_of(system.bodies[b].name).velocity is not None


def _links(system: System) -> list[set[str]]:
    """Names of the bodies that each joint and each force connects."""
    scene = system.scene
    tables = (scene.joints, scene.forces)
    return [marker_owners(part) for table in tables for part in table.values()]


def connected_components(system: System) -> Iterator[tuple[list[int], bool]]:
    """Bodies that joints and forces connect, but for the ground, and whether they are
    connected to that, too; without bodies whose frames are held."""
    body = system.arrays.body
    rows = {
        data.name: b
        for b, data in enumerate(system.bodies)
        if data.is_scene_body and data.name != GROUND_NAME and body[b, at.RD] > 0
    }
    links = _links(system)
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


def frame_positions(mechanics: DenseEquations, z: Array) -> tuple[Array, Array]:
    """Origins (bodies, 3) and rotation matrices of all frames, evaluated last at z."""
    system = mechanics.system
    axes = 2 if system.planar else 3
    positions = np.zeros((len(system.bodies), 3))
    for b, row in enumerate(system.arrays.body):
        if row[at.RD] > 0:
            positions[b, :axes] = z[row[at.POS] : row[at.POS] + axes]
    return positions, to_rotation_matrices(system.frames(mechanics.work.frame)["R"])
