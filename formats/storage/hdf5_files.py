"""HDF5 files: check sums, finite numbers, versions, lists of texts, links.

libhdf5 can loop forever on damaged metadata. HDF5 leaves the first 512 bytes of a file
to the user ("user block"). A check sum is stored there and verified before libhdf5
opens the file; other HDF5 tools skip it.

A dataset may be stored in other files or be composed of them, and a link may lead into
another file or form a circle. A foreign file could so copy any file of the reader into
what is written next; such files are refused. A dataset may also claim to be of any
size without a number stored.

A list of texts is a dataset. As an attribute it must fit into the 64 kB of an object
header, which 4 096 texts fill.
"""

from __future__ import annotations

import hashlib
import math
import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import h5py
import numpy as np
from h5py.h5d import open as open_dataset
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.sid import NODE_SHAPES, SID, Taylor
from .atomic import GrowingFile, undisturbed

if TYPE_CHECKING:
    import h5py

BLOCK = 512
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
SEAL_SIGNATURE = b"\x89SID\r\n\x1a\n"
#: A packed dataset has at most this many times the size of its file.
PACKED = 100
#: End of the name of the folder with the metadata of an installed package.
_METADATA = ".dist-info"


def check_finite(sid: SID) -> None:
    """Refuse NaN and infinity anywhere in the body.

    Raises
    ------
    InputError : names the block or the node.
    """
    if not math.isfinite(sid.mass):
        raise InputError(f"the mass is {sid.mass}", expected="a finite number")
    for place, block in named_expansions(sid):
        for part in (block.m0, block.m1, block.mn):
            if part is not None and not np.isfinite(part).all():
                raise InputError(
                    "contains NaN or infinity", place=place, expected="finite numbers"
                )


def named_expansions(sid: SID) -> Iterator[tuple[str, Taylor]]:
    """Every Taylor expansion of a body with a name for messages."""
    for name, block in (sid.blocks | dict(sid.extra)).items():
        yield f"block {name}", block
    for node in sid.nodes:
        for name in NODE_SHAPES:
            entry = getattr(node, name)
            if entry is not None:
                yield f"node {node.id}, {name}", entry


class NewFile:
    """An HDF5 file that is written piece by piece, wholly or not at all.

    libhdf5 may crash after an error of the file below it. That file never fails, so
    that `put` and `close` report a full disk.

    Attributes
    ----------
    target : the file below libhdf5, see `GrowingFile`

    Raises
    ------
    InputError : see `atomic_path`.
    """

    user_block = 0

    def __init__(
        self, path: str | os.PathLike[str], use_fallback_folder: bool = False
    ) -> None:
        import h5py

        self.target = GrowingFile(path, use_fallback_folder)
        with undisturbed():
            self._file = h5py.File(
                cast(Any, self.target), "w", userblock_size=self.user_block
            )

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
        """Gives the complete file its name.

        Raises
        ------
        OSError : there is no place for it; nothing is left.
        """
        with undisturbed():
            self._file.close()
        self._complete()
        self.target.close()

    def _complete(self) -> None:
        """Writes what stands before the content, which is complete."""

    def discard(self) -> None:
        """Leaves no trace."""
        with undisturbed():
            self._file.close()
        self.target.discard()


class SealedFile(NewFile):
    """A new HDF5 file with a check sum.

    Its root names this program in the attribute written_by.
    """

    user_block = BLOCK

    def __init__(
        self, path: str | os.PathLike[str], use_fallback_folder: bool = False
    ) -> None:
        super().__init__(path, use_fallback_folder)
        with undisturbed():
            self._file.attrs["written_by"] = written_by()

    def _complete(self) -> None:
        """Writes the seal."""
        self.target.seek(BLOCK)
        digest = hashlib.file_digest(cast(Any, self.target), "sha256").digest()
        self.target.seek(0)
        self.target.write((SEAL_SIGNATURE + digest).ljust(BLOCK, b"\0"))


@contextmanager
def closed_or_discarded(file: NewFile) -> Iterator[NewFile]:
    """Close a file at the end of the block, or discard it after an exception."""
    try:
        yield file
        file.close()
    except BaseException:
        file.discard()
        raise


def write_sealed(
    path: str | os.PathLike[str], fill: Callable[[h5py.File], None]
) -> None:
    """Write a sealed HDF5 file, wholly or not at all.

    fill : puts the content into the open file

    Raises
    ------
    InputError, OSError : see `atomic_path`.
    """
    with closed_or_discarded(SealedFile(path)) as file:
        file.put(fill)


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


@cache
def version_of(package: str) -> str:
    """The version of an installed package, from the name of its folder of metadata.

    Where there is no such folder, `importlib.metadata` knows. Its import and the
    metadata of four packages take 13 ms, a thirtieth of a short simulation.
    """
    for name in _metadata_folders():
        version = name.removeprefix(f"{package}-").removesuffix(_METADATA)
        if len(version) + len(f"{package}-{_METADATA}") == len(name):
            return version
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


