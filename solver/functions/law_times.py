"""What a law makes of time alone, so that no step passes a pulse of it unseen."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sidtool.formats.scene import Instruction

from .laws import Called, Parts
from .returned_values import real_number

_TWO: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": math.pow,
    "min": min,
    "max": max,
    "atan2": math.atan2,
}
_OWN: dict[str, Callable[[Any], Any]] = {
    "negative": operator.neg,
    "abs": abs,
    "sign": np.sign,
}


def of_time(parts: Parts) -> Callable[[float], float] | None:
    """The value of a law over time while all that it reads is one; None for a law that
    does not look at the time.

    Functions of time in it are known as such.
    """
    looks = [isinstance(p, Called) or getattr(p, "kind", "") == "time" for p in parts]
    if not any(looks):
        return None

    return lambda t: value_at(parts, t, {})


def value_at(parts: Parts, t: float, known: Mapping[str, float]) -> float:
    """The value of a law where all that it reads is one, but for what is known."""
    stack: list[Any] = []
    for part in parts:
        _run(part, stack, t, known)
    return float(stack[0])


def _run(part: Any, stack: list[Any], t: float, known: Mapping[str, float]) -> None:
    if isinstance(part, Called):
        native = part.native
        values = np.array(stack[len(stack) - native.count :], float)
        del stack[len(stack) - native.count :]
        try:
            stack.append(real_number(native.function(t, values)))
        except Exception as error:
            raise ValueError(str(error)) from None
    elif not isinstance(part, Instruction):
        stack.append(1.0)
    elif part.kind == "name":
        stack.append(known.get(str(part.value), 1.0))
    elif part.kind in ("number", "time"):
        stack.append(part.value if part.kind == "number" else t)
    elif part.kind in _TWO:
        right = stack.pop()
        stack.append(_TWO[part.kind](stack.pop(), right))
    else:
        function = _OWN.get(part.kind) or getattr(math, part.kind)
        stack.append(function(stack.pop()))
