"""What bulk data says of a body, as its cards are read one by one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ...frontends.anisotropic import ElasticMaterial
from ..imported import RawCoupling, RawMass
from ..imported_bars import BarSection
from ..stops import Stops
from .cards import Card, member_groups
from .systems import Frames, System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Property:
    """Of solids, plane elements and shells.

    Attributes
    ----------
    system : the coordinate system of the material's axes
    flat : whether it is one of plane elements and shells
    layered : whether it is one of layers
    extra : mass per area
    """

    material: str
    thickness: float | None
    place: str
    system: int = 0
    flat: bool = False
    layered: bool = False
    extra: float = 0.0


@dataclass(frozen=True, eq=False)
class PlaneLaw:
    """A material of shells in its axes.

    Attributes
    ----------
    law : (3, 3) of plane stress, xx, yy and engineering xy
    transverse : (2, 2) of the shears xz and yz
    """

    law: Array
    transverse: Array
    density: float

    def turned(self, angle: float) -> tuple[Array, Array]:
        """`law` and `transverse` of material axes that stand at an angle [rad]."""
        c, s = np.cos(angle), np.sin(angle)
        strain = np.array(
            [
                [c * c, s * s, c * s],
                [s * s, c * c, -c * s],
                [-2 * c * s, 2 * c * s, c * c - s * s],
            ]
        )
        across = np.array([[c, s], [-s, c]])
        return strain.T @ self.law @ strain, across.T @ self.transverse @ across


@dataclass(frozen=True)
class BarProperty:
    """Of bars and rods."""

    material: str
    section: BarSection
    place: str


@dataclass
class BulkData:
    """What bulk data says of a body; `shells` are asked for, or plane elements.

    Attributes
    ----------
    gaps : set -> members of its ranges, which need not all be defined
    bars, mass_cards : cards of bars and rods, and CONM2
    bar_defaults : what cards CBAR and CBEAM leave out
    moduli : E, G and density of MAT1 as bars have them
    corners : plane element -> its own thicknesses at the corners as they are written,
        and last what TFLAG says of them
    shell_fields : plane element -> what it has behind its nodes
    shell_cards : property -> PSHELL or PCOMP
    plane : materials as shells have them
    springs : cards of springs
    spring_properties : property -> its card and stiffnesses
    local : node -> the system it is given in, -1 for that of GRDSET, and where
    turned : node -> the system of its directions, in which MPC counts, -1 likewise
    multipoint, sums : set -> cards MPC, and sets of MPCADD with their cards
    density : of materials without RHO, to which PARAM WTMASS does not apply
    completed : materials that have it
    chosen : sets of MPC that case control names
    controlled : whether there is case control
    apart : a sentence on elements that only name nodes
    stops : what refuses the file
    frames : the coordinate systems, with the nodes as the file gives them
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: list[tuple[int, int, str, list[int], str]] = field(default_factory=list)
    properties: dict[int, Property] = field(default_factory=dict)
    corners: dict[int, list[str]] = field(default_factory=dict)
    shell_fields: dict[int, list[str]] = field(default_factory=dict)
    shell_cards: dict[int, Card] = field(default_factory=dict)
    plane: dict[str, PlaneLaw] = field(default_factory=dict)
    springs: list[Card] = field(default_factory=list)
    spring_properties: dict[int, tuple[str, tuple[float, ...]]] = field(
        default_factory=dict
    )
    bars: list[Card] = field(default_factory=list)
    bar_defaults: dict[str, Card] = field(default_factory=dict)
    bar_properties: dict[int, BarProperty] = field(default_factory=dict)
    moduli: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    materials: dict[str, ElasticMaterial | None] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    gaps: dict[str, set[int]] = field(default_factory=dict)
    said: dict[str, None] = field(default_factory=dict)
    weight: float = 1.0
    couplings: list[RawCoupling] = field(default_factory=list)
    masses: list[RawMass] = field(default_factory=list)
    mass_cards: list[Card] = field(default_factory=list)
    systems: dict[int, System] = field(default_factory=dict)
    local: dict[int, tuple[int, str]] = field(default_factory=dict)
    turned: dict[int, int] = field(default_factory=dict)
    system: int = 0
    directions: int = 0
    multipoint: dict[int, list[Card]] = field(default_factory=dict)
    sums: dict[int, Card] = field(default_factory=dict)
    chosen: dict[int, None] = field(default_factory=dict)
    controlled: bool = False
    shells: bool = False
    density: float | None = None
    completed: set[str] = field(default_factory=set)
    apart: tuple[str, ...] = ()
    frames: Frames = field(default_factory=lambda: Frames({}, {}, {}))
    stops: Stops = field(default_factory=Stops)

    def extend_set(self, name: str, words: list[str], place: str) -> None:
        """Add numbers and ranges to a node set.

        Raises
        ------
        InputError : they are none.
        """
        for labels in member_groups(words, place):
            self.sets.setdefault(name, []).extend(labels)
            if isinstance(labels, range):
                self.gaps.setdefault(name, set()).update(labels)

    def close_gaps(self) -> None:
        """Remove the members of ranges that are not defined, as Nastran does."""
        for name, spanned in self.gaps.items():
            self.sets[name] = [
                n for n in self.sets[name] if n in self.nodes or n not in spanned
            ]

    def density_of(self, material: str, rho: float) -> float:
        """The density of a card, or that which completes it."""
        if rho or self.density is None:
            return rho
        self.completed.add(material)
        return self.density

    def weight_of(self, material: str) -> float:
        """What multiplies the density of a material."""
        return 1.0 if material in self.completed else self.weight

    def direction_system(self, node: int) -> int:
        """The system of the directions of a node."""
        system = self.turned[node]
        return self.directions if system < 0 else system

    def direction_systems(self) -> dict[int, str]:
        """Those of all nodes, with the place of one node."""
        return {self.direction_system(n): p for n, (_, p) in self.local.items()}


def twice(what: str, name: object, card: Card) -> InputError:
    """What is defined a second time."""
    return InputError(
        f"{what} {name} is defined twice", place=card.place, expected="one definition"
    )
