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

from .bdf_cards import Card, members, read_cards
from .bdf_couplings import conm2, rbe2, rbe3
from .bdf_systems import System, basic_places, systems_of
from .imported import (
    EVERYTHING,
    ImportedMesh,
    RawCoupling,
    RawElement,
    RawMass,
    assembled_mesh,
    reading_notes,
)

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
#: Loads, supports, results, and data beyond linear elasticity.
_IDLE = """
    ACCEL ACCEL1 ASET ASET1 AUTOSPC BSET BSET1 CSET CSET1 DAREA
    DCONSTR DELAY DESVAR DLOAD DPHASE DRESP1 DVPREL1 EIGB EIGC
    EIGP EIGR EIGRL FORCE FORCE1 FORCE2 FREQ FREQ1 FREQ2 FREQ3 FREQ4 FREQ5 GRAV LOAD
    LSEQ MAT4 MATS1 MOMENT MOMENT1 MOMENT2 NLPARM NLPCI OMIT OMIT1 PLOAD PLOAD1 PLOAD2
    PLOAD4 PLOTEL QSET QSET1 RANDPS RFORCE RLOAD1 RLOAD2 SPCADD SPCD SPCR SUPORT
    SUPORT1 TABDMP1 TABLED1 TABLED2 TABLED3 TABLED4 TABLES1 TABRND1 TEMP TEMPD TEMPP1
    TIC TLOAD1 TLOAD2 TSTEP TSTEPNL USET USET1 EPOINT
"""
_WITHOUT_EFFECT = frozenset(_IDLE.split())


@dataclass
class _Content:
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
        content = _Content()
        for card in read_cards(Path(path)):
            _take(content, card, ignored)
        return _imported(content)
    except InputError as error:
        raise error.located(path) from None


def _take(content: _Content, card: Card, ignored: frozenset[str]) -> None:
    if card.name in ignored:
        content.said[f"{card.name} (left out by geometry.ignore)"] = None
    elif card.name in _ELEMENTS:
        _element(content, card)
    elif card.name in _READERS:
        _READERS[card.name](content, card)
    elif card.name in _WITHOUT_EFFECT or EVERYTHING in ignored:
        content.said[card.name] = None
    else:
        raise InputError(
            f"{card.name} is not supported",
            place=card.place,
            expected=f'bulk data without it; geometry.ignore = ["{card.name}"] leaves '
            "it out",
        )


def _grid(content: _Content, card: Card) -> None:
    label = card.integer(0, "a node number")
    if label in content.nodes:
        raise _twice("node", label, card)
    _only_zero(card, (7,), f"node {label} belongs to a superelement")
    x, y, z = (card.real(i, "a coordinate") for i in (2, 3, 4))
    content.nodes[label] = (x, y, z)
    content.local[label] = (card.integer(1, "a coordinate system", -1), card.place)
    if card.word(6):
        content.said["PS of GRID (supports)"] = None


def _grdset(content: _Content, card: Card) -> None:
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


def _element(content: _Content, card: Card) -> None:
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
    if kind in ("quad4", "tri3", "quad8", "tri6") and further:
        content.said[f"further fields of {card.name} (angles, offsets)"] = None
    order = _ORDERS.get(kind, range(len(nodes)))
    listed = [nodes[i] for i in order]
    content.elements.append((label, property_, kind, listed, card.place))


def _psolid(content: _Content, card: Card) -> None:
    _property(content, card, None)
    chosen = [word for word in (card.word(3), card.word(5)) if word]
    if chosen:
        content.said[f"the integration {', '.join(chosen)} of PSOLID"] = None


def _pshell(content: _Content, card: Card) -> None:
    if card.real(7, "a mass per area"):
        raise InputError(
            "has nonstructural mass",
            place=card.place,
            expected="densities that hold all mass",
        )
    _property(content, card, card.real(2, "a thickness") or None)
    content.said["bending of PSHELL: its elements are plane"] = None


def _property(content: _Content, card: Card, thickness: float | None) -> None:
    label = card.integer(0, "a property")
    if label in content.properties:
        raise _twice("property", label, card)
    content.properties[label] = (str(card.integer(1, "a material")), thickness)


def _mat1(content: _Content, card: Card) -> None:
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


def _spc(content: _Content, card: Card) -> None:
    for i in (1, 4):
        if card.word(i):
            _supported(content, card, card.word(i + 1), [card.word(i)])


def _spc1(content: _Content, card: Card) -> None:
    _supported(content, card, card.word(1), card.words[2:])


def _supported(
    content: _Content, card: Card, components: str, words: list[str]
) -> None:
    """Supports only name nodes here, whatever directions they hold."""
    name = f"SPC{card.integer(0, 'a set')}"
    content.sets.setdefault(name, []).extend(members(words, card.place))
    if not {"1", "2", "3"} <= set(components):
        content.said[f"directions of {name}: as a set it names nodes"] = None


def _set1(content: _Content, card: Card) -> None:
    name = f"SET{card.integer(0, 'a set')}"
    if name in content.sets:
        raise _twice("set", name, card)
    content.sets[name] = list(members(card.words[1:], card.place))


def _system(content: _Content, card: Card) -> None:
    for system in systems_of(card):
        if system.label in content.systems:
            raise _twice("coordinate system", system.label, card)
        content.systems[system.label] = system


def _rigid(content: _Content, card: Card) -> None:
    content.couplings.append(rbe2(card))


def _mean(content: _Content, card: Card) -> None:
    coupling, weights = rbe3(card)
    content.couplings.append(coupling)
    if weights:
        content.said["weights of RBE3: its nodes weigh alike here"] = None


def _mass(content: _Content, card: Card) -> None:
    content.masses.append(conm2(card))


def _param(content: _Content, card: Card) -> None:
    if card.word(0).upper() == "WTMASS":
        content.weight = card.real(1, "a factor", 1.0)
        return
    content.said[f"PARAM {card.word(0).upper()}"] = None


_READERS: dict[str, Callable[[_Content, Card], None]] = {
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


def _imported(content: _Content) -> ImportedMesh:
    given = {
        n: (content.system if s < 0 else s, p) for n, (s, p) in content.local.items()
    }
    local = {n: (system, place) for n, (system, place) in given.items() if system}
    content.nodes.update(basic_places(content.nodes, local, content.systems))
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
