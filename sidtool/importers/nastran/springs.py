"""CELAS1, CELAS2 and CBUSH of Nastran bulk data."""

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ...mesh.connections import RawSpring
from .cards import Card, is_real
from .content import BulkData, duplicate_error

#: Entries of PBUSH besides K that change neither mass nor stiffness.
_IDLE = ("B", "GE", "RCV", "T", "ALPHA", "TREF", "COINL")


def spring(content: BulkData, card: Card) -> None:
    """Store CELAS1, CELAS2 and CBUSH until all nodes and properties are known."""
    content.springs.append(card)


def pelas(content: BulkData, card: Card) -> None:
    """PID1, K1, GE1, S1, PID2, K2, GE2, S2."""
    for at in (0, 4):
        if card.word(at):
            label = card.integer(at, "a property")
            _keep(content, label, card, (card.real(at + 1, "a stiffness"),))


def pbush(content: BulkData, card: Card) -> None:
    """PID, "K", K1 to K6, and other words with their values.

    Raises
    ------
    InputError : it has a mass, or a direction is rigid.
    """
    stiffness = [0.0] * 6
    at = 1
    while at < len(card.words):
        word = card.word(at).upper()
        if word == "K":
            if "RIGID" in (own := [w.upper() for w in card.words[at + 1 : at + 7]]):
                raise InputError(
                    f"PBUSH {card.word(0)} has {' '.join(own)}",
                    place=card.place,
                    expected="numbers, or RBE2 for what is rigid",
                )
            stiffness = [card.real(at + 1 + i, "a stiffness") for i in range(6)]
        elif word in _IDLE:
            content.unread_keywords[f"{word} of PBUSH"] = None
        elif word:
            raise InputError(
                f"PBUSH {card.word(0)} has {word}",
                place=card.place,
                expected="K, with masses in CONM2",
            )
        at += 7 if word and at == 1 else 8 if word else 1
    _keep(content, card.integer(0, "a property"), card, tuple(stiffness))


def _keep(
    content: BulkData, label: int, card: Card, stiffness: tuple[float, ...]
) -> None:
    if label in content.spring_properties:
        raise duplicate_error("property", label, card)
    content.spring_properties[label] = card.name, stiffness


def springs_of(content: BulkData) -> tuple[RawSpring, ...]:
    """The springs between two nodes; those to the ground name node sets.

    Raises
    ------
    InputError : a spring has no property or is at no node.
    """
    springs: list[RawSpring] = []
    grounded: list[str] = []
    for card in content.springs:
        with content.stops.collect_errors():
            new_springs = (
                _bush(content, card) if card.name == "CBUSH" else _elas(content, card)
            )
            if new_springs.nodes[1] is not None:
                springs.append(new_springs)
                continue
            name = f"{card.name}_{new_springs.label}"
            content.sets.setdefault(name, []).append(new_springs.nodes[0])
            grounded.append(name)
    if grounded:
        listed = ", ".join(grounded[:5]) + (" and others" if grounded[5:] else "")
        content.unread_keywords[
            f"{len(grounded)} springs to the ground, which are supports and name node "
            f"sets ({listed}): bushings of the scene hold the body there"
        ] = None
    return tuple(springs)


def _stiffness(
    content: BulkData, card: Card, label: int, kind: str
) -> tuple[float, ...]:
    name, values = content.spring_properties.get(label, ("", ()))
    if name != kind:
        raise InputError(
            f"{card.name} {card.word(0)} has the property {label}",
            place=card.place,
            expected=kind,
        )
    return values


