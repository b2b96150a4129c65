"""A body without its geometric stiffening, to see what that does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import SID, Node, Taylor
from sidtool.formats.stiffening import has_stiffening

#: A shape function stays in the plane when it leaves it by less than this part.
IN_PLANE = 1e-9
#: Oe's column that multiplies wz wz.
_ZZ = 2


def can_be_unstiffened(sid: SID, planar: bool) -> bool:
    """Whether the blocks tell what is left without geometric stiffening.

    The kinematic part of Oe m1 for wz wz is the mass of the shape functions in the
    plane, -Me. Out of plane it is another mixture, which the other blocks do not tell.
    """
    phi, _ = sid.shapes
    out, largest = np.abs(phi[:, 2]).max(initial=0.0), np.abs(phi).max(initial=0.0)
    return planar and bool(out <= IN_PLANE * largest)


def without_stiffening(sid: SID, planar: bool, place: str) -> SID:
    """The SID without Ct m1, phi m1, psi m1 and what of Cr m1, Oe m1 goes with them.

    Oe m1 of wz wz is then -Me, with the rotary inertia that Me holds; its other
    columns, which no motion in the plane multiplies, are zero.

    Raises
    ------
    InputError : the blocks do not tell what is left, see `can_be_unstiffened`.
    """
    if not has_stiffening(sid):
        return sid
    if not can_be_unstiffened(sid, planar):
        raise InputError(
            "what Oe m1 would be without geometric stiffening cannot be told from the "
            "blocks of a body that leaves the plane",
            place=place,
            expected="true, or a SID that was converted without [stiffening]",
        )
    nq = sid.nq
    turning = sid.Cr.first_order(nq)
    centrifugal = np.zeros((nq, nq, 6))
    centrifugal[:, :, _ZZ] = -0.5 * (sid.Me.m0 + sid.Me.m0.T)
    return replace(
        sid,
        Ct=Taylor(sid.Ct.m0),
        Cr=Taylor(sid.Cr.m0, 0.5 * (turning - np.swapaxes(turning, 0, 1))),
        Oe=Taylor(sid.Oe.m0, centrifugal),
        nodes=tuple(map(_plain, sid.nodes)),
    )


def _plain(node: Node) -> Node:
    return replace(node, phi=Taylor(node.phi.m0), psi=Taylor(node.psi.m0))
