"""Contents of bulk data; cards without effect; order of nodes of solid elements.

Plane elements and bars without a material beside solids only name node sets:
pre-processors such as Gmsh write them for the surfaces and lines of a solid. Solids
that count their nodes left-handed, which Nastran accepts, are reordered.
Nodes in coordinate systems of the file are transformed to the basic system.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ...mesh.connections import BarSection
from ...mesh.deck_text import RefusalCollector
from ...mesh.imported_mesh import RawCoupling, RawMass, rows_of_labels
from ...mesh.materials import ElasticMaterial
from ...mesh.reference_elements import edge_nodes, reference_element, shape_of
from .cards import Card, parse_member_groups

Point = tuple[float, float, float]


@dataclass(frozen=True)
class CoordinateSystem:
    """A rectangular (R), cylindrical (C) or spherical (S) system.

    Attributes
    ----------
    points : origin, a point of the z axis and one of the xz plane: nodes of CORD1, or
        places in the system `parent` of CORD2
    """

    label: int
    kind: str
    parent: int
    points: tuple[Point, ...] | tuple[int, ...]
    place: str


def systems_of(card: Card) -> list[CoordinateSystem]:
    """The systems of a card: one of CORD2, one or two of CORD1."""
    kind = card.name[-1]
    if card.name.startswith("CORD2"):
        values = [card.real(i, "a coordinate") for i in range(2, 11)]
        points = tuple((values[i], values[i + 1], values[i + 2]) for i in (0, 3, 6))
        label = card.integer(0, "a system")
        parent = card.integer(1, "a system", 0)
        return [CoordinateSystem(label, kind, parent, points, card.place)]
    systems = []
    for start in (0, 4):
        if card.word(start):
            label, *nodes = (card.integer(start + i, "a number") for i in range(4))
            systems.append(CoordinateSystem(label, kind, 0, tuple(nodes), card.place))
    return systems


class CoordinateSystems:
    """Positions and axes of systems in the basic one."""

    def __init__(
        self,
        nodes: Mapping[int, Point],
        local: Mapping[int, tuple[int, str]],
        systems: Mapping[int, CoordinateSystem],
    ) -> None:
        self._nodes, self._local, self._systems = nodes, local, systems
        self._known: dict[int, tuple[Array, Array]] = {}
        self._open: list[int] = []

    def node(self, label: int) -> Point:
        """A node in the basic system."""
        place = self._nodes[label]
        if label in self._local:
            system, where = self._local[label]
            place = self._basic(place, system, where)
        return place

    def named(self, label: int, place: str, who: str = "the card") -> Point:
        """A node in the basic system, which a card names.

        Raises
        ------
        InputError : it is not defined.
        """
        if label not in self._nodes:
            raise InputError(
                f"{who} names node {label}, which is not defined",
                place=place,
                expected="a node of this file",
            )
        return self.node(label)

    def is_rectangular(self, label: int, place: str) -> bool:
        """Whether the axes of a system are the same everywhere."""
        self.frame(label, place)
        return self._systems[label].kind == "R"

    def direction(self, node: int, label: int, number: int) -> Array:
        """The unit vector of a direction 1 to 3 that a system gives at a node.

        Raises
        ------
        InputError : the node is on the axis of a cylindrical or spherical system.
        """
        if label == 0:
            return np.asarray(np.eye(3)[number - 1])
        place = self._local.get(node, (0, ""))[1]
        origin, (x, y, z) = self.frame(label, place)
        arm = np.array(self.node(node)) - origin
        kind = self._systems[label].kind
        if kind == "R":
            return np.asarray((x, y, z)[number - 1])
        if kind == "C" and number == 3:  # also on the axis
            return np.asarray(z)
        across = arm - (arm @ z) * z
        if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(arm) or not arm.any():
            raise InputError(
                f"node {node} is on the axis of the system {label} of its directions",
                place=place,
                expected="directions that exist there",
            )
        r = across / np.linalg.norm(across)
        around = np.cross(z, r)
        if kind == "C":
            return np.asarray((r, around, z)[number - 1])
        out = arm / np.linalg.norm(arm)
        return np.asarray((out, np.cross(around, out), around)[number - 1])

    def _basic(self, point: Point, label: int, place: str) -> Point:
        """A point of a system in the basic one."""
        if label == 0:
            return point
        origin, axes = self.frame(label, place)
        x = origin + axes.T @ _to_rectangular(point, self._systems[label].kind)
        return float(x[0]), float(x[1]), float(x[2])

    def frame(self, label: int, place: str) -> tuple[Array, Array]:
        """Origin, and rows x, y, z in the basic system.

        Raises
        ------
        InputError : the system is not defined, in terms of itself, or has no axes.
        """
        if label == 0:
            return np.zeros(3), np.eye(3)
        if label in self._known:
            return self._known[label]
        if label not in self._systems or label in self._open:
            what = "in terms of itself" if label in self._open else "not defined"
            raise InputError(
                f"coordinate system {label} is {what}",
                place=place,
                expected="a system of this file",
            )
        system = self._systems[label]
        self._open.append(label)
        points = [self._point(system, point) for point in system.points]
        self._open.pop()
        a, b, c = (np.array(point) for point in points)
        y = np.cross(b - a, c - a)
        if not np.linalg.norm(y) > 1e-12 * np.linalg.norm(b - a) * np.linalg.norm(
            c - a
        ):
            raise InputError(
                f"the points of coordinate system {label} lie on one line",
                place=system.place,
                expected="origin, a point of the z axis, one of the xz plane",
            )
        z, y = (v / np.linalg.norm(v) for v in (b - a, y))
        self._known[label] = (a, np.array([np.cross(y, z), y, z]))
        return self._known[label]

    def _point(self, system: CoordinateSystem, point: Point | int) -> Point:
        if not isinstance(point, int):
            return self._basic(point, system.parent, system.place)
        return self.named(point, system.place, f"coordinate system {system.label}")


def _to_rectangular(point: Point, kind: str) -> Array:
    """Radius and angles in degrees as x, y, z."""
    r, first, second = point
    if kind == "R":
        return np.array(point)
    angle = np.radians(first)
    if kind == "C":
        return np.array([r * np.cos(angle), r * np.sin(angle), second])
    turn = np.radians(second)
    across = r * np.sin(angle)
    return np.array([across * np.cos(turn), across * np.sin(turn), r * np.cos(angle)])


_SET_PREFIXES = {1: "LINE", 2: "SURFACE"}
Position = tuple[float, float, float]
#: Shape of a solid -> its corners, seen in a mirror.
_MIRRORED = {
    "tet": (0, 2, 1, 3),
    "pyramid": (0, 3, 2, 1, 4),
    "wedge": (0, 2, 1, 3, 5, 4),
    "hex": (0, 3, 2, 1, 4, 7, 6, 5),
}


@dataclass(frozen=True)
class Property:
    """Property of solids, plane elements and shells.

    Attributes
    ----------
    system : coordinate system of the material axes
    flat : whether it is one of plane elements and shells
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
        """Return `law` and `transverse` for material axes at an angle [rad]."""
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
    """Property of bars and rods."""

    material: str
    section: BarSection
    place: str


