"""Redundant constraints, distinguished from singular configurations.

Constraints that depend on others here and in all neighbouring positions get a
regularisation, so that they share their force. The multipliers of redundant
constraints are those of minimum norm.
"""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..dynamics.equations_of_motion import kernel_pointers
from ..integrators import output_sampling
from ..spatial import system_arrays as at
from ..spatial.coordinates import retract
from ..spatial.system_arrays import WorkArrays
from ..system.characteristic_sizes import constraint_sizes, coordinate_sizes
from ..system.newton_pattern import with_regularisation
from ..system.system import System
from ..system.work_arrays import raise_pending
from .constraint_jacobian import (
    RANK_TOLERANCE,
    InitialState,
    assemble_position,
    dense_jacobians,
    row_names,
)
from .contradictions import later_contradiction
from .overconstraint import restore_constraints
from .sparse_jacobian import (
    CLEARLY_INDEPENDENT,
    LARGE_SCENE_ROWS,
    RowRange,
    scaled_sparse_jacobian,
    sparse_constraint_jacobian,
)

#: How far beside the start constraints are looked at, relative to all sizes.
OFFSET = 1e-3
#: What may stay open there, relative to the sizes of the constraints. Beside a singular
#: position the square of the least singular value does, where that is no more counted.
MAX_RESIDUAL = 1e-8
#: Rows that depend on each other do so up to this many times what is open.
DEPENDENCE_FACTOR = 10.0
#: Slack relative to the Schur complement.
REGULARISATION = 1e-7
#: Rows have a part in a dependency when their share of it is larger.
INVOLVED_SHARE = 1e-6
#: What is left of a free direction is rounding below.
ROUNDING = 1e-10
#: Speeds below this part of the size of the mechanism during the run are rest.
REST_SPEED = 1e-9

#: Square of the part of a multiplier in the null space of C^T that is no rounding.
UNDETERMINED_PART = 1e-10
#: Entries of dense Jacobians of states that are looked at together.
MAX_ENTRIES = 1_000_000


def mark_redundant_constraints(state: InitialState) -> System:
    """The system with slack for constraints that follow from the others.

    Raises
    ------
    InputError
        Constraints contradict each other, or the start is a singular configuration from
        which the motion is not determined.
    """
    system = state.system
    dependent = () if state.is_independent else _dependent_rows(state)
    if not dependent:
        return system
    redundant = _dependent_near_start(state, dependent)
    singular = tuple(sorted(set(dependent) - set(redundant)))
    if len(redundant) < len(dependent):
        _check_singular_start(state, singular or dependent)
    else:
        _check_accelerations(state, redundant)
    if not redundant:
        return system
    regularisation = _regularisation(state)
    return replace(
        system,
        redundant=redundant,
        arrays=with_regularisation(system.arrays, regularisation),
    )


def _dependent_rows(
    state: InitialState, rank_tolerance: float = RANK_TOLERANCE
) -> tuple[int, ...]:
    """Rows that follow from the others: those that pivoting leaves for the last.

    Parameters
    ----------
    rank_tolerance
        Rows do not follow from others by more than this relative size.
    """
    rows = state.classified_rows(rank_tolerance)
    if rows is not None:
        return tuple(map(int, np.flatnonzero(rows.dependent)))
    matrix = state.scaled_jacobian()
    n_rows, n_columns = matrix.shape
    if not n_columns:
        return tuple(range(n_rows))
    sizes = np.linalg.svd(matrix, compute_uv=False)
    bound = rank_tolerance * max(1.0, sizes.max(initial=0.0))
    if n_rows <= n_columns and np.all(sizes > bound):
        return ()
    from scipy.linalg import qr  # a third of a second that few scenes need

    _, R, order = qr(matrix.T, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    rank = int(np.sum(pivots > bound))
    return tuple(sorted(int(i) for i in order[rank:]))


def _dependent_near_start(
    state: InitialState, dependent: tuple[int, ...]
) -> tuple[int, ...]:
    """Rows that depend on the others also where the mechanism can move to.

    With its velocity, and by a mixture of all free directions, now and later.
    """
    z, t, frames = state.z.copy(), state.t, state.work.frame.copy()
    later_time = t + OFFSET * (state.system.breaks[0] - t)
    free = _free_direction(state)
    trials = [(free, t), (free, later_time)]
    if not _is_at_rest(state):
        later = t + OFFSET / state.speed
        trials.insert(0, ((later - t) * state.v, later))
    for step, time in trials:
        state.z[:], state.t = z, time
        retract(state.system.arrays, frames, state.z, step)
        state.evaluate()
        residual = assemble_position(state)
        if residual < MAX_RESIDUAL:
            dependent_there = _dependent_rows(
                state, max(RANK_TOLERANCE, DEPENDENCE_FACTOR * residual)
            )
            dependent = min(dependent, dependent_there, key=len)
    state.z[:], state.t = z, t
    state.evaluate()
    return dependent


def _is_at_rest(state: InitialState) -> bool:
    return state.speed * state.duration < REST_SPEED


def _free_direction(state: InitialState) -> Array:
    """A mixture of all small motions that the constraints allow."""
    rows = state.classified_rows()
    if rows is not None:
        step = np.cos(np.arange(state.system.n_velocities))
        step -= rows.solve_independent(rows.matrix @ step)
        step[np.abs(step) < ROUNDING] = 0.0
    else:
        _, sizes, right = np.linalg.svd(state.scaled_jacobian())
        rank = int(np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))))
        free = right[rank:]
        step = np.cos(np.arange(len(free))) @ free
    size = float(np.max(np.abs(step), initial=0.0))
    return OFFSET * step * coordinate_sizes(state.system) / max(size, 1e-300)


