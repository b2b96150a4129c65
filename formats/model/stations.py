"""Cross-sections of a beam by stations: a table of stiffness and mass over the axis."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import model_validator

from ..base.errors import InputError
from ..base.numbers import real_of_text
from ..base.units import Exponents, parse_unit
from ..storage.atomic import atomic_path
from ..storage.unreadable import read_text
from ..toml.messages import nearest_key
from ..toml.tables import Field, Numbers, OptionalNumbers, Table

Row = tuple[float, ...]
Matrix = tuple[Row, ...]

#: Start of the first comment of a file that `write_stations` writes.
STATIONS_MARK = "sidtool stations of a beam"
#: Column -> exponents of metre, kilogram, second, radian of its unit.
COLUMNS: dict[str, Exponents] = {
    "position": (1, 0, 0, 0),
    "mass_per_length": (-1, 1, 0, 0),
    "EA": (1, 1, -2, 0),
    "EI_y": (3, 1, -2, 0),
    "EI_z": (3, 1, -2, 0),
    "GJ": (3, 1, -2, 0),
    "GA_y": (1, 1, -2, 0),
    "GA_z": (1, 1, -2, 0),
    "twist": (0, 0, 0, 1),
    "mass_y": (1, 0, 0, 0),
    "mass_z": (1, 0, 0, 0),
    "tension_y": (1, 0, 0, 0),
    "tension_z": (1, 0, 0, 0),
    "shear_y": (1, 0, 0, 0),
    "shear_z": (1, 0, 0, 0),
    "inertia_y": (1, 1, 0, 0),
    "inertia_z": (1, 1, 0, 0),
    "inertia_yz": (1, 1, 0, 0),
}
NEEDED = ("position", "mass_per_length", "EA", "EI_y", "EI_z", "GJ")
_MATRIX_NEEDED = ("position", "stiffness", "mass")
#: Columns that are above zero at every station.
_POSITIVE = ("mass_per_length", "EA", "EI_y", "EI_z", "GJ", "GA_y", "GA_z")
_SI_UNITS = {
    (1, 0, 0, 0): "m",
    (-1, 1, 0, 0): "kg/m",
    (1, 1, -2, 0): "N",
    (2, 1, -2, 0): "N m",
    (3, 1, -2, 0): "N m^2",
    (0, 1, 0, 0): "kg",
    (1, 1, 0, 0): "kg m",
    (0, 0, 0, 1): "rad",
}
_HEADER = re.compile(r"\s*([A-Za-z]\w*)\s*(?:[\[(](.*)[\])])?\s*")
_ENTRY = re.compile(r"([KM])([1-6])([1-6])")
#: Exponents of metre and second of entries between forces, of K and M.
_ENTRY_EXPONENTS = {"K": (1, -2), "M": (-1, 0)}
#: Positions with this unit are fractions of the length.
_FRACTION = {"", "-", "1", "%"}
#: Rows and columns of a matrix of another program, in the order N, Vy, Vz, T, My, Mz.
MATRIX_ORDERS: dict[str, tuple[int, ...]] = {
    "sidtool": (0, 1, 2, 3, 4, 5),
    "vabs": (0, 1, 2, 3, 4, 5),
    "beamdyn": (2, 0, 1, 5, 3, 4),
    "hawc2": (2, 0, 1, 5, 3, 4),
    "becas": (2, 0, 1, 5, 3, 4),
}


class StationTable(Table):
    """Cross-sections at stations along a beam, linear between them.

    Lists with one entry per station, or the name of a CSV `file` with the same columns.
    Two stations at one position are a step. Give either the columns from
    `mass_per_length` on, or `stiffness` and `mass`.

    Attributes
    ----------
    file : CSV file; a header names the columns and units, as in `EI_y [N m^2]`
    position : along the axis from its start [m], from 0 to the length of the axis
    fraction : instead of `position`, from 0 to 1
    mass_per_length : [kg/m]
    EA : axial stiffness [N]
    EI_y, EI_z : bending stiffness about the section axes y and z through the centre of
        tension [N m^2]
    GJ : torsional stiffness [N m^2]
    GA_y, GA_z : shear stiffness along y and z, shear coefficients included [N]
    twist : angle of the section axes about the tangent from y to z [rad]
    mass_y, mass_z : centre of mass in section axes, from the axis of the beam [m]
    tension_y, tension_z : centre of tension (neutral axis) [m]
    shear_y, shear_z : shear centre [m]
    inertia_y, inertia_z : mass moments of inertia per length about the axes y and z
        through the centre of mass [kg m]; by default mass_per_length EI / EA
    inertia_yz : product of inertia per length, the integral of y z dm [kg m]
    stiffness : 6 x 6 matrices about the axis of the beam [N, N m, N m^2]
    mass : 6 x 6 matrices per length about the axis of the beam [kg/m, kg, kg m]
    order : rows of the matrices: N, Vy, Vz, T, My, Mz with x along the beam (`sidtool`
        and `vabs`), or forces, then moments, with z along it (the others)
    """

    file: str | None = None
    position: OptionalNumbers = Field(default=None, min_length=2)
    fraction: OptionalNumbers = Field(default=None, min_length=2)
    mass_per_length: Numbers = Field(default=())
    EA: Numbers = Field(default=())
    EI_y: Numbers = Field(default=())
    EI_z: Numbers = Field(default=())
    GJ: Numbers = Field(default=())
    GA_y: Numbers = Field(default=())
    GA_z: Numbers = Field(default=())
    twist: Numbers = Field(default=())
    mass_y: Numbers = Field(default=())
    mass_z: Numbers = Field(default=())
    tension_y: Numbers = Field(default=())
    tension_z: Numbers = Field(default=())
    shear_y: Numbers = Field(default=())
    shear_z: Numbers = Field(default=())
    inertia_y: Numbers = Field(default=())
    inertia_z: Numbers = Field(default=())
    inertia_yz: Numbers = Field(default=())
    stiffness: tuple[Matrix, ...] = ()
    mass: tuple[Matrix, ...] = ()
    order: Literal["sidtool", "vabs", "beamdyn", "hawc2", "becas"] = "sidtool"

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.file is not None:
            self._check_file_alone()
            return self
        place = "geometry.sections"
        where = [n for n in ("position", "fraction") if getattr(self, n) is not None]
        if len(where) != 1:
            raise InputError(
                f"gives {' and '.join(where) or 'neither position nor fraction'}",
                place=place,
                expected="one of position and fraction, or a file",
            )
        stations = getattr(self, where[0])
        self._check_columns(len(stations), place)
        if any(b < a for a, b in zip(stations, stations[1:], strict=False)):
            raise InputError(
                "decreases", place=f"{place}.{where[0]}", expected="ascending stations"
            )
        if stations[0] != 0 or (where == ["fraction"] and stations[-1] != 1):
            raise InputError(
                f"runs from {stations[0]:g} to {stations[-1]:g}",
                place=f"{place}.{where[0]}",
                expected="stations from the start to the end of the beam",
            )
        return self

    def _check_file_alone(self) -> None:
        also = [n for n in self.model_fields_set if n not in ("file", "order")]
        if also:
            raise InputError(
                f"is given beside {also[0]}",
                place="geometry.sections.file",
                expected="a file, or the columns themselves",
            )

    def _check_columns(self, count: int, place: str) -> None:
        by_matrices = bool(self.stiffness or self.mass)
        needed = _MATRIX_NEEDED[1:] if by_matrices else NEEDED[1:]
        missing = [name for name in needed if not getattr(self, name)]
        if missing:
            raise InputError(
                f"has no {', '.join(missing)}", place=place, expected="these columns"
            )
        columns = [name for name in COLUMNS if name != "position"]
        for name in (*columns, "stiffness", "mass"):
            values = getattr(self, name) or ()
            if values and len(values) != count:
                raise InputError(
                    f"has {len(values)} entries",
                    place=f"{place}.{name}",
                    expected=f"{count}, one per station",
                )
            if values and by_matrices and name not in ("twist", "stiffness", "mass"):
                raise InputError(
                    "is given beside matrices",
                    place=f"{place}.{name}",
                    expected="matrices and a twist, or the other columns",
                )
            if name in _POSITIVE and values and min(values) <= 0:
                raise InputError(
                    f"is {min(values):g} at a station",
                    place=f"{place}.{name}",
                    expected="values above zero",
                )
        for name in ("stiffness", "mass"):
            for k, matrix in enumerate(getattr(self, name)):
                if len(matrix) != 6 or any(len(row) != 6 for row in matrix):
                    raise InputError(
                        "is no 6 x 6 matrix",
                        place=f"{place}.{name}[{k}]",
                        expected="six rows of six numbers",
                    )
        if bool(self.GA_y) != bool(self.GA_z):
            raise InputError(
                "is given without the other one",
                place=f"{place}.{'GA_y' if self.GA_y else 'GA_z'}",
                expected="GA_y and GA_z, or neither",
            )


def read_stations(path: str | Path, order: str = "sidtool") -> StationTable:
    """Read a CSV file of stations.

    The first line that is no comment (#) is the header: names of `StationTable` with
    units in brackets, SI units where there are none. A position in `1`, `-` or `%` is a
    fraction of the length. `K11` to `K66` and `M11` to `M66` are entries of matrices,
    of which those above the diagonal suffice.

    Raises
    ------
    InputError : the file cannot be read, or a column, unit or number is wrong.
    """
    text = read_text(path, "a table of stations (CSV)")
    try:
        data = _columns_of(text)
        data["order"] = order
        return StationTable.checked(data, path)
    except InputError as error:
        column = (error.place or "").removeprefix("geometry.sections").lstrip(".")
        error.place = column or None
        raise error.located(path) from None


def _columns_of(text: str) -> dict[str, Any]:
    lines = [line for line in text.splitlines() if line.strip()]
    lines = [line for line in lines if not line.lstrip().startswith("#")]
    if len(lines) < 3:
        raise InputError(
            f"has {max(len(lines) - 1, 0)} stations",
            expected="a header and at least two rows",
        )
    separator = next((c for c in ";\t" if c in lines[0]), ",")
    header, *rows = csv.reader(lines, delimiter=separator)
    numbers = [_numbers_of_row(row, len(header)) for row in rows]
    data: dict[str, Any] = {}
    entries: dict[str, Row] = {}
    for k, cell in enumerate(header):
        values = tuple(row[k] for row in numbers)
        name, unit = _column_name(cell)
        if name in data or name in entries:
            raise InputError("appears twice", place=name, expected="one column")
        entry = _ENTRY.fullmatch(name)
        if entry:
            metres, seconds = _ENTRY_EXPONENTS[entry[1]]
            metres += sum(int(index) > 3 for index in entry.groups()[1:])
            factor = _unit_factor(unit, (metres, 1, seconds, 0), cell) if unit else 1.0
            entries[name] = tuple(factor * value for value in values)
        elif name == "position" and unit in _FRACTION:
            scale = 0.01 if unit == "%" else 1.0
            data["fraction"] = [scale * value for value in values]
        else:
            factor = _unit_factor(unit, COLUMNS[name], cell) if unit else 1.0
            data[name] = [factor * value for value in values]
    for letter, key in (("K", "stiffness"), ("M", "mass")):
        own = {name: values for name, values in entries.items() if name[0] == letter}
        if own:
            data[key] = _matrices(own, len(rows))
    return data


def _numbers_of_row(row: list[str], count: int) -> Row:
    if len(row) != count:
        raise InputError(
            f"has {len(row)} cells",
            place=f"row {','.join(row)[:40]}",
            expected=f"{count}, as the header has",
        )
    values = []
    for cell in row:
        try:
            values.append(real_of_text(cell))
        except ValueError:
            raise InputError(
                f"found {cell.strip()!r}",
                place=f"row {','.join(row)[:40]}",
                expected="a number with a decimal point",
            ) from None
    return tuple(values)


def _column_name(cell: str) -> tuple[str, str]:
    match = _HEADER.fullmatch(cell)
    name = match[1] if match else cell.strip()
    by_lower = {known.lower(): known for known in COLUMNS}
    known = by_lower.get(name.lower())
    if match and known:
        unit = (match[2] or "").strip()
        if known == "position" and match[2] is None:
            unit = "m"
        return known, unit
    if match and _ENTRY.fullmatch(name):
        return name, (match[2] or "").strip()
    raise InputError(
        "is no column of stations",
        place=cell.strip(),
        expected=nearest_key(name, list(COLUMNS)),
    )


def _unit_factor(text: str, wanted: Exponents, cell: str) -> float:
    """Return the value of a unit in SI units."""
    unit = parse_unit(text)
    if unit is None or unit.exponents != wanted:
        raise InputError(
            f"has the unit {text!r}",
            place=cell.strip(),
            expected=f"a unit such as {_SI_UNITS[wanted]}",
        )
    return unit.factor


def _matrices(entries: dict[str, Row], count: int) -> list[list[list[float]]]:
    result = [[[0.0] * 6 for _ in range(6)] for _ in range(count)]
    for name, values in entries.items():
        i, j = int(name[1]) - 1, int(name[2]) - 1
        mirrored = f"{name[0]}{j + 1}{i + 1}" not in entries
        for k, value in enumerate(values):
            result[k][i][j] = value
            if mirrored:
                result[k][j][i] = value
    return result


def write_stations(
    path: str | Path, table: StationTable, comments: Sequence[str]
) -> None:
    """Write a table of stations as CSV, see `read_stations`, matrices in own order.

    Parameters
    ----------
    comments : lines at the top, after the one that names the kind of the file

    Raises
    ------
    OSError : the file cannot be written.
    """
    columns: dict[str, Row] = {}
    if table.fraction is not None:
        columns["position [1]"] = table.fraction
    elif table.position is not None:
        columns["position [m]"] = table.position
    for name, exponents in COLUMNS.items():
        values = getattr(table, name)
        if name != "position" and values:
            columns[f"{name} [{_SI_UNITS[exponents]}]"] = values
    rows = MATRIX_ORDERS[table.order]
    for letter, matrices in (("K", table.stiffness), ("M", table.mass)):
        for i in range(6):
            for j in range(i, 6):
                entries = tuple(matrix[rows[i]][rows[j]] for matrix in matrices)
                if any(entries):
                    columns[f"{letter}{i + 1}{j + 1}"] = entries
    lines = [f"# {line}" for line in (STATIONS_MARK, *comments)]
    lines.append(",".join(columns))
    lines += [",".join(map(repr, row)) for row in zip(*columns.values(), strict=True)]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