@dataclass
class BulkData:
    """Contents of bulk data; `shells` are requested, or plane elements.

    Attributes
    ----------
    gaps : set -> members of its ranges, some of which may be undefined
    panels : shells that are shear panels
    bars, mass_cards : cards of bars and rods, and of masses
    scalar_masses : mass of every PMASS
    bar_defaults : fields that cards CBAR and CBEAM omit
    torsionless : bars without torsional stiffness
    moduli : E, G and density of MAT1 for bars
    corners : plane element -> its own thicknesses at the corners as they are written,
        and last its field TFLAG
    local : node -> the system it is given in, -1 for that of GRDSET, and location
    turned : node -> the system of its directions, in which MPC counts, -1 likewise
    multipoint, sums : set -> cards MPC, and sets of MPCADD with their cards
    density : density of materials without RHO, to which PARAM WTMASS does not apply
    completed : materials that have this density
    chosen : sets of MPC that case control selects
    controlled : whether there is case control
    heated : whether it selects temperatures; of bulk data alone, whether they hold some
    temperature_laws : cards of materials that depend on temperature
    unread_keywords : cards and fields without effect
    name_only : diagnostics of elements that only name nodes
    stops : reasons to refuse the file
    frames : coordinate systems, with the nodes as the file gives them
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: list[tuple[int, int, str, list[int], str]] = field(default_factory=list)
    properties: dict[int, Property] = field(default_factory=dict)
    corners: dict[int, list[str]] = field(default_factory=dict)
    shell_fields: dict[int, list[str]] = field(default_factory=dict)
    shell_cards: dict[int, Card] = field(default_factory=dict)
    panels: set[int] = field(default_factory=set)
    plane: dict[str, PlaneLaw] = field(default_factory=dict)
    springs: list[Card] = field(default_factory=list)
    spring_properties: dict[int, tuple[str, tuple[float, ...]]] = field(
        default_factory=dict
    )
    bars: list[Card] = field(default_factory=list)
    bar_defaults: dict[str, Card] = field(default_factory=dict)
    bar_properties: dict[int, BarProperty] = field(default_factory=dict)
    torsionless: set[int] = field(default_factory=set)
    moduli: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    materials: dict[str, ElasticMaterial | None] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    gaps: dict[str, set[int]] = field(default_factory=dict)
    unread_keywords: dict[str, None] = field(default_factory=dict)
    weight: float = 1.0
    couplings: list[RawCoupling] = field(default_factory=list)
    masses: list[RawMass] = field(default_factory=list)
    scalar_masses: dict[int, float] = field(default_factory=dict)
    mass_cards: list[Card] = field(default_factory=list)
    systems: dict[int, CoordinateSystem] = field(default_factory=dict)
    local: dict[int, tuple[int, str]] = field(default_factory=dict)
    turned: dict[int, int] = field(default_factory=dict)
    system: int = 0
    directions: int = 0
    multipoint: dict[int, list[Card]] = field(default_factory=dict)
    sums: dict[int, Card] = field(default_factory=dict)
    chosen: dict[int, None] = field(default_factory=dict)
    controlled: bool = False
    heated: bool = False
    temperature_laws: list[Card] = field(default_factory=list)
    shells: bool = False
    density: float | None = None
    completed: set[str] = field(default_factory=set)
    name_only: tuple[Diagnostic, ...] = ()
    frames: CoordinateSystems = field(
        default_factory=lambda: CoordinateSystems({}, {}, {})
    )
    stops: RefusalCollector = field(default_factory=RefusalCollector)

    def extend_set(self, name: str, words: list[str], place: str) -> None:
        """Add numbers and ranges to a node set.

        Raises
        ------
        InputError : they are none.
        """
        for labels in parse_member_groups(words, place):
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
        """Return the density of a card, or the one that completes it."""
        if rho or self.density is None:
            return rho
        self.completed.add(material)
        return self.density

    def weight_of(self, material: str) -> float:
        """Return the factor of the density of a material."""
        return 1.0 if material in self.completed else self.weight

    def direction_system(self, node: int) -> int:
        """The system of the directions of a node."""
        system = self.turned[node]
        return self.directions if system < 0 else system

    def direction_systems(self) -> dict[int, str]:
        """Return the direction systems of all nodes, with the location of one node."""
        return {self.direction_system(n): p for n, (_, p) in self.local.items()}


def duplicate_error(what: str, name: object, card: Card) -> InputError:
    """Return the error of a duplicate definition."""
    return InputError(
        f"{what} {name} is defined twice", place=card.place, expected="one definition"
    )


#: Loads, supports, results, and data beyond linear elasticity.
_NO_EFFECT = """
    ACCEL ACCEL1 ASET ASET1 AUTOSPC BSET BSET1 CSET CSET1 DAREA
    DCONSTR DEBUG DELAY DESVAR DLOAD DPHASE DRESP1 DVPREL1 EIGB EIGC
    EIGP EIGR EIGRL FORCE FORCE1 FORCE2 FREQ FREQ1 FREQ2 FREQ3 FREQ4 FREQ5 GRAV LOAD
    LSEQ MAT4 MATS1 MOMENT MOMENT1 MOMENT2 NLPARM NLPCI OMIT OMIT1 PLOAD PLOAD1 PLOAD2
    PLOAD4 PLOTEL QSET QSET1 RANDPS RFORCE RLOAD1 RLOAD2 SPCADD SPCD SPCR SUPORT
    SUPORT1 TABDMP1 TABLED1 TABLED2 TABLED3 TABLED4 TABLES1 TABRND1 TEMP TEMPD TEMPP1
    TIC TLOAD1 TLOAD2 TSTEP TSTEPNL USET USET1 EPOINT SPOINT SET3
    BNDFIX BNDFIX1 BNDFREE BNDFRE1 DOPTPRM DLINK DVMREL1 DVCREL1 TABLEM1
    TABLEM2 TABLEM3 TABLEM4 CNGRNT
    CBARAO YPARAM PLOTOPT PLOTG SEQGP DTI DMI NLSTEP NLMOPT NLADAPT TSTEP1 GROUP SET2
    PLOADX1 PLOADB3 PRESAX SPCOFF SPCOFF1 SPC2 DAMPING HYBDAMP TABDMP2 TABRNDG RANDT1
    DEFORM SLOAD RANDVAR RVDOF RVDOF1
    FREQV TEMPRB TEMPBC TEMPP2 TEMPP3 TEMPB3 TEMPF TEMPN1 CREEP ECHOON ECHOOFF
    NOLIN1 NOLIN2 NOLIN3 NOLIN4 ACSRCE UXVEC LOADCYN LOADCYH DYNRED EIGRZ