def _regularisation(state: InitialState) -> Array:
    """A small part of the diagonal of C M^-1 C^T, in all rows that depend on others.

    Slack in single rows would do as long as just these follow from the others, which
    changes while the mechanism moves. That of all rows is small enough for refinement
    to remove its effect, and large against what stages of a step leave open.
    """
    rows = state.classified_rows()
    if rows is not None and rows.has_clear_columns:
        scaled_rows = (
            sparse_constraint_jacobian(state.system, state.work.C) @ state.metric_root()
        )
        diagonal = scaled_rows.multiply(scaled_rows).sum(axis=1)
        shares = rows.column_range.dependence_shares(len(diagonal))
    else:
        C = state.dense_jacobian()
        for part, root in state.metric_roots():
            C[:, part] = C[:, part] @ root
        diagonal = np.sum(C**2, axis=1)
        vectors, sizes, _ = np.linalg.svd(state.scaled_jacobian())
        rank = np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0)))
        shares = np.linalg.norm(vectors[:, int(rank) :], axis=1)
    typical = float(np.median(diagonal[diagonal > 0.0])) if diagonal.any() else 1.0
    regularisation = np.where(diagonal > 0.0, REGULARISATION * diagonal, typical)
    return np.where(shares > INVOLVED_SHARE, regularisation, 0.0)


def _can_accelerate(state: InitialState) -> bool:
    """True when accelerations exist that all constraints demand."""
    gamma = state.work.row[:, at.C_GAMMA] / state.sizes
    rows = state.classified_rows()
    if rows is not None:
        right_side = gamma * state.sizes
        open_rows = (
            rows.matrix @ rows.solve_independent(right_side) - right_side
        ) / state.sizes
    else:
        C = (
            state.dense_jacobian()
            * coordinate_sizes(state.system)
            / state.sizes[:, None]
        )
        open_rows = C @ np.linalg.lstsq(C, gamma, rcond=RANK_TOLERANCE)[0] - gamma
    residual = float(np.max(np.abs(open_rows), initial=0.0))
    size = max(1.0 / state.duration**2, float(np.max(np.abs(gamma), initial=0.0)))
    return residual <= 1e-7 * size


def _check_accelerations(state: InitialState, redundant: tuple[int, ...]) -> None:
    if _can_accelerate(state):
        return
    names = ", ".join(dict.fromkeys(row_names(state.system, redundant)))
    why = later_contradiction(state.system, state.t, state.z, state.v)
    raise InputError(
        "the mechanism is over-constrained: "
        f"{why or names + ' cannot be accelerated as the others demand'}",
        place="joints",
        expected="as many constraints as the mechanism can follow",
    )


