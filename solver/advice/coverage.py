"""Directions in which a body is loaded that its shape functions lack, or have in part.

A modal basis often lacks the shapes that stretch or twist a body: no shape function
moves a marker in the direction of a load, which then meets a rigid body.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.scene import PointForce, SceneFile, marker_names, marker_reference
from sidtool.formats.sid import SID, Array, Node

from ..space import layout as at
from ..start.assembly import Start
from ..start.conflicts import LARGEST, make_rigid, undeformed
from ..start.consistent import State
from ..system.bodies.embedded import matrices
from ..system.scene import Row, System
from .poor_shapes import Load, is_poor, poor_directions, poor_inertia, remedy
from .unjudged import is_unjudged, unjudged

#: Shape functions move a marker when they do so by more than this part of what they
#: move any node of the body.
MOVED = 1e-9
#: A direction is that of an axis when its cosine is closer to one than this.
ALONG = 1e-6

#: Where a load acts: body and marker.
Where = tuple[str, str]
Found = dict[Where, dict[str, str]]


def uncovered(system: System, start: Start) -> Iterator[str]:
    """One sentence for each body and marker that is loaded where shapes are missing.

    start : the assembled start of the system
    """
    ends = _loaded(system.scene)
    doubted = (_may_be_rigid, is_poor, is_unjudged)
    if any(doubt(system, *end) for doubt in doubted for end in ends):
        loads = list(_loads(system, start))
        yield from _rigid_directions(system, loads)
        yield from poor_directions(system, loads)
        yield from unjudged(system, loads)
    yield from poor_inertia(system, start)


def _loads(system: System, start: Start) -> Iterator[Load]:
    """What joints and forces do to flexible bodies at the start."""
    if system.complete_scene.n_rows > LARGEST:
        return
    state = undeformed(system, system.scene.time.start, start.z, start.v)
    make_rigid(state)
    yield from _of_joints(state)
    yield from _of_forces(state)


def _rigid_directions(system: System, loads: list[Load]) -> Iterator[str]:
    """Of markers that no shape function moves where they are loaded."""
    found: Found = {}
    for load in loads:
        _check(system, *load, found)
    for (body, marker), directions in found.items():
        names = list(dict.fromkeys(directions.values()))
        shapes = remedy(system.bodies[system.index(body)].sid)
        yield (
            f"{body} is rigid {' and '.join(directions)} at {marker}, where "
            f"{', '.join(names)} {'load' if names[1:] else 'loads'} it: no shape "
            f"function moves that; {shapes} with this marker among the interfaces do"
        )


def _loaded(scene: SceneFile) -> set[tuple[str, str]]:
    """Bodies and markers that joints and forces load."""
    texts = [t for joint in scene.joints.values() for t in marker_names(joint)]
    forces = [f for f in scene.forces.values() if isinstance(f, PointForce)]
    return {marker_reference(t) for t in (*texts, *(f.marker for f in forces))}


def _may_be_rigid(system: System, body: str, marker: str) -> bool:
    """Whether a force or a moment in some direction could leave a marker in its place.

    False if the shape functions move and turn it in all directions.
    """
    data = system.bodies[system.index(body)]
    if not data.of_scene or not data.sid.nq:
        return False
    node = data.node(marker)
    if _rests(data.sid, node):
        return False
    move, turn = (slice(2), slice(2, 3)) if system.planar else (slice(3), slice(3))
    least = MOVED * data.sid.nq**0.5
    return any(
        len(shapes) > data.sid.nq
        or np.linalg.svd(shapes, compute_uv=False)[-1] <= least * largest
        for shapes, largest in (
            (node.phi.m0[move], _largest(data.sid)),
            (node.psi.m0[turn], _largest_turn(data.sid)),
        )
    )


def _of_joints(state: State) -> Iterator[Load]:
    """Constraint forces: rows of C hold their directions, rigid and elastic."""
    system = state.system
    owner = {i: row.name for row in system.rows for i in range(row.first, _end(row))}
    for row, b, offset in system.arrays.segment:
        body = system.bodies[b]
        table = system.arrays.body[b]
        rd, nq = int(table[at.RD]), int(table[at.NQ])
        if not nq or not rd or not body.of_scene:
            continue
        joint = system.scene.joints.get(owner[row])
        for text in marker_names(joint) if joint is not None else ():
            name, marker = marker_reference(text)
            if name != body.name:
                continue
            C = state.work.C[offset : offset + rd + nq]
            axes = 2 if system.planar else 3
            f, m = _full(C[:axes]), _full(C[axes:rd], turn=True)
            m = m - np.cross(body.node(marker).position, f)
            if np.linalg.norm(f) > MOVED:
                m = np.zeros(3)
            yield (name, marker), f, m, owner[row]


def _of_forces(state: State) -> Iterator[Load]:
    """Forces and torques at markers, by their directions at the start."""
    system = state.system
    for name, force in system.scene.forces.items():
        if not isinstance(force, PointForce):
            continue
        body, marker = marker_reference(force.marker)
        b = system.index(body)
        if not system.bodies[b].of_scene or not system.bodies[b].sid.nq:
            continue
        R = _orientation(state, b)
        if force.axes == "marker":
            R = np.asarray(system.bodies[b].node(marker).AP.m0).T
        f = R.T @ _padded(force.force)
        torque = np.ravel(force.torque or 0.0)
        turn = torque if len(torque) == 3 else np.array([0.0, 0.0, torque[0]])
        for kind, vector in enumerate((f, R.T @ turn)):
            if np.any(vector):
                pair = [np.zeros(3), np.zeros(3)]
                pair[kind] = vector
                yield (body, marker), pair[0], pair[1], name


def _check(
    system: System, where: Where, f: Array, m: Array, owner: str, found: Found
) -> None:
    """Enters a force f or a moment m at a marker that does not deform its body."""
    body = system.bodies[system.index(where[0])]
    sid, node = body.sid, body.node(where[1])
    turning = bool(np.any(m))
    largest = _largest(sid)
    sits = not node.position.any() and not turning and _still(node.phi.m0, largest)
    if sits or _rests(sid, node):
        return
    vector = m if turning else _along_chord(sid, node, f, largest)
    if turning:
        largest = _largest_turn(sid)
    moved = vector @ (node.psi if turning else node.phi).m0
    size = float(np.linalg.norm(vector))
    if size > 0.0 and _still(moved, size * largest):
        words = f"{'about' if turning else 'along'} {_direction(vector / size)}"
        found.setdefault(where, {}).setdefault(words, owner)


def _largest(sid: SID) -> float:
    """The size of what shape functions move, also if they turn the nodes only."""
    size = max(float(np.abs(n.position).max(initial=0.0)) for n in sid.nodes)
    moved = [float(np.abs(n.phi.m0).max(initial=0.0)) for n in sid.nodes]
    turned = [float(np.abs(n.psi.m0).max(initial=0.0)) for n in sid.nodes]
    return max(*moved, *(size * turn for turn in turned)) or 1.0


def _largest_turn(sid: SID) -> float:
    return max(float(np.abs(n.psi.m0).max(initial=0.0)) for n in sid.nodes) or 1.0


def _rests(sid: SID, node: Node) -> bool:
    """Whether the body frame moves with a node: no shape function does."""
    moved, turned = _still(node.phi.m0, _largest(sid)), _largest_turn(sid)
    return moved and _still(node.psi.m0, turned)


def _still(shapes: Array, largest: float) -> bool:
    return float(np.abs(shapes).max(initial=0.0)) <= MOVED * largest


def _along_chord(sid: SID, node: Node, force: Array, largest: float) -> Array:
    """The part of a force that meets the shape functions in a chord frame.

    Across the line from its origin no node at the end of the chord moves, however soft
    the body is: the frame turns with it.
    """
    length = float(np.linalg.norm(node.position))
    origins = [n for n in sid.nodes if not n.position.any() and n.psi.m0.any()]
    if not length or not any(_still(n.phi.m0, largest) for n in origins):
        return force
    along = node.position / length
    if not _still(node.phi.m0 - np.outer(along, along @ node.phi.m0), largest):
        return force
    return np.asarray(along * (along @ force))


def _direction(unit: Array) -> str:
    for axis, name in enumerate("xyz"):
        if abs(unit[axis]) > 1.0 - ALONG:
            return name
    return f"({', '.join(f'{x:.3g}' for x in unit + 0.0)})"


def _orientation(state: State, b: int) -> Array:
    """Body axes to inertial ones."""
    return matrices(state.system.frames(state.work.frame[b])["R"])


def _padded(values: tuple[float, ...] | None) -> Array:
    full = np.zeros(3)
    full[: len(values or ())] = values or ()
    return full


def _full(part: Array, turn: bool = False) -> Array:
    """Components of a planar or spatial row, in three dimensions."""
    full = np.zeros(3)
    if turn and len(part) == 1:
        full[2] = part[0]
    else:
        full[: len(part)] = part
    return full


def _end(row: Row) -> int:
    return row.first + row.count
