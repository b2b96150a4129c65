"""A SID that is stored holds finite numbers only."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..errors import InputError
from ..sid import NODE_SHAPES, SID, Taylor


def check_finite(sid: SID) -> None:
    """Refuse NaN and infinity anywhere in the body.

    Raises
    ------
    InputError : names the block or the node.
    """
    if not math.isfinite(sid.mass):
        raise InputError(f"the mass is {sid.mass}", expected="a finite number")
    for place, block in expansions(sid):
        for part in (block.m0, block.m1, block.mn):
            if part is not None and not np.isfinite(part).all():
                raise InputError(
                    "contains NaN or infinity", place=place, expected="finite numbers"
                )


def expansions(sid: SID) -> Iterator[tuple[str, Taylor]]:
    """Every Taylor expansion of a body with a name for messages."""
    for name, block in (sid.blocks | dict(sid.extra)).items():
        yield f"block {name}", block
    for node in sid.nodes:
        for name in NODE_SHAPES:
            entry = getattr(node, name)
            if entry is not None:
                yield f"node {node.id}, {name}", entry
