"""Writing a file wholly or not at all.

What is being written has a name that tells the machine and the process. A process that
is killed leaves its file; whoever writes into the same folder next removes it. A file
that is whole is not given up: where its name cannot be had, it gets one beside it.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import tempfile
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import count
from pathlib import Path

from ..errors import InputError
from .operating_system import (
    PRIVATE,
    USUAL,
    create_file,
    create_folder,
    extended_path,
    flush_to_disk,
    has_ended,
    is_open_elsewhere,
    is_own_folder,
    path_problem,
    process_list,
    replace_file,
    set_mode,
)
from .unreadable import reason_of

#: Bytes of a target's name that its temporary file takes over.
LONGEST = 120
PART = ".part"
#: Names of temporary files and folders, see `_new`.
REST = re.compile(r"\..*\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\w+\.part", re.S)

#: Temporary files of this process that are being written.
_living: set[Path] = set()
_lock = threading.Lock()


class KeptBeside(OSError):
    """A whole file could not replace another one and has a name beside it."""


@contextmanager
def atomic_path(
    target: str | os.PathLike[str], keep_beside: bool = True, mode: int | None = None
) -> Iterator[Path]:
    """Yield a temporary path beside `target`; it replaces `target` only on success.

    A killed or failing run leaves whatever stood at `target` untouched. A symbolic link
    stays one: what it points to is replaced. An existing file keeps its mode. Devices
    and pipes are not replaced but written to.

    Parameters
    ----------
    target : the file
    keep_beside : keep a whole file under another name where it cannot replace `target`,
        as on Windows while another program has that open; else it is removed
    mode : permissions of the file, less the umask, instead of the usual ones or those
        of the file that it replaces

    Raises
    ------
    InputError : the folder does not exist or cannot be written to, or a file cannot
        have this name.
    KeptBeside : it cannot replace `target`; says where it is instead.
    OSError : the file cannot be written whole, as on a full disk; it names `target`.
    """
    named = target = Path(target)
    if problem := path_problem(target):
        raise InputError(problem, source=target, expected="another name")
    found = _mode(target)
    stream = found is not None and not stat.S_ISREG(found)
    if not stream:
        target = extended_path(Path(os.path.realpath(target)))
    if stream and target.is_dir():
        raise InputError("is a folder", source=target, expected="the name of a file")
    if mode is None:
        mode = USUAL if found is None else PRIVATE
    else:
        found = None
    if stream:
        with temporary_folder(Path(tempfile.gettempdir()) / target.name) as folder:
            temporary = create_file(folder, "", "")
            yield temporary
            _pour(temporary, target)
        return
    temporary = _beside(target, mode)
    try:
        yield temporary
        flush_to_disk(temporary)
        if found is not None:
            set_mode(temporary, found)
        _give_name(temporary, target, named if keep_beside else None)
    except KeptBeside:
        raise
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(named)) from error
    finally:
        temporary.unlink(missing_ok=True)
        _living.discard(temporary)


@contextmanager
def temporary_folder(target: Path) -> Iterator[Path]:
    """Yield a new folder beside `target` that nobody else may enter.

    It is removed at the end with the files in it; that of a killed process by whoever
    writes into the same folder next.

    Raises
    ------
    InputError : nothing can be created there.
    """
    folder = _new(target, lambda prefix: create_folder(target.parent, prefix, PART))
    try:
        yield folder
    finally:
        _remove(folder)
        _living.discard(folder)


def _give_name(temporary: Path, target: Path, named: Path | None) -> None:
    """Replaces the target, or keeps the file beside it where that is named."""
    try:
        replace_file(temporary, target)
    except OSError as error:
        if named is None:
            raise
        other = _free_name(target)
        replace_file(temporary, other)
        problem = f"cannot be replaced ({reason_of(error)})"
        if is_open_elsewhere(target):
            problem = "is open in another program"
        text = f"{problem}: it is as before, and what was to replace it is {other.name}"
        raise KeptBeside(error.errno, text, os.fspath(named)) from error


def _free_name(target: Path) -> Path:
    names = (f"{target.stem}.new{n}{target.suffix}" for n in count(1))
    return next(p for p in map(target.with_name, names) if not p.exists())


def _mode(target: Path) -> int | None:
    try:
        return target.stat().st_mode
    except OSError:
        return None


def _beside(target: Path, mode: int) -> Path:
    """A new temporary file in the folder of `target`, and no rests of killed runs."""
    return _new(target, lambda prefix: create_file(target.parent, prefix, PART, mode))


def _new(target: Path, create: Callable[[str], Path]) -> Path:
    """What is created with the prefix of a temporary file, and no rests beside it."""
    # whole characters, as Windows and macOS have no names with parts of one
    short = target.name.encode("utf-8", "ignore")[:LONGEST].decode("utf-8", "ignore")
    prefix = f".{short}.{_machine()}-{os.getpid()}-"
    with _lock:
        try:
            path = create(prefix)
        except OSError as error:
            raise InputError(
                f"cannot write here ({reason_of(error)})",
                source=target,
                expected="an existing folder with permission to write",
            ) from error
        _living.add(path)
        _remove_rests(target.parent)
    return path


@cache
def _machine() -> str:
    """Tells those who count the same processes: a machine, or a container on it."""
    return f"{zlib.crc32(process_list().encode()):08x}"


def _remove_rests(folder: Path) -> None:
    """Removes what processes left that are gone; what cannot be removed stays."""
    with suppress(OSError), os.scandir(folder) as entries:
        for path in [Path(e.path) for e in entries if e.name.endswith(PART)]:
            if _is_rest(path):
                with suppress(OSError):
                    _remove(path)


def _remove(path: Path) -> None:
    """Removes a temporary file, or a folder of them."""
    if is_own_folder(path):
        for file in path.iterdir():
            file.unlink(missing_ok=True)
        path.rmdir()
    else:
        path.unlink(missing_ok=True)


def _is_rest(path: Path) -> bool:
    found = REST.fullmatch(path.name)
    if found is None or found["machine"] != _machine():
        return False
    process = int(found["process"])
    if process == os.getpid():
        return path not in _living
    return has_ended(process)


def _pour(source: Path, target: Path) -> None:
    """Writes a file into a device or a pipe."""
    with source.open("rb") as reader, target.open("wb", buffering=0) as writer:
        shutil.copyfileobj(reader, writer)
