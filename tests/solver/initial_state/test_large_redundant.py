"""Constraints of large scenes that follow from others: as dense matrices find them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sidtool.solver.initial_state import (
    constraint_jacobian,
    given_state,
    overconstraint,
    redundant_constraints,
    sparse_jacobian,
)
from sidtool.solver.initial_state.assembly import assemble
from sidtool.solver.initial_state.redundant_constraints import RANK_TOLERANCE
from sidtool.solver.initial_state.sparse_jacobian import IndependentRows
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays
from tests.solver.scenes import compiled, scene

from .networks import ladder

CELLS = 8


def rows_that_follow(B: np.ndarray) -> list[int]:
    """By the ranks of the first rows."""
    ranks = [0, *(np.linalg.matrix_rank(B[: k + 1]) for k in range(len(B)))]
    return [k for k in range(len(B)) if ranks[k + 1] == ranks[k]]


@pytest.mark.parametrize("seed", range(4))
def test_rows_follow_from_those_before_them(seed: int) -> None:
    """Sums of rows before, several of them, the next rows again independent of all; in
    blocks of rows, and where columns are few."""
    rng = np.random.default_rng(seed)
    some = rng.random((120, 130)) < 0.05
    B = some * rng.random((120, 130)) + np.eye(120, 130)
    for k in rng.choice(np.arange(10, 120), 25, replace=False):
        near = rng.choice(np.arange(max(0, k - 9), k), 3, replace=False)
        B[k] = B[near].T @ rng.uniform(0.5, 1.0, 3)
    rows = IndependentRows(csr_array(B))
    assert np.flatnonzero(rows.dependent).tolist() == rows_that_follow(B)
    assert (
        rows.smallest_singular_value == 0.0
        and rows.independent_part.smallest_singular_value > 0.0
        and rows.are_clear(1e-9)
    )
    unit = B / np.linalg.norm(B, axis=1)[:, None]
    left, sizes, _ = np.linalg.svd(unit)
    apart = left[:, int(np.sum(sizes > 1e-9)) :]
    right = rng.standard_normal((120, 3))
    assert rows.has_clear_columns and rows.column_range.rank == 120 - apart.shape[1]
    met = right - apart @ (apart.T @ right)
    assert rows.column_range.project(right) == pytest.approx(met, abs=1e-12)
    shares = np.linalg.norm(apart, axis=1)
    assert ((rows.column_range.dependence_shares(120) > 1e-6) == (shares > 1e-6)).all()
    right = B @ rng.standard_normal(130)
    expected = np.linalg.lstsq(B, right, rcond=None)[0]
    assert rows.solve_independent(right) == pytest.approx(expected, rel=1e-7, abs=1e-7)


def test_more_rows_than_columns() -> None:
    B = np.random.default_rng(3).standard_normal((60, 20))
    rows = IndependentRows(csr_array(B))
    assert np.flatnonzero(rows.dependent).tolist() == list(range(20, 60))


@pytest.mark.parametrize("is_long", [False, True])
def test_a_ladder_in_space_starts_without_dense_matrices(
    monkeypatch: pytest.MonkeyPatch, is_long: bool
) -> None:
    """Axes are parallel: three constraints of each cell follow from the others, but for
    the rounding of many; in its plane each cell can swing.

    Seven times as long, rounding grows beyond what is exact, and what is left of a row
    without the others falls with the square: here the bounds are moved to them.
    """
    cells = 30
    for module in (constraint_jacobian, redundant_constraints):
        monkeypatch.setattr(module, "LARGE_SCENE_ROWS", 100)
    if is_long:
        monkeypatch.setattr(sparse_jacobian, "EXACT_DEPENDENCE", 1e-12)
        monkeypatch.setattr(overconstraint, "DATA_ROUNDING", 3e-3)
    system = ladder(cells, space=True, angular_velocity=[0.0, 0.0, 0.3])
    for name in ("svd", "lstsq"):
        monkeypatch.setattr(np.linalg, name, of_small(getattr(np.linalg, name)))
    found, start = assemble(system)
    assert len(found.redundant) == 3 * cells
    assert found.n_velocities - found.n_rows + 3 * cells == cells
    state = constraint_jacobian.InitialState(found, start)
    assert state.scaled_residual < 1e-12
    assert np.abs(state.work.row[:, at.C_RATE]).max() < 1e-12
    across = start.v.reshape(-1, 6)[:, 2:5]
    assert np.abs(across).max() < 1e-12 and start.v[5] > 1e-3


def test_many_bodies_that_are_held_twice() -> None:
    """All constraints of a large scene lie between bodies without coordinates."""
    count = 60
    table = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    joints = {
        f"{name}{k}": {"type": "fixed", "markers": ["ground", f"b{k}"]}
        for name in ("once", "again")
        for k in range(count)
    }
    bodies = {f"b{k}": table for k in range(count)}
    system = compiled(scene(bodies, joints, dimension="spatial"))
    found, start = assemble(system)
    assert found.n_velocities == 0 and len(found.redundant) == 6 * count
    assert np.isfinite(start.z).all()


def ladder_said_twice(cells: int) -> System:
    """A ladder whose rungs are pinned twice at one end, swinging."""
    once = ladder(cells).scene
    bodies: Any = {n: b.file_data() for n, b in once.bodies.items()}
    joints: Any = {n: j.file_data() for n, j in once.joints.items()}
    for k in range(cells):
        joints[f"again{k}"] = {
            "type": "revolute",
            "markers": [f"low{k}.b", f"rung{k}.a"],
        }
    bodies["low0"]["initial"]["angular_velocity"] = 0.3
    more: Any = {"ground": once.ground.file_data(), "gravity": [0.0, -9.81]}
    return compiled(scene(bodies, joints, **more))


def test_a_ladder_said_twice_starts_as_by_dense_matrices(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As many redundant rows, slack for the same ones, the same start, and multipliers
    without the part that nothing determines."""
    found = {}
    for many in (20, 10**9):
        monkeypatch.setattr(constraint_jacobian, "LARGE_SCENE_ROWS", many)
        monkeypatch.setattr(redundant_constraints, "LARGE_SCENE_ROWS", many)
        with monkeypatch.context() as watched:
            if many == 20:
                watched.setattr(redundant_constraints.np.linalg, "svd", refuse)
            system, start = assemble(ladder_said_twice(CELLS))
        rng = np.random.default_rng(1)
        table = rng.standard_normal((1, system.n_rows))
        states = np.zeros(1), start.z[None], start.v[None]
        least = redundant_constraints.minimum_norm_multipliers(
            system, new_work_arrays(system), *states, table
        )
        found[many] = system, start, least
    (one, begin, least), (other, expected, wanted) = found.values()
    assert len(one.redundant) == len(other.redundant) == 2 * CELLS
    assert one.arrays.regularisation == pytest.approx(
        other.arrays.regularisation, rel=1e-9
    )
    assert (one.arrays.regularisation > 0.0).sum() == 4 * CELLS
    assert begin.z == pytest.approx(expected.z, abs=1e-10)
    assert begin.v == pytest.approx(expected.v, abs=1e-8)
    assert least[0] == pytest.approx(wanted[0], rel=1e-8, abs=1e-9)
    assert least[1] == wanted[1] and len(least[1]) == 4 * CELLS


