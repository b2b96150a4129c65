"""Other numbers in a scene: only the part that has them is read again.

Studies change one number after the other. A whole scene read again costs milliseconds,
most of them for formulas and checks of parts that stay what they are; here these stay
the same objects, and what compiles the scene sees that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ..errors import InputError
from ..toml.files import place_of, put
from ..toml.tables import Table, plain

if TYPE_CHECKING:
    from .file import SceneFile

Scene = TypeVar("Scene", bound="SceneFile")


def with_numbers(scene: Scene, changes: Mapping[str, Any]) -> Scene | None:
    """The scene with other numbers in its parts, before it is checked as a whole.

    None where a change is of another kind, or no part of a scene takes it.
    """
    named = {table: getattr(scene, table) for table in scene.named}
    found: dict[str, Any] = {}
    for key, value in changes.items():
        if not _is_of_numbers(plain(value)):
            return None
        try:
            table, *rest = place_of(key, named, type(scene))
            whole = found.get(str(table), getattr(scene, str(table)))
            found[str(table)] = _with_number(whole, rest, value)
        except (InputError, LookupError, TypeError, ValueError):
            return None
    return scene.model_copy(update=found)


def _with_number(whole: Any, place: list[Any], value: Any) -> Any:
    """A table of the scene, or a mapping of such tables by name, with another value."""
    if isinstance(whole, Table) and place:
        data = whole.said()
        put(data, place, value, "")
        return type(whole).checked(data, "")
    name, *rest = place
    if not isinstance(whole, Mapping) or name not in whole:
        raise LookupError(name)
    return {**whole, name: _with_number(whole[name], rest, value)}


def _is_of_numbers(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_is_of_numbers, value))
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)
