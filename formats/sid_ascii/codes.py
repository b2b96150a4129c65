"""Indices of the entries of one expansion, and their positions in a matrix."""

import re
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

M0, M1, MN = 1, 2, 3
_KINDS = {"0": M0, "1": M1, "n": MN}
#: Indices are packed into one integer: kind, row, mode and column, or row and column.
_BITS = 20
_MASK = (1 << _BITS) - 1

_ENTRY = re.compile(
    r"m([01n])\s*\(\s*(\d{1,6})\s*,\s*(\d{1,6})\s*(?:,\s*(\d{1,6})\s*)?\)\s*",
    re.IGNORECASE,
)


@lru_cache(maxsize=1 << 14)
def entry_code(key: str) -> int:
    """The packed indices of "m0(r,c)", "m1(r,l,c)" or "mn(r,n,c)"; 0 for other keys.

    Indices are 1-based. A file repeats most keys at every node, hence the cache.
    """
    match = _ENTRY.fullmatch(key)
    if match is None:
        return 0
    kind = _KINDS[match[1].lower()]
    if (kind == M0) != (match[4] is None):
        return 0
    row, second, third = int(match[2]), int(match[3]), int(match[4] or 0)
    return (((kind << _BITS | row) << _BITS) | second) << _BITS | third


class IndexCodes:
    """The packed indices of entries, (n,); expansions with the same keys share one.

    What follows from the indices alone is found once for all of them.
    """

    def __init__(self, packed: NDArray[np.int64]) -> None:
        self.packed = packed
        self._places: dict[object, tuple[NDArray[np.bool_], NDArray[np.int64]]] = {}

    def __len__(self) -> int:
        return len(self.packed)

    @cached_property
    def kinds_and_indices(self) -> tuple[NDArray[np.int64], ...]:
        """Kind and the three indices, as written, (n,) each."""
        codes = self.packed
        return (
            codes >> 3 * _BITS,
            codes >> 2 * _BITS & _MASK,
            codes >> _BITS & _MASK,
            codes & _MASK,
        )

    def has(self, kind: int) -> bool:
        """Is there an entry of this kind?"""
        return kind in self._kinds

    @cached_property
    def _kinds(self) -> frozenset[int]:
        return frozenset(self.kinds_and_indices[0].tolist())

    @cached_property
    def largest(self) -> tuple[int, int]:
        """The largest second and third index of first-order entries, 0 for none."""
        kinds, _, second, third = self.kinds_and_indices
        higher = kinds == M1
        return int(second[higher].max(initial=0)), int(third[higher].max(initial=0))

    @cached_property
    def repeated(self) -> int | None:
        """Return the first entry whose indices occur before."""
        codes, firsts = np.unique(self.packed, return_index=True)
        if len(codes) == len(self.packed):
            return None
        return int(np.setdiff1d(np.arange(len(self.packed)), firsts)[0])

    def places(
        self, kind: int, shape: tuple[int, ...], m1_index: str
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Which entries are of this kind, (n,), and their places in the flat matrix.

        A place is -1 where an index is outside of the shape.
        """
        key = (kind, shape, m1_index)
        if key not in self._places:
            kinds, rows, second, third = self.kinds_and_indices
            if kind != M0 and m1_index == "rcl":
                second, third = third, second
            indices = (rows, second) if kind == M0 else (second, rows, third)
            selected = kinds == kind
            zero_based = tuple(index[selected] - 1 for index in indices)
            flat = np.zeros(len(zero_based[0]), dtype=np.int64)
            inside = np.ones(len(flat), dtype=bool)
            for index, size in zip(zero_based, shape, strict=True):
                inside &= (index >= 0) & (index < size)
                flat = flat * size + index
            self._places[key] = selected, np.where(inside, flat, -1)
        return self._places[key]
