"""Requested accuracy of a run: the key `wanted` of [accuracy]."""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from ..base.errors import InputError
from .tables import MAX_RELATIVE_ERROR, MIN_RELATIVE_ERROR, SceneTables
from .units import unit_of
from .wildcards import has_wildcard

_AMOUNT = re.compile(r"([-+0-9.eE]++)\s*+(\S.*)?")
_PREFIXES = {
    "n": 1e-9,
    "u": 1e-6,
    "\N{MICRO SIGN}": 1e-6,
    "m": 1e-3,
    "": 1.0,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
}
_PREFIXED = {"m", "m/s", "m/s\N{SUPERSCRIPT TWO}", "N", "N m", "Pa", "J", "W", "rad"}
_DEGREE = math.pi / 180.0


class Tolerance(NamedTuple):
    """An error that is allowed: in the unit of the output, or of its variation."""

    value: float
    absolute: bool


def tolerance(
    name: str, amount: float | str, scene: SceneTables | None = None
) -> Tolerance:
    """Return the requested error of an output: 1e-3, "0.1 %" of its variation, or "1e-6
    m".

    Raises
    ------
    InputError : no such text, a unit that the output does not have, or no positive
        number.
    """
    if not isinstance(amount, str):
        return Tolerance(amount, False)
    match = _AMOUNT.fullmatch(amount.strip())
    value = _parse_number(match[1]) if match else math.nan
    unit = (match[2] or "") if match else ""
    if not 0.0 < value < math.inf:
        raise _invalid_amount(name, amount, scene)
    if unit == "%":
        if not MIN_RELATIVE_ERROR <= value / 100.0 <= MAX_RELATIVE_ERROR:
            raise _invalid_amount(name, amount, scene)
        return Tolerance(value / 100.0, False)
    factor = _unit_factors(unit_of(name, scene)).get(_without_prefix(unit))
    if factor is None:
        raise _invalid_amount(name, amount, scene)
    return Tolerance(value * factor, True)


def request_texts(wanted: float | Mapping[str, float | str]) -> dict[str, str]:
    """Return the request as texts by output; `*` for all recorded outputs."""
    if not isinstance(wanted, Mapping):
        return {"*": f"{wanted:g}"}
    return {n: w if isinstance(w, str) else f"{w:g}" for n, w in wanted.items()}


def check_wanted(
    wanted: float | Mapping[str, float | str] | None, scene: SceneTables
) -> None:
    """Check the requests for outputs without wildcards, whose units are known.

    Raises
    ------
    InputError : see `tolerance`.
    """
    for name, amount in wanted.items() if isinstance(wanted, Mapping) else ():
        if not has_wildcard(name):
            tolerance(name, amount, scene)


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _without_prefix(unit: str) -> str:
    return unit.replace("^2", "2").replace("s2", "s\N{SUPERSCRIPT TWO}")


def _unit_factors(unit: str) -> dict[str, float]:
    """Return the factor of a number in each unit that can be written."""
    if unit not in _PREFIXED:
        return {unit: 1.0}
    factors = {prefix + unit: factor for prefix, factor in _PREFIXES.items()}
    return factors | ({"deg": _DEGREE} if unit == "rad" else {})


def _invalid_amount(name: str, amount: str, scene: SceneTables | None) -> InputError:
    unit = unit_of(name, scene)
    example = f'"1e-6 {unit}"' if unit else '"1e-6"'
    return InputError(
        f"found {amount!r}",
        place=f"accuracy.wanted, {name}",
        expected=f'an error such as 1e-3 or "0.1 %" of its variation, or {example}',
    )
