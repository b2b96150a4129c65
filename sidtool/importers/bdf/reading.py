"""Nastran bulk data (.bdf, .nas, .dat): solids and plane elements, MAT1, sets,
coordinate systems of nodes, RBE2, RBE3 and CONM2.

Every card is read, listed as without effect on a linear elastic body, or refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from sidtool.formats.errors import InputError
from sidtool.formats.model import Material

from ..imported import (
    EVERYTHING,
    ImportedMesh,
    RawCoupling,
    RawElement,
    RawMass,
    assembled_mesh,
    reading_notes,
)
from .cards import Card, members, read_cards
from .couplings import conm2, rbe2, rbe3
from .systems import System, basic_places, systems_of
from .vocabulary import INSTEAD, WITHOUT_EFFECT

#: Card -> our elements by their number of nodes.
_ELEMENTS = {
    "CTETRA": {4: "tet4", 10: "tet10"},
    "CHEXA": {8: "hex8", 20: "hex20"},
    "CPENTA": {6: "wedge6", 15: "wedge15"},
    "CPYRAM": {5: "pyramid5", 13: "pyramid13"},
    "CQUAD4": {4: "quad4"},
    "CTRIA3": {3: "tri3"},
    "CQUAD8": {8: "quad8"},
    "CTRIA6": {6: "tri6"},
}
#: Nastran has the upright edges before those of the top.
_ORDERS = {
    "hex20": (*range(12), *range(16, 20), *range(12, 16)),
    "wedge15": (*range(9), *range(12, 15), *range(9, 12)),
}


@dataclass
class BulkData:
    """What bulk data says of a body; `shells` are asked for, or plane elements."""

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: list[tuple[int, int, str, list[int], str]] = field(default_factory=list)
    properties: dict[int, tuple[str, float | None]] = field(default_factory=dict)
    materials: dict[str, Material | None] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    said: dict[str, None] = field(default_factory=dict)
    weight: float = 1.0
    couplings: list[RawCoupling] = field(default_factory=list)
    masses: list[RawMass] = field(default_factory=list)
    systems: dict[int, System] = field(default_factory=dict)
    local: dict[int, tuple[int, str]] = field(default_factory=dict)
    system: int = 0
    shells: bool = False


def read_bdf(path: str | Path, ignored: frozenset[str] = frozenset()) -> ImportedMesh:
    """The mesh of a Nastran bulk data file.

    Parameters
    ----------
    ignored : cards that are left out on purpose, in capitals

    Raises
    ------
    InputError : names file, line and expectation.
    """
    try:
        return _imported(bulk_data(Path(path), ignored))
    except InputError as error:
        raise error.located(path) from None


def bulk_data(path: Path, ignored: frozenset[str], *, shells: bool = False) -> BulkData:
    """All cards of a file, with the nodes where they are in the basic system."""
    content = BulkData(shells=shells)
    for card in read_cards(path):
        _take(content, card, ignored)
    given = {
        n: (content.system if s < 0 else s, p) for n, (s, p) in content.local.items()
    }
    local = {n: (system, place) for n, (system, place) in given.items() if system}
    content.nodes.update(basic_places(content.nodes, local, content.systems))
    return content


def _take(content: BulkData, card: Card, ignored: frozenset[str]) -> None:
    if card.name in ignored:
        content.said[f"{card.name} (left out by geometry.ignore)"] = None
    elif card.name in _ELEMENTS:
        _element(content, card)
    elif card.name in _READERS:
        _READERS[card.name](content, card)
    elif card.name in WITHOUT_EFFECT or EVERYTHING in ignored:
        content.said[card.name] = None
    else:
        raise InputError(
            f"{card.name} is not supported",
            place=card.place,
            expected=f"{INSTEAD.get(card.name, 'bulk data without it')}; "
            f'geometry.ignore = ["{card.name}"] leaves it out',
        )


def _grid(content: BulkData, card: Card) -> None:
    label = card.integer(0, "a node number")
    if label in content.nodes:
        raise _twice("node", label, card)
    _only_zero(card, (7,), f"node {label} belongs to a superelement")
    x, y, z = (card.real(i, "a coordinate") for i in (2, 3, 4))
    content.nodes[label] = (x, y, z)
    content.local[label] = (card.integer(1, "a coordinate system", -1), card.place)
    if card.word(6):
        content.said["PS of GRID (supports)"] = None


def _grdset(content: BulkData, card: Card) -> None:
    _only_zero(card, (7,), "gives all nodes a superelement")
    content.system = card.integer(1, "a coordinate system", 0)


def _only_zero(card: Card, places: tuple[int, ...], problem: str) -> None:
    for i in places:
        if card.integer(i, "a number", 0):
            raise InputError(
                f"{problem} ({card.word(i)})",
                place=card.place,
                expected="nodes in the basic system",
            )


def _element(content: BulkData, card: Card) -> None:
    label = card.integer(0, "an element number")
    property_ = card.integer(1, "a property", label)
    most = max(_ELEMENTS[card.name])
    words = card.words[2 : 2 + most]
    while words and not words[-1]:
        words.pop()
    kind = _ELEMENTS[card.name].get(len(words))
    if kind is None or "" in words:
        raise InputError(
            f"element {label} is a {card.name} of {len(words) - words.count('')} nodes",
            place=card.place,
            expected=" or ".join(map(str, _ELEMENTS[card.name])),
        )
    nodes = [card.integer(2 + i, "a node number") for i in range(len(words))]
    further = [word for word in card.words[2 + most :] if word]
    flat = kind in ("quad4", "tri3", "quad8", "tri6")
    angle = 4 if kind == "quad8" else 0
    own = card.words[2 + most :]
    if content.shells and flat and any(own[:angle] + own[angle + 1 :]):
        raise InputError(
            f"element {label} has an offset or thicknesses of its own",
            place=card.place,
            expected="shells in the middle of their thickness, which PSHELL gives",
        )
    if flat and further:
        content.said[f"further fields of {card.name} (angles, offsets)"] = None
    order = _ORDERS.get(kind, range(len(nodes)))
    listed = [nodes[i] for i in order]
    content.elements.append((label, property_, kind, listed, card.place))


def _psolid(content: BulkData, card: Card) -> None:
    _property(content, card, None)
    chosen = [word for word in (card.word(3), card.word(5)) if word]
    if chosen:
        content.said[f"the integration {', '.join(chosen)} of PSOLID"] = None


def _pshell(content: BulkData, card: Card) -> None:
    if card.real(7, "a mass per area"):
        raise InputError(
            "has nonstructural mass",
            place=card.place,
            expected="densities that hold all mass",
        )
    _property(content, card, card.real(2, "a thickness") or None)
    if content.shells:
        _check_bending(card)
    else:
        content.said["bending of PSHELL: its elements are plane"] = None


def _check_bending(card: Card) -> None:
    """Whether a shell is one material through its thickness, which bends and shears."""
    one, bending = card.integer(1, "a material"), card.integer(3, "a material", 0)
    shear = card.integer(5, "a material", one)
    if bending != one or shear != one or card.real(4, "a ratio", 1.0) != 1.0:
        raise InputError(
            f"PSHELL {card.word(0)} has MID1 {one}, MID2 {bending}, MID3 {shear} and "
            f"12I/T3 {card.word(4) or 1}",
            place=card.place,
            expected="one material for membrane, bending and shear of a homogeneous "
            "thickness",
        )


def _property(content: BulkData, card: Card, thickness: float | None) -> None:
    label = card.integer(0, "a property")
    if label in content.properties:
        raise _twice("property", label, card)
    content.properties[label] = (str(card.integer(1, "a material")), thickness)


def _mat1(content: BulkData, card: Card) -> None:
    name = str(card.integer(0, "a material"))
    if name in content.materials:
        raise _twice("material", name, card)
    e, g, nu, rho = (card.real(i, "a constant") for i in (1, 2, 3, 4))
    if not card.word(1):
        e = 2 * g * (1 + nu)
    elif not card.word(3) and g:
        nu = e / (2 * g) - 1
    if card.real(7, "a damping"):
        content.said["GE of MAT1 (damping is that of the model file)"] = None
    sound = e > 0 and rho > 0 and -1 < nu < 0.5
    content.materials[name] = (
        Material(youngs_modulus=e, poissons_ratio=nu, density=rho) if sound else None
    )


def _spc(content: BulkData, card: Card) -> None:
    for i in (1, 4):
        if card.word(i):
            _supported(content, card, card.word(i + 1), [card.word(i)])


def _spc1(content: BulkData, card: Card) -> None:
    _supported(content, card, card.word(1), card.words[2:])


def _supported(
    content: BulkData, card: Card, components: str, words: list[str]
) -> None:
    """Supports only name nodes here, whatever directions they hold."""
    name = f"SPC{card.integer(0, 'a set')}"
    content.sets.setdefault(name, []).extend(members(words, card.place))
    if not {"1", "2", "3"} <= set(components):
        content.said[f"directions of {name}: as a set it names nodes"] = None


def _set1(content: BulkData, card: Card) -> None:
    name = f"SET{card.integer(0, 'a set')}"
    if name in content.sets:
        raise _twice("set", name, card)
    content.sets[name] = list(members(card.words[1:], card.place))


def _system(content: BulkData, card: Card) -> None:
    for system in systems_of(card):
        if system.label in content.systems:
            raise _twice("coordinate system", system.label, card)
        content.systems[system.label] = system


def _rigid(content: BulkData, card: Card) -> None:
    content.couplings.append(rbe2(card))


def _mean(content: BulkData, card: Card) -> None:
    coupling, weights = rbe3(card)
    content.couplings.append(coupling)
    if weights:
        content.said["weights of RBE3: its nodes weigh alike here"] = None


def _mass(content: BulkData, card: Card) -> None:
    content.masses.append(conm2(card))


def _param(content: BulkData, card: Card) -> None:
    if card.word(0).upper() == "WTMASS":
        content.weight = card.real(1, "a factor", 1.0)
        return
    content.said[f"PARAM {card.word(0).upper()}"] = None


_READERS: dict[str, Callable[[BulkData, Card], None]] = {
    "GRID": _grid,
    "GRDSET": _grdset,
    "PSOLID": _psolid,
    "PSHELL": _pshell,
    "MAT1": _mat1,
    "SPC": _spc,
    "SPC1": _spc1,
    "SET1": _set1,
    "PARAM": _param,
    "RBE2": _rigid,
    "RBE3": _mean,
    "CONM2": _mass,
    **dict.fromkeys(("CORD2R", "CORD2C", "CORD2S"), _system),
    **dict.fromkeys(("CORD1R", "CORD1C", "CORD1S"), _system),
}


def _imported(content: BulkData) -> ImportedMesh:
    raw = []
    for label, property_, kind, nodes, place in content.elements:
        material, depth = content.properties.get(property_, (None, None))
        raw.append(RawElement(label, kind, nodes, place, material, depth))
    notes = reading_notes(content.nodes, raw, len(content.elements))
    if content.weight != 1.0:
        notes.append(f"PARAM WTMASS multiplies all densities by {content.weight:g}")
    if content.said:
        notes.append("without effect on the body: " + ", ".join(content.said))
    materials = {
        name: own.model_copy(update={"density": own.density * content.weight})
        for name, own in content.materials.items()
        if own is not None
    }
    mesh = assembled_mesh(content.nodes, raw, content.sets)
    masses = [mass.scaled(content.weight) for mass in content.masses]
    return ImportedMesh(
        mesh,
        materials,
        notes=tuple(notes),
        couplings=tuple(content.couplings),
        masses=tuple(masses),
    )


def _twice(what: str, name: object, card: Card) -> InputError:
    return InputError(
        f"{what} {name} is defined twice", place=card.place, expected="one definition"
    )
