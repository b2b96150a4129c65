"""Blades and towers of OpenFAST as tables of stations: ElastoDyn and BeamDyn files.

Axes: x along the blade to its tip, or up the tower. y is flapwise (out of the rotor
plane, downwind) or fore-aft, z is edgewise (towards the trailing edge) or side to side.
These are the axes z, x, y of both programs. Flapwise bending is therefore about the
axis z. The programs count twist about the opposite of their axis z (leading edge
upwind); it changes its sign.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.stations import MATRIX_ORDERS, StationTable
from sidtool.formats.storage.unreadable import unreadable_error

from ..mesh.deck_text import parse_numbers

#: Column of ElastoDyn -> own column, name of its factor in the file.
_BLADE = {
    "BlFract": ("fraction", None),
    "StrcTwst": ("twist", None),
    "BMassDen": ("mass_per_length", "AdjBlMs"),
    "FlpStff": ("EI_z", "AdjFlSt"),
    "EdgStff": ("EI_y", "AdjEdSt"),
    "GJStff": ("GJ", None),
    "EAStff": ("EA", None),
    "FlpIner": ("inertia_z", None),
    "EdgIner": ("inertia_y", None),
    "FlpcgOf": ("mass_y", None),
    "EdgcgOf": ("mass_z", None),
}
_TOWER = {
    "HtFract": ("fraction", None),
    "TMassDen": ("mass_per_length", "AdjTwMa"),
    "TwFAStif": ("EI_z", "AdjFASt"),
    "TwSSStif": ("EI_y", "AdjSSSt"),
    "TwGJStif": ("GJ", None),
    "TwEAStif": ("EA", None),
    "TwFAIner": ("inertia_z", None),
    "TwSSIner": ("inertia_y", None),
    "TwFAcgOf": ("mass_y", None),
    "TwSScgOf": ("mass_z", None),
}
_NEEDED = ("fraction", "mass_per_length", "EI_y", "EI_z")
#: Radius of gyration over the length, where a file has no axial stiffness and no rotary
#: inertia, for both.
_STIFF_RADIUS, _INERTIA_RADIUS = 1e-2, 1e-3


@dataclass(frozen=True)
class ImportedStations:
    """Stations of a file of another program.

    Attributes
    ----------
    table : the stations
    geometry : keys of the geometry of a model that the file determines
    notes : statements on values that the file lacks and columns that were not used
    """

    table: StationTable
    geometry: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_openfast(path: str | Path, length: float | None = None) -> ImportedStations:
    """Read an ElastoDyn blade or tower file, or a BeamDyn file.

    Parameters
    ----------
    length : of the blade or of the flexible part of the tower [m]; for files of
        ElastoDyn and for blade files of BeamDyn

    Raises
    ------
    InputError : the file is none of these, or is incomplete.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise unreadable_error(path, "a file of OpenFAST", error) from None
    try:
        if any(re.match(r"\s*kp_xr\b", line) for line in lines):
            return _read_beamdyn(lines, Path(path).parent)
        if any(re.search(r"\bstation_total\b", line) for line in lines):
            return _read_beamdyn_blade(lines, length)
        for heads in (_BLADE, _TOWER):
            first = next(iter(heads))
            if any(re.match(rf"\s*{first}\b", line) for line in lines):
                return _read_elastodyn(lines, heads, length)
    except InputError as error:
        raise error.located(path) from None
    raise InputError(
        "is no blade or tower of OpenFAST",
        source=path,
        expected="an ElastoDyn blade or tower file (columns BlFract or HtFract), or a "
        "BeamDyn file (kp_xr or station_total)",
    )


def _read_elastodyn(
    lines: Sequence[str], heads: dict[str, tuple[str, str | None]], length: float | None
) -> ImportedStations:
    first = next(iter(heads))
    start = next(k for k, line in enumerate(lines) if re.match(rf"\s*{first}\b", line))
    names = lines[start].split()
    announced = _count(lines, "NBlInpSt" if heads is _BLADE else "NTwInpSt", 0)
    rows = _rows(lines, start + 2, len(names), announced)
    columns: dict[str, Any] = {}
    unused = []
    for name, values in zip(names, rows.T, strict=True):
        if name not in heads:
            unused.append(name)
            continue
        own, factor = heads[name]
        scale = 1.0 if factor is None else _value(lines, factor, 1.0)
        if own == "twist":
            scale = -math.pi / 180
        columns[own] = scale * values
    if missing := [name for name in _NEEDED if name not in columns]:
        raise InputError(f"has no {', '.join(missing)}", expected=", ".join(heads))
    notes = _complete(columns, length)
    if unused:
        notes.append(f"columns without effect: {', '.join(unused)}")
    notes += _elastodyn_damping(lines)
    content: dict[str, Any] = {name: v.tolist() for name, v in columns.items()}
    table = StationTable(**content)
    return ImportedStations(table, straight_geometry(length), tuple(notes))


