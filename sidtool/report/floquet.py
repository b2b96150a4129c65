"""Floquet analyses as text and as data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sidtool.formats.text import wrapped

from .result import plain_notes
from .tables import text_table

if TYPE_CHECKING:
    from sidtool.solver.simulation.floquet import FloquetModes

FLOQUET_COLUMNS = (
    "mode",
    "|multiplier|",
    "angle [rad]",
    "growth [1/s]",
    "inertial Hz",
    "rotating Hz",
)


def describe_floquet(modes: FloquetModes) -> str:
    """Describe a Floquet analysis: multipliers, frequencies, stability, notes."""
    found = "stable" if modes.is_stable else "unstable"
    summary = f"{found}: period {modes.period:.6g} s"
    frame = (
        "frame: multipliers are the same in all axes; inertial Hz is the largest "
        "harmonic of the displacements in inertial axes, rotating Hz that in the axes "
        "of the bodies; those of other sensors differ by multiples of "
        f"{1.0 / modes.period:.6g} Hz"
    )
    if not len(modes.multipliers):
        return f"{summary}\n\nno modes: nothing can move"
    table = text_table(FLOQUET_COLUMNS, floquet_rows(modes))
    return "\n\n".join([summary, table, wrapped(frame, "    "), *plain_notes(modes)])


def floquet_rows(modes: FloquetModes) -> list[list[str]]:
    """Return number, multiplier, growth and frequencies of each mode."""
    return [
        [
            str(k + 1),
            f"{abs(value):.6g}",
            f"{abs(exponent.imag) * modes.period:.6g}",
            f"{exponent.real:.4g}",
            *(
                f"{hertz[k]:.6g}" if value else "-"
                for hertz in (modes.inertial_frequencies, modes.rotating_frequencies)
            ),
        ]
        for k, (value, exponent) in enumerate(
            zip(modes.multipliers, modes.exponents, strict=True)
        )
    ]


def floquet_data(modes: FloquetModes) -> dict[str, Any]:
    """Return a Floquet analysis as data for JSON; complex numbers are pairs."""
    return {
        "period": modes.period,
        "is_stable": modes.is_stable,
        "error": modes.error,
        "diagnostics": [each.as_data() for each in modes.diagnostics],
        "modes": [
            {
                "multiplier": [float(value.real), float(value.imag)],
                "exponent": [float(exponent.real), float(exponent.imag)],
                "inertial_frequency": float(modes.inertial_frequencies[k]),
                "rotating_frequency": float(modes.rotating_frequencies[k]),
            }
            for k, (value, exponent) in enumerate(
                zip(modes.multipliers, modes.exponents, strict=True)
            )
        ],
        "monodromy": modes.monodromy.tolist(),
    }
