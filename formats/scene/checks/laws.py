"""Checks of laws: formulas that can be read, limits in order, states that are told."""

from __future__ import annotations

from ...errors import InputError
from ...toml.expressions import FUNCTIONS, parse_expression
from ..laws import Expression, Pid
from .failures import fail


def check_expression(law: Expression, place: str) -> None:
    """Raise what does not fit in a formula and its states, with the key."""
    _check_limits(law.limits, place)
    _check_formula(law.value, law, f"{place}.value")
    for name, state in law.states.items():
        here = f"{place}.states.{name}"
        if name in FUNCTIONS or name in ("t", "pi") or not name.isidentifier():
            fail(here, f"a state has the name {name!r}", "a word that is no function")
        if name in law.parameters:
            fail(here, "is a parameter as well", "one of them")
        wanted = "rate" if law.sample_time is None else "next"
        for key in ("rate", "next"):
            formula = getattr(state, key)
            if (formula is not None) != (key == wanted):
                found = f"{key} is {'given' if formula is not None else 'missing'}"
                time = "without" if law.sample_time is None else "with"
                fail(f"{here}.{key}", found, f"{wanted} {time} a sample time")
            if formula is not None:
                _check_formula(formula, law, f"{here}.{key}")


def check_pid(law: Pid, place: str) -> None:
    """Raise what does not fit in a controller, with the key."""
    _check_limits(law.limits, place)
    if law.p == law.i == law.d == 0.0:
        fail(place, "does nothing", "p, i or d")
    if law.filter is not None and law.d == 0.0:
        fail(f"{place}.filter", "stands without d", "both, or none")
    if law.anti_windup is not None and (law.i == 0.0 or law.limits is None):
        fail(f"{place}.anti_windup", "has nothing to do", "i and limits as well")
    alone = law.p == law.d == 0.0 and law.limits is not None
    if alone and law.anti_windup is None:
        fail(f"{place}.anti_windup", "is missing", "a time, as neither p nor d say one")


def _check_limits(limits: tuple[float, float] | None, place: str) -> None:
    if limits is not None and not limits[0] < limits[1]:
        fail(f"{place}.limits", f"found {list(limits)}", "a lower and an upper bound")


def _check_formula(text: str, law: Expression, place: str) -> None:
    try:
        parse_expression(text, law.known)
    except InputError as error:
        fail(place, error.problem, error.expected)