def _complete(columns: dict[str, Array], length: float | None) -> list[str]:
    """Add stiffness and inertia that ElastoDyn takes as rigid and as zero."""
    lacking = [name for name in ("EA", "GJ", "inertia_y") if name not in columns]
    if not lacking:
        return []
    if length is None:
        raise InputError(
            f"has no {' and '.join(lacking)}",
            place="--length",
            expected="the length of the beam in m, from which stiff values follow",
        )
    largest = np.maximum(columns["EI_y"], columns["EI_z"])
    notes = []
    if "EA" in lacking:
        columns["EA"] = largest / (_STIFF_RADIUS * length) ** 2
        notes.append("the file has no EA: nearly inextensible, EA = 1e4 EI / length^2")
    if "GJ" in lacking:
        columns["GJ"] = largest
        notes.append("the file has no GJ: GJ = EI")
    if "inertia_y" in lacking:
        inertia = columns["mass_per_length"] * (_INERTIA_RADIUS * length) ** 2
        columns["inertia_y"] = columns["inertia_z"] = inertia
        notes.append(
            "the file has no rotary inertia: nearly none, 1e-6 mass_per_length length^2"
        )
    return notes


def _elastodyn_damping(lines: Sequence[str]) -> list[str]:
    """A note on damping ratios of the modes of the file [%], which no table holds."""
    names = [f"Bld{a}Dmp({n})" for a in ("Fl", "Ed") for n in (1, 2)]
    names += [f"Twr{a}Dmp({n})" for a in ("FA", "SS") for n in (1, 2)]
    found = {name: _value(lines, name, 0.0) for name in names}
    given = [f"{name} = {value:g} %" for name, value in found.items() if value]
    ratio = max(found.values()) / 100.0
    remedy = f'damping = {{ type = "modal", ratio = {ratio:g} }} of the body in a scene'
    return [f"damping is not in the table: {', '.join(given)}; {remedy}"] * bool(given)


def _beamdyn_damping(lines: Sequence[str]) -> list[str]:
    """A note on damping proportional to the stiffness, which no table holds."""
    head = next(
        (k for k, line in enumerate(lines) if re.match(r"\s*mu1\b", line)), None
    )
    if head is None or not _value(lines, "damp_type", 1.0):
        return []
    for line in lines[head + 1 : head + 4]:
        try:
            factors = parse_numbers(line.split()[:6], "mu1")
        except InputError:
            continue
        if len(factors) == 6 and any(factors):
            text = ", ".join(f"{mu:g}" for mu in factors)
            law = f"alpha = 0.0, beta = {np.mean(factors):g}"
            remedy = f'damping = {{ type = "rayleigh", {law} }} of the model'
            return [f"damping is not in the table: mu = {text} s; {remedy}"]
    return []


def _read_beamdyn(lines: Sequence[str], folder: Path) -> ImportedStations:
    """A primary file: reference axis, initial twist, and its blade file."""
    members = _count(lines, "member_total", 1)
    if members != 1:
        raise InputError(f"has {members} members", expected="one member")
    start = next(k for k, line in enumerate(lines) if re.match(r"\s*kp_xr\b", line))
    points = _rows(lines, start + 2, 4, _count(lines, "kp_total", 0))
    named = next((line for line in lines if re.search(r"\bBldFile\b", line)), "")
    match = re.match(r"\s*[\"']?([^\"']+?)[\"']?\s+BldFile", named)
    if match is None:
        raise InputError("names no blade file", expected="a line with BldFile")
    path = folder / match[1]
    try:
        blade = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise unreadable_error(path, "the blade file of BeamDyn", error) from None
    found = _read_beamdyn_blade(blade, None)
    steps = np.linalg.norm(np.diff(points[:, :3], axis=0), axis=1)
    covered = np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps)
    table = _twisted(found.table, covered, -np.radians(points[:, 3]))
    return ImportedStations(table, _curved_geometry(points[:, :3]), found.notes)


