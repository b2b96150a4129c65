"""A result in HDF5.

Attributes of the root: format, format_version, title, completed, message. Datasets: t,
values, positions, velocities, multipliers, the names of the columns of each of the
latter four in names/values, ...; notes and warnings, lists of texts; scene (JSON text).
Groups counters, drift, settings and versions hold their entries as attributes; group
bodies/NAME for each flexible body, see `hdf5_bodies`; group events, see `events`; group
sids: the SIDs of all bodies that have one, see `hdf5_sids`. Dataset accuracy: an
`AccuracyReport` as JSON, if there is one.
Version 1 held all lists as attributes, the names as attribute of each table.
The file is sealed, see `seal`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..endings import check_ending
from ..errors import InputError
from ..storage.growing import GrowingFile
from ..storage.hdf5_data import (
    check_own_data,
    check_sizes,
    put_texts,
    read_texts,
)
from ..storage.seal import SealedFile, check_seal
from ..storage.unreadable import unreadable
from .accuracy import AccuracyReport
from .data import TABLES, Result
from .events import read_events, write_events
from .hdf5_bodies import read_bodies, write_bodies
from .hdf5_sids import read_sids, write_sids
from .rows import BLOCK, Columns, Rows, pass_on

FORMAT = "sidtool result"
VERSION = 2
READABLE = (1, 2)
#: Numbers that are stored together, so that a chunk fits into the cache of libhdf5.
CHUNK = 1 << 17
_GROUPS = ("counters", "drift", "settings", "versions")
_UNITS = "t: s; other quantities in SI units, angles in radians"


class ResultFile:
    """A result file that is written while a run goes on.

    The file is there after `finish`, and not at all after `discard`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """

    def __init__(self, path: str | Path, elsewhere: bool = False) -> None:
        check_ending(path, "result")
        self._path, self._elsewhere = path, elsewhere
        self._sealed: SealedFile | None = None

    @property
    def file(self) -> GrowingFile | None:
        return None if self._sealed is None else self._sealed.target

    def begin(self, columns: Columns, most: int) -> None:
        def fill(file: h5py.File) -> None:
            rows = min(BLOCK, max(most, 1))
            file.create_dataset("t", (0,), float, maxshape=(None,), chunks=(rows,))
            for table, names in columns.items():
                width = len(names)
                across = min(max(width, 1), CHUNK)
                file.create_dataset(
                    table,
                    (0, width),
                    float,
                    maxshape=(None, width or None),
                    chunks=(min(rows, CHUNK // across), across),
                )
                put_texts(file, f"names/{table}", names)

        self._sealed = SealedFile(self._path, self._elsewhere)
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
        self._sealed.put(lambda file: _tell(file, result))
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
        pass_on(result, file)
    except BaseException:
        file.discard()
        raise


def _tell(file: h5py.File, result: Result) -> None:
    """All but the tables."""
    file.attrs.update(
        format=FORMAT,
        format_version=VERSION,
        units=_UNITS,
        title=result.title,
        completed=result.completed,
        message=result.message,
    )
    put_texts(file, "notes", result.notes)
    put_texts(file, "warnings", result.warnings)
    file.create_dataset("scene", data=result.scene, dtype=h5py.string_dtype())
    for group in _GROUPS:
        file.create_group(group).attrs.update(_storable(getattr(result, group)))
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
            check_own_data(file)
            check_sizes(file)
            return _result(file, Path(path))
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
            raise unreadable(path, "a result file") from None
        raise InputError(
            f"cannot be read ({error})", source=path, expected="a whole result file"
        ) from None


def _check_format(file: h5py.File, path: str | Path) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise InputError(f"found the format {found!r}", source=path, expected=FORMAT)
    version = file.attrs.get("format_version")
    if version not in READABLE:
        raise InputError(
            f"found version {version} of the format",
            source=path,
            expected=f"version {' or '.join(map(str, READABLE))}",
        )


def _result(file: h5py.File, path: Path) -> Result:
    parts: dict[str, Any] = {"t": np.asarray(file["t"][()], float)}
    for table, names in TABLES.items():
        parts[table] = np.asarray(file[table][()], float)
        parts[names] = _texts(file, f"names/{table}", file[table], "names")
    for group in _GROUPS:
        entries = file[group].attrs.items()
        parts[group] = {key: _plain(value) for key, value in entries}
    parts["bodies"] = read_bodies(file.get("bodies"))
    parts["events"] = read_events(file.get("events"))
    if "accuracy" in file:
        text = file["accuracy"].asstr()[()]
        parts["accuracy"] = AccuracyReport.model_validate_json(text)
    parts["sids"] = read_sids(file.get("sids"), str(path))
    return Result(
        title=str(file.attrs["title"]),
        completed=bool(file.attrs["completed"]),
        message=str(file.attrs["message"]),
        notes=_texts(file, "notes", file, "notes"),
        warnings=_texts(file, "warnings", file, "warnings"),
        scene=file["scene"].asstr()[()],
        **parts,
    )


def _texts(file: h5py.File, place: str, former: Any, name: str) -> tuple[str, ...]:
    """A list of texts; that of version 1 from the attribute `name` of `former`."""
    if place in file:
        return read_texts(file[place])
    return tuple(map(_plain, former.attrs.get(name, ())))


def _storable(entries: Mapping[str, Any]) -> dict[str, Any]:
    """HDF5 has no None: an entry that says nothing is left out."""
    return {key: value for key, value in entries.items() if value is not None}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value
