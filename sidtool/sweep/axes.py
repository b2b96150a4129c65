"""Axes of a sweep: keys of a scene and the values that they take."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.toml.expressions import evaluate_number

Axes = dict[str, tuple[Any, ...]]
Over = str | Iterable[str] | Mapping[str, Iterable[Any]]
_RANGE_FORM = (
    "KEY=FROM:TO:COUNT, with :log at its end for equal ratios, or KEY=VALUE,VALUE"
)
#: Sweeps with more points are refused as mistakes.
MAX_POINTS = 1_000_000


def parse_axes(over: Over) -> Axes:
    """Parse axes from texts of the option `--over`, or from a mapping of keys to
    values.

    Raises
    ------
    InputError : a text has another form, an axis has no values, or there are too many
        points.
    """
    axes: Axes = {}
    if isinstance(over, Mapping):
        axes = {key: _values_given(key, values) for key, values in over.items()}
    else:
        for text in [over] if isinstance(over, str) else over:
            key, values = _parse_axis(text)
            if key in axes:
                raise InputError(
                    f"{key} is varied twice", place="--over", expected="each key once"
                )
            axes[key] = values
    if not axes:
        raise InputError("nothing is varied", place="--over", expected=_RANGE_FORM)
    count = 1
    for values in axes.values():
        count *= len(values)
    if count > MAX_POINTS:
        raise InputError(
            f"{count} points", place="--over", expected=f"at most {MAX_POINTS} points"
        )
    return axes


def axis_combinations(axes: Axes) -> list[dict[str, Any]]:
    """Return all combinations of values; the last axis changes fastest."""
    return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def _values_given(key: str, values: Iterable[Any]) -> tuple[Any, ...]:
    """Convert values given in Python; NumPy numbers and arrays become plain ones."""
    several = [values] if isinstance(values, str | int | float) else list(values)
    if not several:
        raise InputError(f"{key} has no values", place="over", expected="at least one")
    return tuple(
        v.tolist() if isinstance(v, np.generic | np.ndarray) else v for v in several
    )


def _parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (key and equals and values):
        raise InputError(f"found {text!r}", place="--over", expected=_RANGE_FORM)
    parts = values.split(":")
    if len(parts) in (3, 4) and values[0] not in "\"'[{":
        return key, _parse_range(text, parts)
    return key, tuple(_split_values(values))


def _parse_range(text: str, parts: list[str]) -> tuple[float, ...]:
    """Return evenly spaced values of a range that includes both ends.

    Raises
    ------
    InputError : an end or the count is not a number, or a logarithmic range is not
        positive.
    """
    try:
        first, last = (evaluate_number(part, {}) for part in parts[:2])
        count = int(parts[2])
    except (InputError, ValueError):
        raise InputError(
            f"found {text!r}", place="--over", expected=_RANGE_FORM
        ) from None
    if not 1 <= count <= MAX_POINTS or (count == 1 and first != last):
        raise InputError(
            f"{parts[2]} values in {text!r}", place="--over", expected="2 or more"
        )
    if parts[3:] not in ([], ["log"]):
        raise InputError(
            f"found {parts[3]!r} in {text!r}", place="--over", expected="log or nothing"
        )
    if parts[3:] and not (first > 0 and last > 0):
        raise InputError(
            f"{text!r} has values without a logarithm",
            place="--over",
            expected="positive numbers",
        )
    space = np.geomspace if parts[3:] else np.linspace
    return tuple(float(f"{value:.15g}") for value in space(first, last, count))


def _split_values(text: str) -> list[Any]:
    """Return values separated by commas, each as in `--set`."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except tomllib.TOMLDecodeError:
        parts = [part.strip() for part in text.split(",")]
    if not all(parts):
        raise InputError(f"found {text!r}", place="--over", expected=_RANGE_FORM)
    return [_parse_value(part) for part in parts]


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
