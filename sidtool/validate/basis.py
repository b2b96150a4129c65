"""The same body in another basis of its shape functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sidtool.formats.errors import InputError
from sidtool.formats.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    Array,
    Node,
    Taylor,
    axis_major,
    by_mode,
)

MatrixMap = Callable[[Array], Array]


def change_basis(
    sid: SID, transformation: ArrayLike, labels: tuple[str, ...] | None = None
) -> SID:
    """The body with new elastic coordinates p, where q = T p.

    Parameters
    ----------
    transformation : T, (nq, np). Columns are the new shape functions in terms of the
        old ones: signs, order, scaling, any regular mixture; fewer columns truncate
    labels : np texts; by default the old ones where a column is a multiple of one old
        shape function, else empty

    Raises
    ------
    InputError : T has another number of rows, or the SID carries terms of second or
        higher order or blocks of unknown meaning.
    """
    T = np.asarray(transformation, float)
    if T.ndim != 2 or len(T) != sid.nq:
        raise InputError(
            f"the transformation has shape {T.shape}",
            expected=f"({sid.nq}, n): one row per elastic coordinate",
        )
    refuse_unknown(sid, "a change of basis")
    blocks: dict[str, Any] = {
        name: _transformed(block, name, T, sid.nq) for name, block in sid.blocks.items()
    }
    return replace(
        sid,
        labels=_labels(sid, T) if labels is None else labels,
        nodes=tuple(_node(node, T, sid.nq) for node in sid.nodes),
        **blocks,
    )


def refuse_unknown(sid: SID, purpose: str) -> None:
    """Refuse contents whose meaning the format leaves open.

    Raises
    ------
    InputError : a block of unknown name, or a term above the first order.
    """
    if sid.extra:
        raise InputError(
            f"the meaning of this block for {purpose} is not known",
            place=f"block {next(iter(sid.extra))}",
        )
    for name, block in sid.blocks.items():
        _refuse_higher(block, f"block {name}", purpose)
    for node in sid.nodes:
        for name in NODE_SHAPES:
            entry = getattr(node, name)
            if entry is not None:
                _refuse_higher(entry, f"node {node.id}, {name}", purpose)


def _refuse_higher(entry: Taylor, place: str, purpose: str) -> None:
    if entry.mn is not None and entry.mn.any():
        raise InputError(
            f"the meaning of terms above the first order for {purpose} is not known",
            place=place,
        )


def _node(node: Node, T: Array, nq: int) -> Node:
    entries: dict[str, Any] = {
        name: None if entry is None else _transformed(entry, name, T, nq)
        for name in NODE_SHAPES
        for entry in [getattr(node, name)]
    }
    return replace(node, **entries)


def _transformed(entry: Taylor, name: str, T: Array, nq: int) -> Taylor:
    rows, columns = BLOCK_SHAPES.get(name) or NODE_SHAPES[name]
    left: MatrixMap = (lambda m: T.T @ m) if rows == "q" else _same
    right = {"q": lambda m: m @ T, "3q": lambda m: _mode_columns(m, T, nq)}.get(
        str(columns), _same
    )
    m1 = None
    if entry.m1 is not None:
        turned = np.array([right(left(matrix)) for matrix in entry.m1])
        shape = right(left(entry.m0)).shape
        m1 = (T.T @ turned.reshape(nq, math.prod(shape))).reshape(T.shape[1], *shape)
    return Taylor(right(left(entry.m0)), m1, order=entry.order)


def _same(matrix: Array) -> Array:
    return matrix


def _mode_columns(columns: Array, T: Array, nq: int) -> Array:
    return axis_major(np.tensordot(T.T, by_mode(columns, nq), axes=1))


def _labels(sid: SID, T: Array) -> tuple[str, ...]:
    labels = []
    for column in T.T:
        used = np.flatnonzero(column)
        labels.append(sid.labels[used[0]] if len(used) == 1 else "")
    return tuple(labels)
