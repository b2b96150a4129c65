"""The table [diagnostics] of scenes and models."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, Self, TypeVar

from pydantic import field_validator

from ..diagnostics.catalogue import find_code
from .constructor_types import Field, Takes
from .tables import Table


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
