"""MPC and MPCADD of Nastran bulk data as equations between displacements."""

from __future__ import annotations

from sidtool.formats.errors import InputError

from ..imported_ties import RawEquation, Term
from .cards import Card
from .content import BulkData, twice

#: Fields of a line: a blank one or the set, two terms of three, a blank one.
_LINE = 8


def mpc(content: BulkData, card: Card) -> None:
    """SID, G1, C1, A1, G2, C2, A2, blank, blank, G3, C3, A3, ..."""
    content.multipoint.setdefault(card.integer(0, "a set"), []).append(card)


def mpcadd(content: BulkData, card: Card) -> None:
    label = card.integer(0, "a set")
    if label in content.sums:
        raise twice("set", label, card)
    content.sums[label] = card


def case_control(content: BulkData, card: Card) -> None:
    """Whether there is case control, and the sets of MPC that it names."""
    content.controlled = True
    for word in card.words:
        content.chosen[int(word)] = None


def equations_of(content: BulkData) -> tuple[RawEquation, ...]:
    """The equations of the set that case control names; of bulk data alone, of all.

    Raises
    ------
    InputError : subcases name different sets, or a set does not exist.
    """
    if not content.multipoint:
        return ()
    if len(content.chosen) > 1 or (not content.controlled and _several(content)):
        known = content.chosen or content.multipoint
        raise InputError(
            f"holds the sets of MPC {', '.join(map(str, known))}",
            place=next(iter(content.multipoint.values()))[0].place,
            expected="one set, which MPC = SET in case control names",
        )
    if content.controlled and not content.chosen:
        content.said["MPC, which case control does not name"] = None
        return ()
    wanted = content.chosen or content.sums or content.multipoint
    cards = [card for label in wanted for card in _cards(content, label)]
    kept = {id(card) for card in cards}
    rest = [c for own in content.multipoint.values() for c in own if id(c) not in kept]
    if rest:
        content.said["sets of MPC that case control does not name"] = None
    return tuple(_equation(content, card) for card in cards)


def _several(content: BulkData) -> bool:
    return len(content.sums or content.multipoint) > 1


def _cards(content: BulkData, label: int) -> list[Card]:
    if label in content.multipoint:
        return content.multipoint[label]
    if label not in content.sums:
        raise InputError(
            f"case control names the set of MPC {label}, which is not defined",
            expected="a set of MPC or MPCADD",
        )
    card = content.sums[label]
    sets = [card.integer(i, "a set") for i, w in enumerate(card.words) if i and w]
    for part in sets:
        if part not in content.multipoint:
            raise InputError(
                f"MPCADD {label} names the set {part}, which is not defined",
                place=card.place,
                expected="sets of MPC",
            )
    return [own for part in sets for own in content.multipoint[part]]


def _equation(content: BulkData, card: Card) -> RawEquation:
    terms: list[Term] = []
    for i in range(len(card.words)):
        if i % _LINE not in (1, 4):
            continue
        if not any(card.words[i : i + 3]):
            continue
        node, direction = (card.integer(i + k, "a number") for k in (0, 1))
        if node not in content.nodes or direction not in (1, 2, 3):
            raise InputError(
                f"MPC {card.word(0)} names direction {direction} of {node}",
                place=card.place,
                expected="nodes of this file and their directions 1, 2 and 3",
            )
        system = content.direction_system(node)
        axis = content.frames.direction(node, system, direction)
        share = card.real(i + 2, "a factor")
        x, y, z = (share * float(a) for a in axis)
        terms.append((node, (x, y, z)))
    stray = [w for i, w in enumerate(card.words) if w and i and i % _LINE in (0, 7)]
    if not terms or stray:
        raise InputError(
            f"MPC {card.word(0)} holds {', '.join(stray) or 'no term'}",
            place=card.place,
            expected="SID, G1, C1, A1, G2, C2, A2; lines of two terms",
        )
    return RawEquation(tuple(terms), card.place)
