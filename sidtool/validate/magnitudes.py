"""Numbers that no body has, refused before anything is computed with them."""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import NODE_SHAPES, SID, Array, Taylor

# The largest exponent that the format prints has two digits.
_LARGEST = 1e100


def refuse_absurd(sid: SID) -> None:
    """Every number must be finite and below 1e100 in magnitude.

    Raises
    ------
    InputError : names the block or the node whose entry is not.
    """
    entries: list[tuple[str, Taylor | None]] = [
        (f"block {name}", block) for name, block in sid.blocks.items()
    ]
    for node in sid.nodes:
        entries += [(f"node {node.id}, {n}", getattr(node, n)) for n in NODE_SHAPES]
    _refuse("mass", np.array(sid.mass))
    for place, entry in entries:
        for part in () if entry is None else (entry.m0, entry.m1, entry.mn):
            if part is not None:
                _refuse(place, part)


def _refuse(place: str, numbers: Array) -> None:
    if not np.all(np.abs(numbers) < _LARGEST):
        raise InputError(
            "holds a number that is infinite, undefined or beyond any physical size",
            place=place,
            expected="finite numbers below 1e100",
        )
