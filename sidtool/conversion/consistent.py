"""Blocks that are the same integral stay the same number through a change of frame.

A change of frame takes large numbers from large numbers, and what the print of a file
left of an identity (1e-12 of the old blocks) may be 1e-9 of the new ones. Where the
old blocks agree to their print, the new ones are made to agree.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.sid import SID, Array, Taylor, axis_major, by_mode, symmetric_3x3

#: Blocks agree that differ by no more than this share of the largest entry.
_SAME = 1e-10


def kept_consistent(new: SID, old: SID) -> SID:
    """`new`, whose mdCM m1, Oe m0, Gr and Ge follow Ct, J m1 and Cr m1 as in `old`."""
    if new.nq == 0:
        return new
    changed: dict[str, Any] = {}
    if _agree(_static(old), old.Ct.m0):
        changed["mdCM"] = replace(new.mdCM, m1=_first(new.mdCM.m1, new.Ct.m0))
    if _agree(old.Oe.m0, centrifugal(old.J, old.nq)):
        changed["Oe"] = replace(new.Oe, m0=centrifugal(new.J, new.nq))
    if _agree(*_gyroscopic(old)):
        Gr = by_mode(new.Gr.m0, new.nq)
        rate = symmetric_3x3(new.J.first_order(new.nq)[:, :, 0])
        turned = rate + (Gr - np.swapaxes(Gr, 1, 2)) / 2
        changed["Gr"] = replace(new.Gr, m0=axis_major(turned))
    if _agree(by_mode(old.Ge.m0, old.nq), _coriolis(old)):
        changed["Ge"] = replace(new.Ge, m0=axis_major(_coriolis(new)))
    return replace(new, **changed)


def _agree(one: Array, other: Array) -> bool:
    size = max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0))
    return bool(np.abs(one - other).max(initial=0.0) <= _SAME * size)


def _static(sid: SID) -> Array:
    return sid.mdCM.first_order(sid.nq)[:, :, 0]


def _first(m1: Array | None, coupling: Array) -> Array | None:
    return None if m1 is None and not coupling.any() else coupling[:, :, None]


def centrifugal(J: Taylor, nq: int) -> Array:
    """Oe m0 = -(J1xx/2, J1yy/2, J1zz/2, J1xy, J1yz, J1xz)."""
    six = J.first_order(nq)[:, :, 0]
    return -six[:, [0, 1, 2, 3, 5, 4]] * [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]


def _gyroscopic(sid: SID) -> tuple[Array, Array]:
    """Both sides of Gr_l + Gr_l^T = 2 J1_l."""
    Gr = by_mode(sid.Gr.m0, sid.nq)
    rate = symmetric_3x3(sid.J.first_order(sid.nq)[:, :, 0])
    return Gr + np.swapaxes(Gr, 1, 2), 2.0 * rate


def _coriolis(sid: SID) -> Array:
    """Ge_l = Cr1_l - Cr1_l^T."""
    first = sid.Cr.first_order(sid.nq)
    return first - np.swapaxes(first, 0, 1)
