"""Comparison with published or computed numbers from a reference file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.reference import BlockValue, Frequencies, ReferenceFile
from sidtool.formats.sid import SID, Array, Taylor
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, free_motion, plane_of_motion

from ..frequencies import free_modes, held_modes, hertz
from .rows import Comparison, Row


def compare_table(sid: SID, table: ReferenceFile) -> Comparison:
    """Each number of the table beside that of the SID.

    Raises
    ------
    InputError : the table names a node, an index or a kind of frequency that this SID
        does not have.
    """
    rows: list[Row] = []
    notes: list[str] = []
    for entry in table.frequencies:
        found = _frequencies(sid, entry)
        beyond = [str(number) for number in entry.numbers if number > len(found)]
        if beyond:
            numbers = ", ".join(beyond)
            notes.append(f"{entry.name}: the SID has no frequency number {numbers}")
        rows += _frequency_rows(entry, found)
    rows += [_block_row(sid, entry) for entry in table.blocks]
    return Comparison(tuple(rows), tuple(notes))


def _frequency_rows(entry: Frequencies, found: Array) -> Iterator[Row]:
    group = f"frequencies, {entry.name} [Hz]"
    for number, expected in zip(entry.numbers, entry.hertz, strict=True):
        if number <= len(found):
            value = float(found[number - 1])
            yield Row(
                group,
                f"f{number}",
                value,
                expected,
                _relative(value, expected),
                entry.tolerance,
                entry.source,
            )


def _frequencies(sid: SID, entry: Frequencies) -> Array:
    if sid.nq == 0:
        raise InputError(
            "a rigid body has no frequencies",
            place=f"frequencies {entry.name!r}",
            expected="a SID with elastic coordinates",
        )
    if entry.body == "held":
        return _held(sid, entry)
    axis = plane_of_motion(sid)
    for rigid in (SPATIAL, *(() if axis is None else (IN_PLANE[axis],))):
        if free_motion(sid, rigid).possible:
            return hertz(free_modes(sid, rigid)[0])
    raise InputError(
        f"this body cannot move freely: {free_motion(sid).reason}",
        place=f"frequencies {entry.name!r}",
        expected='body = "held"',
    )


def _held(sid: SID, entry: Frequencies) -> Array:
    try:
        return hertz(held_modes(sid)[0])
    except np.linalg.LinAlgError:
        raise InputError(
            "Me is not positive definite, so there are no frequencies",
            place=f"frequencies {entry.name!r}",
            expected="a SID that passes I13",
        ) from None


def _block_row(sid: SID, entry: BlockValue) -> Row:
    name = _name(entry)
    value = sid.mass if entry.block == "mass" else _entry(sid, entry, name)
    quantity = entry.name or name
    deviation = _relative(value, entry.value)
    return Row(
        "blocks",
        quantity,
        value,
        entry.value,
        deviation,
        entry.tolerance,
        entry.source,
    )


def _entry(sid: SID, entry: BlockValue, name: str) -> float:
    owner = sid if entry.node is None else sid.node(entry.node)
    block: Taylor | None = getattr(owner, entry.block)
    if block is None:
        raise InputError("is not in this SID", place=name)
    rows, columns = block.shape
    if entry.row > rows or entry.column > columns or (entry.mode or 0) > sid.nq:
        raise InputError(
            "is beyond the block",
            place=name,
            expected=f"at most row {rows}, column {columns}, mode {sid.nq}",
        )
    matrix = (
        block.m0 if entry.mode is None else block.first_order(sid.nq)[entry.mode - 1]
    )
    return float(matrix[entry.row - 1, entry.column - 1])


def _name(entry: BlockValue) -> str:
    at = "" if entry.node is None else f"node {entry.node} "
    if entry.block == "mass":
        return "mass"
    if entry.mode is None:
        return f"{at}{entry.block} m0({entry.row},{entry.column})"
    return f"{at}{entry.block} m1({entry.row},{entry.mode},{entry.column})"


def _relative(value: float, expected: float) -> float:
    """Relative to the expected number; to one if that is zero."""
    return (value - expected) / abs(expected) if expected else value
