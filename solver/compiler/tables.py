"""Tables: records of arrays that kernels receive as one pointer.

A table has the same attributes in Python and in compiled code. In memory it is a row of
64-bit words: of an array the address of its data and its shape, of a kernel or another
table its address; numbers are stored directly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, ClassVar, Self, get_type_hints

import numpy as np

from .arrays import PointerType, ViewType, address_of, array_words
from .records import RowsType
from .types import KernelType, float64, int64

_NUMBER_TYPES: dict[Any, Any] = {int: int64, float: float64}
_NUMBER_TYPE_LIST = [*_NUMBER_TYPES.values()]
#: Bytes of which the addresses of arrays that are made together are multiples.
ALIGNMENT = 64


class TableType(KernelType):
    """The compiled type of a subclass of `Table`.

    Attributes
    ----------
    name
        Of what kernels see a table as, which is compiled in their place.
    seen
        Types of fields that they see otherwise.
    """

    def __init__(self, owner: type[Table], name: str = "", **members: Any) -> None:
        super().__init__(f"{owner.__module__}.{owner.__qualname__}{name}")
        hints = get_type_hints(owner, include_extras=True)
        self.fields = tuple(owner.__annotations__)
        known = {field: self._member(owner, hints[field]) for field in self.fields}
        self.members = known | members
        self.scalars: dict[str, int] = {
            field: _NUMBER_TYPE_LIST.index(kind)
            for field, kind in self.members.items()
            if kind in _NUMBER_TYPE_LIST
        }
        self.offsets: dict[str, int] = {}
        words = 0
        for field, kind in self.members.items():
            self.offsets[field] = words
            words += 1 + (kind.ndim if isinstance(kind, ViewType | RowsType) else 0)
        self.words = words
        self.number_runs = _runs(sorted(self.offsets[field] for field in self.scalars))
        self.owner, self.variant = owner, name
        if not name:
            owner.kind, owner.kinds = self, {}
        owner.kinds[name] = self

    def _member(self, owner: type[Table], hint: Any) -> Any:
        """What kernels see of an annotation: a number, a table, or what it is annotated
        with.
        """
        if hasattr(hint, "__metadata__"):
            return hint.__metadata__[0]
        if hint is owner:
            return self
        return _NUMBER_TYPES.get(hint) or hint.kind

    def write(self, memory: np.ndarray, field: str, value: Any) -> None:
        """Puts a value where kernels find it, into the words of a table."""
        kind, start = self.members[field], self.offsets[field]
        if field in self.scalars:
            _as_numbers(memory)[self.scalars[field]][start] = value
        elif isinstance(kind, ViewType | RowsType):
            memory[start : start + 1 + kind.ndim] = array_words(kind, value)
        else:
            memory[start] = _address(kind, value)

    def with_field_types(self, name: str, **members: Any) -> TableType:
        """The same table with other types of some fields."""
        return TableType(self.owner, name, **members)

    def checked(self, table: Any) -> Table:
        """A table that is of this type.

        Raises TypeError where it is not.
        """
        if type(table) is not self.owner:
            raise TypeError(f"not a {self.owner.__name__}: {table!r}")
        return table  # type: ignore[no-any-return]

    def __reduce__(self) -> Any:
        return _table_type_of, (self.owner, self.variant)


def _runs(numbers: list[int]) -> list[tuple[int, int]]:
    """First and end of each run of growing numbers without a gap."""
    runs: list[tuple[int, int]] = []
    for n in numbers:
        if runs and runs[-1][1] == n:
            runs[-1] = runs[-1][0], n + 1
        else:
            runs.append((n, n + 1))
    return runs


def _as_numbers(words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The words of a table, seen as each of `_NUMBER_TYPES`."""
    return words, words.view(np.float64)


