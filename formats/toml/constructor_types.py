"""Types of fields whose constructor takes more than they hold.

`mass: Number` holds a float and takes a formula, too. Checkers of types see a
descriptor: what is read has the first type, what a constructor takes the second one
("descriptor-typed fields" of `typing.dataclass_transform`). When a program runs, a
field has the first type alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import pydantic
from numpy.typing import ArrayLike

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
