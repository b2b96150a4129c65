"""Equations, coupled directions and point masses of an ANSYS archive."""

import re
from collections.abc import Mapping

import numpy as np

from sidtool.formats.base.errors import InputError

from ...mesh.connections import RawEquation, Term
from ...mesh.deck_text import parse_integers, parse_numbers
from ...mesh.imported_mesh import RawMass
from .content import ArchiveContent, ConstraintEquation, axes_of

_DIRECTIONS = ("UX", "UY", "UZ")
#: Widths of whole numbers, if there are some, and of reals.
_REALS = re.compile(r"\((?:\d+[iI](\d+),\s*)?\d+[gGeEfF](\d+)")
#: Type of point masses, and KEYOPT(3) -> how many directions their mass has, and
#: whether they have inertia.
POINT_MASS = 21
_MASSES = {0: (3, True), 2: (1, False), 3: (1, True), 4: (1, False)}


def read_equation(content: ArchiveContent, words: list[str]) -> None:
    """CE, number, constant, node, label, factor, ...; or DEFI and NODE of R5.0.

    Raises
    ------
    InputError : it has a constant.
    """
    blocked = words[1].upper().startswith("R5")
    if blocked and words[2].upper() == "DEFI":
        label, constant, terms = words[4], words[5], []
    elif blocked:
        label, constant, terms = "", "", words[3:]
    else:
        label, constant, terms = words[1], "".join(words[2:3]), words[3:]
    if constant and parse_numbers([constant], content.place, "a constant")[0]:
        raise InputError(
            f"CE {label} has the constant {constant}",
            place=content.place,
            expected="sums that are zero",
        )
    if label:
        number = parse_integers([label], content.place, "CE, number, constant, terms")[
            0
        ]
        content.current["CE"] = number
        content.sums.setdefault(number, ConstraintEquation(content.place))
    content.sums[content.current["CE"]].terms += _equation_terms(content, terms)


def _equation_terms(
    content: ArchiveContent, words: list[str]
) -> list[tuple[int, str, float]]:
    filled = [word for word in words if word]
    if len(filled) % 3:
        raise InputError(
            f"CE has {len(filled)} entries",
            place=content.place,
            expected="node, label and factor of every term",
        )
    return [
        (
            parse_integers([node], content.place, "a node")[0],
            label.upper(),
            parse_numbers([factor], content.place, "a factor")[0],
        )
        for node, label, factor in zip(*[iter(filled)] * 3, strict=True)
    ]


def read_coupled(content: ArchiveContent, words: list[str]) -> None:
    """CP, number, label, nodes: they have one displacement.

    Raises
    ------
    InputError : it names components, or is written in another way.
    """
    number, label = words[1], "".join(words[2:3]).upper()
    nodes = parse_integers(
        [word for word in words[3:] if word], content.place, "CP, number, label, nodes"
    )
    if not nodes:
        raise InputError(
            f"CP {number} couples no nodes",
            place=content.place,
            expected="CP, number, label, nodes",
        )
    labels = _DIRECTIONS if label == "ALL" else (label,)
    for own in labels:
        key = (number, own)
        content.coupled.setdefault(key, (content.place, []))[1].extend(nodes)


def equations_of(content: ArchiveContent) -> tuple[RawEquation, ...]:
    """All of them along the directions of their nodes.

    Raises
    ------
    InputError : a node or a direction is not there.
    """
    result = [
        RawEquation(
            tuple(_equation_term(content, *term, own.place) for term in own.terms),
            own.place,
        )
        for own in content.sums.values()
        if own.terms
    ]
    for (_, label), (place, nodes) in content.coupled.items():
        first, *others = dict.fromkeys(nodes)
        for node in others:
            pair = ((node, 1.0), (first, -1.0))
            terms = [
                _equation_term(content, n, label, share, place) for n, share in pair
            ]
            result.append(RawEquation(tuple(terms), place))
    return tuple(result)


def _equation_term(
    content: ArchiveContent, node: int, label: str, factor: float, place: str
) -> Term:
    if label not in _DIRECTIONS or node not in content.nodes:
        raise InputError(
            f"names {label} of node {node}",
            place=place,
            expected="UX, UY or UZ of a node of this file",
        )
    axes = axes_of(content.turned.get(node, (0.0, 0.0, 0.0)))
    x, y, z = (factor * axes[_DIRECTIONS.index(label)]).tolist()
    return node, (x, y, z)


def read_constants(content: ArchiveContent, words: list[str]) -> None:
    """R, set, values."""
    label = parse_integers(words[1:2], content.place, "a set of real constants")[0]
    values = [word or "0" for word in words[2:]]
    content.reals[label] = parse_numbers(values, content.place, "real constants")


def read_constant_block(content: ArchiveContent, words: list[str]) -> None:
    """RLBLOCK, sets, ...: two formats; number, count and values of every set.

    Raises
    ------
    InputError : the lines do not have these formats.
    """
    first, further = (_REALS.search(content.next()) for _ in range(2))
    if first is None or further is None:
        raise InputError(
            "has no formats",
            place=content.place,
            expected="lines like (2i8,6g16.9) and (7g16.9)",
        )
    head, wide = int(first.group(1) or 8), int(first.group(2))
    for _ in range(parse_integers(words[1:2], content.place, "a number of sets")[0]):
        line = content.next()
        fields = [line[:head], line[head : 2 * head]]
        label, count = parse_integers(
            fields, content.place, "a set and how many values"
        )
        texts = _split_fixed_width(line[2 * head :], wide)
        while len(texts) < count:
            texts += _split_fixed_width(content.next(), int(further.group(2)))
        content.reals[label] = parse_numbers(
            texts[:count], content.place, "real constants"
        )


def _split_fixed_width(line: str, width: int) -> list[str]:
    line = line.rstrip()
    return [line[i : i + width].strip() or "0" for i in range(0, len(line), width)]


def point_mass(content: ArchiveContent, values: list[int], place: str) -> RawMass:
    """Return the point mass of an element of type 21.

    Raises
    ------
    InputError : its mass has directions or axes of its own, or is not constant.
    """
    keys = {i: v for (k, i), v in content.options.items() if k == values[1]}
    reals = [*content.reals.get(values[2], []), *[0.0] * 6]
    count, turns = _MASSES.get(keys.get(3, 0), (0, False))
    masses = reals[:count]
    inertia = tuple(reals[count : count + 3]) if turns else (0.0,) * 3
    if turns and count == 1:  # about z alone
        inertia = (0.0, 0.0, reals[1])
    odd = np.ptp(masses or [0.0, 1.0]) > 0 or any(keys.get(i, 0) for i in (1, 2))
    if odd or values[2] not in content.reals:
        raise InputError(
            f"element {values[10]} of type {POINT_MASS} has the real constants "
            f"{content.reals.get(values[2], 'none')} and KEYOPT {keys}",
            place=place,
            expected="one mass for all directions, along the global axes",
        )
    xx, yy, zz = inertia
    return RawMass(values[11], masses[0], place, inertia=(xx, yy, zz, 0.0, 0.0, 0.0))


def real_thickness(
    content: ArchiveContent, kind: str, keys: Mapping[int, int], label: int, place: str
) -> float | None:
    """Return the thickness of plane elements from their real constants (KEYOPT(3) = 3).

    Raises
    ------
    InputError : there are none.
    """
    if kind not in ("quad4", "quad8") or keys.get(3, 0) != 3:
        return None
    thickness = content.reals.get(label, [0.0])[0]
    if thickness <= 0:
        raise InputError(
            f"the real constants {label} hold no thickness",
            place=place,
            expected="R, set, thickness",
        )
    return thickness
