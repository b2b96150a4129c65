"""First-order terms of a SID as arrays, and what stiffened bodies have of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.sid import SID, Array, Taylor
from sidtool.formats.storage.kept import kept

#: A symmetric part of Cr m1 below this part of it, or of Me, which bounds it where
#: nothing stiffens (Cauchy and Schwarz), is rounding in a file.
FIRST_ORDER = 1e-9


def cr1(sid: SID) -> Array:
    """First-order term of Cr as (axis, k, l)."""
    return sid.Cr.first_order(sid.nq).transpose(2, 1, 0)


def ge(sid: SID) -> Array:
    """Ge as (axis, k, l), rebuilt as Cr1 - Cr1^T, the exact theory (I8)."""
    kinematic = cr1(sid)
    return kinematic - kinematic.transpose(0, 2, 1)


def oe1(sid: SID) -> Array:
    """First-order term of Oe as (column, k, l), symmetric in k and l (I11)."""
    term = sid.Oe.first_order(sid.nq).transpose(2, 1, 0)
    return 0.5 * (term + term.transpose(0, 2, 1))


def ct1(sid: SID) -> Array:
    """First-order term of Ct as (axis, k, l): geometric stiffening.

    Symmetric in k and l, as Ct(q) is the derivative of mdCM(q).
    """
    term = sid.Ct.first_order(sid.nq).transpose(2, 1, 0)
    return 0.5 * (term + term.transpose(0, 2, 1))


@kept
def has_second_order(sid: SID) -> bool:
    """Do Ct and Cr have terms of a displacement field of second order?

    Those are Ct m1 and the part of Cr m1 that is symmetric in the coordinates.
    """
    if sid.nq == 0:
        return False
    turning = cr1(sid)
    bent = np.abs(turning + turning.transpose(0, 2, 1)).max(initial=0.0)
    size = max(np.abs(turning).max(initial=0.0), np.abs(sid.Me.m0).max())
    return bool(ct1(sid).any() or bent > FIRST_ORDER * size)


def without_turning(sid: SID) -> SID:
    """A stiffened body without J, Cr and Oe, whose place the mean axes take."""
    if not has_second_order(sid):
        return sid
    J, Cr, Oe = (Taylor(np.zeros_like(b.m0)) for b in (sid.J, sid.Cr, sid.Oe))
    return replace(sid, J=J, Cr=Cr, Oe=Oe)