def _check_singular_start(state: InitialState, rows: tuple[int, ...]) -> None:
    """A mechanism may start in a singular configuration if it moves on in one way."""
    names = ", ".join(dict.fromkeys(row_names(state.system, rows)))
    if _is_at_rest(state):
        raise InputError(
            f"the mechanism rests in a singular position ({names}): it could move on "
            "in several ways",
            place="bodies.*.initial",
            expected="initial velocities that choose one, or a start beside it",
        )
    if not _can_accelerate(state):
        why = later_contradiction(state.system, state.t, state.z, state.v)
        raise InputError(
            f"the mechanism starts in a singular position ({names}) with velocities "
            "that lead nowhere: "
            f"{why or 'no accelerations keep the joints together'}",
            place="bodies.*.initial",
            expected="velocities of a motion through this position, or a start "
            "beside it",
        )


def minimum_norm_multipliers(
    system: System,
    work: WorkArrays,
    times: Array,
    z: Array,
    v: Array,
    multipliers: Array,
) -> tuple[Array, tuple[int, ...]]:
    """Multipliers (nt, rows) of the states z, v at some times, without what lies in the
    null space of C^T; and the rows that have a part in it, which the motion does not
    determine."""
    result, known_part = multipliers.copy(), np.ones(system.n_rows)
    full, is_large = restore_constraints(system), system.n_rows >= LARGE_SCENE_ROWS
    numbers = max(1, system.n_rows * system.n_velocities)
    block = 1 if is_large else max(1, MAX_ENTRIES // numbers)
    for first in range(0, len(times), block):
        part = slice(first, first + block)
        states = times[part], z[part], v[part]
        C, solution = _state_jacobians(system, work, *states), None
        full_jacobians = C if full is system else _state_jacobians(full, work, *states)
        if is_large and full_jacobians is C:
            solution = _sparse_minimum_norm(system, C[0], multipliers[part])
        if solution is None:
            solution = _dense_minimum_norm(system, C, full_jacobians, multipliers[part])
        result[part], determined = solution
        known_part = np.minimum(known_part, determined)
    return result, tuple(map(int, np.flatnonzero(1.0 - known_part > UNDETERMINED_PART)))


def _state_jacobians(
    system: System, work: WorkArrays, times: Array, z: Array, v: Array
) -> Array:
    """`WorkArrays.C` of some states, (nt, .)."""
    jacobians = np.zeros((len(times), len(work.C)))
    interval_times = system.clocks(times)
    output_sampling.evaluate_jacobians(
        kernel_pointers(system.planar),
        system.arrays,
        work,
        times,
        interval_times,
        z,
        v,
        jacobians,
    )
    raise_pending(system)
    return jacobians


def _dense_minimum_norm(
    system: System, C: Array, full_jacobians: Array, multipliers: Array
) -> tuple[Array, Array]:
    """The smallest multipliers of some states (nt, rows), and of each row the least
    part (rows,) that the motion determines.

    Parameters
    ----------
    full_jacobians
        C where no constraint is left out.
    """
    rows, columns = constraint_sizes(system), coordinate_sizes(system)
    rank = system.n_rows - len(system.redundant)
    scaled = dense_jacobians(system, full_jacobians) * columns / rows[:, None]
    left, sizes, right = np.linalg.svd(scaled, full_matrices=False)
    largest = np.maximum(1.0, sizes.max(axis=1, initial=0.0))
    sizes = sizes[:, :rank]
    known = sizes > RANK_TOLERANCE * largest[:, None]
    determined = left[:, :, :rank] * known[:, None, :]
    if full_jacobians is C:
        determined_part = np.einsum("krn,kr->kn", determined, multipliers * rows)
    else:
        force = np.einsum("kru,kr->ku", dense_jacobians(system, C), multipliers)
        determined_part = np.einsum("knu,ku->kn", right[:, :rank], columns * force)
        determined_part /= np.where(known, sizes, np.inf)
    least = np.einsum("krn,kn->kr", determined, determined_part) / rows
    return least, np.sum(determined**2, axis=2).min(axis=0, initial=1.0)


def _sparse_minimum_norm(
    system: System, C: Array, multipliers: Array
) -> tuple[Array, Array] | None:
    """The same for one state of a large scene; None where its rows are not clear."""
    sizes = constraint_sizes(system)
    B = scaled_sparse_jacobian(system, C).multiply(1.0 / sizes[:, None]).tocsr()
    column_range = RowRange(B, CLEARLY_INDEPENDENT)
    if not column_range.remove_components or column_range.rank != system.n_rows - len(
        system.redundant
    ):
        return None
    least = column_range.project(multipliers[0] * sizes) / sizes
    return least[None], 1.0 - column_range.dependence_shares(system.n_rows) ** 2
