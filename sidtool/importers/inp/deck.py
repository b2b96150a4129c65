"""What an Abaqus or CalculiX deck holds, as it stands in its file."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from .blocks import Block
from .elements import ElementType

Array = NDArray[np.float64]

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
    """A *SOLID SECTION, of an instance where several make the body."""

    elset: str
    material: str
    thickness: float | None
    place: str
    orientation: str = ""
    instance: str = ""


@dataclass(frozen=True)
class SurfacePart:
    """A line of a *SURFACE: elements and a face, or nodes."""

    kind: str
    word: str
    face: str
    place: str


@dataclass
class Scope:
    """What one part defines, or the assembly, or a flat file.

    Attributes
    ----------
    gaps : "nsets" or "elsets" and set -> members of its ranges, which need not all be
        defined
    first : what the file's own node and element numbers here are raised by
    instances : the same for those of instances that were put together here
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
class Hold:
    """A coupling or a mass as it stands in its file, and what says its kind."""

    block: Block
    scope: Scope
    kind: Block | None = None


@dataclass
class Deck:
    """A deck as it stands in its file.

    Attributes
    ----------
    assembly : also what a flat file defines
    parts, instances : by name; an instance names its part
    placement : of instances: translation, and two points and an angle of rotation
    names_only : whether CalculiX discretises the deck
    chosen, absent : whether only a part of the file is the body, and instances that
        are not
    outside : labels of elements of the body's scope that are left out
    materials : name -> keyword -> rows of numbers
    kinds : of the elasticity of materials that are not isotropic
    orientations : by name, those of a part after its name and a point
    unsorted : node sets that keep their order, by names alike
    holds, masses : what holds nodes together, and point masses
    equations, ties : equations between displacements with their axes, tied surfaces
    system : that of *SYSTEM, where it holds: origin and axes, (4, 3)
    density : of materials without *DENSITY
    temperatures : that *INITIAL CONDITIONS gives nodes
    said : keywords without effect
    remarks : sentences on what has another name here
    """

    assembly: Scope = field(default_factory=Scope)
    parts: dict[str, Scope] = field(default_factory=dict)
    instances: dict[str, str] = field(default_factory=dict)
    placement: dict[str, list[list[float]]] = field(default_factory=dict)
    names_only: bool = False
    chosen: bool = False
    absent: tuple[str, ...] = ()
    outside: frozenset[int] = frozenset()
    materials: dict[str, dict[str, list[list[float]]]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    orientations: dict[str, Block] = field(default_factory=dict)
    unsorted: set[str] = field(default_factory=set)
    holds: list[Hold] = field(default_factory=list)
    masses: list[Hold] = field(default_factory=list)
    equations: list[Hold] = field(default_factory=list)
    ties: list[Hold] = field(default_factory=list)
    density: float | None = None
    temperatures: set[float] = field(default_factory=set)
    said: dict[str, None] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    scope: Scope = field(default_factory=Scope)
    system: tuple[Scope, Array] | None = None
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

    def _is_defined(self, scope: Scope, which: str, member: Member) -> bool:
        instance, label = member
        if instance in self.instances:
            scope = self.parts[self.instances[instance]]
        return label in (scope.nodes if which == "nsets" else scope.elements)

    def own_name(self, text: str) -> str:
        """A name that belongs to the part that is being read."""
        return self.name(f"{self.scope.name}.{text}" if self.scope.name else text)

    def name(self, text: str) -> str:
        """Names are the same in any case; the first spelling is kept."""
        plain = text.strip('"')
        return self.spelling.setdefault(plain.upper(), plain)


def owner_of(deck: Deck, scope: Scope, word: str) -> tuple[Scope | None, str]:
    """Where a name is defined, INSTANCE.NAME too, and the name there.

    None for an instance that is not part of the body.
    """
    head, point, tail = word.rpartition(".")
    name = deck.name(head)
    if point and name in deck.instances:
        return deck.parts[deck.instances[name]], tail
    return (None, tail) if point and name in deck.absent else (scope, word)


def twice(what: str, name: object, place: str) -> InputError:
    return InputError(
        f"{what} {name} is defined twice", place=place, expected="one definition"
    )
