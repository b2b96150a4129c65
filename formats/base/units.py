"""Units as texts, such as `kN m` or `mm/s^2`, with factor to SI and dimension."""

import math
import re
from typing import NamedTuple

from .errors import InputError

Exponents = tuple[int, int, int, int]

#: The unit in brackets behind the name of a column.
_IN_BRACKETS = re.compile(r"\s*[\[(]((?:[^][()]|\([^][()]*\))*)[\])]\s*$")
#: Units of a column that mean something else as well: gravity, a minimum, revolutions.
_AMBIGUOUS = ("g", "min", "1/min")
_SEPARATORS = re.compile(r"[\s*\N{MIDDLE DOT}\N{DOT OPERATOR}]+")


class Unit(NamedTuple):
    """A unit by its factor to SI, and its exponents of metre, kilogram, second and
    radian.
    """

    factor: float
    exponents: Exponents


_POUND_FORCE = 4.4482216152605
_LENGTH, _MASS, _TIME, _ANGLE = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)
_FORCE, _PRESSURE, _SPEED = (1, 1, -2, 0), (-1, 1, -2, 0), (0, 0, -1, 1)
_ENERGY, _POWER = (2, 1, -2, 0), (2, 1, -3, 0)
_UNITS: dict[str, Unit] = {
    "m": Unit(1.0, _LENGTH),
    "km": Unit(1e3, _LENGTH),
    "cm": Unit(1e-2, _LENGTH),
    "mm": Unit(1e-3, _LENGTH),
    "um": Unit(1e-6, _LENGTH),
    "\N{MICRO SIGN}m": Unit(1e-6, _LENGTH),
    "\N{GREEK SMALL LETTER MU}m": Unit(1e-6, _LENGTH),
    "in": Unit(0.0254, _LENGTH),
    "ft": Unit(0.3048, _LENGTH),
    "kg": Unit(1.0, _MASS),
    "g": Unit(1e-3, _MASS),
    "t": Unit(1e3, _MASS),
    "lb": Unit(0.45359237, _MASS),
    "s": Unit(1.0, _TIME),
    "ms": Unit(1e-3, _TIME),
    "us": Unit(1e-6, _TIME),
    "\N{MICRO SIGN}s": Unit(1e-6, _TIME),
    "\N{GREEK SMALL LETTER MU}s": Unit(1e-6, _TIME),
    "min": Unit(60.0, _TIME),
    "h": Unit(3600.0, _TIME),
    "Hz": Unit(1.0, (0, 0, -1, 0)),
    "N": Unit(1.0, _FORCE),
    "mN": Unit(1e-3, _FORCE),
    "daN": Unit(10.0, _FORCE),
    "kN": Unit(1e3, _FORCE),
    "MN": Unit(1e6, _FORCE),
    "GN": Unit(1e9, _FORCE),
    "lbf": Unit(_POUND_FORCE, _FORCE),
    "Pa": Unit(1.0, _PRESSURE),
    "kPa": Unit(1e3, _PRESSURE),
    "MPa": Unit(1e6, _PRESSURE),
    "GPa": Unit(1e9, _PRESSURE),
    "bar": Unit(1e5, _PRESSURE),
    "J": Unit(1.0, _ENERGY),
    "kJ": Unit(1e3, _ENERGY),
    "W": Unit(1.0, _POWER),
    "kW": Unit(1e3, _POWER),
    "rad": Unit(1.0, _ANGLE),
    "mrad": Unit(1e-3, _ANGLE),
    "deg": Unit(math.pi / 180, _ANGLE),
    "\N{DEGREE SIGN}": Unit(math.pi / 180, _ANGLE),
    "rev": Unit(2 * math.pi, _ANGLE),
    "rpm": Unit(2 * math.pi / 60, _SPEED),
}
#: Names of units, long ones first. Right behind others `ms` is `m s`, as in `Nms`.
_NAMES = "|".join(
    rf"(?<![A-Za-z]){name}" if name == "ms" else name
    for name in sorted(_UNITS, key=len, reverse=True)
)
#: A unit with its power, or one of 1 / ( ).
_TOKEN = re.compile(rf"({_NAMES})(?:\s*\^?\s*(-?[0-9]+))?|1(?=\s*/)|[/()]")


def parse_unit(text: str) -> Unit | None:
    """Return the unit that a text names, None of a text that names none.

    Factors may stand side by side (`Nm`) or be separated, powers are `^2` or `2`, and
    all behind a `/` divides, up to the end or the closing parenthesis.
    """
    factor, exponents, known = 1.0, [0, 0, 0, 0], False
    text = text.replace("\N{SUPERSCRIPT TWO}", "2").replace(
        "\N{SUPERSCRIPT THREE}", "3"
    )
    at, signs, sign = 0, [1], 1
    while at < len(text):
        if separator := _SEPARATORS.match(text, at):
            at = separator.end()
            continue
        match = _TOKEN.match(text, at)
        if match is None:
            return None
        at = match.end()
        if match[1]:
            unit, power = _UNITS[match[1]], sign * int(match[2] or 1)
            factor *= unit.factor**power
            exponents = [
                e + power * b for e, b in zip(exponents, unit.exponents, strict=True)
            ]
            known = True
        elif match[0] == "/":
            sign = -signs[-1]
        elif match[0] == "(":
            signs.append(sign)
        elif match[0] == ")":
            if len(signs) == 1:
                return None
            sign = signs.pop()
    x, m, t, a = exponents
    return Unit(factor, (x, m, t, a)) if known and len(signs) == 1 else None


def is_known_unit(text: str) -> bool:
    """Whether the unit of a column is converted, or it has none."""
    return text in ("", "-", "1") or parse_unit(text) is not None


def split_unit(head: str) -> tuple[str, str]:
    """Return name and unit of a column, such as `z [mm]`; "" without a unit."""
    match = _IN_BRACKETS.search(head)
    return _IN_BRACKETS.sub("", head).strip(), match[1].strip() if match else ""


def column_factor(text: str, wanted: str = "") -> float:
    """Return the factor from the unit in the head of a column to a wanted one.

    Units that are not known, and columns without a unit, have the factor 1.

    Parameters
    ----------
    wanted : by default the SI unit of the same dimension

    Raises
    ------
    InputError : the first one cannot be converted to the other, or means several
        things.
    """
    unit, own = parse_unit(text), parse_unit(wanted)
    if unit is None or text == wanted:
        return 1.0
    if not wanted:
        if text in _AMBIGUOUS:
            raise InputError(
                f"has the unit {text}, which has several meanings",
                expected="numbers in SI units, or their scale",
            )
        return unit.factor
    if own is None or unit.exponents != own.exponents:
        raise InputError(f"has the unit {text}", expected=f"one such as {wanted}")
    return unit.factor / own.factor
