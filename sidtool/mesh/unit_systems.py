"""Unit systems, conversion of a SID from one to another, limits of magnitude.

A SID names no units. The elastic coordinates keep their numbers here (they count as
dimensionless), so every motion q(t) stays what it was: the shape functions take the
unit of length and Me that of mass times length squared. Modes that were normalised to
Me = I are therefore no longer so; `change_basis` restores it where a reader needs it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    Array,
    Node,
    Section,
    Taylor,
)

Sigma = Literal["stress", "section force"]

_ALIASES = {"si": "m-kg-s", "mks": "m-kg-s", "cgs": "cm-g-s", "mpa": "mm-t-s"}
#: Exponents of length, mass and time in each block with dimensionless q.
_BLOCK_UNITS = {
    "mdCM": (1, 1, 0),
    "J": (2, 1, 0),
    "Ct": (1, 1, 0),
    "Cr": (2, 1, 0),
    "Me": (2, 1, 0),
    "Gr": (2, 1, 0),
    "Ge": (2, 1, 0),
    "Oe": (2, 1, 0),
    "ksigma": (2, 1, -2),
    "Ke": (2, 1, -2),
    "De": (2, 1, -1),
}
_NODE_UNITS = {"origin": (1, 0, 0), "phi": (1, 0, 0)}
_STRESS, _FORCE, _MOMENT = (-1, 1, -2), (1, 1, -2), (2, 1, -2)
# The largest exponent that the format prints has two digits.
_MAX_MAGNITUDE = 1e100


@dataclass(frozen=True)
class UnitSystem:
    """A consistent system: one unit of length, mass and time in SI units.

    `force` names the unit of force that follows.
    """

    name: str
    length: float
    mass: float
    time: float
    force: str


_POUND_FORCE = 4.4482216152605
_INCH = 0.0254
_FOOT = 0.3048

#: Known unit systems by name; one line adds one.
UNIT_SYSTEMS: Mapping[str, UnitSystem] = MappingProxyType(
    {
        system.name: system
        for system in (
            UnitSystem("m-kg-s", 1.0, 1.0, 1.0, "N"),
            UnitSystem("mm-t-s", 1e-3, 1e3, 1.0, "N"),
            UnitSystem("mm-kg-ms", 1e-3, 1.0, 1e-3, "kN"),
            UnitSystem("mm-g-ms", 1e-3, 1e-3, 1e-3, "N"),
            UnitSystem("mm-kg-s", 1e-3, 1.0, 1.0, "mN"),
            UnitSystem("cm-g-s", 1e-2, 1e-3, 1.0, "dyn"),
            UnitSystem("in-lbf-s", _INCH, _POUND_FORCE / _INCH, 1.0, "lbf"),
            UnitSystem("ft-lbf-s", _FOOT, _POUND_FORCE / _FOOT, 1.0, "lbf"),
        )
    }
)


def check_known_contents(sid: SID, purpose: str) -> None:
    """Refuse contents whose meaning the format leaves open.

    Raises
    ------
    InputError : a block of unknown name, or a term above the first order.
    """
    if sid.extra:
        raise InputError(
            f"the meaning of this block for {purpose} is not known",
            place=f"block {next(iter(sid.extra))}",
        )
    for name, block in sid.blocks.items():
        _check_order(block, f"block {name}", purpose)
    for node in sid.nodes:
        for name in NODE_SHAPES:
            entry = getattr(node, name)
            if entry is not None:
                _check_order(entry, f"node {node.id}, {name}", purpose)


def _check_order(entry: Taylor, place: str, purpose: str) -> None:
    if entry.mn is not None and entry.mn.any():
        raise InputError(
            f"the meaning of terms above the first order for {purpose} is not known",
            place=place,
        )


def unit_system(name: str) -> UnitSystem:
    """The unit system of this name, or of an alias such as "SI".

    Raises
    ------
    InputError : there is no such system.
    """
    key = name.strip().lower()
    key = _ALIASES.get(key, key)
    if key not in UNIT_SYSTEMS:
        raise InputError(
            f"there is no unit system {name!r}",
            expected=f"one of SI, {', '.join(UNIT_SYSTEMS)}",
        )
    return UNIT_SYSTEMS[key]


def convert_units(
    sid: SID, from_system: str, to_system: str, sigma: Sigma | None = None
) -> SID:
    """The SID with its numbers expressed in another unit system; see `rescale`.

    Of a SID that sidtool made of a model, sigma is known to be stress.

    Raises
    ------
    InputError : an unknown system, or contents whose unit is not known.
    """
    old, new = unit_system(from_system), unit_system(to_system)
    if (
        sigma is None and sid.carried is not None
    ):  # only SIDs that sidtool converted have this
        sigma = "stress"
    return rescale(
        sid,
        length=old.length / new.length,
        mass=old.mass / new.mass,
        time=old.time / new.time,
        sigma=sigma,
    )


def rescale(
    sid: SID, length: float, mass: float, time: float, sigma: Sigma | None = None
) -> SID:
    """The SID with every block multiplied by its unit.

    Parameters
    ----------
    length, mass, time : new units per old unit (m to mm: length = 1000)
    sigma : meaning of the optional entry sigma of nodes, which the format does not
        define

    The elastic coordinates keep their numbers. Labels are not changed.

    Raises
    ------
    InputError : a factor is not positive, or an entry has no known unit (blocks of
        unknown name, terms above first order, sigma without `sigma`).
    """
    for name, factor in (("length", length), ("mass", mass), ("time", time)):
        if not (factor > 0.0 and np.isfinite(factor)):
            raise InputError(
                f"found {factor}", place=name, expected="a positive finite factor"
            )
    check_magnitudes(sid)
    check_known_contents(sid, "a change of units")
    units = np.array([length, mass, time])
    blocks: dict[str, Any] = {
        name: _scale_entry(block, _unit_factor(units, _BLOCK_UNITS[name]))
        for name, block in sid.blocks.items()
    }
    nodes = tuple(_scale_node(node, units, sigma) for node in sid.nodes)
    sections = tuple(
        replace(section, part=_rescaled_part(section, length, mass, time))
        for section in sid.sections
    )
    return replace(sid, mass=sid.mass * mass, nodes=nodes, sections=sections, **blocks)


def _rescaled_part(section: Section, length: float, mass: float, time: float) -> SID:
    """Rescale the part beyond a section.

    The last six shape functions are displacements per unit jump: the first three (per
    length) have no unit, the others (per angle) have that of a length.
    """
    part = rescale(section.part, length, mass, time, "section force")
    factors = np.ones(part.nq)
    first = part.nq - section.jumps
    factors[first : first + 3] /= length
    entries: list[dict[str, Any]] = [part.blocks, *map(vars, part.nodes)]
    scaled: list[dict[str, Any]] = [
        {
            name: _scale_coordinates(entry, name, factors)
            for name, entry in owner.items()
            if isinstance(entry, Taylor)
        }
        for owner in entries
    ]
    nodes = [
        replace(node, **own) for node, own in zip(part.nodes, scaled[1:], strict=True)
    ]
    return replace(part, nodes=tuple(nodes), **scaled[0])


def _scale_coordinates(entry: Taylor, name: str, factors: Array) -> Taylor:
    """Multiply an entry by the factors of its shape functions.

    Parameters
    ----------
    name : of the block or of the entry of a node
    factors : (nq,)
    """
    m0, m1, shape = entry.m0, entry.m1, BLOCK_SHAPES.get(name) or NODE_SHAPES[name]
    scales = {"q": factors, "3q": np.tile(factors, 3)}
    for axis, size in zip((-2, -1), shape, strict=True):
        if isinstance(size, str):
            scale = scales[size].reshape(-1, 1) if axis == -2 else scales[size]
            m0, m1 = m0 * scale, None if m1 is None else m1 * scale
    if m1 is not None:
        m1 = m1 * factors[:, None, None]
    return replace(entry, m0=m0, m1=m1)


def _unit_factor(units: Array, exponents: tuple[int, int, int]) -> float:
    return float(np.prod(units ** np.array(exponents, float)))


def _scale_entry(entry: Taylor, factor: float | Array) -> Taylor:
    m1 = None if entry.m1 is None else entry.m1 * factor
    return replace(entry, m0=entry.m0 * factor, m1=m1)


def _scale_node(node: Node, units: Array, sigma: Sigma | None) -> Node:
    entries: dict[str, Any] = {
        name: _scale_entry(getattr(node, name), _unit_factor(units, exponents))
        for name, exponents in _NODE_UNITS.items()
    }
    # psi.m1 and AP are pure numbers; sigma is not.
    if node.sigma is not None:
        entries["sigma"] = _scale_entry(node.sigma, _sigma_factor(node, units, sigma))
    return replace(node, **entries)


def _sigma_factor(node: Node, units: Array, sigma: Sigma | None) -> float | Array:
    if sigma is None:
        raise InputError(
            "the file does not define what sigma holds",
            place=f"node {node.id}, sigma",
            expected="--sigma stress or --sigma 'section force'",
        )
    if sigma == "stress":
        return _unit_factor(units, _STRESS)
    per_row = [_unit_factor(units, _FORCE)] * 3 + [_unit_factor(units, _MOMENT)] * 3
    return np.array(per_row)[:, None]


def check_magnitudes(sid: SID) -> None:
    """Check that every number is finite and below 1e100 in magnitude.

    Raises
    ------
    InputError : an entry is not; the error names its block or node.
    """
    entries: list[tuple[str, Taylor | None]] = [
        (f"block {name}", block) for name, block in sid.blocks.items()
    ]
    for node in sid.nodes:
        entries += [(f"node {node.id}, {n}", getattr(node, n)) for n in NODE_SHAPES]
    numbers = [
        (place, part)
        for place, entry in [("mass", Taylor(np.full((1, 1), sid.mass))), *entries]
        if entry is not None
        for part in (entry.m0, entry.m1, entry.mn)
        if part is not None
    ]
    if _are_usual(np.concatenate([part.ravel() for _, part in numbers])):
        return
    place = next(place for place, part in numbers if not _are_usual(part))
    raise InputError(
        "holds a number that is infinite, undefined or beyond any physical size",
        place=place,
        expected="finite numbers below 1e100",
    )


def _are_usual(numbers: Array) -> bool:
    return bool(np.all(np.abs(numbers) < _MAX_MAGNITUDE))
