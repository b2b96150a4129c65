"""The content of a table, with all that it refers to, as constant data.

The image is a sequence of 64-bit words. Words that are addresses are zero in it; the
relocations give what they point to: to another word of the image, or to a kernel. An
instance is a copy of the image with its addresses filled in.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sidtool.solver.compiler.arrays import PointerType, ViewType
from sidtool.solver.compiler.records import RowsType
from sidtool.solver.compiler.tables import ALIGNMENT, Table, TableType

from .kernel_objects import PREFIX

WORD = 8
#: Fields of `Lapack`, as routines of LAPACK.
_LAPACK = {"factor": "getrf", "solve": "getrs"}
#: How names of LAPACK begin, by the tables of factors.
_PRECISION = {"Factors": "d", "ComplexFactors": "z"}


@dataclass(frozen=True, eq=False)
class MemoryImage:
    """Words of the image, and what its addresses point to.

    Attributes
    ----------
    words : (n,) int64
    pointers : (word, word that it points to)
    kernels : (word, symbol of the kernel that it points to)
    """

    words: np.ndarray
    pointers: tuple[tuple[int, int], ...]
    kernels: tuple[tuple[int, str], ...]
    _places: tuple[tuple[int, int, int], ...]

    def word_of(self, array: np.ndarray, index: int = 0) -> int:
        """Word of an entry of an array, which is counted in full rows."""
        address = array.__array_interface__["data"][0] + WORD * index
        return _offset(self._places, address) // WORD


def memory_image(table: Table) -> MemoryImage:
    """The image of a table, which is at its begin."""
    walk = _Walk()
    walk.add_table(table, type(table).kind)
    return walk.image()


@dataclass(eq=False)
class _Walk:
    """Memory in the order in which tables refer to it.

    That order, unlike the order of addresses, is the same in each process.
    """

    spans: list[tuple[int, int]] = field(default_factory=list)
    pointers: dict[int, int] = field(default_factory=dict)
    kernels: dict[int, str] = field(default_factory=dict)
    empty: list[int] = field(default_factory=list)
    seen: set[int] = field(default_factory=set)
    kept: list[Any] = field(default_factory=list)

    def add_table(self, table: Any, kind: TableType, precision: str = "") -> None:
        """Add a table and what it refers to."""
        if table.address in self.seen:
            return
        self.seen.add(table.address)
        self.kept.append(table)
        self.spans.append((table.address, WORD * kind.words))
        precision = _PRECISION.get(kind.owner.__name__, precision)
        for name, member in kind.members.items():
            if name not in kind.scalars:
                word = table.address + WORD * kind.offsets[name]
                self._add_member(word, name, getattr(table, name), member, precision)

    def _add_member(
        self, word: int, name: str, value: Any, member: Any, precision: str
    ) -> None:
        if isinstance(member, TableType):
            if value is None:
                self.empty.append(word)
                return
            self.pointers[word] = value.address
            self.add_table(value, member, precision)
        elif isinstance(member, PointerType):
            if not value.address:
                self.empty.append(word)
                return
            symbol = precision + _LAPACK[name] if name in _LAPACK else name
            self.kernels[word] = PREFIX + symbol
        elif isinstance(member, ViewType | RowsType):
            if not value.nbytes:
                self.empty.append(word)
                return
            address = int(value.__array_interface__["data"][0])
            self.pointers[word] = address
            self.spans.append((address, value.nbytes))
            self.kept.append(value)
        else:
            raise TypeError(f"a field {name} of {member}")

    def image(self) -> MemoryImage:
        """The image of all that was added."""
        content, places = bytearray(), []
        for begin, end in self._merged_spans():
            content += bytes(-len(content) % ALIGNMENT)
            places.append((begin, end, len(content)))
            content += ctypes.string_at(begin, end - begin)
        content += bytes(-len(content) % ALIGNMENT)
        words = np.frombuffer(bytes(content), np.int64).copy()
        known = tuple(places)

        def word(address: int) -> int:
            return _offset(known, address) // WORD

        for address in (*self.pointers, *self.kernels, *self.empty):
            words[word(address)] = 0
        pointers = sorted((word(a), word(b)) for a, b in self.pointers.items())
        kernels = sorted((word(a), symbol) for a, symbol in self.kernels.items())
        return MemoryImage(words, tuple(pointers), tuple(kernels), known)

    def _merged_spans(self) -> list[tuple[int, int]]:
        """Begin and end of memory, overlapping parts as one, in order of the walk."""
        order: dict[int, int] = {}
        for k, (begin, _) in enumerate(self.spans):
            order.setdefault(begin, k)
        merged: list[list[int]] = []
        for begin, size in sorted(self.spans):
            if merged and begin < merged[-1][1]:
                merged[-1][1] = max(merged[-1][1], begin + size)
                merged[-1][2] = min(merged[-1][2], order[begin])
            else:
                merged.append([begin, begin + size, order[begin]])
        return [(a, b) for a, b, _ in sorted(merged, key=lambda part: part[2])]


def _offset(places: tuple[tuple[int, int, int], ...], address: int) -> int:
    """Where an address lies in the image [bytes]."""
    for begin, end, start in places:
        if begin <= address < end:
            return start + address - begin
    raise LookupError(f"an address that is not in the image: {address}")
