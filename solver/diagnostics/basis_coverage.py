"""Loads in directions that the shape functions of a body hardly represent.

A modal basis often lacks the shapes that stretch or twist a body: no shape function
moves a marker in the direction of a load, for which the body is then rigid.

Loads for which the shape functions of a body are poor or unknown.

The share of the static compliance of the full body that the shape functions represent
is stored in the SID, if its source knew it. Shares are checked for loads at markers and
for the inertia of the body itself.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import DIRECTIONS, OE_INDICES, SID, Array, Node
from sidtool.formats.base.stress import stress_nodes
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import PointForce, SceneFile, marker_names, marker_reference
from sidtool.formats.sid_mass import body_size
from sidtool.formats.sid_subset import (
    inertia_load_scales,
    inertia_work_of_full_body,
    unit_load_compliances,
)

from ..initial_state.assembly import StateVectors
from ..initial_state.constraint_jacobian import InitialState
from ..initial_state.contradictions import (
    LARGE_SCENE,
    remove_deformation,
    undeformed_state,
)
from ..spatial import system_arrays as at
from ..system.body_data import BodyData
from ..system.rotated_markers import to_rotation_matrices
from ..system.sid_packing import symmetrise
from ..system.system import ConstraintRows, System
from .body_loads import expected_loads
from .excitation import drive_history, prescribed_frames, start_frame

#: Shape functions move a marker when they do so by more than this part of what they
#: move any node of the body.
MIN_DISPLACEMENT = 1e-9
#: A direction is that of an axis when its cosine is closer to one than this.
AXIS_COSINE = 1e-6

#: Where a load acts: body and marker.
LoadPosition = tuple[str, str]
RigidDirections = dict[LoadPosition, dict[str, str]]

#: Shape functions that carry less than this share of a compliance are poor.
MIN_SHARE = 0.9
#: Where what is missing is less than this part of the largest compliance beside it,
#: it matters only if the share is below one half.
SMALL_FRACTION, HALF_SHARE = 0.01, 0.5
#: A direction is loaded if this much of it lies in what the loads span.
LOADED_FRACTION = 0.5
#: A body without stress may be rigid under a load, as inextensible blades: its shape
#: functions carry less than this share.
RIGID_SHARE = 1e-3
#: A free one is not: it deforms by more than this part of its size.
MIN_STRETCH = 1e-6
#: Shapes that carry less than this share are missing, not poor.
MISSING_SHARE = 1e-12
#: What loads a body: body and marker, force and moment in body axes, what exerts them.
Load = tuple[tuple[str, str], Array, Array, str]
#: Words of labels of shape functions that are answers to static loads.
_STATIC_LABELS = ("attachment", "constraint", "static", "relief", "at 0 hz")
#: A compliance smaller by as much than the largest one of its kind is rounding.
_NEGLIGIBLE = 1e-18
#: Squares of natural frequencies that are closer (relative) are those of a pair.
_EQUAL_FREQUENCY = 1e-6
#: A mode takes part where it has more than this part of the largest share.
_MIN_PARTICIPATION = 1e-3
#: By node, compliances (6,) of the lower half of the natural modes that take part in
#: each direction, and of all.
HalfCompliances = dict[str, tuple[Array, Array]]


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


_FORCES, _MOMENTS = slice(0, 3), slice(3, 6)

#: Loads of a body by its own inertia.
INERTIA_LOADS = (
    *(f"acceleration along {axis}" for axis in "xyz"),
    *(f"acceleration about {axis}" for axis in "xyz"),
    *(f"rotation about {axis}" for axis in "xyz"),
    *(f"rotation about both {axes}" for axes in ("x and y", "y and z", "x and z")),
)


def is_poorly_represented(system: System, body: str, marker: str) -> bool:
    """True if shape functions are poor in some direction at a marker."""
    return bool(_poor_shares(system, system.bodies[system.index(body)], marker))


def poor_direction_notes(system: System, loads: Iterable[Load]) -> Iterator[Diagnostic]:
    """Compliance that is missing at loaded markers (N420)."""
    for (body, marker), acting in loads_at_markers(loads).items():
        data = system.bodies[system.index(body)]
        spanned_ = spanned_fraction(np.array([vector for vector, _ in acting]))
        poor = _poor_shares(system, data, marker, spanned_ > LOADED_FRACTION)
        if not poor:
            continue
        names = dict.fromkeys(name for v, name in acting if v[list(poor)].any())
        missing, directions = _missing_shares(poor)
        yield diagnose(
            "N420",
            body,
            missing=missing,
            directions=directions,
            marker=marker,
            joints=list(names),
            shapes=suggested_shapes(data.sid),
        )


def loads_at_markers(
    loads: Iterable[Load],
) -> dict[tuple[str, str], list[tuple[Array, str]]]:
    """Forces and moments (6,) with what exerts them, by body and marker."""
    loads_by_marker: dict[tuple[str, str], list[tuple[Array, str]]] = {}
    for end, force, moment, name in loads:
        loads_by_marker.setdefault(end, []).append(
            (np.concatenate([force, moment]), name)
        )
    return loads_by_marker


def _poor_shares(
    system: System,
    data: BodyData,
    marker: str,
    loaded: NDArray[np.bool_] | None = None,
) -> dict[int, float]:
    """What is carried in poor directions, by number.

    Parameters
    ----------
    loaded : (6,) whether anything loads them, default all
    """
    loaded = np.ones(6, bool) if loaded is None else loaded
    compliance = data.sid.carried
    if not data.is_scene_body or not data.sid.nq or compliance is None:
        return {}
    node = data.node(marker)
    row = compliance.shares.get(node.id)
    if row is None or min((x for x in row if x is not None), default=1.0) >= MIN_SHARE:
        return {}
    known = np.array([np.nan if x is None else x for x in row])
    # loads at the node that a free body's frame follows deform the body, too
    is_free_frame = compliance.free and not (node.phi.m0.any() or node.psi.m0.any())
    own = unit_load_compliances(data.sid, compliance.free).nodes[node.id]
    full = own / np.maximum(known, MISSING_SHARE)
    shares: dict[int, float] = {}
    for directions in load_directions(system):
        kind = [k for k in directions if loaded[k]]
        full[kind] = np.where(known[kind] > MISSING_SHARE, full[kind], 0.0)
        largest = np.nanmax(full[kind], initial=0.0)
        for k in kind:
            small = full[k] - own[k] <= SMALL_FRACTION * largest
            if known[k] <= MISSING_SHARE:
                poor = is_free_frame
            else:
                poor = known[k] < (HALF_SHARE if small else MIN_SHARE)
            if poor:
                shares[k] = float(known[k])
    return shares


def load_directions(system: System) -> tuple[list[int], list[int]]:
    """The directions of forces and of moments, in the plane or in space."""
    return ([0, 1], [5]) if system.planar else ([0, 1, 2], [3, 4, 5])


def spanned_fraction(vectors: Array) -> Array:
    """(6,) how much of a unit force or moment lies in what vectors (n, 6) span."""
    shares = np.zeros(6)
    for kind in (_FORCES, _MOMENTS):
        _, sizes, basis = np.linalg.svd(vectors[:, kind], full_matrices=False)
        basis_ = basis[sizes > LOADED_FRACTION * sizes.max(initial=0.0)]
        shares[kind] = np.linalg.norm(basis_, axis=0)
    return shares


def _missing_shares(poor: dict[int, float]) -> tuple[float, str]:
    """The largest missing share, and all directions in words, from shares by number."""
    directions = " and ".join(direction_text(k) for k in poor)
    return 1.0 - min(poor.values()), directions


def direction_text(k: int) -> str:
    return f"{'along' if k < 3 else 'about'} {DIRECTIONS[k].removeprefix('r')}"


def suggested_shapes(sid: SID) -> str:
    """Which shape functions hold the static answer to a load at a marker.

    Those of Craig-Bampton hold it of a body that is held; of a free one they hold its
    inertia in place of its reaction, unless it is loaded where it is held only.
    """
    if sid.carried is None:
        return "attachment"
    return f"attachment or {'Herting' if sid.carried.free else 'Craig-Bampton'}"


def poor_inertia_notes(system: System, start: StateVectors) -> Iterator[Diagnostic]:
    """Bodies whose own inertia deforms them as no shape function does (N422).

    Gravity and, as far as they are known, accelerations and rotations of its frame
    load it.
    """
    poor = [
        data for data in system.bodies if data.is_scene_body and _has_poor_inertia(data)
    ]
    if not poor:
        return
    history = system.cached(drive_history)
    frames = prescribed_frames(system, history)
    for data in poor:
        frame = frames.get(data.name)
        if frame is None:
            frame = start_frame(system, start.z, start.v, data.name)
        loads = expected_loads(system, frame, history.times, data.name)
        accelerations = (loads.acceleration, loads.angular_acceleration)
        w = loads.angular_velocity
        products = np.column_stack([w[:, a] * w[:, b] for a, b in OE_INDICES])
        sizes = np.hstack([*accelerations, products])
        shares = _poor_inertia_shares(system, data, np.abs(sizes).max(axis=0))
        if shares:
            causes = " and ".join(INERTIA_LOADS[k] for k in shares)
            missing = 1.0 - min(shares.values())
            yield diagnose("N422", data.name, missing=missing, causes=causes)


def _has_poor_inertia(data: BodyData) -> bool:
    compliance = data.sid.carried
    return bool(
        data.sid.nq
        and compliance
        and compliance.knows_inertia
        and max(compliance.lost) > 0.0
    )


def _poor_inertia_shares(
    system: System, data: BodyData, size: Array
) -> dict[int, float]:
    """Shares that are carried of the energy under loads of `size` (12,), where much of
    what all of them cause is missing.
    """
    compliance = data.sid.carried
    assert compliance is not None
    unit = unit_load_compliances(data.sid, compliance.free)
    full, own = inertia_work_of_full_body(compliance.lost, unit), unit.inertia
    size = size / inertia_load_scales(data.sid.mass, data.sid.J.m0[:3, 0])
    stretch = (full - own) * size / data.sid.mass
    is_deformed = compliance.free & (stretch > MIN_STRETCH * body_size(data.sid))
    full, own = full * size**2, own * size**2
    possible = [0, 1, 5, 8] if system.planar else list(range(12))
    largest = full[possible].max()
    has_stress = bool(stress_nodes(data.sid))
    counts = has_stress | is_deformed | (own >= RIGID_SHARE * full)
    return {
        k: float(own[k] / full[k])
        for k in possible
        if counts[k]
        and full[k] - own[k]
        > max((1.0 - MIN_SHARE) * full[k], SMALL_FRACTION * largest)
    }


def is_unassessed(system: System, body: str, marker: str) -> bool:
    """True if much of the compliance at a marker rests on the upper half of modes."""
    return bool(_upper_half_shares(system, body, marker))


def unassessed_loads(system: System, loads: Iterable[Load]) -> Iterator[Diagnostic]:
    """Markers at which it is not known what shape functions lack (N423)."""
    for (body, marker), acting in loads_at_markers(loads).items():
        spanned_ = spanned_fraction(np.array([vector for vector, _ in acting]))
        shares = _upper_half_shares(system, body, marker)
        shares = {k: share for k, share in shares.items() if spanned_[k] > HALF_SHARE}
        if shares:
            worst = max(shares, key=lambda k: shares[k])
            of_one = shares[worst] >= 1.0
            names = dict.fromkeys(name for v, name in acting if v[list(shares)].any())
            yield diagnose(
                "N423",
                body,
                share=shares[worst],
                direction=direction_text(worst),
                marker=marker,
                modes="modes of one frequency" if of_one else "the upper modes",
                joints=list(names),
            )


def _upper_half_shares(system: System, body: str, marker: str) -> dict[int, float]:
    """The share of the upper half of the natural modes, by direction, where large."""
    data = system.bodies[system.index(body)]
    halves = system.cached(_half_compliances).get(body)
    if halves is None:
        return {}
    lower, own = halves[data.node(marker).id]
    shares: dict[int, float] = {}
    for kind in load_directions(system):
        largest = max((own[k] for k in kind), default=0.0)
        for k in kind:
            share = 1.0 - lower[k] / own[k] if own[k] > _NEGLIGIBLE * largest else 0.0
            small = own[k] - lower[k] <= SMALL_FRACTION * largest
            if share > (HALF_SHARE if small else 1.0 - MIN_SHARE):
                shares[k] = float(share)
    return shares


def _half_compliances(system: System) -> dict[str, HalfCompliances]:
    """Of the bodies of which nothing is known."""
    compliances = {}
    for data in system.bodies:
        known = data.sid.carried is not None or _has_static_shapes(data.sid)
        if data.is_scene_body and data.sid.nq and not known:
            halves = _natural_mode_halves(data.sid)
            if halves is not None:
                compliances[data.name] = halves
    return compliances


def _has_static_shapes(sid: SID) -> bool:
    labels = " ".join(sid.labels).lower()
    return any(word in labels for word in _STATIC_LABELS)


def _natural_mode_halves(sid: SID) -> HalfCompliances | None:
    """None where Me or Ke is singular."""
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(symmetrise(sid.Me.m0)))
    except np.linalg.LinAlgError:
        return None
    squares, vectors = np.linalg.eigh(inverse @ symmetrise(sid.Ke.m0) @ inverse.T)
    if not squares[0] > 0.0:
        return None
    modes = inverse.T @ vectors / np.sqrt(squares)
    halves = {}
    for node in sid.nodes:
        parts = (np.vstack([node.phi.m0, node.psi.m0]) @ modes) ** 2
        lower = [_lower_half_sum(squares, part) for part in parts]
        halves[node.id] = (np.array(lower), parts.sum(axis=1))
    return halves


def _lower_half_sum(squares: Array, parts: Array) -> float:
    """What the lower half of the modes that take part has, of parts (nq,).

    Of modes of one frequency none is lower: which comes first is rounding.
    """
    taking = np.flatnonzero(parts > _MIN_PARTICIPATION * parts.max(initial=0.0))
    if not taking.size:
        return 0.0
    limit = (1.0 - _EQUAL_FREQUENCY) * squares[taking[len(taking) // 2]]
    return float(parts[squares < limit].sum())
