"""The file formats of a SID: one line of `FORMATS` each."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .base.errors import InputError
from .base.sid import SID
from .diagnostics import diagnose
from .diagnostics.python_warnings import warn_of
from .file_names import check_ending
from .sid_ascii import read_ascii, write_ascii
from .sid_hdf5 import SIGNATURES, read_hdf5, write_hdf5
from .storage.unreadable import unreadable_error

CANONICAL = "fembs"


@dataclass(frozen=True)
class SIDFormat:
    """A way to store a SID.

    Attributes
    ----------
    name : how messages call it
    suffixes : file name endings that choose it for writing; empty: all others
    signatures : first bytes of such files; empty: all others
    read, write : path to SID, and path, SID and dialect to file
    """

    name: str
    suffixes: tuple[str, ...]
    signatures: tuple[bytes, ...]
    read: Callable[[str | os.PathLike[str]], SID]
    write: Callable[[str | os.PathLike[str], SID, str], None]


def _write_hdf5(path: str | os.PathLike[str], sid: SID, dialect: str) -> None:
    if dialect != CANONICAL:
        raise InputError(
            f"HDF5 knows no dialect '{dialect}'",
            source=path,
            expected="a dialect with an ASCII file, such as .SID_FEM",
        )
    write_hdf5(path, sid)


def _write_ascii(path: str | os.PathLike[str], sid: SID, dialect: str) -> None:
    write_ascii(path, sid, dialect)
    if sid.sections:
        warn_of(diagnose("N173", Path(path).name, count=len(sid.sections)))


#: The last one takes what no other does.
FORMATS = (
    SIDFormat("HDF5", (".h5", ".hdf5"), SIGNATURES, read_hdf5, _write_hdf5),
    SIDFormat("ASCII", (), (), read_ascii, _write_ascii),
)


def read_sid(path: str | os.PathLike[str]) -> SID:
    """Read the SID in a file of any known format and dialect.

    The content decides what the file is, except that an empty or damaged file is
    judged by its name. `SID.dialect` states how the file was written.

    Raises
    ------
    InputError : there is no such file, or it is not a SID; names file and line.
    """
    source = Path(path)
    if not source.is_file():
        if source.exists() and not source.is_dir():
            problem, expected = "is a pipe or a device", "a regular file"
            raise InputError(problem, source=source, expected=expected)
        raise unreadable_error(source, "a SID file, ASCII or HDF5")
    return _format_by_content(source).read(source)


def write_sid(path: str | os.PathLike[str], sid: SID, dialect: str = CANONICAL) -> None:
    """Write a SID; .h5 and .hdf5 give HDF5, any other name ASCII.

    Parameters
    ----------
    path : file to create or replace; it appears wholly or not at all
    sid : any body without NaN and infinity
    dialect : of an ASCII file: "fembs" (canonical), "pysid", "matmorembs", "fembeam"

    Raises
    ------
    InputError : the body cannot be stored, or not at this place.
    OSError : the file cannot be written whole, as on a full disk.
    """
    check_ending(path, "sid")
    try:
        _format_by_name(Path(path)).write(path, sid, dialect)
    except ValueError as error:
        problem = f"cannot hold a text of this body ({error})"
        raise InputError(problem, source=path, expected="printable text") from error
    except InputError as error:
        raise error.located(path) from error


def _format_by_content(path: Path) -> SIDFormat:
    try:
        with path.open("rb") as stream:
            start = stream.read(16)
    except OSError as error:
        raise unreadable_error(path, "a SID file", error) from error
    for known in FORMATS:
        if start.startswith(known.signatures):
            return known
    return FORMATS[-1] if _is_text(start) else _format_by_name(path)


def _is_text(start: bytes) -> bool:
    return bool(start.strip()) and all(9 <= byte <= 13 or byte >= 32 for byte in start)


def _format_by_name(path: Path) -> SIDFormat:
    suffix = path.suffix.lower()
    return next(known for known in FORMATS if suffix in (known.suffixes or (suffix,)))
