"""Sums of symmetric element matrices in sparse ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

Indices = NDArray[np.int64]
NodeNumbers = NDArray[np.int32]
#: Entries of element matrices that are added up at a time.
_ENTRIES_PER_BATCH = 4_000_000
#: Blocks of a sum that are written into its sparse matrix at a time.
_BLOCKS_AT_A_TIME = 100_000


def pairs_of_functions(matrices: Array, d: int) -> Array:
    """(ne, pairs, d d) blocks of symmetric element matrices (ne, d m, d m), for the
    pairs of functions m <= n."""
    ne, size, _ = matrices.shape
    entries, _ = pair_entries(size // d, d)
    blocks = np.take(matrices.reshape(ne, size**2), entries, axis=1)
    return np.asarray(blocks.reshape(ne, entries.size // d**2, d * d))


@cache
def pair_entries(m: int, d: int) -> tuple[Indices, Indices]:
    """Numbers of entries: those of the blocks (pairs d d,) in a matrix (d m d m,), and
    those of the matrix in the blocks, of which it is made by symmetry.
    """
    first, second = np.triu_indices(m)
    axes = np.arange(d)
    rows = first[:, None, None] * d + axes[:, None]
    columns = second[:, None, None] * d + axes
    entries = (rows * (d * m) + columns).ravel()
    places = np.zeros((d * m, d * m), np.int64)
    numbers = np.arange(entries.size).reshape(rows.shape[0], d, d)
    places[columns, rows] = numbers
    places[rows, columns] = numbers
    return entries, places.ravel()


class MatrixSum:
    """Symmetric element matrices added up in sparse ones, in blocks (d, d) by pairs of
    nodes.

    Matrices with the same nodes, such as mass and stiffness, share the search for equal
    pairs. Only one of the two orders of a pair is added up. Elements wait until they
    are many, and are added up together.

    Parameters
    ----------
    count : number of nodes n
    sizes : d of every matrix
    """

    def __init__(self, count: int, *sizes: int) -> None:
        self.sizes, self._count = sizes, count
        self._waiting: list[_Pairs] = []
        self._entries = 0
        self._parts: list[_Pairs] = []

    def add(self, nodes: Indices, *matrices: Array) -> None:
        """Element matrices (ne, d m, d m) for every d at their nodes (ne, m)."""
        pairs = zip(matrices, self.sizes, strict=True)
        self.add_pairs(nodes, *(pairs_of_functions(each, d) for each, d in pairs))

    def add_pairs(self, nodes: Indices, *blocks: Array) -> None:
        """Their blocks (ne, pairs, d d) as from `pairs_of_functions`."""
        if not len(nodes):
            return
        first, second = np.triu_indices(nodes.shape[1])
        rows, columns = (nodes.astype(np.int32)[:, x].ravel() for x in (first, second))
        flat = [each.reshape(len(rows), -1) for each in blocks]
        self._waiting.append(_Pairs(rows, columns, flat))
        self._entries += sum(each.size for each in flat)
        is_apart = np.tile(first != second, len(nodes))
        twice = np.flatnonzero((rows == columns) & is_apart)
        if twice.size:  # a node of a collapsed element: both orders are one pair
            turned = [_turned(each[twice]) for each in flat]
            self._waiting.append(_Pairs(rows[twice], rows[twice], turned))
        if self._entries > _ENTRIES_PER_BATCH:
            self._add_up()

    def total(self) -> tuple[sp.csr_matrix, ...]:
        """The sums, (d n, d n) for every d; these are without elements afterwards."""
        self._add_up()
        if not self._parts:
            return tuple(sp.csr_matrix((d * self._count,) * 2) for d in self.sizes)
        pairs = _merged(self._parts, self._count)
        pattern = _both_orders(pairs.rows, pairs.columns, self._count)
        return tuple(
            _symmetric_matrix(pattern, pairs.blocks.pop(0), d) for d in self.sizes
        )

    def _add_up(self) -> None:
        """Add up the elements that wait."""
        if self._waiting:
            parts, self._waiting, self._entries = self._waiting, [], 0
            blocks = zip(*(part.blocks for part in parts), strict=True)
            pairs = _Pairs(
                np.concatenate([part.rows for part in parts]),
                np.concatenate([part.columns for part in parts]),
                [np.concatenate(each) for each in blocks],
            )
            del parts
            self._parts.append(_sum_pairs(pairs, self._count))


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of nodes (p,) and their blocks (p, d d), for every d."""

    rows: NodeNumbers
    columns: NodeNumbers
    blocks: list[Array]


