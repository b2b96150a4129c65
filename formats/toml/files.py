"""Scenes and models as files: tables with formulas, a folder, and changes by key.

The table [diagnostics] of scenes and models.
"""

import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeVar

from pydantic import PrivateAttr, field_validator

from ..base.errors import InputError
from ..diagnostics.record import find_code
from ..storage.atomic import atomic_path
from ..storage.operating_system import path_from
from .expressions import evaluate_number
from .messages import nearest_key
from .reading import PARAMETERS, TABLES, Formulas, read_data, with_formulas
from .tables import Field, Table, Takes, named_object, to_plain, toml_text

_PART = re.compile(r"\.?([^.\[\]]+)|\[([0-9]+)\]")


class Diagnostics(Table):
    """Which diagnostics are not reported."""

    ignore: Takes[tuple[str, ...], Sequence[str]] = Field(
        default=(),
        description='codes of warnings and notes that are not reported, such as "N420" '
        "(`sidtool explain N420`); errors cannot be ignored",
    )

    @field_validator("ignore")
    @classmethod
    def _are_codes(cls, codes: tuple[str, ...]) -> tuple[str, ...]:
        try:
            return tuple(map(find_code, codes))
        except KeyError as error:
            raise ValueError(
                f"codes that `sidtool explain` lists; {error} is none of them"
            ) from None


class HasDiagnosticsTable(Protocol):
    """A file with a table [diagnostics]."""

    @property
    def diagnostics(self) -> Diagnostics: ...

    def model_copy(self, *, update: Mapping[str, Any]) -> Self: ...


Kind = TypeVar("Kind", bound=HasDiagnosticsTable)


def ignoring(file: Kind, codes: Iterable[str]) -> Kind:
    """Return a file that does not report diagnostics of these codes either."""
    both = (*file.diagnostics.ignore, *codes)
    table = file.diagnostics.model_copy(update={"ignore": both})
    return file.model_copy(update={"diagnostics": table})


class File(Table):
    """Content of a TOML or JSON file; `said` and `save` retain its formulas."""

    is_file: ClassVar[bool] = True
    #: tables whose entries may be named alone in changes: `crank.mass`
    named: ClassVar[tuple[str, ...]] = (PARAMETERS,)
    #: keys of one table that say the same in two ways: changes of one replace the other
    either: ClassVar[tuple[tuple[str, str], ...]] = ()
    #: places of paths of other files, `*` for any key
    paths: ClassVar[tuple[tuple[str, ...], ...]] = ()
    _formulas: Formulas = PrivateAttr(default_factory=dict)
    _source: Path | None = PrivateAttr(default=None)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.__dict__ == other.__dict__

    @property
    def folder(self) -> Path:
        """Folder of relative paths: that of the file, or the working folder."""
        return Path(".") if self._source is None else self._source.parent

    @property
    def source(self) -> Path | None:
        """The file that it came from."""
        return self._source

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], changes: Mapping[str, Any] | None = None
    ) -> Self:
        """Read a file (TOML, or JSON by its ending), with `changes` as in `with_`.

        Raises
        ------
        InputError : names the file, the key, what was found and what was expected.
        """
        path = Path(path)
        data = read_data(path)
        try:
            data = with_changes(data, changes or {}, cls)
        except InputError as error:
            raise error.located(path) from None
        return cls._read(data, path)

    @classmethod
    def _read(cls, data: dict[str, Any], path: Path) -> Self:
        content = cls.checked(data, path)
        content._source = path
        return content

    @classmethod
    def checked(cls, data: Mapping[str, Any], source: str | os.PathLike[str]) -> Self:
        content, formulas = with_formulas(data, cls, os.fspath(source))
        content._formulas = formulas
        return content

    def with_(self, changes: Mapping[str, Any] | None = None, **more: Any) -> Self:
        """Return the content with other values, checked again.

        Keys are those of the file with dots between them; entries of tables with names
        can be given by these alone: `scene.with_({"crank.mass": 0.4, "time.end":
        1.0})`, `scene.with_({"parameters.n": 8})`. Formulas follow the parameters.

        Raises
        ------
        InputError : there is no such key, or the value does not fit.
        """
        data = with_changes(self.file_data(), {**(changes or {}), **more}, type(self))
        content = self.checked(data, type(self).__name__)
        content._source = self._source
        return content

    def file_data(self) -> dict[str, Any]:
        """Return the explicit content as in the file, with formulas that are still
        valid.
        """
        data = super().file_data()
        numbers = dict(data.get(PARAMETERS, {}))
        tables = getattr(self, TABLES, {})
        for place, text in self._formulas.items():
            try:
                table: Any = _value_at(data, place[:-1])
                value = evaluate_number(text, numbers, tables)
                holds = table[place[-1]] in (value, [value])
            except (InputError, LookupError, TypeError):
                continue  # somebody has changed what it stood for
            if holds:
                table[place[-1]] = text
        return data

    def reads_parameter(self, name: str) -> bool:
        """Whether a formula contains the name of a parameter."""
        return name not in self.unread_names([name])

    def unread_names(self, names: Iterable[str]) -> list[str]:
        """Return the names of parameters and tables that no formula contains."""
        left = unread_names(names, list(self._formulas.values()))
        return unread_names(left, self.file_data()) if left else []

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a TOML file; relative paths in it begin at its folder.

        Raises
        ------
        InputError, OSError : the ending is not .toml, or it cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".toml":
            raise InputError("is no TOML file", source=path, expected="NAME.toml")
        data = self.file_data()
        _refuse_objects(data, "")
        for place in self.paths:
            relocate_paths(data, place, self.folder, path.parent)
        with atomic_path(path) as temporary:
            temporary.write_text(toml_text(data), encoding="utf-8")


