"""Numbers as the writers of SID files print them."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..sid import Array
from .lines import Lines

_NUMBER = re.compile(
    r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eEdD]([+-]?\d+)|([+-]\d+))?", re.ASCII
)
_INTEGER = re.compile(r"[+-]?\d{1,9}", re.ASCII)

REAL_EXPECTED = "a finite number such as 1.5, -7.065D+02 or 1.0-100"


def reals(texts: Sequence[str], numbers: Sequence[int], lines: Lines) -> Array:
    """Many numbers at once, (n,); `numbers` are their line numbers.

    Raises
    ------
    InputError : one of them is not a finite number; names its line.
    """
    joined = "\n".join(texts).replace("D", "e").replace("d", "e")
    plain = "_" not in joined
    try:
        values = np.array([float(text) for text in joined.split("\n")] if texts else [])
    except ValueError:
        plain = False
    if plain and np.isfinite(values).all():
        return values
    pairs = zip(texts, numbers, strict=True)
    return np.array([real(text, lines, number) for text, number in pairs])


def real(text: str, lines: Lines, number: int | None = None) -> float:
    """One number; the exponent letter may be D, E or missing (Fortran's 1.0-100).

    Raises
    ------
    InputError : it is not a number, or not finite.
    """
    match = _NUMBER.fullmatch(text.strip())
    if match is None:
        problem = f"'{short(text)}' is not a number"
        raise lines.error(problem, REAL_EXPECTED, number)
    value = float(f"{match[1]}e{match[2] or match[3] or 0}")
    if not np.isfinite(value):
        problem = f"{short(text)} is too large for a floating-point number"
        raise lines.error(problem, REAL_EXPECTED, number)
    return value


def integer(text: str, name: str, lines: Lines) -> int:
    """One integer that is not negative.

    Raises
    ------
    InputError : it is something else.
    """
    value = int(text) if _INTEGER.fullmatch(text) else -1
    if value < 0:
        raise lines.error(f"{name} = '{short(text)}'", "a small integer, not negative")
    return value


def short(text: str) -> str:
    """A text cut to fit into a message."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:57]}..."