def _array_layout(kind: TableType, shapes: Mapping[str, tuple[int, ...]]) -> Any:
    """Where arrays of some fields lie in sequence.

    Shape, type and place of each by its field; which words are addresses, and the words
    where the first array is at 0; the bytes of all.
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
        size += -(-bytes_ // ALIGNMENT) * ALIGNMENT
    return views, addresses, words, size


def _check_names(kind: TableType, given: Mapping[str, Any]) -> None:
    """Raises TypeError where a field that is no number lacks, or one does not exist."""
    unexpected = ({*kind.members} ^ {*given}) - {*kind.scalars}
    if unexpected:
        raise TypeError(
            f"lacking or no fields of {kind}: {', '.join(sorted(unexpected))}"
        )


def _table_type_of(owner: type[Table], name: str) -> TableType:
    return owner.kinds[name]


def _address(kind: Any, value: Any) -> int:
    """Of a table or a kernel."""
    if value is None:
        return 0
    if isinstance(kind, PointerType) and value.signature != kind.signature:
        raise TypeError(f"not a {kind}: {value.signature}")
    return int(value.address)


class Table:
    """A record of arrays, kernels, tables and numbers; its fields are its annotations.

    Arrays and kernels are annotated with their compiled types, float and int are
    numbers. Numbers and the values of arrays may change, other fields may not.
    """

    kind: ClassVar[TableType]
    kinds: ClassVar[dict[str, TableType]]
    address: int
    _memory: np.ndarray
    _numbers: tuple[np.ndarray, np.ndarray]

    def __init__(self, **fields: Any) -> None:
        _check_names(self.kind, fields)
        self._set(fields, np.zeros(self.kind.words, np.int64))

    @classmethod
    def zeros(cls, **fields: Any) -> Self:
        """A table of zeros, see `maker`."""
        return cls.maker(**fields)()

    @classmethod
    def maker(cls, **fields: Any) -> Callable[[], Self]:
        """Makes tables of zeros: in sequence in memory, made at once.

        Parameters
        ----------
        fields
            Tuples are shapes of arrays of zeros, and makers make a table of their own
            for each; numbers are zero if they are not given.
        """
        _check_names(cls.kind, fields)
        makers = {f: value for f, value in fields.items() if callable(value)}
        shapes = {f: value for f, value in fields.items() if type(value) is tuple}
        others = {f: fields[f] for f in fields.keys() - makers.keys() - shapes.keys()}
        views, inside, known, size = _array_layout(cls.kind, shapes)
        for field, value in others.items():
            cls.kind.write(known, field, value)
        unchanged = {f: others[f] for f in others.keys() - cls.kind.scalars.keys()}

        def make() -> Any:
            memory = np.zeros(size + ALIGNMENT, np.uint8)
            base = address_of(memory)
            gap = -base % ALIGNMENT
            table = cls.__new__(cls)
            zeros = memory[gap : gap + size]
            table.__dict__.update(unchanged, _views=views, _zeros=zeros)
            tables = {field: make_table() for field, make_table in makers.items()}
            table._set(tables, known + (base + gap) * inside)
            return table

        return make

    def _set(self, fields: Mapping[str, Any], words: np.ndarray) -> None:
        """Takes the values of some fields; words of the others are known."""
        scalars = self.kind.scalars
        for field, value in fields.items():
            self.kind.write(words, field, value)
            if field not in scalars:
                self.__dict__[field] = value
        derived = {"_memory": words, "_numbers": _as_numbers(words)}
        self.__dict__.update(derived, address=address_of(words))

    def __getattr__(self, name: str) -> Any:
        """A number, or an array of zeros on its first request."""
        kind = self.kind
        if name in kind.scalars:
            return self._numbers[kind.scalars[name]].item(kind.offsets[name])
        views = self.__dict__.get("_views", {})
        if name not in views:
            raise AttributeError(f"{type(self).__name__} has no {name}")
        shape, numbers, start = views[name]
        view = np.ndarray(shape, numbers, self._zeros, start)
        return self.__dict__.setdefault(name, view)

    def __setattr__(self, name: str, value: Any) -> None:
        kind = self.kind
        if name not in kind.scalars:
            raise AttributeError(f"not a number of a table: {name}; see `replaced`")
        self._numbers[kind.scalars[name]][kind.offsets[name]] = value

    def contents(self) -> Iterator[np.ndarray]:
        """All that kernels may change in this table and in its tables.

        Views of the numbers, then of the arrays. Addresses are not part of it, so that
        copies of the views can be put into another table of the same shapes.
        """
        for first, end in self.kind.number_runs:
            yield self._memory[first:end]
        views = self.__dict__.get("_views", {})
        if views:
            yield self._zeros
        for field in self.kind.members:
            if field in self.kind.scalars or field in views:
                continue
            value = getattr(self, field)
            if isinstance(value, Table):
                yield from value.contents()
            elif isinstance(value, np.ndarray):
                yield value

    def __reduce__(self) -> Any:
        """Copies have an address of their own."""
        fields = {field: getattr(self, field) for field in self.kind.fields}
        return partial(type(self), **fields), ()

    def replaced(self, **changes: Any) -> Self:
        """The same table with other values of some fields."""
        twin = type(self).__new__(type(self))
        twin.__dict__.update(self.__dict__)
        views = self.__dict__.get("_views", {})
        twin.__dict__["_views"] = {f: v for f, v in views.items() if f not in changes}
        twin._set(changes, self._memory.copy())
        return twin
