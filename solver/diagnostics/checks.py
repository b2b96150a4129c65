"""Checks of a compiled scene before it is integrated.

Torques between a point mass, which has no orientation, and a body that turns.

A point mass takes no torque. What holds, drives or springs an angle between it and
another body would act on this body as if the point mass could not be turned at all.
The same holds of forces beside its centre: at a marker elsewhere, or along a line or
on a plane of its own. They are meant where a guide takes the torque, as that of a
piston does.
"""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, orientation_fault
from sidtool.formats.motion_kinds import check_moves, dead_nodes
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    INPUTS,
    SCENE_QUANTITIES,
    STATE,
    VALUE,
    Bushing,
    Coupling,
    Gear,
    Joint,
    PointForce,
    RigidBody,
    SceneFile,
    coordinate_of,
    coupled_coordinates,
    driven_coordinate,
    is_along_coordinate,
    is_elastic,
    is_section_force,
    is_stress,
    marker_names,
    marker_reference,
    observed_outputs,
    parse_output,
)
from sidtool.formats.scene.connections import force_coordinate, is_turned
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, free_motion
from sidtool.formats.storage.cache import content_digest

from ..initial_state.constraint_jacobian import InitialState
from ..initial_state.given_state import align_bodies, initial_estimate, prescribed_rows
from ..initial_state.overconstraint import ROTATION_CONSTRAINTS
from ..initial_state.sparse_jacobian import (
    normalised_sparse_rows,
    scaled_sparse_jacobian,
)
from ..output.body_outputs import check_stress
from ..output.columns import state_row
from ..output.reactions import COMPONENTS, is_constraint, multiplier_row, second_marker
from ..output.section_forces import check_section_force
from ..spatial import system_arrays as at
from ..system.system import System

#: Spatial joints that hold the direction of an axis, and what they are without that.
_TILTED = {
    "revolute": "spherical",
    "cylindrical": "point_on_line",
    "screw": None,
    "universal": "spherical",
    "planar": "point_on_plane",
}
#: Rotations that other joints hold, up to rounding of the data.
_HELD = 1e-6


def check_replaced_sids(scene: SceneFile, names: Iterable[str]) -> None:
    """Bodies whose SIDs are replaced have one.

    Raises
    ------
    InputError
        One is not a flexible body of the scene.
    """
    flexible = scene.flexible
    for name in names:
        if name not in flexible:
            raise InputError(
                f"there is no flexible body {name!r} whose SID could be replaced",
                place="sids",
                expected=", ".join(flexible) or "a flexible body in the scene",
            )


def check_started(scene: SceneFile) -> None:
    """A scene that starts from a result holds the numbers of it.

    Raises
    ------
    InputError
        It names the file alone.
    """
    if scene.initial.state == "result" and not scene.initial.bodies:
        raise InputError(
            "has not been read",
            place="initial.file",
            expected="a function of `sidtool` that reads it, such as `simulate`",
        )


def check_same_sids(scene: SceneFile, sids: Mapping[str, SID]) -> None:
    """Elastic coordinates at the start belong to the SIDs of the scene.

    Raises
    ------
    InputError
        A body has another SID than in the result that the scene starts from.
    """
    for name, digest in (scene.initial.sids or {}).items():
        body = scene.sid_bodies.get(name)
        if body is None or body.rigid or content_digest(sids[name]) == digest:
            continue
        raise InputError(
            f"{name} had another SID in the result that the scene starts from",
            place="initial.file",
            expected="the same SID, as elastic coordinates belong to shape functions; "
            f"`rigid = true` of {name} starts without them",
        )


def check_outputs(system: System) -> None:
    """Output names that need the SID or the constraints to be judged.

    Raises
    ------
    InputError
        An elastic coordinate, a multiplier or a stress that does not exist.
    """
    for text in observed_outputs(system.scene):
        name = parse_output(text)
        if name.marker == STATE and name.owner not in system.scene.bodies:
            state_row(system, name)
            continue
        if is_stress(name.quantity):
            check_stress(system, name)
            continue
        if is_section_force(name):
            check_section_force(system, name)
            continue
        if name.marker or name.owner in (INPUTS, *SCENE_QUANTITIES):
            continue
        if coordinate_of(name.quantity) or name.quantity in FRICTION_QUANTITIES:
            continue
        if name.quantity in COMPONENTS:
            if is_constraint(system, name.owner):
                second_marker(system, name.owner)
            continue
        if name.quantity == VALUE or is_along_coordinate(name.quantity):
            continue
        if name.owner not in system.scene.bodies:
            multiplier_row(system, name.owner, name.quantity)
        elif is_elastic(name.quantity):
            data = system.bodies[system.index(name.owner)]
            data.elastic_number(name.quantity, f"outputs.record, {text}")


