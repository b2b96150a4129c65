"""Loads in directions that the shape functions of a body hardly represent.

A modal basis often lacks the shapes that stretch or twist a body: no shape function
moves a marker in the direction of a load, for which the body is then rigid.
"""

from collections.abc import Iterator

import numpy as np

from sidtool.formats.base.sid import SID, Array, Node
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import PointForce, SceneFile, marker_names, marker_reference

from ..initial_state.assembly import StateVectors
from ..initial_state.constraint_jacobian import InitialState
from ..initial_state.contradictions import (
    LARGE_SCENE,
    remove_deformation,
    undeformed_state,
)
from ..spatial import system_arrays as at
from ..system.rotated_markers import to_rotation_matrices
from ..system.system import ConstraintRows, System
from .basis_shares import (
    Load,
    is_poorly_represented,
    is_unassessed,
    poor_direction_notes,
    poor_inertia_notes,
    suggested_shapes,
    unassessed_loads,
)

#: Shape functions move a marker when they do so by more than this part of what they
#: move any node of the body.
MIN_DISPLACEMENT = 1e-9
#: A direction is that of an axis when its cosine is closer to one than this.
AXIS_COSINE = 1e-6

#: Where a load acts: body and marker.
LoadPosition = tuple[str, str]
RigidDirections = dict[LoadPosition, dict[str, str]]


def unrepresented_loads(system: System, start: StateVectors) -> Iterator[Diagnostic]:
    """Markers that are loaded where shape functions are missing (N420, N422, N423).

    Parameters
    ----------
    start
        The assembled start of the system.
    """
    ends = _loaded_markers(system.scene)
    checks = (_may_be_rigid, is_poorly_represented, is_unassessed)
    if any(check(system, *end) for check in checks for end in ends):
        loads = list(_body_loads(system, start))
        yield from _rigid_directions(system, loads)
        yield from poor_direction_notes(system, loads)
        yield from unassessed_loads(system, loads)
    yield from poor_inertia_notes(system, start)


def _body_loads(system: System, start: StateVectors) -> Iterator[Load]:
    """What joints and forces do to flexible bodies at the start."""
    if system.full_joint_system.n_rows > LARGE_SCENE:
        return
    state = undeformed_state(system, system.scene.time.start, start.z, start.v)
    remove_deformation(state)
    yield from _joint_loads(state)
    yield from _force_loads(state)


def _rigid_directions(system: System, loads: list[Load]) -> Iterator[Diagnostic]:
    """Of markers that no shape function moves where they are loaded."""
    by_marker: RigidDirections = {}
    for load in loads:
        _find_rigid_direction(system, *load, by_marker)
    for (body, marker), directions in by_marker.items():
        names = list(dict.fromkeys(directions.values()))
        shapes = suggested_shapes(system.bodies[system.index(body)].sid)
        yield diagnose(
            "N420",
            body,
            missing=1.0,
            directions=" and ".join(directions),
            marker=marker,
            joints=names,
            shapes=shapes,
        )


def _loaded_markers(scene: SceneFile) -> set[tuple[str, str]]:
    """Bodies and markers that joints and forces load."""
    texts = [t for joint in scene.joints.values() for t in marker_names(joint)]
    forces = [f for f in scene.forces.values() if isinstance(f, PointForce)]
    return {marker_reference(t) for t in (*texts, *(f.marker for f in forces))}


def _may_be_rigid(system: System, body: str, marker: str) -> bool:
    """True if a force or a moment in some direction could leave a marker in its place.

    False if the shape functions move and turn it in all directions.
    """
    data = system.bodies[system.index(body)]
    if not data.is_scene_body or not data.sid.nq:
        return False
    node = data.node(marker)
    if _is_frame_node(data.sid, node):
        return False
    move, rotation = (slice(2), slice(2, 3)) if system.planar else (slice(3), slice(3))
    least = MIN_DISPLACEMENT * data.sid.nq**0.5
    return any(
        len(shapes) > data.sid.nq
        or np.linalg.svd(shapes, compute_uv=False)[-1] <= least * largest
        for shapes, largest in (
            (node.phi.m0[move], _largest_shape_entry(data.sid)),
            (node.psi.m0[rotation], _largest_rotation_entry(data.sid)),
        )
    )


def _joint_loads(state: InitialState) -> Iterator[Load]:
    """Constraint forces: rows of C hold their directions, rigid and elastic."""
    system = state.system
    owner = {
        i: row.name for row in system.rows for i in range(row.first, _end_row(row))
    }
    for row, b, offset in system.arrays.segment:
        body = system.bodies[b]
        table = system.arrays.body[b]
        rd, nq = int(table[at.RD]), int(table[at.NQ])
        if not nq or not rd or not body.is_scene_body:
            continue
        joint = system.scene.joints.get(owner[row])
        for text in marker_names(joint) if joint is not None else ():
            name, marker = marker_reference(text)
            if name != body.name:
                continue
            C = state.work.C[offset : offset + rd + nq]
            axes = 2 if system.planar else 3
            f, m = _row_as_3d(C[:axes]), _row_as_3d(C[axes:rd], is_rotation=True)
            m = m - np.cross(body.node(marker).position, f)
            if np.linalg.norm(f) > MIN_DISPLACEMENT:
                m = np.zeros(3)
            yield (name, marker), f, m, owner[row]


