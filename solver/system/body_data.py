"""Data of the bodies of a scene: SID, markers and elastic coordinates of each body.

Damping of a body: the matrix De of a SID for the damping that a scene asks for.
"""

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    SID,
    Array,
    Node,
    Taylor,
    rigid_node,
    rigid_sid,
    symmetric_3x3,
)
from sidtool.formats.motion_kinds import named_by_kind
from sidtool.formats.scene import (
    DISPLACEMENTS,
    KIND,
    Body,
    Damping,
    ElasticInitial,
    Fixed,
    FrequencyDamping,
    Marker,
    ModalDamping,
    Placement,
    RayleighDamping,
    RigidBody,
    SceneFile,
    SidBody,
    SidDamping,
    as_3d,
    has_wildcard,
    is_elastic,
    is_section_force,
    is_stress,
    orientation_matrix,
    parse_output,
    position_3d,
)
from sidtool.formats.sid_files import read_sid
from sidtool.formats.sid_subset import select_shape_functions, selected_indices
from sidtool.formats.storage.cache import cached_by_identity

from .sid_packing import symmetrise
from .sid_terms import (
    check_first_order,
    has_quadratic_inertia,
    out_of_plane_momenta,
    unloaded_across,
)
from .stiffening import without_stiffening

#: Damping ratios of the frequency policy: up to each frequency [Hz], then beyond.
FREQUENCY_STEPS = ((100.0, 0.01), (1000.0, 0.1))
DEFAULT_RATIO = 1.0

#: Name of the added node.
FRAME_NODE = "held frame"


def sid_with_damping(sid: SID, policy: Damping | None, name: str) -> SID:
    """The SID with the damping matrix that a policy makes.

    Raises
    ------
    InputError
        Wrong number of ratios.
    """
    if policy is None or isinstance(policy, SidDamping) or sid.nq == 0:
        return sid
    return replace(sid, De=Taylor(_damping_matrix(sid, policy, name)))


def _damping_matrix(sid: SID, policy: Damping, name: str) -> Array:
    if isinstance(policy, RayleighDamping):
        return policy.alpha * sid.Me.m0 + policy.beta * sid.Ke.m0
    frequencies, modes = natural_modes(sid)
    ratios = _ratios(policy, frequencies / (2.0 * np.pi), name)
    weighted = sid.Me.m0 @ modes
    return (weighted * (2.0 * ratios * frequencies)) @ weighted.T


def natural_modes(sid: SID) -> tuple[Array, Array]:
    """Angular frequencies [rad/s], growing, and modes of Me and Ke, mass-normalised."""
    from scipy.linalg import eigh

    squares, modes = eigh(sid.Ke.m0, sid.Me.m0)
    return np.sqrt(np.maximum(squares, 0.0)), modes


def _ratios(policy: Damping, hertz: Array, name: str) -> Array:
    if isinstance(policy, FrequencyDamping):
        ratios = np.full(len(hertz), DEFAULT_RATIO)
        for limit, ratio in reversed(FREQUENCY_STEPS):
            ratios[hertz <= limit] = ratio
        return ratios
    assert isinstance(policy, ModalDamping)
    if len(policy.ratio) not in (1, len(hertz)):
        raise InputError(
            f"has {len(policy.ratio)} ratios",
            place=f"bodies.{name}.damping.ratio",
            expected=f"one, or {len(hertz)} for the modes of the SID",
        )
    return np.broadcast_to(np.array(policy.ratio), hertz.shape)


@cached_by_identity
def displacement_amplitudes(sid: SID, axes: int) -> Array:
    """Largest displacement that is known per unit of each elastic coordinate, (nq,).

    At a node, but no less than the mean over the mass of the body: nodes may lie where
    a shape function hardly moves.
    """
    if sid.nq == 0 or sid.mass == 0.0:
        return np.ones(sid.nq)
    mean = np.sqrt(np.maximum(np.diag(sid.Me.m0), 1e-300) / sid.mass)
    sizes = [np.linalg.norm(node.phi.m0[:axes], axis=0) for node in sid.nodes]
    return np.max([mean, *sizes], axis=0)


