"""Write a file completely or not at all."""

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

from ..base.errors import InputError
from .operating_system import (
    PRIVATE,
    USUAL,
    create_file,
    create_folder,
    extended_path,
    flush_to_disk,
    has_ended,
    is_open_in_other_program,
    is_own_folder,
    path_problem,
    process_list,
    replace_file,
    set_mode,
)
from .unreadable import failure_reason

#: Bytes of a target's name that its temporary file takes over.
MAX_NAME_LENGTH = 120
TEMPORARY_PREFIX = ".part"
#: Names of temporary files and folders, see `_new_temporary`.
LEFTOVER_PATTERN = re.compile(
    r"\..*\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\w+\.part", re.S
)

#: Temporary files of this process that are being written.
_living: set[Path] = set()
_lock = threading.Lock()


class StoredUnderOtherName(OSError):
    """Raised when a complete file could not replace another one and is stored beside
    it.
    """


@contextmanager
def atomic_path(
    target: str | os.PathLike[str], keep_beside: bool = True, mode: int | None = None
) -> Iterator[Path]:
    """Yield a temporary path beside `target`; it replaces `target` only on success.

    A killed or failing run leaves the file at `target` unchanged. A symbolic link
    remains one: its target is replaced. An existing file keeps its mode. Devices
    and pipes are not replaced but written to.

    Parameters
    ----------
    target : the file
    keep_beside : store a complete file under another name if it cannot replace
        `target`, as on Windows while another program has that open; else it is removed
    mode : permissions of the file, less the umask, instead of the usual ones or those
        of the file that it replaces

    Raises
    ------
    InputError : the folder does not exist or cannot be written to, or a file cannot
        have this name.
    KeptBeside : it cannot replace `target`; states where it is instead.
    OSError : the file cannot be written completely, as on a full disk; it names
        `target`.
    """
    given_path = target = Path(target)
    if problem := path_problem(target):
        raise InputError(problem, source=target, expected="another name")
    file_mode = _file_mode(target)
    stream = file_mode is not None and not stat.S_ISREG(file_mode)
    if not stream:
        target = extended_path(Path(os.path.realpath(target)))
    if stream and target.is_dir():
        raise InputError("is a folder", source=target, expected="the name of a file")
    if mode is None:
        mode = USUAL if file_mode is None else PRIVATE
    else:
        file_mode = None
    if stream:
        with temporary_folder(Path(tempfile.gettempdir()) / target.name) as folder:
            temporary = create_file(folder, "", "")
            yield temporary
            _copy_into_device(temporary, target)
        return
    temporary = _create_temporary(target, mode)
    try:
        yield temporary
        flush_to_disk(temporary)
        if file_mode is not None:
            set_mode(temporary, file_mode)
        _move_into_place(temporary, target, given_path if keep_beside else None)
    except StoredUnderOtherName:
        raise
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(given_path)) from error
    finally:
        _remove_temporary(temporary)


@contextmanager
def temporary_folder(target: Path) -> Iterator[Path]:
    """Yield a new folder beside `target` that only this user may enter.

    It is removed at the end with the files in it; that of a killed process by the next
    process that writes into the same folder.

    Raises
    ------
    InputError : nothing can be created there.
    OSError : a file in it cannot be written, as on a full disk; it names `target`.
    """
    folder = _new_temporary(
        target, lambda prefix: create_folder(target.parent, prefix, TEMPORARY_PREFIX)
    )
    try:
        yield folder
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(target)) from error
    finally:
        _remove_temporary(folder)


def _move_into_place(temporary: Path, target: Path, given_path: Path | None) -> None:
    """Replace the target, or store the file beside it if `named` is set."""
    try:
        replace_file(temporary, target)
    except OSError as error:
        if given_path is None:
            raise
        other = _free_name(target)
        replace_file(temporary, other)
        problem = f"cannot be replaced ({failure_reason(error)})"
        if is_open_in_other_program(target):
            problem = "is open in another program"
        text = f"{problem}: it is as before, and what was to replace it is {other.name}"
        raise StoredUnderOtherName(error.errno, text, os.fspath(given_path)) from error


def _free_name(target: Path) -> Path:
    names = (f"{target.stem}.new{n}{target.suffix}" for n in count(1))
    return next(p for p in map(target.with_name, names) if not p.exists())


def _file_mode(target: Path) -> int | None:
    try:
        return target.stat().st_mode
    except OSError:
        return None


def _create_temporary(target: Path, mode: int) -> Path:
    """A new temporary file in the folder of `target`, and no rests of killed runs."""
    return _new_temporary(
        target,
        lambda prefix: create_file(target.parent, prefix, TEMPORARY_PREFIX, mode),
    )


def _new_temporary(target: Path, create: Callable[[str], Path]) -> Path:
    """Create a temporary file or folder, after removal of leftovers beside it."""
    # whole characters, as Windows and macOS have no names with parts of one
    short = target.name.encode("utf-8", "ignore")[:MAX_NAME_LENGTH].decode(
        "utf-8", "ignore"
    )
    prefix = f".{short}.{_machine_name()}-{os.getpid()}-"
    with _lock:
        try:
            path = create(prefix)
        except OSError as error:
            raise InputError(
                f"cannot write here ({failure_reason(error)})",
                source=target,
                expected="an existing folder with permission to write",
            ) from error
        _living.add(path)
        _remove_leftovers(target.parent)
    return path


@cache
def _machine_name() -> str:
    """Return a name of the machine or container whose process numbers are ours."""
    return f"{zlib.crc32(process_list().encode()):08x}"


def _remove_leftovers(folder: Path) -> None:
    """Remove temporary files of processes that have ended, as far as possible."""
    with suppress(OSError), os.scandir(folder) as entries:
        for path in [
            Path(e.path) for e in entries if e.name.endswith(TEMPORARY_PREFIX)
        ]:
            if _is_leftover(path):
                with suppress(OSError):
                    _remove(path)


def _remove_temporary(path: Path) -> None:
    """Remove what this process has written, or leave it to the next one.

    Windows removes no open file, as libhdf5 leaves one on a full disk.
    """
    with suppress(OSError):
        _remove(path)
    _living.discard(path)


def _remove(path: Path) -> None:
    """Removes a temporary file, or a folder of them."""
    if is_own_folder(path):
        for file in path.iterdir():
            file.unlink(missing_ok=True)
        path.rmdir()
    else:
        path.unlink(missing_ok=True)


def _is_leftover(path: Path) -> bool:
    match = LEFTOVER_PATTERN.fullmatch(path.name)
    if match is None or match["machine"] != _machine_name():
        return False
    process = int(match["process"])
    if process == os.getpid():
        return path not in _living
    return has_ended(process)


def _copy_into_device(source: Path, target: Path) -> None:
    """Writes a file into a device or a pipe."""
    with source.open("rb") as reader, target.open("wb", buffering=0) as writer:
        shutil.copyfileobj(reader, writer)
