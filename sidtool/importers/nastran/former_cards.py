"""Cards of former NASTRAN as the cards that replaced them.

CQUAD1 and CTRIA1 have a membrane, a moment of inertia and a shear thickness of their
own; CQUAD2 and CTRIA2 one homogeneous thickness, all of which shears; CQDMEM, CQDMEM1,
CQDMEM2 and CTRMEM a membrane alone (NASTRAN User's Manual, NASA SP-222).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError

from .cards import Card

_MEMBRANES = ("PQDMEM", "PQDMEM1", "PQDMEM2", "PTRMEM")
#: Former element -> its replacement, with fields in the same order.
_ELEMENTS = {
    **dict.fromkeys(("CQUAD1", "CQUAD2", "CQDMEM", "CQDMEM1", "CQDMEM2"), "CQUAD4"),
    **dict.fromkeys(("CTRIA1", "CTRIA2", "CTRMEM"), "CTRIA3"),
    "CTUBE": "CROD",
}
#: Cards that hold two elements or two properties of four fields each.
_TWO = (
    "CROD",
    "CTUBE",
    "PQUAD2",
    "PTRIA2",
    *_MEMBRANES,
)


def current_cards(card: Card) -> Iterator[Card]:
    """Yield the present cards of a card that may be a former one.

    Raises
    ------
    InputError : a tube is no tube, or has two diameters.
    """
    for part in _halves(card):
        if part.name in _ELEMENTS:
            yield replace(part, name=_ELEMENTS[part.name])
        elif part.name in ("PQUAD1", "PTRIA1"):
            yield _general_shell(part)
        elif part.name in ("PQUAD2", "PTRIA2"):
            yield _homogeneous_shell(part)
        elif part.name in _MEMBRANES:
            label, material, t, extra = (part.word(i) for i in range(4))
            words = [label, material, t, "", "", "", "", extra]
            yield replace(part, name="PSHELL", words=words)
        elif part.name == "PTUBE":
            yield _rod_of_tube(part)
        else:
            yield part


def _halves(card: Card) -> list[Card]:
    if card.name not in _TWO or not any(card.words[4:8]):
        return [card]
    return [replace(card, words=card.words[i : i + 4]) for i in (0, 4)]


def _general_shell(card: Card) -> Card:
    """PID, MID1, T1, MID2, I, MID3, T3, NSM."""
    t, inertia, across = (card.real(i, "a number") for i in (2, 4, 6))
    if t <= 0:
        raise InputError(
            f"{card.name} {card.word(0)} has no membrane",
            place=card.place,
            expected="MID1, and T1 above zero",
        )
    bending = card.word(3) if inertia else ""
    ratio = repr(12 * inertia / t**3) if inertia else ""
    shear = card.word(5) if across else ""
    words = [card.word(0), card.word(1), card.word(2), bending, ratio, shear]
    words += [repr(across / t) if shear else "", card.word(7)]
    return replace(card, name="PSHELL", words=words)


def _homogeneous_shell(card: Card) -> Card:
    """PID, MID, T, NSM."""
    label, material, t, extra = (card.word(i) for i in range(4))
    words = [label, material, t, material, "", material, "1.0", extra]
    return replace(card, name="PSHELL", words=words)


def _rod_of_tube(card: Card) -> Card:
    """PID, MID, OD, T, NSM, OD2."""
    outer, t = card.real(2, "a diameter"), card.real(3, "a thickness")
    inner = outer - 2 * t if t else 0.0
    if outer <= 0 or not 0 <= inner < outer or card.real(5, "", outer) != outer:
        raise InputError(
            f"PTUBE {card.word(0)} has OD = {outer:g}, T = {t:g} and OD2 = "
            f"{card.word(5) or outer}",
            place=card.place,
            expected="one outer diameter, and a thickness up to half of it",
        )
    area = np.pi / 4 * (outer**2 - inner**2)
    torsion = np.pi / 32 * (outer**4 - inner**4)
    words = [card.word(0), card.word(1), repr(float(area)), repr(float(torsion))]
    return replace(card, name="PROD", words=[*words, "", card.word(4)])
