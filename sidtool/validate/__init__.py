"""Validation of a SID: identities, repair and units.

identity              registry of identities, scales and deviations
inertia_identities    nodes, counts and inertia blocks (I1 to I12)
mass_identities       mass, stiffness, damping, contents (I13 to I21)
checks                all identities applied to one SID, its printed digits
frequencies           natural frequencies of a SID, sign of the gravity terms
basis_change          change of the basis of shape functions
body_modes            natural modes of a body at its nodes
repairs               repair of implied blocks
unit_guess            most likely unit system
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Check": "sidtool.validate.checks",
    "check": "sidtool.validate.checks",
    "report": "sidtool.validate.checks",
    "verdict": "sidtool.validate.checks",
    "Comparison": "sidtool.comparison.block_differences",
    "compare": "sidtool.comparison.comparison",
    "comparison_report": "sidtool.comparison.comparison",
    "Change": "sidtool.validate.repairs",
    "repair": "sidtool.validate.repairs",
    "change_basis": "sidtool.validate.basis_change",
    "rescale": "sidtool.mesh.unit_systems",
    "convert_units": "sidtool.mesh.unit_systems",
    "guess_units": "sidtool.validate.unit_guess",
    "UnitGuess": "sidtool.validate.unit_guess",
    "checks_as_data": "sidtool.validate.checks",
    "comparison_as_data": "sidtool.comparison.comparison",
    "to_json": "sidtool.comparison.comparison",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that the command line starts fast."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