def _force_loads(state: InitialState) -> Iterator[Load]:
    """Forces and torques at markers, by their directions at the start."""
    system = state.system
    for name, force in system.scene.forces.items():
        if not isinstance(force, PointForce):
            continue
        body, marker = marker_reference(force.marker)
        b = system.index(body)
        if not system.bodies[b].is_scene_body or not system.bodies[b].sid.nq:
            continue
        R = _orientation(state, b)
        if force.axes == "marker":
            R = np.asarray(system.bodies[b].node(marker).AP.m0).T
        f = R.T @ _pad_vector(force.force)
        torque = np.ravel(force.torque or 0.0)
        moment = torque if len(torque) == 3 else np.array([0.0, 0.0, torque[0]])
        for kind, vector in enumerate((f, R.T @ moment)):
            if np.any(vector):
                pair = [np.zeros(3), np.zeros(3)]
                pair[kind] = vector
                yield (body, marker), pair[0], pair[1], name


def _find_rigid_direction(
    system: System,
    position: LoadPosition,
    f: Array,
    m: Array,
    owner: str,
    directions: RigidDirections,
) -> None:
    """Enters a force f or a moment m at a marker that does not deform its body."""
    body = system.bodies[system.index(position[0])]
    sid, node = body.sid, body.node(position[1])
    is_moment = bool(np.any(m))
    largest = _largest_shape_entry(sid)
    is_at_origin = (
        not node.position.any() and not is_moment and _is_zero(node.phi.m0, largest)
    )
    if is_at_origin or _is_frame_node(sid, node):
        return
    vector = (
        _moment_without_roll(sid, node, m)
        if is_moment
        else _chord_component(sid, node, f, largest)
    )
    if is_moment:
        largest = _largest_rotation_entry(sid)
    displacement = vector @ (node.psi if is_moment else node.phi).m0
    size = float(np.linalg.norm(vector))
    if size > 0.0 and _is_zero(displacement, size * largest):
        direction_text = (
            f"{'about' if is_moment else 'along'} {_direction_text(vector / size)}"
        )
        directions.setdefault(position, {}).setdefault(direction_text, owner)


def _largest_shape_entry(sid: SID) -> float:
    """The size of what shape functions move, also if they turn the nodes only."""
    size = max(float(np.abs(n.position).max(initial=0.0)) for n in sid.nodes)
    displacements = [float(np.abs(n.phi.m0).max(initial=0.0)) for n in sid.nodes]
    rotations = [float(np.abs(n.psi.m0).max(initial=0.0)) for n in sid.nodes]
    return max(*displacements, *(size * rotation for rotation in rotations)) or 1.0


def _largest_rotation_entry(sid: SID) -> float:
    return max(float(np.abs(n.psi.m0).max(initial=0.0)) for n in sid.nodes) or 1.0


def _is_frame_node(sid: SID, node: Node) -> bool:
    """True if the body frame moves with a node: no shape function does."""
    displacement, rotation = (
        _is_zero(node.phi.m0, _largest_shape_entry(sid)),
        _largest_rotation_entry(sid),
    )
    return displacement and _is_zero(node.psi.m0, rotation)


def _is_zero(shapes: Array, largest: float) -> bool:
    return float(np.abs(shapes).max(initial=0.0)) <= MIN_DISPLACEMENT * largest


def _chord_component(sid: SID, node: Node, force: Array, largest: float) -> Array:
    """The part of a force that meets the shape functions in a chord frame.

    Across the line from its origin no node at the end of the chord moves, however soft
    the body is: the frame rotates with it.
    """
    length = float(np.linalg.norm(node.position))
    origins = [n for n in sid.nodes if not n.position.any() and n.psi.m0.any()]
    if not length or not any(_is_zero(n.phi.m0, largest) for n in origins):
        return force
    along = node.position / length
    if not _is_zero(node.phi.m0 - np.outer(along, along @ node.phi.m0), largest):
        return force
    return np.asarray(along * (along @ force))


def _moment_without_roll(sid: SID, node: Node, moment: Array) -> Array:
    """The part of a moment that meets the shape functions in a chord frame.

    The frame rotates about its chord with the node at its origin, and the other nodes
    twist relative to that.
    """
    largest, largest_rotation = _largest_shape_entry(sid), _largest_rotation_entry(sid)
    if node.position.any() or not _is_zero(node.phi.m0, largest):
        return moment
    for end in sid.nodes:
        length = float(np.linalg.norm(end.position))
        along = end.position / length if length else np.zeros(3)
        across = end.phi.m0 - np.outer(along, along @ end.phi.m0)
        is_twisted = not _is_zero(along @ end.psi.m0, largest_rotation)
        is_held = _is_zero(along @ node.psi.m0, largest_rotation)
        if length and _is_zero(across, largest) and is_twisted and is_held:
            return np.asarray(moment - along * (along @ moment))
    return moment


def _direction_text(unit: Array) -> str:
    for axis, name in enumerate("xyz"):
        if abs(unit[axis]) > 1.0 - AXIS_COSINE:
            return name
    return f"({', '.join(f'{x:.3g}' for x in unit + 0.0)})"


def _orientation(state: InitialState, b: int) -> Array:
    """Body axes to inertial ones."""
    return to_rotation_matrices(state.system.frames(state.work.frame[b])["R"])


def _pad_vector(values: tuple[float, ...] | None) -> Array:
    full = np.zeros(3)
    full[: len(values or ())] = values or ()
    return full


def _row_as_3d(part: Array, is_rotation: bool = False) -> Array:
    """Components of a planar or spatial row, in three dimensions."""
    full = np.zeros(3)
    if is_rotation and len(part) == 1:
        full[2] = part[0]
    else:
        full[: len(part)] = part
    return full


def _end_row(row: ConstraintRows) -> int:
    return row.first + row.count
