"""Generated nodes and elements: *NGEN, *NFILL, *NCOPY, *ELGEN and *ELCOPY."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose

from ...mesh.deck_text import parse_integers, parse_numbers
from ...mesh.imported_mesh import MOST_MEMBERS
from .deck import Deck, duplicate_error, extend_set, members_of, parse_range
from .instances import place_nodes
from .keywords import Block
from .surfaces import check_no_system

#: Tolerance of the nodes of an arc, relative to the radius.
_ARC_TOLERANCE = 1e-3


def read_ngen(deck: Deck, block: Block) -> None:
    """Nodes evenly along a line, a parabola (LINE=P) or an arc (LINE=C).

    Raises
    ------
    InputError : ends or the third point are not defined, or make no such curve.
    """
    line = block.options.get("LINE", "").upper()
    if line not in ("", "P", "C"):
        raise InputError(
            f"*NGEN, LINE={line} is not supported",
            place=block.place,
            expected="P for a parabola or C for an arc",
        )
    if line:
        check_no_system(deck, block)
    for words, place in block.rows:
        labels = parse_range(words[:3], place)
        if [labels[-1]] != parse_integers(words[1:2], place):
            raise InputError(
                f"found {', '.join(words[:3])!r}",
                place=place,
                expected="first, last, and a step that leads from one to the other",
            )
        a, b = _node_positions(deck, (labels[0], labels[-1]), place)
        t = np.linspace(0, 1, len(labels))[1:-1, None]
        node, *rest = [word or "0" for word in [*words[3:], *[""] * 7][:7]]
        point = np.array(parse_numbers(rest, place))
        c = (
            _node_positions(deck, parse_integers([node], place), place)[0]
            if node != "0"
            else None
        )
        c = point[:3] if c is None else c
        if line == "P":
            bulge = 4 * t * (1 - t) * (c - (a + b) / 2)
            positions = a + t * (b - a) + bulge
        elif line == "C":
            positions = c + _arc_positions(a - c, b - c, point[3:], t, place)
        else:
            positions = a + t * (b - a)
        _add_nodes(deck, labels[1:-1], positions, place)
        if "NSET" in block.options:
            extend_set(deck, deck.scope.nsets, block.options["NSET"], labels)


def _arc_positions(a: Array, b: Array, normal: Array, t: Array, place: str) -> Array:
    """Places about the origin, right-handed about the normal; else the short way."""
    from scipy.spatial.transform import Rotation  # a quarter of a second

    across, radii = np.cross(a, b), np.linalg.norm([a, b], axis=1)
    axis = normal if normal.any() else across
    if np.ptp(radii) > _ARC_TOLERANCE * radii.max() or (
        not normal.any() and np.linalg.norm(across) <= 1e-6 * radii.prod()
    ):
        raise InputError(
            "has no arc between its nodes",
            place=place,
            expected="two nodes equally far from the centre, and the normal of an arc "
            "of half a turn or more",
        )
    axis = axis / np.linalg.norm(axis)
    angle = np.arctan2(axis @ across, a @ b) % (2 * np.pi)
    grown = 1 + t * (radii[1] / radii[0] - 1)
    return np.asarray(grown * Rotation.from_rotvec(angle * t * axis).apply(a), float)


def read_nfill(deck: Deck, block: Block) -> None:
    """Nodes on straight lines between those of two sets.

    BIAS is the ratio of an interval to the next one, from the first set on.

    Raises
    ------
    InputError : there are no two sets, or their nodes are not defined.
    """
    (bias,) = parse_numbers([block.options.get("BIAS", "1")], block.place)
    if bias > 0 and bias != 1:
        what = f"an interval is {bias:g} times the next one, from the first set on"
        deck.diagnostics.append(
            diagnose("N120", place=f"*NFILL, BIAS={bias:g}", what=what)
        )
    for words, place in block.rows:
        sets = [_ordered_nodes(deck, word, place) for word in words[:2]]
        count, step = _parse_counts(words[2:], (0, 1), place)
        sizes = [len(group) for group in sets]
        if min(bias, count) <= 0 or not step or len(sizes) != 2:
            raise InputError(
                f"fills {count} intervals with BIAS {bias:g} between sets of {sizes} "
                "nodes",
                place=place,
                expected="two sets of nodes, a number of intervals and BIAS above "
                "zero, and the step of node numbers",
            )
        if sizes[0] != sizes[1]:
            count_left = abs(sizes[0] - sizes[1])
            what = f"the last {count_left} nodes of the longer set have no partner"
            deck.diagnostics.append(
                diagnose("N120", place=f"*NFILL ({place})", what=what, count=count_left)
            )
        _check_number(count * sizes[0], place)
        powers = -np.log(bias) * np.arange(count)
        lengths = np.exp(powers - powers.max())
        t = (np.cumsum(lengths) / lengths.sum())[:-1, None]
        new_labels = [label for group in sets for label in group]
        for a, b in zip(*sets, strict=False):
            start, end = _node_positions(deck, (a, b), place)
            labels = range(a + step, a + count * step, step)
            _add_nodes(deck, labels, start + t * (end - start), place)
            new_labels += labels
        if "NSET" in block.options:
            extend_set(deck, deck.scope.nsets, block.options["NSET"], new_labels)


def read_ncopy(deck: Deck, block: Block) -> None:
    """Nodes moved, then turned, by SHIFT, MULTIPLE times in a row.

    Raises
    ------
    InputError : it is no SHIFT, or a node is not defined.
    """
    check_no_system(deck, block)
    if "SHIFT" not in block.options:
        raise InputError(
            "*NCOPY without SHIFT is not supported",
            place=block.place,
            expected="SHIFT, or a deck with the nodes themselves",
        )
    given = [block.options.get(key, "") for key in ("CHANGE NUMBER", "MULTIPLE")]
    change, times = _parse_counts(given, (0, 1), block.place)
    old = _ordered_nodes(deck, block.options.get("OLD SET", ""), block.place)
    _check_number(times * len(old), block.place)
    lines = [
        parse_numbers([w or "0" for w in words], place) for words, place in block.rows
    ]
    if lines and len(lines[0]) > 3:
        lines.insert(0, [])  # a blank line is a zero shift
    nodes = {
        n: deck.scope.nodes[n] for n in old if _node_positions(deck, (n,), block.place)
    }
    for k in range(1, times + 1):
        nodes = place_nodes(nodes, lines)
        labels = [n + k * change for n in nodes]
        _add_nodes(deck, labels, nodes.values(), block.place)
        if "NEW SET" in block.options:
            extend_set(deck, deck.scope.nsets, block.options["NEW SET"], labels)


def read_elgen(deck: Deck, block: Block) -> None:
    """Elements like a first one, in rows, layers of rows, and blocks of layers."""
    for words, place in block.rows:
        label, *steps = _parse_counts(words, (0, 1, 1, 1, 1, 0, 0, 1, 0, 0), place)
        shifts = [(0, 0)]
        for count, nodes, elements in zip(*[iter(steps)] * 3, strict=True):
            _check_number(count * len(shifts), place)
            shifts = [
                (n + k * nodes, e + k * elements)
                for k in range(count)
                for n, e in shifts
            ]
        _copy_elements(deck, [label], shifts[1:], block.options.get("ELSET"), place)
        if "ELSET" in block.options:
            extend_set(deck, deck.scope.elsets, block.options["ELSET"], [label])


def read_elcopy(deck: Deck, block: Block) -> None:
    """Elements of a set with other numbers of themselves and of their nodes."""
    given = [block.options.get(key, "") for key in ("SHIFT NODES", "ELEMENT SHIFT")]
    nodes, elements = _parse_counts(given, (0, 0), block.place)
    word = block.options.get("OLD SET", "")
    old = [label for _, label in members_of(deck, "elsets", "", word, block.place)]
    new = block.options.get("NEW SET")
    _copy_elements(deck, old, [(nodes, elements)], new, block.place)


def _copy_elements(
    deck: Deck,
    labels: Sequence[int],
    shifts: Iterable[tuple[int, int]],
    elset: str | None,
    place: str,
) -> None:
    """Elements again, by steps of the numbers of their nodes and of themselves."""
    elements, copies = deck.scope.elements, []
    for label in labels:
        if label not in elements:
            raise InputError(
                f"copies element {label}, which is not defined",
                place=place,
                expected="an element of a line above",
            )
        for nodes, step in shifts:
            moved = [n + nodes for n in elements[label].nodes]
            new = replace(elements[label], label=label + step, nodes=moved, place=place)
            if new.label in elements:
                raise duplicate_error("element", new.label, place)
            elements[new.label] = new
            copies.append(new.label)
    if elset is not None:
        extend_set(deck, deck.scope.elsets, elset, copies)


def _add_nodes(
    deck: Deck, labels: Sequence[int], places: Iterable[Sequence[float]], place: str
) -> None:
    """Add nodes; an existing node must have the same position."""
    known = deck.scope.nodes
    for label, (x, y, z) in zip(labels, places, strict=True):
        new = (float(x), float(y), float(z))
        there = known.setdefault(label, new)
        size = max(map(abs, there + new))
        if there != new and not np.allclose(there, new, rtol=0, atol=1e-6 * size):
            raise duplicate_error("node", label, place)


def _node_positions(deck: Deck, labels: Iterable[int], place: str) -> list[Array]:
    known = deck.scope.nodes
    for label in labels:
        if label not in known:
            raise InputError(
                f"names node {label}, which is not defined",
                place=place,
                expected="a node of a line above",
            )
    return [np.array(known[label]) for label in labels]


def _ordered_nodes(deck: Deck, word: str, place: str) -> list[int]:
    """Return the nodes of a set in the order of Abaqus: by number, unless UNSORTED is
    set.
    """
    labels = [label for _, label in members_of(deck, "nsets", "", word, place)]
    unsorted = deck.own_name(word) in deck.unsorted
    return labels if unsorted else sorted(set(labels))


def _parse_counts(words: Sequence[str], least: Sequence[int], place: str) -> list[int]:
    """Parse integers, with defaults for blank ones."""
    filled = [*words, *[""] * len(least)][: len(least)]
    given = [w or str(d) for w, d in zip(filled, least, strict=True)]
    return parse_integers(given, place)


def _check_number(count: int, place: str) -> None:
    if not 0 <= count <= MOST_MEMBERS:
        raise InputError(
            f"makes {count} nodes or elements",
            place=place,
            expected=f"at most {MOST_MEMBERS}",
        )
