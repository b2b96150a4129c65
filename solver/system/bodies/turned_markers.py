"""Second markers of joints, turned to how the scene places both bodies.

The axis of a joint is a direction of its first marker. Where the scene states the
orientations of both bodies, the axis stands in the second marker as the two are placed:
the joint takes a copy of that marker with other axes, in which the axis has the same
components. Where an orientation is not stated, the axis has the same components in both
markers and the assembly turns the body to it. A fixed or prismatic joint keeps the
whole relative orientation that is stated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.scene import (
    Initial,
    SceneFile,
    as_3d,
    marker_names,
    marker_reference,
    rotation,
)
from sidtool.formats.sid import Array

from ..joints import spatial_axis
from ..scene import GROUND_NAME
from .data import BodyData
from .held_frames import without_held_frames
from .packing import rotation_part
from .rotations import rotation_matrix, rotation_vector, shortest_rotation

#: Axes nearer to each other than this are taken for one that was rounded [rad].
ROUNDED = 0.01
#: Joints that keep an axis, and those that keep the whole orientation.
_AXIAL = ("revolute", "cylindrical", "screw", "planar")
_WHOLE = ("fixed", "prismatic")


def with_turned_markers(
    scene: SceneFile, data: Mapping[str, BodyData]
) -> tuple[SceneFile, dict[str, BodyData]]:
    """The scene whose joints name turned markers, and the bodies that have them.

    A turned marker is called "MARKER turned by JOINT".
    """
    found, joints = dict(data), dict(scene.joints)
    for name, turn in _turns(scene, data):
        first, second = marker_names(joints[name])
        body, marker = marker_reference(second)
        key = marker + _suffix(name)
        known = found[body]
        found[body] = replace(known, turned={**known.turned, key: (marker, turn)})
        pair = first, f"{body}.{key}"
        joints[name] = joints[name].model_copy(update={"markers": pair})
    return scene.model_copy(update={"joints": joints}), found


def as_written(scene: SceneFile) -> SceneFile:
    """The scene that became that of a system, as files hold it."""
    scene = without_held_frames(scene)
    joints = dict(scene.joints)
    for name, joint in joints.items():
        texts = marker_names(joint)
        if texts and texts[1].endswith(_suffix(name)):
            pair = texts[0], texts[1].removesuffix(_suffix(name)).removesuffix(".")
            joints[name] = joint.model_copy(update={"markers": pair})
    return scene.model_copy(update={"joints": joints})


def _suffix(joint: str) -> str:
    return f" turned by {joint}"


def _turns(
    scene: SceneFile, data: Mapping[str, BodyData]
) -> Iterator[tuple[str, Array]]:
    """Joints that turn their second marker, and the rotation of that."""
    kinds = _WHOLE if scene.dimension == "planar" else (*_WHOLE, *_AXIAL)
    for name, joint in scene.joints.items():
        if joint.type not in kinds:
            continue
        a, b = marker_names(joint)
        second = getattr(joint, "second_axis", None)
        stated = _relative(scene, data, a, b)
        turn = _turn(stated, spatial_axis(joint), second, joint.type in _WHOLE)
        if turn is not None and not _is_point(data, a, b):
            yield name, turn


def _turn(
    stated: tuple[Array, ...],
    axis: Array,
    second: tuple[float, ...] | None,
    whole: bool,
) -> Array | None:
    """Rotation of the second marker; None where it keeps its axes.

    stated : orientations of the second marker in the first, see `_relative`
    second : direction of the axis in the second marker, if it is stated
    """
    turn = np.eye(3)
    if whole or second is None:
        turns = [Q.T if whole else shortest_rotation(axis, Q.T @ axis) for Q in stated]
        if all(np.linalg.norm(rotation_vector(turn)) > ROUNDED for turn in turns):
            turn = turns[-1] if turns else turn
    if second is not None:
        target = as_3d(second) / np.linalg.norm(second)
        turn = shortest_rotation(turn @ axis, target) @ turn
    return None if np.array_equal(turn, np.eye(3)) else turn


def _relative(
    scene: SceneFile, data: Mapping[str, BodyData], a: str, b: str
) -> tuple[Array, ...]:
    """Stated orientations of a marker in another one, none where one is not stated.

    Of the bodies as they are, and as stated elastic coordinates deform them: a start
    that is deformed may be stated either way.
    """
    found = []
    for body, marker in map(marker_reference, (a, b)):
        stated = np.eye(3) if body == GROUND_NAME else _stated(scene, body)
        if stated is None:
            return ()
        found.append(
            [stated @ axes for axes in _marker_axes(scene, data[body], marker)]
        )
    return tuple(np.asarray(A.T @ B) for A, B in zip(*found, strict=True))


def _marker_axes(scene: SceneFile, data: BodyData, marker: str) -> tuple[Array, Array]:
    """Orientation of a marker in the body frame, undeformed and deformed."""
    node = data.node(marker)
    axes = rotation_part(node.AP.m0)
    initial = None if data.name == GROUND_NAME else scene.bodies[data.name].initial
    elastic = getattr(initial, "elastic", None)
    if elastic is None or len(elastic) != data.sid.nq:
        return axes, axes
    return axes, rotation_matrix(node.psi.m0 @ np.array(elastic)) @ axes


def _stated(scene: SceneFile, body: str) -> Array | None:
    initial: Initial = scene.bodies[body].initial
    ways = (initial.angle, initial.axis_angle, initial.quaternion, initial.matrix)
    if all(way is None for way in ways) and not initial.fixed:
        return None
    return rotation(initial)


def _is_point(data: Mapping[str, BodyData], a: str, b: str) -> bool:
    """Whether one of two markers is on a point mass, which has no orientation."""
    bodies = [data[marker_reference(text)[0]] for text in (a, b)]
    return not all(body.rotates or body.name == GROUND_NAME for body in bodies)
