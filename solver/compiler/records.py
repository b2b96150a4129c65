"""Records: rows of tables whose numbers have names.

A kernel sees a table in plane or in space (`RowsType`): ``work.point[m].x`` loads a
`Vector`, ``work.point[m].x = ...`` stores one. A record is an address only.
"""

import operator
from functools import cached_property
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import (
    lower_builtin,
    lower_getattr_generic,
    lower_setattr_generic,
    models,
    register_model,
)
from numpy.typing import NDArray

from .arrays import check_index
from .vectors import INDEX, REAL, ValueType


class RecordType(types.Type):
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
        whole = types.int64 in fields.values()
        self.number = INDEX if whole else REAL
        super().__init__(name)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """What numpy sees rows as."""
        number = np.int64 if self.number is INDEX else np.float64
        return np.dtype(
            [
                (field, number, (kind.size,) if isinstance(kind, ValueType) else ())
                for field, kind in self.fields.items()
            ]
        )

    def as_records(self, values: NDArray[Any]) -> NDArray[np.void]:
        """Numbers (..., size) seen as rows with names, (...)."""
        return values.view(self.dtype)[..., 0]


class RowsType(types.Type):
    """A table of records."""

    def __init__(self, record: RecordType, ndim: int = 2) -> None:
        self.record, self.ndim = record, ndim
        self.numbers = np.dtype(np.int64 if record.number is INDEX else np.float64)
        super().__init__(f"rows of {record} in {ndim} dimensions")


for _kind in (RecordType, RowsType):

    @register_model(_kind)
    class _RecordAddressModel(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            number = kind.number if isinstance(kind, RecordType) else INDEX
            super().__init__(manager, kind, number.as_pointer())


@infer_getattr
class _FieldOfRecord(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, kind: RecordType, field: str) -> Any:  # type: ignore[override]
        return kind.fields.get(field)


def _field_address(
    builder: Any, kind: RecordType, record: Any, field: str, i: int = 0
) -> Any:
    offset = ir.Constant(INDEX, kind.places[field] + i)
    return builder.gep(record, [offset], inbounds=True)


@lower_getattr_generic(RecordType)
def _get_field(context: Any, builder: Any, kind: Any, record: Any, field: str) -> Any:
    member = kind.fields[field]
    if not isinstance(member, ValueType):
        loaded = builder.load(_field_address(builder, kind, record, field))
        return _mark_invariant(builder, loaded) if kind.number is INDEX else loaded
    value = ir.Constant(context.get_value_type(member), ir.Undefined)
    for i in range(member.size):
        loaded = builder.load(_field_address(builder, kind, record, field, i))
        value = builder.insert_value(value, loaded, i)
    return value


@lower_setattr_generic(RecordType)
def _set_field(context: Any, builder: Any, sig: Any, args: Any, field: str) -> None:
    kind, member = sig.args[0], sig.args[0].fields[field]
    record, value = args
    value = context.cast(builder, value, sig.args[1], member)
    if not isinstance(member, ValueType):
        builder.store(value, _field_address(builder, kind, record, field))
        return
    for i in range(member.size):
        number = builder.extract_value(value, i)
        builder.store(number, _field_address(builder, kind, record, field, i))


@infer_global(operator.getitem)
class _RowOfTable(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        rows, index = args
        if isinstance(rows, RowsType) and isinstance(index, types.Integer):
            return signature(rows.record, rows, index)
        return None


@lower_builtin(operator.getitem, RowsType, types.Integer)
def _get_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    record = sig.args[0].record
    index = context.cast(builder, args[1], sig.args[1], types.int64)
    check_index(builder, index, load_invariant_word(builder, args[0], 1))
    offset = builder.mul(index, ir.Constant(INDEX, record.size))
    data = builder.inttoptr(
        load_invariant_word(builder, args[0], 0), record.number.as_pointer()
    )
    return builder.gep(data, [offset], inbounds=True)


@infer_global(len)
class _LengthOfTable(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], RowsType):
            return signature(types.intp, *args)
        return None


@lower_builtin(len, RowsType)
def _count_rows(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return load_invariant_word(builder, args[0], 1)


def load_invariant_word(builder: Any, words: Any, index: int) -> Any:
    """A word of a table; tables do not change."""
    return _mark_invariant(
        builder, builder.load(builder.gep(words, [ir.Constant(INDEX, index)]))
    )


def _mark_invariant(builder: Any, word: Any) -> Any:
    """Marks that kernels do not write there, so that it is read once."""
    word.set_metadata("invariant.load", builder.module.add_metadata([]))
    return word
