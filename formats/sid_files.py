"""The file formats of a SID, one line of `FORMATS` each, and the SID in HDF5.

HDF5 is self-describing, fast, bit-identical when read back.

Nodes are stacked: all ``m0`` of one entry are one dataset with the node as first index.
Higher orders are stored for those nodes that have them, with their node numbers beside.
The file has a check sum, see `storage/hdf5_files.py`.
"""

import hashlib
import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from .base.errors import InputError
from .base.sid import (
    BLOCK_SHAPES,
    DIRECTIONS,
    NODE_SHAPES,
    SID,
    Array,
    ComplianceShares,
    Dialect,
    Node,
    Section,
    Taylor,
)
from .base.stress import has_peak_nodes, stress_nodes
from .diagnostics import Diagnostic, diagnose, plain_text
from .diagnostics.hdf5 import read_diagnostics, write_diagnostics
from .diagnostics.record import warn_of
from .file_names import check_ending
from .sid_ascii import read_ascii, write_ascii
from .storage.hdf5_files import (
    HDF5_SIGNATURE,
    SEAL_SIGNATURE,
    check_contents,
    check_finite,
    check_seal,
    open_dataset,
    put_texts,
    stored_array,
    write_sealed,
)
from .storage.unreadable import unreadable_error

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

#: The parts of an expansion that may be missing.
PARTS = ("m1", "mn")
#: So many files, each of at most so many bytes, are not parsed again.
MAX_READ, MAX_SIZE = 16, 4 * 2**20
_READ: dict[tuple[str, bytes], SID] = {}


def write_hdf5(path: str | os.PathLike[str], sid: SID) -> None:
    """Store a SID completely, with its dialect; the file appears wholly or not at all.

    Raises
    ------
    InputError : a number is not finite, or the place cannot be written to.
    OSError : not as a whole, as on a full disk.
    """
    check_finite(sid)
    write_sealed(path, lambda file: write_sid_group(file, sid))


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
            check_contents(file)
            sid = SidReader(source).sid(file)
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


def write_sid_group(file: h5py.Group, sid: SID) -> None:
    """All of a SID, into a file or a group of one."""
    file.attrs["format"] = FORMAT
    file.attrs["version"] = VERSION
    file.attrs["meaning"] = MEANING
    file.attrs["title"] = sid.title
    file.attrs["mass"] = sid.mass
    file.attrs["from_matrices"] = sid.from_matrices
    if stress_nodes(sid):
        file.attrs["has_peak_nodes"] = has_peak_nodes(sid)
    file.attrs["dialect"] = json.dumps(asdict(sid.dialect))
    put_texts(file, "labels", sid.labels)
    for name, block in sid.blocks.items():
        _write_block(file.create_group(f"blocks/{name}"), block)
    extra = file.create_group("extra")
    for index, (name, block) in enumerate(sid.extra.items()):
        group = extra.create_group(f"{index:06d}")
        group.attrs["name"] = name
        _write_block(group, block)
    _write_nodes(file.create_group("nodes"), sid.nodes)
    if sid.diagnostics:
        write_diagnostics(file, sid.diagnostics)
    if sid.carried is not None:
        _write_compliance_shares(file.create_group("carried"), sid.carried)
    for index, section in enumerate(sid.sections):
        group = file.create_group(f"sections/{index:06d}")
        group.attrs["name"] = section.name
        put_texts(group, "beyond", section.beyond)
        write_sid_group(group.create_group("part"), section.part)


def _write_compliance_shares(group: h5py.Group, carried: ComplianceShares) -> None:
    """Write compliance shares, see `ComplianceShares`; unknown ones are NaN."""
    group.attrs["free"] = carried.free
    group.attrs["lost"] = np.array(carried.lost, float)
    put_texts(group, "id", list(carried.shares))
    rows = np.array(list(carried.shares.values()), float)  # None becomes NaN
    group["shares"] = rows.reshape(-1, len(DIRECTIONS))


def _write_block(group: h5py.Group, block: Taylor) -> None:
    group.attrs["order"] = block.order
    group["m0"] = block.m0
    for part in PARTS:
        value = getattr(block, part)
        if value is not None:
            group[part] = value


def _write_nodes(group: h5py.Group, nodes: tuple[Node, ...]) -> None:
    put_texts(group, "id", [node.id for node in nodes])
    put_texts(group, "rframe", [node.rframe for node in nodes])
    for name in NODE_SHAPES:
        entries = {
            index: entry
            for index, node in enumerate(nodes)
            if (entry := getattr(node, name)) is not None
        }
        if entries:
            _write_entries(group.create_group(name), entries)


def _write_entries(group: h5py.Group, entries: dict[int, Taylor]) -> None:
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


