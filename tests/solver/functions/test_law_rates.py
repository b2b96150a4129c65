"""Rates of formulas against differences along a motion."""

from __future__ import annotations

import math

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import parse_expression
from sidtool.solver.functions.control_laws import LawInstructions, LawState
from sidtool.solver.functions.law_derivatives import evaluate_law, time_derivative

FORMULAS = (
    "x*v - x/v + 3*t + 2",
    "x**3 + v**-2 + 2**x + x**v + t**0",
    "atan2(x, v) + atan(x*v)",
    "sin(x)*cos(2*v) - tan(0.3*x)",
    "asin(0.2*x) + acos(0.1*v) + log(v + 3)",
    "sinh(x) - cosh(v) + tanh(x*v) + exp(-x) + sqrt(2 + v)",
    "min(x, 0.2*v) + max(x, v) + clip(v, -1, 1.5) + abs(x - 4)",
    "-x",
    "7.5",
)
#: x' = v, v' = -x + sin(t)
STATES = {"x": (0.7, "v"), "v": (1.1, "-x + sin(t)")}


def parsed(text: str) -> LawInstructions:
    return parse_expression(text, {})


def course(t: float) -> dict[str, float]:
    """The states along x'' = -x + sin(t), from where they start."""
    x0, v0 = STATES["x"][0], STATES["v"][0]
    x = x0 * math.cos(t) + (v0 + 0.5) * math.sin(t) - 0.5 * t * math.cos(t)
    v = -x0 * math.sin(t) + v0 * math.cos(t) + 0.5 * t * math.sin(t)
    return {"x": x, "v": v}


@pytest.mark.parametrize("formula", FORMULAS)
def test_rates_are_those_along_the_motion(formula: str) -> None:
    states = {name: LawState(x, parsed(rate)) for name, (x, rate) in STATES.items()}
    value, t, h = parsed(formula), 0.3, 1e-3
    rate = time_derivative(value, states, "here", smooth=False)

    def at(time: float) -> float:
        return evaluate_law(value, time, course(time))

    wide, near = (at(t + 2 * h) - at(t - 2 * h), at(t + h) - at(t - h))
    differences = (8.0 * near - wide) / (12.0 * h)
    assert evaluate_law(rate, t, course(t)) == pytest.approx(
        differences, rel=1e-8, abs=1e-9
    )


@pytest.mark.parametrize("formula", ["abs(x)", "min(x, v)", "sign(x)", "clip(x, 0, 1)"])
def test_what_bends_has_no_smooth_rate(formula: str) -> None:
    states = {name: LawState(x, parsed(rate)) for name, (x, rate) in STATES.items()}
    with pytest.raises(InputError, match="jumps, or its rate does"):
        time_derivative(parsed(formula), states, "here", smooth=True)