@cached_by_identity
def coordinate_frequencies(sid: SID) -> Array:
    """Angular frequency of each elastic coordinate alone [rad/s], (nq,)."""
    mass = np.maximum(np.diag(sid.Me.m0), 1e-300)
    return np.sqrt(np.maximum(np.diag(sid.Ke.m0), 0.0) / mass)


@cached_by_identity
def squared_frequencies(sid: SID) -> Array:
    """Squares of the angular frequencies of the modes of (Ke, Me), growing, (nq,)
    [rad2/s2]; of single coordinates if Me is no mass matrix."""
    stiffness, mass = symmetrise(sid.Ke.m0), symmetrise(sid.Me.m0)
    try:
        half = np.linalg.inv(np.linalg.cholesky(mass))
    except np.linalg.LinAlgError:
        return np.sort(coordinate_frequencies(sid) ** 2)
    return np.asarray(np.linalg.eigvalsh(half @ stiffness @ half.T))


def with_held_frames(scene: SceneFile) -> SceneFile:
    """The scene with a fixed joint "NAME held" for each body whose frame is held."""
    markers, joints = dict(scene.ground.markers), dict(scene.joints)
    held_bodies = {
        n: body for n, body in scene.sid_bodies.items() if body.frame == "held"
    }
    for body, content in held_bodies.items():
        name = f"{body} held"
        start = content.initial
        pose: dict[str, Any] = {k: getattr(start, k) for k in Placement.model_fields}
        markers[name] = Marker(**pose)
        ends = (f"ground.{name}", f"{body}.{FRAME_NODE}")
        joints[name] = Fixed(type="fixed", markers=ends)
    if not held_bodies:
        return scene
    ground = scene.ground.model_copy(update={"markers": markers})
    return scene.model_copy(update={"ground": ground, "joints": joints})


def without_held_frames(scene: SceneFile) -> SceneFile:
    """The scene that became this one, as files hold it: the same object where it did
    not change.
    """
    held_markers = {f"{name} held" for name in scene.bodies}
    if held_markers.isdisjoint(scene.joints):
        return scene
    joints = {n: joint for n, joint in scene.joints.items() if n not in held_markers}
    markers = {n: m for n, m in scene.ground.markers.items() if n not in held_markers}
    ground = scene.ground.model_copy(update={"markers": markers})
    return scene.model_copy(update={"ground": ground, "joints": joints})


def with_frame_node(sid: SID) -> SID:
    """The SID with a node at the origin of its frame."""
    shapes = Taylor(np.zeros((3, sid.nq)))
    origin, AP = Taylor(np.zeros((3, 1))), Taylor(np.eye(3))
    return replace(
        sid, nodes=(*sid.nodes, Node(FRAME_NODE, origin, shapes, shapes, AP))
    )


def is_taken_as_rigid(scene: SceneFile, name: str) -> bool:
    """True if a body has a SID of which only the mass counts."""
    body = scene.bodies.get(name)
    return isinstance(body, SidBody) and body.rigid


def elastic_outputs(scene: SceneFile) -> list[str]:
    """Outputs that only the flexibility of rigid bodies would give."""
    names = []
    for text in scene.outputs.record:
        if has_wildcard("." + text.rpartition(".")[2]):
            continue
        name = parse_output(text)
        elastic = is_elastic(name.quantity) or is_stress(name.quantity)
        elastic = elastic or is_section_force(name)
        # That of one marker is zero; patterns find those of flexible bodies.
        elastic = elastic or (has_wildcard(text) and name.quantity in DISPLACEMENTS)
        owners = fnmatch.filter(scene.bodies, name.owner)
        if elastic and owners and all(is_taken_as_rigid(scene, n) for n in owners):
            names.append(text)
    return names


def without_elasticity(scene: SceneFile) -> SceneFile:
    """The scene without what is said of the elastic coordinates of rigid bodies."""
    if not any(is_taken_as_rigid(scene, name) for name in scene.bodies):
        return scene
    bodies = {
        name: body.model_copy(
            update={"initial": _undeformed_initial(body), "damping": None}
        )
        if isinstance(body, SidBody) and body.rigid
        else body
        for name, body in scene.bodies.items()
    }
    removed = set(elastic_outputs(scene))
    record = tuple(text for text in scene.outputs.record if text not in removed)
    outputs = scene.outputs.model_copy(update={"record": record})
    return scene.model_copy(update={"bodies": bodies, "outputs": outputs})


