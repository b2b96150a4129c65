"""Measures of the time history of an output: maximum, mean, ... ..."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import has_wildcard, parse_output

#: Name for the output times; no output has this name.
TIME = "t"


def mean(times: Array, values: Array) -> float:
    """Return the mean over time by the trapezoidal rule."""
    if times[-1] <= times[0]:
        return float(values[-1])
    return float(trapezoid(values, times) / (times[-1] - times[0]))


def root_mean_square(times: Array, values: Array) -> float:
    """Return the root mean square over time by the trapezoidal rule."""
    return float(np.sqrt(mean(times, values**2)))


MEASURES: dict[str, Callable[[Array, Array], float]] = {
    "max": lambda _, values: float(values.max()),
    "min": lambda _, values: float(values.min()),
    "end": lambda _, values: float(values[-1]),
    "mean": mean,
    "rms": root_mean_square,
    "amplitude": lambda _, values: float(values.max() - values.min()) / 2.0,
}


class Measure(NamedTuple):
    """A measure of an output, such as `tip.y.max`; `output` may have wildcards."""

    output: str
    name: str

    def __str__(self) -> str:
        return f"{self.output}.{self.name}"


def parse_measures(texts: str | Iterable[str]) -> list[Measure]:
    """Parse measures of the option `--of`; one text may hold several, with commas.

    Raises
    ------
    InputError : a text does not end in a measure, or names no output.
    """
    given = [texts] if isinstance(texts, str) else texts
    listed = [part.strip() for text in given for part in text.split(",")]
    if not any(listed):
        raise InputError(
            "nothing is measured", place="--of", expected="such as piston.x.max"
        )
    return [_parse_measure(text) for text in dict.fromkeys(listed) if text]


def _parse_measure(text: str) -> Measure:
    output, _, name = text.rpartition(".")
    if name not in MEASURES or not output:
        known = ", ".join(MEASURES)
        raise InputError(
            f"found {text!r}",
            place="--of",
            expected=f"an output and one of {known}, such as {text.strip('.')}.max",
        )
    if output != TIME and not has_wildcard(output):
        try:
            parse_output(output)
        except InputError as error:
            raise InputError(
                error.problem, place=f"--of {text}", expected=error.expected
            ) from None
    return Measure(output, name)
