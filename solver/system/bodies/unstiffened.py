"""A body without its geometric stiffening, to see what that does."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import OE_INDICES, SID, Array, Node, Taylor
from sidtool.formats.stiffening import has_stiffening

#: A shape function does not move along an axis when it does by less than this part.
STILL = 1e-9
#: Oe's column that multiplies wz wz.
_ZZ = 2


def can_be_unstiffened(sid: SID, planar: bool) -> bool:
    """Whether the blocks tell what is left without geometric stiffening.

    The kinematic part of Oe m1 is made of the integrals of phi_a phi_b. In the plane
    that for wz wz is -Me. In space Me and Cr m1 tell them all where each shape function
    moves every node along one axis, as in a beam that bends in its principal planes;
    else they are another mixture.
    """
    if planar:
        phi, _ = sid.shapes
        out, largest = np.abs(phi[:, 2]).max(initial=0.0), np.abs(phi).max(initial=0.0)
        return bool(out <= STILL * largest)
    return _axes(sid) is not None


def without_stiffening(sid: SID, planar: bool, place: str) -> SID:
    """The SID without Ct m1, phi m1, psi m1 and what of Cr m1, Oe m1 goes with them.

    What is left of Oe m1 holds the rotary inertia that Me holds. In the plane only its
    column for wz wz counts, and the others are zero.

    Raises
    ------
    InputError : the blocks do not tell what is left, see `can_be_unstiffened`.
    """
    if not has_stiffening(sid):
        return sid
    if not can_be_unstiffened(sid, planar):
        raise InputError(
            "what Oe m1 would be without geometric stiffening cannot be told from the "
            "blocks of a body that leaves the plane, unless each of its shape "
            "functions moves along one axis alone",
            place=place,
            expected="true, or a SID that was converted without [stiffening]",
        )
    turning = sid.Cr.first_order(sid.nq)
    swept = 0.5 * (turning - np.swapaxes(turning, 0, 1))
    return replace(
        sid,
        Ct=Taylor(sid.Ct.m0),
        Cr=Taylor(sid.Cr.m0, swept),
        Oe=Taylor(sid.Oe.m0, _in_plane(sid) if planar else _in_space(sid, swept)),
        nodes=tuple(map(_plain, sid.nodes)),
    )


def _in_plane(sid: SID) -> Array:
    centrifugal = np.zeros((sid.nq, sid.nq, 6))
    centrifugal[:, :, _ZZ] = -0.5 * (sid.Me.m0 + sid.Me.m0.T)
    return centrifugal


def _in_space(sid: SID, swept: Array) -> Array:
    """Oe m1 as (nq, nq, 6): W_s[a, b] int phi_k phi_i, along the axes a and b.

    The integral is Me's where the axes are the same; else that of their cross product,
    phi_k x phi_i, tells it.
    """
    axes = _axes(sid)
    assert axes is not None
    me = 0.5 * (sid.Me.m0 + sid.Me.m0.T)
    columns = [frozenset(pair) for pair in OE_INDICES]
    found = np.zeros((sid.nq, sid.nq, 6))
    for (k, a), (i, b) in product(enumerate(axes), repeat=2):
        if a == b:
            found[k, i, :3] = -me[k, i]
            found[k, i, a] = 0.0
        else:
            sign = 1.0 if (b - a) % 3 == 1 else -1.0
            crossed = sign * swept[k, i, 3 - a - b]
            found[k, i, columns.index(frozenset((a, b)))] = crossed
    return found


def _axes(sid: SID) -> list[int] | None:
    """The axis 0 to 2 along which each shape function moves all nodes, if it does."""
    phi, _ = sid.shapes
    most = np.abs(phi).max(axis=0, initial=0.0)
    moving = most > STILL * most.max(axis=0, initial=0.0)
    if not (moving.sum(axis=0) == 1).all():
        return None
    axes = moving.argmax(axis=0)
    aside = np.abs(sid.Ct.m0) * ~moving.T
    if aside.max(initial=0.0) > STILL * np.abs(sid.Ct.m0).max(initial=0.0):
        return None
    return [int(axis) for axis in axes]


def _plain(node: Node) -> Node:
    return replace(node, phi=Taylor(node.phi.m0), psi=Taylor(node.psi.m0))
