"""A seal on HDF5 files: a check sum that is verified before libhdf5 sees the file.

libhdf5 can loop forever on damaged metadata. HDF5 leaves the first 512 bytes of a file
to the user ("user block"); the seal stands there, other HDF5 tools skip it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from .atomic import atomic_path
from .errors import InputError

if TYPE_CHECKING:
    import h5py

BLOCK = 512
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
SEAL_SIGNATURE = b"\x89SID\r\n\x1a\n"


def write_sealed(
    path: str | os.PathLike[str], fill: Callable[[h5py.File], None]
) -> None:
    """Write a sealed HDF5 file, wholly or not at all.

    libhdf5 makes it in memory: on a full disk it would end the process.

    fill : puts the content into the open file

    Raises
    ------
    InputError, OSError : see `atomic_path`.
    """
    import h5py

    with h5py.File(
        os.fspath(path), "w", driver="core", backing_store=False, userblock_size=BLOCK
    ) as file:
        fill(file)
        file.flush()
        image = file.id.get_file_image()
    head = SEAL_SIGNATURE + hashlib.sha256(image).digest()
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(head.ljust(BLOCK, b"\0"))
        stream.write(image)


def check_seal(path: Path) -> None:
    """Refuse a sealed file that is not what was sealed; unsealed HDF5 files pass.

    Raises
    ------
    InputError : the file was damaged, cut short or edited, or is not HDF5 at all.
    """
    with path.open("rb") as stream:
        start = stream.read(BLOCK)
    if start.startswith(HDF5_SIGNATURE):
        return
    if not start.startswith(SEAL_SIGNATURE):
        raise InputError("is not an HDF5 file", source=path, expected="HDF5")
    expected = SEAL_SIGNATURE + _digest(path)
    if start != expected.ljust(BLOCK, b"\0"):
        raise InputError(
            "was damaged or changed after it was written",
            source=path,
            place=f"check sum in the first {BLOCK} bytes",
            expected="an unchanged file (remove the user block after edits by hand)",
        )


def _digest(path: Path) -> bytes:
    with path.open("rb") as stream:
        stream.seek(BLOCK)
        return hashlib.file_digest(stream, "sha256").digest()
