"""Couplings and equations of Nastran: RBE2, RBAR, RBE3, CONM2, MPC and MPCADD."""

from collections import Counter

from sidtool.formats.base.errors import InputError

from ...mesh.connections import RawEquation, Term
from ...mesh.imported_mesh import RawCoupling
from .cards import HEATED, Card, is_real, parse_members, real_number
from .content import BulkData, duplicate_error

#: Fields of a line: a blank one or the set, two terms of three, a blank one.
_FIELDS_PER_LINE = 8


def read_rbe2(card: Card) -> RawCoupling:
    """EID, GN, CM, GM1, GM2, ...: nodes that follow a rigid piece, in some directions.

    Raises
    ------
    InputError : it has no directions.
    """
    label, node = (card.integer(i, "a number") for i in (0, 1))
    held = _directions(card, f"RBE2 {label} holds", card.word(2))
    words = [word for word in card.words[3:] if word]
    while words and is_real(words[-1]):  # ALPHA and TREF
        words.pop()
    nodes = tuple(parse_members(words, card.place))
    name, turns = f"RBE2 {label}", held == "123456"
    return RawCoupling(name, True, nodes, node, card.place, turns, directions=held)


def read_rbar(card: Card) -> RawCoupling:
    """EID, GA, GB, CNA, CNB, CMA, CMB: one end moves as a rigid piece with the other.

    Raises
    ------
    InputError : no end has all six independent directions, or the other has no
        dependent ones.
    """
    label, a, b = (card.integer(i, "a number") for i in (0, 1, 2))
    independent = [card.word(i) for i in (3, 4)]
    if sorted(map(set, independent), key=len) != [set(), set("123456")]:
        raise InputError(
            f"RBAR {label} has the independent directions {' and '.join(independent)}",
            place=card.place,
            expected="123456 at one end and none at the other",
        )
    node, other, held = (a, b, card.word(6)) if independent[0] else (b, a, card.word(5))
    held = _directions(card, f"RBAR {label} holds", held or "123456")
    name, turns = f"RBAR {label}", held == "123456"
    return RawCoupling(name, True, (other,), node, card.place, turns, directions=held)


def _directions(card: Card, what: str, word: str) -> str:
    """The directions of a word, rising."""
    if not set(word) or not set(word) <= set("123456"):
        raise InputError(
            f"{what} the directions {word or '(none)'}",
            place=card.place,
            expected="digits from 1 to 6",
        )
    return "".join(sorted(set(word)))


def read_rbe3(card: Card) -> RawCoupling:
    """EID, blank, REFGRID, REFC, WT1, C1, G1, G2, ..., WT2, C2, ..., UM ...

    Raises
    ------
    InputError : nodes take part with less than their three displacements, with no
        weight, or twice with one weight; a weight is written as a whole number, which
        Nastran reads as a node.
    """
    label, node = card.integer(0, "a number"), card.integer(2, "a node")
    _check_directions(card, f"RBE3 {label} moves", card.word(3))
    shares: dict[int, float] = {}
    turning: list[int] = []
    words = [word for word in card.words[4:] if word]
    end = next((i for i, w in enumerate(words) if w.upper() in ("UM", "ALPHA")), None)
    words = words[:end]
    i = 0
    while i < len(words):
        weight = _parse_weight(words[i], f"RBE3 {label}", card.place)
        directions = words[i + 1] if i + 1 < len(words) else ""
        _check_directions(card, f"RBE3 {label} takes", directions)
        i += 2
        start = i
        while i < len(words) and not is_real(words[i]):
            i += 1
        listed = list(parse_members(words[start:i], card.place))
        repeated = next((n for n, k in Counter(listed).items() if k > 1), None)
        if repeated is not None or not listed:
            raise InputError(
                f"RBE3 {label} gives one weight to "
                + (f"node {repeated} twice" if listed else "no node"),
                place=card.place,
                expected="nodes once each; a weight has a decimal point, as in 1.",
            )
        for own in listed:
            shares[own] = shares.get(own, 0.0) + weight
        rotations = set(directions) & set("456")
        if rotations and len(rotations) < 3:
            raise InputError(
                f"RBE3 {label} takes the directions {directions}",
                place=card.place,
                expected="1, 2 and 3, or all six",
            )
        turning += listed if rotations else []
    weights = tuple(shares.values()) if len(set(shares.values())) > 1 else ()
    name = f"RBE3 {label}"
    moved = "".join(sorted(set(card.word(3))))
    return RawCoupling(
        name,
        False,
        tuple(shares),
        node,
        card.place,
        weights=weights,
        directions=moved,
        turning=tuple(turning),
    )