def unread_names(names: Iterable[str], data: Any) -> list[str]:
    """Return the names that no text in plain data contains."""
    text = "\n".join(_texts_in(data))
    return [
        name
        for name in names
        if not re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", text)
    ]


def _texts_in(data: Any) -> Iterator[str]:
    """Yield all texts in plain data."""
    waiting = [data]
    while waiting:
        part = waiting.pop()
        if isinstance(part, str):
            yield part
        elif isinstance(part, dict):
            waiting += part.values()
        elif isinstance(part, list):
            waiting += part


def _refuse_objects(data: Any, place: str) -> None:
    """Refuse a text that refers to a Python object."""
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(data, dict):
        parts = data.items()
    elif isinstance(data, list):
        parts = enumerate(data)
    for key, part in parts:
        _refuse_objects(part, f"{place}.{key}".lstrip("."))
    if isinstance(data, str) and named_object(data) is not None:
        raise InputError(
            "was given as an object, which no file holds",
            place=place,
            expected="the name of a file, written by sidtool.write or Model.save",
        )


@contextmanager
def locate_errors(content: File) -> Iterator[None]:
    """Input errors inside name the file that a scene or model came from."""
    try:
        yield
    except InputError as error:
        if content.source is None:
            raise
        raise error.located(content.source) from None


def parse_settings(texts: Iterable[str], option: str = "--set") -> dict[str, Any]:
    """The changes that KEY=VALUE on the command line ask for, values as in TOML; what
    is none is a text, as a formula or a name.

    Raises
    ------
    InputError : a text has another form.
    """
    changes = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key.strip() and equals and value.strip()):
            raise InputError(
                f"found {text!r}", place=option, expected="KEY=VALUE, as in time.end=2"
            )
        try:
            changes[key.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            changes[key.strip()] = value.strip()
    return changes


def with_changes(
    data: Mapping[str, Any], changes: Mapping[str, Any], file: type[File]
) -> dict[str, Any]:
    """The data of a file with other values at dotted keys, see `File.with_`."""
    data = to_plain(data)
    for key, value in changes.items():
        place = key_path(key, data, file)
        set_at(data, place, value, key)
        for other in _equivalent_keys(file, place):
            if not any(key_path(k, data, file) == other for k in changes):
                _value_at(data, other[:-1]).pop(other[-1], None)
    return dict(data)


def _equivalent_keys(file: type[File], place: list[str | int]) -> list[list[str | int]]:
    """Return the places of keys that are equivalent to a key."""
    *parents, last = place
    pairs = [pair for pair in file.either if last in pair]
    return [[*parents, other] for pair in pairs for other in pair if other != last]


def set_at(table: Any, place: list[str | int], value: Any, key: str) -> None:
    """Puts a value at a place in tables and lists.

    Raises
    ------
    InputError : there is no such place.
    """
    *parents, last = place
    for part in parents:
        table = _enter(table, part, key)
    _enter(table, last, key)
    table[last] = to_plain(value)


def key_path(key: str, data: Mapping[str, Any], file: type[File]) -> list[str | int]:
    """The parts of a key, from the top of the file.

    data : of the file, at least the names in its tables with names

    Raises
    ------
    InputError : it has another form, or nothing has this name.
    """
    parts: list[str | int] = []
    at = 0
    while at < len(key):
        match = _PART.match(key, at)
        if match is None:
            raise InputError(f"{key!r} is no key", expected="one such as time.end")
        parts.append(match[1] or int(match[2]))
        at = match.end()
    if not parts or not isinstance(parts[0], str):
        raise InputError(f"{key!r} is no key", expected="one such as time.end")
    first = parts[0]
    if first in file.model_fields:
        return parts
    homes = [table for table in file.named if first in data.get(table, {})]
    if len(homes) == 1:
        return [homes[0], *parts]
    if homes:
        full_keys = " or ".join(f"{owner}.{key}" for owner in homes)
        raise InputError(
            f"{first!r} is the name of several", place=key, expected=full_keys
        )
    known = [
        *file.model_fields,
        *(n for table in file.named for n in data.get(table, {})),
    ]
    raise InputError(
        f"there is nothing named {first!r}",
        place=key,
        expected=nearest_key(first, known),
    )


def _enter(table: Any, part: str | int, key: str) -> Any:
    if isinstance(table, dict) and isinstance(part, str):
        return table.setdefault(part, {})
    if isinstance(table, list) and isinstance(part, int) and part < len(table):
        return table[part]
    raise InputError("is not there", place=key, expected="a key of the file")


def _value_at(data: Any, place: Iterable[str | int]) -> Any:
    for part in place:
        data = data[part]
    return data


def relocate_paths(data: Any, place: tuple[str, ...], old: Path, new: Path) -> None:
    """Rewrites relative paths at a place, `*` for any key, so that they name the same
    files from another folder."""
    first, *inner_keys = place
    if not isinstance(data, dict) or old == new:
        return
    for key in data if first == "*" else [first] if first in data else []:
        if inner_keys:
            relocate_paths(data[key], tuple(inner_keys), old, new)
        elif isinstance(data[key], str):
            target = old / data[key]
            stays = target.is_absolute() or new == Path(".")
            data[key] = str(target) if stays else path_from(new, target)
