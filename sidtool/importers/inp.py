"""Abaqus and CalculiX input files (.inp): nodes, elements, sets, materials.

Read are *NODE, *ELEMENT, *NSET, *ELSET, *MATERIAL with *ELASTIC and *DENSITY,
*SOLID SECTION, *INCLUDE and one *PART with its *INSTANCE. What else a deck may hold,
and what of it is refused, stands in `inp_keywords`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from formats.errors import InputError

from .imported import ImportedMesh, integers, numbers
from .inp_blocks import Block, read_blocks
from .inp_elements import ElementType, element_type, supported
from .inp_keywords import kind_of, readable

#: A generated set of more members is a damaged number.
_MOST_MEMBERS = 100_000_000
#: A node or element of an assembly by its instance ("" for the assembly's own).
Member = tuple[str, int]


@dataclass(frozen=True)
class Element:
    """An element of a deck."""

    label: int
    type: ElementType
    given: str
    nodes: list[int]
    place: str


@dataclass(frozen=True)
class Section:
    """A *SOLID SECTION."""

    elset: str
    material: str
    thickness: float | None
    place: str


@dataclass
class Scope:
    """What one part defines, or the assembly, or a flat file."""

    name: str = ""
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, Element] = field(default_factory=dict)
    nsets: dict[str, list[Member]] = field(default_factory=dict)
    elsets: dict[str, list[Member]] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)


@dataclass
class Deck:
    """A deck as it stands in its file.

    Attributes
    ----------
    assembly : also what a flat file defines
    parts, instances : by name; an instance names its part
    materials : name -> keyword -> rows of numbers
    said : keywords without effect
    remarks : sentences on what has another name here
    """

    assembly: Scope = field(default_factory=Scope)
    parts: dict[str, Scope] = field(default_factory=dict)
    instances: dict[str, str] = field(default_factory=dict)
    materials: dict[str, dict[str, list[list[float]]]] = field(default_factory=dict)
    said: dict[str, None] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    scope: Scope = field(default_factory=Scope)
    material: str = ""
    spelling: dict[str, str] = field(default_factory=dict)

    def name(self, text: str) -> str:
        """Names are the same in any case; the first spelling is kept."""
        plain = text.strip('"')
        return self.spelling.setdefault(plain.upper(), plain)


def read_inp(path: str | Path, ignored: frozenset[str] = frozenset()) -> ImportedMesh:
    """The mesh of an Abaqus or CalculiX input file.

    Parameters
    ----------
    ignored : keywords that are left out on purpose, in capitals

    Raises
    ------
    InputError : names file, line and expectation.
    """
    from .inp_mesh import mesh_of

    try:
        return mesh_of(read_deck(Path(path), ignored))
    except InputError as error:
        raise error.located(path) from None


def read_deck(path: Path, ignored: frozenset[str] = frozenset()) -> Deck:
    """All that a deck says of the body; see `read_inp`."""
    deck = Deck()
    deck.scope = deck.assembly
    in_step = False
    for block in read_blocks(path):
        in_step = block.keyword == "STEP" or (in_step and block.keyword != "END STEP")
        kind = kind_of(block, ignored)
        if kind == "read":
            block = readable(block)
            _READERS.get(block.keyword, _nothing)(deck, block)
        elif not in_step:
            deck.said[f"*{block.keyword}" + _REMARKS.get(kind, "")] = None
    return deck


_REMARKS = {
    "damping": " (damping is that of the model file)",
    "ignored": " (left out by geometry.ignore)",
}


def _nothing(deck: Deck, block: Block) -> None:
    """A keyword that only opens or closes something."""


def _part(deck: Deck, block: Block) -> None:
    name = deck.name(block.options.get("NAME", ""))
    if name in deck.parts:
        raise _twice("part", name, block.place)
    deck.scope = deck.parts.setdefault(name, Scope(name))


def _assembly(deck: Deck, block: Block) -> None:
    deck.scope = deck.assembly


def _instance(deck: Deck, block: Block) -> None:
    name = deck.name(block.options.get("NAME", ""))
    part = deck.name(block.options.get("PART", ""))
    moved = [word for words, _ in block.rows for word in words if word]
    if deck.instances or any(numbers(moved, block.place)):
        raise InputError(
            "several or displaced instances are not supported",
            place=block.place,
            expected="one part, or a flat input file",
        )
    if part not in deck.parts:
        raise InputError(
            f"names the part {part!r}, which is not defined",
            place=block.place,
            expected="a *PART of this file",
        )
    deck.instances[name] = part
    deck.scope = deck.parts[part]


def _nodes(deck: Deck, block: Block) -> None:
    if block.options.get("SYSTEM", "R").upper() not in ("R", ""):
        raise InputError(
            "uses a cylindrical or spherical system",
            place=block.place,
            expected="Cartesian coordinates",
        )
    labels = []
    for words, place in block.rows:
        (label,) = integers(words[:1], place, "a node number")
        values = numbers(_filled(words[1:]), place, "coordinates")
        if len(values) > 6:
            raise InputError(
                f"node {label} has {len(values)} coordinates",
                place=place,
                expected="at most 3, and 3 of a normal",
            )
        if label in deck.scope.nodes:
            raise _twice("node", label, place)
        x, y, z = (*values, 0.0, 0.0, 0.0)[:3]
        deck.scope.nodes[label] = (x, y, z)
        labels.append(label)
    if "NSET" in block.options:
        _extend(deck, deck.scope.nsets, block.options["NSET"], labels)


def _elements(deck: Deck, block: Block) -> None:
    given = block.options.get("TYPE", "").upper()
    kind = element_type(given)
    if kind is None:
        raise _unsupported(given, block.place)
    labels = []
    for words, place in _records(block, kind, given):
        label, *nodes = integers(words, place, "element and node numbers")
        if label in deck.scope.elements:
            raise _twice("element", label, place)
        deck.scope.elements[label] = Element(label, kind, given, nodes, place)
        labels.append(label)
    if "ELSET" in block.options:
        _extend(deck, deck.scope.elsets, block.options["ELSET"], labels)


def _records(
    block: Block, kind: ElementType, given: str
) -> list[tuple[list[str], str]]:
    """The words of every element, which may go over several lines."""
    records: list[tuple[list[str], str]] = []
    for words, place in block.rows:
        open_ = records and len(records[-1][0]) <= kind.count
        if open_:
            records[-1][0].extend(words)
        else:
            records.append((list(words), place))
    for words, place in records:
        if len(words) == kind.count + 1:
            continue
        if kind.kind is None:
            raise _unsupported(given, block.place)
        raise InputError(
            f"element {words[0]} ({given}) has {len(words) - 1} nodes",
            place=place,
            expected=f"{kind.count} nodes",
        )
    return records


def _nset(deck: Deck, block: Block) -> None:
    if "NSET" not in block.options:
        raise InputError("has no name", place=block.place, expected="NSET=NAME")
    name = block.options["NSET"]
    if "ELSET" not in block.options:
        return _members(deck, block, name, "nsets")
    elset = deck.name(block.options["ELSET"])
    known = deck.scope.elements
    members = deck.scope.elsets.get(elset)
    if members is None:
        raise _undefined_set(elset, block.place)
    nodes = dict.fromkeys(n for _, e in members if e in known for n in known[e].nodes)
    return _extend(deck, deck.scope.nsets, name, list(nodes))


def _elset(deck: Deck, block: Block) -> None:
    if "ELSET" not in block.options:
        raise InputError("has no name", place=block.place, expected="ELSET=NAME")
    _members(deck, block, block.options["ELSET"], "elsets")


def _members(deck: Deck, block: Block, name: str, which: str) -> None:
    instance = deck.name(block.options.get("INSTANCE", ""))
    if instance and instance not in deck.instances:
        raise InputError(
            f"names the instance {instance!r}, which is not defined",
            place=block.place,
            expected="an *INSTANCE above",
        )
    found: list[Member] = []
    for words, place in block.rows:
        if "GENERATE" in block.options:
            found += [(instance, n) for n in _generated(words, place)]
            continue
        for word in filter(None, words):
            found += _member(deck, which, instance, word, place)
    group = getattr(deck.scope, which)
    group.setdefault(deck.name(name), []).extend(found)


def _generated(words: list[str], place: str) -> range:
    values = integers([word for word in words if word], place, "first, last, step")
    first, last, step = (*values, 1)[:3] if len(values) > 1 else (1, 0, 0)
    if step < 1 or last < first or (last - first) // step > _MOST_MEMBERS:
        found = ", ".join(words)
        raise InputError(f"found {found!r}", place=place, expected="first, last, step")
    return range(first, last + 1, step)


def _member(
    deck: Deck, which: str, instance: str, word: str, place: str
) -> list[Member]:
    """A number or the name of a set, with or without its instance before a point."""
    own = getattr(deck.scope, which)
    if not instance and deck.name(word) in own:
        return list(own[deck.name(word)])
    head, point, tail = word.rpartition(".")
    if point and deck.name(head) in deck.instances:
        instance, word = deck.name(head), tail
    if word.lstrip("-").isdigit():
        return [(instance, int(word))]
    if instance in deck.instances:
        own = getattr(deck.parts[deck.instances[instance]], which)
    if deck.name(word) not in own:
        raise _undefined_set(word, place)
    return [(instance, label) for _, label in own[deck.name(word)]]


def _extend(
    deck: Deck, sets: dict[str, list[Member]], name: str, labels: list[int]
) -> None:
    sets.setdefault(deck.name(name), []).extend(("", label) for label in labels)


def _material(deck: Deck, block: Block) -> None:
    deck.material = deck.name(block.options.get("NAME", ""))
    if deck.material in deck.materials:
        raise _twice("material", deck.material, block.place)
    deck.materials[deck.material] = {}


def _property(deck: Deck, block: Block) -> None:
    table = deck.materials.get(deck.material)
    if not block.rows or table is None:
        raise InputError(
            f"*{block.keyword} stands alone",
            place=block.place,
            expected="a *MATERIAL before it and a line of numbers after it",
        )
    if block.keyword in table:
        raise _twice(f"*{block.keyword} of material", deck.material, block.place)
    kind = block.options.get("TYPE", "ISO").upper()
    if not kind.startswith("ISO"):
        raise InputError(
            f"elasticity of type {kind} is not supported",
            place=block.place,
            expected="isotropic elasticity",
        )
    table[block.keyword] = [numbers(_filled(w), place) for w, place in block.rows]


def _section(deck: Deck, block: Block) -> None:
    elset, material = (deck.name(block.options.get(k, "")) for k in _OF_SECTION)
    thickness = None
    if block.rows and any(block.rows[0][0]):
        words, place = block.rows[0]
        thickness = numbers(_filled(words[:1]), place)[0] or None
    deck.scope.sections.append(Section(elset, material, thickness, block.place))


_OF_SECTION = ("ELSET", "MATERIAL")
_READERS = {
    "PART": _part,
    "END PART": _assembly,
    "ASSEMBLY": _assembly,
    "INSTANCE": _instance,
    "END INSTANCE": _assembly,
    "NODE": _nodes,
    "ELEMENT": _elements,
    "NSET": _nset,
    "ELSET": _elset,
    "MATERIAL": _material,
    "ELASTIC": _property,
    "DENSITY": _property,
    "SOLID SECTION": _section,
}


def _filled(words: list[str]) -> list[str]:
    """A blank field is zero."""
    return [word or "0" for word in words]


def _twice(what: str, name: object, place: str) -> InputError:
    return InputError(
        f"{what} {name} is defined twice", place=place, expected="one definition"
    )


def _unsupported(given: str, place: str) -> InputError:
    return InputError(
        f"element type {given or '(none)'} is not supported",
        place=place,
        expected=supported(),
    )


def _undefined_set(name: str, place: str) -> InputError:
    return InputError(
        f"names the set {name!r}, which is not defined",
        place=place,
        expected="numbers or the name of a set above",
    )
