"""Lists of texts in HDF5, and checks of what HDF5 files claim to hold.

A dataset may be stored in other files, or be put together from them, and a link may
lead into another file or round in a circle: a file from elsewhere could so bring any
file of the reader's into what is written next. A dataset may also claim to be of any
size without a number stored.

A list is a dataset. As an attribute it must fit into the 64 kB of an object header,
which 4 096 texts fill.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import h5py

from ..errors import InputError

#: A packed dataset has at most this many times the size of its file.
PACKED = 100


def check_own_data(file: h5py.File) -> None:
    """Refuse soft and external links, external storage and virtual datasets.

    Raises
    ------
    InputError : names the place in the file.
    """
    found: list[InputError] = []

    def check_link(name: str, link: object) -> bool | None:
        if not isinstance(link, h5py.HardLink):
            found.append(_refused(name, "is a link to another place"))
        else:
            item = file[name]
            if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
                found.append(_refused(name, "holds the data of other files"))
        return True if found else None

    file.visititems_links(check_link)
    if found:
        raise found[0]


def check_sizes(file: h5py.File) -> None:
    """Refuse datasets that claim more data than the file can hold.

    Raises
    ------
    InputError : names the place in the file.
    """
    most_packed = PACKED * file.id.get_filesize()

    def check_item(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            check_size(item, most_packed)

    file.visititems(check_item)


def check_size(dataset: h5py.Dataset, most_packed: float = math.inf) -> None:
    """Refuse a dataset that claims more data than are stored.

    most_packed : bytes that a compressed one may have

    Raises
    ------
    InputError : names the dataset.
    """
    size = (dataset.size or 0) * dataset.dtype.itemsize
    stored = dataset.id.get_storage_size()
    packed = dataset.id.get_create_plist().get_nfilters() > 0
    if size > (most_packed if packed and stored else stored):
        raise InputError(
            f"has shape {dataset.shape} and type {dataset.dtype}",
            place=f"dataset {dataset.name}",
            expected="no more data than the file holds",
        )


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
    return InputError(
        problem, place=f"/{name}", expected="data that stand in this file itself"
    )
