"""Other numbers in a scene: only the part that has them is read again.

Studies change one number after the other. A whole scene read again costs milliseconds,
most of them for formulas and checks of parts that stay what they are; here these stay
the same objects, and what compiles the scene sees that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import InputError
from ..toml.files import place_of
from ..toml.tables import Table, plain
from .base import as_tuples

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
        value = plain(value)
        if not _is_of_numbers(value):
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
    key, *rest = place
    if not isinstance(whole, Table):
        return {**whole, key: _with_number(whole[key], rest, value)}
    fields, said = type(whole).model_fields, whole.model_fields_set
    data = {
        fields[name].alias or name: part
        for name, part in whole
        if name in said and part is not None
    }
    part = data[key] if key in data else getattr(whole, key, None)
    data[key] = _with_inner(part, rest, value)
    return type(whole).model_validate(data, strict=True)


def _with_inner(part: Any, place: list[Any], value: Any) -> Any:
    """What stands in a table, with another value at a place inside of it."""
    if not place:
        return as_tuples(value)
    if isinstance(part, Table):
        return _with_number(part, place, value)
    key, *rest = place
    inner = _with_inner(part[key], rest, value)
    if isinstance(part, tuple):
        return (*part[:key], inner, *part[key + 1 :])
    return {**part, key: inner}


def _is_of_numbers(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_is_of_numbers, value))
    return type(value) in (int, float)
