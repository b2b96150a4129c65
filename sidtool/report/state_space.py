"""State spaces and frequency responses as text, as data and as files."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.file_names import check_ending
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.text import counted_noun

from .diagnostics import severity_counts
from .json_data import write_json
from .result import plain_notes
from .tables import name_with_unit, named_values, text_table, title_line

if TYPE_CHECKING:
    from sidtool.solver.analyses.frequency_response import FrequencyResponse, Peak
    from sidtool.solver.analyses.state_space import StateSpace

FORMAT = "sidtool state space"
RESPONSE_FORMAT = "sidtool frequency response"
#: First column of a table of a frequency response.
FREQUENCY_COLUMN = "frequency [Hz]"
#: Eigenvalues below this part of the largest one are printed as zero: those of rigid
#: motions are double, so that rounding moves them by its square root.
_ROUNDING = 1e-8
#: Eigenvalues and state rates in a printed table.
MAX_LISTED = 12
#: Real parts below this share of an eigenvalue are printed as zero.
_NO_DAMPING = 1e-12
#: Operating points by their option.
_POINTS = {"static": "the static equilibrium", "start": "the initial state"}

#: Header of `peak_rows`.
PEAK_COLUMNS = ("output", "Hz", "magnitude", "unit", "mode Hz", "damping ratio")


def describe_state_space(space: StateSpace) -> str:
    """Describe a state space: its operating point, states, inputs, outputs,
    eigenvalues and notes.
    """
    about = space.about
    point = _POINTS.get(
        str(about),
        f"t = {about:.9g} s of a run" if isinstance(about, float) else str(about),
    )
    frozen = "" if space.is_steady else " (frozen)"
    counts = {
        "state": len(space.A),
        "input": len(space.input_names),
        "output": len(space.output_names),
    }
    sizes = ", ".join(counted_noun(count, noun) for noun, count in counts.items())
    entries = [("size", sizes), ("diagnostics", severity_counts(space.diagnostics))]
    title = title_line(space.title, f"linearised about {point}{frozen}")
    parts: list[str] = [f"{title}\n{named_values(entries)}"]
    header = ["", "name", "unit", "at the operating point"]
    rows = [
        [kind, name, unit or "-", f"{value:.6g}"]
        for kind, names, units, values in (
            ("u", space.input_names, space.input_units, space.inputs),
            ("y", space.output_names, space.output_units, space.outputs),
        )
        for name, unit, value in zip(names, units, values, strict=True)
    ]
    states = [
        ["x", name, unit or "-", "-" if space.is_steady else f"rate {rate:.6g}"]
        for name, unit, rate in zip(
            space.state_names, space.state_units, space.state_rates, strict=True
        )
    ]
    parts.append(text_table(header, _shortened(states) + _shortened(rows)))
    values = space.eigenvalues
    values = values[values.imag >= 0.0]
    rounding = _ROUNDING * np.abs(values).max(initial=0.0)
    values = np.where(np.abs(values) > rounding, values, 0.0)
    undamped = np.abs(values.real) < _NO_DAMPING * np.abs(values)
    values = np.where(undamped, 1j * values.imag, values)
    table = [[f"{v.real:.6g}", f"{v.imag:.6g}", *_frequency_texts(v)] for v in values]
    parts.append(
        text_table(
            ["eigenvalue [1/s]", "imaginary", "Hz", "damping ratio"], _shortened(table)
        )
    )
    parts += plain_notes(space)
    return "\n\n".join(parts)


def _shortened(rows: list[list[str]]) -> list[list[str]]:
    if len(rows) <= MAX_LISTED:
        return rows
    more = f"... {len(rows) - MAX_LISTED} more"
    return [*rows[:MAX_LISTED], ["", more, *[""] * (len(rows[0]) - 2)]]


def _frequency_texts(value: complex) -> tuple[str, str]:
    size = abs(value)
    hertz = f"{size / (2.0 * math.pi):.6g}" if value.imag else "-"
    return hertz, f"{-value.real / size + 0.0:.4g}" if size else "-"


def state_space_arrays(space: StateSpace) -> dict[str, Any]:
    """Return matrices, names, units and operating point by the names of files."""
    found: dict[str, Any] = {}  # names first: a file begins with them
    for part in ("state", "input", "output"):
        found[f"{part}_names"] = getattr(space, f"{part}_names")
        found[f"{part}_units"] = getattr(space, f"{part}_units")
    found |= {name: getattr(space, name) for name in "ABCD"}
    found |= {
        "operating_inputs": space.inputs,
        "operating_outputs": space.outputs,
        "operating_rates": space.state_rates,
        "operating_positions": space.positions,
        "operating_velocities": space.velocities,
    }
    found["second_order"] = dict(vars(space.second_order))
    if space.descriptor is not None:
        found["descriptor"] = dict(vars(space.descriptor))
    return found


def state_space_data(space: StateSpace) -> dict[str, Any]:
    """Return a state space as data for JSON."""
    return {
        "format": FORMAT,
        "version": 1,
        "title": space.title,
        "about": space.about,
        "time": space.time,
        "is_steady": space.is_steady,
        **state_space_arrays(space),
        "diagnostics": [each.as_data() for each in space.diagnostics],
    }


def write_state_space(path: str | Path, space: StateSpace) -> None:
    """Write a state space: ``.npz`` for NumPy, ``.mat`` for MATLAB, ``.json``.

    Raises
    ------
    InputError : the file cannot be written, or has another ending.
    """
    path = Path(path)
    check_ending(path, "state_space")
    ending = path.suffix.lower()
    if ending == ".json":
        write_json(path, state_space_data(space))
        return
    content = state_space_arrays(space)
    content |= {"title": space.title, "about": str(space.about)}
    content |= {"time": space.time, "is_steady": space.is_steady}
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        if ending == ".npz":
            np.savez(stream, **_flattened(content))
        else:
            from scipy.io import savemat

            savemat(stream, _for_matlab(content))


def _flattened(content: Mapping[str, Any]) -> dict[str, Any]:
    """Tables in one level, `second_order_M`; texts as arrays that need no pickle."""
    flat: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}_{key}": part for key, part in _flattened(value).items()}
        else:
            flat[name] = np.array(value, str) if isinstance(value, tuple) else value
    return flat


def _for_matlab(content: Mapping[str, Any]) -> dict[str, Any]:
    """Names as cell arrays, vectors as columns."""
    found: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            found[name] = _for_matlab(value)
        elif isinstance(value, tuple):
            cells = np.empty((len(value), 1), object)
            cells[:, 0] = value
            found[name] = cells
        elif isinstance(value, np.ndarray) and value.ndim == 1:
            found[name] = value[:, None]
        else:
            found[name] = value
    return found


def describe_response(response: FrequencyResponse) -> str:
    """Describe a frequency response: its range and its peaks with their modes."""
    span = f"{response.frequencies.min():.6g} to {response.frequencies.max():.6g} Hz"
    parts: list[str] = [
        named_values(
            [
                ("from", response.excitation),
                ("frequencies", f"{len(response.frequencies)}, {span}"),
                ("peaks", str(len(response.peaks)) if response.peaks else "none"),
            ]
        )
    ]
    if response.peaks:
        parts.append(text_table(PEAK_COLUMNS, map(list, peak_rows(response))))
    return "\n\n".join(parts)


def peak_rows(response: FrequencyResponse) -> list[tuple[str, ...]]:
    """Return output, frequency, magnitude, unit, and mode with its damping, by peak."""
    units = dict(zip(response.output_names, response.units, strict=True))
    return [
        (
            peak.output,
            f"{peak.frequency:.6g}",
            f"{peak.magnitude:.6g}" if math.isfinite(peak.magnitude) else "unbounded",
            units[peak.output] or "-",
            *_mode_texts(peak),
        )
        for peak in response.peaks
    ]


def _mode_texts(peak: Peak) -> tuple[str, str]:
    if not math.isfinite(peak.mode_frequency):
        return "-", "-"
    return f"{peak.mode_frequency:.6g}", f"{peak.damping_ratio:.4g}"


def response_data(response: FrequencyResponse) -> dict[str, Any]:
    """Return a frequency response as data for JSON."""
    return {
        "format": RESPONSE_FORMAT,
        "version": 1,
        "title": response.title,
        "excitation": response.excitation,
        "frequencies": response.frequencies,
        "outputs": {
            name: {
                "unit": unit,
                "real": values.real,
                "imaginary": values.imag,
                "magnitude": np.abs(values),
                "phase": phase,
            }
            for name, unit, values, phase in zip(
                response.output_names,
                response.units,
                response.values.T,
                response.phase.T,
                strict=True,
            )
        },
        "peaks": [
            {
                "output": peak.output,
                "frequency": peak.frequency,
                "magnitude": peak.magnitude,
                "mode_frequency": peak.mode_frequency,
                "damping_ratio": peak.damping_ratio,
            }
            for peak in response.peaks
        ],
    }


def write_response(path: str | Path, response: FrequencyResponse) -> None:
    """Write a frequency response: ``.csv``, ``.json`` or a picture.

    Raises
    ------
    InputError : the file cannot be written, or has another ending.
    """
    path = Path(path)
    check_ending(path, "response")
    if path.suffix.lower() == ".json":
        write_json(path, response_data(response))
        return
    header = [FREQUENCY_COLUMN]
    for name, unit in zip(response.output_names, response.units, strict=True):
        header += [name_with_unit(name, unit), f"{name} phase [deg]"]
    columns = [response.frequencies]
    degrees = np.degrees(response.phase)
    for k in range(len(response.output_names)):
        columns += [response.magnitude[:, k], degrees[:, k]]
    with (
        atomic_path(path) as temporary,
        open(temporary, "w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        for row in np.column_stack(columns):
            writer.writerow([repr(float(value)) for value in row])


def sizes_text(space: StateSpace) -> str:
    """Return numbers of states, inputs and outputs in words."""
    return ", ".join(
        counted_noun(len(names), word)
        for names, word in (
            (space.state_names, "state"),
            (space.input_names, "input"),
            (space.output_names, "output"),
        )
    )