class SidReader:
    """Takes datasets out of a file that may lie about their type.

    Their sizes are those of `check_contents`.
    """

    def __init__(self, source: str) -> None:
        self._source = source

    def sid(self, file: h5py.Group) -> SID:
        """The whole body."""
        blocks: dict[str, Any] = {
            name: self._block(file[f"blocks/{name}"]) for name in BLOCK_SHAPES
        }
        extra = {
            str(group.attrs["name"]): self._block(group)
            for _, group in sorted(file["extra"].items())
        }
        peaks = file.attrs.get("has_peak_nodes")
        dialect, notes = _parse_dialect(file.attrs["dialect"])
        return SID(
            mass=float(file.attrs["mass"]),
            labels=tuple(self._texts(file["labels"])),
            nodes=self._nodes(file["nodes"]),
            title=_decode_text(file.attrs["title"]),
            extra=extra,
            dialect=dialect,
            written_by=_decode_text(file.attrs.get("written_by", "sidtool")),
            carried=self._carried(file),
            diagnostics=(
                read_diagnostics(file["diagnostics"])
                if "diagnostics" in file
                else notes
            ),
            from_matrices=bool(file.attrs.get("from_matrices", False)),
            has_peak_nodes=None if peaks is None else bool(peaks),
            sections=tuple(
                Section(
                    _decode_text(group.attrs["name"]),
                    self.sid(group["part"]),
                    tuple(self._texts(group["beyond"])),
                )
                for _, group in sorted(file.get("sections", {}).items())
            ),
            **blocks,
        )

    def _carried(self, file: h5py.Group) -> ComplianceShares | None:
        if "carried" not in file:
            return None
        group = file["carried"]
        rows = self._numbers(group.id, "shares", 2).tolist()
        known_rows = [tuple(None if math.isnan(x) else x for x in row) for row in rows]
        names = self._texts(group["id"])
        lost = tuple(float(x) for x in group.attrs["lost"])
        if {len(row) for row in known_rows} - {6} or len(lost) not in (0, 6, 9, 12):
            raise ValueError("shares are not given by direction")
        shares = dict(zip(names, known_rows, strict=True))
        return ComplianceShares(bool(group.attrs["free"]), shares, lost)

    def _block(self, group: h5py.Group) -> Taylor:
        parts = {
            part: self._numbers(group.id, part, 3) if part in group else None
            for part in PARTS
        }
        m0 = self._numbers(group.id, "m0", 2)
        return Taylor(m0, order=int(group.attrs["order"]), **parts)

    def _nodes(self, group: h5py.Group) -> tuple[Node, ...]:
        ids, frames = self._texts(group["id"]), self._texts(group["rframe"])
        stacks: dict[str, dict[int, Any]] = {
            name: self._stack(group[name]) if name in group else {}
            for name in NODE_SHAPES
        }
        return tuple(
            Node(
                id=name,
                rframe=frame,
                sigma=stacks["sigma"].get(index),
                **{entry: stacks[entry][index] for entry in stacks if entry != "sigma"},
            )
            for index, (name, frame) in enumerate(zip(ids, frames, strict=True))
        )

    def _stack(self, group: h5py.Group) -> dict[int, Taylor]:
        place = group.id
        m0 = self._numbers(place, "m0", 3)
        linear: dict[int, Array] = {}
        if "m1" in group:
            m1 = self._numbers(place, "m1", 4)
            linear = dict(zip(self._indices(place, "m1_node"), m1, strict=True))
        higher = set(group["mn"]) if "mn" in group else ()
        nodes, orders = self._indices(place, "node"), self._indices(place, "order")
        return {
            node: Taylor(
                value,
                linear.get(node),
                self._numbers(place, f"mn/{node}", 3) if str(node) in higher else None,
                order,
            )
            for node, order, value in zip(nodes, orders, m0, strict=True)
        }

    def _numbers(self, group: h5py.h5g.GroupID, name: str, dimensions: int) -> Array:
        expected = f"{dimensions} dimensions of real numbers"
        found = self._array(group, name, "f", dimensions, expected)
        return np.asarray(found, dtype=np.float64)

    def _indices(self, group: h5py.h5g.GroupID, name: str) -> list[int]:
        found = self._array(group, name, "iu", 1, "a list of integers")
        indices: list[int] = found.tolist()
        return indices

    def _array(
        self,
        group: h5py.h5g.GroupID,
        name: str,
        kinds: str,
        dimensions: int,
        expected: str,
    ) -> NDArray[Any]:
        dataset = open_dataset(group, name.encode())
        if dataset.dtype.kind not in kinds or dataset.rank != dimensions:
            raise self._wrong(dataset, expected)
        return stored_array(dataset)

    def _texts(self, dataset: h5py.Dataset) -> list[str]:
        if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim != 1:
            raise self._wrong(dataset.id, "a list of texts")
        return [str(text) for text in dataset.asstr()[:]]

    def _wrong(self, dataset: h5py.h5d.DatasetID, expected: str) -> InputError:
        return InputError(
            f"has shape {dataset.shape} and type {dataset.dtype}",
            source=self._source,
            place=f"dataset {h5py.h5i.get_name(dataset).decode()}",
            expected=expected,
        )