"""
#: Aerodynamics, whose splines only name nodes.
_AERODYNAMIC = """
    AERO AEROS AEFACT AELIST AELINK AELIST AESTAT AESURF AESURFS AEPARM AECOMP AECOMPL
    AEDW AEFORCE AEGRID AEPRESS AEQUAD4 AETRIA3 CAERO1 CAERO2 CAERO3 CAERO4 CAERO5
    PAERO1 PAERO2 PAERO3 PAERO4 PAERO5 SPLINE1 SPLINE2 SPLINE3 SPLINE4 SPLINE5 SPLINE6
    SPLINE7 SPLINEX SPBLND1 SPBLND2 SPLINRB MKAERO1 MKAERO2 FLUTTER FLFACT GUST MONPNT1
    MONPNT2 MONPNT3 MONDSP1 MONSUM MONSUM1 MONCNCM TRIM TRIM2 DIVERG CSSCHD DMIJ DMIK
    DMIJI
"""
#: Optimisation, which does not change the present body.
_OPTIMISATION = """
    DRESP2 DRESP3 DEQATN DSCREEN DTABLE DTABLE2 DCONADD DCONSTR DVTREL1 DVCREL2 DVMREL2
    DVPREL2 DVLREL1 DVPSURF DVGRID DVSHAP DVBSHAP DVSET DDVAL DMNCON BEADVAR TOPVAR
    TOMVAR DRESP DREPEAT DLINK2 DVEREL1
