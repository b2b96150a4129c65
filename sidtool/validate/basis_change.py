"""Change of the basis of shape functions of a SID."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    Array,
    Node,
    Section,
    Taylor,
    axis_major,
    by_mode,
)

from ..mesh.unit_systems import check_known_contents

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
    check_known_contents(sid, "a change of basis")
    blocks: dict[str, Any] = {
        name: _transform_entry(block, name, T, sid.nq)
        for name, block in sid.blocks.items()
    }
    return replace(
        sid,
        labels=_new_labels(sid, T) if labels is None else labels,
        nodes=tuple(_transform_node(node, T, sid.nq) for node in sid.nodes),
        sections=tuple(
            replace(section, part=_change_part(section, T, labels))
            for section in sid.sections
        ),
        **blocks,
    )


def _change_part(section: Section, T: Array, labels: tuple[str, ...] | None) -> SID:
    """The part beyond a section, whose further shape functions stay."""
    added = section.part.labels[len(T) :]
    both = np.eye(len(T) + len(added), T.shape[1] + len(added))
    both[: len(T), : T.shape[1]] = T
    both[len(T) :, T.shape[1] :] = np.eye(len(added))
    return change_basis(section.part, both, None if labels is None else labels + added)


def _transform_node(node: Node, T: Array, nq: int) -> Node:
    entries: dict[str, Any] = {
        name: None if entry is None else _transform_entry(entry, name, T, nq)
        for name in NODE_SHAPES
        for entry in [getattr(node, name)]
    }
    return replace(node, **entries)


def _transform_entry(entry: Taylor, name: str, T: Array, nq: int) -> Taylor:
    rows, columns = BLOCK_SHAPES.get(name) or NODE_SHAPES[name]
    left: MatrixMap = (lambda m: T.T @ m) if rows == "q" else _same_matrix
    right = {"q": lambda m: m @ T, "3q": lambda m: _transform_columns(m, T, nq)}.get(
        str(columns), _same_matrix
    )
    m1 = None
    if entry.m1 is not None:
        turned = np.array([right(left(matrix)) for matrix in entry.m1])
        shape = right(left(entry.m0)).shape
        m1 = (T.T @ turned.reshape(nq, math.prod(shape))).reshape(T.shape[1], *shape)
    return Taylor(right(left(entry.m0)), m1, order=entry.order)


def _same_matrix(matrix: Array) -> Array:
    return matrix


def _transform_columns(columns: Array, T: Array, nq: int) -> Array:
    return axis_major(np.tensordot(T.T, by_mode(columns, nq), axes=1))


def _new_labels(sid: SID, T: Array) -> tuple[str, ...]:
    labels = []
    for column in T.T:
        used = np.flatnonzero(column)
        labels.append(sid.labels[used[0]] if len(used) == 1 else "")
    return tuple(labels)
