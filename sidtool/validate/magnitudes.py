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
    numbers = [
        (place, part)
        for place, entry in [("mass", Taylor(np.full((1, 1), sid.mass))), *entries]
        if entry is not None
        for part in (entry.m0, entry.m1, entry.mn)
        if part is not None
    ]
    if _usual(np.concatenate([part.ravel() for _, part in numbers])):
        return
    place = next(place for place, part in numbers if not _usual(part))
    raise InputError(
        "holds a number that is infinite, undefined or beyond any physical size",
        place=place,
        expected="finite numbers below 1e100",
    )


def _usual(numbers: Array) -> bool:
    return bool(np.all(np.abs(numbers) < _LARGEST))
