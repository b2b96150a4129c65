"""PSOLID and PSHELL of Nastran bulk data."""

from __future__ import annotations

from sidtool.formats.errors import InputError

from .cards import Card, real_number
from .content import BulkData, Property, twice

#: Behind the nodes of a plane element: where T1, T2, ... begin and end, and TFLAG.
_CORNERS = {
    "quad4": (4, 8, 3),
    "tri3": (5, 8, 4),
    "quad8": (0, 4, 6),
    "tri6": (2, 5, 5),
}
_ROUNDED = 1e-9


def corner_thicknesses(kind: str, words: list[str]) -> list[str]:
    """T1, T2, ... and TFLAG among what an element has behind its nodes."""
    first, end, flag = _CORNERS[kind]
    padded = [*words, *[""] * (max(end, flag) + 1)]
    return [*padded[first:end], padded[flag]]


def rest_of(kind: str, words: list[str]) -> list[str]:
    """What else it has there."""
    first, end, flag = _CORNERS[kind]
    return [w for i, w in enumerate(words) if i != flag and not first <= i < end]


def thickness_of(
    content: BulkData, label: int, given: Property | None, place: str
) -> float | None:
    """The thickness of an element: its own one, or that of its property.

    Raises
    ------
    InputError : it has another one at every corner.
    """
    depth = given.thickness if given else None
    *corners, flag = content.corners.get(label, [""])
    unit = (depth or 0.0) if flag == "1" else 1.0
    values = [
        unit * real_number(word, "a thickness", place) if word else depth or 0.0
        for word in corners
    ]
    if not values:
        return depth
    if max(values) - min(values) > _ROUNDED * max(values):
        raise InputError(
            f"element {label} has the thicknesses "
            f"{', '.join(f'{value:g}' for value in values)} at its corners",
            place=place,
            expected="one thickness for an element",
        )
    return values[0] or None


def psolid(content: BulkData, card: Card) -> None:
    """PID, MID, CORDM, IN, STRESS, ISOP, FCTN.

    Raises
    ------
    InputError : it is a fluid.
    """
    if card.word(6).upper() not in ("", "SMECH"):
        raise InputError(
            f"PSOLID {card.word(0)} is {card.word(6)}",
            place=card.place,
            expected="a structure (SMECH)",
        )
    _property(content, card, None, card.integer(2, "a coordinate system", 0))
    chosen = [word for word in (card.word(3), card.word(5)) if word]
    if chosen:
        content.said[f"the integration {', '.join(chosen)} of PSOLID"] = None


def pshell(content: BulkData, card: Card) -> None:
    _property(content, card, card.real(2, "a thickness") or None)
    content.shell_cards[card.integer(0, "a property")] = card
    if content.shells and card.word(1):
        _check_bending(card)
        check_no_extra_mass(card.real(7, "a mass per area"), card.place)


def check_no_extra_mass(extra: float, place: str) -> None:
    """Whether a PSHELL has no nonstructural mass.

    Raises
    ------
    InputError : it has.
    """
    if extra:
        raise InputError(
            "has nonstructural mass",
            place=place,
            expected="densities that hold all mass, or shells (geometry.engine = "
            '"calculix")',
        )


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


def _property(
    content: BulkData, card: Card, thickness: float | None, system: int = 0
) -> None:
    label = card.integer(0, "a property")
    if label in content.properties:
        raise twice("property", label, card)
    flat = card.name == "PSHELL"
    blank = flat and not card.word(1)
    material = "" if blank else str(card.integer(1, "a material"))
    content.properties[label] = Property(
        material,
        thickness,
        card.place,
        system,
        flat,
        extra=card.real(7, "a mass per area") if flat else 0.0,
    )
