"""Laws of outputs in random scenes, and how they are said differently.

Each acts along a coordinate of a joint and reads one, the same or another.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from tests.metamorphic.generator.case import Table
from tests.metamorphic.generator.ingredients import Random

Coordinate = tuple[str, str]
Rename = Callable[[str], str]
KINDS = ("expression", "pid")
_NAME = re.compile(r"\w+\.\w+")


def law(rng: Random, coordinate: Coordinate, rest: float) -> Table:
    """A formula that is odd about `rest`, or a controller towards a place nearby."""
    name = ".".join(coordinate)
    if rng.random() < 0.5:
        numbers = {"a": float(rng.uniform(-2.0, 2.0)), "d": 0.2, "r": rest, "s": 0.7}
        value = f"a*sin(({name} - r)/s) - d*{name}_rate"
        return {"type": "expression", "value": value, "parameters": numbers}
    return {
        "type": "pid",
        "measured": name,
        "reference": rest + float(rng.uniform(-0.3, 0.3)),
        "p": float(rng.uniform(0.5, 3.0)),
        "i": 1.0,
        "d": 0.3,
        "filter": 0.05,
    }


def is_law(function: Table | None) -> bool:
    return function is not None and function["type"] in KINDS


def measured(function: Table) -> Coordinate:
    """Joint and coordinate that a law reads."""
    text = function.get("measured") or function["value"]
    name, coordinate = _NAME.findall(text)[0].split(".")
    return name, coordinate.removesuffix("_rate")


def renamed(function: Table, other: Rename) -> Table:
    new = dict(function)
    for key in ("measured", "value"):
        if key in new:
            new[key] = _NAME.sub(lambda found: other(found.group()), new[key])
    return new


def scaled(function: Table, factor: float) -> Table:
    """A law that yields so many times as much."""
    return _changed(function, factor)


def in_signs(function: Table, own: float, read: float) -> Table:
    """The law where the coordinate that it acts along, and the one that it reads,
    change their signs."""
    return _changed(function, own * read, read)


def in_units(function: Table, force: float, way: float, time: float) -> Table:
    """The law in other units of its value, of what it reads, and of time."""
    return _changed(function, force, way, time)


def _changed(
    function: Table, value: float, way: float = 1.0, time: float = 1.0
) -> Table:
    """The law of way * g, with times multiplied as well, that yields value * u."""
    if function["type"] == "expression":
        old = function["parameters"]
        numbers = {
            "a": old["a"] * value,
            "d": old["d"] * value * time / abs(way),
            "r": old["r"] * way,
            "s": old["s"] * abs(way),
        }
        return function | {"parameters": numbers}
    gain = value / abs(way)
    return function | {
        "reference": function["reference"] * way,
        "p": function["p"] * gain,
        "i": function["i"] * gain / time,
        "d": function["d"] * gain * time,
        "filter": function["filter"] * time,
    }