"""
#: Heat transfer.
_HEAT_TRANSFER = """
    CHBDYE CHBDYG CHBDYP PHBDY CONV CONVM PCONV PCONVM RADBC RADM RADMT RADSET RADLST
    RADCAV RADMTX RADBND VIEW VIEW3D VIEWEX QBDY1 QBDY2 QBDY3 QHBDY QVECT QVOL MAT4 MAT5
    MATT4 MATT5 TEMPG BDYOR
"""
#: Damping, which is that of the model file.
_DAMPING = """
    CDAMP1 CDAMP2 CDAMP3 CDAMP4 CDAMP5 PDAMP PDAMP5 CVISC PVISC PDAMPT
"""
#: Alternatives to refused cards.
ALTERNATIVES = {
    "CBEND": "CBAR with the same section",
    **dict.fromkeys(
        ("CELAS3", "CELAS4", "CBUSH1D", "CBUSH2D", "CGAP"),
        "a force in the scene between markers",
    ),
    **dict.fromkeys(("CMASS3", "CMASS4"), "CONM2"),
}
WITHOUT_EFFECT = frozenset(
    " ".join(
        (_NO_EFFECT, _AERODYNAMIC, _OPTIMISATION, _HEAT_TRANSFER, _DAMPING)
    ).split()
)


def property_node_sets(content: BulkData) -> tuple[Diagnostic, ...]:
    """Make node sets SURFACE2, LINE1, ... of such elements, by their property.

    Returns
    -------
    diagnostics of them
    """
    dimensions = [
        reference_element(kind).dimension for _, _, kind, *_ in content.elements
    ]
    top = max(dimensions, default=1)
    elements, bars = [], []
    node_sets: dict[str, list[int]] = {}
    for element, dimension in zip(content.elements, dimensions, strict=True):
        _, label, _, nodes, _ = element
        given = content.properties.get(label)
        if dimension == top or (given and given.flat and given.material):
            elements.append(element)
        else:
            node_sets.setdefault(f"{_SET_PREFIXES[dimension]}{label}", []).extend(nodes)
    for card in content.bars:
        label = card.integer(1, "a property", card.integer(0, "an element number"))
        if top == 1 or card.name == "CONROD" or label in content.bar_properties:
            bars.append(card)
        else:
            nodes = [card.integer(i, "a node") for i in (2, 3)]
            node_sets.setdefault(f"{_SET_PREFIXES[1]}{label}", []).extend(nodes)
    omitted = len(content.elements) + len(content.bars) - len(elements) - len(bars)
    content.elements, content.bars = elements, bars
    for name, nodes in node_sets.items():
        content.sets.setdefault(name, []).extend(nodes)
    if not omitted:
        return ()
    names = list(node_sets)
    reason = f"without a material ({', '.join(names)})"
    return (diagnose("N111", count=omitted, reason=reason, sets=names),)


def reorder_left_handed(content: BulkData) -> None:
    """Give the nodes of left-handed solids the order of right-handed ones.

    An element counts as left-handed if the Jacobian determinant is negative at all of
    its quadrature points. Elements of mixed sign are refused elsewhere.
    """
    by_kind: dict[str, list[int]] = {}
    for row, (_, _, kind, *_) in enumerate(content.elements):
        if content.nodes and shape_of(kind) in _MIRRORED:
            by_kind.setdefault(kind, []).append(row)
    for kind, rows in by_kind.items():
        listed = [content.elements[row][3] for row in rows]
        for k in _is_left_handed(kind, listed, content.nodes):
            label, property_, _, nodes, place = content.elements[rows[k]]
            order = [nodes[i] for i in mirrored_order(kind)]
            content.elements[rows[k]] = label, property_, kind, order, place


def _is_left_handed(
    kind: str, elements: list[list[int]], positions: Mapping[int, Position]
) -> NDArray[np.int64]:
    labels = np.fromiter(positions, np.int64, len(positions))
    rows = rows_of_labels(labels, elements)
    corners = np.array([*positions.values()])[rows]
    negative = np.flatnonzero((rows >= 0).all(axis=1))
    for slopes in reference_element(kind).gradients:
        jacobians = np.swapaxes(corners[negative], 1, 2) @ slopes
        negative = negative[np.linalg.det(jacobians) < 0]
    return negative


@cache
def mirrored_order(kind: str) -> tuple[int, ...]:
    """The right-handed order of the nodes of a solid that counts them left-handed."""
    corners = _MIRRORED[shape_of(kind)]
    edges = edge_nodes(kind)
    number = {frozenset(edge): len(corners) + k for k, edge in enumerate(edges)}
    middles = [number[frozenset((corners[a], corners[b]))] for a, b in edges]
    return (*corners, *middles)
