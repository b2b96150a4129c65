"""What kind of file a path names, and how each kind is read."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sidtool.formats.arguments import path_of
from sidtool.formats.errors import InputError
from sidtool.formats.storage.seal import HDF5_SIGNATURE, SEAL_SIGNATURE, check_seal
from sidtool.formats.storage.unreadable import unreadable

Path_ = str | os.PathLike[str]
#: The entry ``format`` of files that people write, and the kind that it means.
WRITTEN = {
    "sidtool model": "model",
    "sidtool scene": "scene",
    "sidtool reference": "reference",
    "sidtool study": "study",
}
#: The same of HDF5 files; all others are SIDs, whose reader says what is wrong.
_STORED = {"sidtool result": "result", "sidtool field": "field"}


def kind_of(path: Path_) -> str:
    """ "model", "scene", "reference", "study", "result", "field" or "sid".

    Raises
    ------
    InputError : there is no such file, or a TOML or JSON file of no known format.
    """
    path = path_of(path, "path")
    if not path.is_file():
        raise unreadable(path, "a SID, model, scene or result")
    if path.suffix in (".toml", ".json"):
        return _kind_of_text(path)
    return _kind_of_hdf5(path) if _starts_as_hdf5(path) else "sid"


def read(path: Path_) -> Any:
    """The content of a file: SID, Model, Scene, StudyFile, Result or Field.

    Raises
    ------
    InputError : the file cannot be read; names file and place.
    """
    kind = kind_of(path)
    if kind not in READERS:
        raise InputError(
            f"is a {kind}", source=path, expected="a SID, model, scene or result"
        )
    return READERS[kind](path)


def expect_kind(path: Path_, *kinds: str) -> str:
    """The kind of a file that must be one of some kinds.

    Raises
    ------
    InputError : it is of another kind.
    """
    kind = kind_of(path)
    if kind not in kinds:
        *most, last = (name.replace("sid", "SID") for name in kinds)
        wanted = f"a {', '.join(most)} or {last}" if most else f"a {last}"
        found = kind.replace("sid", "SID")
        raise InputError(f"is a {found} file", source=path, expected=wanted)
    return kind


def _kind_of_text(path: Path) -> str:
    from sidtool.formats.toml.reading import read_data

    found = read_data(path).get("format")
    if not isinstance(found, str) or found not in WRITTEN:
        what = "is missing" if found is None else f"found {found!r}"
        expected = " or ".join(repr(name) for name in WRITTEN)
        raise InputError(what, source=path, place="format", expected=expected)
    return WRITTEN[found]


def _starts_as_hdf5(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            start = stream.read(len(HDF5_SIGNATURE))
    except OSError as error:
        raise unreadable(path, error=error) from None
    return start in (HDF5_SIGNATURE, SEAL_SIGNATURE)


def _kind_of_hdf5(path: Path) -> str:
    import h5py

    check_seal(path)
    try:
        with h5py.File(path, "r") as file:
            return _STORED.get(str(file.attrs.get("format")), "sid")
    except (OSError, RuntimeError, ValueError, TypeError):
        return "sid"  # whose reader says what is wrong


def _read_sid(path: Path_) -> Any:
    from sidtool.formats.sid_files import read_sid

    return read_sid(path)


def _read_model(path: Path_) -> Any:
    from .scenes import Model

    return Model.load(path)


def _read_scene(path: Path_) -> Any:
    from .scenes import Scene

    return Scene.load(path)


def _read_result(path: Path_) -> Any:
    from sidtool.formats.result import read_result

    from .results import answering

    return answering(read_result(Path(path)))


def _read_field(path: Path_) -> Any:
    from sidtool.formats.field import read_field

    return read_field(path)


def _read_study(path: Path_) -> Any:
    from sidtool.formats.study import read_study

    return read_study(Path(path))


READERS: dict[str, Callable[[Path_], Any]] = {
    "sid": _read_sid,
    "model": _read_model,
    "scene": _read_scene,
    "result": _read_result,
    "field": _read_field,
    "study": _read_study,
}