def _parse_dialect(text: object) -> tuple[Dialect, tuple[Diagnostic, ...]]:
    stored = json.loads(_decode_text(text))
    known = {item.name: stored[item.name] for item in fields(Dialect)}
    notes = stored.get("notes", [])  # of files of sidtool 0.1
    if not all(isinstance(value, str) for value in (*known.values(), *notes)):
        raise ValueError("the dialect is not made of texts")
    return Dialect(**known), tuple(map(plain_text, notes))


def _decode_text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"found {type(value).__name__} instead of a text")
    return value


CANONICAL = "fembs"


@dataclass(frozen=True)
class SIDFormat:
    """A way to store a SID.

    Attributes
    ----------
    name : how messages call it
    suffixes : file name endings that choose it for writing; empty: all others
    signatures : first bytes of such files; empty: all others
    read, write : path to SID, and path, SID and dialect to file
    """

    name: str
    suffixes: tuple[str, ...]
    signatures: tuple[bytes, ...]
    read: Callable[[str | os.PathLike[str]], SID]
    write: Callable[[str | os.PathLike[str], SID, str], None]


def _write_hdf5(path: str | os.PathLike[str], sid: SID, dialect: str) -> None:
    if dialect != CANONICAL:
        raise InputError(
            f"HDF5 knows no dialect '{dialect}'",
            source=path,
            expected="a dialect with an ASCII file, such as .SID_FEM",
        )
    write_hdf5(path, sid)


def _write_ascii(path: str | os.PathLike[str], sid: SID, dialect: str) -> None:
    write_ascii(path, sid, dialect)
    if sid.sections:
        warn_of(diagnose("N173", Path(path).name, count=len(sid.sections)))


#: The last one takes what no other does.
FORMATS = (
    SIDFormat("HDF5", (".h5", ".hdf5"), SIGNATURES, read_hdf5, _write_hdf5),
    SIDFormat("ASCII", (), (), read_ascii, _write_ascii),
)


def read_sid(path: str | os.PathLike[str]) -> SID:
    """Read the SID in a file of any known format and dialect.

    The content decides what the file is, except that an empty or damaged file is
    judged by its name. `SID.dialect` states how the file was written. A file that was
    read before and has the same content gives the same object.

    Raises
    ------
    InputError : there is no such file, or it is not a SID; names file and line.
    """
    source = Path(path)
    if not source.is_file():
        if source.exists() and not source.is_dir():
            problem, expected = "is a pipe or a device", "a regular file"
            raise InputError(problem, source=source, expected=expected)
        raise unreadable_error(source, "a SID file, ASCII or HDF5")
    content = _content_key(source)
    if content is not None and (known := _READ.get(content)) is not None:
        return known
    sid = _format_by_content(source).read(source)
    if content is not None and _content_key(source) == content:
        _READ[content] = sid
        while len(_READ) > MAX_READ:
            _READ.pop(next(iter(_READ)), None)
    return sid


def _content_key(source: Path) -> tuple[str, bytes] | None:
    """Name and check sum of a file, None of one that is not kept."""
    try:
        if source.stat().st_size > MAX_SIZE:
            return None
        return source.name, hashlib.sha256(source.read_bytes()).digest()
    except OSError:
        return None


def write_sid(path: str | os.PathLike[str], sid: SID, dialect: str = CANONICAL) -> None:
    """Write a SID; .h5 and .hdf5 give HDF5, any other name ASCII.

    Parameters
    ----------
    path : file to create or replace; it appears wholly or not at all
    sid : any body without NaN and infinity
    dialect : of an ASCII file: "fembs" (canonical), "pysid", "matmorembs", "fembeam"

    Raises
    ------
    InputError : the body cannot be stored, or not at this place.
    OSError : the file cannot be written whole, as on a full disk.
    """
    check_ending(path, "sid")
    try:
        _format_by_name(Path(path)).write(path, sid, dialect)
    except ValueError as error:
        problem = f"cannot hold a text of this body ({error})"
        raise InputError(problem, source=path, expected="printable text") from error
    except InputError as error:
        raise error.located(path) from error


def _format_by_content(path: Path) -> SIDFormat:
    try:
        with path.open("rb") as stream:
            start = stream.read(16)
    except OSError as error:
        raise unreadable_error(path, "a SID file", error) from error
    for known in FORMATS:
        if start.startswith(known.signatures):
            return known
    return FORMATS[-1] if _is_text(start) else _format_by_name(path)


def _is_text(start: bytes) -> bool:
    return bool(start.strip()) and all(9 <= byte <= 13 or byte >= 32 for byte in start)


def _format_by_name(path: Path) -> SIDFormat:
    suffix = path.suffix.lower()
    return next(known for known in FORMATS if suffix in (known.suffixes or (suffix,)))
