"""Binary Gmsh meshes (.msh 2.2 and 4.1) as the lines of their text form.

Source: Gmsh reference manual, "MSH file format". Sections are enclosed by $NAME and
$EndNAME; integers have 4 bytes, sizes and tags of version 4.1 have 8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError

#: Numbers of nodes by the number of a Gmsh type.
_NODES = {
    1: 2,
    2: 3,
    3: 4,
    4: 4,
    5: 8,
    6: 6,
    7: 5,
    8: 3,
    9: 6,
    10: 9,
    11: 10,
    12: 27,
    13: 18,
    14: 14,
    15: 1,
    16: 8,
    17: 20,
    18: 15,
    19: 13,
}
_HEAD = b"$MeshFormat"
#: Number of bytes that contain the format of a mesh.
_HEADER_BYTES = 200


class _SectionBytes:
    """The bytes of one section, read in order."""

    def __init__(self, name: str, data: bytes, order: str) -> None:
        self.order = order
        self._name, self._data, self._at = name, data, 0

    def numbers(self, kind: str, count: int) -> list[int] | list[float]:
        """Read numbers of a kind such as i4, u8 or f8.

        Raises
        ------
        InputError : the section ends before them.
        """
        return self.table([("x", kind, (count,))], 1)["x"][0].tolist()

    def table(self, fields: list[tuple[str, str, tuple[int]]], rows: int) -> NDArray:  # type: ignore[type-arg]
        """(rows,) records of fields of a name, a kind and a shape."""
        dtype = np.dtype([(name, self.order + kind, n) for name, kind, n in fields])
        size = rows * dtype.itemsize
        if rows < 0 or self._at + size > len(self._data):
            raise InputError(
                f"${self._name} ends early", expected="a whole binary mesh"
            )
        records = np.frombuffer(self._data, dtype, rows, self._at)
        self._at += size
        return records


def is_binary(path: Path) -> bool:
    """Check whether a mesh file is binary (file type 1)."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        words = file.read(_HEADER_BYTES).split()
    return words[:1] == [_HEAD] and words[2:3] == [b"1"]


def text_lines(path: Path) -> list[str]:
    """The lines that the mesh would have as text.

    Raises
    ------
    InputError : the file is cut off, or of another version.
    """
    data = path.read_bytes()
    words = data[:_HEADER_BYTES].split()
    version = words[1].decode("ascii", "replace")
    begin = data.find(b"\n", data.find(_HEAD) + len(_HEAD) + 1) + 1
    at = data.find(b"$EndMeshFormat", begin)
    if not 0 < begin <= at:
        raise InputError("the file ends inside $MeshFormat", expected="a whole mesh")
    one = data[begin : begin + 4]
    order = "<" if int.from_bytes(one, "little") == 1 else ">"
    lines = ["$MeshFormat", f"{version} 0 8", "$EndMeshFormat"]
    readers = _READERS.get(version)
    if readers is None or words[3:4] != [b"8"]:
        raise InputError(
            f"is of version {version}, binary",
            expected="version 2.2 or 4.1 with numbers of 8 bytes",
        )
    at += len(b"$EndMeshFormat")
    while (start := data.find(b"$", at)) >= 0:
        stop = data.find(b"\n", start)
        name = data[start + 1 : max(stop, start + 1)].strip().decode("ascii", "replace")
        end = data.find(f"\n$End{name}".encode(), stop)
        if stop < 0 or end < 0:
            raise InputError(f"the file ends inside ${name}", expected=f"$End{name}")
        body = data[stop + 1 : end]
        lines.append(f"${name}")
        if name in readers:
            lines += readers[name](_SectionBytes(name, body, order), body)
        elif name == "PhysicalNames":
            lines += body.decode("utf-8", "replace").splitlines()
        lines.append(f"$End{name}")
        at = end + len(name) + 5
    return lines


def _split_count_line(body: bytes) -> tuple[int, bytes]:
    """The number in the first line of a section of version 2.2, and what follows."""
    head, _, rest = body.partition(b"\n")
    if not head.strip().isdigit():
        raise InputError("has no number of entries", expected="a binary mesh")
    return int(head), rest


def _node_lines_2(given: _SectionBytes, body: bytes) -> Iterator[str]:
    count, rest = _split_count_line(body)
    section = _SectionBytes("Nodes", rest, given.order)
    yield str(count)
    table = section.table([("n", "i4", (1,)), ("x", "f8", (3,))], count)
    for (label,), place in zip(table["n"].tolist(), table["x"].tolist(), strict=True):
        yield f"{label} {place[0]!r} {place[1]!r} {place[2]!r}"


def _element_lines_2(given: _SectionBytes, body: bytes) -> Iterator[str]:
    count, rest = _split_count_line(body)
    section = _SectionBytes("Elements", rest, given.order)
    yield str(count)
    done = 0
    while done < count:
        kind, follow, tags = map(int, section.numbers("i4", 3))
        width = 1 + tags + _nodes_per_element(kind)
        for label, *words in section.table([("x", "i4", (width,))], follow)[
            "x"
        ].tolist():
            yield " ".join(map(str, (label, kind, tags, *words)))
        done += max(follow, 1)


def _nodes_per_element(kind: int) -> int:
    if kind not in _NODES:
        raise InputError(
            f"has elements of type {kind}", expected="a Gmsh type up to order two"
        )
    return _NODES[kind]


def _entity_lines_4(section: _SectionBytes, body: bytes) -> Iterator[str]:
    counts = [int(n) for n in section.numbers("u8", 4)]
    yield " ".join(map(str, counts))
    for dimension, count in enumerate(counts):
        for _ in range(count):
            (tag,) = section.numbers("i4", 1)
            places = section.numbers("f8", 3 if dimension == 0 else 6)
            words = [tag, *map(repr, places)]
            for _ in range(1 if dimension == 0 else 2):
                (own,) = section.numbers("u8", 1)
                words += [own, *section.numbers("i4", int(own))]
            yield " ".join(map(str, words))


def _node_lines_4(section: _SectionBytes, body: bytes) -> Iterator[str]:
    head = section.numbers("u8", 4)
    yield " ".join(map(str, head))
    for _ in range(int(head[0])):
        dimension, entity, parametric = map(int, section.numbers("i4", 3))
        (count,) = map(int, section.numbers("u8", 1))
        yield f"{dimension} {entity} {parametric} {count}"
        yield from map(str, section.numbers("u8", count))
        width = 3 + (dimension if parametric else 0)
        for row in section.table([("x", "f8", (width,))], count)["x"].tolist():
            yield " ".join(map(repr, row))


def _element_lines_4(section: _SectionBytes, body: bytes) -> Iterator[str]:
    head = section.numbers("u8", 4)
    yield " ".join(map(str, head))
    for _ in range(int(head[0])):
        dimension, entity, kind = map(int, section.numbers("i4", 3))
        (count,) = map(int, section.numbers("u8", 1))
        yield f"{dimension} {entity} {kind} {count}"
        width = 1 + _nodes_per_element(kind)
        for row in section.table([("x", "u8", (width,))], count)["x"].tolist():
            yield " ".join(map(str, row))


_Reader = Callable[[_SectionBytes, bytes], Iterator[str]]
_READERS: dict[str, dict[str, _Reader]] = {
    "2.2": {"Nodes": _node_lines_2, "Elements": _element_lines_2},
    "4.1": {
        "Entities": _entity_lines_4,
        "Nodes": _node_lines_4,
        "Elements": _element_lines_4,
    },
}