@cache
def _metadata_folders() -> list[str]:
    """Names such as "numpy-2.0.0.dist-info", in the order of the search path."""
    found: list[str] = []
    for folder in sys.path:
        with suppress(OSError):
            found += (path.name for path in Path(folder).glob(f"*{_METADATA}"))
    return found


def written_by() -> str:
    """Return the mark of files of this program, such as "sidtool 0.1.0"."""
    return f"sidtool {version_of('sidtool')}"


def versions() -> dict[str, str]:
    """Versions of this program and of what computes under it."""
    packages = ("sidtool", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {p: version_of(p) for p in packages}


def check_own_data(file: h5py.File) -> None:
    """Refuse soft and external links, external storage and virtual datasets.

    Raises
    ------
    InputError : names the place in the file.
    """
    for _ in _own_datasets(file):
        pass


def check_contents(file: h5py.File) -> None:
    """Refuse what `check_own_data` does, and datasets that claim more data than the
    file can hold.

    Raises
    ------
    InputError : names the place in the file.
    """
    most_packed = PACKED * file.id.get_filesize()
    for name, dataset, properties in _own_datasets(file):
        _check_size(f"/{name}", dataset, properties, most_packed)


def _own_datasets(
    file: h5py.File,
) -> Iterator[tuple[str, h5py.h5d.DatasetID, h5py.h5p.PropDCID]]:
    """All datasets with their names and properties, those of the low level: others take
    five times as long to make.

    Raises
    ------
    InputError : one is none of this file; names its place.
    """
    names: list[bytes] = []
    links: list[bytes] = []

    def add_link(name: bytes, link: Any) -> bool | None:
        if link.type != h5py.h5l.TYPE_HARD:
            links.append(name)
        return True if links else None

    def add(name: bytes, item: Any) -> None:
        if item.type == h5py.h5o.TYPE_DATASET:
            names.append(name)

    file.id.links.visit(add_link, info=True)
    if links:
        raise _refused(_decoded(links[0]), "is a link to another place")
    h5py.h5o.visit(file.id, add, info=True)
    for name in names:
        dataset = open_dataset(file.id, name)
        properties = dataset.get_create_plist()
        is_virtual = properties.get_layout() == h5py.h5d.VIRTUAL
        if is_virtual or properties.get_external_count():
            raise _refused(_decoded(name), "holds the data of other files")
        yield _decoded(name), dataset, properties


def _decoded(name: bytes) -> str:
    return name.decode("utf-8", "replace")


def check_size(dataset: h5py.Dataset) -> None:
    """Refuse a dataset that claims more data than are stored.

    Raises
    ------
    InputError : names the dataset.
    """
    properties = dataset.id.get_create_plist()
    _check_size(dataset.name, dataset.id, properties, math.inf)


def _check_size(
    name: str,
    dataset: h5py.h5d.DatasetID,
    properties: h5py.h5p.PropDCID,
    most_packed: float,
) -> None:
    """Refuse data that are not stored; compressed ones may have `most_packed` bytes."""
    count = dataset.get_space().get_simple_extent_npoints()
    stored = dataset.get_storage_size()
    packed = properties.get_nfilters() > 0
    limit = most_packed if packed and stored else stored
    if count * dataset.dtype.itemsize > limit:
        raise InputError(
            f"has shape {dataset.shape} and type {dataset.dtype}",
            place=f"dataset {name}",
            expected="no more data than the file holds",
        )


def stored_array(dataset: h5py.h5d.DatasetID) -> NDArray[Any]:
    """All of a dataset of the low level, which takes a third of the time."""
    values = np.empty(dataset.shape, dataset.dtype)
    if values.size:
        dataset.read(h5py.h5s.ALL, h5py.h5s.ALL, values)
    return values


def put_texts(group: h5py.Group, name: str, texts: Sequence[str]) -> None:
    """Store a list of texts as a dataset, also an empty one."""
    shape, kind = len(texts), h5py.string_dtype()
    group.create_dataset(name, data=list(texts), dtype=kind, shape=shape)


def read_texts(dataset: h5py.Dataset) -> tuple[str, ...]:
    """Inverse of `put_texts`.

    Raises
    ------
    TypeError : the dataset is no list of texts.
    """
    if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim != 1:
        raise TypeError(
            f"{dataset.name} has shape {dataset.shape} and type {dataset.dtype}, "
            "not that of a list of texts"
        )
    return tuple(map(str, dataset.asstr()[:]))


def _refused(name: str, problem: str) -> InputError:
    return InputError(problem, place=f"/{name}", expected="data in this file itself")
