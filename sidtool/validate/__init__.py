"""What judges a SID: identities, comparison with a reference, repair and units."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "Check": "sidtool.validate.checks",
    "check": "sidtool.validate.checks",
    "report": "sidtool.validate.checks",
    "verdict": "sidtool.validate.checks",
    "Comparison": "sidtool.validate.comparisons.rows",
    "compare": "sidtool.validate.comparison",
    "comparison_report": "sidtool.validate.comparison",
    "Change": "sidtool.validate.repairs",
    "repair": "sidtool.validate.repairs",
    "change_basis": "sidtool.validate.basis",
    "rescale": "sidtool.validate.units",
    "convert_units": "sidtool.validate.units",
    "guess_units": "sidtool.validate.guess",
    "UnitGuess": "sidtool.validate.guess",
    "checks_as_data": "sidtool.validate.checks",
    "comparison_as_data": "sidtool.validate.data",
    "to_json": "sidtool.validate.data",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that the command line answers at once."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
