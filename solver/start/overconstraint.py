"""Constraints that follow from the others but for the rounding of data.

Four revolute joints whose parallel axes are written with six digits close a loop that,
taken to the letter, cannot move: three of its constraints contradict the others by
1e-6. They are left out, so that the rest can be met exactly; the motion is that of a
mechanism whose joints have so much play. Which ones is decided by how well the others
hold the mechanism without them, in many of its positions.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, islice

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.coordinates import retract
from ..system import kernel_calls
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes
from ..system.storage import new_work
from .consistent import State, close, names_of_rows
from .freer_joints import TURNING, freer_joints, kind_of_row

#: Relative size, of what data leave open and of what is left of a constraint without
#: the others, that rounding may have.
ROUNDED = 1e-4
#: Constraints that are open by less are met as far as numbers allow, and with less of
#: their own they follow from the others exactly.
MET, EXACT = 1e-12, 1e-13
#: Positions in which constraints are compared, and the way from one to the next in
#: radians or sizes of the mechanism.
POSITIONS, WAY = 12, 0.15
#: Constraints have a part in a dependency when their share of it is larger.
INVOLVED = 1e-3
#: Choices that are compared, and the part of the best one that is good as well.
CHOICES, AS_GOOD = 5000, 0.1


def relax(state: State, guessed: Array) -> bool:
    """Leaves out constraints that follow from others but for rounding; whether it did.

    guessed : positions before they were moved onto the constraints
    """
    if state.opening <= MET and not _hardly_differ(state):
        return False
    kept = state.z.copy()
    state.z[:] = guessed
    state.evaluate()
    if close(state, ROUNDED) <= ROUNDED and _drop(state):
        return True
    state.z[:] = kept
    state.evaluate()
    return False


def _hardly_differ(state: State) -> bool:
    """Whether constraints nearly follow from others, as rounding makes it."""
    if state.stands_apart(ROUNDED):
        return False
    sizes = np.asarray(np.linalg.svd(state.scaled_jacobian(), compute_uv=False), float)
    state.is_apart = len(sizes) == state.system.n_rows and bool((sizes > ROUNDED).all())
    if not _are_rounded(sizes):
        return False
    return _are_rounded(_decomposed(state)[1])


def _are_rounded(sizes: Array) -> bool:
    """Whether there are singular values that may be those of rounding."""
    return bool(((sizes > EXACT) & (sizes < ROUNDED)).any())


def complete(system: System) -> System:
    """The system with all of its constraints as the scene has them."""
    if system.strict is None:
        return system
    none = np.zeros((0, at.N_DROPPED), np.int64)
    arrays = system.arrays.replaced(constraint=system.strict, dropped=none)
    return replace(system, arrays=arrays, strict=None, dropped=())


def widest_left_open(system: System, times: Array, z: Array, v: Array) -> float:
    """How far constraints that were left out are open at most, relative to sizes."""
    whole, work, widest = complete(system), new_work(system), 0.0
    sizes = row_sizes(whole)
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.clock[0] = clock
        kernel_calls.evaluate(whole, work, t, z[k], v[k])
        relative = np.abs(work.row[:, at.C_VALUE]) / sizes
        widest = max(widest, float(relative.max(initial=0.0)))
    return widest


def _drop(state: State) -> bool:
    """Leaves out what depends on other constraints in all positions."""
    before = state.system
    state.system = _in_marker_axes(before)
    state.evaluate()
    bases = _dependencies(state)
    count = min((basis.shape[1] for basis in bases), default=0)
    if count == 0:
        state.system = before
        return False
    bases = [basis for basis in bases if basis.shape[1] == count]
    state.system = _without(state.system, _choice(state.system, bases, count))
    state.evaluate()
    return True


def _in_marker_axes(system: System) -> System:
    """Coincident points as one constraint along each axis of the first marker.

    What is left out of them then turns with the bodies, as their dependency does.
    """
    axes = np.eye(3)
    data = [[*axis, 0.0, 0.0, 0.0] for axis in axes]
    if system.planar:
        data = [[0.0, 0.0], [0.5 * np.pi, 0.0]]
    pool, table = list(system.arrays.pool), []
    for con in system.arrays.constraint:
        if con[at.KIND] != at.COINCIDENT:
            table.append(con)
            continue
        for k, numbers in enumerate(data):
            row = con.copy()
            row[[at.KIND, at.C_DATA]] = at.ALONG, len(pool)
            row[at.ROW] += k
            for side in (at.SEG_A, at.SEG_B):
                row[side] += k * (con[side] >= 0)
            pool += numbers
            table.append(row)
    arrays = system.arrays.replaced(
        constraint=np.array(table, np.int64), pool=np.array(pool)
    )
    return replace(system, arrays=arrays, strict=system.arrays.constraint)


def _without(system: System, rows: tuple[int, ...]) -> System:
    """The system without some constraint rows."""
    pieces = [
        (row, offset, system.arrays.body[b, at.NV])
        for row, b, offset in system.arrays.segment
        if row in rows
    ]
    table = np.array(pieces, np.int64).reshape(-1, at.N_DROPPED)
    return replace(system, arrays=system.arrays.replaced(dropped=table), dropped=rows)


def _choice(system: System, bases: list[Array], count: int) -> tuple[int, ...]:
    """Rows without which the others hold the mechanism well in the worst position.

    Of those that do so about as well as the best, what a joint of another type leaves
    out as well comes first, then rotations, which turn with the bodies.
    """
    from scipy.linalg import qr  # a third of a second that few scenes need

    share = np.max([np.linalg.norm(basis, axis=1) for basis in bases], axis=0)
    rows = [int(i) for i in np.flatnonzero(share > INVOLVED)]
    owners = names_of_rows(system, tuple(rows))
    passive = [i for i, n in zip(rows, owners, strict=True) if n in system.scene.joints]
    involved = passive if len(passive) >= count else rows
    turning = {i for i in involved if kind_of_row(system, i) in TURNING}
    involved.sort(key=lambda i: i not in turning)
    pivoted = qr(bases[0][involved].T, mode="r", pivoting=True)[1][:count]
    found = [[involved[i] for i in pivoted]]
    choices = np.array([*found, *islice(combinations(involved, count), CHOICES)], int)
    worst = np.min(
        [np.linalg.svd(basis[choices], compute_uv=False)[:, -1] for basis in bases],
        axis=0,
    )
    good = np.flatnonzero(worst >= AS_GOOD * worst.max())

    def rank(k: int) -> tuple[int, int, float]:
        rows = tuple(int(i) for i in choices[k])
        named = sum(freer is None for freer in freer_joints(system, rows).values())
        return named, -len(turning.intersection(rows)), -round(float(worst[k]), 6)

    return tuple(int(i) for i in choices[min(map(int, good), key=rank)])


def _dependencies(state: State) -> list[Array]:
    """Bases of the dependencies (rows, k), at the state and where it can move to.

    Along free motions both ways, and with the drives. None where nothing that it could
    move to keeps the joints together. The state is as before afterwards.
    """
    z, t, found = state.z.copy(), state.t, [_dependency(state)]
    moves = False
    for sign in (1.0, -1.0):
        state.z[:], state.t = z, t
        state.evaluate()
        for _ in range(POSITIONS):
            step, duration = _way(state, sign)
            if not step.any():
                break
            moves = True
            if not _walk(state, step, duration):
                break
            found.append(_dependency(state))
    state.z[:], state.t = z, t
    state.evaluate()
    return found if len(found) > 1 or not moves else []


def _way(state: State, sign: float) -> tuple[Array, float]:
    """A step along a mixture of free motions and with the drives; how long it takes."""
    system, sizes = state.system, state.balanced_sizes()
    left, values, right = _decomposed(state)
    relative = sizes / coordinate_sizes(system)
    rank = int(np.sum(values > ROUNDED))
    free = right[rank:]
    step = np.cos(np.arange(len(free))) @ free
    step *= sign * WAY / max(_largest(relative * step), 1e-300)
    if sign < 0.0:
        return step * sizes, 0.0
    rest = np.zeros(system.n_velocities)
    kernel_calls.evaluate(system, state.work, state.t, state.z, rest)
    drift = state.work.row[:, at.C_RATE]
    norms = np.linalg.norm(state.jacobian() * sizes, axis=1)
    scaled = drift / np.where(norms > 0.0, norms, 1.0)
    driven = -right[:rank].T @ ((left[:, :rank].T @ scaled) / values[:rank])
    speed = max(_largest(relative * driven), 1e-300)
    duration = min(WAY / speed, (system.breaks[0] - state.t) / POSITIONS)
    return (step + duration * driven) * sizes, duration


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _walk(state: State, step: Array, duration: float) -> bool:
    """Moves the state along a step, or a part of it; False if joints come apart."""
    z, t, frames = state.z.copy(), state.t, state.work.frame.copy()
    for part in (1.0, 0.5, 0.25, 0.125):
        state.z[:], state.t = z, t + part * duration
        retract(state.system.arrays, frames, state.z, part * step)
        state.evaluate()
        if close(state, ROUNDED) <= ROUNDED:
            return True
    return False


def _decomposed(state: State) -> tuple[Array, Array, Array]:
    """U (rows, .), singular values and V^T of C for balanced sizes of coordinates.

    Rows have length 1; those that nothing can move are left out, zero in U.
    """
    C = state.jacobian() * state.balanced_sizes()
    norms = np.linalg.norm(C, axis=1)
    active = norms > 0.0
    left, sizes, right = np.linalg.svd(C[active] / norms[active, None])
    whole = np.zeros((len(C), left.shape[1]))
    whole[active] = left
    return whole, sizes, right


def _dependency(state: State) -> Array:
    """Orthonormal columns that C^T maps to less than rounding of data."""
    left, sizes, _ = _decomposed(state)
    return left[:, int(np.sum(sizes > ROUNDED)) :]
