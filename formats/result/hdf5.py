"""Results in HDF5.

Attributes of the root: format, format_version, title, completed, message. Datasets: t,
values, positions, velocities, multipliers, the names of the columns of each of the
latter four in names/values, ..., units of outputs in units/values; diagnostics, a table
of `Diagnostic`; notes and warnings, the same as texts; scene (JSON text).
Groups counters, drift, settings and versions hold their entries as attributes; group
bodies/NAME for each flexible body; group events, see `Event`; group sids: the SIDs of
all bodies that have one, equal ones once. Dataset accuracy: an `AccuracyReport` as
JSON, if there is one.
Version 1 held all lists as attributes, the names as attribute of each table.
The file has a check sum, see `storage/hdf5_files.py`.

Outputs of a result as a table of text (CSV), with their units.
"""

import csv
import io
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..base.errors import InputError
from ..base.sid import SID
from ..diagnostics import INFO, WARNING, Diagnostic, plain_text
from ..diagnostics.hdf5 import read_diagnostics, write_diagnostics
from ..file_names import check_ending
from ..geometric_stiffening import LoadStiffening
from ..scene import SceneFile, unit_of
from ..sid_files import SidReader, write_sid_group
from ..storage.atomic import GrowingFile
from ..storage.hdf5_files import (
    SealedFile,
    check_contents,
    check_finite,
    check_seal,
    put_texts,
    read_texts,
)
from ..storage.unreadable import unreadable_error
from ..toml.reading import validate_data
from .accuracy_report import AccuracyReport, Excitation, FlexibleBody
from .data import (
    ROWS_PER_BLOCK,
    TABLES,
    Columns,
    Result,
    Rows,
    read_events,
    write_events,
    write_rows,
)

FORMAT = "sidtool result"
VERSION = 2
READABLE = (1, 2)
#: Numbers that are stored together, so that a chunk fits into the cache of libhdf5.
CHUNK = 1 << 17
_GROUPS = ("counters", "drift", "settings", "versions")
_UNITS = "t: s; other quantities in SI units, angles in radians"
_PARTS = {"excitation": Excitation, "expected": LoadStiffening, "found": LoadStiffening}


class TableFile:
    """A header ``t,NAME,...`` and one row per output time, written during a run.

    Numbers are written so that reading them gives the same double back. The file
    exists after `finish`, and not after `discard`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """

    def __init__(self, path: str | Path, use_fallback_folder: bool = False) -> None:
        check_ending(path, "table")
        self.file: GrowingFile | None = None
        self._path, self._use_fallback_folder = path, use_fallback_folder

    def begin(self, columns: Columns, most: int) -> None:
        self.file = GrowingFile(self._path, self._use_fallback_folder)
        self._write([["t", *columns["values"]]])

    def add(self, rows: Rows) -> None:
        values = rows.tables["values"].tolist()
        self._write(
            [repr(time), *map(repr, row)]
            for time, row in zip(rows.t.tolist(), values, strict=True)
        )

    def finish(self, result: Result) -> None:
        assert self.file is not None
        self.file.close()

    def discard(self) -> None:
        if self.file is not None:
            self.file.discard()

    def _write(self, lines: Iterable[list[Any]]) -> None:
        assert self.file is not None
        text = io.StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows(lines)
        self.file.write(text.getvalue().encode())
        self.file.check()


def write_csv(path: str | Path, result: Result) -> None:
    """Write outputs as text, see `TableFile`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """
    table = TableFile(path)
    try:
        write_rows(result, table)
    except BaseException:
        table.discard()
        raise


def units_in(result: Result) -> Callable[[str], str]:
    """The unit of an output of this result by its name, see `unit_of`."""
    return partial(unit_of, scene=lambda: _scene_of(result.scene))


@lru_cache(maxsize=8)
def _scene_of(text: str) -> SceneFile | None:
    try:
        return validate_data(json.loads(text), SceneFile)
    except (ValueError, InputError):
        return None


