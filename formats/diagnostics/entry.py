"""An entry of the catalogue of diagnostics, and how its message is filled."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from string import Formatter
from typing import Any

from sidtool.formats.text import counted_noun

ERROR, WARNING, INFO = SEVERITIES = ("error", "warning", "info")
#: A number, a name, or several of them, of a message.
Value = float | int | str | Sequence[str] | Sequence[float] | Sequence[str | float]
#: Fractions below this are printed as "< 1e-06 %".
SMALLEST_FRACTION = 1e-8


@dataclass(frozen=True)
class Entry:
    """What the program can say under one code.

    Attributes
    ----------
    code : "N" and three digits, never used for anything else again
    severity : error, warning or info
    message : the fact, with `{name}` for each value; `{name:.2g}` formats a number,
        `{name:node}` counts nodes
    remedy : one sentence on what to do, or none
    explanation : what it means, and how each number is computed, with its threshold
    units : of the values that have one; "%" prints a fraction in per cent
    example : values for an example, with `subject` and `t` where it has them
    """

    code: str
    severity: str
    message: str
    explanation: str
    remedy: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    example: Mapping[str, Any] = field(default_factory=dict)

    def data_unit(self, name: str) -> str:
        """The unit of a value in the data of a diagnostic; "1" for fractions."""
        unit = self.units.get(name, "")
        return "1" if unit == "%" else unit


def fill(template: str, values: Mapping[str, Value], units: Mapping[str, str]) -> str:
    """Return a template filled with values.

    Numbers have three significant digits and their unit, fractions with the unit "%"
    are printed in per cent, several names or numbers are joined by commas.
    """
    parts = []
    for text, name, spec, _ in Formatter().parse(template):
        parts.append(text)
        if name is not None:
            parts.append(_text(values[name], spec or "", units.get(name, "")))
    return "".join(parts)


def _text(value: Value, spec: str, unit: str) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        parts = [v if isinstance(v, str) else _number(v, spec) for v in value]
        return ", ".join(parts) + (f" {unit}" if unit else "")
    if unit == "%":
        if 0.0 < abs(value) < SMALLEST_FRACTION:
            return f"< {100 * SMALLEST_FRACTION:g} %"
        return f"{per_cent(value, spec or '.3g')} %"
    text = _number(value, spec)
    return f"{text} {unit}" if unit else text


def _number(value: float, spec: str) -> str:
    if len(spec) > 1 and spec.replace(" ", "").isalpha():
        return counted_noun(int(value), spec)
    return format(value, spec) if spec else _short(value)


def per_cent(share: float, spec: str) -> str:
    """A share in per cent; from 99 % on without digits behind the point."""
    sign = "+" if spec.startswith("+") else ""
    whole = f"{sign}.0f" if abs(share) < 1e3 else f"{sign}.2g"
    return format(100.0 * share, spec if abs(share) < 0.99 else whole)


def _short(value: float) -> str:
    """A number with three significant digits, below a million without an exponent."""
    if isinstance(value, int) or 1e3 <= abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.3g}"
