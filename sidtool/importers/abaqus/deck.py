"""Contents of an Abaqus or CalculiX deck, and its node and element sets.

Element types of Abaqus and CalculiX: own element, formulation, differences.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic

from ...mesh.deck_text import parse_integers
from ...mesh.imported_mesh import MOST_MEMBERS
from ...mesh.reference_elements import ELEMENT_KINDS
from .keywords import BY_CALCULIX, Block

#: Element type without its suffix -> our name.
_KINDS = {
    "C3D4": "tet4",
    "C3D5": "pyramid5",
    "C3D6": "wedge6",
    "C3D8": "hex8",
    "C3D10": "tet10",
    "C3D13": "pyramid13",
    "C3D15": "wedge15",
    "C3D20": "hex20",
    "CPS3": "tri3",
    "CPS4": "quad4",
    "CPS6": "tri6",
    "CPS8": "quad8",
    "CPE3": "tri3",
    "CPE4": "quad4",
    "CPE6": "tri6",
    "CPE8": "quad8",
}
#: Suffixes after the number of nodes.
_SUFFIXES = "IRHMTSEPLV"
#: Types of point masses and of their inertia.
POINTS = ("MASS", "ROTARYI")
#: Types of reference nodes of *DISTRIBUTING COUPLING.
REFERENCES = ("DCOUP2D", "DCOUP3D")
#: Types of lines, triangles and quadrilaterals that pre-processors leave in a deck.
_LOWER = {
    **dict.fromkeys((*POINTS, *REFERENCES), (0, 1)),
    **dict.fromkeys(("T2D2", "T3D2", "B21", "B31", "B31R", "SPRINGA"), (1, 2)),
    **dict.fromkeys(("T3D3", "T2D3", "B22", "B32", "B32R"), (1, 3)),
    **dict.fromkeys(("S3", "S3R", "M3D3", "STRI3", "SFM3D3", "R3D3"), (2, 3)),
    **dict.fromkeys(("S4", "S4R", "M3D4", "M3D4R", "SFM3D4", "R3D4"), (2, 4)),
    **dict.fromkeys(("S6", "STRI65", "M3D6", "SFM3D6"), (2, 6)),
    **dict.fromkeys(("S8", "S8R", "M3D8", "M3D8R", "SFM3D8"), (2, 8)),
}
#: Shells of corner nodes that a section makes elements of the body -> ours.
_SHELLS = {"S3": "tri3", "S3R": "tri3", "S4": "quad4", "S4R": "quad4"}

#: Description of elements without an elastic body, and a remedy.
_FOREIGN = (
    (r"D$", "belongs to networks of fluids", "the elastic body alone"),
    (r"FC?3D", "is one of fluids", "the elastic body alone"),
    (r"(DC|DS|DG)[123CA]", "conducts heat only", "elements with displacements"),
    (r"CAX|SAX|MAX|RAX", "is axisymmetric", "the whole body in solids"),
    (r"CG?PEG|CGAX", "has generalised plane strain", "CPE or solids"),
    (r"SPRING|DASHPOT|GAP|CONN", "joins two points", "a force between markers"),
    (r"COH|C3D\d+P", "is not elastic alone", "elements with displacements"),
)
_IN_CALCULIX = {
    "tri3": "S3",
    "quad4": "S4",
    "tri6": "S6",
    "quad8": "S8",
    "tet4": "C3D4",
    "tet10": "C3D10",
    "wedge6": "C3D6",
    "wedge15": "C3D15",
    "hex8": "C3D8I",
    "hex20": "C3D20",
}
_FOR_CALCULIX = "solids, or shells, beams and trusses of CalculiX, as S8R, B31, T3D2"
#: A node or element of an assembly by its instance ("" for the assembly's own).
Member = tuple[str, int]


@dataclass(frozen=True)
class ElementType:
    """Meaning of an element type of a deck.

    Attributes
    ----------
    kind : our element, None for elements that only serve sets
    dimension, count : of the element, and of its nodes
    state : of a plane element
    formulation : of our element, if there is a choice
    replaced : differences from the deck, "" for none
    shell_kind : our shell element, "" for none
    """

    kind: str | None
    dimension: int
    count: int
    state: str | None = None
    formulation: str | None = None
    replaced: str = ""
    shell_kind: str = ""


def element_type(name: str) -> ElementType | None:
    """The type of this name in capitals; None for one that is not supported."""
    base = name.rstrip(_SUFFIXES)
    suffix = name[len(base) :]
    kind = _KINDS.get(base)
    if kind is None or kind not in ELEMENT_KINDS:
        lower = _LOWER.get(name)
        shell = _SHELLS.get(name, "")
        return None if lower is None else ElementType(None, *lower, shell_kind=shell)
    plane = base.startswith("CP")
    state = None
    if plane:
        state = "plane_stress" if base.startswith("CPS") else "plane_strain"
    formulation = None
    if kind in ("hex8", "quad4"):
        incompatible = "I" in suffix or "R" in suffix
        formulation = "incompatible_modes" if incompatible else "full_integration"
    count = int(kind.lstrip("abcdefghijklmnopqrstuvwxyz"))
    averaged = kind == "hex8" or (kind == "quad4" and state == "plane_strain")
    replaced = "; ".join(_replaced_properties(suffix, formulation, averaged))
    dimension = 2 if plane else 3
    return ElementType(kind, dimension, count, state, formulation, replaced)


def _replaced_properties(
    suffix: str, formulation: str | None, averaged: bool
) -> list[str]:
    """Describe differences from the deck; `averaged` if Abaqus uses B-bar."""
    notes = []
    if "R" in suffix:
        by = "full integration" if formulation is None else "incompatible modes"
        notes.append(f"reduced integration is replaced by {by}")
    if formulation == "full_integration" and averaged:
        notes.append("full integration as in CalculiX, without Abaqus' B-bar")
    if "H" in suffix:
        notes.append("the hybrid formulation is replaced by displacements alone")
    if "M" in suffix or ("I" in suffix and formulation is None):
        notes.append("the modified formulation is replaced by the plain one")
    if set(suffix) & set("TEPV"):
        notes.append("fields other than displacements are left out")
    return notes


def unsupported_element_text(
    name: str, place: str, *, by_calculix: bool = False
) -> InputError:
    """Return a text that an element type is not supported, and the reason.

    Parameters
    ----------
    by_calculix : True if CalculiX should discretise the deck
    """
    for pattern, what, instead in _FOREIGN:
        if re.match(pattern, name):
            return InputError(
                f"element type {name} is not supported: it {what}",
                place=place,
                expected=instead,
            )
    return InputError(
        f"element type {name or '(none)'} is not supported",
        place=place,
        expected=_FOR_CALCULIX if by_calculix else supported_types(),
    )


def calculix_type(kind: str) -> str:
    """The element of CalculiX for one of ours, shells for plane ones.

    Raises
    ------
    InputError : there is no such element.
    """
    known_type = _IN_CALCULIX.get(kind)
    if known_type is None:
        raise InputError(f"CalculiX has no {kind}", expected=", ".join(_IN_CALCULIX))
    return known_type


def supported_types() -> str:
    """The supported types, for a message."""
    known = ", ".join(base for base, kind in _KINDS.items() if kind in ELEMENT_KINDS)
    shells = ", ".join(_SHELLS)
    return f"{known}, {shells} with *SHELL SECTION, or {BY_CALCULIX}"


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
    if (
        len(values) > 3
        or step < 1
        or last < first
        or (last - first) // step > MOST_MEMBERS
    ):
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
