"""Friction of joints at the start: determined by the motion, or refused with its name.

Joints whose motion drives prescribe have friction, too, which adds to the force of the
drive. At rest they do not stick, as the drives hold them, and the part that friction
would bear is undetermined: it is taken as zero.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..system import work_arrays
from ..system.characteristic_sizes import (
    constraint_sizes,
    coordinate_sizes,
    resting_rates,
)
from ..system.system import System
from .constraint_jacobian import InitialState, friction_directions, row_names
from .contradictions import undeformed_state
from .given_state import StateVectors
from .overconstraint import restore_constraints

#: Constraints that follow from others but for the rounding of data, and the part of a
#: load that such rounding may have.
DEPENDENCE_TOLERANCE, LOAD_SHARE_TOLERANCE = 1e-6, 1e-6


def with_prescribed_friction(
    system: System, start: StateVectors, driven: Array | None = None
) -> System:
    """The system that knows the motions of which joints with friction are prescribed.

    Parameters
    ----------
    driven : (n,)
        True for the velocity coordinates that move, default all.

    Raises
    ------
    InputError
        The load of a joint is statically indeterminate; a joint with friction cannot
        move.
    """
    if not system.friction_joints:
        return system
    state = InitialState(restore_constraints(system), start)
    sizes = constraint_sizes(system)
    scale = coordinate_sizes(system) * (1.0 if driven is None else driven)
    C = state.dense_jacobian() * scale / sizes[:, None]
    is_prescribed = _is_prescribed(state, C, scale, np.ones(system.n_rows, bool))
    is_locked = is_prescribed
    if is_prescribed.any():
        is_locked = is_prescribed & _are_held_by_joints(system, start)
    for j in np.flatnonzero(is_locked):
        name = system.friction_joints[j].joint
        raise InputError(
            f"{name} has friction, but other joints keep it from moving",
            place=f"joints.{name}.friction",
            expected="a joint that can slide, or no friction",
        )
    _refuse_indeterminate_loads(system, _null_spaces(C)[0], sizes)
    friction_state = system.arrays.friction_state.copy()
    friction_state[:, at.REST_RATE] = np.where(
        is_prescribed, resting_rates(system), 0.0
    )
    return replace(system, arrays=system.arrays.replaced(friction_state=friction_state))


def _are_held_by_joints(system: System, start: StateVectors) -> NDArray[np.bool_]:
    """Which coordinates with friction would stay without drives, (frictions,).

    Seen in the scene with all of its joints, where bodies that drives move have
    coordinates, too.
    """
    state = undeformed_state(system, system.scene.time.start, start.z, start.v)
    full = state.system
    scale = coordinate_sizes(full)
    C = state.dense_jacobian() * scale / constraint_sizes(full)[:, None]
    rows = np.ones(full.n_rows, bool)
    for row in full.rows:
        if row.name in full.scene.drives:
            rows[row.first : row.first + row.count] = False
    return _is_prescribed(state, C, scale, rows)


def _null_spaces(C: Array) -> tuple[Array, Array]:
    """Sums of rows that vanish, and what the rows leave free."""
    left, values, right = np.linalg.svd(C, full_matrices=True)
    rank = int(
        np.sum(values > DEPENDENCE_TOLERANCE * max(1.0, values.max(initial=0.0)))
    )
    return left[:, rank:], right[rank:]


def _is_prescribed(
    state: InitialState, C: Array, scale: Array, rows: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which coordinates with friction some of the rows hold, (frictions,).

    To second order: where a mechanism is at its dead point, others rest for an
    instant, but are not held.
    """
    directions = friction_directions(state.system, state.work.C) * scale
    _, free = _null_spaces(C[rows])
    largest = np.abs(directions).max(axis=1, initial=0.0)
    is_held = (
        np.abs(directions @ free.T).max(axis=1, initial=0.0)
        <= DEPENDENCE_TOLERANCE * largest
    )
    if not is_held.any() or not len(free):
        return np.asarray(is_held, bool)
    motion = free.T @ np.random.default_rng(0).normal(size=len(free))
    curvature, curvature_along = _curvatures(state, scale * motion)
    right = curvature[rows] / constraint_sizes(state.system)[rows]
    a = np.linalg.lstsq(C[rows], right, rcond=DEPENDENCE_TOLERANCE)[0]
    differences = np.abs(directions @ a - curvature_along)
    return np.asarray(
        is_held & (differences <= DEPENDENCE_TOLERANCE * largest * (motion @ motion)),
        bool,
    )


def _curvatures(state: InitialState, v: Array) -> tuple[Array, Array]:
    """What accelerations of constraints and of coordinates with friction are quadratic
    in velocities v, with a minus; (rows,) and (frictions,)."""
    work, curvatures = state.work, []
    for sign in (1.0, -1.0, 0.0):
        work_arrays.evaluate(state.system, work, state.t, state.z, sign * v)
        rows = work.row[:, at.C_GAMMA], work.friction_subsystem.row[:, at.C_GAMMA]
        curvatures.append([np.array(part) for part in rows])
    (a, b), (c, d), (e, f) = curvatures
    return 0.5 * (a + c) - e, 0.5 * (b + d) - f


def _refuse_indeterminate_loads(
    system: System, dependencies: Array, sizes: Array
) -> None:
    for friction_joint in system.friction_joints:
        rows = list(friction_joint.rows)
        scaled_weights = friction_joint.weights.reshape(-1, len(rows)) / sizes[rows]
        loads = np.abs(scaled_weights @ dependencies[rows]).max(initial=0.0)
        if loads <= LOAD_SHARE_TOLERANCE * np.abs(scaled_weights).max():
            continue
        involved = np.abs(dependencies).max(axis=1) > LOAD_SHARE_TOLERANCE
        indices = tuple(int(i) for i in np.flatnonzero(involved))
        names = ", ".join(dict.fromkeys(row_names(system, indices)))
        raise InputError(
            f"the load of {friction_joint.joint} is statically indeterminate, so that "
            f"its friction is not known: {names} share it in any proportion",
            place=f"joints.{friction_joint.joint}.friction",
            expected="joints without redundant constraints, or a force of type "
            "friction, which has a limit of its own",
        )
