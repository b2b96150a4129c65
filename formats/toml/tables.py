"""Tables of files as typed objects of Python: one class says both what a file may hold
and what its constructor takes.

    Revolute(markers=["ground.bearing", "crank.bearing"])

is what ``{type = "revolute", markers = [...]}`` is in TOML, checked in the same way.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self, dataclass_transform

import numpy as np
from pydantic import BaseModel, ConfigDict

from ..sid import SID
from .constructor_types import Field
from .evaluation import tags
from .objects import name_object
from .reading import validated

if TYPE_CHECKING:

    @dataclass_transform(kw_only_default=True, field_specifiers=(Field,))
    class _Checked(BaseModel):
        pass

else:

    class _Constructor(type(BaseModel)):
        """Calling a class checks its arguments as the entries of a file are checked."""

        def __call__(cls, **given: Any) -> Any:
            return cls.checked(tags(cls) | plain(given), cls.__name__)

    class _Checked(BaseModel, metaclass=_Constructor):
        pass


def _require_tags(schema: dict[str, Any], model: type[BaseModel]) -> None:
    """Files have to say what Python says by the name of a class."""
    for name in tags(model):
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
        return validated(data, cls, source=os.fspath(source))

    def said(self) -> dict[str, Any]:
        """What was said, as TOML holds it: no defaults, tables and lists."""
        fields = type(self).model_fields
        kinds = tags(type(self))
        given = [n for n in fields if n in self.model_fields_set]
        return {
            fields[name].alias or name: plain(getattr(self, name))
            for name in sorted(given, key=lambda name: name not in kinds)
            if getattr(self, name) is not None
        }


def plain(value: Any) -> Any:
    """Tables, arrays and paths as the tables, lists, numbers and texts of a file.

    A text stands for a SID, a result and for a whole file, see `objects`.
    """
    if isinstance(value, SID) or getattr(value, "is_file", False) is True:
        return name_object(value)
    if isinstance(value, Table):
        return value.said()
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | range):
        return [plain(part) for part in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value
