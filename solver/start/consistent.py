"""The state in which a scene starts, and the dense matrices of its constraints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.coordinates import retract
from ..system import kernel_calls
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes
from ..system.storage import new_work, stiffness_metric
from . import large_scenes
from .balance import balanced_sizes
from .large_scenes import MANY, IndependentRows, jacobian_entries, sparse_jacobian
from .orthogonal import OrthogonalFactor
from .peeled import rows_left
from .stated import Start

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ITERATIONS = 60
#: Constraints are closed when they are open by less, relative to their sizes.
CLOSED = 1e-13
#: Rows of the constraint Jacobian count as dependent below this relative size.
RANK_TOLERANCE = 1e-9
#: Inertia below this part of the mean one counts as so much.
NO_INERTIA = 1e-14
#: How much less readily coordinates move that are to be kept.
KEPT = 1e-3


class State:
    """The state in hand, with dense matrices of its constraints.

    work : of the system, default a new one
    sizes : (rows,) what is large for each constraint, see `sizes.row_sizes`
    metric : blocks of tau^2 K of all bodies
    stiffness : their share in the metric
    kept : True for coordinates that move only where no others can
    is_apart : True where no constraint follows from the others, not even nearly, at
        the positions in hand; False where that is not known
    """

    def __init__(
        self, system: System, start: Start, work: at.Work | None = None
    ) -> None:
        self.system = system
        self.z, self.v = start.z.copy(), start.v.copy()
        self.work = work or new_work(system)
        self.metric = system.once(stiffness_metric)
        self.t = system.scene.time.start
        self.free = _free_coordinates(system)
        self.kept = np.zeros(system.n_velocities, bool)
        self.ignored = np.zeros(system.n_rows, bool)
        self.ignored[[row for _, row in system.from_start]] = True
        self.sizes = system.once(row_sizes)
        self.stiffness, self.is_apart = 1.0, False
        self.start()

    def start(self) -> None:
        """Evaluates at the start, with the drives that hold just after it."""
        self.work.clock[0] = 0.5 * (self.t + self.system.breaks[0])
        self.evaluate()

    def evaluate(self) -> None:
        kernel_calls.evaluate(self.system, self.work, self.t, self.z, self.v)

    @property
    def residual(self) -> Array:
        return np.where(self.ignored, 0.0, self.work.row[:, at.C_VALUE])

    @property
    def opening(self) -> float:
        """How far the constraints are open, relative to their sizes."""
        return self.relative(self.residual)

    @property
    def duration(self) -> float:
        return self.system.scene.time.end - self.system.scene.time.start

    @property
    def speed(self) -> float:
        """The largest velocity relative to the sizes of the coordinates [1/s]."""
        return self.speed_of(self.v)

    def speed_of(self, v: Array) -> float:
        """The same of other velocities."""
        sizes = self.system.once(coordinate_sizes)
        return float(np.max(np.abs(v) / sizes, initial=0.0))

    def relative(self, rows: Array) -> float:
        """The largest of some values of the constraint rows, relative to its size."""
        return float(np.max(np.abs(rows) / self.sizes, initial=0.0))

    def jacobian(self) -> Array:
        C = dense_jacobian(self.system, self.work.C)
        C[self.ignored] = 0.0
        return C

    def smallest(
        self, right: Array, independent: float = RANK_TOLERANCE
    ) -> tuple[Array, Array]:
        """x with C x = right, smallest in the metric, and what remains of right.

        independent : constraints count as dependent below this relative size
        """
        if len(self.ignored) >= MANY and not self.ignored.any():
            found = self._smallest_of_many(right, independent)
            if found is not None:
                return found
        C = self.jacobian()
        N = np.zeros((len(self.free), len(self.free)))
        for part, block in self.roots():
            N[part, part] = block * self.free[part, None]
        B = C @ N
        lengths = np.sqrt((B * B).sum(axis=1))
        scale = np.where(lengths > 0.0, 1.0 / np.maximum(lengths, 1e-300), 0.0)
        scaled = scale[:, None] * B
        x = N @ np.linalg.lstsq(scaled, scale * right, rcond=independent)[0]
        return x, C @ x - right

    def _smallest_of_many(
        self, right: Array, independent: float
    ) -> tuple[Array, Array] | None:
        """The same with sparse matrices; None where that is not clear."""
        from scipy.sparse import diags_array

        C = sparse_jacobian(self.system, self.work.C)
        N = diags_array(self.free.astype(float)) @ self.root()
        rows = IndependentRows(C @ N)
        if rows.dependent.any():
            sizes = self.system.once(coordinate_sizes) * self.free
            relative = IndependentRows(C.multiply(sizes[None, :]).tocsr())
            rows = IndependentRows(C @ N, follow=relative.dependent)
        if rows.least > independent:
            x = rows.smallest(right)
        elif (without := rows.small(independent)) is not None:
            x = rows.smallest(right, without)
        elif (found := rows.least_squares(right, independent)) is not None:
            x = found
        else:
            return None
        x = N @ x
        return x, C @ x - right

    def scaled_jacobian(self) -> Array:
        """C for relative changes of the coordinates, its rows of length 1 or 0."""
        return of_length_one(self.jacobian() * self.system.once(coordinate_sizes))

    def clear_rows(self, independent: float = RANK_TOLERANCE) -> IndependentRows | None:
        """The rows of the scaled Jacobian of a large scene, of which each is known to
        follow from others exactly, or to be independent; None where that is not clear.

        independent : relative to the largest singular value
        """
        rows = self._large_rows()
        return rows if rows is not None and rows.are_clear(independent) else None

    def stands_apart(self, rounded: float) -> bool:
        """Whether more than rounding is left of each row of a large scene without the
        others, see `IndependentRows.stand_apart`; with one or the other sizes."""
        rows = self._large_rows()
        if rows is None or rows.stand_apart(rounded):
            return rows is not None
        sizes = self.balanced_sizes() / self.system.once(coordinate_sizes)
        B = large_scenes.of_length_one(rows.given.multiply(sizes[None, :]).tocsr())
        follow = OrthogonalFactor(B[::-1].tocsr()).dependent[::-1]
        left = rows_left(self.system, B, ~follow, rounded)
        return not left.any() or IndependentRows(B[left]).stand_apart(rounded)

    def balanced_sizes(self) -> Array:
        return balanced_sizes(self.system, self.work.C)

    def _large_rows(self) -> IndependentRows | None:
        if len(self.ignored) < MANY or self.ignored.any():
            return None
        C = large_scenes.scaled_jacobian(self.system, self.work.C)
        return IndependentRows(C)

    def root(self) -> csr_array:
        """N of `roots` as a whole."""
        from scipy.sparse import block_diag, csr_array

        blocks = [csr_array(block) for _, block in self.roots() if len(block)]
        return block_diag(blocks, "csr") if blocks else csr_array((0, 0))

    def roots(self) -> Iterator[tuple[slice, Array]]:
        """The blocks of N with N N^T = W^-1 of all bodies, and their coordinates.

        With x = N y, the metric x^T W x is y^T y. C N has the digits that C N N^T C^T
        loses where bodies are stiff.
        """
        blocks = self.work.M + self.stiffness * self.metric
        diagonal = blocks[self.system.lasting(_diagonals)]
        squares = self.system.once(coordinate_sizes) ** 2
        least = NO_INERTIA * (diagonal @ squares) / max(1, len(squares)) / squares
        scale = 1.0 / np.sqrt(np.maximum(diagonal, 0.0) + least)
        for row in self.system.arrays.body.tolist():
            n, o, first = row[at.NV], row[at.BLOCK], row[at.VEL]
            if n == 0:
                continue
            part = slice(first, first + n)
            column = scale[part, None]
            W = blocks[o : o + n * n].reshape(n, n) * column * scale[part]
            W += np.diag(least[part] * scale[part] ** 2)
            kept = self.kept[part]
            W[np.not_equal.outer(kept, kept)] = 0.0
            column = np.where(kept[:, None], KEPT, 1.0) * column
            inertias, directions = np.linalg.eigh(W)
            yield part, column * directions / np.sqrt(np.maximum(inertias, NO_INERTIA))


def _diagonals(system: System) -> np.ndarray:
    """Where those of the blocks of all bodies stand, (n velocities,)."""
    places = [
        row[at.BLOCK] + (row[at.NV] + 1) * np.arange(row[at.NV])
        for row in system.arrays.body
    ]
    return np.concatenate(places)


def close(state: State, independent: float = RANK_TOLERANCE) -> float:
    """Moves the state onto the constraints; how far they stay open.

    independent : see `State.smallest`
    """
    opening = state.opening
    for _ in range(ITERATIONS):
        if opening <= CLOSED:
            break
        step, _ = state.smallest(-state.residual, independent)
        base, base_opening, fraction = state.z.copy(), opening, 1.0
        frame = state.work.frame.copy()
        while fraction > 1e-4:
            state.z[:] = base
            retract(state.system.arrays, frame, state.z, fraction * step)
            state.evaluate()
            opening = state.opening
            if opening < base_opening:
                break
            fraction *= 0.5
        else:
            state.z[:] = base
            state.evaluate()
            return base_opening
    return opening


def _free_coordinates(system: System) -> Array:
    """True for velocity coordinates of bodies that the assembly may move."""
    free = np.ones(system.n_velocities, bool)
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.of_scene and system.scene.bodies[data.name].initial.fixed:
            free[row[at.VEL] : row[at.VEL] + row[at.NV]] = False
    return free


def of_length_one(C: Array) -> Array:
    """The rows (n, m) divided by their lengths, those of nothing as they are."""
    lengths = np.sqrt((C * C).sum(axis=1))
    return C / np.where(lengths > 0.0, lengths, 1.0)[:, None]


def dense_jacobian(system: System, C: Array) -> Array:
    """The constraint Jacobian as a dense (rows, velocities) matrix."""
    rows, columns, values = jacobian_entries(system, C)
    shape = system.n_rows, system.n_velocities
    places = rows * shape[1] + columns
    found = np.bincount(places, values, shape[0] * shape[1])
    return np.asarray(found, float).reshape(shape)


def dense_jacobians(system: System, C: Array) -> Array:
    """Those of some states, (nt, rows, velocities), from the rows of C."""
    dense = np.zeros((len(C), system.n_rows, system.n_velocities))
    rows, columns, values = jacobian_entries(system, C)
    places: Any = (slice(None), rows, columns)
    np.add.at(dense, places, values)
    return dense


def sliding_directions(system: System, C: Array) -> Array:
    """Derivatives of the coordinates with friction, (frictions, velocities)."""
    arrays = system.arrays
    along = np.zeros((len(system.rubbing), system.n_velocities))
    for j, b, offset in arrays.sliding.segment:
        n, u = arrays.body[b, at.NV], arrays.body[b, at.VEL]
        along[j, u : u + n] += C[offset : offset + n]
    return along


def names_of_rows(system: System, rows: tuple[int, ...]) -> list[str]:
    """The joints and drives that constraint rows belong to."""
    return [
        next(r.name for r in system.rows if r.first <= i < r.first + r.count)
        for i in rows
    ]


def widest_open(system: System, residual: Array) -> str:
    """Names the constraints with the largest residuals, relative to their sizes."""
    relative = np.abs(residual) / row_sizes(system)
    parts: dict[str, int] = {}
    for row in system.rows:
        worst = row.first + int(np.argmax(relative[row.first : row.first + row.count]))
        if relative[worst] >= relative[parts.get(row.name, worst)]:
            parts[row.name] = worst
    largest = max(relative[row] for row in parts.values())
    names = sorted(parts, key=lambda name: -relative[parts[name]])[:3]
    names = [name for name in names if relative[parts[name]] > 1e-6 * largest]
    return ", ".join(
        f"{name} is open by {abs(residual[parts[name]]):.3g}" for name in names
    )
