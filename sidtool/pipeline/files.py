"""Detect the kind of a file from its content; write SIDs and results."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from sidtool.formats.base.errors import InputError
from sidtool.formats.file_names import OUTPUT_KINDS, kind_by_ending, path_of
from sidtool.formats.storage.hdf5_files import (
    HDF5_SIGNATURE,
    SEAL_SIGNATURE,
    check_seal,
)
from sidtool.formats.storage.unreadable import unreadable_error

if TYPE_CHECKING:
    from sidtool.formats.base.sid import SID
    from sidtool.formats.result import Result

Path_ = str | os.PathLike[str]
#: Kind of a text file by its entry ``format``.
TEXT_FORMATS = {
    "sidtool model": "model",
    "sidtool scene": "scene",
    "sidtool reference": "reference",
    "sidtool study": "study",
    "sidtool design": "design",
    "sidtool optimisation": "optimisation",
}
#: Kind of an HDF5 file by its format; all others are read as SIDs.
_HDF5_FORMATS = {"sidtool result": "result", "sidtool field": "field"}


def kind_of(path: Path_) -> str:
    """Return "model", "scene", "design", "result", "sid" or another kind of file.

    Raises
    ------
    InputError : there is no such file, or a TOML or JSON file of no known format.
    """
    path = path_of(path, "path")
    if not path.is_file():
        raise unreadable_error(path, "a SID, model, scene or result")
    if path.suffix.lower() in (".toml", ".json"):
        return _kind_of_text(path)
    if _starts_as_hdf5(path):
        return _kind_of_hdf5(path)
    if path.suffix.lower() not in OUTPUT_KINDS["sid"].endings:
        _refuse_mesh(path)
    return "sid"


def _refuse_mesh(path: Path) -> None:
    """Raise InputError on a mesh."""
    from ..importers.mesh_files import MESH_READERS

    ending = path.suffix.lower()
    if ending in MESH_READERS:
        geometry = f'{{type = "mesh", file = "{path.name}"}}'
        raise InputError(
            "is a mesh",
            source=path,
            expected=f"a model with geometry = {geometry}: "
            "sidtool new NAME --from imported_mesh",
        )


def expect_kind(path: Path_, *kinds: str) -> str:
    """Return the kind of a file, which must be one of the given kinds.

    Raises
    ------
    InputError : the file is of another kind.
    """
    kind = kind_of(path)
    if kind not in kinds:
        *most, last = (name.replace("sid", "SID") for name in kinds)
        wanted = f"a {', '.join(most)} or {last}" if most else f"a {last}"
        actual = kind.replace("sid", "SID")
        raise InputError(f"is a {actual} file", source=path, expected=wanted)
    return kind


def _kind_of_text(path: Path) -> str:
    from sidtool.formats.toml.reading import read_data

    format_name = read_data(path).get("format")
    if not isinstance(format_name, str) or format_name not in TEXT_FORMATS:
        what = "is missing" if format_name is None else f"found {format_name!r}"
        expected = " or ".join(repr(name) for name in TEXT_FORMATS)
        raise InputError(what, source=path, place="format", expected=expected)
    return TEXT_FORMATS[format_name]


def _starts_as_hdf5(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            start = stream.read(len(HDF5_SIGNATURE))
    except OSError as error:
        raise unreadable_error(path, error=error) from None
    return start in (HDF5_SIGNATURE, SEAL_SIGNATURE)


def _kind_of_hdf5(path: Path) -> str:
    import h5py

    check_seal(path)
    try:
        with h5py.File(path, "r") as file:
            return _HDF5_FORMATS.get(str(file.attrs.get("format")), "sid")
    except (OSError, RuntimeError, ValueError, TypeError):
        return "sid"  # the reader of SIDs reports errors


def write(path: Path_, content: SID | Result, *, dialect: str = "fembs") -> None:
    """Write a SID (``.h5`` or ASCII) or a result (``.h5`` or ``.csv``).

    Raises
    ------
    InputError : the file cannot be written, or its ending belongs to another kind of
        file.
    """
    from sidtool.formats.base.sid import SID
    from sidtool.formats.result import Result, write_csv, write_result
    from sidtool.formats.sid_files import write_sid

    path = path_of(path, "path")
    if isinstance(content, SID):
        write_sid(path, content, dialect)
    elif not isinstance(content, Result):
        kind = type(content).__name__
        raise InputError(
            f"is of the type {kind}", place="content", expected="a SID or a Result"
        )
    elif kind_by_ending(path, "result", "table") == "table":
        write_csv(path, content)
    else:
        write_result(path, content)
