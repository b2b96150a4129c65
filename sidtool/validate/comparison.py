"""Comparison of a SID with another SID or with a table of reference numbers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sidtool.formats.reference import ReferenceFile, read_reference
from sidtool.formats.sid import SID

from .comparisons.rows import Comparison
from .comparisons.sids import compare_sids
from .comparisons.table import compare_table
from .magnitudes import refuse_absurd


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
        says itself which of its rows are judged.
    markers : ids of the nodes to load; by default up to four that move most

    Raises
    ------
    InputError : the reference cannot be read, or names what the SID does not have.
    """
    if not isinstance(reference, SID | ReferenceFile):
        reference = _read(Path(reference))
    refuse_absurd(sid)
    with np.errstate(all="ignore"):
        if isinstance(reference, ReferenceFile):
            return compare_table(sid, reference)
        refuse_absurd(reference)
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


def _read(path: Path) -> SID | ReferenceFile:
    if path.suffix.lower() in (".toml", ".json", ".csv"):
        return read_reference(path)
    from sidtool.formats.sid_files import read_sid

    return read_sid(path)
