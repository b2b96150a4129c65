"""Second markers of joints, rotated to the relative orientation that the scene states.

The axis of a joint is a direction of its first marker. Where the scene states the
orientations of both bodies, the joint uses a copy of the second marker with other axes,
in which the axis has the same components. Where an orientation is not stated, the axis
has the same components in both markers and the assembly rotates the body. A fixed or
prismatic joint keeps the whole relative orientation that is stated.

Vectors and rotations of the plane embedded in space; rotation vectors.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Initial,
    SceneFile,
    as_3d,
    marker_names,
    marker_reference,
    orientation_matrix,
    rotation_matrix,
)
from sidtool.formats.sid_mass import cross

from .body_data import BodyData, without_held_frames
from .joints import spatial_axis
from .sid_packing import nearest_rotation, quaternion
from .system import GROUND_NAME

#: Axes nearer to each other than this are taken for one that was rounded [rad].
ROUNDED_ANGLE = 0.01
#: Joints that keep an axis, and those that keep the whole orientation.
_AXIS_JOINTS = ("revolute", "cylindrical", "screw", "planar")
_ORIENTATION_JOINTS = ("fixed", "prismatic")


def to_3d(x: Array) -> Array:
    """Vectors (..., 3), of the plane in x and y; rotations of the plane (..., 1) turn
    about z."""
    count = x.shape[-1]
    x3 = np.zeros((*x.shape[:-1], 3))
    x3[..., slice(2, 3) if count == 1 else slice(count)] = x
    return x3


def to_rotation_matrices(R: Array) -> Array:
    """Rotation matrices (..., 3, 3) of what kernels keep: cosine and sine, or nine."""
    if R.shape[-1] == 9:
        return R.reshape(*R.shape[:-1], 3, 3)
    R3 = np.zeros((*R.shape[:-1], 3, 3))
    R3[..., 0, 0] = R3[..., 1, 1] = R[..., 0]
    R3[..., 1, 0], R3[..., 0, 1] = R[..., 1], -R[..., 1]
    R3[..., 2, 2] = 1.0
    return R3


def rotation_vector(matrix: Array) -> Array:
    """Axis times angle [rad] of a rotation matrix, (3,)."""
    q = quaternion(matrix)
    size = float(np.linalg.norm(q[1:]))
    return q[1:] * (2.0 * np.arctan2(size, q[0]) / size if size > 0.0 else 2.0)


def shortest_rotation(source: Array, target: Array) -> Array:
    """The smallest rotation of one unit vector onto another, (3, 3)."""
    axis = cross(source, target)
    size = np.linalg.norm(axis)
    angle = np.arctan2(size, source @ target)
    if size < 1e-12:
        axis = cross(target, np.eye(3)[int(np.argmin(abs(target)))])
        size = np.linalg.norm(axis)
    return rotation_matrix(angle * axis / size)


def with_rotated_markers(
    scene: SceneFile,
    data: Mapping[str, BodyData],
    rotations: Mapping[str, Array] | None = None,
) -> tuple[SceneFile, dict[str, BodyData]]:
    """The scene whose joints name rotated markers, and the bodies that have them.

    A rotated marker is called "MARKER turned by JOINT".

    Parameters
    ----------
    rotations
        Of the second markers of joints, by name, from `marker_rotations`; by default
        they follow from the orientations that the scene states.
    """
    rotated, joints = dict(data), dict(scene.joints)
    if rotations is None:
        rotations = dict(find_rotations(scene, data))
    for name, rotation_ in rotations.items():
        first, second = marker_names(joints[name])
        body, marker = marker_reference(second)
        key = marker + _suffix(name)
        known = rotated[body]
        rotated[body] = replace(
            known, rotated_markers={**known.rotated_markers, key: (marker, rotation_)}
        )
        pair = first, f"{body}.{key}"
        joints[name] = joints[name].model_copy(update={"markers": pair})
    return scene.model_copy(update={"joints": joints}), rotated


def marker_rotations(scene: SceneFile, bodies: Iterable[BodyData]) -> dict[str, Array]:
    """Rotations of the second markers of joints, by joint.

    Parameters
    ----------
    scene, bodies
        From `with_rotated_markers`.
    """
    rotated = {data.name: data.rotated_markers for data in bodies}
    found = {}
    for name, joint in scene.joints.items():
        for text in marker_names(joint)[1:]:
            body, marker = marker_reference(text)
            if marker in rotated[body]:
                found[name] = rotated[body][marker][1]
    return found


def original_scene(scene: SceneFile) -> SceneFile:
    """The scene that became that of a system, as files hold it: the same object where
    it did not change.
    """
    scene, changed = without_held_frames(scene), {}
    for name, joint in scene.joints.items():
        texts = marker_names(joint)
        if texts and texts[1].endswith(_suffix(name)):
            pair = texts[0], texts[1].removesuffix(_suffix(name)).removesuffix(".")
            changed[name] = joint.model_copy(update={"markers": pair})
    if not changed:
        return scene
    return scene.model_copy(update={"joints": dict(scene.joints) | changed})


def _suffix(joint: str) -> str:
    return f" turned by {joint}"


def find_rotations(
    scene: SceneFile, data: Mapping[str, BodyData]
) -> Iterator[tuple[str, Array]]:
    """Joints that turn their second marker, and the rotation of that."""
    kinds = (
        _ORIENTATION_JOINTS
        if scene.dimension == "planar"
        else (*_ORIENTATION_JOINTS, *_AXIS_JOINTS)
    )
    for name, joint in scene.joints.items():
        if joint.type not in kinds:
            continue
        a, b = marker_names(joint)
        second = getattr(joint, "second_axis", None)
        specified = _relative_orientations(scene, data, a, b)
        rotation_ = _marker_rotation(
            specified, spatial_axis(joint), second, joint.type in _ORIENTATION_JOINTS
        )
        if rotation_ is not None and not _is_point_mass(data, a, b):
            yield name, rotation_


def _marker_rotation(
    specified: tuple[Array, ...],
    axis: Array,
    second: tuple[float, ...] | None,
    keeps_orientation: bool,
) -> Array | None:
    """Rotation of the second marker; None where it keeps its axes.

    Parameters
    ----------
    specified
        Orientations of the second marker in the first, see `_relative_orientations`.
    second
        Direction of the axis in the second marker, if it is stated.
    """
    rotation_ = np.eye(3)
    if keeps_orientation or second is None:
        rotations_ = [
            Q.T if keeps_orientation else shortest_rotation(axis, Q.T @ axis)
            for Q in specified
        ]
        if all(np.linalg.norm(rotation_vector(R)) > ROUNDED_ANGLE for R in rotations_):
            rotation_ = rotations_[-1] if rotations_ else rotation_
    if second is not None:
        target = as_3d(second) / np.linalg.norm(second)
        rotation_ = shortest_rotation(rotation_ @ axis, target) @ rotation_
    return None if np.array_equal(rotation_, np.eye(3)) else rotation_


def _relative_orientations(
    scene: SceneFile, data: Mapping[str, BodyData], a: str, b: str
) -> tuple[Array, ...]:
    """Stated orientations of a marker in another one, none where one is not stated.

    Of the bodies as they are, and as stated elastic coordinates deform them: a start
    that is deformed may be stated either way.
    """
    orientations = []
    for body, marker in map(marker_reference, (a, b)):
        specified = (
            np.eye(3) if body == GROUND_NAME else _specified_orientation(scene, body)
        )
        if specified is None:
            return ()
        orientations.append(
            [specified @ axes for axes in _marker_axes(scene, data[body], marker)]
        )
    return tuple(np.asarray(A.T @ B) for A, B in zip(*orientations, strict=True))


def _marker_axes(scene: SceneFile, data: BodyData, marker: str) -> tuple[Array, Array]:
    """Orientation of a marker in the body frame, undeformed and deformed."""
    node = data.node(marker)
    axes = nearest_rotation(node.AP.m0)
    initial = None if data.name == GROUND_NAME else scene.bodies[data.name].initial
    elastic = getattr(initial, "elastic", None)
    if elastic is None or len(elastic) != data.sid.nq:
        return axes, axes
    q = np.array(elastic)
    return axes, rotation_matrix(node.psi.at(0.5 * q) @ q) @ axes


def _specified_orientation(scene: SceneFile, body: str) -> Array | None:
    initial: Initial = scene.bodies[body].initial
    descriptions = (
        initial.angle,
        initial.axis_angle,
        initial.quaternion,
        initial.matrix,
    )
    if all(way is None for way in descriptions) and not initial.fixed:
        return None
    return orientation_matrix(initial)


def _is_point_mass(data: Mapping[str, BodyData], a: str, b: str) -> bool:
    """True if one of two markers is on a point mass, which has no orientation."""
    bodies = [data[marker_reference(text)[0]] for text in (a, b)]
    return not all(body.rotates or body.name == GROUND_NAME for body in bodies)
