"""Natural modes of a SID as a person would call them, and the kind of its frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.dead_nodes import motion_scale
from sidtool.formats.sid import SID
from sidtool.formats.sid_mass import central_inertia

from ..validate.frequencies import held_modes, hertz

Array = NDArray[np.float64]
AXES = "xyz"
#: A mode moves along one axis if nothing else reaches this share of the motion.
_DOMINANT = 0.5
#: A body is slender if its smallest central inertia is below this share of the largest.
_SLENDER = 0.3
#: Part of the body's length over which a node's rotation counts as displacement.
_SLOPE = 0.1
#: Relative size below which shape functions and couplings count as zero.
_NOTHING = 1e-9


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
    long_axis = _long_axis(sid)
    boundary = boundary_of(sid)
    shares = _compliance_shares(sid, squares, shapes)
    modes = []
    for square, shape, share in zip(squares, shapes.T, shares, strict=True):
        modal_mass = float(shape @ sid.Me.m0 @ shape)
        coupling = shape @ sid.Ct.m0
        modes.append(
            Mode(
                frequency=float(hertz(np.array([square]))[0]),
                kind=_kind(sid, shape, long_axis),
                effective_mass=coupling**2 / modal_mass if modal_mass else coupling * 0,
                boundary=boundary,
                contribution=float(share),
                label=_label(sid, shape),
            )
        )
    return tuple(modes)


def kinds_of(sid: SID) -> tuple[str, ...]:
    """What each elastic coordinate alone is: "bending y", "torsion", ..."""
    long_axis = _long_axis(sid)
    return tuple(_kind(sid, shape, long_axis) for shape in np.eye(sid.nq))


def frame_of(sid: SID) -> str:
    """The kind of body frame, judged by the couplings and the nodes."""
    if sid.nq == 0:
        return "rigid body"
    kind, nodes = _frame_kind(sid)
    return {
        "free": "mean axes (Buckens): no coupling to the rigid motion",
        "held": f"tangent frame, fixed to node {nodes} at its origin",
        "held away": f"fixed to node {nodes}, away from its origin",
        "chord": f"chord frame between nodes {nodes}",
        "other": "another frame: coupled, and no node rests in it",
    }[kind]


def boundary_of(sid: SID) -> str:
    """How the natural modes of (Ke, Me) are held: "held", "chord", "free", "other"."""
    return _frame_kind(sid)[0].split()[0]


def _frame_kind(sid: SID) -> tuple[str, str]:
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
    return bool(np.abs(node.psi.m0).max(initial=0.0) <= _NOTHING * scale)


def _end_of_chord(sid: SID, start: Any) -> str | None:
    """The node whose direction from the start stays the same."""
    for node in sid.nodes:
        chord = node.position - start.position
        length = np.linalg.norm(chord)
        if length == 0:
            continue
        across = np.cross(chord / length, node.phi.m0.T)
        if np.abs(across).max() <= _NOTHING * motion_scale(sid):
            return str(node.id)
    return None


def _compliance_shares(sid: SID, squares: Array, shapes: Array) -> Array:
    """(nq,) sum over nodes of phi^2 / w^2, as shares of the total.

    Rotations count by the displacement they make over a part of the body's length.
    """
    arm = _SLOPE * _length(sid)
    phi, psi = sid.shapes
    motion = ((phi @ shapes) ** 2).sum(axis=(0, 1))
    motion = motion + ((arm * psi @ shapes) ** 2).sum(axis=(0, 1))
    soft = motion / np.where(squares > 0, squares, np.inf)
    total = soft.sum()
    return soft / total if total else soft


def at_rest(node: Any, sid: SID) -> bool:
    """Does no shape function displace a node?"""
    return bool(np.abs(node.phi.m0).max(initial=0.0) <= _NOTHING * motion_scale(sid))


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


def _long_axis(sid: SID) -> int | None:
    """The axis of a slender body, by the spread of its mass, or else of its nodes."""
    spread = _second_moments(sid)
    if spread is None and sid.nodes:
        spread = np.ptp([node.position for node in sid.nodes], axis=0) ** 2
    if spread is None:
        return None
    order = np.argsort(spread)
    return int(order[2]) if spread[order[1]] < _SLENDER * spread[order[2]] else None


def _second_moments(sid: SID) -> Array | None:
    """Central integrals of x^2, y^2, z^2 dm; None where the inertia is planar."""
    if sid.mass <= 0:
        return None
    moments = np.diag(_spread(sid))
    return moments if (moments >= -1e-6 * np.abs(moments).max()).all() else None


def _spread(sid: SID) -> Array:
    """(3, 3) central integral of c c^T dm."""
    inertia = central_inertia(sid)
    return np.asarray(np.trace(inertia) / 2 * np.eye(3) - inertia)


def _kind(sid: SID, shape: Array, long_axis: int | None) -> str:
    """By the largest displacement at the nodes, or by the effective mass without.

    Torsion is what turns the nodes about the long axis by more than it moves them.
    """
    motion = _motion_by_axis(sid, shape) + _slopes_by_axis(sid, shape, long_axis)
    if (
        long_axis is not None
        and _twist(sid, shape, long_axis) > _DOMINANT * motion.sum()
    ):
        return f"torsion {AXES[long_axis]}"
    rotation = np.abs(sid.shapes[1] @ shape).max(initial=0.0)
    if not motion.any():
        return "torsion" if rotation else "not seen at the nodes"
    axis = int(motion.argmax())
    name = AXES[axis]
    if motion[axis] < _DOMINANT * motion.sum():
        return "mixed " + "".join(AXES[a] for a in np.flatnonzero(motion > 0))
    if long_axis is None:
        return f"mainly {name}"
    return f"axial {name}" if axis == long_axis else f"bending {name}"


def _twist(sid: SID, shape: Array, long_axis: int) -> float:
    """Square of the motion at the radius of gyration about the long direction."""
    if _second_moments(sid) is None:
        return 0.0
    along = _direction(sid, long_axis)
    about = float(along @ central_inertia(sid) @ along)
    turns = sid.shapes[1] @ shape @ along
    return float(np.square(turns).sum() * about / sid.mass)


def _direction(sid: SID, long_axis: int) -> Array:
    """(3,) the direction in which a slender body is long."""
    if _second_moments(sid) is None:
        return np.eye(3)[long_axis]
    return np.asarray(np.linalg.eigh(_spread(sid))[1][:, 2])


def _coupling(sid: SID, shape: Array) -> Array:
    """(3,) momentum per velocity of a shape; zero where it is rounding."""
    found = shape @ sid.Ct.m0
    largest = np.sqrt(abs(sid.mass * (shape @ sid.Me.m0 @ shape)))
    return np.where(np.abs(found) > _NOTHING * largest, found, 0.0)


def _length(sid: SID) -> float:
    places = np.array([node.position for node in sid.nodes]).reshape(-1, 3)
    return float(np.ptp(places, axis=0).max()) if len(places) else 0.0


def _slopes_by_axis(sid: SID, shape: Array, long_axis: int | None) -> Array:
    """(3,) squares of the bending that node rotations tell where no node moves."""
    if long_axis is None:
        return np.zeros(3)
    length, along = _length(sid), _direction(sid, long_axis)
    sideways = np.cross(sid.shapes[1] @ shape, along)
    return np.asarray(((_SLOPE * length * sideways) ** 2).sum(axis=0))


def _motion_by_axis(sid: SID, shape: Array) -> Array:
    """(3,) squares of displacements, summed over the nodes; of Ct where they rest."""
    at_nodes = ((sid.shapes[0] @ shape) ** 2).sum(axis=0)
    seen = at_nodes.max() > (_NOTHING * motion_scale(sid) * np.abs(shape).max()) ** 2
    motion = at_nodes if seen else _coupling(sid, shape) ** 2
    return np.where(motion > _NOTHING * motion.max(), motion, 0.0)
