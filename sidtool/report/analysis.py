"""What analyses found, as tables; natural modes as data for other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.result import Result, units_in

from .result import note_lines
from .tables import named, table

if TYPE_CHECKING:
    from sidtool.solver.analyses.linear import Linearisation

    from ..states import Equilibrium

#: Coordinates named beside a mode: those that move most, if they move by more than a
#: part of the most.
LEADING, MOVES = 3, 1e-6
#: Damping ratios are negative below this; differences do not tell less from none.
GROWS = 1e-6
#: Damping ratios below this are rounding.
NOISE = 1e-12


def describe_equilibrium(found: Equilibrium) -> str:
    """Iterations, residual, notes, outputs and multipliers."""
    result = found.result()
    parts: list[str] = [
        named(
            [
                ("equilibrium", f"after {found.iterations} steps"),
                ("unbalanced", f"{found.residual:.1e} of the forces"),
            ]
        )
    ]
    parts += _notes(result)
    rows = found.rows()
    if rows:
        texts = [[name, f"{value:.10g}", unit] for name, value, unit in rows]
        parts.append(table(["output", "value", "unit"], texts))
    return "\n\n".join(parts)


def describe_modes(modes: Linearisation) -> str:
    """A table of the natural modes and the coordinates that lead each, and notes."""
    rows = mode_rows(modes)
    if not rows:
        return "no natural modes: nothing can move"
    text: str = table(mode_header(modes), rows)
    text += f"\n\n{frame_of(modes)}"
    growing = np.flatnonzero((modes.damping_ratios < -GROWS) & ~modes.rigid) + 1
    if len(growing):
        which = ", ".join(map(str, growing))
        told = f"mode {which} grows, its damping ratio is negative"
        if len(growing) > 1:
            told = f"modes {which} grow, their damping ratios are negative"
        text += f"\n\nunstable: {told}"
    return "\n\n".join([text, *_notes(modes)])


def turns(modes: Linearisation) -> bool:
    """Whether frequencies differ between inertial axes and those of the bodies."""
    apart = modes.inertial_frequencies - modes.rotating_frequencies
    return bool(any(modes.whirl) or apart.any())


def mode_header(modes: Linearisation) -> tuple[str, ...]:
    """Heads of the columns of `mode_rows`."""
    columns: tuple[str, ...] = ("Hz",)
    if turns(modes):
        columns = ("inertial Hz", "rotating Hz", "whirl")
    return ("mode", *columns, "damping ratio", "moved most by")


def frame_of(modes: Linearisation) -> str:
    """In which axes the frequencies are those that one sees."""
    if not turns(modes):
        return f"frame: {modes.frame} axes"
    return (
        f"frame: modes are solved in axes {modes.frame}"
        if modes.frame != "inertial"
        else "frame: modes are solved in inertial axes"
    ) + (
        "; inertial Hz is what fixed sensors see, rotating Hz what strain gauges on "
        "the body see"
    )


def mode_rows(modes: Linearisation) -> list[list[str]]:
    """Number, frequency, damping ratio and leading coordinates of each mode."""
    rows = []
    for k, (hertz, ratio) in enumerate(
        zip(modes.frequencies, modes.damping_ratios, strict=True)
    ):
        sizes = np.abs(modes.shapes[k])
        order = [i for i in np.argsort(-sizes) if sizes[i] > MOVES * sizes.max()]
        lead = ", ".join(modes.names[i] for i in order[:LEADING])
        columns = [f"{hertz:.6g}"]
        if turns(modes):
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
                else f"{ratio if abs(ratio) > NOISE else 0.0:.4g}",
                lead,
            ]
        )
    return rows


def modes_as_data(modes: Linearisation) -> dict[str, Any]:
    """Natural modes as JSON holds them; complex numbers are pairs."""
    return {
        "coordinates": list(modes.names),
        "position": modes.z.tolist(),
        "velocity": modes.v.tolist(),
        "notes": list(modes.notes),
        "warnings": list(modes.warnings),
        "frame": modes.frame,
        "modes": [
            {
                "frequency": float(modes.frequencies[k]),
                "inertial_frequency": float(modes.inertial_frequencies[k]),
                "rotating_frequency": float(modes.rotating_frequencies[k]),
                "whirl": modes.whirl[k],
                "rigid": bool(modes.rigid[k]),
                "damping_ratio": float(modes.damping_ratios[k]),
                "eigenvalue": _pair(value),
                "shape": [_pair(entry) for entry in modes.shapes[k]],
            }
            for k, value in enumerate(modes.eigenvalues)
        ],
    }


def describe_inverse(result: Result) -> str:
    """The largest force of each constraint, and notes."""
    unit = units_in(result)
    rows = [
        [name, f"{np.min(column):.10g}", f"{np.max(column):.10g}", unit(name)]
        for name, column in zip(
            result.multiplier_names, result.multipliers.T, strict=True
        )
    ]
    return "\n\n".join(
        [table(["force", "least", "greatest", "unit"], rows), *_notes(result)]
    )


def _notes(result: Result | Linearisation) -> list[str]:
    """Notes but the warnings, which are told before; one paragraph or none."""
    lines = [line for line in note_lines(result) if line[0] == "note"]
    return [named(lines)] if lines else []


def _pair(value: complex) -> list[float]:
    return [float(np.real(value)), float(np.imag(value))]