def _merged(parts: list[_Pairs], count: int) -> _Pairs:
    """Return the sum of parts, each of which has every pair once; the list is emptied,
    so that no memory is held twice.
    """
    if len(parts) == 1:
        return parts.pop()
    keys = [part.rows * np.int64(count) + part.columns for part in parts]
    every = np.sort(np.concatenate(keys))
    every = every[np.diff(every, prepend=-1) > 0]
    blocks = zip(*(part.blocks for part in parts), strict=True)
    kinds = [(each[0].shape[1], np.result_type(*each)) for each in blocks]
    sums = [np.zeros((len(every), size), kind) for size, kind in kinds]
    while parts:
        part, key = parts.pop(0), keys.pop(0)
        there = np.searchsorted(every, key)
        for total, own in zip(sums, part.blocks, strict=True):
            total[there] += own
    rows, columns = (x.astype(np.int32) for x in np.divmod(every, count))
    return _Pairs(rows, columns, sums)


def _turned(blocks: Array) -> Array:
    """Return transposed blocks (p, d d)."""
    d = round(blocks.shape[1] ** 0.5)
    return blocks.reshape(-1, d, d).swapaxes(1, 2).reshape(-1, d * d)


def _sum_pairs(pairs: _Pairs, count: int) -> _Pairs:
    """Return the sums of the blocks of equal pairs, the smaller node first.

    They are sorted by counting, by the larger node first and then by the smaller one.
    """
    rows = np.minimum(pairs.rows, pairs.columns)
    columns = np.maximum(pairs.rows, pairs.columns)
    every = np.arange(len(rows) + 1, dtype=np.int32)
    shape = (len(rows), count)
    by_column = sp.csr_matrix((every[:-1], columns, every), shape=shape).tocsc()
    entries = (by_column.data, rows[by_column.data], by_column.indptr)
    by_row = sp.csr_matrix(entries, shape=(count, count)).tocsc()
    order, starts = by_row.data, by_row.indptr
    is_first = np.diff(by_row.indices, prepend=-1) != 0
    is_first[starts[:-1][np.diff(starts) > 0]] = True
    firsts = np.flatnonzero(is_first)
    ends = np.append(firsts, len(rows))
    is_turned = (pairs.rows > pairs.columns)[order]
    before = np.concatenate([[0], np.cumsum(is_turned)])[ends]
    sums = []
    while pairs.blocks:
        blocks = pairs.blocks.pop(0)
        if blocks.shape[1] == 1:
            sums.append(_selected_sums(order, ends, blocks))
            continue
        total = _selected_sums(order[~is_turned], ends - before, blocks)
        total += _turned(_selected_sums(order[is_turned], before, blocks))
        sums.append(total)
    chosen = order[firsts]
    return _Pairs(rows[chosen], columns[chosen], sums)


def _selected_sums(order: Indices, ends: Indices, blocks: Array) -> Array:
    """Sums (k, d d) of the blocks numbered by groups of `order` between `ends`."""
    entries = (np.ones(len(order)), order, ends)
    return np.asarray(sp.csr_matrix(entries, (len(ends) - 1, len(blocks))) @ blocks)


def _both_orders(rows: NodeNumbers, columns: NodeNumbers, count: int) -> sp.csr_matrix:
    """(n, n) numbers of pairs plus 1, for the other order of the nodes negative."""
    numbers = np.arange(1, len(rows) + 1, dtype=np.int32)
    starts = np.searchsorted(rows, np.arange(count + 1, dtype=rows.dtype))
    upper = sp.csr_matrix((numbers, columns, starts), shape=(count, count))
    apart = rows != columns
    entries = (-numbers[apart], (columns[apart], rows[apart]))
    return sp.csr_matrix(sp.csr_matrix(entries, shape=upper.shape) + upper)


def _symmetric_matrix(pattern: sp.csr_matrix, blocks: Array, d: int) -> sp.csr_matrix:
    """Sparse matrix of the blocks (p, d d) that a pattern of `_both_orders` numbers.

    Its rows are written group by group: all blocks at once would take as much memory
    as the matrix.
    """
    count, starts = pattern.shape[0], pattern.indptr
    values = np.empty(pattern.nnz * d**2, blocks.dtype)
    columns = np.empty(values.size, pattern.indices.dtype)
    ends = np.zeros(d * count + 1, starts.dtype)
    limits = np.arange(0, pattern.nnz + _BLOCKS_AT_A_TIME, _BLOCKS_AT_A_TIME)
    rows = np.unique(np.append(np.searchsorted(starts, limits).clip(max=count), count))
    for first, last in zip(rows[:-1], rows[1:], strict=True):
        own = slice(starts[first], starts[last])
        numbers = pattern.data[own]
        every = blocks[np.abs(numbers) - 1]
        every[numbers < 0] = _turned(every[numbers < 0])
        entries = (
            every.reshape(-1, d, d),
            pattern.indices[own],
            starts[first : last + 1] - starts[first],
        )
        shape = (d * (last - first), d * count)
        part = sp.bsr_matrix(entries, shape=shape).tocsr()
        there = slice(own.start * d**2, own.stop * d**2)
        values[there], columns[there] = part.data, part.indices
        ends[d * first : d * last + 1] = part.indptr + there.start
    return sp.csr_matrix((values, columns, ends), shape=(d * count,) * 2)
