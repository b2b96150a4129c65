"""CBAR, CBEAM, CROD and CONROD of Nastran bulk data."""

from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.base.sid import Array

from ...mesh.connections import BarSection, RawBar, RawEquation, Vector
from ...mesh.imported_mesh import check_unique_labels
from .cards import Card, is_real
from .content import BarProperty, BulkData, duplicate_error

#: Whether the y axis, and the offsets of both ends, are in directions of the nodes;
#: the flags of former NASTRAN: a vector (1), a node (2).
_VECTOR, _NODE = "1", "2"
_GLOBAL = ("", "GGG", "BGG", _VECTOR, _NODE)
#: Relative distance from a line that is rounding.
_ON_LINE = 1e-9


def bar(content: BulkData, card: Card) -> None:
    """Store CBAR, CBEAM, CROD, CONROD until all nodes and properties are known."""
    content.bars.append(card)


def bar_defaults(content: BulkData, card: Card) -> None:
    """BAROR and BEAMOR: PID, X1, X2, X3 (or G0) and OFFT of cards that leave them out.

    Raises
    ------
    InputError : there are two.
    """
    name = {"BAROR": "CBAR", "BEAMOR": "CBEAM"}[card.name]
    if name in content.bar_defaults:
        raise duplicate_error("the default of", name, card)
    content.bar_defaults[name] = card


def fill_bar_defaults(content: BulkData, card: Card) -> Card:
    """Fill the blank fields of a card by those of BAROR or BEAMOR."""
    default = content.bar_defaults.get(card.name)
    if default is None:
        return card
    words = [*card.words, *[""] * 8]
    for start, end in ((1, 2), (4, 7), (7, 8)):
        if not any(words[start:end]):
            words[start:end] = [default.word(i) for i in range(start, end)]
    return replace(card, words=words)


def bars_of(content: BulkData) -> tuple[RawBar, ...]:
    """The bars with their properties.

    Raises
    ------
    InputError : a bar has properties that the elements of sidtool do not have.
    """
    readers = {
        "CBAR": _read_bar,
        "CBEAM": _read_bar,
        "CROD": _read_rod,
        "CONROD": _read_conrod,
    }
    bars = []
    for card in content.bars:
        with content.stops.collect_errors():
            bars.append(readers[card.name](content, card))
    elements = tuple(bars)
    check_unique_labels(elements, (label for label, *_ in content.elements))
    return elements


def with_rigid_twist(
    content: BulkData, bars: tuple[RawBar, ...]
) -> tuple[tuple[RawBar, ...], tuple[RawEquation, ...]]:
    """The bars and equations that turn the ends of bars without torsion alike, if all
    bars are on one line, where nothing else holds them (as AUTOSPC does).
    """
    loose = content.torsionless.intersection(bar.label for bar in bars)
    if not loose or content.elements or content.springs or content.couplings:
        return bars, ()
    places = np.array(
        [
            np.add(content.nodes[n], share * np.array(offset))
            for bar in bars
            for n, offset in zip(bar.nodes, bar.offsets, strict=True)
            for share in (0, 1)
        ]
    )
    _, sizes, axes = np.linalg.svd(places - places.mean(axis=0))
    if sizes[1] > _ON_LINE * sizes[0]:
        return bars, ()
    content.unread_keywords["J = 0 of bars on one line: their twist is rigid"] = None
    x, y, z = axes[0].tolist()
    turned, equations = [], []
    for bar in bars:
        if bar.label in loose:
            first, second = bar.nodes
            ends = (first, (x, y, z)), (second, (-x, -y, -z))
            equations.append(RawEquation((), bar.place, ends))
            # any torsion: its polar inertia remains
            section = replace(bar.section, torsion=bar.section.iy or bar.section.iz)
            first_pins, second_pins = ({*pins} - {4} for pins in bar.pins)
            pins = (tuple(sorted(first_pins)), tuple(sorted(second_pins)))
            bar = replace(bar, section=section, pins=pins)
        turned.append(bar)
    return tuple(turned), tuple(equations)


