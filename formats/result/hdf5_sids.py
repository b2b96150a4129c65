"""The SIDs that a run was made with, in HDF5 groups; equal ones are stored once."""

from __future__ import annotations

from collections.abc import Mapping

import h5py

from ..sid import SID
from ..sid_hdf5 import put_sid
from ..sid_hdf5_reader import Reader
from ..storage.finite import check_finite


def write_sids(group: h5py.Group, sids: Mapping[str, SID]) -> None:
    """One subgroup per SID, numbered; `bodies` tells the number of each body."""
    numbers: dict[int, int] = {}
    kept = group.create_group("content")
    for body, sid in sids.items():
        if id(sid) not in numbers:
            numbers[id(sid)] = len(numbers)
            put_sid(kept.create_group(str(numbers[id(sid)])), sid)
        group.create_group(f"bodies/{body}").attrs["content"] = numbers[id(sid)]


def read_sids(group: h5py.Group | None, source: str) -> dict[str, SID]:
    """Inverse of `write_sids`; files of before have no such group.

    source : name of the file
    """
    if group is None or "bodies" not in group:
        return {}
    reader, known = Reader(source), dict[int, SID]()
    for name, content in group["content"].items():
        sid = reader.sid(content)
        check_finite(sid)
        known[int(name)] = sid
    return {
        body: known[int(entry.attrs["content"])]
        for body, entry in group["bodies"].items()
    }
