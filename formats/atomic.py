"""Writing a file wholly or not at all."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError


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


def _mode(target: Path) -> int | None:
    try:
        return target.stat().st_mode
    except OSError:
        return None


def _beside(target: Path) -> Path:
    """A new temporary file in the folder of `target`."""
    try:
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.name}.", suffix=".part"
        )
    except OSError as error:
        raise InputError(
            f"cannot write here ({error.strerror})",
            source=target,
            expected="an existing folder with permission to write",
        ) from error
    os.close(handle)
    return Path(name)


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
