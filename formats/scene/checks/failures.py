"""How a check of a scene fails: with the key, what was found and what was expected."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import NoReturn

from ...errors import InputError


def fail(place: str, problem: str, expected: str | None = None) -> NoReturn:
    """Raise what was found wrong at a key."""
    raise InputError(problem, place=place, expected=expected)


def known_names(name: str, known: Iterable[str], what: str) -> str:
    """What to expect instead of an unknown name: the nearest one, or the list."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1)
    if near:
        return f"an existing {what}, perhaps {near[0]}"
    listed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    return f"an existing {what}, one of {listed}" if names else f"an existing {what}"
