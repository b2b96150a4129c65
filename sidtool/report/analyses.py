"""Equilibria, natural modes, inverse dynamics, Campbell diagrams, Floquet modes.

Texts and tables of all, data and files of those that have them.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.result import (
    Result,
    units_in,
)
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.text import counted_noun, wrapped

from .diagnostics import severity_counts
from .json_data import write_json
from .result import MAX_OUTPUTS, plain_notes, result_span
from .tables import (
    TextBlock,
    named_values,
    text_table,
    title_line,
    without_rounding,
)

if TYPE_CHECKING:
    from sidtool.solver.analyses.campbell import CampbellDiagram, CriticalSpeed
    from sidtool.solver.analyses.linearisation import Linearisation
    from sidtool.solver.analyses.static_equilibrium import Equilibrium
    from sidtool.solver.simulation.floquet import FloquetModes


#: Largest number of leading coordinates of a mode, and the decimals of their amplitudes
#: relative to the largest one: those that agree to them keep the order of the names.
MAX_LEADING_COORDINATES, AMPLITUDE_DECIMALS = 3, 6
#: Largest numbers of modes and of rows of multipliers in a description.
MAX_MODES, MAX_FORCES = 30, 12
#: Damping ratios below this are rounding.
DAMPING_ROUNDING = 1e-12

#: States that modes are about, by their option.
_STATES = {
    "static": "the static equilibrium, at rest",
    "start": "the initial state, with its velocities",
}
FORMAT = "sidtool Campbell diagram"
CRITICAL_COLUMNS = ("critical speed [rad/s]", "rev/min", "Hz", "mode", "order", "whirl")
#: Revolutions per minute of 1 rad/s.
_PER_MINUTE = 30.0 / np.pi
#: Values of the parameter in a printed table.
_MAX_LISTED = 12
#: Modes in a printed table.
_CAMPBELL_MODES = 7
FLOQUET_COLUMNS = (
    "mode",
    "|multiplier|",
    "angle [rad]",
    "growth [1/s]",
    "inertial Hz",
    "rotating Hz",
)


def describe_equilibrium(equilibrium: Equilibrium, verbose: bool = False) -> str:
    """Describe an equilibrium: cost, residual, notes, outputs, forces of the joints.

    verbose : all outputs and multipliers
    """
    result = equilibrium.result()
    entries = [
        ("cost", counted_noun(equilibrium.iterations, "iteration")),
        ("residual", f"{equilibrium.residual:.1e} of the forces"),
        ("diagnostics", severity_counts(result.diagnostics)),
    ]
    title = title_line(result.title, "static equilibrium found")
    parts = [f"{title}\n{named_values(entries)}", *plain_notes(result)]
    rows = state_rows(result)
    units = [unit for _, _, unit in rows]
    values = without_rounding([value for _, value, _ in rows], units)
    found = [
        (name, float(value), unit)
        for (name, _, unit), value in zip(rows, values, strict=True)
    ]
    outputs = [[n, f"{x:.10g}", unit] for n, x, unit in found if n in result.names]
    if outputs:
        most = None if verbose else MAX_OUTPUTS
        parts.append(text_table(["output", "value", "unit"], outputs, most))
    forces = [row for row in found if row[0] not in result.names]
    if forces:
        parts.append(_force_table(forces, None if verbose else MAX_FORCES))
    return "\n\n".join(parts)


def _force_table(
    forces: Iterable[tuple[str, float, str]], most: int | None
) -> TextBlock:
    """Tabulate the multipliers of each joint and drive, those of one unit in a row."""
    of_owner: dict[tuple[str, str], dict[str, float]] = {}
    for name, value, unit in forces:
        owner, _, component = name.rpartition(".")
        of_owner.setdefault((owner, unit), {})[component] = value
    rows = [
        [
            owner,
            ", ".join(sorted(values)),
            ", ".join(f"{values[component]:.6g}" for component in sorted(values)),
            unit,
        ]
        for (owner, unit), values in sorted(of_owner.items())
    ]
    return text_table(["joint or drive", "multipliers", "values", "unit"], rows, most)


def state_rows(result: Result) -> list[tuple[str, float, str]]:
    """Return recorded outputs and all multipliers of a result of one time.

    Returns
    -------
    names, values and units
    """
    names = (*result.names, *result.multiplier_names)
    values = [*result.values[0], *result.multipliers[0]]
    unit = units_in(result)
    value_of = dict(zip(names, map(float, values), strict=True))
    return [(name, value, unit(name)) for name, value in value_of.items()]


def describe_modes(
    modes: Linearisation, about: str = "static", verbose: bool = False
) -> str:
    """Describe natural modes: a table with the leading coordinates of each, and
    notes.

    verbose : all modes
    """
    rows = mode_rows(modes)
    if not rows:
        return "no natural modes: nothing can move"
    count = counted_noun(len(rows), "natural mode")
    most = None if verbose else MAX_MODES
    table = text_table(mode_header(modes), rows, most)
    parts = [f"{count} about {_STATES[about]}", table]
    parts.append(wrapped(axes_of_frequencies(modes), "    "))
    return "\n\n".join([*parts, *plain_notes(modes)])


def has_rotating_axes(modes: Linearisation) -> bool:
    """Return whether frequencies differ between inertial and body axes."""
    difference = modes.inertial_frequencies - modes.rotating_frequencies
    return bool(any(modes.whirl) or difference.any())


def mode_header(modes: Linearisation) -> tuple[str, ...]:
    """Return the header of `mode_rows`."""
    columns: tuple[str, ...] = ("Hz",)
    if has_rotating_axes(modes):
        columns = ("inertial Hz", "rotating Hz", "whirl")
    return ("mode", *columns, "damping ratio", "moved most by")


def axes_of_frequencies(modes: Linearisation) -> str:
    """Return a text on what the frequencies are, and the axes they are measured in."""
    if not has_rotating_axes(modes):
        still = "; without oscillation the decay time"
        still = still if any(map(_has_no_oscillation, modes.eigenvalues)) else ""
        return f"frame: {modes.frame} axes; Hz: undamped, |eigenvalue| / 2 pi{still}"
    return (
        f"frame: modes are solved in axes {modes.frame}"
        if modes.frame != "inertial"
        else "frame: modes are solved in inertial axes"
    ) + (
        "; inertial Hz is what fixed sensors see, rotating Hz what strain gauges on "
        "the body see, both of the damped motion"
    )


def mode_rows(modes: Linearisation) -> list[list[str]]:
    """Return number, frequency, damping ratio and leading coordinates of each mode."""
    rows = []
    for k, (hertz, ratio) in enumerate(
        zip(modes.frequencies, modes.damping_ratios, strict=True)
    ):
        sizes = np.abs(modes.shapes[k])
        sizes = np.round(sizes / sizes.max(), AMPLITUDE_DECIMALS)
        order = [i for i in np.argsort(-sizes, kind="stable") if sizes[i] > 0.0]
        leading = ", ".join(modes.names[i] for i in order[:MAX_LEADING_COORDINATES])
        columns = [f"{hertz:.6g}"]
        if has_rotating_axes(modes):
            columns = [
                f"{modes.inertial_frequencies[k]:.6g}",
                f"{modes.rotating_frequencies[k]:.6g}",
                modes.whirl[k],
            ]
        rows.append(
            [
                str(k + 1),
                *columns,
                "rigid"
                if modes.rigid[k]
                else _damping_text(modes.eigenvalues[k], ratio),
                leading,
            ]
        )
    return rows


def _has_no_oscillation(eigenvalue: complex) -> bool:
    return bool(eigenvalue.real and not eigenvalue.imag)


def _damping_text(eigenvalue: complex, ratio: float) -> str:
    """The damping ratio; of a mode without oscillation the time of its decay."""
    if _has_no_oscillation(eigenvalue):
        kind = "decay" if eigenvalue.real < 0 else "growth"
        return f"{kind} in {1 / abs(eigenvalue.real):.3g} s"
    return f"{ratio if abs(ratio) > DAMPING_ROUNDING else 0.0:.4g}"


def modes_as_data(modes: Linearisation) -> dict[str, Any]:
    """Return natural modes as data for JSON; complex numbers are pairs."""
    return {
        "coordinates": list(modes.names),
        "position": modes.z.tolist(),
        "velocity": modes.v.tolist(),
        "diagnostics": [each.as_data() for each in modes.diagnostics],
        "frame": modes.frame,
        "modes": [
            {
                "frequency": float(modes.frequencies[k]),
                "inertial_frequency": float(modes.inertial_frequencies[k]),
                "rotating_frequency": float(modes.rotating_frequencies[k]),
                "whirl": modes.whirl[k],
                "rigid": bool(modes.rigid[k]),
                "damping_ratio": float(modes.damping_ratios[k]),
                "eigenvalue": _complex_pair(value),
                "shape": [_complex_pair(entry) for entry in modes.shapes[k]],
            }
            for k, value in enumerate(modes.eigenvalues)
        ],
    }


def describe_inverse(result: Result, verbose: bool = False) -> str:
    """Describe inverse dynamics: the largest force of each constraint, and notes.

    verbose : all forces
    """
    first, last, count = result_span(result)
    times = counted_noun(count, "time")
    outcome = f"inverse dynamics, {first:g} to {last:g} s, {times}"
    unit = units_in(result)
    units = [unit(name) for name in result.multiplier_names]
    columns = without_rounding(result.multipliers.T, units)
    rows = [
        [name, f"{np.min(column):.10g}", f"{np.max(column):.10g}", unit(name)]
        for name, column in zip(result.multiplier_names, columns, strict=True)
    ]
    return "\n\n".join(
        [
            title_line(result.title, outcome),
            text_table(
                ["force", "least", "greatest", "unit"],
                rows,
                None if verbose else MAX_MODES,
            ),
            *plain_notes(result),
        ]
    )


def _complex_pair(value: complex) -> list[float]:
    return [float(np.real(value)), float(np.imag(value))]


def describe_campbell(diagram: CampbellDiagram) -> str:
    """Describe a diagram: frequencies at some values, critical speeds, notes."""
    count = len(diagram.values)
    rows = np.unique(np.linspace(0, count - 1, min(count, _MAX_LISTED)).round()).astype(
        int
    )
    total = diagram.inertial_frequencies.shape[1]
    modes = range(min(total, _CAMPBELL_MODES))
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
    if total > _CAMPBELL_MODES:
        left_out.append(f"modes {_CAMPBELL_MODES + 1} to {total}")
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
