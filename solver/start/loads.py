"""Friction of joints at the start: determined by the motion, or refused by name.

Joints whose motion drives prescribe rub, too: what moves them takes that. At rest they
do not stick, for the drives hold them, and what part of that friction would bear is
known to nobody: it counts as none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from ..space import layout as at
from ..system import kernel_calls
from ..system.scene import System
from ..system.sizes import coordinate_sizes, resting_rates, row_sizes
from .consistent import State, names_of_rows, sliding_directions
from .overconstraint import complete
from .stated import Start

#: Constraints that follow from others but for the rounding of data, and the part of a
#: load that such rounding may have.
DEPENDENT, SHARE = 1e-6, 1e-6


def with_prescribed_friction(
    system: System, start: Start, driven: Array | None = None
) -> System:
    """The system that knows the motions of which joints with friction are prescribed.

    driven : (n,) True for the velocity coordinates that move, default all

    Raises
    ------
    InputError : the load of a joint is statically indeterminate; a joint with friction
        cannot move.
    """
    if not system.rubbing:
        return system
    state = State(complete(system), start)
    sizes = row_sizes(system)
    scale = coordinate_sizes(system) * (1.0 if driven is None else driven)
    C = state.jacobian() * scale / sizes[:, None]
    joints = np.ones(system.n_rows, bool)
    for row in system.rows:
        if row.name in system.scene.drives:
            joints[row.first : row.first + row.count] = False
    led = _held(state, C, scale, np.ones(system.n_rows, bool))
    stuck = led & _held(state, C, scale, joints)
    for j in np.flatnonzero(stuck):
        name = system.rubbing[j].joint
        raise InputError(
            f"{name} has friction, but other joints keep it from moving",
            place=f"joints.{name}.friction",
            expected="a joint that can slide, or no friction",
        )
    _refuse_shared_loads(system, _parts(C)[0], sizes)
    grip = system.arrays.grip.copy()
    grip[:, at.LED] = np.where(led, resting_rates(system), 0.0)
    return replace(system, arrays=system.arrays.replaced(grip=grip))


def _parts(C: Array) -> tuple[Array, Array]:
    """Sums of rows that vanish, and what the rows leave free."""
    left, values, right = np.linalg.svd(C, full_matrices=True)
    rank = int(np.sum(values > DEPENDENT * max(1.0, values.max(initial=0.0))))
    return left[:, rank:], right[rank:]


def _held(
    state: State, C: Array, scale: Array, rows: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which coordinates with friction some of the rows hold, (frictions,).

    To second order: where a mechanism stands at its dead point, others rest for an
    instant, but are not held.
    """
    along = sliding_directions(state.system, state.work.C) * scale
    _, free = _parts(C[rows])
    largest = np.abs(along).max(axis=1, initial=0.0)
    held = np.abs(along @ free.T).max(axis=1, initial=0.0) <= DEPENDENT * largest
    if not held.any() or not len(free):
        return np.asarray(held, bool)
    motion = free.T @ np.random.default_rng(0).normal(size=len(free))
    bent, bent_along = _curvatures(state, scale * motion)
    right = bent[rows] / row_sizes(state.system)[rows]
    a = np.linalg.lstsq(C[rows], right, rcond=DEPENDENT)[0]
    moved = np.abs(along @ a - bent_along)
    return np.asarray(held & (moved <= DEPENDENT * largest * (motion @ motion)), bool)


def _curvatures(state: State, v: Array) -> tuple[Array, Array]:
    """What accelerations of constraints and of coordinates with friction are quadratic
    in velocities v, with a minus; (rows,) and (frictions,)."""
    work, found = state.work, []
    for sign in (1.0, -1.0, 0.0):
        kernel_calls.evaluate(state.system, work, state.t, state.z, sign * v)
        rows = work.row[:, at.C_GAMMA], work.sliding.row[:, at.C_GAMMA]
        found.append([np.array(part) for part in rows])
    (a, b), (c, d), (e, f) = found
    return 0.5 * (a + c) - e, 0.5 * (b + d) - f


def _refuse_shared_loads(system: System, shared: Array, sizes: Array) -> None:
    for rub in system.rubbing:
        rows = list(rub.rows)
        open_ = rub.weights.reshape(-1, len(rows)) / sizes[rows]
        loads = np.abs(open_ @ shared[rows]).max(initial=0.0)
        if loads <= SHARE * np.abs(open_).max():
            continue
        involved = np.abs(shared).max(axis=1) > SHARE
        indices = tuple(int(i) for i in np.flatnonzero(involved))
        names = ", ".join(dict.fromkeys(names_of_rows(system, indices)))
        raise InputError(
            f"the load of {rub.joint} is statically indeterminate, so that its "
            f"friction is not known: {names} share it in any proportion",
            place=f"joints.{rub.joint}.friction",
            expected="joints without redundant constraints, or a force of type "
            "friction, which has a limit of its own",
        )