def _read_bar(content: BulkData, card: Card) -> RawBar:
    """EID, PID, GA, GB, X1, X2, X3, OFFT, PA, PB, W1A, W2A, W3A, W1B, W2B, W3B."""
    label = card.label(0, "an element")
    nodes = _end_nodes(content, card, 2)
    if card.word(7).upper() not in _GLOBAL or any(card.words[16:]):
        raise InputError(
            f"{card.name} {label} has OFFT {card.word(7) or 'GGG'} and further fields "
            f"{' '.join(card.words[16:]).strip() or '(none)'}",
            place=card.place,
            expected="OFFT = GGG or BGG, and no warping",
        )
    property_ = _bar_property(content, card, card.integer(1, "a property", label))
    offsets = [_vector_in_basic(content, card, nodes[k], 10 + 3 * k) for k in (0, 1)]
    section, free_directions = _with_pinned_stiffness(card, property_.section)
    given = [_pin_directions(card, 8 + k) for k in (0, 1)]
    if 4 in free_directions[1] and 4 not in {*given[0], *given[1]}:
        content.torsionless.add(label)
    pins = [tuple(sorted({*given[k], *free_directions[k]})) for k in (0, 1)]
    up = _orientation_vector(content, card, nodes[0])
    if section.turn and free_directions[0]:  # hinges about a principal axis
        if {*given[0], *given[1]} - {1, 4}:
            raise InputError(
                f"{card.name} {label} has pins, and no stiffness about an axis that "
                "is not its own",
                place=card.place,
                expected="I12 squared below I1 times I2, or no pins but 1 and 4",
            )
        ends = [
            np.add(content.nodes[n], w) for n, w in zip(nodes, offsets, strict=True)
        ]
        up = _principal_axis(up, ends[1] - ends[0], section.turn)
        section = replace(section, turn=0.0)
    property_ = replace(property_, section=section)
    raw = _make_bar(
        content, card, (label, nodes), property_, up, (offsets[0], offsets[1])
    )
    return replace(raw, pins=(pins[0], pins[1]))


def _pin_directions(card: Card, at: int) -> tuple[int, ...]:
    """Return PA or PB: released directions of an end of the bar.

    Raises
    ------
    InputError : they are none.
    """
    word = card.word(at)
    if set(word) - set("0123456"):
        raise InputError(
            f"{card.name} {card.word(0)} has the pins {word}",
            place=card.place,
            expected="digits from 1 to 6",
        )
    return tuple(sorted({int(digit) for digit in word} - {0}))


