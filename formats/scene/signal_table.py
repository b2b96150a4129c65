"""Tables of a scene whose values over time may come from a file."""

from typing import Any, Self

from pydantic import ModelWrapValidatorHandler, PrivateAttr, model_validator

from .base import Table
from .signal_files import SIGNAL_KEYS, signal_and_unit


class SignalTable(Table):
    """A table with the keys `times` and `values`, or `file` and its columns."""

    #: what the file states of its values
    _unit_of_file: str = PrivateAttr(default="")

    @model_validator(mode="wrap")
    @classmethod
    def _read_file(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Return the table's data with the columns of its file."""
        data, unit = signal_and_unit(data, SIGNAL_KEYS)
        table = handler(data)
        if unit:
            table._unit_of_file = unit
        return table

    def __eq__(self, other: object) -> bool:
        """Whether numbers are equal, whether they came from a file or not."""
        return type(self) is type(other) and vars(self) == vars(other)

    @property
    def unit_of_file(self) -> str:
        """The unit that its file states, or ""."""
        return self._unit_of_file
