"""A seal on HDF5 files: a check sum that is verified before libhdf5 sees the file.

libhdf5 can loop forever on damaged metadata. HDF5 leaves the first 512 bytes of a file
to the user ("user block"); the seal stands there, other HDF5 tools skip it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ..errors import InputError
from .growing import GrowingFile, undisturbed
from .versions import written_by

if TYPE_CHECKING:
    import h5py

BLOCK = 512
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
SEAL_SIGNATURE = b"\x89SID\r\n\x1a\n"


class SealedFile:
    """A sealed HDF5 file that is written piece by piece, wholly or not at all.

    Its root names this program in the attribute written_by.

    Attributes
    ----------
    target : the file below libhdf5, see `GrowingFile`

    Raises
    ------
    InputError : see `atomic_path`.
    """

    def __init__(self, path: str | os.PathLike[str], elsewhere: bool = False) -> None:
        import h5py

        self.target = GrowingFile(path, elsewhere)
        with undisturbed():
            self._file = h5py.File(cast(Any, self.target), "w", userblock_size=BLOCK)
            self._file.attrs["written_by"] = written_by()

    def put(self, fill: Callable[[h5py.File], None]) -> None:
        """Puts some content into the file.

        Raises
        ------
        OSError : there is no place for it.
        """
        with undisturbed():
            fill(self._file)
        self.target.check()

    def close(self) -> None:
        """Seals the file, which takes its place.

        Raises
        ------
        OSError : there is no place for it; nothing is left.
        """
        with undisturbed():
            self._file.close()
        self.target.seek(BLOCK)
        digest = hashlib.file_digest(cast(Any, self.target), "sha256").digest()
        self.target.seek(0)
        self.target.write((SEAL_SIGNATURE + digest).ljust(BLOCK, b"\0"))
        self.target.close()

    def discard(self) -> None:
        """Leaves no trace."""
        with undisturbed():
            self._file.close()
        self.target.discard()


def write_sealed(
    path: str | os.PathLike[str], fill: Callable[[h5py.File], None]
) -> None:
    """Write a sealed HDF5 file, wholly or not at all.

    fill : puts the content into the open file

    Raises
    ------
    InputError, OSError : see `atomic_path`.
    """
    file = SealedFile(path)
    try:
        file.put(fill)
        file.close()
    except BaseException:
        file.discard()
        raise


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
        stream.seek(BLOCK)
        expected = SEAL_SIGNATURE + hashlib.file_digest(stream, "sha256").digest()
    if start != expected.ljust(BLOCK, b"\0"):
        raise InputError(
            "was damaged or changed after it was written",
            source=path,
            place=f"check sum in the first {BLOCK} bytes",
            expected="an unchanged file (remove the user block after edits by hand)",
        )