def _with_pinned_stiffness(
    card: Card, section: BarSection
) -> tuple[BarSection, tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return a section with full stiffness, and pins that release its missing
    stiffness. A bar without bending stiffness about an axis has hinges about it at both
    ends; a bar without torsional stiffness rotates freely at its second end.

    Raises
    ------
    InputError : a moment vanishes at some stations only.
    """
    first: set[int] = set()
    second: set[int] = set()
    area = max(v for _, v in section.area)
    changes: dict[str, Any] = {}
    for name, direction in (("torsion", 4), ("iy", 5), ("iz", 6)):
        values = [v for _, v in getattr(section, name)]
        if values and min(values) > 0:
            continue
        if values and (max(values) > 0 or min(values) < 0):
            raise InputError(
                f"{card.name} {card.word(0)} has {name} = {min(values):g} at a station",
                place=card.place,
                expected="I1, I2 and J above zero, or zero everywhere",
            )
        changes[name] = ((0.0, area**2 / 12),)
        second.add(direction)
        if direction > 4:
            first.add(direction)
    return replace(section, **changes), (tuple(first), tuple(second))


def _principal_axis(up: Vector, along: Array, turn: float) -> Vector:
    """The y axis of a bar turned about it towards its z axis."""
    x = along / np.linalg.norm(along)
    y = np.asarray(up) - (np.asarray(up) @ x) * x
    if not np.linalg.norm(y) > 1e-9 * np.linalg.norm(up):
        return up  # along the bar: refused when elements are created
    y /= np.linalg.norm(y)
    a, b, c = (np.cos(turn) * y + np.sin(turn) * np.cross(x, y)).tolist()
    return a, b, c


def _orientation_vector(content: BulkData, card: Card, start: int) -> Vector:
    """X1, X2, X3 in the directions of the first node, or from it to the node G0."""
    words, flag = card.words[4:7], card.word(7)
    if flag == _NODE or (words[0] and not is_real(words[0]) and flag != _VECTOR):
        if any(words[1:]):
            raise InputError(
                f"{card.name} {card.word(0)} has {', '.join(words)} as X1, X2, X3",
                place=card.place,
                expected="real numbers with a decimal point, as in 1., or a node G0 "
                "alone, as which Nastran reads a whole number",
            )
        other = card.integer(4, "a node")
        if other not in content.nodes:
            raise _unknown_node(card, other)
        arm = np.subtract(content.nodes[other], content.nodes[start])
        return float(arm[0]), float(arm[1]), float(arm[2])
    if flag == _VECTOR:  # of whole numbers, too
        real = [f"{word}." if is_label(word.lstrip("+-")) else word for word in words]
        card = replace(card, words=[*card.words[:4], *real, *card.words[7:]])
    basic = card.word(7).upper().startswith("B")
    vector = _vector_in_basic(content, card, None if basic else start, 4)
    if not any(vector):
        raise InputError(
            f"{card.name} {card.word(0)} has no direction of its y axis",
            place=card.place,
            expected="X1, X2, X3 or G0",
        )
    return vector


def _vector_in_basic(
    content: BulkData, card: Card, node: int | None, at: int
) -> Vector:
    """A vector in the directions of a node, or basic ones, in the basic system."""
    x, y, z = total = [card.real(at + i, "a component") for i in range(3)]
    if node is None:
        return x, y, z
    system = content.direction_system(node)
    if not system or not any(total):
        return x, y, z
    # zeros do not need their directions, which an axis has not
    parts = [
        part * content.frames.direction(node, system, i)
        for i, part in enumerate(total, 1)
        if part
    ]
    a, b, c = np.sum(parts, axis=0)
    return float(a), float(b), float(c)


def _read_rod(content: BulkData, card: Card) -> RawBar:
    """EID, PID, G1, G2."""
    label = card.label(0, "an element")
    _check_last_field(card, 4)
    property_ = _bar_property(content, card, card.integer(1, "a property", label))
    if property_.section.iy:
        raise InputError(
            f"CROD {label} has a property of bars", place=card.place, expected="PROD"
        )
    return _make_bar(content, card, (label, _end_nodes(content, card, 2)), property_)


def _read_conrod(content: BulkData, card: Card) -> RawBar:
    """EID, G1, G2, MID, A, J, C, NSM."""
    _check_last_field(card, 8)
    profiles = (((0.0, card.real(i, "a number")),) for i in (4, 5, 7))
    area, torsion, extra = profiles
    section = BarSection(area, torsion=torsion, extra=extra)
    property_ = BarProperty(str(card.integer(3, "a material")), section, card.place)
    if card.word(6):
        content.unread_keywords["stress points of CONROD"] = None
    label = card.label(0, "an element")
    return _make_bar(content, card, (label, _end_nodes(content, card, 1)), property_)


def _make_bar(
    content: BulkData,
    card: Card,
    ends: tuple[int, tuple[int, int]],
    property_: BarProperty,
    y_axis: Vector | None = None,
    offsets: tuple[Vector, Vector] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
) -> RawBar:
    section, weight = property_.section, content.weight
    if min(v for _, v in section.area) <= 0:
        raise InputError(
            f"{card.name} {ends[0]} has no area",
            place=card.place,
            expected="an area above zero",
        )
    e, g, rho = content.moduli.get(property_.material, (0.0, 0.0, 0.0))
    heavy = tuple((at, weight * value) for at, value in section.extra)
    section = replace(section, extra=heavy)
    rho *= content.weight_of(property_.material)
    return RawBar(*ends, card.place, y_axis, e, g, rho, section, offsets)


def _bar_property(content: BulkData, card: Card, label: int) -> BarProperty:
    property_ = content.bar_properties.get(label)
    if property_ is None or (card.name != "CROD" and not property_.section.iy):
        raise InputError(
            f"{card.name} {card.word(0)} has the property {label}",
            place=card.place,
            expected="PROD for CROD; PBAR, PBARL, PBEAM or PBEAML for bars",
        )
    return property_


def _end_nodes(content: BulkData, card: Card, at: int) -> tuple[int, int]:
    first, last = (card.integer(at + i, "a node") for i in (0, 1))
    for node in (first, last):
        if node not in content.nodes:
            raise _unknown_node(card, node)
    return first, last


def _unknown_node(card: Card, node: int) -> InputError:
    return InputError(
        f"{card.name} {card.word(0)} names node {node}, which is not defined",
        place=card.place,
        expected="a node of this file",
    )


def _check_last_field(card: Card, at: int) -> None:
    if any(card.words[at:]):
        raise InputError(
            f"{card.name} {card.word(0)} holds {' '.join(card.words[at:]).strip()}",
            place=card.place,
            expected=f"{at} fields",
        )
