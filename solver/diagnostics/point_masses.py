"""Torques between a point mass, which has no orientation, and a body that turns.

A point mass takes no torque. What holds, drives or springs an angle between it and
another body would act on this body as if the point mass could not be turned at all.
That is meant where a guide takes the torque, as that of a piston does.
"""

from collections.abc import Iterator

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import (
    Bushing,
    Coupling,
    Gear,
    Joint,
    PointForce,
    SceneFile,
    coupled_coordinates,
    driven_coordinate,
    marker_names,
    marker_reference,
)
from sidtool.formats.scene.connections import force_coordinate, is_turned

from ..system.system import System

#: Joints without a relative rotation, and those that guide.
_TRANSLATING = ("fixed", "prismatic")
_GUIDES = (*_TRANSLATING, "point_on_line", "point_on_plane")


def check_point_masses(system: System) -> None:
    """Check that no torque acts on a point mass.

    Raises
    ------
    InputError : one does; the error names key and point mass.
    """
    masses = {d.name for d in system.bodies if not d.rotates and d.is_scene_body}
    if not masses:
        return
    scene = system.scene
    for name, force in scene.forces.items():
        if isinstance(force, PointForce) and np.any(force.torque or 0.0):
            body = marker_reference(force.marker)[0]
            if body in masses:
                raise _error(f"forces.{name}.torque", "its torque acts", body, "torque")
    bodies = {d.name for d in system.bodies if d.rotates and d.is_scene_body}
    translating = _translating(scene, masses)
    turning = bodies - translating
    masses -= _guided(scene, translating)
    for place, what, texts, remedy in _torques(scene):
        ends = {marker_reference(text)[0] for text in texts}
        if ends & masses and ends & turning:
            raise _error(place, what, min(ends & masses), remedy)


def _error(place: str, what: str, body: str, remedy: str) -> InputError:
    return InputError(
        f"{what} on {body}, a point mass, which does not rotate",
        place=place,
        expected=f"a body with inertia: bodies.{body}.inertia, or {remedy}",
    )


def _translating(scene: SceneFile, masses: set[str]) -> set[str]:
    """Bodies that joints without rotation connect to the ground."""
    found, before = {"ground"}, 0
    while len(found) > before:
        before = len(found)
        for joint in scene.joints.values():
            ends = {marker_reference(text)[0] for text in marker_names(joint)}
            if joint.type in _TRANSLATING and ends & found and not ends & masses:
                found |= ends
    return found


def _guided(scene: SceneFile, translating: set[str]) -> set[str]:
    """Bodies that something guides which does not turn."""
    found = set[str]()
    for joint in scene.joints.values():
        ends = {marker_reference(text)[0] for text in marker_names(joint)}
        if joint.type in _GUIDES and ends & translating:
            found |= ends
    return found


def _torques(scene: SceneFile) -> Iterator[tuple[str, str, tuple[str, ...], str]]:
    """Yield key, words, markers and remedy of what makes torques between two bodies."""
    joints: dict[str, Joint] = scene.joints
    for name, joint in joints.items():
        place = f"joints.{name}"
        if isinstance(joint, Gear | Coupling):
            for other, coordinate, _ in coupled_coordinates(joint, joints):
                if is_turned(coordinate):
                    markers = tuple(marker_names(joints[other]))
                    yield place, f"the {coordinate} of {other} acts", markers, "none"
        elif joint.type == "prismatic":
            words = "the joint holds the orientation, which acts"
            yield place, words, tuple(marker_names(joint)), 'type = "point_on_line"'
        elif joint.type == "revolute" and joint.friction is not None:
            markers = tuple(marker_names(joint))
            yield f"{place}.friction", "its friction acts", markers, "no friction"
    for name, drive in scene.drives.items():
        if drive.joint is not None and is_turned(driven_coordinate(drive, joints)):
            markers = tuple(marker_names(joints[drive.joint]))
            yield f"drives.{name}", "its torque acts", markers, "no drive"
    for name, force in scene.forces.items():
        joint_name = getattr(force, "joint", None)
        if joint_name is not None and is_turned(force_coordinate(force, scene)):
            markers = tuple(marker_names(joints[joint_name]))
            yield f"forces.{name}", "its torque acts", markers, "no force"
        elif isinstance(force, Bushing) and _twists(force, scene):
            yield (
                f"forces.{name}",
                "its torque acts",
                tuple(force.markers),
                "zeros for rotations",
            )


def _twists(force: Bushing, scene: SceneFile) -> bool:
    """Whether a bushing makes torques of rotations."""
    first = 2 if scene.dimension == "planar" else 3
    for given in (force.stiffness, force.damping):
        values = np.array(given if given is not None else 0.0, float)
        if values.ndim and np.any(values[first:]):
            return True
    return False
