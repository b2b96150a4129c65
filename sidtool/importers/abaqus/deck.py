"""Contents of an Abaqus or CalculiX deck, and its node and element sets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.diagnostics import Diagnostic

from ...mesh.deck_text import parse_integers
from ...mesh.imported_mesh import MOST_MEMBERS
from .element_types import ElementType
from .keywords import Block

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
    """A *SOLID SECTION or *SHELL SECTION, with its instance if several form the body.

    `offset` is that of the nodes from the middle of a shell, by its thickness.
    """

    elset: str
    material: str
    thickness: float | None
    place: str
    orientation: str = ""
    instance: str = ""
    is_shell: bool = False
    offset: float = 0.0


@dataclass(frozen=True)
class SurfacePart:
    """A line of a *SURFACE: elements and a face, or nodes."""

    kind: str
    word: str
    face: str
    place: str


@dataclass
class Namespace:
    """Name space of a part, of the assembly, or of a flat file.

    Attributes
    ----------
    gaps : "nsets" or "elsets" and set -> members of its ranges, some of which may be
        undefined
    first : offset of the node and element numbers of the file
    instances : the same for instances that were merged here
    """

    name: str = ""
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, Element] = field(default_factory=dict)
    nsets: dict[str, list[Member]] = field(default_factory=dict)
    elsets: dict[str, list[Member]] = field(default_factory=dict)
    gaps: dict[tuple[str, str], set[Member]] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)
    surfaces: dict[str, list[SurfacePart]] = field(default_factory=dict)
    first: tuple[int, int] = (0, 0)
    instances: dict[str, tuple[int, int]] = field(default_factory=dict)


@dataclass
class CouplingDefinition:
    """A coupling or a mass as written in its file, and the block that defines
    its kind.
    """

    block: Block
    scope: Namespace
    kind: Block | None = None


@dataclass
class Deck:
    """Contents of a deck.

    Attributes
    ----------
    assembly : content of the assembly, or of a flat file
    parts, instances : by name; an instance names its part
    placement : of instances: translation, and two points and an angle of rotation
    names_only : whether CalculiX discretises the deck
    chosen, unused_instances : whether only a part of the file is the body, and the
        instances that are not used
    outside : labels of elements of the body's scope that are not used
    materials : name -> keyword -> rows of numbers
    kinds : elasticity types of anisotropic materials
    orientations : by name, those of a part after its name and a point
    unsorted : names of node sets that keep their order
    coupling_definitions, masses : couplings of nodes, and point masses
    equations, ties : equations between displacements with their axes, tied surfaces
    system : the current *SYSTEM: origin and axes, (4, 3)
    density : density of materials without *DENSITY
    temperatures : temperatures of nodes by *INITIAL CONDITIONS
    unread_keywords : keywords without effect
    diagnostics : of renamed and omitted contents
    """

    assembly: Namespace = field(default_factory=Namespace)
    parts: dict[str, Namespace] = field(default_factory=dict)
    instances: dict[str, str] = field(default_factory=dict)
    placement: dict[str, list[list[float]]] = field(default_factory=dict)
    names_only: bool = False
    chosen: bool = False
    unused_instances: tuple[str, ...] = ()
    outside: frozenset[int] = frozenset()
    materials: dict[str, dict[str, list[list[float]]]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    orientations: dict[str, Block] = field(default_factory=dict)
    unsorted: set[str] = field(default_factory=set)
    coupling_definitions: list[CouplingDefinition] = field(default_factory=list)
    masses: list[CouplingDefinition] = field(default_factory=list)
    equations: list[CouplingDefinition] = field(default_factory=list)
    ties: list[CouplingDefinition] = field(default_factory=list)
    density: float | None = None
    temperatures: set[float] = field(default_factory=set)
    unread_keywords: dict[str, None] = field(default_factory=dict)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    scope: Namespace = field(default_factory=Namespace)
    system: tuple[Namespace, Array] | None = None
    material: str = ""
    spelling: dict[str, str] = field(default_factory=dict)

    def close_gaps(self) -> None:
        """Remove the members of ranges that are not defined, as Abaqus does."""
        for scope in (self.assembly, *self.parts.values()):
            for (which, name), spanned in scope.gaps.items():
                sets = getattr(scope, which)
                sets[name] = [
                    member
                    for member in sets[name]
                    if member not in spanned or self._is_defined(scope, which, member)
                ]

    def _is_defined(self, scope: Namespace, which: str, member: Member) -> bool:
        instance, label = member
        if instance in self.instances:
            scope = self.parts[self.instances[instance]]
        return label in (scope.nodes if which == "nsets" else scope.elements)

    def own_name(self, text: str) -> str:
        """A name that belongs to the part that is being read."""
        return self.name(f"{self.scope.name}.{text}" if self.scope.name else text)

    def name(self, text: str) -> str:
        """Return the first spelling of a name; names do not depend on case."""
        plain = text.strip('"')
        return self.spelling.setdefault(plain.upper(), plain)


def resolve_name(
    deck: Deck, scope: Namespace, word: str
) -> tuple[Namespace | None, str]:
    """Return the scope that defines a name (also INSTANCE.NAME), and the name in it.

    The scope is None for an instance that is not part of the body.
    """
    head, point, tail = word.rpartition(".")
    name = deck.name(head)
    if point and name in deck.instances:
        return deck.parts[deck.instances[name]], tail
    return (None, tail) if point and name in deck.unused_instances else (scope, word)


def duplicate_error(what: str, name: object, place: str) -> InputError:
    return InputError(
        f"{what} {name} is defined twice", place=place, expected="one definition"
    )


def read_nset(deck: Deck, block: Block) -> None:
    if "NSET" not in block.options:
        raise InputError("has no name", place=block.place, expected="NSET=NAME")
    name = block.options["NSET"]
    if "UNSORTED" in block.options:
        deck.unsorted.add(deck.own_name(name))
    if "ELSET" not in block.options:
        return _read_members(deck, block, name, "nsets")
    elset = deck.name(block.options["ELSET"])
    known = deck.scope.elements
    members = deck.scope.elsets.get(elset)
    if members is None:
        raise _undefined_set(elset, block.place)
    undefined = next((e for _, e in members if e not in known), None)
    if undefined is not None:
        raise InputError(
            f"the set {elset!r} names element {undefined}, which is not defined",
            place=block.place,
            expected="a set of elements above",
        )
    nodes = dict.fromkeys(n for _, e in members for n in known[e].nodes)
    return extend_set(deck, deck.scope.nsets, name, list(nodes))


def read_elset(deck: Deck, block: Block) -> None:
    if "ELSET" not in block.options:
        raise InputError("has no name", place=block.place, expected="ELSET=NAME")
    _read_members(deck, block, block.options["ELSET"], "elsets")


def _read_members(deck: Deck, block: Block, name: str, which: str) -> None:
    instance = deck.name(block.options.get("INSTANCE", ""))
    if instance and instance not in deck.instances:
        raise InputError(
            f"names the instance {instance!r}, which is not defined",
            place=block.place,
            expected="an *INSTANCE above",
        )
    members: list[Member] = []
    for words, place in block.rows:
        if "GENERATE" in block.options:
            spread = [(instance, n) for n in parse_range(words, place)]
            gaps = deck.scope.gaps.setdefault((which, deck.name(name)), set())
            gaps.update(spread)
            members += spread
            continue
        for word in filter(None, words):
            members += members_of(deck, which, instance, word, place)
    group = getattr(deck.scope, which)
    group.setdefault(deck.name(name), []).extend(members)


def parse_range(words: Sequence[str], place: str) -> range:
    """The numbers of first, last and step."""
    values = parse_integers(
        [word for word in words if word], place, "first, last, step"
    )
    first, last, step = (*values, 1)[:3] if len(values) > 1 else (1, 0, 0)
    if step < 1 or last < first or (last - first) // step > MOST_MEMBERS:
        text = ", ".join(words)
        raise InputError(f"found {text!r}", place=place, expected="first, last, step")
    return range(first, last + 1, step)


def members_of(
    deck: Deck, which: str, instance: str, word: str, place: str
) -> list[Member]:
    """A number or the name of a set, with or without its instance before a point."""
    own = getattr(deck.scope, which)
    if not instance and deck.name(word) in own:
        return list(own[deck.name(word)])
    head, point, tail = word.rpartition(".")
    if point and deck.name(head) in deck.instances:
        instance, word = deck.name(head), tail
    if word.removeprefix("-").isdecimal():
        return [
            (instance, label) for label in parse_integers([word], place, "a number")
        ]
    if instance in deck.instances:
        own = getattr(deck.parts[deck.instances[instance]], which)
    if deck.name(word) not in own:
        raise _undefined_set(word, place)
    return [(instance, label) for _, label in own[deck.name(word)]]


def extend_set(
    deck: Deck, sets: dict[str, list[Member]], name: str, labels: Iterable[int]
) -> None:
    sets.setdefault(deck.name(name), []).extend(("", label) for label in labels)


def _undefined_set(name: str, place: str) -> InputError:
    return InputError(
        f"names the set {name!r}, which is not defined",
        place=place,
        expected="numbers or the name of a set above",
    )