def _parse_weight(word: str, name: str, place: str) -> float:
    if not is_real(word):
        raise InputError(
            f"{name} has {word!r} where a weight stands",
            place=place,
            expected="a real number with a decimal point, as in 1.: Nastran reads "
            "whole numbers as nodes",
        )
    value = real_number(word, f"{name}: a weight", place)
    if value <= 0:
        raise InputError(
            f"{name} has the weight {word}", place=place, expected="one above zero"
        )
    return value


def _check_directions(card: Card, what: str, directions: str) -> None:
    if not {"1", "2", "3"} <= set(directions) <= set("123456"):
        raise InputError(
            f"{what} the directions {directions or '(none)'}",
            place=card.place,
            expected="1, 2 and 3 with or without rotations",
        )


def read_mpc(content: BulkData, card: Card) -> None:
    """SID, G1, C1, A1, G2, C2, A2, blank, blank, G3, C3, A3, ..."""
    content.multipoint.setdefault(card.integer(0, "a set"), []).append(card)


def read_mpcadd(content: BulkData, card: Card) -> None:
    label = card.integer(0, "a set")
    if label in content.sums:
        raise duplicate_error("set", label, card)
    content.sums[label] = card


def read_case_control(content: BulkData, card: Card) -> None:
    """Store that there is case control, the sets of MPC that it selects, and whether
    it selects temperatures.
    """
    content.controlled = True
    content.heated = card.after == HEATED
    for word in card.words:
        content.chosen[int(word)] = None


def equations_of(content: BulkData, *, turning: bool = True) -> tuple[RawEquation, ...]:
    """The equations of the set that case control names; of bulk data alone, of all.

    Parameters
    ----------
    turning : whether nodes have rotations

    Raises
    ------
    InputError : subcases name different sets, or a set does not exist.
    """
    if not content.multipoint:
        return ()
    if len(content.chosen) > 1 or (not content.controlled and _selected_sets(content)):
        known = content.chosen or content.multipoint
        raise InputError(
            f"holds the sets of MPC {', '.join(map(str, known))}",
            place=next(iter(content.multipoint.values()))[0].place,
            expected="one set, which MPC = SET in case control names",
        )
    if content.controlled and not content.chosen:
        content.unread_keywords["MPC, which case control does not name"] = None
        return ()
    wanted = content.chosen or content.sums or content.multipoint
    cards = [card for label in wanted for card in _cards_of_set(content, label)]
    used_cards = {id(card) for card in cards}
    rest = [
        c for own in content.multipoint.values() for c in own if id(c) not in used_cards
    ]
    if rest:
        content.unread_keywords["sets of MPC that case control does not name"] = None
    return tuple(_make_equation(content, card, 6 if turning else 3) for card in cards)


def _selected_sets(content: BulkData) -> bool:
    return len(content.sums or content.multipoint) > 1


def _cards_of_set(content: BulkData, label: int) -> list[Card]:
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


def _make_equation(content: BulkData, card: Card, last: int) -> RawEquation:
    terms: list[Term] = []
    rotations: list[Term] = []
    for i in range(len(card.words)):
        if i % _FIELDS_PER_LINE not in (1, 4):
            continue
        if not any(card.words[i : i + 3]):
            continue
        node, direction = (card.integer(i + k, "a number") for k in (0, 1))
        if node not in content.nodes or not 1 <= direction <= last:
            raise InputError(
                f"MPC {card.word(0)} names direction {direction} of {node}",
                place=card.place,
                expected=f"nodes of this file and their directions 1 to {last}",
            )
        system = content.direction_system(node)
        axis = content.frames.direction(node, system, (direction - 1) % 3 + 1)
        share = card.real(i + 2, "a factor")
        x, y, z = (share * float(a) for a in axis)
        (terms if direction < 4 else rotations).append((node, (x, y, z)))
    stray = [
        w
        for i, w in enumerate(card.words)
        if w and i and i % _FIELDS_PER_LINE in (0, 7)
    ]
    if not (terms or rotations) or stray:
        raise InputError(
            f"MPC {card.word(0)} holds {', '.join(stray) or 'no term'}",
            place=card.place,
            expected="SID, G1, C1, A1, G2, C2, A2; lines of two terms",
        )
    return RawEquation(tuple(terms), card.place, tuple(rotations))
