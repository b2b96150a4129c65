"""Bodies of a compiled scene: their SIDs as the scene takes them, and their markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.kinds_of_motion import named_by_kind
from sidtool.formats.scene import (
    KIND,
    Body,
    Marker,
    RigidBody,
    SceneFile,
    SidBody,
    as_3d,
    position_3d,
    rotation,
)
from sidtool.formats.sid import SID, Array, Node, Taylor, rigid_node, rigid_sid
from sidtool.formats.sid_files import read_sid
from sidtool.formats.sid_subset import kept_indices, with_shape_functions

from .damping import damped
from .first_order import check_first_order
from .held_frames import with_frame_node
from .lost_inertia import has_quadratic_inertia
from .out_of_plane import out_of_plane, unloaded_across
from .rigid_bodies import rigid_part
from .unstiffened import without_stiffening


@dataclass(frozen=True)
class BodyData:
    """One body of a compiled scene.

    sid : its Standard Input Data; a rigid body has no elastic coordinates
    rotates : False for a point mass, whose orientation never changes
    quadratic_inertia : keep the term of J that is quadratic in q; stiffened bodies
        always do
    nodes : marker name to node id
    numbers : (nq,) of the elastic coordinates, from 1, as in the SID that was given
    of_scene : False for the ground, and for what carries a state of a law, see `laws`
    starts_at : that state at the start
    given : the SID that was given, of which elastic coordinates have their names
    across : (n, nq) momenta of motions that nothing in the plane of a planar scene
        excites, see `out_of_plane`
    turned : name of a turned marker to the marker and its rotation, (3, 3); see
        `turned_markers`
    """

    name: str
    sid: SID
    rotates: bool
    quadratic_inertia: bool
    nodes: Mapping[str, str]
    numbers: tuple[int, ...] = ()
    of_scene: bool = True
    starts_at: float = 0.0
    given: SID | None = None
    across: Array | None = None
    turned: Mapping[str, tuple[str, Array]] = field(default_factory=dict)

    def node(self, marker: str) -> Node:
        """The node behind a marker name; no name is the origin of a rigid body."""
        if marker not in self.turned:
            return self.sid.node(self.nodes.get(marker, marker))
        marker, turn = self.turned[marker]
        node = self.node(marker)
        m1 = None if node.AP.m1 is None else node.AP.m1 @ turn
        return replace(node, AP=Taylor(node.AP.m0 @ turn, m1))

    def elastic_number(self, quantity: str, place: str) -> int:
        """Number of the elastic coordinate that qN, vqN, bending_yN, ... stand for.

        Raises
        ------
        InputError : the body has no such coordinate.
        """
        kind = KIND.fullmatch(quantity)
        if kind is not None:
            return self._number_of(kind[2], place)
        prefix = "vq" if quantity.startswith("v") else "q"
        number = int(quantity.removeprefix(prefix))
        if number not in self.numbers:
            raise InputError(
                f"{self.name} has {len(self.numbers)} elastic coordinates",
                place=place,
                expected=listed_numbers(self.numbers, prefix),
            )
        return number

    def _number_of(self, kind: str, place: str) -> int:
        """Of the elastic coordinate that is called so by its kind."""
        known = named_by_kind(self.given or self.sid)
        kept = {name: k for name, k in known.items() if k in self.numbers}
        if kind in kept:
            return kept[kind]
        listed = ", ".join(kept)
        raise InputError(
            f"{self.name} has no elastic coordinate {kind}",
            place=place,
            expected=f"one of {listed}" if listed else "another output",
        )


def listed_numbers(numbers: Sequence[int], prefix: str) -> str:
    """ "q1 to q5", or "q1, q3" where some are left out."""
    names = [f"{prefix}{k}" for k in numbers]
    whole = list(numbers) == list(range(1, len(names) + 1))
    if len(names) > 1 and whole:
        return f"{names[0]} to {names[-1]}"
    return ", ".join(names) or "another name"


def read_sids(
    scene: SceneFile, folder: Path, sids: Mapping[str, SID]
) -> dict[str, SID]:
    """The SIDs of all bodies that have one, by name; given ones replace files.

    Raises
    ------
    InputError : a SID cannot be read.
    """
    found = {}
    for name, body in scene.sid_bodies.items():
        if name not in sids and not body.sid:
            raise InputError(
                f"{body.model} is a model that has to be converted first",
                place=f"bodies.{name}.model",
                expected="a command of sidtool, which converts it, or a SID",
            )
        found[name] = sids[name] if name in sids else read_sid(folder / body.sid)
    return found


def body_data(name: str, body: Body, sids: Mapping[str, SID], planar: bool) -> BodyData:
    """The data of one body of a scene; see `read_sids`.

    Raises
    ------
    InputError : its SID lacks a node that a marker names.
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
    kept = kept_indices(body.shape_functions, sid.nq, f"{place}.shape_functions")
    across: Array | None = None
    if body.rigid:
        sid, kept = rigid_part(sid), ()
    else:
        check_first_order(sid, body.sid, f"{place}.sid")
        sid = damped(sid, body.damping, name)
        if not body.geometric_stiffening:
            stiffening = f"{place}.geometric_stiffening"
            sid = without_stiffening(sid, planar, stiffening)
        sid = with_shape_functions(sid, kept)
        if planar:
            ids = map(str, body.markers.values())
            across = out_of_plane(sid, ids, body.frame == "held", f"{place}.sid")
            sid = unloaded_across(sid, across)
    sid = with_frame_node(sid) if body.frame == "held" else sid
    numbers = tuple(k + 1 for k in kept)
    return BodyData(
        name,
        sid,
        True,
        has_quadratic_inertia(body, sid, planar),
        nodes,
        numbers,
        given=given,
        across=across,
    )


def rigid_body(name: str, body: RigidBody, nodes: tuple[Node, ...]) -> BodyData:
    """The data of a rigid body; see `rigid_nodes`."""
    centre = as_3d(body.centre_of_mass)
    inertia = np.zeros((3, 3)) if body.inertia is None else _tensor(body.inertia)
    steiner = body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    sid = rigid_sid(body.mass, centre, inertia + steiner, nodes)
    rotates = body.inertia is not None or bool(centre.any())
    return BodyData(name, sid, rotates, False, {})


def rigid_nodes(markers: Mapping[str, Marker]) -> tuple[Node, ...]:
    """The origin of a rigid body or of the ground, and its markers, as nodes."""
    placed = (
        (n, position_3d(marker), rotation(marker)) for n, marker in markers.items()
    )
    return rigid_node("", np.zeros(3)), *(rigid_node(*marker) for marker in placed)


def _tensor(inertia: object) -> Array:
    """zz alone (planar), principal values, or a full tensor, as (3, 3)."""
    values = np.asarray(inertia, float)
    if values.ndim == 0:
        return np.diag([0.0, 0.0, float(values)])
    return np.diag(values) if values.ndim == 1 else values
