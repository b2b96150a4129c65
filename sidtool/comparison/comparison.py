"""Comparison of a SID with another SID or a reference table; results as JSON."""

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.reference import (
    BlockValue,
    Frequencies,
    ReferenceFile,
    read_reference,
)
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, free_motion, plane_of_motion

from ..mesh.unit_systems import check_magnitudes
from ..validate.checks import Check, checks_as_data, verdict
from ..validate.frequencies import free_modes, held_modes, to_hertz
from ..validate.unit_guess import UnitGuess
from .block_differences import Comparison, ComparisonRow, compare_sids


def compare_table(sid: SID, table: ReferenceFile) -> Comparison:
    """Compare each number of the table with that of the SID.

    Raises
    ------
    InputError : the table names a node, an index or a kind of frequency that this SID
        does not have.
    """
    rows: list[ComparisonRow] = []
    notes: list[str] = []
    for entry in table.frequencies:
        frequencies = _sid_frequencies(sid, entry)
        beyond = [str(number) for number in entry.numbers if number > len(frequencies)]
        if beyond:
            numbers = ", ".join(beyond)
            notes.append(f"{entry.name}: the SID has no frequency number {numbers}")
        rows += _table_frequency_rows(entry, frequencies)
    rows += [_block_row(sid, entry) for entry in table.blocks]
    return Comparison(tuple(rows), tuple(notes))


def _table_frequency_rows(
    entry: Frequencies, frequencies: Array
) -> Iterator[ComparisonRow]:
    group = f"frequencies, {entry.name} [Hz]"
    for number, expected in zip(entry.numbers, entry.hertz, strict=True):
        if number <= len(frequencies):
            value = float(frequencies[number - 1])
            yield ComparisonRow(
                group,
                f"f{number}",
                value,
                expected,
                _relative_deviation(value, expected),
                entry.tolerance,
                entry.source,
            )


def _sid_frequencies(sid: SID, entry: Frequencies) -> Array:
    if sid.nq == 0:
        raise InputError(
            "a rigid body has no frequencies",
            place=f"frequencies {entry.name!r}",
            expected="a SID with elastic coordinates",
        )
    if entry.body == "held":
        return _held_frequencies(sid, entry)
    axis = plane_of_motion(sid)
    for rigid in (SPATIAL, *(() if axis is None else (IN_PLANE[axis],))):
        if free_motion(sid, rigid).possible:
            return to_hertz(free_modes(sid, rigid)[0])
    raise InputError(
        f"this body cannot move freely: {free_motion(sid).reason}",
        place=f"frequencies {entry.name!r}",
        expected='body = "held"',
    )


def _held_frequencies(sid: SID, entry: Frequencies) -> Array:
    try:
        return to_hertz(held_modes(sid)[0])
    except np.linalg.LinAlgError:
        raise InputError(
            "Me is not positive definite, so there are no frequencies",
            place=f"frequencies {entry.name!r}",
            expected="a SID that passes I13",
        ) from None


def _block_row(sid: SID, entry: BlockValue) -> ComparisonRow:
    name = _entry_name(entry)
    value = sid.mass if entry.block == "mass" else _sid_entry(sid, entry, name)
    quantity = entry.name or name
    deviation = _relative_deviation(value, entry.value)
    return ComparisonRow(
        "blocks",
        quantity,
        value,
        entry.value,
        deviation,
        entry.tolerance,
        entry.source,
    )


def _sid_entry(sid: SID, entry: BlockValue, name: str) -> float:
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


def _entry_name(entry: BlockValue) -> str:
    at = "" if entry.node is None else f"node {entry.node} "
    if entry.block == "mass":
        return "mass"
    if entry.mode is None:
        return f"{at}{entry.block} m0({entry.row},{entry.column})"
    return f"{at}{entry.block} m1({entry.row},{entry.mode},{entry.column})"


def _relative_deviation(value: float, expected: float) -> float:
    """Relative to the expected number; to one if that is zero."""
    return (value - expected) / abs(expected) if expected else value


def compare(
    sid: SID,
    reference: SID | ReferenceFile | str | os.PathLike[str],
    *,
    tolerance: float | None = None,
    markers: Sequence[str] | None = None,
) -> Comparison:
    """Compare a SID with a reference, whatever the basis of its shape functions.

    Parameters
    ----------
    reference : another SID, a table, or the name of a file with either (``.toml``,
        ``.json`` and ``.csv`` are tables, everything else is a SID)
    tolerance : accepted relative deviation from another SID; None only shows. A table
        states itself which of its rows are judged.
    markers : ids of the nodes to load; by default up to four that move most

    Raises
    ------
    InputError : the reference cannot be read, or names what the SID does not have.
    """
    if not isinstance(reference, SID | ReferenceFile):
        reference = _read_reference_file(Path(reference))
    check_magnitudes(sid)
    with np.errstate(all="ignore"):
        if isinstance(reference, ReferenceFile):
            return compare_table(sid, reference)
        check_magnitudes(reference)
        return compare_sids(sid, reference, tolerance, markers)


def comparison_report(comparison: Comparison) -> list[dict[str, str]]:
    """The rows as texts, for a table on the screen."""
    return [
        {
            "group": row.group,
            "quantity": row.quantity,
            "value": f"{row.value:.8g}",
            "reference": f"{row.reference:.8g}",
            "deviation": f"{row.deviation:+.2e}",
            "tolerance": "-" if row.tolerance is None else f"{row.tolerance:.0e}",
            "verdict": row.verdict,
            "source": row.source,
        }
        for row in comparison.rows
    ]


def _read_reference_file(path: Path) -> SID | ReferenceFile:
    if path.suffix.lower() in (".toml", ".json", ".csv"):
        return read_reference(path)
    from sidtool.formats.sid_files import read_sid

    return read_sid(path)


def comparison_as_data(comparison: Comparison) -> dict[str, Any]:
    """The rows (fields of `Row` and their verdict), notes, and the verdict of all."""
    rows = [
        _json_value({**asdict(row), "verdict": row.verdict}) for row in comparison.rows
    ]
    return {"passed": comparison.passed, "notes": list(comparison.notes), "rows": rows}


def to_json(
    checks: Sequence[Check],
    comparison: Comparison | None = None,
    units: UnitGuess | None = None,
    diagnostics: Sequence[Diagnostic] = (),
    written_by: str = "",
    *,
    strict: bool = False,
    has_doubts: bool = False,
) -> str:
    """One JSON document; numbers that JSON cannot hold (nan, infinity) become null.

    Keys: ``passed`` (of all together), ``checks``, and, where given, ``comparison``,
    ``units``, ``diagnostics`` and ``written_by`` of own files.

    has_doubts : whether warnings count beside those of the checks if `strict`
    """
    good = verdict(checks, strict=strict) and (comparison is None or comparison.passed)
    good = good and not (strict and has_doubts)
    data: dict[str, Any] = {
        "passed": good,
        "checks": _json_value(checks_as_data(checks)),
    }
    if comparison is not None:
        data["comparison"] = comparison_as_data(comparison)
    if units is not None:
        data["units"] = _json_value(
            {
                "candidates": [asdict(each) for each in units.candidates],
                "certain": units.certain,
            }
        )
        data["diagnostics"] = [_json_value(each.as_data()) for each in diagnostics]
    if written_by:
        data["written_by"] = written_by
    return json.dumps(data, indent=2, allow_nan=False)


def _json_value(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _json_value(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