def check_attachments(system: System) -> None:
    """Joints, drives and forces act where shape functions can move.

    Raises
    ------
    InputError
        One acts on a node of a flexible body where all of them vanish, or whose
        orientation is no rotation.
    """
    _check_orientations(system)
    check_point_masses(system)
    bodies = {data.name: data for data in system.bodies if dead_nodes(data.sid)}
    for what, place, (body, marker) in attachments(system.scene):
        if body not in bodies:
            continue
        node = bodies[body].node(marker)
        try:
            check_moves(bodies[body].sid, node.id, what, body)
        except InputError as error:
            raise InputError(
                error.problem,
                place=place,
                expected=f"{error.expected}, or --accept-defects",
            ) from None


def _check_orientations(system: System) -> None:
    """Of SIDs; those of rigid bodies are made of what the scene says."""
    bodies = {data.name: data for data in system.bodies if data.given_sid is not None}
    for what, place, (body, marker) in attachments(system.scene):
        if body not in bodies:
            continue
        node = bodies[body].node(marker)
        fault = orientation_fault(node.AP.m0)
        if fault:
            raise InputError(
                f"{what} acts on node {node.id} of {body}, whose AP {fault}",
                place=place,
                expected="a rotation (`sidtool validate`, I18; `convert --repair` may "
                "repair it), or --accept-defects",
            )


def attachments(scene: SceneFile) -> Iterator[tuple[str, str, tuple[str, str]]]:
    """What acts on which (body, marker): in words, its key, and the marker."""
    for name, joint in scene.joints.items():
        for text in marker_names(joint):
            yield f"the joint {name}", f"joints.{name}", marker_reference(text)
    for name, drive in scene.drives.items():
        for end in (drive.marker, drive.reference):
            if drive.marker is not None and end is not None:
                yield f"the drive {name}", f"drives.{name}", marker_reference(end)
    for name, force in scene.forces.items():
        pair = getattr(force, "markers", None) or (getattr(force, "marker", None),)
        for end in pair:
            if end is not None:
                yield f"the force {name}", f"forces.{name}", marker_reference(end)


def check_masses(system: System) -> None:
    """Mass matrices of all bodies that the scene lets move freely.

    Raises
    ------
    InputError
        One is not positive definite: no such body can exist.
    """
    prescribed = (
        ()
        if system.prescribed_body_table is None
        else prescribed_rows(system.prescribed_body_table)
    )
    rigid = system.arrays.body[:, at.RD]
    for b, data in enumerate(system.bodies):
        if (
            not data.is_scene_body
            or b in prescribed
            or rigid[b] < (3 if system.planar else 6)
        ):
            continue
        motion = free_motion(data.sid, IN_PLANE[2] if system.planar else SPATIAL)
        if motion.possible:
            continue
        expected = (
            "a SID whose coupled mass matrix is positive definite (`sidtool validate`, "
            'I14), a prescribed frame (frame = "held"), or --accept-defects'
        )
        if isinstance(system.scene.bodies[data.name], RigidBody):
            expected = "positive moments of inertia, or none: a point mass"
        raise InputError(
            f"this body cannot move freely: {motion.reason}",
            place=f"bodies.{data.name}",
            expected=expected,
        )


#: Joints without a relative rotation, and those that guide.
_TRANSLATING = ("fixed", "prismatic")
_GUIDES = (*_TRANSLATING, "point_on_line", "point_on_plane")
_ROTATIONS = (*ROTATION_CONSTRAINTS, at.COUPLED_ANGLE)


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
                raise _error(
                    f"forces.{name}.torque", "its torque acts on", body, "no torque"
                )
    bodies = {d.name for d in system.bodies if d.rotates and d.is_scene_body}
    translating = _translating(scene, masses)
    turning = bodies - translating
    masses -= _guided(scene, translating)
    _check_centres(system, masses, turning)
    _check_tilts(system, masses, turning)
    for place, what, texts, remedy in _torques(scene):
        ends = {marker_reference(text)[0] for text in texts}
        if ends & masses and ends & turning:
            raise _error(place, what, min(ends & masses), remedy)


def _check_centres(system: System, masses: set[str], turning: set[str]) -> None:
    """Check that nothing acts beside the centre of a point mass.

    Raises
    ------
    InputError : a joint, drive or force does.
    """
    scene = system.scene
    data = {body.name: body for body in system.bodies if body.name in masses}
    pairs = [(f"joints.{n}", marker_names(joint)) for n, joint in scene.joints.items()]
    for name, force in scene.forces.items():
        one = (force.marker,) if isinstance(force, PointForce) else ()
        pairs.append((f"forces.{name}", getattr(force, "markers", None) or one))
    carried = list(_with_axes_of_first(scene))
    for place, texts in [*pairs, *carried]:
        for body, marker in map(marker_reference, texts):
            if body in data and data[body].node(marker).position.any():
                words = f"the marker {marker} lies beside the centre of"
                raise _error(place, words, body, "a marker at its centre")
    for place, texts in carried:
        first, second = (marker_reference(text)[0] for text in texts)
        if first in masses and second in turning:
            key = "marker" if place.startswith("drives") else "second marker"
            remedy = f"{first} as {key}"
            raise _error(place, "its axes are those of", first, remedy)


