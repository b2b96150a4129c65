"""A SID in HDF5: self-describing, quick, and the same bits when read back.

Nodes are stacked: all ``m0`` of one entry are one dataset with the node as first index.
Higher orders are stored for those nodes that have them, with their node numbers beside.
The file is sealed with a check sum, see `seal`.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np

from .carried import DIRECTIONS, Carried
from .errors import InputError
from .sid import NODE_SHAPES, SID, Node, Taylor
from .sid_hdf5_reader import PARTS, Reader
from .storage.finite import check_finite
from .storage.hdf5_data import check_own_data, check_sizes, put_texts
from .storage.seal import HDF5_SIGNATURE, SEAL_SIGNATURE, check_seal, write_sealed

SIGNATURES = (HDF5_SIGNATURE, SEAL_SIGNATURE)
FORMAT = "sidtool SID"
VERSION = 1
MEANING = (
    "Standard Input Data of one flexible body (Wallrapp 1994), in the body frame. "
    "m0 is the value at rest, m1[l] the derivative by elastic coordinate l. "
    "Columns of Gr and Ge: axis * nq + mode. "
    "J: xx yy zz xy xz yz; Oe: xx yy zz xy yz xz."
)

#: libhdf5 and h5py report damage in many ways.
_DAMAGE = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    RuntimeError,
    AttributeError,
    IndexError,
    OverflowError,
    MemoryError,
)


def write_hdf5(path: str | os.PathLike[str], sid: SID) -> None:
    """Store a SID completely, with its dialect; the file appears wholly or not at all.

    Raises
    ------
    InputError : a number is not finite, or the place cannot be written to.
    OSError : not as a whole, as on a full disk.
    """
    check_finite(sid)
    write_sealed(path, lambda file: put_sid(file, sid))


def read_hdf5(path: str | os.PathLike[str]) -> SID:
    """The SID in an HDF5 file, bit for bit as it was written.

    Raises
    ------
    InputError : the file is damaged, of another kind, or of a later version.
    """
    source = os.fspath(path)
    try:
        check_seal(Path(path))
        with h5py.File(path, "r") as file:
            _check_kind(file, source)
            check_own_data(file)
            check_sizes(file)
            sid = Reader(source).sid(file)
        check_finite(sid)
    except InputError as error:
        raise error.located(source) from error
    except _DAMAGE as error:
        raise InputError(
            f"is damaged or no HDF5 file ({_first_line(error)})",
            source=source,
            expected="a SID in HDF5 as sidtool writes it",
        ) from error
    return sid


def _check_kind(file: h5py.File, source: str) -> None:
    kind = file.attrs.get("format")
    if not isinstance(kind, str) or kind != FORMAT:
        raise InputError(
            "is an HDF5 file, but not a SID",
            source=source,
            place="attribute format",
            expected=f"'{FORMAT}'",
        )
    version = file.attrs.get("version")
    if not isinstance(version, np.integer) or version != VERSION:
        raise InputError(
            f"has version {version}",
            source=source,
            place="attribute version",
            expected=f"version {VERSION}",
        )


def put_sid(file: h5py.Group, sid: SID) -> None:
    """All of a SID, into a file or a group of one."""
    file.attrs["format"] = FORMAT
    file.attrs["version"] = VERSION
    file.attrs["meaning"] = MEANING
    file.attrs["title"] = sid.title
    file.attrs["mass"] = sid.mass
    file.attrs["from_matrices"] = sid.from_matrices
    file.attrs["dialect"] = json.dumps(asdict(sid.dialect))
    put_texts(file, "labels", sid.labels)
    for name, block in sid.blocks.items():
        _put_block(file.create_group(f"blocks/{name}"), block)
    extra = file.create_group("extra")
    for index, (name, block) in enumerate(sid.extra.items()):
        group = extra.create_group(f"{index:06d}")
        group.attrs["name"] = name
        _put_block(group, block)
    _put_nodes(file.create_group("nodes"), sid.nodes)
    if sid.carried is not None:
        _put_carried(file.create_group("carried"), sid.carried)


def _put_carried(group: h5py.Group, carried: Carried) -> None:
    """See `Carried`; what is not known is NaN."""
    group.attrs["free"] = carried.free
    group.attrs["lost"] = np.array(carried.lost, float)
    put_texts(group, "id", list(carried.shares))
    rows = np.array(list(carried.shares.values()), float)  # None becomes NaN
    group["shares"] = rows.reshape(-1, len(DIRECTIONS))


def _put_block(group: h5py.Group, block: Taylor) -> None:
    group.attrs["order"] = block.order
    group["m0"] = block.m0
    for part in PARTS:
        value = getattr(block, part)
        if value is not None:
            group[part] = value


def _put_nodes(group: h5py.Group, nodes: tuple[Node, ...]) -> None:
    put_texts(group, "id", [node.id for node in nodes])
    put_texts(group, "rframe", [node.rframe for node in nodes])
    for name in NODE_SHAPES:
        entries = {
            index: entry
            for index, node in enumerate(nodes)
            if (entry := getattr(node, name)) is not None
        }
        if entries:
            _put_stack(group.create_group(name), entries)


def _put_stack(group: h5py.Group, entries: dict[int, Taylor]) -> None:
    """The same entry of many nodes, by the number of the node."""
    group["node"] = np.array(list(entries), dtype=np.int64)
    group["order"] = np.array([entry.order for entry in entries.values()], np.int64)
    group["m0"] = np.stack([entry.m0 for entry in entries.values()])
    linear = {
        index: entry.m1 for index, entry in entries.items() if entry.m1 is not None
    }
    if linear:
        group["m1_node"] = np.array(list(linear), dtype=np.int64)
        group["m1"] = np.stack(list(linear.values()))
    for index, entry in entries.items():
        if entry.mn is not None:
            group[f"mn/{index}"] = entry.mn


def _first_line(error: BaseException) -> str:
    lines = str(error).splitlines() or [type(error).__name__]
    return lines[0][:120]
