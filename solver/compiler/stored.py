"""Compiled kernels on disk: one file each, complete or absent.

A file holds a checksum, the key of the kernel and its machine code. What cannot be
read, does not fit or may be of another user is as if it were not there, and what cannot
be written is done without: the kernel is compiled in memory, and one warning says why.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from sidtool.formats.errors import InputError, warn_caller
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.operating_system import (
    Untrusted,
    cache_folder,
    create_file,
    make_trusted_folder,
    read_trusted,
)
from sidtool.formats.storage.unreadable import reason_of

MAGIC = b"sidtool kernel 1\n"
#: Bytes of the checksum and of the length of the key.
DIGEST, LENGTH = 32, 8
#: Permissions of a file: others may use what an administrator has compiled.
MODE = 0o644
HERE = Path(__file__).resolve().parent

_told: set[str] = set()


class KernelCacheWarning(UserWarning):
    """Compiled kernels cannot be kept, or what was kept is damaged."""


def folders() -> list[Path]:
    """Where kernels are looked for, and written if possible: the first comes first.

    The folder in NUMBA_CACHE_DIR, or the package and, behind it, the user's cache.
    """
    package = hashlib.sha256(os.fsencode(HERE)).hexdigest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return [Path(chosen).absolute() / f"sidtool-{package}"]
    found, users = [HERE / "__pycache__"], cache_folder()
    return found if users is None else [*found, users / package]


def read(name: str, key: str) -> bytes | None:
    """The machine code in a file, if it is whole and of this key."""
    for folder in folders():
        path = folder / name
        try:
            content = read_trusted(path, _trusted_like(folder))
        except Untrusted as error:
            text = f"{error.filename}: {reason_of(error)}"
            tell("untrusted", f"{text}; its kernels are compiled anew")
            continue
        except OSError:
            continue
        try:
            found, code = _opened(content)
        except ValueError:
            tell("damaged", f"{path} is damaged: what it held is compiled anew")
            continue
        if found == key:
            return code
    return None


def write(name: str, key: str, code: bytes) -> None:
    """Keeps machine code where that is possible."""
    content = _sealed(key, code)
    failures = []
    for folder in folders():
        try:
            make_trusted_folder(folder, _trusted_like(folder))
            path = folder / name
            with atomic_path(path, keep_beside=False, mode=MODE) as temporary:
                temporary.write_bytes(content)
            return
        except OSError as error:
            failures.append(f"{folder} ({reason_of(error)})")
        except InputError as error:
            failures.append(f"{folder} ({error.problem})")
    _tell_unkept(failures)


def is_writable() -> bool:
    """Whether kernels can be kept at all; says so if they cannot."""
    failures = []
    for folder in folders():
        try:
            make_trusted_folder(folder, _trusted_like(folder))
            create_file(folder, ".sidtool-", ".tmp").unlink()
            return True
        except OSError as error:
            failures.append(f"{folder} ({reason_of(error)})")
    _tell_unkept(failures)
    return False


def _trusted_like(folder: Path) -> Path | None:
    """The package beside whose code kernels stand: who may change that is trusted."""
    return folder.parent if folder.parent == HERE and HERE.is_dir() else None


def unkept() -> bool:
    """Whether this process has failed to keep a kernel."""
    return "unkept" in _told


def tell(kind: str, text: str) -> None:
    """Warns once of each kind of trouble."""
    if kind not in _told:
        _told.add(kind)
        warn_caller(text, KernelCacheWarning)


def _tell_unkept(failures: list[str]) -> None:
    if "untrusted" in _told:
        _told.add("unkept")
    tell(
        "unkept",
        f"compiled kernels cannot be kept in {', '.join(failures)}: "
        "every run compiles them anew; "
        "NUMBA_CACHE_DIR may name another folder",
    )


def _sealed(key: str, code: bytes) -> bytes:
    text = key.encode()
    body = len(text).to_bytes(LENGTH, "little") + text + code
    return MAGIC + hashlib.sha256(body).digest() + body


def _opened(content: bytes) -> tuple[str, bytes]:
    """Key and machine code.

    Raises
    ------
    ValueError : these are not the bytes that were written.
    """
    start = len(MAGIC) + DIGEST
    head, body = content[:start], content[start:]
    if head != MAGIC + hashlib.sha256(body).digest():
        raise ValueError("checksum")
    end = LENGTH + int.from_bytes(body[:LENGTH], "little")
    return body[LENGTH:end].decode(), body[end:]
