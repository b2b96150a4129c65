"""Arguments of calls in Python that name files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .errors import InputError


def path_of(value: Any, argument: str, instead: str = "") -> Path:
    """The path that an argument is.

    instead : what the argument may be beside the path of a file

    Raises
    ------
    InputError : it is none; names the argument.
    """
    try:
        return Path(value)
    except TypeError:
        raise InputError(
            f"is of the type {type(value).__name__}",
            place=argument,
            expected=f"{instead}, or the path of a file" if instead else "a path",
        ) from None
