"""Which points and which motions two SIDs of one body have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from sidtool.formats.sid import SID, Array, Node
from sidtool.formats.sid_mass import (
    IN_PLANE,
    SPATIAL,
    central_inertia,
    centre_of_mass,
    free_motion,
    plane_of_motion,
)

from .measures import largest, rotation_scale, translation_scale

Frame = Literal["mean axis", "attached"]

# Points this close, relative to the size of the body, are the same point.
_SAME_POINT = 1e-6
# Momentum of a shape function below this share of the possible one counts as none.
_NO_MOMENTUM = 1e-6


@dataclass(frozen=True)
class Pairing:
    """Common ground of two SIDs whose axes are parallel.

    Attributes
    ----------
    nodes : pairs (node here, node in the reference) at the same material point
    offset : position of a point in the reference less its position here, (3,)
    rigid : rigid coordinates in which both can move freely; None if there are none
    held : do both describe the deformation in the same body frame?
    notes : what the comparison had to assume or leave out
    """

    nodes: tuple[tuple[Node, Node], ...]
    offset: Array
    rigid: tuple[int, ...] | None
    held: bool
    notes: tuple[str, ...]


def frame_kind(sid: SID) -> Frame:
    """Mean axis if no shape function carries momentum, else attached to a point."""
    if sid.nq == 0:
        return "mean axis"
    moving = largest(sid.Ct.m0) > _NO_MOMENTUM * translation_scale(sid)
    turning = largest(sid.Cr.m0) > _NO_MOMENTUM * rotation_scale(sid)
    return "attached" if moving or turning else "mean axis"


def body_size(sid: SID) -> float:
    """A length that tells how large the body is: extent of nodes and of the mass."""
    points = [node.position for node in sid.nodes]
    if sid.mass > 0.0:
        points.append(centre_of_mass(sid))
    extent = float(np.ptp(np.array(points), axis=0).max()) if points else 0.0
    return max(extent, _gyration(sid))


def pair(here: SID, reference: SID) -> Pairing:
    """Match nodes and motions of two SIDs.

    Nodes match by id if at least two ids are common and differ by one shift of the
    frame's origin; otherwise nodes at equal positions match, whatever their ids.
    """
    notes: list[str] = []
    nodes, offset = _common_nodes(here, reference)
    size = body_size(reference)
    shifted = bool(np.abs(offset).max() > _SAME_POINT * size)
    if shifted:
        text = ", ".join(f"{value:.6g}" for value in offset)
        notes.append(f"the origins of the two body frames differ by ({text})")
    if not nodes:
        notes.append("no common nodes: neither deflections nor shapes are compared")
    kinds = frame_kind(here), frame_kind(reference)
    held = kinds[0] == kinds[1] and (kinds[0] == "mean axis" or not shifted)
    if not held:
        notes.append(
            f"different body frames ({kinds[0]} here, {kinds[1]} in the reference): "
            "only the free body is compared; shape functions cut off count as error"
        )
    rigid = _common_motion(here, reference)
    if rigid is None and here.nq:
        notes.append("one of the bodies cannot move freely: only the held one counts")
    return Pairing(nodes, offset, rigid, held, tuple(notes))


def _gyration(sid: SID) -> float:
    if not sid.mass > 0.0:
        return 0.0
    return float(np.sqrt(largest(central_inertia(sid)) / sid.mass))


def _common_nodes(
    here: SID, reference: SID
) -> tuple[tuple[tuple[Node, Node], ...], Array]:
    near = 100.0 * _SAME_POINT * body_size(reference)
    by_id = {node.id: node for node in reference.nodes}
    named = [(node, by_id[node.id]) for node in here.nodes if node.id in by_id]
    if len(named) > 1:
        shifts = np.array([other.position - node.position for node, other in named])
        if np.ptp(shifts, axis=0).max() <= near:
            return tuple(named), shifts.mean(axis=0)
    return tuple(_by_position(here, reference, near)), np.zeros(3)


def _by_position(here: SID, reference: SID, near: float) -> list[tuple[Node, Node]]:
    if not here.nodes or not reference.nodes:
        return []
    points = KDTree([node.position for node in reference.nodes])
    distances, nearest = points.query([n.position for n in here.nodes], p=np.inf)
    return [
        (node, reference.nodes[int(i)])
        for node, i, distance in zip(here.nodes, nearest, distances, strict=True)
        if distance <= near
    ]


def _common_motion(here: SID, reference: SID) -> tuple[int, ...] | None:
    axes = {plane_of_motion(here), plane_of_motion(reference)}
    candidates: list[tuple[int, ...]] = [SPATIAL]
    if len(axes) == 1 and None not in axes:
        candidates.append(IN_PLANE[axes.pop() or 0])
    for rigid in candidates:
        if all(free_motion(sid, rigid).possible for sid in (here, reference)):
            return rigid
    return None
