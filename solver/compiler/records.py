"""Records: rows of tables whose numbers have names.

A kernel sees a table in plane or in space (`RowsType`): ``work.point[m].x`` loads a
`Vector`, ``work.point[m].x = ...`` stores one. A record is an address only.
"""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .types import KernelType, float64, int64
from .vectors import ValueType


class RecordType(KernelType):
    """Numbers behind each other in memory, with names.

    Attributes
    ----------
    fields
        Float64 or values; or int64, all of them, which kernels only read.
    size
        Of a row, in numbers.
    """

    def __init__(self, name: str, **fields: Any) -> None:
        self.fields, self.size = fields, 0
        self.places: dict[str, int] = {}
        for field, kind in fields.items():
            self.places[field] = self.size
            self.size += kind.size if isinstance(kind, ValueType) else 1
        whole = int64 in fields.values()
        self.number = int64 if whole else float64
        super().__init__(name)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """What numpy sees rows as."""
        number = str(self.number)
        return np.dtype(
            [
                (field, number, (kind.size,) if isinstance(kind, ValueType) else ())
                for field, kind in self.fields.items()
            ]
        )

    def as_records(self, values: NDArray[Any]) -> NDArray[np.void]:
        """Numbers (..., size) seen as rows with names, (...)."""
        return values.view(self.dtype)[..., 0]


class RowsType(KernelType):
    """A table of records."""

    def __init__(self, record: RecordType, ndim: int = 2) -> None:
        self.record, self.ndim = record, ndim
        self.numbers = np.dtype(str(record.number))
        super().__init__(f"rows of {record} in {ndim} dimensions")
