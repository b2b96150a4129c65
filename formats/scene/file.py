"""Scene file: bodies, joints, drives, forces, time, accuracy and outputs.

`with_numbers` changes numbers of a scene without reading it again: only the parts that
change are checked, all others stay the same objects. Studies change one number after
the other; reading a whole scene costs milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from pydantic import model_validator

from ..base.errors import InputError
from ..toml.files import File, key_path
from ..toml.tables import to_plain
from .base import Table, as_tuples
from .laws import Expression, without_tables
from .scene_checks import check_scene
from .signal_files import SIGNAL_KEYS, relocate_signal_files, with_signal
from .tables import SceneTables
from .values import expected_names

Scene = TypeVar("Scene", bound="SceneFile")


class SceneFile(SceneTables):
    """A scene. Lengths, masses and times in SI units, angles in radians.

    Raises
    ------
    InputError : names that do not exist, wrong numbers of components, and so on.
    """

    def with_(self, changes: Mapping[str, Any] | None = None, **more: Any) -> Self:
        content = with_numbers(self, {**(changes or {}), **more})
        if content is not None:
            try:
                return content._with_consistent_parts(self)
            except (InputError, ValueError):
                pass  # reading the whole scene again finds what is wrong
        return super().with_(changes, **more)

    with_.__doc__ = File.with_.__doc__

    @classmethod
    def _read(cls, data: dict[str, Any], path: Path) -> Self:
        """The content; files of signals are found from the folder of the file."""
        relocate_signal_files(data, path.parent)
        return super()._read(data, path)

    @model_validator(mode="after")
    def _consistent(self) -> SceneFile:
        return self._with_consistent_parts()

    def _with_consistent_parts(self, fitting: SceneFile | None = None) -> Self:
        """The scene, whose parts are checked against each other; see `check_scene`."""
        for owner in (*self.forces.values(), *self.drives.values()):
            function = getattr(owner, "function", None)
            if isinstance(function, Expression):
                function.share(self.parameters, self.tables)
        check_scene(self, fitting)
        return self


def with_inputs(scene: Scene, inputs: Mapping[str, Any]) -> Scene:
    """The scene whose inputs follow other tables, or stay at other values.

    Parameters
    ----------
    inputs : by name times [s] and values, (nt,) each, or a number

    Raises
    ------
    InputError : an unknown name, or no such table.
    """
    changes: dict[str, Any] = {}
    for name, value in inputs.items():
        place = f"inputs.{name}"
        if name not in scene.inputs:
            expected = expected_names(name, scene.inputs, "input")
            raise InputError("there is no such input", place=place, expected=expected)
        if isinstance(value, int | float) and not isinstance(value, bool):
            changes |= without_tables({name: scene.inputs[name]})
            changes[f"{place}.initial"] = float(value)
            continue
        try:
            times, values = (np.asarray(part, float) for part in value)
        except (TypeError, ValueError):
            times = values = np.zeros((0, 0))
        if times.ndim != 1 or times.shape != values.shape:
            raise InputError(
                "is no table", place=place, expected="times and as many values, (nt,)"
            )
        changes[f"{place}.times"] = times.tolist()
        changes[f"{place}.values"] = values.tolist()
    return scene.with_(changes) if changes else scene


def read_input_table(
    path: str | Path, unit: str | None = None
) -> tuple[list[float], list[float]]:
    """Times [s] and values of an input from the first two columns of a file.

    Parameters
    ----------
    unit : of the input, to which values are converted, or of what takes it

    Raises
    ------
    InputError : see `with_signal`.
    """
    data = {"file": str(path), "unit": unit}
    data = with_signal(data, SIGNAL_KEYS, ())
    return list(data["times"]), list(data["values"])


def read_scene(path: str | Path, changes: Mapping[str, Any] | None = None) -> SceneFile:
    """Read a scene from TOML or JSON, with `changes` as in `SceneFile.with_`.

    Raises
    ------
    InputError : the file cannot be read or is not a valid scene.
    """
    return SceneFile.load(path, changes)


def with_numbers(scene: Scene, changes: Mapping[str, Any]) -> Scene | None:
    """The scene with other numbers in its parts, or other outputs, before it is
    checked as a whole.

    None where a change is of another kind, or no part of a scene takes it.
    """
    named_tables = {table: getattr(scene, table) for table in scene.named}
    tables: dict[str, Any] = {}
    for key, value in changes.items():
        value = to_plain(value)
        if not _holds_numbers(value) and key != "outputs.record":
            return None
        try:
            table, *inner_keys = key_path(key, named_tables, type(scene))
            table_value = tables.get(str(table), getattr(scene, str(table)))
            tables[str(table)] = _with_number(table_value, inner_keys, value)
        except (InputError, LookupError, TypeError, ValueError):
            return None
    return scene.model_copy(update=tables)


def _with_number(content: Any, place: list[Any], value: Any) -> Any:
    """A table of the scene, or a mapping of such tables by name, with another value."""
    key, *inner_keys = place
    if not isinstance(content, Table):
        return {**content, key: _with_number(content[key], inner_keys, value)}
    fields, set_fields = type(content).model_fields, content.model_fields_set
    data = {
        fields[name].alias or name: part
        for name, part in content
        if name in set_fields and part is not None
    }
    part = data[key] if key in data else getattr(content, key, None)
    data[key] = _with_nested_value(part, inner_keys, value)
    return type(content).model_validate(data, strict=True)


def _with_nested_value(part: Any, place: list[Any], value: Any) -> Any:
    """Return the content of a table with another value at a place inside."""
    if not place:
        return as_tuples(value)
    if isinstance(part, Table):
        return _with_number(part, place, value)
    key, *inner_keys = place
    inner = _with_nested_value(part[key], inner_keys, value)
    if isinstance(part, tuple):
        return (*part[:key], inner, *part[key + 1 :])
    return {**part, key: inner}


def _holds_numbers(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_holds_numbers, value))
    return type(value) in (int, float)
