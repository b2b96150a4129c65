"""Arguments of calls in Python that are files or what these hold."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InputError

if TYPE_CHECKING:
    from .scene import SceneFile


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


def scene_given(value: Any) -> SceneFile:
    """The scene that an argument is, or that its file holds.

    Raises
    ------
    InputError : it is neither, or the file is wrong.
    """
    from .scene import SceneFile, read_scene  # costs commands without one 0.2 s

    if isinstance(value, SceneFile):
        return value
    return read_scene(path_of(value, "scene", "a sidtool.Scene"))
