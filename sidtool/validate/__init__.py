"""What judges a SID: identities, comparison with a reference, repair and units."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "Check": "checks",
    "check": "checks",
    "report": "checks",
    "verdict": "checks",
    "Comparison": "comparisons.rows",
    "compare": "comparison",
    "comparison_report": "comparison",
    "Change": "repairs",
    "repair": "repairs",
    "change_basis": "basis",
    "rescale": "units",
    "convert_units": "units",
    "guess_units": "guess",
    "UnitGuess": "guess",
    "checks_as_data": "checks",
    "comparison_as_data": "data",
    "to_json": "data",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that the command line answers at once."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)
