"""Tables: records of arrays that kernels read through one pointer.

A table has the same attributes in Python and in compiled code. There it is one
address, however many arrays it holds, so that calls are cheap to make and to compile.
In memory it is a row of 64-bit words: for an array the address of its data and its
shape, for a kernel or another table its address.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, ClassVar, NoReturn, Self

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.extending import (
    NativeValue,
    lower_getattr_generic,
    register_model,
    typeof_impl,
    unbox,
)
from numba.core.typing.templates import AttributeTemplate, infer_getattr

from .compiler import ArrayValue
from .records import RowsType, constant_word

_WORD = ir.IntType(64)


class TableType(types.Type):
    """The compiled type of a subclass of `Table`.

    members : types of its fields; None stands for the table type itself
    name : of what kernels see a table as, which is compiled in their place
    """

    def __init__(self, owner: type[Table], members: list[Any], name: str = "") -> None:
        self.fields = tuple(owner.__annotations__)
        super().__init__(f"{owner.__module__}.{owner.__qualname__}{name}")
        self.members = {
            field: self if kind is None else kind
            for field, kind in zip(self.fields, members, strict=True)
        }
        self.offsets: dict[str, int] = {}
        #: what the fields hold that are arrays: numbers of a kind, along so many axes
        self.arrays: dict[str, tuple[np.dtype[Any], int]] = {}
        words = 0
        for field, kind in self.members.items():
            self.offsets[field] = words
            words += 1
            words += kind.ndim if isinstance(kind, types.Array | RowsType) else 0
            if isinstance(kind, types.Array):
                self.arrays[field] = np.dtype(str(kind.dtype)), kind.ndim
        self.words = words
        self.owner, self.seen_as = owner, name
        if not name:
            owner.kind, owner.kinds = self, {}
        owner.kinds[name] = self

    def write(self, memory: list[int], field: str, value: Any) -> None:
        """Puts a value where kernels find it, into the words of a table."""
        kind, start = self.members[field], self.offsets[field]
        if field not in self.arrays:
            memory[start] = _address(kind, value)
            return
        shape = value.shape
        fits = (value.dtype, len(shape)) == self.arrays[field]
        if not (fits and value.flags.c_contiguous):
            raise TypeError(f"not an array of {kind}: {value.dtype}, {shape}")
        memory[start] = value.__array_interface__["data"][0]
        memory[start + 1 : start + 1 + len(shape)] = shape

    def seen(self, name: str, **members: Any) -> TableType:
        """The same table with other types of some fields."""
        kinds = {field: None if k is self else k for field, k in self.members.items()}
        return TableType(self.owner, [*(kinds | members).values()], name)

    def __reduce__(self) -> Any:
        return _kind_of, (self.owner, self.seen_as)


def _kind_of(owner: type[Table], name: str) -> TableType:
    return owner.kinds[name]


def _address(kind: Any, value: Any) -> int:
    """Of a table or a kernel."""
    if value is None:
        return 0
    if isinstance(kind, TableType):
        return int(value.address)
    return int(value.__wrapper_address__())


class Table:
    """A record of arrays, kernels and tables; the fields are its annotations.

    The values of arrays may change, the fields may not.
    """

    kind: ClassVar[TableType]
    kinds: ClassVar[dict[str, TableType]]
    address: int
    _memory: np.ndarray

    def __init__(self, *values: Any, **named: Any) -> None:
        rest = (named.pop(field) for field in self.kind.fields[len(values) :])
        values = (*values, *rest)
        if named:
            raise TypeError(f"no fields of a table: {', '.join(named)}")
        self._set(
            dict(zip(self.kind.fields, values, strict=True)), [0] * self.kind.words
        )

    def _set(self, fields: Mapping[str, Any], words: list[int]) -> None:
        """Takes the values of some fields; words of the others are known."""
        for field, value in fields.items():
            self.kind.write(words, field, value)
        memory = np.array(words, np.int64)
        self.__dict__.update(fields, _memory=memory, address=memory.ctypes.data)

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise AttributeError(f"a table does not change: {name}; see `replaced`")

    def __reduce__(self) -> Any:
        """Copies have an address of their own."""
        return type(self), tuple(getattr(self, field) for field in self.kind.fields)

    def replaced(self, **changes: Any) -> Self:
        """The same table with other values of some fields."""
        twin = type(self).__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._set(changes, self._memory.tolist())
        return twin


class Pointer(types.WrapperAddressProtocol):
    """The address of a compiled function, as a field of a table."""

    def __init__(self, address: int, signature: Any) -> None:
        self._address, self._signature = address, signature

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        return self._signature


@typeof_impl.register(Table)
def _type_of(value: Table, context: Any) -> TableType:
    return value.kind


@register_model(TableType)
class _TableModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: TableType) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


@unbox(TableType)
def _unbox(kind: TableType, value: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_longlong(number)
    c.pyapi.decref(number)
    failed = cgutils.is_not_null(c.builder, c.pyapi.err_occurred())
    return NativeValue(c.builder.inttoptr(address, cgutils.voidptr_t), failed)


@infer_getattr
class _TableAttribute(AttributeTemplate):
    key = TableType

    def generic_resolve(self, kind: TableType, field: str) -> Any:  # type: ignore[override]
        return kind.members.get(field)


@lower_getattr_generic(TableType)
def _get_field(context: Any, builder: Any, kind: TableType, table: Any, field: str):  # type: ignore[no-untyped-def]
    member, start = kind.members[field], kind.offsets[field]
    words = builder.bitcast(table, _WORD.as_pointer())
    address = constant_word(builder, words, start)
    if isinstance(member, RowsType):
        return builder.gep(words, [ir.Constant(_WORD, start)])
    if isinstance(member, TableType):
        return builder.inttoptr(address, cgutils.voidptr_t)
    if isinstance(member, types.FunctionType):
        function = cgutils.create_struct_proxy(member)(context, builder)
        function.c_addr = builder.inttoptr(address, cgutils.voidptr_t)
        return function._getvalue()
    shape = [constant_word(builder, words, start + 1 + i) for i in range(member.ndim)]
    size = context.get_abi_sizeof(context.get_data_type(member.dtype))
    strides = [context.get_constant(types.intp, size)]
    for extent in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], extent))
    data = builder.inttoptr(address, context.get_data_type(member.dtype).as_pointer())
    array = ArrayValue(context, builder, member, None)
    array.data = data
    array.itemsize = strides[-1]
    array.nitems = functools.reduce(builder.mul, shape)
    array.shape = cgutils.pack_array(builder, shape)
    array.strides = cgutils.pack_array(builder, strides)
    return array._getvalue()