def of_small(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same for matrices of a few rows and columns only."""

    def refused(matrix: np.ndarray, *more: Any, **named: Any) -> Any:
        assert max(np.shape(matrix)) < 100, "dense matrices of all constraints"
        return function(matrix, *more, **named)

    return refused


def refuse(*_: Any, **__: Any) -> None:
    raise AssertionError("singular values of all constraints")


def test_free_directions_of_a_ladder_keep_its_constraints(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its rails swing: one direction for each cell."""
    monkeypatch.setattr(constraint_jacobian, "LARGE_SCENE_ROWS", 20)
    system = ladder_said_twice(CELLS)
    state = constraint_jacobian.InitialState(
        system, given_state.initial_estimate(system)
    )
    assert state.classified_rows(RANK_TOLERANCE) is not None
    step = redundant_constraints._free_direction(state)
    assert np.abs(step).max() > 0.0
    assert np.abs(state.dense_jacobian() @ step).max() < 1e-12
    assert system.n_velocities - system.n_rows + 2 * CELLS == CELLS


def test_rounding_beside_a_row_said_twice_is_seen() -> None:
    """The third and the fourth row differ by 1e-7, the second one is the first."""
    B = np.zeros((4, 6))
    B[:, 0], B[2:, 1], B[3, 2] = 1.0, 1.0, 1e-7
    rows = IndependentRows(csr_array(B))
    assert np.flatnonzero(rows.dependent).tolist() == [1]
    assert not rows.have_remainder(1e-5) and rows.have_remainder(1e-9)