def _elas(content: BulkData, card: Card) -> RawSpring:
    """EID, PID or K, G1, C1, G2, C2."""
    label = card.label(0, "an element")
    if card.name == "CELAS2":
        (k,) = (card.real(1, "a stiffness"),)
    else:
        (k,) = _stiffness(content, card, card.integer(1, "a property", label), "PELAS")
    ends = []
    for at in (2, 4):
        node, component = (card.integer(at + i, "a number", 0) for i in (0, 1))
        if not node:
            continue
        if node not in content.nodes or component not in range(1, 7):
            raise InputError(
                f"{card.name} {label} is at component {component} of {node}",
                place=card.place,
                expected="components 1 to 6 of nodes (GRID)",
            )
        ends.append((node, component - 1))
    if not ends:
        raise InputError(
            f"{card.name} {label} is at no node", place=card.place, expected="a node"
        )
    axes = [_node_axes(content, node) for node, _ in ends]
    first, second = ends[0], ends[1] if len(ends) > 1 else (None, 0)
    return RawSpring(
        label,
        (first[0], second[0]),
        card.place,
        (axes[0], axes[-1]),
        (k,),
        components=(first[1], second[1]),
    )


def _node_axes(content: BulkData, node: int) -> Array:
    system = content.direction_system(node)
    return np.array([content.frames.direction(node, system, i) for i in (1, 2, 3)])


def _bush(content: BulkData, card: Card) -> RawSpring:
    """EID, PID, GA, GB, GO or X1, X2, X3, CID, S, OCID, S1, S2, S3."""
    label = card.label(0, "an element")
    stiffness = _stiffness(content, card, card.integer(1, "a property", label), "PBUSH")
    first, last = card.integer(2, "a node"), card.integer(3, "a node", 0)
    for node in (first, last):
        if node and node not in content.nodes:
            raise InputError(
                f"CBUSH {label} names node {node}, which is not defined",
                place=card.place,
                expected="a node of this file",
            )
    a = np.array(content.nodes[first])
    b = np.array(content.nodes[last or first])
    axes = _bush_axes(content, card, a, b, stiffness)
    location = a + card.real(8, "a share", 0.5) * (b - a)
    system = card.integer(9, "a system", -1)
    if system >= 0:
        origin, own = content.frames.frame(system, card.place)
        if system and not content.frames.is_rectangular(system, card.place):
            raise InputError(
                f"CBUSH {label} has its place in the system {system}",
                place=card.place,
                expected="a rectangular one",
            )
        location = origin + own.T @ [card.real(i, "a place") for i in (10, 11, 12)]
    return RawSpring(
        label, (first, last or None), card.place, (axes, axes), stiffness, location
    )


def _bush_axes(
    content: BulkData, card: Card, a: Array, b: Array, stiffness: tuple[float, ...]
) -> Array:
    """Rows x, y, z: of CID, or x along the element and y towards GO or X."""
    if card.word(7):
        system = card.integer(7, "a system")
        node = card.integer(2, "a node")
        if system == 0:
            return np.eye(3)
        content.frames.frame(system, card.place)
        return np.array([content.frames.direction(node, system, i) for i in (1, 2, 3)])
    x = b - a
    if not x.any():
        if len(set(stiffness[:3])) == len(set(stiffness[3:])) == 1:
            return np.eye(3)
        raise InputError(
            f"CBUSH {card.word(0)} joins nodes at one place and has no axes",
            place=card.place,
            expected="CID",
        )
    x = x / np.linalg.norm(x)
    if card.word(4) and not is_real(card.word(4)):
        up = np.subtract(content.frames.named(card.integer(4, "a node"), card.place), a)
    else:
        up = np.array([card.real(i, "a component") for i in (4, 5, 6)])
        up = _node_axes(content, card.integer(2, "a node")).T @ up
    if not up.any():
        if stiffness[1] != stiffness[2] or stiffness[4] != stiffness[5]:
            raise InputError(
                f"CBUSH {card.word(0)} has no direction of its y axis",
                place=card.place,
                expected="GO, X1 to X3 or CID",
            )
        up = np.eye(3)[np.argmin(np.abs(x))]
    z = np.cross(x, up)
    if not np.linalg.norm(z) > 1e-9 * np.linalg.norm(up):
        raise InputError(
            f"the y axis of CBUSH {card.word(0)} lies along it",
            place=card.place,
            expected="a direction across it",
        )
    z = z / np.linalg.norm(z)
    return np.array([x, np.cross(z, x), z])
