"""What a law makes of time alone, so that no step passes a pulse of it unseen."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from sidtool.formats.scene import Instruction

from .laws import Called, Parts

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

    def value(t: float) -> float:
        stack: list[Any] = []
        for part in parts:
            _run(part, stack, t)
        return float(stack[0])

    return value


def _run(part: Any, stack: list[Any], t: float) -> None:
    if isinstance(part, Called):
        native = part.native
        values = np.array(stack[len(stack) - native.count :], float)
        del stack[len(stack) - native.count :]
        try:
            stack.append(float(native.function(t, values)))
        except Exception as error:
            raise ValueError(str(error)) from None
    elif not isinstance(part, Instruction) or part.kind == "name":
        stack.append(1.0)
    elif part.kind in ("number", "time"):
        stack.append(part.value if part.kind == "number" else t)
    elif part.kind in _TWO:
        right = stack.pop()
        stack.append(_TWO[part.kind](stack.pop(), right))
    else:
        function = _OWN.get(part.kind) or getattr(math, part.kind)
        stack.append(function(stack.pop()))
