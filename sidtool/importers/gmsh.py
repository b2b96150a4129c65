"""Gmsh meshes (.msh), text or binary, versions 2.2 and 4.1.

Physical names become node sets. Solid elements make the body; if there are none, the
plane ones do. Elements of lower dimension only serve the sets.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError

from ..mesh.deck_text import (
    RefusalCollector,
    check_label,
    parse_integers,
    parse_numbers,
    read_lines,
)
from ..mesh.imported_mesh import (
    LEFT_OUT,
    ONLY_NODES,
    ImportedMesh,
    RawElement,
    assemble_mesh,
    check_defined,
    reading_notes,
    unread_keyword_notes,
)

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

_READ = ("MeshFormat", "PhysicalNames", "Entities", "Nodes", "Elements")
#: Sections with results and meshing data, which have no effect.
_WITHOUT_EFFECT = (
    "Comments",
    "ElementData",
    "ElementNodeData",
    "InterpolationScheme",
    "NodeData",
    "Parametrizations",
    "Periodic",
)


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


#: Gmsh type -> dimension, nodes, our name, our order of its nodes.
_TYPES: dict[int, tuple[int, int, str | None, tuple[int, ...] | None]] = {
    1: (1, 2, None, None),
    2: (2, 3, "tri3", None),
    3: (2, 4, "quad4", None),
    4: (3, 4, "tet4", None),
    5: (3, 8, "hex8", None),
    6: (3, 6, "wedge6", None),
    7: (3, 5, "pyramid5", None),
    8: (1, 3, None, None),
    9: (2, 6, "tri6", None),
    10: (2, 9, None, None),
    11: (3, 10, "tet10", (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)),
    15: (0, 1, None, None),
    16: (2, 8, "quad8", None),
    18: (3, 15, "wedge15", (*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11)),
    19: (3, 13, "pyramid13", (*range(5), 5, 8, 10, 6, 7, 9, 11, 12)),
    17: (
        3,
        20,
        "hex20",
        (*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
    ),
}


class _SectionLines:
    """The lines of one section, in order."""

    def __init__(self, name: str, lines: list[tuple[str, str]]) -> None:
        self.name = name
        self._lines: Iterator[tuple[str, str]] = iter(lines)

    def next(self) -> tuple[list[str], str]:
        for text, place in self._lines:
            return text.split(), place
        raise InputError(
            f"${self.name} ends early", expected=f"more lines before $End{self.name}"
        )

    def end(self) -> None:
        """Check that the section has no surplus lines.

        Raises
        ------
        InputError : there are surplus lines.
        """
        left = next(self._lines, None)
        if left is not None:
            raise InputError(
                f"${self.name} holds more than it announces: {left[0][:40]!r}",
                place=left[1],
                expected=f"$End{self.name}",
            )

    def count(self) -> int:
        """A line of one number."""
        values, place = self.integers(1)
        if len(values) > 1:
            raise InputError(
                f"has {len(values)} entries", place=place, expected="one number"
            )
        return values[0]

    def integers(self, count: int) -> tuple[list[int], str]:
        words, place = self.next()
        if len(words) < count:
            raise InputError(
                f"has {len(words)} entries", place=place, expected=f"{count} of them"
            )
        return parse_integers(words, place), place


@dataclass
class _MeshContent:
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    #: label, type, nodes, physical tags, place
    elements: list[tuple[int, int, list[int], list[int], str]] = field(
        default_factory=list
    )
    physical: dict[tuple[int, int], list[int]] = field(default_factory=dict)


def read_msh(
    path: str | Path,
    ignored: frozenset[str] = frozenset(),
    *,
    density: float | None = None,
) -> ImportedMesh:
    """The mesh of a Gmsh file, which has no materials that a density would complete.

    Raises
    ------
    InputError : the file is not valid; the error names file, line and expectation.
    """
    try:
        file = Path(path)
        lines = text_lines(file) if is_binary(file) else read_lines(path)
        sections = _split_sections(lines)
        unread = _unread_sections(sections, ignored)
        version = _format_version(sections)
        content = _MeshContent()
        _read_physical_names(content, sections)
        if version == 2:
            _read_nodes_2(content, _required_section(sections, "Nodes"))
            _read_elements_2(content, _required_section(sections, "Elements"))
        else:
            if "Entities" in sections:
                _read_entities(content, _required_section(sections, "Entities"))
            _read_nodes_4(content, _required_section(sections, "Nodes"))
            _read_elements_4(content, _required_section(sections, "Elements"))
        return _imported_mesh(content, unread)
    except InputError as error:
        raise error.located(path) from None


def _split_sections(lines: list[str]) -> dict[str, list[tuple[str, str]]]:
    sections: dict[str, list[tuple[str, str]]] = {}
    current: str | None = None
    for number, line in enumerate(lines, start=1):
        text, place = line.strip(), f"line {number}"
        if text.startswith("$End"):
            if text[4:] != current:
                raise InputError(
                    f"found {text}", place=place, expected=f"$End{current or '...'}"
                )
            current = None
        elif text.startswith("$"):
            if current is not None:
                raise InputError(
                    f"found {text}", place=place, expected=f"$End{current}"
                )
            current = text[1:]
            if current in sections and current in _READ:
                raise InputError(
                    f"holds ${current} twice", place=place, expected="one section"
                )
            sections[current] = []
        elif current is not None and text:
            sections[current].append((text, place))
    if current is not None:
        raise InputError(f"the file ends inside ${current}", expected=f"$End{current}")
    return sections


def _unread_sections(
    sections: dict[str, list[tuple[str, str]]], ignored: frozenset[str]
) -> list[str]:
    """The sections that are not read, as `unread_keyword_notes` takes them.

    Raises
    ------
    InputError : one of them may change the body.
    """
    others = [name for name in sections if name not in _READ]
    stops = RefusalCollector()
    for name in others:
        if ONLY_NODES in ignored or name.upper() in ignored:
            continue
        if name not in _WITHOUT_EFFECT:
            error = InputError(
                f"holds ${name}, which is not supported",
                expected=f'a mesh without it; geometry.ignore = ["{name}"] leaves it '
                "out",
            )
            stops.add(error, name)
    stops.check()
    return [
        f"${name}" if name in _WITHOUT_EFFECT else f"${name}{LEFT_OUT}"
        for name in others
    ]


def _required_section(
    sections: dict[str, list[tuple[str, str]]], name: str
) -> _SectionLines:
    if name not in sections:
        raise InputError(f"has no ${name}", expected=f"a section ${name}")
    return _SectionLines(name, sections[name])


def _format_version(sections: dict[str, list[tuple[str, str]]]) -> int:
    words, place = _required_section(sections, "MeshFormat").next()
    if words[:2] == ["2.2", "0"]:
        return 2
    if words[:2] == ["4.1", "0"]:
        return 4
    raise InputError(
        f"is of version {words[0]}, file type {' '.join(words[1:2])}",
        place=place,
        expected="version 2.2 or 4.1",
    )


def _read_physical_names(
    content: _MeshContent, sections: dict[str, list[tuple[str, str]]]
) -> None:
    if "PhysicalNames" not in sections:
        return
    lines = _required_section(sections, "PhysicalNames")
    announced = lines.count()
    named = sections["PhysicalNames"][1:]
    if announced != len(named):
        raise InputError(
            f"$PhysicalNames announces {announced} names and holds {len(named)}",
            expected="as many as it announces",
        )
    for text, place in named:
        words = text.split(maxsplit=2)
        if len(words) < 3:
            raise InputError(
                f"found {text[:40]!r}", place=place, expected='dimension tag "name"'
            )
        dimension, tag = parse_integers(words[:2], place)
        content.names[dimension, tag] = words[2].strip('"')


def _read_nodes_2(content: _MeshContent, lines: _SectionLines) -> None:
    for _ in range(lines.count()):
        words, place = lines.next()
        _add_node(content, parse_integers(words[:1], place)[0], words[1:], place)
    lines.end()


def _add_node(content: _MeshContent, label: int, words: list[str], place: str) -> None:
    if label < 1:
        check_label(label, place, "a node")
    values = parse_numbers(words, place, "x y z")
    if len(values) != 3 or label in content.nodes:
        several = f"has {len(values)} coordinates"
        problem = several if len(values) != 3 else "is defined twice"
        raise InputError(f"node {label} {problem}", place=place, expected="x y z, once")
    content.nodes[label] = (values[0], values[1], values[2])


def _read_elements_2(content: _MeshContent, lines: _SectionLines) -> None:
    for _ in range(lines.count()):
        values, place = lines.integers(3)
        label, kind, ntags = values[:3]
        tags = values[3 : 3 + ntags][:1]
        _add_element(content, label, kind, values[3 + ntags :], tags, place)
    lines.end()
    _merge_repeated_elements(content)


def _merge_repeated_elements(content: _MeshContent) -> None:
    """Merge elements that differ in their number and their physical group.

    In version 2.2 an element has one group. Gmsh writes an element of several groups
    once for each of them.
    """
    groups = {(kind, *tags) for _, kind, _, tags, _ in content.elements}
    counts = Counter(kind for kind, *_ in groups)
    if max(counts.values(), default=0) < 2:
        return
    known: dict[tuple[int, ...], list[int]] = {}
    merged = []
    for element in content.elements:
        _, kind, nodes, tags, _ = element
        if counts[kind] > 1:
            own = known.setdefault((kind, *nodes), tags)
            if own is not tags and not set(own).issuperset(tags):
                own += tags
                continue
        merged.append(element)
    content.elements = merged


def _add_element(
    content: _MeshContent,
    label: int,
    kind: int,
    nodes: list[int],
    tags: list[int],
    place: str,
) -> None:
    if label < 1:
        check_label(label, place, "an element")
    if kind not in _TYPES:
        raise InputError(
            f"element {label} is of type {kind}, which is not supported",
            place=place,
            expected="a Gmsh type among " + ", ".join(map(str, _TYPES)),
        )
    if len(nodes) != _TYPES[kind][1]:
        raise InputError(
            f"element {label} has {len(nodes)} nodes",
            place=place,
            expected=f"{_TYPES[kind][1]} nodes",
        )
    content.elements.append((label, kind, nodes, tags, place))


def _read_entities(content: _MeshContent, lines: _SectionLines) -> None:
    counts, _ = lines.integers(4)
    for dimension, count in enumerate(counts[:4]):
        for _ in range(count):
            words, place = lines.next()
            skip = 4 if dimension == 0 else 7
            (tag,) = parse_integers(words[:1], place)
            (n,) = parse_integers(words[skip : skip + 1] or ["0"], place)
            tags = parse_integers(words[skip + 1 : skip + 1 + n], place)
            content.physical[dimension, tag] = tags


def _read_nodes_4(content: _MeshContent, lines: _SectionLines) -> None:
    (blocks, *_), _ = lines.integers(4)
    for _ in range(blocks):
        (_, _, parametric, count, *_), place = lines.integers(4)
        labels = [lines.count() for _ in range(count)]
        for label in labels:
            words, place = lines.next()
            _add_node(content, label, words[:3] if parametric else words, place)
    lines.end()


def _read_elements_4(content: _MeshContent, lines: _SectionLines) -> None:
    (blocks, *_), _ = lines.integers(4)
    for _ in range(blocks):
        (dimension, entity, kind, count, *_), _ = lines.integers(4)
        tags = content.physical.get((dimension, entity), [])
        for _ in range(count):
            (label, *nodes), place = lines.integers(1)
            _add_element(content, label, kind, nodes, tags, place)
    lines.end()


def _imported_mesh(content: _MeshContent, unread: list[str]) -> ImportedMesh:
    top = max((_TYPES[kind][0] for _, kind, *_ in content.elements), default=0)
    if top < 2:
        raise InputError("has no plane or solid element", expected="a mesh of a body")
    raw, sets = [], {name: set[int]() for name in content.names.values()}
    for label, kind, nodes, tags, place in content.elements:
        dimension, _, ours, order = _TYPES[kind]
        check_defined(label, nodes, content.nodes, place)
        names = [
            content.names.get((dimension, abs(t)), f"{dimension}.{abs(t)}")
            for t in tags  # of a negative sign where the direction is reversed
        ]
        for name in names:
            sets.setdefault(name, set()).update(nodes)
        if dimension < top:
            continue
        if ours is None:
            raise InputError(
                f"element {label} is of type {kind}, which makes no body here",
                place=place,
                expected="serendipity elements (Mesh.SecondOrderIncomplete = 1)",
            )
        listed = nodes if order is None else [nodes[i] for i in order]
        raw.append(RawElement(label, ours, listed, place))
    found = reading_notes(content.nodes, raw, len(content.elements))
    found += unread_keyword_notes(unread)
    return ImportedMesh(
        assemble_mesh(content.nodes, raw, sets), diagnostics=tuple(found)
    )
