"""Redundant constraints, told apart from singular positions.

Constraints that follow from the others, wherever the mechanism moves, are redundant:
they and those others get slack on the diagonal of the Schur complement, which picks
multipliers out of the many that do. In a singular position constraints depend on each
other as well, but not beside it; there, nothing may be left out. So what depends on the
others at the start is looked at again a little later.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.coordinates import retract
from ..system.newton_rows import with_slack
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .conflicts import conflict_soon
from .consistent import RANK_TOLERANCE, State, close, names_of_rows
from .large_scenes import sparse_jacobian

#: How far beside the start constraints are looked at, relative to all sizes.
BESIDE = 1e-3
#: What may stay open there, relative to the sizes of the constraints. Beside a singular
#: position the square of the least singular value does, where that is no more counted.
REACHED = 1e-8
#: Rows that depend on each other do so up to this many times what is open.
OPEN = 10.0
#: Slack relative to the Schur complement.
SLACK = 1e-7
#: Rows have a part in a dependency when their share of it is larger.
INVOLVED = 1e-6
#: What is left of a free direction is rounding below.
ROUNDING = 1e-10
#: Speeds below this part of the size of the mechanism during the run are rest.
REST = 1e-9


def mark_redundant(state: State) -> System:
    """The system with slack for constraints that follow from the others.

    Raises
    ------
    InputError : constraints contradict each other, or the start is a singular position
        from which the motion is not determined.
    """
    system = state.system
    dependent = () if state.is_apart else _dependent_rows(state)
    if not dependent:
        return system
    redundant = _dependent_beside(state, dependent)
    singular = tuple(sorted(set(dependent) - set(redundant)))
    if len(redundant) < len(dependent):
        _check_singular_start(state, singular or dependent)
    else:
        _check_accelerations(state, redundant)
    if not redundant:
        return system
    slack = _slack(state)
    return replace(system, redundant=redundant, arrays=with_slack(system.arrays, slack))


def _dependent_rows(
    state: State, independent: float = RANK_TOLERANCE
) -> tuple[int, ...]:
    """Rows that follow from the others: those that pivoting leaves for the last.

    independent : rows do not follow from others by more than this relative size
    """
    rows = state.clear_rows(independent)
    if rows is not None:
        return tuple(map(int, np.flatnonzero(rows.dependent)))
    matrix = state.scaled_jacobian()
    n_rows, n_columns = matrix.shape
    if not n_columns:
        return tuple(range(n_rows))
    sizes = np.linalg.svd(matrix, compute_uv=False)
    bound = independent * max(1.0, sizes.max(initial=0.0))
    if n_rows <= n_columns and np.all(sizes > bound):
        return ()
    from scipy.linalg import qr  # a third of a second that few scenes need

    _, R, order = qr(matrix.T, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    rank = int(np.sum(pivots > bound))
    return tuple(sorted(int(i) for i in order[rank:]))


def _dependent_beside(state: State, dependent: tuple[int, ...]) -> tuple[int, ...]:
    """Rows that depend on the others also where the mechanism can move to.

    With its velocity, and by a mixture of all free directions, now and later.
    """
    z, t, frames = state.z.copy(), state.t, state.work.frame.copy()
    soon = t + BESIDE * (state.system.breaks[0] - t)
    free = _free_direction(state)
    places = [(free, t), (free, soon)]
    if not _at_rest(state):
        later = t + BESIDE / state.speed
        places.insert(0, ((later - t) * state.v, later))
    for step, when in places:
        state.z[:], state.t = z, when
        retract(state.system.arrays, frames, state.z, step)
        state.evaluate()
        opening = close(state)
        if opening < REACHED:
            found = _dependent_rows(state, max(RANK_TOLERANCE, OPEN * opening))
            dependent = min(dependent, found, key=len)
    state.z[:], state.t = z, t
    state.evaluate()
    return dependent


def _at_rest(state: State) -> bool:
    return state.speed * state.duration < REST


def _free_direction(state: State) -> Array:
    """A mixture of all small motions that the constraints allow."""
    rows = state.clear_rows()
    if rows is not None:
        step = np.cos(np.arange(state.system.n_velocities))
        step -= rows.meeting(rows.given @ step)
        step[np.abs(step) < ROUNDING] = 0.0
    else:
        _, sizes, right = np.linalg.svd(state.scaled_jacobian())
        rank = int(np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))))
        free = right[rank:]
        step = np.cos(np.arange(len(free))) @ free
    size = float(np.max(np.abs(step), initial=0.0))
    return BESIDE * step * coordinate_sizes(state.system) / max(size, 1e-300)


def _slack(state: State) -> Array:
    """A small part of the diagonal of C M^-1 C^T, in all rows that depend on others.

    Slack in single rows would do as long as just these follow from the others, which
    changes while the mechanism moves. That of all rows is small enough for refinement
    to remove its effect, and large against what stages of a step leave open.
    """
    rows = state.clear_rows()
    if rows is not None and rows.has_clear_columns:
        moved = sparse_jacobian(state.system, state.work.C) @ state.root()
        diagonal = moved.multiply(moved).sum(axis=1)
        shares = rows.reached.shares(len(diagonal))
    else:
        C = state.jacobian()
        for part, root in state.roots():
            C[:, part] = C[:, part] @ root
        diagonal = np.sum(C**2, axis=1)
        vectors, sizes, _ = np.linalg.svd(state.scaled_jacobian())
        rank = np.sum(sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0)))
        shares = np.linalg.norm(vectors[:, int(rank) :], axis=1)
    typical = float(np.median(diagonal[diagonal > 0.0])) if diagonal.any() else 1.0
    slack = np.where(diagonal > 0.0, SLACK * diagonal, typical)
    return np.where(shares > INVOLVED, slack, 0.0)


def _can_accelerate(state: State) -> bool:
    """True when accelerations exist that all constraints demand."""
    gamma = state.work.row[:, at.C_GAMMA] / state.sizes
    rows = state.clear_rows()
    if rows is not None:
        demanded = gamma * state.sizes
        open_rows = (rows.given @ rows.meeting(demanded) - demanded) / state.sizes
    else:
        C = state.jacobian() * coordinate_sizes(state.system) / state.sizes[:, None]
        open_rows = C @ np.linalg.lstsq(C, gamma, rcond=RANK_TOLERANCE)[0] - gamma
    left = float(np.max(np.abs(open_rows), initial=0.0))
    size = max(1.0 / state.duration**2, float(np.max(np.abs(gamma), initial=0.0)))
    return left <= 1e-7 * size


def _check_accelerations(state: State, redundant: tuple[int, ...]) -> None:
    if _can_accelerate(state):
        return
    names = ", ".join(dict.fromkeys(names_of_rows(state.system, redundant)))
    why = conflict_soon(state.system, state.t, state.z, state.v)
    raise InputError(
        "the mechanism is over-constrained: "
        f"{why or names + ' cannot be accelerated as the others demand'}",
        place="joints",
        expected="as many constraints as the mechanism can follow",
    )


def _check_singular_start(state: State, rows: tuple[int, ...]) -> None:
    """A mechanism may start in a singular position if it moves on in one way."""
    names = ", ".join(dict.fromkeys(names_of_rows(state.system, rows)))
    if _at_rest(state):
        raise InputError(
            f"the mechanism rests in a singular position ({names}): it could move on "
            "in several ways",
            place="bodies.*.initial",
            expected="initial velocities that choose one, or a start beside it",
        )
    if not _can_accelerate(state):
        why = conflict_soon(state.system, state.t, state.z, state.v)
        raise InputError(
            f"the mechanism starts in a singular position ({names}) with velocities "
            "that lead nowhere: "
            f"{why or 'no accelerations keep the joints together'}",
            place="bodies.*.initial",
            expected="velocities of a motion through this position, or a start "
            "beside it",
        )
