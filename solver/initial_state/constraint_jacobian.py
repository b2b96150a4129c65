"""A state with its constraint Jacobian, in scaled coordinates.

Coordinates are scaled so that every part of a mechanism counts: relative to the size
of the whole mechanism, motions of a small part would vanish.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..spatial.coordinates import retract
from ..system import work_arrays
from ..system.characteristic_sizes import (
    body_extents,
    constraint_sizes,
    coordinate_sizes,
)
from ..system.system import System
from ..system.work_arrays import new_work_arrays, stiffness_metric
from . import sparse_jacobian as sparse_jacobian_module
from .given_state import StateVectors
from .sparse_jacobian import (
    LARGE_SCENE_ROWS,
    IndependentRows,
    OrthogonalFactor,
    candidate_dependent_rows,
    jacobian_entries,
    sparse_constraint_jacobian,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rounds of the iteration, and parts of a row whose squares count as nothing.
ITERATIONS, NEGLIGIBLE = 30, 1e-20

MAX_ITERATIONS = 60
#: Constraints are closed when they are open by less, relative to their sizes.
RESIDUAL_TOLERANCE = 1e-13
#: Rows of the constraint Jacobian count as dependent below this relative size.
RANK_TOLERANCE = 1e-9
#: Inertia below this part of the mean one counts as so much.
MIN_INERTIA = 1e-14
#: How much less readily coordinates move that are to be kept.
PRESERVED_MOBILITY = 1e-3


def balanced_sizes(system: System, C: Array) -> Array:
    """Sizes of the velocity coordinates, (n velocities,): of each body one for its
    place, one for its turns and one for its deformation, whatever the axes are.

    Source: A. R. Curtis, J. K. Reid, J. Inst. Maths Applics 10 (1972): the sum of the
    squared logarithms of all scaled entries is least; here for rows and columns by
    turns.

    Parameters
    ----------
    C
        Of `WorkArrays`.
    """
    sizes, kinds = (
        coordinate_sizes(system),
        system.cached_by_topology(_coordinate_groups),
    )
    squares = _squared_entries(system, C, sizes, kinds)
    segment, kind = np.nonzero(squares)
    row, body, _ = system.arrays.segment[segment].T
    column = 3 * body + kind
    entries = np.log(squares[segment, kind])
    of_rows = np.zeros(system.n_rows)
    of_columns = np.zeros(3 * len(system.arrays.body))
    for _ in range(ITERATIONS):
        of_rows = _group_means(row, entries - of_columns[column], len(of_rows))
        of_columns = _group_means(column, entries - of_rows[row], len(of_columns))
    return sizes * np.exp(-0.5 * of_columns)[kinds]


def _group_means(group: np.ndarray, values: Array, count: int) -> Array:
    """Of values that share a place, (count,); 0 where there are none."""
    shares = np.maximum(np.bincount(group, minlength=count), 1)
    return np.asarray(np.bincount(group, values, count) / shares)


def _coordinate_groups(system: System) -> np.ndarray:
    """Of each velocity coordinate three times the number of its body, plus 0 of a
    place, 1 of a turn, 2 of a deformation."""
    axes = 2 if system.planar else 3
    kinds = [
        3 * b + np.repeat([0, 1, 2], np.diff([0, min(axes, rigid), rigid, n]))
        for b, (rigid, n) in enumerate(system.arrays.body[:, [at.RD, at.NV]])
    ]
    return np.concatenate(kinds)


def _squared_entries(
    system: System, C: Array, sizes: Array, kinds: np.ndarray
) -> Array:
    """Those of what rows have of a body, (segments, 3): of arms that are at least as
    long as the body, of points that deform as the body does."""
    _, columns, values = jacobian_entries(system, C)
    row, body, _ = system.arrays.segment.T
    segment = np.repeat(np.arange(len(body)), system.arrays.body[body, at.NV])
    groups = 3 * segment + kinds[columns] % 3
    squares = np.bincount(groups, (values * sizes[columns]) ** 2, 3 * len(body))
    squares_by_row = np.asarray(squares, float).reshape(-1, 3)
    arms = (body_extents(system) / system.length)[body]
    squares_by_row[:, 1] = np.maximum(
        squares_by_row[:, 1], arms**2 * squares_by_row[:, 0]
    )
    squares_by_row[:, 2] = np.maximum(squares_by_row[:, 2], squares_by_row[:, 0])
    rows = np.bincount(row, squares_by_row.sum(axis=1), system.n_rows)
    squares_by_row[squares_by_row < NEGLIGIBLE * rows[row, None]] = 0.0
    return squares_by_row


class InitialState:
    """The state in hand, with dense matrices of its constraints.

    Attributes
    ----------
    work
        Of the system, default a new one.
    sizes : (rows,)
        What is large for each constraint, see `constraint_sizes`.
    metric
        Blocks of tau^2 K of all bodies.
    stiffness
        Their share in the metric.
    kept
        True for coordinates that move only where no others can.
    is_independent
        True where no constraint follows from the others, not even nearly, at the
        positions in hand; False where that is not known.
    """

    def __init__(
        self, system: System, start: StateVectors, work: at.WorkArrays | None = None
    ) -> None:
        self.system = system
        self.z, self.v = start.z.copy(), start.v.copy()
        self.work = work or new_work_arrays(system)
        self.metric = system.cached(stiffness_metric)
        self.t = system.scene.time.start
        self.free = _free_coordinates(system)
        self.is_preserved = np.zeros(system.n_velocities, bool)
        self.ignored = np.zeros(system.n_rows, bool)
        self.ignored[[row for _, row in system.set_at_start]] = True
        self.sizes = system.cached(constraint_sizes)
        self.stiffness, self.is_independent = 1.0, False
        self.start()

    def start(self) -> None:
        """Evaluates at the start, with the drives that hold just after it."""
        self.work.interval_time[0] = 0.5 * (self.t + self.system.breaks[0])
        self.evaluate()

    def evaluate(self) -> None:
        work_arrays.evaluate(self.system, self.work, self.t, self.z, self.v)

    @property
    def residual(self) -> Array:
        return np.where(self.ignored, 0.0, self.work.row[:, at.C_VALUE])

    @property
    def scaled_residual(self) -> float:
        """How far the constraints are open, relative to their sizes."""
        return self.largest_relative(self.residual)

    @property
    def has_mass(self) -> bool:
        """Whether no stiffened body is deformed so far that its inertia is lost."""
        return bool(np.isfinite(self.work.M).all())

    @property
    def duration(self) -> float:
        return self.system.scene.time.end - self.system.scene.time.start

    @property
    def speed(self) -> float:
        """The largest velocity relative to the sizes of the coordinates [1/s]."""
        return self.scaled_speed(self.v)

    def scaled_speed(self, v: Array) -> float:
        """The same of other velocities."""
        sizes = self.system.cached(coordinate_sizes)
        return float(np.max(np.abs(v) / sizes, initial=0.0))

    def largest_relative(self, rows: Array) -> float:
        """The largest of some values of the constraint rows, relative to its size."""
        return float(np.max(np.abs(rows) / self.sizes, initial=0.0))

    def dense_jacobian(self) -> Array:
        C = dense_jacobian(self.system, self.work.C)
        C[self.ignored] = 0.0
        return C

    def minimum_norm(
        self, right: Array, rank_tolerance: float = RANK_TOLERANCE
    ) -> tuple[Array, Array]:
        """x with C x = right, smallest in the metric, and what remains of right.

        Parameters
        ----------
        rank_tolerance
            Constraints count as dependent below this relative size.
        """
        if len(self.ignored) >= LARGE_SCENE_ROWS and not self.ignored.any():
            solution = self._sparse_minimum_norm_solution(right, rank_tolerance)
            if solution is not None:
                return solution
        C = self.dense_jacobian()
        N = np.zeros((len(self.free), len(self.free)))
        for part, block in self.metric_roots():
            N[part, part] = block * self.free[part, None]
        B = C @ N
        lengths = np.sqrt((B * B).sum(axis=1))
        scale = np.where(lengths > 0.0, 1.0 / np.maximum(lengths, 1e-300), 0.0)
        scaled = scale[:, None] * B
        x = N @ np.linalg.lstsq(scaled, scale * right, rcond=rank_tolerance)[0]
        return x, C @ x - right

    def _sparse_minimum_norm_solution(
        self, right: Array, rank_tolerance: float
    ) -> tuple[Array, Array] | None:
        """The same with sparse matrices; None where that is not clear."""
        from scipy.sparse import diags_array

        C = sparse_constraint_jacobian(self.system, self.work.C)
        N = diags_array(self.free.astype(float)) @ self.metric_root()
        rows = IndependentRows(C @ N)
        if rows.dependent.any():
            sizes = self.system.cached(coordinate_sizes) * self.free
            relative = IndependentRows(C.multiply(sizes[None, :]).tocsr())
            rows = IndependentRows(C @ N, is_dependent=relative.dependent)
        if rows.smallest_singular_value > rank_tolerance:
            x = rows.minimum_norm_solution(right)
        elif (without := rows.small_singular_vectors(rank_tolerance)) is not None:
            x = rows.minimum_norm_solution(right, without)
        elif (solution := rows.least_squares(right, rank_tolerance)) is not None:
            x = solution
        else:
            return None
        x = N @ x
        return x, C @ x - right

    def scaled_jacobian(self) -> Array:
        """C for relative changes of the coordinates, its rows of length 1 or 0."""
        return normalised_rows(
            self.dense_jacobian() * self.system.cached(coordinate_sizes)
        )

    def classified_rows(
        self, rank_tolerance: float = RANK_TOLERANCE
    ) -> IndependentRows | None:
        """The rows of the scaled Jacobian of a large scene, of which each is known to
        follow from others exactly, or to be independent; None where that is not
        clear.

        Parameters
        ----------
        rank_tolerance
            Relative to the largest singular value.
        """
        rows = self._independent_rows()
        return rows if rows is not None and rows.are_clear(rank_tolerance) else None

    def has_independent_remainder(self, rounding: float) -> bool:
        """True if more than rounding is left of each row of a large scene without the
        others, see `sparse_jacobian.IndependentRows`; with one or the other sizes.
        """
        rows = self._independent_rows()
        if rows is None or rows.have_remainder(rounding):
            return rows is not None
        sizes = self.balanced_sizes() / self.system.cached(coordinate_sizes)
        B = sparse_jacobian_module.normalised_sparse_rows(
            rows.matrix.multiply(sizes[None, :]).tocsr()
        )
        is_dependent = OrthogonalFactor(B[::-1].tocsr()).dependent[::-1]
        candidates = candidate_dependent_rows(self.system, B, ~is_dependent, rounding)
        return not candidates.any() or IndependentRows(B[candidates]).have_remainder(
            rounding
        )

    def balanced_sizes(self) -> Array:
        return balanced_sizes(self.system, self.work.C)

    def _independent_rows(self) -> IndependentRows | None:
        if len(self.ignored) < LARGE_SCENE_ROWS or self.ignored.any():
            return None
        C = sparse_jacobian_module.scaled_sparse_jacobian(self.system, self.work.C)
        return IndependentRows(C)

    def metric_root(self) -> csr_array:
        """N of `metric_roots` as a whole."""
        from scipy.sparse import coo_array

        rows, columns, values = [], [], []
        for part, blocks in self._stacked_metric_roots():
            shape = blocks.shape
            rows.append(np.broadcast_to(part[:, :, None], shape).ravel())
            columns.append(np.broadcast_to(part[:, None, :], shape).ravel())
            values.append(blocks.ravel())
        count = len(self.free)
        if not values:
            return coo_array((count, count)).tocsr()
        entries = np.concatenate(values)
        indices = np.concatenate(rows), np.concatenate(columns)
        root = coo_array((entries, indices), (count, count)).tocsr()
        root.eliminate_zeros()
        return root

    def metric_roots(self) -> Iterator[tuple[slice, Array]]:
        """The blocks of N with N N^T = W^-1 of all bodies, and their coordinates.

        With x = N y, the metric x^T W x is y^T y. C N has the digits that C N N^T C^T
        loses where bodies are stiff.
        """
        for parts, blocks in self._stacked_metric_roots():
            for part, block in zip(parts, blocks, strict=True):
                yield slice(int(part[0]), int(part[-1]) + 1), block

    def _stacked_metric_roots(self) -> Iterator[tuple[np.ndarray, Array]]:
        """Those of all bodies with n coordinates: coordinates (k, n), blocks (k, n, n).

        Large scenes have thousands of bodies, most of them with as many coordinates.
        """
        blocks = self.work.M + self.stiffness * self.metric
        diagonal = blocks[self.system.cached_by_topology(_diagonal_indices)]
        squares = self.system.cached(coordinate_sizes) ** 2
        least = MIN_INERTIA * (diagonal @ squares) / max(1, len(squares)) / squares
        scale = 1.0 / np.sqrt(np.maximum(diagonal, 0.0) + least)
        body = self.system.arrays.body
        for n in sorted(set(body[:, at.NV].tolist()) - {0}):
            of_n = body[body[:, at.NV] == n]
            part = of_n[:, at.VEL, None] + np.arange(n)
            entries = of_n[:, at.BLOCK, None] + np.arange(n * n)
            column = scale[part][:, :, None]
            W = blocks[entries].reshape(-1, n, n) * column * scale[part][:, None, :]
            W[:, range(n), range(n)] += least[part] * scale[part] ** 2
            preserved = self.is_preserved[part]
            W[preserved[:, :, None] != preserved[:, None, :]] = 0.0
            mobility = np.where(preserved[:, :, None], PRESERVED_MOBILITY, 1.0)
            inertias, directions = np.linalg.eigh(W)
            roots = np.sqrt(np.maximum(inertias, MIN_INERTIA))
            yield part, mobility * column * directions / roots[:, None, :]


def _diagonal_indices(system: System) -> np.ndarray:
    """Where those of the blocks of all bodies stand, (n velocities,)."""
    indices = [
        row[at.BLOCK] + (row[at.NV] + 1) * np.arange(row[at.NV])
        for row in system.arrays.body
    ]
    return np.concatenate(indices)


def assemble_position(
    state: InitialState, rank_tolerance: float = RANK_TOLERANCE
) -> float:
    """Moves the state onto the constraints; how far they stay open.

    Parameters
    ----------
    rank_tolerance
        See `State.smallest`.
    """
    residual = state.scaled_residual
    for _ in range(MAX_ITERATIONS):
        if residual <= RESIDUAL_TOLERANCE or not state.has_mass:
            break
        step, _ = state.minimum_norm(-state.residual, rank_tolerance)
        base, base_residual, fraction = state.z.copy(), residual, 1.0
        frame = state.work.frame.copy()
        while fraction > 1e-4:
            state.z[:] = base
            retract(state.system.arrays, frame, state.z, fraction * step)
            state.evaluate()
            residual = state.scaled_residual
            if residual < base_residual and state.has_mass:
                break
            fraction *= 0.5
        else:
            state.z[:] = base
            state.evaluate()
            return base_residual
    return residual


def _free_coordinates(system: System) -> Array:
    """True for velocity coordinates of bodies that the assembly may move."""
    free = np.ones(system.n_velocities, bool)
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.is_scene_body and system.scene.bodies[data.name].initial.fixed:
            free[row[at.VEL] : row[at.VEL] + row[at.NV]] = False
    return free


def normalised_rows(C: Array) -> Array:
    """The rows (n, m) divided by their lengths, those of nothing as they are."""
    lengths = np.sqrt((C * C).sum(axis=1))
    return C / np.where(lengths > 0.0, lengths, 1.0)[:, None]


def dense_jacobian(system: System, C: Array) -> Array:
    """The constraint Jacobian as a dense (rows, velocities) matrix."""
    rows, columns, values = jacobian_entries(system, C)
    shape = system.n_rows, system.n_velocities
    indices = rows * shape[1] + columns
    flat = np.bincount(indices, values, shape[0] * shape[1])
    return np.asarray(flat, float).reshape(shape)


def dense_jacobians(system: System, C: Array) -> Array:
    """Those of some states, (nt, rows, velocities), from the rows of C."""
    dense = np.zeros((len(C), system.n_rows, system.n_velocities))
    rows, columns, values = jacobian_entries(system, C)
    places: Any = (slice(None), rows, columns)
    np.add.at(dense, places, values)
    return dense


def friction_directions(system: System, C: Array) -> Array:
    """Derivatives of the coordinates with friction, (frictions, velocities)."""
    arrays = system.arrays
    along = np.zeros((len(system.friction_joints), system.n_velocities))
    for j, b, offset in arrays.friction_subsystem.segment:
        n, u = arrays.body[b, at.NV], arrays.body[b, at.VEL]
        along[j, u : u + n] += C[offset : offset + n]
    return along


def row_names(system: System, rows: tuple[int, ...]) -> list[str]:
    """The joints and drives that constraint rows belong to."""
    return [
        next(r.name for r in system.rows if r.first <= i < r.first + r.count)
        for i in rows
    ]


def largest_residuals_text(system: System, residual: Array) -> str:
    """Names the constraints with the largest residuals, relative to their sizes."""
    relative = np.abs(residual) / constraint_sizes(system)
    parts: dict[str, int] = {}
    for row in system.rows:
        largest_row = row.first + int(
            np.argmax(relative[row.first : row.first + row.count])
        )
        if relative[largest_row] >= relative[parts.get(row.name, largest_row)]:
            parts[row.name] = largest_row
    largest = max(relative[row] for row in parts.values())
    names = sorted(parts, key=lambda name: -relative[parts[name]])[:3]
    names = [name for name in names if relative[parts[name]] > 1e-6 * largest]
    return ", ".join(
        f"{name} is open by {abs(residual[parts[name]]):.3g}" for name in names
    )
