"""Writing a file wholly or not at all.

What is being written has a name that tells the machine and the process. A process that
is killed leaves its file; whoever writes into the same folder next removes it.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import stat
import tempfile
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from ..errors import InputError

#: Bytes of a target's name that its temporary file takes over.
LONGEST = 120
#: Names of temporary files, see `_beside`.
REST = re.compile(r"\..*\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\w+\.part", re.S)

#: Temporary files of this process that are being written.
_living: set[Path] = set()
_lock = threading.Lock()


@contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `target`; it replaces `target` only on success.

    A killed or failing run leaves whatever stood at `target` untouched. A symbolic link
    stays one: what it points to is replaced. An existing file keeps its mode. Devices
    and pipes are not replaced but written to.

    Raises
    ------
    InputError : the folder does not exist or cannot be written to.
    OSError : the file cannot be written whole, as on a full disk; it names `target`.
    """
    target = Path(target)
    mode = _mode(target)
    stream = mode is not None and not stat.S_ISREG(mode)
    if not stream:
        target = Path(os.path.realpath(target))
    if stream and target.is_dir():
        raise InputError("is a folder", source=target, expected="the name of a file")
    temporary = _beside(Path(tempfile.gettempdir()) / target.name if stream else target)
    try:
        yield temporary
        if stream:
            _pour(temporary, target)
            return
        _flush_to_disk(temporary)
        temporary.chmod(0o666 & ~_umask() if mode is None else stat.S_IMODE(mode))
        temporary.replace(target)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(target)) from error
    finally:
        temporary.unlink(missing_ok=True)
        _living.discard(temporary)


def _mode(target: Path) -> int | None:
    try:
        return target.stat().st_mode
    except OSError:
        return None


def _beside(target: Path) -> Path:
    """A new temporary file in the folder of `target`, and no rests of killed runs."""
    short = os.fsdecode(os.fsencode(target.name)[:LONGEST])
    prefix = f".{short}.{_machine()}-{os.getpid()}-"
    with _lock:
        try:
            handle, name = tempfile.mkstemp(
                dir=target.parent, prefix=prefix, suffix=".part"
            )
        except OSError as error:
            raise InputError(
                f"cannot write here ({error.strerror})",
                source=target,
                expected="an existing folder with permission to write",
            ) from error
        os.close(handle)
        _living.add(Path(name))
        _remove_rests(target.parent)
    return Path(name)


@cache
def _machine() -> str:
    """Tells those who count the same processes: a machine, or a container on it."""
    name = platform.node()
    with suppress(OSError):
        name += os.readlink("/proc/self/ns/pid")
    return f"{zlib.crc32(name.encode()):08x}"


def _remove_rests(folder: Path) -> None:
    """Removes what processes left that are gone; what cannot be removed stays."""
    with suppress(OSError), os.scandir(folder) as entries:
        for path in [Path(e.path) for e in entries if e.name.endswith(".part")]:
            if _is_rest(path):
                with suppress(OSError):
                    path.unlink(missing_ok=True)


def _is_rest(path: Path) -> bool:
    found = REST.fullmatch(path.name)
    if found is None or found["machine"] != _machine() or os.name != "posix":
        return False
    process = int(found["process"])
    if process == os.getpid():
        return path not in _living
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


def _pour(source: Path, target: Path) -> None:
    """Writes a file into a device or a pipe."""
    with source.open("rb") as reader, target.open("wb", buffering=0) as writer:
        shutil.copyfileobj(reader, writer)


def _flush_to_disk(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