class ResultFile:
    """A result file that is written during a run.

    The file exists after `finish`, and not after `discard`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """

    def __init__(self, path: str | Path, use_fallback_folder: bool = False) -> None:
        check_ending(path, "result")
        self._path, self._use_fallback_folder = path, use_fallback_folder
        self._sealed: SealedFile | None = None

    @property
    def file(self) -> GrowingFile | None:
        return None if self._sealed is None else self._sealed.target

    def begin(self, columns: Columns, most: int) -> None:
        def fill(file: h5py.File) -> None:
            rows = min(ROWS_PER_BLOCK, max(most, 1))
            file.create_dataset("t", (0,), float, maxshape=(None,), chunks=(rows,))
            for table, names in columns.items():
                width = len(names)
                chunk_columns = min(max(width, 1), CHUNK)
                file.create_dataset(
                    table,
                    (0, width),
                    float,
                    maxshape=(None, width or None),
                    chunks=(min(rows, CHUNK // chunk_columns), chunk_columns),
                )
                put_texts(file, f"names/{table}", names)

        self._sealed = SealedFile(self._path, self._use_fallback_folder)
        self._sealed.put(fill)

    def add(self, rows: Rows) -> None:
        def fill(file: h5py.File) -> None:
            begin = len(file["t"])
            for name, array in {"t": rows.t, **rows.tables}.items():
                file[name].resize(begin + len(rows.t), axis=0)
                file[name][begin:] = array
            file.flush()

        assert self._sealed is not None
        self._sealed.put(fill)

    def finish(self, result: Result) -> None:
        assert self._sealed is not None
        self._sealed.put(lambda file: _write_metadata(file, result))
        self._sealed.close()

    def discard(self) -> None:
        if self._sealed is not None:
            self._sealed.discard()


def write_result(path: str | Path, result: Result) -> None:
    """Write a result, wholly or not at all.

    Raises
    ------
    InputError : the file cannot be written.
    OSError : not as a whole, as on a full disk.
    """
    file = ResultFile(path)
    try:
        write_rows(result, file)
    except BaseException:
        file.discard()
        raise


def _write_metadata(file: h5py.File, result: Result) -> None:
    """All but the tables."""
    file.attrs.update(
        format=FORMAT,
        format_version=VERSION,
        units=_UNITS,
        title=result.title,
        completed=result.completed,
        message=result.message,
    )
    put_texts(file, "units/values", tuple(map(units_in(result), result.names)))
    put_texts(file, "notes", result.notes)  # for readers of sidtool 0.1
    put_texts(file, "warnings", result.warnings)
    write_diagnostics(file, result.diagnostics)
    file.create_dataset("scene", data=result.scene, dtype=h5py.string_dtype())
    for group in _GROUPS:
        file.create_group(group).attrs.update(_without_none(getattr(result, group)))
    write_bodies(file.create_group("bodies"), result.bodies)
    write_sids(file.create_group("sids"), result.sids)
    if result.accuracy is not None:
        text = result.accuracy.model_dump_json()
        file.create_dataset("accuracy", data=text, dtype=h5py.string_dtype())
    if result.events:
        write_events(file.create_group("events"), result.events)


def read_result(path: str | Path) -> Result:
    """Read a result.

    Raises
    ------
    InputError : there is no such file, or it is no whole result of this version.
    """
    try:
        check_seal(Path(path))
        with h5py.File(path, "r") as file:
            _check_format(file, path)
            check_contents(file)
            return _read_content(file, Path(path))
    except InputError as error:
        raise error.located(path) from None
    except (
        OSError,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        RuntimeError,
    ) as error:
        if not Path(path).is_file():
            raise unreadable_error(path, "a result file") from None
        raise InputError(
            f"cannot be read ({error})", source=path, expected="a whole result file"
        ) from None


def _check_format(file: h5py.File, path: str | Path) -> None:
    format_name = file.attrs.get("format")
    if format_name != FORMAT:
        raise InputError(
            f"found the format {format_name!r}", source=path, expected=FORMAT
        )
    version = file.attrs.get("format_version")
    if version not in READABLE:
        raise InputError(
            f"found version {version} of the format",
            source=path,
            expected=f"version {' or '.join(map(str, READABLE))}",
        )


def _read_content(file: h5py.File, path: Path) -> Result:
    parts: dict[str, Any] = {"t": np.asarray(file["t"][()], float)}
    more: tuple[Diagnostic, ...] = ()
    for table, names in TABLES.items():
        parts[table] = np.asarray(file[table][()], float)
        parts[names] = _read_text_list(file, f"names/{table}", file[table], "names")
    for group in _GROUPS:
        entries = file[group].attrs.items()
        parts[group] = {key: _scalar_value(value) for key, value in entries}
    parts["bodies"] = read_bodies(file.get("bodies"))
    parts["events"] = read_events(file.get("events"))
    if "accuracy" in file:
        parts["accuracy"], more = _read_accuracy(file["accuracy"].asstr()[()])
    parts["sids"] = read_sids(file.get("sids"), str(path))
    return Result(
        title=str(file.attrs["title"]),
        completed=bool(file.attrs["completed"]),
        message=str(file.attrs["message"]),
        diagnostics=(*_read_diagnostics(file), *more),
        scene=file["scene"].asstr()[()],
        **parts,
    )


def _read_accuracy(text: str) -> tuple[AccuracyReport, tuple[Diagnostic, ...]]:
    """The report of an accuracy; sentences of sidtool 0.1 are diagnostics without a
    code.
    """
    report = json.loads(text)
    found = tuple(map(plain_text, report.pop("sentences", ())))
    report.pop("notes", None)
    for decision in report["decisions"]:
        decision.pop("sentence", None)
    return AccuracyReport.model_validate_json(json.dumps(report)), found


def _read_diagnostics(file: h5py.File) -> tuple[Diagnostic, ...]:
    """The table of diagnostics; notes of older files are diagnostics without a code."""
    if "diagnostics" in file:
        return read_diagnostics(file["diagnostics"])
    notes = _read_text_list(file, "notes", file, "notes")
    warnings = _read_text_list(file, "warnings", file, "warnings")
    return tuple(
        plain_text(text, WARNING if text in warnings else INFO) for text in notes
    )


def _read_text_list(
    file: h5py.File, place: str, former: Any, name: str
) -> tuple[str, ...]:
    """A list of texts; that of version 1 from the attribute `name` of `former`."""
    if place in file:
        return read_texts(file[place])
    return tuple(map(_scalar_value, former.attrs.get(name, ())))


def _without_none(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries without those that are None, which HDF5 cannot store."""
    return {key: value for key, value in entries.items() if value is not None}


def _scalar_value(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value


def write_bodies(group: h5py.Group, bodies: Mapping[str, FlexibleBody]) -> None:
    """One subgroup per body: its lists are datasets, its other entries attributes."""
    for name, body in bodies.items():
        place = group.create_group(name)
        for key, value in _body_entries(body).items():
            if isinstance(value, tuple):
                put_texts(place, key, value)
            elif isinstance(value, np.ndarray):
                place[key] = value
            else:
                place.attrs[key] = value


def read_bodies(group: h5py.Group | None) -> dict[str, FlexibleBody]:
    """Read flexible bodies; inverse of `write_bodies`.

    Files of earlier versions have no such group, or their lists as attributes.
    """
    if group is None:
        return {}
    return {
        name: _body_of_entries(_read_stored(place)) for name, place in group.items()
    }


def _read_stored(place: h5py.Group) -> dict[str, Any]:
    lists = {
        key: dataset[()] if dataset.dtype.kind == "f" else read_texts(dataset)
        for key, dataset in place.items()
    }
    return dict(place.attrs) | lists


def _body_entries(body: FlexibleBody) -> dict[str, Any]:
    """Numbers, texts and arrays; those of parts as PART.NAME."""
    entries: dict[str, Any] = {}
    for entry in fields(body):
        value = getattr(body, entry.name)
        if entry.name not in _PARTS:
            entries[entry.name] = value
        elif value is not None:
            for part in fields(value):
                part_value = getattr(value, part.name)
                if part_value is not None:
                    entries[f"{entry.name}.{part.name}"] = part_value
    return entries


def _body_of_entries(entries: dict[str, Any]) -> FlexibleBody:
    """Make a body of entries; entries that only earlier versions had are ignored."""
    parts: dict[str, Any] = {}
    for key, value in entries.items():
        part, dot, name = key.partition(".")
        if dot:
            parts.setdefault(part, {})[name] = _entry_value(value)
        else:
            parts[key] = _entry_value(value)
    for name, kind in _PARTS.items():
        if name in parts:
            known = {entry.name for entry in fields(kind)}
            parts[name] = kind(**{k: v for k, v in parts[name].items() if k in known})
    return FlexibleBody(**parts)


def _entry_value(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return tuple(value.tolist()) if value.dtype.kind == "O" else value
    return value.item() if isinstance(value, np.generic) else value


def write_sids(group: h5py.Group, sids: Mapping[str, SID]) -> None:
    """Write one subgroup per SID, numbered; `bodies` holds the number for each body."""
    numbers: dict[int, int] = {}
    contents = group.create_group("content")
    for body, sid in sids.items():
        if id(sid) not in numbers:
            numbers[id(sid)] = len(numbers)
            write_sid_group(contents.create_group(str(numbers[id(sid)])), sid)
        group.create_group(f"bodies/{body}").attrs["content"] = numbers[id(sid)]


def read_sids(group: h5py.Group | None, source: str) -> dict[str, SID]:
    """Read SIDs; inverse of `write_sids`. Files of earlier versions have no such group.

    Parameters
    ----------
    source : name of the file
    """
    if group is None or "bodies" not in group:
        return {}
    reader, known = SidReader(source), dict[int, SID]()
    for name, content in group["content"].items():
        sid = reader.sid(content)
        check_finite(sid)
        known[int(name)] = sid
    return {
        body: known[int(entry.attrs["content"])]
        for body, entry in group["bodies"].items()
    }
