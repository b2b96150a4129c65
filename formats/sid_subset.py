"""SID with a subset of its shape functions."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .base.errors import InputError
from .base.sid import BLOCK_SHAPES, NODE_SHAPES, SID, Taylor
from .static_compliance import remaining_compliance_shares

#: Entries of a matrix that belong to the coordinates `kept` (n,) out of nq.
_ENTRIES = {
    "q": lambda kept, nq: kept,
    "3q": lambda kept, nq: np.concatenate([axis * nq + kept for axis in range(3)]),
}


def selected_indices(
    numbers: Sequence[int] | None, nq: int, place: str
) -> tuple[int, ...]:
    """Indices from 0 of the shape functions with these numbers, all for None.

    Raises
    ------
    InputError : a number is none of 1 to nq.
    """
    if numbers is None:
        return tuple(range(nq))
    for number in numbers:
        if not 1 <= number <= nq:
            raise InputError(
                f"there is no shape function {number}",
                place=place,
                expected=f"numbers from 1 to {nq}" if nq else "a SID that has some",
            )
    return tuple(sorted(number - 1 for number in numbers))


def select_shape_functions(sid: SID, selected: Sequence[int]) -> SID:
    """The body that moves and deforms with these shape functions only, from 0.

    Raises
    ------
    InputError : the SID has terms above the first order, whose meaning is open.
    """
    if len(selected) == sid.nq:
        return sid
    rows = np.array(selected, dtype=int)

    def cut(entry: Taylor, name: str) -> Taylor:
        if entry.mn is not None and entry.mn.any():
            raise InputError(
                "the meaning of terms above the first order for some of the shape "
                "functions is not known",
                place=name,
            )
        shape = BLOCK_SHAPES.get(name) or NODE_SHAPES[name]
        m0, m1 = entry.m0, entry.m1
        m1 = None if m1 is None else m1[rows]
        for axis, size in zip((-2, -1), shape, strict=True):
            if isinstance(size, str):
                entries = _ENTRIES[size](rows, sid.nq)
                m0 = np.take(m0, entries, axis)
                m1 = None if m1 is None else np.take(m1, entries, axis)
        return Taylor(m0, m1, order=entry.order)

    nodes = []
    for node in sid.nodes:
        entries: dict[str, Any] = {
            name: None if entry is None else cut(entry, name)
            for name in NODE_SHAPES
            for entry in [getattr(node, name)]
        }
        nodes.append(replace(node, **entries))
    blocks: dict[str, Any] = {name: cut(b, name) for name, b in sid.blocks.items()}
    labels = tuple(sid.labels[k] for k in selected)
    sections = tuple(
        replace(
            section,
            part=select_shape_functions(
                section.part, [*selected, *range(sid.nq, section.part.nq)]
            ),
        )
        for section in sid.sections
    )
    small = replace(
        sid, labels=labels, nodes=tuple(nodes), extra={}, sections=sections, **blocks
    )
    return replace(small, carried=remaining_compliance_shares(sid, small))
