"""HDF5 files of others: only the numbers that stand in the file itself are read.

A dataset may be stored in other files, or be put together from them, and a link may
lead into another file or round in a circle: a file from elsewhere could so bring any
file of the reader's into what is written next.
"""

from __future__ import annotations

import h5py

from ..errors import InputError


def check_own_data(file: h5py.File) -> None:
    """Refuse soft and external links, external storage and virtual datasets.

    Raises
    ------
    InputError : names the place in the file.
    """
    found: list[InputError] = []

    def look(name: str, link: object) -> bool | None:
        if not isinstance(link, h5py.HardLink):
            found.append(_refused(name, "is a link to another place"))
        else:
            item = file[name]
            if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
                found.append(_refused(name, "holds the data of other files"))
        return True if found else None

    file.visititems_links(look)
    if found:
        raise found[0]


def _refused(name: str, problem: str) -> InputError:
    return InputError(
        problem, place=f"/{name}", expected="data that stand in this file itself"
    )
