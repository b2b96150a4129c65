"""Units of outputs, for axes and tables."""

from __future__ import annotations

from .outputs import (
    FRICTION_QUANTITIES,
    IN_BODY,
    JOINT_QUANTITIES,
    MULTIPLIER,
    STATE,
    VALUE,
    coordinate_of,
    is_elastic,
    is_rate,
    is_stress,
    parse_output,
)

_KINDS = {"u": "m", "v": "m/s", "a": "m/s\N{SUPERSCRIPT TWO}", "w": "rad/s"}

_MOMENTA = {
    "momentum": "kg m/s",
    "angular_momentum": "kg m\N{SUPERSCRIPT TWO}/s",
}
#: Of what has an axis or a number behind it.
_WORDS = {**_MOMENTA, "quaternion": "", "rotation": "rad"}


def unit_of(name: str) -> str:
    """The unit of an output; empty where it has none that is known.

    Elastic coordinates are measured in what their SID says, multipliers in what their
    constraint needs, friction in N or N m as its joint moves, laws and their states in
    what their formula makes of it.

    Raises
    ------
    InputError : it is no name of an output.
    """
    parsed = parse_output(name)
    quantity = parsed.quantity.removesuffix(IN_BODY)
    if parsed.owner == "energy" and not parsed.marker:
        return "J"
    if parsed.owner == "constraint" and not parsed.marker:
        return ""
    if parsed.owner in _MOMENTA and not parsed.marker:
        return _MOMENTA[parsed.owner]
    if "_" in quantity and quantity.rpartition("_")[0] in _WORDS:
        return _WORDS[quantity.rpartition("_")[0]]
    if quantity in FRICTION_QUANTITIES:
        return ""
    if is_stress(quantity):
        return "Pa"
    if is_elastic(quantity) or MULTIPLIER.fullmatch(quantity):
        return ""
    if quantity in JOINT_QUANTITIES:
        return "N" if quantity[0] == "f" else "N m"
    if parsed.marker == STATE or quantity == VALUE:
        return ""
    coordinate = coordinate_of(quantity)
    if coordinate:
        unit = "rad" if coordinate.startswith("angle") else "m"
        return f"{unit}/s" if is_rate(quantity) else unit
    return _KINDS[quantity[0]] if len(quantity) == 2 else "m"
