"""Quantities of a body and their derivatives: mass, frequencies, inertia, compliance.

A quantity is written NAME or NAME(ARGUMENT), see `QUANTITIES`. It is a function of a
SID; its derivative follows from that of the SID by the product rule.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import BLOCK_SHAPES, J_INDICES, NODE_SHAPES, SID
from sidtool.formats.toml.expressions import split_at_commas

from ..eigensolvers.eigenpair_derivatives import clusters

_FORM = re.compile(r"(\w+)(?:\((.*)\))?")
_ENTRY = re.compile(r"(?:(\w+)\.)?(\w+?)(?:\.m1\[(\d+)\])?\[(\d+),\s*(\d+)\]")
_AXES = "xyz"

#: Value and derivative of a quantity.
Pair = tuple[float, float]

#: Forms of quantities with their meanings, for help and messages.
QUANTITIES: Mapping[str, str] = {
    "mass": "mass",
    "frequency(k)": "k-th frequency of the body on the supports of its frame; "
    "frequency(*) all of them",
    "centre(x)": "coordinate of the centre of mass in the body frame, also y, z",
    "inertia(xx)": "moment or product of inertia about the origin of the body frame, "
    "also yy, zz, xy, xz, yz",
    "compliance(NAME.x)": "static displacement of a marker along x, y or z by a unit "
    "force there",
    "entry(Ke[0,0])": "entry of a block of the SID; of a node entry(2.phi[1,0]), of a "
    "first-order term entry(J.m1[0][2,0])",
}


@dataclass(frozen=True)
class Quantity:
    """A number that a SID gives.

    Attributes
    ----------
    text : as it is written
    unit : its SI unit
    evaluate : function of a SID and its derivative that returns value and derivative
    """

    text: str
    unit: str
    evaluate: Callable[[SID, SID], Pair]


def parse_quantities(
    texts: str | Iterable[str], sid: SID, nodes: Mapping[str, str]
) -> list[Quantity]:
    """Return the quantities of texts, each of which may hold several.

    Parameters
    ----------
    nodes : marker -> id of its node in the SID

    Raises
    ------
    InputError : there is no such quantity, mode, marker or entry.
    """
    given = [texts] if isinstance(texts, str) else [*texts]
    parts = [part for text in given for part in split_at_commas(text)]
    found: list[Quantity] = []
    for part in dict.fromkeys(parts):
        found += _parse(part, sid, nodes)
    if not found:
        raise _unknown("nothing")
    return found


def _parse(text: str, sid: SID, nodes: Mapping[str, str]) -> list[Quantity]:
    match = _FORM.fullmatch(text)
    if match is None or match[1] not in _PARSERS:
        raise _unknown(repr(text))
    return _PARSERS[match[1]](text, (match[2] or "").strip(), sid, nodes)


def _unknown(what: str) -> InputError:
    return InputError(
        f"found {what}", place="--of", expected=", ".join(QUANTITIES) + " or others"
    )


def _mass(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    return [Quantity(text, "kg", lambda s, d: (s.mass, d.mass))]


def _frequency(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    numbers = range(1, sid.nq + 1) if argument == "*" else [_mode(argument, sid)]
    return [
        Quantity(f"frequency({k})", "Hz", partial(_frequency_pair, k)) for k in numbers
    ]


def _mode(argument: str, sid: SID) -> int:
    if argument.isdecimal() and 1 <= int(argument) <= sid.nq:
        return int(argument)
    raise InputError(
        f"there is no mode {argument!r}",
        place="--of",
        expected=f"frequency(k) with k from 1 to {sid.nq}, or frequency(*)",
    )


def _frequency_pair(number: int, sid: SID, derivative: SID) -> Pair:
    return _frequencies(sid, derivative)[number - 1]


def _frequencies(sid: SID, derivative: SID) -> list[Pair]:
    """Return frequencies [Hz] and their derivatives.

    Those of equal frequencies are the eigenvalues of their block, ascending: they are
    derivatives along the variable, and those of the other direction are in the
    opposite order.
    """
    squares = np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)
    values = np.sqrt(np.maximum(squares, 0.0))
    slopes = np.zeros(sid.nq)
    for group in clusters(squares):
        inside = np.ix_(group, group)
        block = (
            derivative.Ke.m0[inside] - squares[group].mean() * derivative.Me.m0[inside]
        )
        slopes[group] = np.linalg.eigvalsh((block + block.T) / 2)
    rates = slopes / (2 * np.maximum(values, 1e-300)) / (2 * np.pi)
    return list(zip((values / (2 * np.pi)).tolist(), rates.tolist(), strict=True))


def _centre(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    axis = _axis(argument)

    def evaluate(s: SID, d: SID) -> Pair:
        value = float(s.mdCM.m0[axis, 0]) / s.mass
        return value, (float(d.mdCM.m0[axis, 0]) - value * d.mass) / s.mass

    return [Quantity(text, "m", evaluate)]


def _axis(argument: str) -> int:
    if argument in ("x", "y", "z"):
        return _AXES.index(argument)
    raise InputError(f"found {argument!r}", place="--of", expected="x, y or z")


def _inertia(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    names = [_AXES[a] + _AXES[b] for a, b in J_INDICES]
    if argument not in names:
        raise InputError(f"found {argument!r}", place="--of", expected=", ".join(names))
    row = names.index(argument)
    return [
        Quantity(
            text,
            "kg m^2",
            lambda s, d: (float(s.J.m0[row, 0]), float(d.J.m0[row, 0])),
        )
    ]


def _compliance(
    text: str, argument: str, sid: SID, nodes: Mapping[str, str]
) -> list[Quantity]:
    name, _, direction = argument.rpartition(".")
    axis = _axis(direction)
    if name not in nodes:
        raise InputError(
            f"there is no marker {name!r}", place="--of", expected=", ".join(nodes)
        )

    def evaluate(s: SID, d: SID) -> Pair:
        row, change = (x.node(nodes[name]).phi.m0[axis] for x in (s, d))
        answer = np.linalg.solve(s.Ke.m0, row)
        return float(row @ answer), float(
            2 * change @ answer - answer @ d.Ke.m0 @ answer
        )

    return [Quantity(text, "m/N", evaluate)]


def _entry(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    match = _ENTRY.fullmatch(argument)
    expected = "such as entry(Ke[0,0]), entry(2.phi[1,0]) or entry(J.m1[0][2,0])"
    if match is None:
        raise InputError(f"found {argument!r}", place="--of", expected=expected)
    node, block, order, *index = match.groups()
    row, column = map(int, index)
    if block not in (BLOCK_SHAPES if node is None else NODE_SHAPES):
        raise InputError(
            f"there is no block {block!r}", place="--of", expected=expected
        )

    def number(s: SID) -> float:
        part = getattr(s if node is None else s.node(node), block)
        if part is None:
            raise IndexError
        if order is not None:
            return float(part.first_order(s.nq)[int(order), row, column])
        return float(part.m0[row, column])

    try:
        number(sid)
    except IndexError:
        raise InputError(
            f"the SID has no {argument}", place="--of", expected=expected
        ) from None
    return [Quantity(text, "", lambda s, d: (number(s), number(d)))]


_PARSERS: dict[str, Callable[..., list[Quantity]]] = {
    "mass": _mass,
    "frequency": _frequency,
    "centre": _centre,
    "inertia": _inertia,
    "compliance": _compliance,
    "entry": _entry,
}
