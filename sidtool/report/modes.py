"""Campbell diagrams as text, as data and as files.

Floquet analyses as text and as data.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.text import wrapped

from .json_data import write_json
from .result import plain_notes
from .tables import text_table

if TYPE_CHECKING:
    from sidtool.solver.analyses.campbell import CampbellDiagram, CriticalSpeed
    from sidtool.solver.simulation.floquet import FloquetModes


FORMAT = "sidtool Campbell diagram"
CRITICAL_COLUMNS = ("critical speed [rad/s]", "rev/min", "Hz", "mode", "order", "whirl")
#: Revolutions per minute of 1 rad/s.
_PER_MINUTE = 30.0 / np.pi
#: Values of the parameter in a printed table.
_MAX_LISTED = 12
#: Modes in a printed table.
_MAX_MODES = 7


def describe_campbell(diagram: CampbellDiagram) -> str:
    """Describe a diagram: frequencies at some values, critical speeds, notes."""
    count = len(diagram.values)
    rows = np.unique(np.linspace(0, count - 1, min(count, _MAX_LISTED)).round()).astype(
        int
    )
    total = diagram.inertial_frequencies.shape[1]
    modes = range(min(total, _MAX_MODES))
    header = [diagram.key, "rad/s", *(f"mode {k + 1}" for k in modes)]
    table = [
        [f"{diagram.values[n]:.6g}", f"{diagram.speeds[n]:.6g}"]
        + [_frequency(diagram, int(n), k) for k in modes]
        for n in rows
    ]
    remarks = "damped frequencies in inertial axes [Hz]; F forward, B backward whirl"
    left_out = []
    if len(rows) < count:
        left_out.append(f"all {count} values")
    if total > _MAX_MODES:
        left_out.append(f"modes {_MAX_MODES + 1} to {total}")
    if left_out:
        remarks += f"\n{' and '.join(left_out)} are in files and in Python"
    parts: list[str] = [text_table(header, table), remarks]
    if diagram.critical_speeds:
        parts.append(text_table(CRITICAL_COLUMNS, critical_rows(diagram)))
    elif diagram.speeds.any():
        parts.append("no critical speed in this range")
    return "\n\n".join([*parts, *plain_notes(diagram)])


def _frequency(diagram: CampbellDiagram, n: int, k: int) -> str:
    hertz = diagram.inertial_frequencies[n, k]
    if np.isnan(hertz):
        return "-"
    letter = str(diagram.whirl[n, k])[:1].upper()
    return f"{hertz:.6g} {letter}".rstrip()


def critical_rows(diagram: CampbellDiagram) -> list[list[str]]:
    """Return the critical speeds by rising speed."""
    return [
        [
            f"{each.speed:.6g}",
            f"{each.speed * _PER_MINUTE:.6g}",
            f"{each.speed * each.order / (2.0 * np.pi):.6g}",
            str(each.mode),
            f"{each.order:g}",
            each.whirl or "-",
        ]
        for each in sorted(diagram.critical_speeds, key=lambda each: each.speed)
    ]


def campbell_data(diagram: CampbellDiagram) -> dict[str, Any]:
    """Return a diagram as data for JSON; numbers of a mode that is not there are
    None."""
    return {
        "format": FORMAT,
        "parameter": diagram.key,
        "values": diagram.values.tolist(),
        "speeds": diagram.speeds.tolist(),
        "modes": [
            {
                "inertial_frequency": _numbers(diagram.inertial_frequencies[:, k]),
                "rotating_frequency": _numbers(diagram.rotating_frequencies[:, k]),
                "damping_ratio": _numbers(diagram.damping_ratios[:, k]),
                "whirl": [str(text) for text in diagram.whirl[:, k]],
                "agreement": _numbers(diagram.agreement[:, k]),
            }
            for k in range(diagram.inertial_frequencies.shape[1])
        ],
        "critical_speeds": [_critical_data(each) for each in diagram.critical_speeds],
        "diagnostics": [each.as_data() for each in diagram.diagnostics],
    }


def _critical_data(each: CriticalSpeed) -> dict[str, Any]:
    return {
        "mode": each.mode,
        "value": each.value,
        "speed": each.speed,
        "order": each.order,
        "whirl": each.whirl,
    }


def _numbers(column: Any) -> list[float | None]:
    return [None if np.isnan(x) else float(x) for x in column]


def write_campbell(path: Path, diagram: CampbellDiagram) -> None:
    """Write a diagram as a table (.csv) or as data (.json)."""
    if path.suffix.lower() == ".json":
        write_json(path, campbell_data(diagram))
        return
    header = [diagram.key, "speed [rad/s]"]
    columns: list[Any] = [diagram.values, diagram.speeds]
    for k in range(diagram.inertial_frequencies.shape[1]):
        name = f"mode{k + 1}"
        header += [
            f"{name}.inertial_frequency [Hz]",
            f"{name}.rotating_frequency [Hz]",
            f"{name}.damping_ratio",
            f"{name}.whirl",
        ]
        columns += [
            diagram.inertial_frequencies[:, k],
            diagram.rotating_frequencies[:, k],
            diagram.damping_ratios[:, k],
            diagram.whirl[:, k],
        ]
    with (
        atomic_path(path) as temporary,
        open(temporary, "w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        for row in zip(*columns, strict=True):
            writer.writerow([x if isinstance(x, str) else repr(float(x)) for x in row])


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