def _twisted(table: StationTable, at: Array, twist: Array) -> StationTable:
    """The table with a twist that is linear between its values at fractions `at`.

    These become stations, too, where the twist changes its slope.
    """
    fractions = np.array(table.fraction)
    slopes = np.diff(twist) / np.diff(at)
    bends = at[1:-1][np.abs(np.diff(slopes)) > 1e-9]
    further = [x for x in bends if np.abs(fractions - x).min() > 1e-9]
    order = np.argsort(np.concatenate([fractions, further]), kind="stable")
    data: dict[str, Any] = {}
    for name in ("stiffness", "mass"):
        values = np.array(getattr(table, name))
        rows = values.reshape(len(fractions), -1).T
        added = np.array([np.interp(further, fractions, row) for row in rows]).T
        joined = np.concatenate([values, added.reshape(-1, 6, 6)])
        data[name] = joined[order].tolist()
    places = np.concatenate([fractions, further])[order]
    data |= {"fraction": places.tolist(), "twist": np.interp(places, at, twist)}
    return StationTable(**data)


def _read_beamdyn_blade(lines: Sequence[str], length: float | None) -> ImportedStations:
    """Stations with 6 x 6 matrices; z along the blade, forces before moments."""
    count = _count(lines, "station_total", 0)
    start = next(
        (k for k, line in enumerate(lines) if "istributed" in line.lower()), len(lines)
    )
    numbered = enumerate(lines[start + 1 :], start + 2)
    words = [(word, k) for k, line in numbered for word in line.split()]
    values = np.array(
        [parse_numbers([word], f"line {k}")[0] for word, k in words[: 73 * count]]
    )
    if not count or len(values) != 73 * count:
        raise InputError(
            f"has {len(values) / 73:.3g} stations",
            place="Distributed Properties",
            expected=f"{count} of 73 numbers, as station_total says",
        )
    blocks = values.reshape(count, 73)
    rows = np.array(MATRIX_ORDERS["beamdyn"])
    matrices = blocks[:, 1:].reshape(count, 2, 6, 6)[:, :, rows][..., rows]
    table = StationTable(
        fraction=blocks[:, 0].tolist(),
        stiffness=matrices[:, 0].tolist(),
        mass=matrices[:, 1].tolist(),
    )
    notes = tuple(_beamdyn_damping(lines))
    return ImportedStations(table, straight_geometry(length), notes)


def _rows(lines: Sequence[str], start: int, count: int, announced: int) -> Array:
    """Rows of numbers from a line on.

    Parameters
    ----------
    announced : number of rows; 0 for all up to the first line that is none

    Raises
    ------
    InputError : there are fewer rows.
    """
    rows: list[list[float]] = []
    end = start + announced if announced else None
    for k, line in enumerate(lines[start:end], start + 1):
        try:
            row = parse_numbers(line.split()[:count], f"line {k}")
        except InputError:
            if announced:
                raise
            break
        if len(row) != count:
            break
        rows.append(row)
    if len(rows) < max(announced, 2):
        raise InputError(
            f"has {len(rows)} stations",
            place=f"line {start + 1 + len(rows)}",
            expected=f"{announced or 'two or more'} rows of {count} numbers",
        )
    return np.array(rows)


def _count(lines: Sequence[str], name: str, default: int) -> int:
    """The integer before a name."""
    value = _value(lines, name, float(default))
    if not value.is_integer():
        raise InputError(f"found {value:g}", place=name, expected="an integer")
    return int(value)


def _value(lines: Sequence[str], name: str, default: float) -> float:
    """The number before a name, as in `1.04536  AdjBlMs - Factor ...`."""
    for k, line in enumerate(lines, 1):
        words = line.split()
        if len(words) > 1 and words[1] == name:
            return parse_numbers(words[:1], f"line {k}, {name}", "a number")[0]
    return default


def straight_geometry(length: float | None) -> dict[str, Any]:
    """A beam along z of OpenFAST, y axis of the section along its x."""
    if length is None:
        return {}
    return {
        "type": "beam",
        "start": [0.0, 0.0, 0.0],
        "end": [0.0, 0.0, length],
        "y_axis": [1.0, 0.0, 0.0],
    }


def _curved_geometry(points: Array) -> dict[str, Any]:
    length = float(np.linalg.norm(points[-1] - points[0]))
    chord = (points[-1] - points[0]) / length
    arms = points - points[0]
    across = np.linalg.norm(arms - np.outer(arms @ chord, chord), axis=1)
    geometry = {
        "type": "beam",
        "start": points[0].tolist(),
        "end": points[-1].tolist(),
        "y_axis": [1.0, 0.0, 0.0],
    }
    if across.max() > 1e-9 * length:
        geometry["through"] = points[1:-1].tolist()
    return geometry
