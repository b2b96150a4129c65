"""Tables: records of arrays that kernels read through one pointer.

A table has the same attributes in Python and in compiled code. There it is one
address, however many arrays it holds, so that calls are cheap to make and to compile.
In memory it is a row of 64-bit words: for an array the address of its data and its
shape, for a kernel or another table its address.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NoReturn, Self

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import lower_getattr_generic, register_model

from .records import RowsType, constant_word
from .views import PointerType, ViewType, array_words, make_view

_WORD = ir.IntType(64)
#: Bytes of which the addresses of arrays that are made together are multiples.
ALIGNED = 64


class TableType(types.Type):
    """The compiled type of a subclass of `Table`.

    members : types of its fields; None stands for the table type itself
    name : of what kernels see a table as, which is compiled in their place
    """

    def __init__(self, owner: type[Table], members: list[Any], name: str = "") -> None:
        self.fields = tuple(owner.__annotations__ or owner.__mro__[1].__annotations__)
        super().__init__(f"{owner.__module__}.{owner.__qualname__}{name}")
        self.members = {
            field: self if kind is None else kind
            for field, kind in zip(self.fields, members, strict=True)
        }
        self.offsets: dict[str, int] = {}
        words = 0
        for field, kind in self.members.items():
            self.offsets[field] = words
            words += 1 + (kind.ndim if isinstance(kind, ViewType | RowsType) else 0)
        self.words = words
        self.owner, self.seen_as = owner, name
        if not name:
            owner.kind, owner.kinds = self, {}
        owner.kinds[name] = self

    def write(self, memory: np.ndarray, field: str, value: Any) -> None:
        """Puts a value where kernels find it, into the words of a table."""
        kind, start = self.members[field], self.offsets[field]
        if isinstance(kind, ViewType):
            memory[start : start + 1 + kind.ndim] = array_words(kind, value)
        else:
            memory[start] = _address(kind, value)

    def seen(self, name: str, **members: Any) -> TableType:
        """The same table with other types of some fields."""
        kinds = {field: None if k is self else k for field, k in self.members.items()}
        return TableType(self.owner, [*(kinds | members).values()], name)

    def checked(self, table: Any) -> Table:
        """A table that is of this type.

        Raises TypeError where it is not.
        """
        if type(table) is not self.owner:
            raise TypeError(f"not a {self.owner.__name__}: {table!r}")
        return table  # type: ignore[no-any-return]

    def __reduce__(self) -> Any:
        return _kind_of, (self.owner, self.seen_as)


def _places(kind: TableType, shapes: Mapping[str, tuple[int, ...]]) -> Any:
    """Where arrays of some fields lie one after the other.

    Shape, type and place of each by its field; which words are addresses, and the
    words where the first array is at 0; the bytes of all.
    """
    views: dict[str, tuple[tuple[int, ...], np.dtype[Any], int]] = {}
    addresses, words = np.zeros((2, kind.words), np.int64)
    size = 0
    for field, shape in shapes.items():
        member: Any = kind.members[field]
        word = kind.offsets[field]
        if len(shape) != member.ndim:
            raise TypeError(f"not the shape of {member}: {shape}")
        views[field] = shape, member.numbers, size
        addresses[word] = 1
        words[word : word + 1 + member.ndim] = size, *shape
        bytes_ = member.numbers.itemsize * math.prod(shape)
        size += -(-bytes_ // ALIGNED) * ALIGNED
    return views, addresses, words, size


def _address_of(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


def _kind_of(owner: type[Table], name: str) -> TableType:
    return owner.kinds[name]


def _address(kind: Any, value: Any) -> int:
    """Of a table or a kernel."""
    if value is None:
        return 0
    if isinstance(kind, PointerType) and value.signature != kind.signature:
        raise TypeError(f"not a {kind}: {value.signature}")
    return int(value.address)


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
        fields = dict(zip(self.kind.fields, values, strict=True))
        self._set(fields, np.zeros(self.kind.words, np.int64))

    @classmethod
    def zeros(cls, *values: Any) -> Self:
        """A table of zeros, see `maker`."""
        return cls.maker(*values)()

    @classmethod
    def maker(cls, *values: Any) -> Callable[[], Self]:
        """Makes tables of zeros: one after the other in memory, made at once.

        values : of the fields in their order; tuples are shapes of arrays of zeros,
            and makers make a table of their own for each
        """
        fields = dict(zip(cls.kind.fields, values, strict=True))
        makers = {f: value for f, value in fields.items() if callable(value)}
        shapes = {f: value for f, value in fields.items() if type(value) is tuple}
        others = {f: fields[f] for f in fields.keys() - makers.keys() - shapes.keys()}
        views, inside, known, size = _places(cls.kind, shapes)
        for field, value in others.items():
            cls.kind.write(known, field, value)

        def make() -> Any:
            memory = np.zeros(size + ALIGNED, np.uint8)
            base = _address_of(memory)
            gap = -base % ALIGNED
            table = cls.__new__(cls)
            table.__dict__.update(others, _views=views, _zeros=memory[gap:])
            tables = {field: made() for field, made in makers.items()}
            table._set(tables, known + (base + gap) * inside)
            return table

        return make

    def _set(self, fields: Mapping[str, Any], words: np.ndarray) -> None:
        """Takes the values of some fields; words of the others are known."""
        for field, value in fields.items():
            self.kind.write(words, field, value)
        self.__dict__.update(fields, _memory=words, address=_address_of(words))

    def __getattr__(self, name: str) -> np.ndarray:
        """An array of zeros that nobody asked for before."""
        views = self.__dict__.get("_views", {})
        if name not in views:
            raise AttributeError(f"{type(self).__name__} has no {name}")
        shape, kind, start = views[name]
        view = np.ndarray(shape, kind, self._zeros, start)
        return self.__dict__.setdefault(name, view)

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise AttributeError(f"a table does not change: {name}; see `replaced`")

    def __reduce__(self) -> Any:
        """Copies have an address of their own."""
        return type(self), tuple(getattr(self, field) for field in self.kind.fields)

    def replaced(self, **changes: Any) -> Self:
        """The same table with other values of some fields."""
        twin = type(self).__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._set(changes, self._memory.copy())
        return twin


@register_model(TableType)
class _TableModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: TableType) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


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
    if isinstance(member, PointerType):
        return address
    kind_of_entry = context.get_data_type(member.dtype).as_pointer()
    extents = [constant_word(builder, words, start + 1 + i) for i in range(member.ndim)]
    data = builder.inttoptr(address, kind_of_entry)
    return make_view(context, member, builder, [data, *extents])
