"""Drives of constant rate or acceleration as functions of time.

The integral of a rate is the state of a law, which no prescribed motion contains. Where
the rate or the acceleration is a constant, the integral is a polynomial of time.
"""

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

from ..functions.control_laws import CompiledLaw, LawInstruction, TimeLaw
from ..functions.law_derivatives import evaluate_law


def integrate_constant_rates(
    scene: SceneFile, laws: Mapping[str, CompiledLaw], given: Iterable[str]
) -> SceneFile | None:
    """The scene whose drives of constant rate or acceleration prescribe values; None
    where there are none.

    Outputs of the states that are left out are no longer recorded.

    Parameters
    ----------
    laws
        Of forces and drives.
    given
        Drives whose functions a program gives.
    """
    changed: dict[str, Drive] = {}
    for name, drive in scene.drives.items():
        if drive.of == "value" or name in given:
            continue
        value = _constant_value(laws[name])
        if value is not None:
            coefficients = (
                (value,) if drive.of == "rate" else (drive.start_rate, value / 2.0)
            )
            changed[name] = _polynomial_drive(
                drive, scene.time.start, (drive.start, *coefficients)
            )
    if not changed:
        return None
    removed = tuple(
        f"{name}.{part}" for name in changed for part in ("state.", "value")
    )
    recorded = tuple(
        name for name in scene.outputs.record if not name.startswith(removed)
    )
    outputs = scene.outputs.model_copy(update={"record": recorded})
    drives = {**scene.drives, **changed}
    return scene.model_copy(update={"drives": drives, "outputs": outputs})


def _polynomial_drive(drive: Drive, start: float, terms: tuple[float, ...]) -> Drive:
    piece = {"from": start, "coefficients": terms}
    function = Polynomial.model_validate({"pieces": [piece]})
    changes = {"of": "value", "start": 0.0, "start_rate": 0.0, "function": function}
    return drive.model_copy(update=changes)


def _constant_value(law: CompiledLaw) -> float | None:
    """The number that a law is, whatever moves; None if it is no such number."""
    numbers = [_constant_instruction(part) for part in law.value]
    if law.states or law.sample_time is not None or None in numbers:
        return None
    value = evaluate_law(tuple(part for part in numbers if part is not None), 0.0, {})
    return value if math.isfinite(value) else None


def _constant_instruction(part: LawInstruction) -> LawInstruction | None:
    """A part of a law that changes neither in time nor with the motion."""
    if isinstance(part, TimeLaw):
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
