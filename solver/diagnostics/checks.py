"""Checks of a compiled scene before it is integrated."""

from collections.abc import Iterable, Iterator, Mapping

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, orientation_fault
from sidtool.formats.dead_nodes import check_moves, dead_nodes
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    INPUTS,
    SCENE_QUANTITIES,
    STATE,
    VALUE,
    RigidBody,
    SceneFile,
    coordinate_of,
    is_along_coordinate,
    is_elastic,
    is_section_force,
    is_stress,
    marker_names,
    marker_reference,
    observed_outputs,
    parse_output,
)
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, free_motion
from sidtool.formats.storage.sid_content import content_digest

from ..initial_state.given_state import prescribed_rows
from ..output.body_outputs import check_stress
from ..output.columns import state_row
from ..output.reactions import COMPONENTS, is_constraint, multiplier_row, second_marker
from ..output.section_forces import check_section_force
from ..spatial import system_arrays as at
from ..system.system import System
from .point_masses import check_point_masses


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
