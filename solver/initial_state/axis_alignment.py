"""Initial orientations: the intended one of the positions in which axes are aligned.

Orientation constraints require axes to be perpendicular, which also holds when a body
is turned upside down. Before the assembly, bodies far from the orientation that a joint
requires are rotated to it; after it the result is checked.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    SceneFile,
    driven_coordinate,
    marker_names,
    marker_reference,
)

from ..dynamics.drives import function_value
from ..spatial import system_arrays as at
from ..spatial.system_arrays import WorkArrays
from ..system.joints import is_point_mass_joint, joint_primitives
from ..system.rotations import (
    rotation_matrix,
    rotation_vector,
    shortest_rotation,
    to_rotation_matrices,
)
from ..system.sid_packing import nearest_rotation, quaternion
from ..system.system import System

#: Bodies are turned beforehand when they are off by more than this angle [rad].
LARGE_MISALIGNMENT = 1.0


@dataclass(frozen=True)
class _OrientationGoal:
    """What a joint wants of the orientation Q of its second marker in the first.

    Attributes
    ----------
    orientation
        Q itself, or None when it is wanted only that.
    source, target
        Q takes one direction to the other.
    angle
        Wanted rotation about them, if it is driven and they are the same.
    """

    name: str
    a: tuple[str, str]
    b: tuple[str, str]
    orientation: Array | None = None
    source: Array = field(default_factory=lambda: np.zeros(3))
    target: Array = field(default_factory=lambda: np.zeros(3))
    angle: float | None = None

    def correction(self, Q: Array) -> Array:
        """The rotation C, in the frame of the first marker, for which C Q is right."""
        if self.orientation is not None:
            return self.orientation @ Q.T
        rotation = shortest_rotation(Q @ self.source, self.target)
        if self.angle is None:
            return rotation
        now = rotation_vector(rotation @ Q) @ self.target
        remaining = (self.angle - now + np.pi) % (2.0 * np.pi) - np.pi
        return rotation_matrix(remaining * self.target) @ rotation


def align_bodies(system: System, work: WorkArrays, z: Array) -> None:
    """Turns bodies of a spatial guess to their joints, where they are far away.

    `work` holds the frames of that guess. Each body is turned once, after those that
    lie between it and the ground.
    """
    if system.planar:
        return
    frames = {
        body.name: to_rotation_matrices(system.frames(work.frame[b])["R"])
        for b, body in enumerate(system.bodies)
    }
    known = {
        system.bodies[0].name,
        *system.eliminated.values(),
        *_fixed_bodies(system.scene),
    }
    goals = list(_orientation_goals(system))
    while goals:
        ready = [w for w in goals if w.a[0] in known or w.b[0] in known]
        goal = ready[0] if ready else goals[0]
        if not ready:
            known.add(goal.a[0])
        rotated = goal.b[0] if goal.b[0] not in known else goal.a[0]
        if rotated not in known:
            _rotate_body(system, z, frames, goal, rotated)
        known |= {goal.a[0], goal.b[0]}
        goals.remove(goal)


def check_alignment(system: System, work: WorkArrays) -> None:
    """Raises joints that were assembled the wrong way round.

    Raises
    ------
    InputError
        Names the joint and the angle by which it is off.
    """
    if system.planar:
        return
    for goal in _orientation_goals(system):
        if goal.a not in system.markers or goal.b not in system.markers:
            continue
        A, B = (
            to_rotation_matrices(system.points(work.point[system.markers[m]])["R"])
            for m in (goal.a, goal.b)
        )
        off = float(np.linalg.norm(rotation_vector(goal.correction(A.T @ B))))
        if off > LARGE_MISALIGNMENT:
            raise InputError(
                f"the start is assembled with {goal.name} turned by {off:.3g} rad",
                place="bodies.*.initial",
                expected="initial orientations nearer to what the joints want",
            )


def _orientation_goals(system: System) -> Iterator[_OrientationGoal]:
    """Joints that want an orientation, and are not carried by a prescribed frame; and
    driven rotations."""
    scene = system.scene
    for name, drive in scene.drives.items():
        if drive.axis is not None and drive.marker is not None:
            a, b = marker_reference(drive.reference), marker_reference(drive.marker)
            axis = np.array(drive.axis) / np.linalg.norm(drive.axis)
            angle = _driven_value(system, name)
            yield _OrientationGoal(name, a, b, source=axis, target=axis, angle=angle)
    for name, joint in scene.joints.items():
        texts = marker_names(joint)
        if not texts or name in system.eliminated:
            continue
        if is_point_mass_joint(joint, {data.name: data for data in system.bodies}):
            continue
        constraints = joint_primitives(joint, system.planar).constraints
        perpendicular = [p for p in constraints if p.kind == at.PERPENDICULAR]
        a, b = (marker_reference(text) for text in texts)
        driven = _driven_angles(system, name)
        if len(perpendicular) == 3:
            yield _OrientationGoal(name, a, b, orientation=np.eye(3))
        elif len(perpendicular) == 2:
            axis = np.array(perpendicular[0].data[3:])
            yield _OrientationGoal(
                name, a, b, source=axis, target=axis, angle=driven.get("angle")
            )
        elif perpendicular and driven:
            first, second = np.reshape(perpendicular[0].data, (2, 3))
            yield _OrientationGoal(
                name, a, b, **_universal_joint_goal(first, second, driven)
            )


def _universal_joint_goal(
    first: Array, second: Array, angles: dict[str, float]
) -> dict[str, Any]:
    """What a universal joint wants with one or both of its angles driven."""
    inner = rotation_matrix(angles.get("angle_1", 0.0) * first)
    outer = rotation_matrix(angles.get("angle_2", 0.0) * second)
    if len(angles) == 2:
        return {"orientation": inner @ outer}
    if "angle_1" in angles:
        return {"source": second, "target": inner @ second}
    return {"source": outer.T @ first, "target": first}


def _driven_angles(system: System, joint: str) -> dict[str, float]:
    """Driven angles of a joint at the start."""
    scene, angles = system.scene, {}
    for name, drive in scene.drives.items():
        if drive.joint != joint:
            continue
        coordinate = driven_coordinate(drive, scene.joints)
        if coordinate.startswith("angle"):
            angles[coordinate] = _driven_value(system, name)
    return angles


def _driven_value(system: System, drive: str) -> float:
    """The function of a drive at the start."""
    row, start = list(system.scene.drives).index(drive), system.scene.time.start
    clock = 0.5 * (start + system.breaks[0])
    return float(function_value.py_func(system.arrays, row, clock, start)[0])


def _fixed_bodies(scene: SceneFile) -> set[str]:
    return {name for name, body in scene.bodies.items() if body.initial.fixed}


def _rotate_body(
    system: System,
    z: Array,
    frames: dict[str, Array],
    goal: _OrientationGoal,
    body: str,
) -> None:
    """Turns one of the two bodies if it is far from what the joint wants."""
    first, second = (
        nearest_rotation(system.bodies[system.index(name)].node(marker).AP.m0)
        for name, marker in (goal.a, goal.b)
    )
    A, B = frames[goal.a[0]] @ first, frames[goal.b[0]] @ second
    correction = goal.correction(A.T @ B)
    row = system.arrays.body[system.index(body)]
    if (
        np.linalg.norm(rotation_vector(correction)) < LARGE_MISALIGNMENT
        or row[at.RD] != 6
    ):
        return
    Q = correction @ A.T @ B
    rotated = A @ Q @ second.T if body == goal.b[0] else B @ Q.T @ first.T
    frames[body] = rotated
    p = row[at.POS] + 3
    z[p : p + 4] = quaternion(rotated)