def _undeformed_initial(body: SidBody) -> ElasticInitial:
    nothing = {"elastic": None, "elastic_velocity": None}
    return body.initial.model_copy(update=nothing)


def as_rigid_sid(sid: SID) -> SID:
    """The same body undeformed: mass, centre, inertia and nodes."""
    centre = sid.mdCM.m0[:, 0] / sid.mass if sid.mass else sid.mdCM.m0[:, 0]
    nodes = tuple(
        rigid_node(node.id, node.origin.m0[:, 0], node.AP.m0) for node in sid.nodes
    )
    return rigid_sid(sid.mass, centre, symmetric_3x3(sid.J.m0[:, 0]), nodes)


@dataclass(frozen=True)
class BodyData:
    """One body of a compiled scene.

    Attributes
    ----------
    sid
        Its Standard Input Data; a rigid body has no elastic coordinates.
    rotates
        False for a point mass, whose orientation never changes.
    quadratic_inertia
        Keep the term of J that is quadratic in q; stiffened bodies always do.
    nodes
        Marker name to node id.
    coordinate_numbers : (nq,)
        The elastic coordinates, from 1, as in the SID that was given.
    is_scene_body
        False for the ground, and for what carries a state of a law, see `control_laws`.
    initial_state
        That state at the start.
    given_sid
        The SID that was given, of which elastic coordinates have their names.
    out_of_plane_momenta : (n, nq)
        Momenta of motions that nothing in the plane of a planar scene excites, see
        `out_of_plane_momenta`.
    rotated_markers
        Name of a rotated marker to the marker and its rotation, (3, 3); see
        `rotated_markers`.
    """

    name: str
    sid: SID
    rotates: bool
    quadratic_inertia: bool
    nodes: Mapping[str, str]
    coordinate_numbers: tuple[int, ...] = ()
    is_scene_body: bool = True
    initial_state: float = 0.0
    given_sid: SID | None = None
    out_of_plane_momenta: Array | None = None
    rotated_markers: Mapping[str, tuple[str, Array]] = field(default_factory=dict)

    def node(self, marker: str) -> Node:
        """The node behind a marker name; no name is the origin of a rigid body."""
        if marker not in self.rotated_markers:
            return self.sid.node(self.nodes.get(marker, marker))
        marker, rotation = self.rotated_markers[marker]
        node = self.node(marker)
        m1 = None if node.AP.m1 is None else node.AP.m1 @ rotation
        return replace(node, AP=Taylor(node.AP.m0 @ rotation, m1))

    def elastic_number(self, quantity: str, place: str) -> int:
        """Number of the elastic coordinate that qN, vqN, bending_yN, ... stand for.

        Raises
        ------
        InputError
            The body has no such coordinate.
        """
        kind = KIND.fullmatch(quantity)
        if kind is not None:
            return self._number_of(kind[2], place)
        prefix = "vq" if quantity.startswith("v") else "q"
        number = int(quantity.removeprefix(prefix))
        if number not in self.coordinate_numbers:
            raise InputError(
                f"{self.name} has {len(self.coordinate_numbers)} elastic coordinates",
                place=place,
                expected=listed_numbers(self.coordinate_numbers, prefix),
            )
        return number

    def _number_of(self, kind: str, place: str) -> int:
        """Of the elastic coordinate that is called so by its kind."""
        known = named_by_kind(self.given_sid or self.sid)
        available = {
            name: k for name, k in known.items() if k in self.coordinate_numbers
        }
        if kind in available:
            return available[kind]
        listed = ", ".join(available)
        raise InputError(
            f"{self.name} has no elastic coordinate {kind}",
            place=place,
            expected=f"one of {listed}" if listed else "another output",
        )


def listed_numbers(numbers: Sequence[int], prefix: str) -> str:
    """ "q1 to q5", or "q1, q3" where some are left out."""
    names = [f"{prefix}{k}" for k in numbers]
    is_complete = list(numbers) == list(range(1, len(names) + 1))
    if len(names) > 1 and is_complete:
        return f"{names[0]} to {names[-1]}"
    return ", ".join(names) or "another name"


