"""Tables of files as typed Python objects, and their text in TOML.

One class states what a file may hold and what its constructor takes:

    Revolute(markers=["ground.bearing", "crank.bearing"])

is what ``{type = "revolute", markers = [...]}`` is in TOML, checked in the same way.

Types of fields whose constructor takes more than they hold.

`mass: Number` holds a float and takes a formula, too. Checkers of types see a
descriptor: what is read has the first type, what a constructor takes the second one
("descriptor-typed fields" of `typing.dataclass_transform`). When a program runs, a
field has the first type alone.

Python objects in places where files name other files.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from inspect import Signature
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Generic,
    Self,
    TypeVar,
    dataclass_transform,
)

import numpy as np
import pydantic
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict

from ..base.sid import SID
from .reading import required_keys, validate_data

Kept = TypeVar("Kept")
Taken = TypeVar("Taken")

if TYPE_CHECKING:

    class Takes(Generic[Kept, Taken]):
        """A field that holds the first type and takes the second one."""

        def __get__(self, instance: object, owner: Any = None) -> Kept: ...
        def __set__(self, instance: object, value: Taken) -> None: ...

    def Field(default: Any = ..., **more: Any) -> Any:
        """Return the `Field` of pydantic, for a default of the type that the field
        holds.
        """

else:
    Field = pydantic.Field

    class Takes:
        """A field that holds the first type and takes the second one."""

        def __class_getitem__(cls, types: tuple[Any, Any]) -> Any:
            return types[0]


#: Any table may be given as a dictionary.
Entries = Mapping[str, Any]
Number = Takes[float, float | str]
OptionalNumber = Takes[float | None, float | str | None]
Integer = Takes[int, int | str]
OptionalInteger = Takes[int | None, int | str | None]
Texts = Takes[tuple[str, ...], Sequence[str]]
OptionalTexts = Takes[tuple[str, ...] | None, Sequence[str] | None]
TwoTexts = Takes[tuple[str, str], Sequence[str]]
OptionalTwoTexts = Takes[tuple[str, str] | None, Sequence[str] | None]
Numbers = Takes[tuple[float, ...], ArrayLike]
OptionalNumbers = Takes[tuple[float, ...] | None, ArrayLike | None]
OptionalTwoNumbers = Takes[tuple[float, float] | None, ArrayLike | None]


#: Objects by their texts, as long as the process runs: scenes hold texts alone.
_OBJECTS: dict[str, Any] = {}

_BARE = re.compile(r"[A-Za-z0-9_-]+")
#: Width of a line; longer lists have one entry per line.
WIDTH = 88
#: Tables in each other that get a header of their own, such as [bodies.rod].
HEADERS = 2


def name_object(value: Any) -> str:
    """Return the text that refers to an object, the same one each time."""
    for text, known in _OBJECTS.items():
        if known is value:
            return text
    text = f"(object {len(_OBJECTS) + 1} of a program)"
    _OBJECTS[text] = value
    return text


def named_object(text: str | None) -> Any:
    """Return the object that a text refers to; None for the name of a file."""
    return None if text is None else _OBJECTS.get(text)


if TYPE_CHECKING:

    @dataclass_transform(kw_only_default=True, field_specifiers=(Field,))
    class _Checked(BaseModel):
        pass

else:

    class _Constructor(type(BaseModel)):
        """Calling a class checks its arguments as the entries of a file are checked."""

        def __call__(cls, **given: Any) -> Any:
            return cls.checked(required_keys(cls) | to_plain(given), cls.__name__)

    class _Checked(BaseModel, metaclass=_Constructor):
        pass


def _require_tags(schema: dict[str, Any], model: type[BaseModel]) -> None:
    """Require tags in files, which Python expresses by the class name."""
    for name in required_keys(model):
        schema["properties"][name].pop("default", None)
        schema["required"] = list(dict.fromkeys([name, *schema.get("required", [])]))


def _derived_from(kind: type[Table]) -> Iterator[type[Table]]:
    for one in kind.__subclasses__():
        yield one
        yield from _derived_from(one)


class _DeferredSignature:
    """Signature of a table, which is built when somebody asks for its keys."""

    def __get__(self, table: Table | None, kind: type[Table]) -> Signature:
        kind.model_rebuild()  # replaces this one
        return kind.__signature__


class Table(_Checked):
    """A frozen table of a file: unknown keys and infinite numbers are errors.

    Takes lists, tuples and NumPy arrays alike, and formulas of numbers ("2*pi") where
    a number is expected.

    Raises
    ------
    InputError : names the argument, what was found and what was expected.
    """

    model_config = ConfigDict(
        extra="forbid",
        defer_build=True,
        frozen=True,
        allow_inf_nan=False,
        populate_by_name=True,
        json_schema_extra=_require_tags,
    )

    #: whether it is a whole file, and no table of one
    is_file: ClassVar[bool] = False

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        super().__pydantic_init_subclass__(**options)
        if not cls.__pydantic_complete__:
            cls.__signature__ = _DeferredSignature()  # type: ignore[assignment]

    @classmethod
    def model_json_schema(cls, *arguments: Any, **options: Any) -> dict[str, Any]:
        """JSON Schema, which writes defaults by what is else built on first use."""
        for kind in _derived_from(Table):
            kind.model_rebuild(raise_errors=False)
        return super().model_json_schema(*arguments, **options)

    @classmethod
    def checked(cls, data: Mapping[str, Any], source: str | os.PathLike[str]) -> Self:
        """The table of data as TOML holds them; errors name the source."""
        return validate_data(data, cls, source=os.fspath(source))

    def file_data(self) -> dict[str, Any]:
        """Return the explicit content as TOML holds it: no defaults, tables
        and lists.
        """
        fields = type(self).model_fields
        kinds = required_keys(type(self))
        given = [n for n in fields if n in self.model_fields_set]
        return {
            fields[name].alias or name: to_plain(getattr(self, name))
            for name in sorted(given, key=lambda name: name not in kinds)
            if getattr(self, name) is not None
        }


def to_plain(value: Any) -> Any:
    """Convert tables, arrays and paths to the tables, lists, numbers and texts of a
    file.

    A text refers to a SID, a result and to a whole file, see `objects`.
    """
    if isinstance(value, SID) or getattr(value, "is_file", False) is True:
        return name_object(value)
    if isinstance(value, Table):
        return value.file_data()
    if isinstance(value, Mapping):
        return {str(key): to_plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_plain(value.tolist())
    if isinstance(value, list | tuple | range):
        return [to_plain(part) for part in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def toml_text(data: Mapping[str, Any]) -> str:
    """A file with these entries, in their order; tables follow plain values."""
    return "\n\n".join(_table_lines(data, ())) + "\n"


def _table_lines(data: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    inner = {k: v for k, v in data.items() if len(path) < HEADERS and _is_table(v)}
    lines = [
        f"{_format_key(k)} = {_format_value(v)}"
        for k, v in data.items()
        if k not in inner
    ]
    if path and (lines or not inner):
        lines.insert(0, f"[{'.'.join(map(_format_key, path))}]")
    texts = ["\n".join(lines)] if lines else []
    for key, table in inner.items():
        texts += _table_lines(table, (*path, key))
    return texts


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _format_key(text: str) -> str:
    return text if _BARE.fullmatch(text) else _format_text(text)


def _format_value(value: Any, indent: str = "") -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        entries = (
            f"{_format_key(k)} = {_format_value(v, indent)}" for k, v in value.items()
        )
        return f"{{{', '.join(entries)}}}"
    if isinstance(value, list | tuple):
        line = f"[{', '.join(_format_value(part, indent) for part in value)}]"
        if len(line) + len(indent) <= WIDTH - 20 or not value:
            return line
        more = indent + "    "
        parts = "".join(f"{more}{_format_value(part, more)},\n" for part in value)
        return f"[\n{parts}{indent}]"
    return _format_text(value) if isinstance(value, str) else repr(value)


def _format_text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
