"""Elastic coordinates that mean the same in two SIDs of one body."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sidtool.formats.scene import is_elastic
from sidtool.formats.scene import parse_output as parsed
from sidtool.formats.sid import SID

#: Frequencies of one shape function in two bases differ by less, and those of its
#: neighbours by more, relative.
SAME = 0.05


def differs(output: str, before: Mapping[str, SID], after: Mapping[str, SID]) -> bool:
    """Whether an output belongs to a shape function that another SID of its body does
    not have, or cannot be told from others there."""
    name = parsed(output)
    if name.marker or not is_elastic(name.quantity) or name.owner not in before:
        return False
    sids = before[name.owner], after[name.owner]
    number = int(name.quantity.lstrip("vq")) - 1
    return sids[0] is not sids[1] and not _is_in_both(number, *sids)


def _is_in_both(number: int, *sids: SID) -> bool:
    """Whether two bases have a shape function of about one frequency, and each of them
    no other one near it."""
    squares = [np.diag(sid.Ke.m0) / np.diag(sid.Me.m0) for sid in sids]
    if number >= min(map(len, squares)):
        return False
    own = squares[0][number]
    near = [np.abs(found - own) <= 2.0 * SAME * own for found in squares]
    return all(rows[number] and rows.sum() == 1 for rows in near)
