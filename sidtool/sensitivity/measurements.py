"""Measured outputs: tables of times and values."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text
from sidtool.formats.base.sid import Array
from sidtool.formats.base.units import column_factor, is_known_unit, split_unit
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.diagnostics.record import warn_of
from sidtool.formats.scene.units import unit_of


@dataclass(frozen=True)
class Measurement:
    """A measured time history.

    Attributes
    ----------
    times, values : (n,)
    """

    times: Array
    values: Array


def read_measurements(path: Path) -> dict[str, Measurement]:
    """Read measured outputs from a table (CSV): `t` and a column for each output.

    Units in brackets behind a name are converted to SI, empty cells are left out.

    Raises
    ------
    InputError : the file cannot be read, or holds something else; or a unit does not
        fit its output.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            numbered = [(reader.line_num, row) for row in reader if row]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", source=path) from None
    heads = [split_unit(name) for name in numbered[0][1]] if numbered else []
    names = [name for name, _ in heads]
    if names[:1] != ["t"] or len(names) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"has the columns {', '.join(names) or 'none'}",
            source=path,
            expected="t, then outputs of the scene, each once",
        )
    numbers = []
    for line, row in numbered[1:]:
        try:
            numbers.append([_number(cell) for cell in row])
        except ValueError:
            numbers.append([])
        if len(numbers[-1]) != len(names):
            raise InputError(
                f"found {','.join(row)[:40]!r}",
                source=path,
                place=f"line {line}",
                expected=f"{len(names)} numbers; empty cells are left out",
            )
    table = np.array(numbers, float).reshape(-1, len(names))
    for name, unit in heads:
        if not is_known_unit(unit):
            warn_of(diagnose("N245", f"{path.name}, {name}", unit=unit))
    try:
        table *= [_unit_factor(name, unit) for name, unit in heads]
        columns = dict(zip(names[1:], table[:, 1:].T, strict=True))
        return as_measurements(table[:, 0], columns)
    except InputError as error:
        raise error.located(path) from None


def _number(cell: str) -> float:
    """The number of a cell, NaN of an empty one and of the word nan."""
    text = cell.strip()
    return np.nan if text.lower() in ("", "nan") else real_of_text(text)


def _unit_factor(name: str, unit: str) -> float:
    try:
        wanted = "s" if name == "t" else unit_of(name)
    except InputError:
        wanted = ""  # the only column of a file may have any name
    try:
        return column_factor(unit, wanted)
    except InputError as error:
        error.place = f"column {name}"
        raise


def as_measurements(
    times: Array, outputs: Mapping[str, Array]
) -> dict[str, Measurement]:
    """Measurements of some outputs at common times; values that are NaN are left out.

    Raises
    ------
    InputError : times do not increase, or an output has no values.
    """
    found = {}
    for name, values in outputs.items():
        if values.shape != times.shape:
            raise InputError(
                f"{name} has {values.size} values",
                expected=f"{times.size}, one for each time",
            )
        known = np.isfinite(values) & np.isfinite(times)
        if not known.any() or (np.diff(times[known]) < 0.0).any():
            raise InputError(
                f"{name} has no values at times that increase",
                expected="a row per time",
            )
        found[name] = Measurement(times[known], values[known])
    return found
