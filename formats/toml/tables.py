"""Tables of files as typed Python objects, and their text in TOML.

One class states what a file may hold and what its constructor takes:

    Revolute(markers=["ground.bearing", "crank.bearing"])

is what ``{type = "revolute", markers = [...]}`` is in TOML, checked in the same way.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self, dataclass_transform

import numpy as np
from pydantic import BaseModel, ConfigDict

from ..base.sid import SID
from .constructor_types import Field
from .evaluation import required_keys
from .objects import name_object
from .reading import validate_data

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
        frozen=True,
        allow_inf_nan=False,
        populate_by_name=True,
        json_schema_extra=_require_tags,
    )

    #: whether it is a whole file, and no table of one
    is_file: ClassVar[bool] = False

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


_BARE = re.compile(r"[A-Za-z0-9_-]+")
#: Width of a line; longer lists have one entry per line.
WIDTH = 88
#: Tables in each other that get a header of their own, such as [bodies.rod].
HEADERS = 2


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
