"""Natural modes of a SID as a person would call them, and the kind of its frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.dead_nodes import motion_scale
from sidtool.formats.kinds_of_motion import (
    NOTHING,
    SLOPE,
    kind_of_shape,
    length_of,
    long_axis,
)
from sidtool.formats.sid import SID

from ..validate.frequencies import held_modes, hertz

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mode:
    """One natural mode of the body with its frame held.

    Attributes
    ----------
    frequency : [Hz]
    kind : "bending y", "axial x", "torsion x", ...
    effective_mass : (3,) effective modal mass along x, y, z [kg]
    boundary : how the body is held where the mode has this frequency: "held",
        "chord", "free" (mean axes), "other"
    contribution : share of the mode in the static compliance of all nodes
    label : of the elastic coordinate that the mode consists of, if of one
    """

    frequency: float
    kind: str
    effective_mass: Array
    boundary: str
    contribution: float
    label: str


def modes_of(sid: SID) -> tuple[Mode, ...]:
    """The natural modes of (Ke, Me), lowest first; empty for a rigid body.

    The effective mass of mode y is (Ct^T y)^2 / (y^T Me y), by axis.
    """
    if sid.nq == 0:
        return ()
    squares, shapes = _natural_modes(sid)
    axis = long_axis(sid)
    boundary = boundary_of(sid)
    shares = _compliance_shares(sid, squares, shapes)
    modes = []
    for square, shape, share in zip(squares, shapes.T, shares, strict=True):
        modal_mass = float(shape @ sid.Me.m0 @ shape)
        coupling = shape @ sid.Ct.m0
        modes.append(
            Mode(
                frequency=float(hertz(np.array([square]))[0]),
                kind=kind_of_shape(sid, shape, axis),
                effective_mass=coupling**2 / modal_mass if modal_mass else coupling * 0,
                boundary=boundary,
                contribution=float(share),
                label=_label(sid, shape),
            )
        )
    return tuple(modes)


def frame_of(sid: SID) -> str:
    """The kind of body frame, judged by the couplings and the nodes."""
    if sid.nq == 0:
        return "rigid body"
    kind, nodes = _framekind_of_shape(sid)
    return {
        "free": "mean axes (Buckens): no coupling to the rigid motion",
        "held": f"tangent frame, fixed to node {nodes} at its origin",
        "held away": f"fixed to node {nodes}, away from its origin",
        "chord": f"chord frame between nodes {nodes}",
        "other": "another frame: coupled, and no node rests in it",
    }[kind]


def boundary_of(sid: SID) -> str:
    """How the natural modes of (Ke, Me) are held: "held", "chord", "free", "other"."""
    return _framekind_of_shape(sid)[0].split()[0]


def _framekind_of_shape(sid: SID) -> tuple[str, str]:
    scale = np.sqrt(sid.mass * np.abs(np.diag(sid.Me.m0)).max()) or 1.0
    size = max((np.abs(node.position).max() for node in sid.nodes), default=0.0) or 1.0
    if (
        np.abs(sid.Ct.m0).max() <= 1e-6 * scale
        and np.abs(sid.Cr.m0).max() <= 1e-6 * scale * size
    ):
        return "free", ""
    still = [node for node in sid.nodes if at_rest(node, sid)]
    turning = [node for node in still if node.psi.m0.any() and not _unturned(node, sid)]
    held = [node for node in still if node not in turning]
    at_origin = [n for n in still if np.abs(n.position).max() <= 1e-9 * size]
    silent = not any(node.psi.m0.any() for node in sid.nodes)
    if at_origin and (at_origin[0] in turning or silent):
        end = _end_of_chord(sid, at_origin[0])
        if end is not None:
            return "chord", f"{at_origin[0].id} and {end}"
        if not silent:
            return "other", ""
    if at_origin:
        return "held", str(at_origin[0].id)
    if held:
        return "held away", str(held[0].id)
    return "other", ""


def _unturned(node: Any, sid: SID) -> bool:
    scale = sid.largest_shapes[1]
    return bool(np.abs(node.psi.m0).max(initial=0.0) <= NOTHING * scale)


def _end_of_chord(sid: SID, start: Any) -> str | None:
    """The node whose direction from the start stays the same."""
    for node in sid.nodes:
        chord = node.position - start.position
        length = np.linalg.norm(chord)
        if length == 0:
            continue
        across = np.cross(chord / length, node.phi.m0.T)
        if np.abs(across).max() <= NOTHING * motion_scale(sid):
            return str(node.id)
    return None


def _compliance_shares(sid: SID, squares: Array, shapes: Array) -> Array:
    """(nq,) sum over nodes of phi^2 / w^2, as shares of the total.

    Rotations count by the displacement they make over a part of the body's length.
    """
    arm = SLOPE * length_of(sid)
    phi, psi = sid.shapes
    motion = ((phi @ shapes) ** 2).sum(axis=(0, 1))
    motion = motion + ((arm * psi @ shapes) ** 2).sum(axis=(0, 1))
    soft = motion / np.where(squares > 0, squares, np.inf)
    total = soft.sum()
    return soft / total if total else soft


def at_rest(node: Any, sid: SID) -> bool:
    """Does no shape function displace a node?"""
    return bool(np.abs(node.phi.m0).max(initial=0.0) <= NOTHING * motion_scale(sid))


def _natural_modes(sid: SID) -> tuple[Array, Array]:
    """Modes in the columns; the coordinates themselves where Me is no mass matrix."""
    try:
        return held_modes(sid)
    except np.linalg.LinAlgError:
        masses = np.diag(sid.Me.m0)
        safe = np.where(masses > 0, masses, np.inf)
        return np.diag(sid.Ke.m0) / safe, np.eye(sid.nq)


def _label(sid: SID, shape: Array) -> str:
    leading = int(np.abs(shape).argmax())
    others = np.delete(np.abs(shape), leading)
    alone = others.max(initial=0.0) <= 1e-3 * abs(shape[leading])
    return sid.labels[leading].strip() if alone else ""