def read_sids(
    scene: SceneFile, folder: Path, sids: Mapping[str, SID]
) -> dict[str, SID]:
    """The SIDs of all bodies that have one, by name; given ones replace files.

    Raises
    ------
    InputError
        A SID cannot be read.
    """
    read = {}
    for name, body in scene.sid_bodies.items():
        if name not in sids and not body.sid:
            raise InputError(
                f"{body.model} is a model that has to be converted first",
                place=f"bodies.{name}.model",
                expected="a command of sidtool, which converts it, or a SID",
            )
        read[name] = sids[name] if name in sids else read_sid(folder / body.sid)
    return read


def body_data(name: str, body: Body, sids: Mapping[str, SID], planar: bool) -> BodyData:
    """The data of one body of a scene; see `read_sids`.

    Raises
    ------
    InputError
        Its SID lacks a node that a marker names.
    """
    if isinstance(body, SidBody):
        return _flexible_body(name, body, sids[name], planar)
    return rigid_body(name, body, rigid_nodes(body.markers))


def _flexible_body(name: str, body: SidBody, sid: SID, planar: bool) -> BodyData:
    for marker, node in body.markers.items():
        try:
            sid.node(node)
        except InputError as error:
            raise InputError(
                f"{error.problem} in {body.sid}",
                place=f"bodies.{name}.markers.{marker}",
                expected=error.expected,
            ) from None
    nodes, place, given = dict(body.markers), f"bodies.{name}", sid
    selected = selected_indices(
        body.shape_functions, sid.nq, f"{place}.shape_functions"
    )
    momenta: Array | None = None
    if body.rigid:
        sid, selected = as_rigid_sid(sid), ()
    else:
        check_first_order(sid, body.sid, f"{place}.sid")
        sid = sid_with_damping(sid, body.damping, name)
        if not body.geometric_stiffening:
            stiffening = f"{place}.geometric_stiffening"
            sid = without_stiffening(sid, planar, stiffening)
        sid = select_shape_functions(sid, selected)
        if planar:
            ids = map(str, body.markers.values())
            momenta = out_of_plane_momenta(
                sid, ids, body.frame == "held", f"{place}.sid"
            )
            sid = unloaded_across(sid, momenta)
    sid = with_frame_node(sid) if body.frame == "held" else sid
    numbers = tuple(k + 1 for k in selected)
    return BodyData(
        name,
        sid,
        True,
        has_quadratic_inertia(body, sid, planar),
        nodes,
        numbers,
        given_sid=given,
        out_of_plane_momenta=momenta,
    )


def rigid_body(name: str, body: RigidBody, nodes: tuple[Node, ...]) -> BodyData:
    """The data of a rigid body; see `rigid_nodes`."""
    centre = as_3d(body.centre_of_mass)
    inertia = np.zeros((3, 3)) if body.inertia is None else inertia_tensor(body.inertia)
    with np.errstate(over="ignore", invalid="ignore"):
        steiner = body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    if not np.isfinite(inertia + steiner).all():
        raise InputError(
            f"gives {name} an inertia beyond the largest number",
            place=f"bodies.{name}.centre_of_mass",
            expected="lengths in metres",
        )
    sid = rigid_sid(body.mass, centre, inertia + steiner, nodes)
    rotates = body.inertia is not None or bool(centre.any())
    return BodyData(name, sid, rotates, False, {})


def rigid_nodes(markers: Mapping[str, Marker]) -> tuple[Node, ...]:
    """The origin of a rigid body or of the ground, and its markers, as nodes."""
    markers_with_pose = (
        (n, position_3d(marker), orientation_matrix(marker))
        for n, marker in markers.items()
    )
    return rigid_node("", np.zeros(3)), *(
        rigid_node(*marker) for marker in markers_with_pose
    )


def inertia_tensor(inertia: object) -> Array:
    """zz alone (planar), principal values, or a full tensor, as (3, 3)."""
    values = np.asarray(inertia, float)
    if values.ndim == 0:
        return np.diag([0.0, 0.0, float(values)])
    return np.diag(values) if values.ndim == 1 else values
