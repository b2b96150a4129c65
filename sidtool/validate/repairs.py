"""Repair of the blocks that other blocks imply, with a list of every number changed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formats.sid import SID, Array, Taylor, axis_major
from formats.sid_mass import skew

from .magnitudes import refuse_absurd
from .measures import largest, modes_of, swapped

# Entries that agree to the 12 digits of a file, their own and those of what they follow
# from, stay as they are.
_SAME = 2e-11


@dataclass(frozen=True)
class Change:
    """One number that the repair replaced.

    Attributes
    ----------
    block : name of the block
    entry : the entry as the (canonical) file names it, "m0(r,c)" or "m1(r,l,c)"
    before, after : its values
    reason : the identity that the new value follows from
    """

    block: str
    entry: str
    before: float
    after: float
    reason: str


def repair(sid: SID) -> tuple[SID, tuple[Change, ...]]:
    """Rebuild what follows from other blocks of the same SID.

    Gr_l = J1_l - (Cr0_l)~ (I6, I10); Ge_l = Cr1_l - Cr1_l^T (I7, I8); the first-order
    columns xy, yz, xz of Oe become the mean over their two mode indices (I11). All
    other blocks are taken as they are. A consistent SID comes back unchanged.

    Returns
    -------
    The repaired SID and every number that differs from before by more than the print
    of a file (2e-11 of the largest entry of the block and of those it follows from);
    other entries keep their value.

    Raises
    ------
    InputError : an entry is not a finite number below 1e100.
    """
    refuse_absurd(sid)
    if sid.nq == 0:
        return sid, ()
    modes = modes_of(sid)
    Gr = axis_major(modes.J1 - skew(sid.Cr.m0))
    Ge = axis_major(modes.Cr1 - swapped(modes.Cr1))
    Oe1 = modes.Oe1.copy()
    Oe1[..., 3:] = 0.5 * (Oe1 + swapped(Oe1))[..., 3:]
    sources = largest(modes.J1, sid.Cr.m0), largest(modes.Cr1), largest(modes.Oe1)
    new_gr, gr_changes = _replaced(
        "Gr", sid.Gr.m0, Gr, "Gr_l = J1_l - (Cr0_l)~", sources[0]
    )
    new_ge, ge_changes = _replaced(
        "Ge", sid.Ge.m0, Ge, "Ge_l = Cr1_l - Cr1_l^T", sources[1]
    )
    new_oe, oe_changes = _replaced(
        "Oe", modes.Oe1, Oe1, "Oe1 symmetric in the modes", sources[2]
    )
    changes = gr_changes + ge_changes + oe_changes
    if not changes:
        return sid, ()
    repaired = replace(
        sid,
        Gr=replace(sid.Gr, m0=new_gr),
        Ge=replace(sid.Ge, m0=new_ge),
        Oe=Taylor(sid.Oe.m0, new_oe, sid.Oe.mn, 1) if oe_changes else sid.Oe,
    )
    return repaired, changes


def _replaced(
    block: str, before: Array, after: Array, reason: str, sources: float
) -> tuple[Array, tuple[Change, ...]]:
    differs = np.abs(after - before) > _SAME * max(largest(before, after), sources)
    changes = tuple(
        Change(block, _entry(index), float(before[index]), float(after[index]), reason)
        for index in map(tuple, np.argwhere(differs))
    )
    return np.where(differs, after, before), changes


def _entry(index: tuple[int, ...]) -> str:
    """(row, column) or (mode, row, column) from 0, in the notation of the file."""
    if len(index) == 2:
        return f"m0({index[0] + 1},{index[1] + 1})"
    mode, row, column = index
    return f"m1({row + 1},{mode + 1},{column + 1})"
