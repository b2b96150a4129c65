"""Tables: what kernels read through one pointer is what Python sees."""

from __future__ import annotations

import copy
import gc

import numpy as np
import pytest

from sidtool.solver.compiler.kernels import entry
from sidtool.solver.compiler.tables import Table, TableType
from sidtool.solver.compiler.types import float64, int64
from sidtool.solver.spatial.system_arrays import Reals, Reals2


class Pair(Table):
    numbers: Reals
    grid: Reals2
    other: Pair
    weight: float
    count: int


PAIR = TableType(Pair)


@entry(float64(PAIR, int64))
def last_entries(pair, scale):
    """Sum of the last entries of a table and of the one it refers to."""
    total = 0.0
    for table in (pair, pair.other):
        rows, columns = table.grid.shape
        total += table.numbers[len(table.numbers) - 1] * scale
        total += table.grid[rows - 1, columns - 1]
    return total


def pair() -> Pair:
    return Pair(numbers=np.array([5.0]), grid=np.full((3, 1), 7.0), other=last())


def last() -> Pair:
    grid = np.arange(6.0).reshape(2, 3)
    return Pair(numbers=np.array([1.0, 2.0]), grid=grid, other=None)


def test_kernels_see_arrays_shapes_and_tables_within_tables() -> None:
    assert last_entries(pair(), 10) == (50.0 + 7.0) + (20.0 + 5.0)


def test_values_change_and_fields_do_not() -> None:
    table = pair()
    table.numbers[0] = 6.0
    assert last_entries(table, 10) == 92.0
    with pytest.raises(AttributeError, match="numbers"):
        table.numbers = np.zeros(3)
    assert last_entries(table.replaced(numbers=np.ones(4)), 10) == 42.0


def test_a_table_with_other_values_keeps_the_rest_and_the_original() -> None:
    table = pair()
    changed = table.replaced(grid=np.full((2, 2), 3.0))
    assert changed.numbers is table.numbers and changed.other is table.other
    assert last_entries(changed, 10) == (50.0 + 3.0) + (20.0 + 5.0)
    assert last_entries(table, 10) == (50.0 + 7.0) + (20.0 + 5.0)
    with pytest.raises(KeyError, match="width"):
        table.replaced(width=np.zeros(3))
    with pytest.raises(TypeError, match="not an array"):
        table.replaced(numbers=np.zeros(3, int))


def test_copies_outlive_the_original() -> None:
    table = pair()
    twin = copy.deepcopy(table)
    assert twin.address != table.address
    del table
    gc.collect()
    assert last_entries(twin, 10) == 82.0


@pytest.mark.parametrize(
    "numbers", [np.zeros(2, int), np.zeros((2, 2)), np.zeros(4)[::2], np.zeros(2, "f4")]
)
def test_arrays_of_another_kind_are_refused(numbers: np.ndarray) -> None:
    with pytest.raises(TypeError, match="array"):
        Pair(numbers=numbers, grid=np.zeros((1, 1)), other=None)


def test_fields_that_do_not_exist_are_refused() -> None:
    with pytest.raises(TypeError, match="width"):
        Pair(numbers=np.zeros(1), grid=np.zeros((1, 1)), other=None, width=1.0)
    with pytest.raises(TypeError, match="grid"):
        Pair(numbers=np.zeros(1), other=None)


def test_arrays_of_zeros_are_made_together() -> None:
    inner = last()
    table = Pair.zeros(numbers=(3,), grid=(2, 5), other=inner)
    assert table.numbers.shape == (3,) and table.grid.shape == (2, 5)
    assert not table.numbers.any() and not table.grid.any()
    table.numbers[2], table.grid[1, 4] = 5.0, 7.0
    assert last_entries(table, 10) == (50.0 + 7.0) + (20.0 + 5.0)
    other = Pair.zeros(numbers=(3,), grid=(2, 5), other=inner)
    assert not other.numbers.any() and not other.grid.any()
    empty = Pair.zeros(numbers=(0,), grid=(0, 4), other=None)
    assert empty.numbers.size == 0 and empty.grid.shape == (0, 4)
    with pytest.raises(TypeError, match="shape"):
        Pair.zeros(numbers=(3, 3), grid=(2, 5), other=None)


def test_makers_make_tables_with_arrays_and_tables_of_their_own() -> None:
    numbers = np.array([1.0, 2.0])
    inner = Pair.maker(numbers=(2,), grid=(1, 5), other=None)
    make = Pair.maker(numbers=numbers, grid=(2, 5), other=inner, weight=0.5)
    one, two = make(), make()
    assert one.numbers is two.numbers is numbers and one.other is not two.other
    one.grid[1, 4], one.other.numbers[1], one.other.grid[0, 4] = 7.0, 3.0, 2.0
    assert not two.grid.any() and not two.other.grid.any()
    assert last_entries(one, 10) == (20.0 + 7.0) + (30.0 + 2.0)
    assert last_entries(two, 10) == 20.0
    assert last_entries(one.replaced(numbers=np.ones(3)), 10) == 17.0 + 32.0
    assert one.weight == 0.5 and one.count == 0


@entry(float64(PAIR, float64))
def weigh(pair, more):
    """Counts, adds to a weight, and returns it."""
    pair.count += 1
    pair.weight += more
    return pair.weight * pair.other.numbers[1]


def test_numbers_change_in_python_and_in_kernels() -> None:
    table = pair()
    assert (table.weight, table.count) == (0.0, 0)
    table.weight, table.count = 2, 7
    assert weigh(table, 0.25) == 4.5
    assert (table.weight, table.count) == (2.25, 8)
    assert type(table.weight) is float and type(table.count) is int
    twin, changed = copy.deepcopy(table), table.replaced(weight=1.0)
    assert weigh(twin, 0.0) == 4.5 and weigh(changed, 0.0) == 2.0
    assert (table.count, twin.count, changed.count) == (8, 9, 9)
