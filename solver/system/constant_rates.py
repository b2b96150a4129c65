"""Drives of constant rate or acceleration as what they are: known functions of time.

What a rate adds up to is a state of a law, which no prescribed motion decides. Where
the rate, or the acceleration, is one number, it is a polynomial of the time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from sidtool.formats.scene import (
    Constant,
    Drive,
    Function,
    Harmonic,
    Instruction,
    Polynomial,
    SceneFile,
)

from ..functions.law_times import value_at
from ..functions.laws import LawParts, Part, Timing


def with_integrated_rates(
    scene: SceneFile, laws: Mapping[str, LawParts], given: Iterable[str]
) -> SceneFile | None:
    """The scene whose drives of constant rate or acceleration prescribe values; None
    where there are none.

    laws : of forces and drives
    given : drives whose functions a program gives

    Outputs of the states that are left out are no longer recorded.
    """
    found: dict[str, Drive] = {}
    for name, drive in scene.drives.items():
        if drive.of == "value" or name in given:
            continue
        value = _constant(laws[name])
        if value is not None:
            rise = (value,) if drive.of == "rate" else (drive.start_rate, value / 2.0)
            found[name] = _polynomial(drive, scene.time.start, (drive.start, *rise))
    if not found:
        return None
    lost = tuple(f"{name}.{part}" for name in found for part in ("state.", "value"))
    kept = tuple(name for name in scene.outputs.record if not name.startswith(lost))
    outputs = scene.outputs.model_copy(update={"record": kept})
    drives = {**scene.drives, **found}
    return scene.model_copy(update={"drives": drives, "outputs": outputs})


def _polynomial(drive: Drive, start: float, terms: tuple[float, ...]) -> Drive:
    piece = {"from": start, "coefficients": terms}
    function = Polynomial.model_validate({"pieces": [piece]})
    changes = {"of": "value", "start": 0.0, "start_rate": 0.0, "function": function}
    return drive.model_copy(update=changes)


def _constant(law: LawParts) -> float | None:
    """The number that a law is, whatever moves; None if it is no such number."""
    numbers = [_number(part) for part in law.value]
    if law.states or law.sample_time is not None or None in numbers:
        return None
    value = value_at(tuple(part for part in numbers if part is not None), 0.0, {})
    return value if math.isfinite(value) else None


def _number(part: Part) -> Part | None:
    """A part of a law that changes neither in time nor with the motion."""
    if isinstance(part, Timing):
        value = _constant_function(part.function)
        return None if value is None else Instruction("number", value)
    plain = isinstance(part, Instruction) and part.kind not in ("name", "time")
    return part if plain else None


def _constant_function(function: Function) -> float | None:
    if isinstance(function, Constant):
        return function.value
    if isinstance(function, Harmonic) and function.amplitude == 0.0:
        return function.offset
    if isinstance(function, Polynomial):
        first, *rest = function.pieces
        if not rest and first.coefficients and not any(first.coefficients[1:]):
            return first.coefficients[0]
    return None
