"""SID of the same body and elastic coordinates in another body frame.

The new frame moves relative to the old one by the small rigid motion
xi_l(c) = t_l + theta_l x c per elastic coordinate, so that the shape functions become
phi_l - xi_l. A body with geometric stiffening has a displacement field of second order;
there the motion is the screw exp(sum_l xi_l q_l), whose inverse is that of -xi:

    Phi1'_kl = Phi1_kl - theta_k x phi_l - theta_l x phi_k
               + (theta_k x xi_l + theta_l x xi_k) / 2

Every block is changed by what these fields change in its integral (theory, section 4),
so that going there and back is the identity. Ke and De belong to the elastic
coordinates, which are the same in every frame, so they do not change, even if De was
computed as alpha Me + beta Ke with the old Me.

Source: R. Schwertassek, O. Wallrapp, A. Shabana, "Flexible multibody simulation and
choice of shape functions", Nonlinear Dynamics 20, 1999.

Blocks that are the same integral stay equal through a change of frame: the change takes
differences of large numbers, and the rounding of an identity in a file (1e-12 of the
old blocks) may be 1e-9 of the new ones. Where the old blocks agree to their printed
digits, the new ones are equalised.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    J_INDICES,
    SID,
    Array,
    ComplianceShares,
    Node,
    Taylor,
    axis_major,
    by_mode,
    symmetric_3x3,
)
from sidtool.formats.geometric_stiffening import has_second_order_field
from sidtool.formats.sid_mass import (
    CENTRIFUGAL_PRODUCTS,
    centre_of_mass,
    coupled_mass_matrix,
    mean_axes_motion,
    skew,
)

from ..mesh.quadratic_fields import LEVI_CIVITA
from ..validate import check

#: Replacement of "Hz" in labels with a frequency of another frame.
_FORMER_HERTZ = "hertz in another frame"

#: Blocks agree that differ by no more than this share of the largest entry.
_EQUALITY_TOLERANCE = 1e-10
#: Displacements below this share of the largest are rounding.
_NO_MOTION = 1e-9


def relabel_frequencies(sid: SID) -> SID:
    """The SID with "Hz" in its labels only if the frequencies are those of the body."""
    restored = replace(
        sid, labels=tuple(s.replace(_FORMER_HERTZ, "Hz") for s in sid.labels)
    )
    if not any(found.id == "I15" and found.failed for found in check(restored)):
        return restored
    labels = tuple(re.sub(r"\bHz\b", _FORMER_HERTZ, label) for label in restored.labels)
    return replace(restored, labels=labels)


def equalise_blocks(new: SID, old: SID) -> SID:
    """`new`, whose mdCM m1, Oe m0, Gr and Ge follow Ct, J m1 and Cr m1 as in `old`."""
    if new.nq == 0:
        return new
    changed: dict[str, Any] = {}
    if _are_equal(_static_blocks(old), old.Ct.m0):
        changed["mdCM"] = replace(
            new.mdCM, m1=_first_order_moment(new.mdCM.m1, new.Ct.m0)
        )
    if _are_equal(old.Oe.m0, centrifugal(old.J, old.nq)):
        changed["Oe"] = replace(new.Oe, m0=centrifugal(new.J, new.nq))
    if _are_equal(*_gyroscopic_pair(old)):
        Gr = by_mode(new.Gr.m0, new.nq)
        rate = symmetric_3x3(new.J.first_order(new.nq)[:, :, 0])
        turned = rate + (Gr - np.swapaxes(Gr, 1, 2)) / 2
        changed["Gr"] = replace(new.Gr, m0=axis_major(turned))
    if _are_equal(by_mode(old.Ge.m0, old.nq), _coriolis_pair(old)):
        changed["Ge"] = replace(new.Ge, m0=axis_major(_coriolis_pair(new)))
    return replace(new, **changed)


def _are_equal(one: Array, other: Array) -> bool:
    size = max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0))
    return bool(np.abs(one - other).max(initial=0.0) <= _EQUALITY_TOLERANCE * size)


def _static_blocks(sid: SID) -> Array:
    return sid.mdCM.first_order(sid.nq)[:, :, 0]


def _first_order_moment(m1: Array | None, coupling: Array) -> Array | None:
    return None if m1 is None and not coupling.any() else coupling[:, :, None]


def centrifugal(J: Taylor, nq: int) -> Array:
    """Oe m0 = -(J1xx/2, J1yy/2, J1zz/2, J1xy, J1yz, J1xz)."""
    six = J.first_order(nq)[:, :, 0]
    return -six[:, [0, 1, 2, 3, 5, 4]] * [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]


def _gyroscopic_pair(sid: SID) -> tuple[Array, Array]:
    """Both sides of Gr_l + Gr_l^T = 2 J1_l."""
    Gr = by_mode(sid.Gr.m0, sid.nq)
    rate = symmetric_3x3(sid.J.first_order(sid.nq)[:, :, 0])
    return Gr + np.swapaxes(Gr, 1, 2), 2.0 * rate


def _coriolis_pair(sid: SID) -> Array:
    """Ge_l = Cr1_l - Cr1_l^T."""
    first = sid.Cr.first_order(sid.nq)
    return first - np.swapaxes(first, 0, 1)


_RIGID = slice(0, 6)


@dataclass(frozen=True, eq=False)
class FrameChange:
    """Position and motion of a new frame in the old one.

    Attributes
    ----------
    origin : (3,) its origin in the undeformed body, old frame [m]
    shift : (nq, 3) t_l, motion of the point that is the old origin [m/[q]]
    turn : (nq, 3) theta_l [rad/[q]]
    """

    origin: Array
    shift: Array
    turn: Array

    def padded(self, nq: int) -> FrameChange:
        """Extend the change by zero rows for further shape functions, which keep their
        values.
        """
        rows = ((0, nq - len(self.turn)), (0, 0))
        shift, turn = np.pad(self.shift, rows), np.pad(self.turn, rows)
        return FrameChange(self.origin, shift, turn)

    def at(self, position: Array) -> Array:
        """(nq, 3) the rigid motion at a point."""
        return self.shift + np.cross(self.turn, position)


def change_frame(sid: SID, frame: str) -> SID:
    """Return a SID in another frame.

    Parameters
    ----------
    frame : "tangent:NODE", "chord:NODE,NODE", "buckens" or "buckens:NODE"

    Raises
    ------
    InputError : the frame is unknown, a node is missing or has no rotation.
    """
    return apply_frame_change(sid, frame_change(sid, frame))


def frame_change(sid: SID, frame: str) -> FrameChange:
    """Return the motion of a frame that is given as text; see `change_frame`."""
    kind, _, text = frame.partition(":")
    names = [name.strip() for name in text.split(",") if name.strip()]
    counts = {"tangent": (1,), "chord": (2,), "buckens": (0, 1)}
    if len(names) not in counts.get(kind, ()):
        raise InputError(
            f"found {frame!r}",
            place="frame",
            expected="tangent:NODE, chord:NODE,NODE, buckens or buckens:NODE",
        )
    nodes = [sid.node(name) for name in names]
    if sid.nq == 0:
        origin = nodes[0].position if nodes else centre_of_mass(sid)
        return FrameChange(origin, np.zeros((0, 3)), np.zeros((0, 3)))
    if kind == "tangent":
        return _tangent_change(sid, nodes[0])
    if kind == "chord":
        return _chord_change(nodes[0], nodes[1])
    return _buckens_change(sid, nodes[0] if nodes else None)


def _tangent_change(sid: SID, node: Node) -> FrameChange:
    most = max(np.abs(other.phi.m0).max() for other in sid.nodes)
    moves = np.abs(node.phi.m0).max() > _NO_MOTION * most
    if moves and not node.psi.m0.any():
        raise _no_rotation(node)
    turn = node.psi.m0.T
    shift = node.phi.m0.T - np.cross(turn, node.position)
    return FrameChange(node.position, shift, turn)


def _chord_change(first: Node, second: Node) -> FrameChange:
    chord = second.position - first.position
    length = np.linalg.norm(chord)
    if length == 0:
        raise InputError(
            f"nodes {first.id} and {second.id} are at the same place",
            place="frame",
            expected="two nodes at a distance",
        )
    along = chord / length
    gap = (second.phi.m0 - first.phi.m0).T
    twist = first.psi.m0.T @ along
    turn = np.cross(along, gap) / length + np.outer(twist, along)
    shift = first.phi.m0.T - np.cross(turn, first.position)
    return FrameChange(first.position, shift, turn)


def _buckens_change(sid: SID, node: Node | None) -> FrameChange:
    motion = mean_axes_motion(sid).T
    origin = centre_of_mass(sid) if node is None else node.position
    return FrameChange(origin, motion[:, :3], motion[:, 3:])


def _no_rotation(node: Node) -> InputError:
    return InputError(
        f"node {node.id} moves but has no rotation",
        place="frame",
        expected="a node with psi, whose turning the frame can follow",
    )


def apply_frame_change(sid: SID, change: FrameChange) -> SID:
    """A SID in the frame that a change describes; all blocks consistent."""
    second = has_second_order_field(sid)
    sections = tuple(
        replace(
            section,
            part=_changed(section.part, change.padded(section.part.nq), second),
        )
        for section in sid.sections
    )
    moved = _changed(sid, change, second)
    moved = replace(moved, carried=_remaining_compliance(sid), sections=sections)
    return relabel_frequencies(moved)


def _changed(sid: SID, change: FrameChange, second: bool) -> SID:
    """Nodes and blocks in another frame, of a body or of its part beyond a section."""
    old = _MassIntegrals.of(sid)
    d_phi, d_phi_c, d_pairs, d_second = _integral_differences(sid, old, change, second)
    d_rigid = _rigid_differences(sid, old, change)
    blocks = _changed_blocks(sid, d_phi, d_phi_c, d_pairs, d_second, d_rigid)
    blocks["Me"] = _add_terms(sid.Me, _modal_mass_difference(sid, change))
    nodes = tuple(_changed_node(node, change, second) for node in sid.nodes)
    return equalise_blocks(replace(sid, nodes=nodes, **blocks), sid)


def _remaining_compliance(sid: SID) -> ComplianceShares | None:
    """Displacements of a held body are those from its frame, and no longer known."""
    return sid.carried if sid.carried is not None and sid.carried.free else None


@dataclass(frozen=True, eq=False)
class _MassIntegrals:
    """int dm: c (3,), c c^T (3, 3), phi (nq, 3), phi c^T (nq, 3, 3)."""

    c: Array
    cc: Array
    phi: Array
    phi_c: Array

    @classmethod
    def of(cls, sid: SID) -> _MassIntegrals:
        inertia = symmetric_3x3(sid.J.m0[:, 0])
        rate = symmetric_3x3(sid.J.first_order(sid.nq)[:, :, 0])
        c4 = -0.5 * (rate - skew(sid.Cr.m0))
        trace = np.einsum("laa->l", c4)[:, None, None]
        return cls(
            c=sid.mdCM.m0[:, 0],
            cc=np.trace(inertia) / 2 * np.eye(3) - inertia,
            phi=sid.Ct.m0,
            phi_c=c4 - trace / 2 * np.eye(3),
        )


def _integral_differences(
    sid: SID, old: _MassIntegrals, change: FrameChange, second: bool
) -> tuple[Array, Array, Array, tuple[Array, Array]]:
    """Return the changes of int phi, phi c^T, phi_i phi_l^T, and Phi1, Phi1 c^T."""
    t, turn, c0 = change.shift, skew(change.turn), change.origin
    xi = sid.mass * t + turn @ old.c
    xi_c = np.einsum("la,b->lab", t, old.c) + turn @ old.cc
    phi_xi = np.einsum("ia,lb->ilab", old.phi, t) + np.einsum(
        "iac,lbc->ilab", old.phi_c, turn
    )
    xi_xi = np.einsum("ia,lb->ilab", xi, t) + np.einsum("iac,lbc->ilab", xi_c, turn)
    xi_phi = np.swapaxes(np.swapaxes(phi_xi, 0, 1), 2, 3)
    d_pairs = xi_xi - phi_xi - xi_phi
    new_phi = old.phi - xi
    d_phi_c = -xi_c - np.einsum("la,b->lab", new_phi, c0)
    nq = sid.nq
    d_one, d_one_c = np.zeros((nq, nq, 3)), np.zeros((nq, nq, 3, 3))
    if second:
        xi_moved = xi_c - np.einsum("la,b->lab", xi, c0)
        phi_moved = old.phi_c - np.einsum("la,b->lab", old.phi, c0)
        half, half_c = xi / 2 - old.phi, xi_moved / 2 - phi_moved
        d_one = np.einsum("kab,lb->kla", turn, half)
        d_one = d_one + np.swapaxes(d_one, 0, 1)
        d_one_c = np.einsum("kab,lbc->klac", turn, half_c)
        d_one_c = d_one_c + np.swapaxes(d_one_c, 0, 1)
        first = sid.Ct.first_order(nq)
        d_one_c = d_one_c - np.einsum("kla,b->klab", first, c0)
    return -xi, d_phi_c, d_pairs, (d_one, d_one_c)


def _rigid_differences(
    sid: SID, old: _MassIntegrals, change: FrameChange
) -> tuple[Array, Array]:
    """Return the changes of int c dm and int c c^T dm."""
    c0 = change.origin
    mixed = np.outer(old.c, c0)
    return -sid.mass * c0, sid.mass * np.outer(c0, c0) - mixed - mixed.T


def _changed_blocks(
    sid: SID,
    d_phi: Array,
    d_phi_c: Array,
    d_pairs: Array,
    d_second: tuple[Array, Array],
    d_rigid: tuple[Array, Array],
) -> dict[str, Any]:
    """The blocks of theory, section 4, each with the difference in its integral."""
    d_c, d_cc = d_rigid
    d_one, d_one_c = d_second
    d_c4 = d_phi_c - np.einsum("lcc,ab->lab", d_phi_c, np.eye(3))
    cross = np.einsum("abc,lbic->lia", LEVI_CIVITA, np.moveaxis(d_pairs, 2, 1))
    arm = np.einsum("abc,licb->lia", LEVI_CIVITA, d_one_c)
    d_j = np.trace(d_cc) * np.eye(3) - d_cc
    d_j1 = -(d_c4 + np.swapaxes(d_c4, 1, 2))
    first_gr = None
    if sid.Gr.m1 is not None:
        trace = np.einsum("klaa->kl", d_pairs)[..., None, None] * np.eye(3)
        products = -2 * (np.swapaxes(d_pairs, 2, 3) - trace)
        first_gr = np.stack([axis_major(part) for part in products])
    return {
        "mdCM": _add_terms(sid.mdCM, d_c[:, None], d_phi[:, :, None]),
        "J": _add_terms(
            sid.J, _six_of_tensors(d_j)[:, None], _six_of_tensors(d_j1)[..., None]
        ),
        "Ct": _add_terms(sid.Ct, d_phi, d_one if d_one.any() else None),
        "Cr": _add_terms(
            sid.Cr, np.einsum("abc,lcb->la", LEVI_CIVITA, d_phi_c), cross + arm
        ),
        "Gr": _add_terms(sid.Gr, axis_major(-2 * d_c4), first_gr),
        "Ge": _add_terms(sid.Ge, axis_major(2 * cross)),
        "Oe": _add_terms(
            sid.Oe,
            np.einsum("kab,iab->ik", CENTRIFUGAL_PRODUCTS, d_phi_c),
            np.einsum("kab,liab->lik", CENTRIFUGAL_PRODUCTS, d_pairs + d_one_c),
        ),
    }


def _modal_mass_difference(sid: SID, change: FrameChange) -> Array:
    """-X R - R^T X^T + R^T M R with couplings X and rigid mass matrix M."""
    mass = coupled_mass_matrix(sid)
    motion = np.hstack([change.shift, change.turn])
    shared = mass[6:, _RIGID] @ motion.T
    rigid_mass = motion @ mass[_RIGID, _RIGID] @ motion.T
    return (rigid_mass + rigid_mass.T) / 2 - (shared + shared.T)


def _changed_node(node: Node, change: FrameChange, second: bool) -> Node:
    xi, nq = change.at(node.position), len(change.turn)
    phi, psi, turn = node.phi.m0.T, node.psi.m0.T, change.turn
    more_phi = more_psi = None
    if second:
        arm = np.einsum("kab,lb->kla", skew(turn), xi / 2 - phi)
        more_phi = np.swapaxes(arm + np.swapaxes(arm, 0, 1), 1, 2)
        cross = np.einsum("kab,lb->kla", skew(turn), -psi) / 2
        more_psi = np.swapaxes(cross + np.swapaxes(cross, 0, 1), 1, 2)
    frame = node.AP.m0
    return replace(
        node,
        origin=_add_terms(node.origin, -change.origin[:, None], -xi[:, :, None]),
        phi=_add_terms(node.phi, -xi.T, more_phi),
        psi=_add_terms(node.psi, -turn.T, more_psi),
        AP=_add_terms(node.AP, np.zeros((3, 3)), -skew(turn).reshape(nq, 3, 3) @ frame),
    )


def _add_terms(block: Taylor, m0: Array, m1: Array | None = None) -> Taylor:
    if m1 is None:
        return replace(block, m0=block.m0 + m0)
    first = block.first_order(len(m1)) + m1
    return replace(block, m0=block.m0 + m0, m1=first)


def _six_of_tensors(tensors: Array) -> Array:
    return np.stack([tensors[..., a, b] for a, b in J_INDICES], axis=-1)