def _with_axes_of_first(scene: SceneFile) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield key and both markers of what pushes the second one along axes of the
    first, which is not the line between them."""
    for name, joint in scene.joints.items():
        if joint.type in ("point_on_line", "point_on_plane"):
            first, second = marker_names(joint)
            yield f"joints.{name}", (first, second)
    for name, drive in scene.drives.items():
        if drive.marker is not None:
            yield f"drives.{name}", (drive.reference, drive.marker)
    for name, force in scene.forces.items():
        if isinstance(force, Bushing) and not _is_central(force, scene):
            first, second = force.markers
            yield f"forces.{name}", (first, second)


def _check_tilts(system: System, masses: set[str], turning: set[str]) -> None:
    """Check that no point mass alone holds the axis of a body by a spatial joint.

    Raises
    ------
    InputError : one does.
    """
    if system.planar:
        return
    tilted = {}
    for name, joint in system.scene.joints.items():
        ends = {marker_reference(text)[0] for text in marker_names(joint)}
        if joint.type in _TILTED and ends & masses and ends & turning:
            tilted[name] = min(ends & masses)
    if not tilted:
        return
    from scipy.sparse import identity  # a third of a second that few scenes need
    from scipy.sparse.linalg import splu

    state = InitialState(system, initial_estimate(system))
    align_bodies(system, state.work, state.z)
    state.evaluate()
    tilts = dict[str, list[int]]()
    turned = [c[at.ROW] for c in system.arrays.constraint if c[at.KIND] in _ROTATIONS]
    for row in system.rows:
        if row.name in tilted:
            own = set(range(row.first, row.first + row.count)).intersection(turned)
            tilts.setdefault(row.name, []).extend(own)
    C = normalised_sparse_rows(scaled_sparse_jacobian(system, state.work.C))
    others = C[np.setdiff1d(np.arange(system.n_rows), sum(tilts.values(), []))]
    # regularised, as constraints may follow from each other
    gram = others @ others.T + 1e-12 * identity(others.shape[0])
    solve = splu(gram.tocsc()).solve if others.shape[0] else np.zeros_like
    for name, each in tilts.items():
        tilt = C[each].toarray().T
        if np.abs(tilt - others.T @ solve(others @ tilt)).max(initial=0.0) > _HELD:
            freer = _TILTED[system.scene.joints[name].type]
            words = "the joint would hold the axis of another body by"
            remedy = f'type = "{freer}"' if freer else ""
            raise _error(f"joints.{name}", words, tilted[name], remedy)


def _error(place: str, words: str, body: str, remedy: str) -> InputError:
    """Return the error of what acts, in words that end before the name of the body."""
    expected = f"a body with inertia: bodies.{body}.inertia"
    return InputError(
        f"{words} {body}, a point mass, which has no orientation",
        place=place,
        expected=f"{expected}, or {remedy}" if remedy else expected,
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
                    yield place, f"the {coordinate} of {other} acts on", markers, ""
        elif joint.type == "prismatic":
            words = "the joint would hold the orientation of another body by"
            yield place, words, tuple(marker_names(joint)), 'type = "point_on_line"'
        elif joint.type == "revolute" and joint.friction is not None:
            markers = tuple(marker_names(joint))
            yield f"{place}.friction", "its friction acts on", markers, "no friction"
    for name, drive in scene.drives.items():
        if is_turned(driven_coordinate(drive, joints)):
            markers = (drive.marker or "ground", drive.reference)
            if drive.joint is not None:
                markers = tuple(marker_names(joints[drive.joint]))
            yield f"drives.{name}", "its torque acts on", markers, "no drive"
    for name, force in scene.forces.items():
        joint_name = getattr(force, "joint", None)
        if joint_name is not None and is_turned(force_coordinate(force, scene)):
            markers = tuple(marker_names(joints[joint_name]))
            yield f"forces.{name}", "its torque acts on", markers, "no force"
        elif isinstance(force, Bushing) and _twists(force, scene):
            yield (
                f"forces.{name}",
                "its torque acts on",
                tuple(force.markers),
                "zeros for rotations",
            )


def _is_central(force: Bushing, scene: SceneFile) -> bool:
    """Whether a bushing pulls along the line between its markers."""
    first = 2 if scene.dimension == "planar" else 3
    stiffness = np.array(force.stiffness, float)
    is_alike = stiffness.ndim == 1 and np.ptp(stiffness[:first]) == 0.0
    return is_alike and not np.any(force.damping or 0.0)


def _twists(force: Bushing, scene: SceneFile) -> bool:
    """Whether a bushing makes torques of rotations."""
    first = 2 if scene.dimension == "planar" else 3
    for given in (force.stiffness, force.damping):
        values = np.array(given if given is not None else 0.0, float)
        if values.ndim and np.any(values[first:]):
            return True
    return False
