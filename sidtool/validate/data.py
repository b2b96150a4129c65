"""Judgements as plain data and as JSON, for machines."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from .checks import Check, checks_as_data, verdict
from .comparison import Comparison
from .guess import UnitGuess


def comparison_as_data(comparison: Comparison) -> dict[str, Any]:
    """The rows (fields of `Row` and their verdict), notes, and the verdict of all."""
    rows = [_plain({**asdict(row), "verdict": row.verdict}) for row in comparison.rows]
    return {"passed": comparison.passed, "notes": list(comparison.notes), "rows": rows}


def to_json(
    checks: Sequence[Check],
    comparison: Comparison | None = None,
    units: UnitGuess | None = None,
    questions: Sequence[str] = (),
    written_by: str = "",
    *,
    strict: bool = False,
) -> str:
    """One JSON document; numbers that JSON cannot hold (nan, infinity) become null.

    Keys: ``passed`` (of all together), ``checks``, and, where given, ``comparison``,
    ``units``, ``questions``, which count as warnings, and ``written_by`` of own files.
    """
    good = verdict(checks, strict=strict) and (comparison is None or comparison.passed)
    good = good and not (strict and questions)
    data: dict[str, Any] = {"passed": good, "checks": _plain(checks_as_data(checks))}
    if comparison is not None:
        data["comparison"] = comparison_as_data(comparison)
    if units is not None:
        data["units"] = _plain(asdict(units))
        data["questions"] = list(questions)
    if written_by:
        data["written_by"] = written_by
    return json.dumps(data, indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
