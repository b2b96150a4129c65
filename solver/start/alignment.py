"""Orientations at the start: the right one of the ways in which axes are aligned.

Constraints of orientation in space say that axes are at right angles, which also holds
when a body is turned upside down. Before the assembly, bodies that are turned far away
from what a joint wants are turned to it; after it, what was found is checked.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    SceneFile,
    driven_coordinate,
    marker_names,
    marker_reference,
)
from sidtool.formats.sid import Array

from ..equations.drives import drive_value
from ..space import layout as at
from ..space.layout import Work
from ..system.bodies.embedded import matrices
from ..system.bodies.packing import quaternion, rotation_part
from ..system.bodies.rotations import (
    rotation_matrix,
    rotation_vector,
    shortest_rotation,
)
from ..system.joints import is_of_point, joint_parts
from ..system.scene import System

#: Bodies are turned beforehand when they are off by more than this angle [rad].
FAR = 1.0


@dataclass(frozen=True)
class _Wish:
    """What a joint wants of the orientation Q of its second marker in the first.

    whole : Q itself, or None when it is wanted only that
    source, target : Q takes one direction to the other
    angle : wanted rotation about them, if it is driven and they are the same
    """

    name: str
    a: tuple[str, str]
    b: tuple[str, str]
    whole: Array | None = None
    source: Array = field(default_factory=lambda: np.zeros(3))
    target: Array = field(default_factory=lambda: np.zeros(3))
    angle: float | None = None

    def correction(self, Q: Array) -> Array:
        """The rotation C, in the frame of the first marker, for which C Q is right."""
        if self.whole is not None:
            return self.whole @ Q.T
        turn = shortest_rotation(Q @ self.source, self.target)
        if self.angle is None:
            return turn
        now = rotation_vector(turn @ Q) @ self.target
        left = (self.angle - now + np.pi) % (2.0 * np.pi) - np.pi
        return rotation_matrix(left * self.target) @ turn


def align(system: System, work: Work, z: Array) -> None:
    """Turns bodies of a spatial guess to their joints, where they are far away.

    `work` holds the frames of that guess. Each body is turned once, after those that
    lie between it and the ground.
    """
    if system.planar:
        return
    frames = {
        body.name: matrices(system.frames(work.frame[b])["R"])
        for b, body in enumerate(system.bodies)
    }
    known = {system.bodies[0].name, *system.eliminated.values(), *_held(system.scene)}
    wishes = list(_wishes(system))
    while wishes:
        ready = [w for w in wishes if w.a[0] in known or w.b[0] in known]
        wish = ready[0] if ready else wishes[0]
        if not ready:
            known.add(wish.a[0])
        turned = wish.b[0] if wish.b[0] not in known else wish.a[0]
        if turned not in known:
            _turn(system, z, frames, wish, turned)
        known |= {wish.a[0], wish.b[0]}
        wishes.remove(wish)


def check_alignment(system: System, work: Work) -> None:
    """Raises joints that were assembled the wrong way round.

    Raises
    ------
    InputError : names the joint and the angle by which it is off.
    """
    if system.planar:
        return
    for wish in _wishes(system):
        if wish.a not in system.markers or wish.b not in system.markers:
            continue
        A, B = (
            matrices(system.points(work.point[system.markers[m]])["R"])
            for m in (wish.a, wish.b)
        )
        off = float(np.linalg.norm(rotation_vector(wish.correction(A.T @ B))))
        if off > FAR:
            raise InputError(
                f"the start is assembled with {wish.name} turned by {off:.3g} rad",
                place="bodies.*.initial",
                expected="initial orientations nearer to what the joints want",
            )


def _wishes(system: System) -> Iterator[_Wish]:
    """Joints that want an orientation, and are not carried by a prescribed frame; and
    driven rotations."""
    scene = system.scene
    for name, drive in scene.drives.items():
        if drive.axis is not None and drive.marker is not None:
            a, b = marker_reference(drive.reference), marker_reference(drive.marker)
            axis = np.array(drive.axis) / np.linalg.norm(drive.axis)
            angle = _driven_value(system, name)
            yield _Wish(name, a, b, source=axis, target=axis, angle=angle)
    for name, joint in scene.joints.items():
        texts = marker_names(joint)
        if not texts or name in system.eliminated:
            continue
        if is_of_point(joint, {data.name: data for data in system.bodies}):
            continue
        constraints = joint_parts(joint, system.planar).constraints
        across = [p for p in constraints if p.kind == at.PERPENDICULAR]
        a, b = (marker_reference(text) for text in texts)
        driven = _driven_angles(system, name)
        if len(across) == 3:
            yield _Wish(name, a, b, whole=np.eye(3))
        elif len(across) == 2:
            axis = np.array(across[0].data[3:])
            yield _Wish(name, a, b, source=axis, target=axis, angle=driven.get("angle"))
        elif across and driven:
            first, second = np.reshape(across[0].data, (2, 3))
            yield _Wish(name, a, b, **_cross(first, second, driven))


def _cross(first: Array, second: Array, angles: dict[str, float]) -> dict[str, Any]:
    """What a universal joint wants with one or both of its angles driven."""
    inner = rotation_matrix(angles.get("angle_1", 0.0) * first)
    outer = rotation_matrix(angles.get("angle_2", 0.0) * second)
    if len(angles) == 2:
        return {"whole": inner @ outer}
    if "angle_1" in angles:
        return {"source": second, "target": inner @ second}
    return {"source": outer.T @ first, "target": first}


def _driven_angles(system: System, joint: str) -> dict[str, float]:
    """Driven angles of a joint at the start."""
    scene, found = system.scene, {}
    for name, drive in scene.drives.items():
        if drive.joint != joint:
            continue
        coordinate = driven_coordinate(drive, scene.joints)
        if coordinate.startswith("angle"):
            found[coordinate] = _driven_value(system, name)
    return found


def _driven_value(system: System, drive: str) -> float:
    """The function of a drive at the start."""
    row, start = list(system.scene.drives).index(drive), system.scene.time.start
    clock = 0.5 * (start + system.breaks[0])
    return float(drive_value.py_func(system.arrays, row, clock, start)[0])


def _held(scene: SceneFile) -> set[str]:
    return {name for name, body in scene.bodies.items() if body.initial.fixed}


def _turn(
    system: System, z: Array, frames: dict[str, Array], wish: _Wish, body: str
) -> None:
    """Turns one of the two bodies if it is far from what the joint wants."""
    first, second = (
        rotation_part(system.bodies[system.index(name)].node(marker).AP.m0)
        for name, marker in (wish.a, wish.b)
    )
    A, B = frames[wish.a[0]] @ first, frames[wish.b[0]] @ second
    correction = wish.correction(A.T @ B)
    row = system.arrays.body[system.index(body)]
    if np.linalg.norm(rotation_vector(correction)) < FAR or row[at.RD] != 6:
        return
    Q = correction @ A.T @ B
    turned = A @ Q @ second.T if body == wish.b[0] else B @ Q.T @ first.T
    frames[body] = turned
    p = row[at.POS] + 3
    z[p : p + 4] = quaternion(turned)
