"""Constraints that depend on others except for rounding of the data.

Such constraints are left out, and a joint type that would do without them is
suggested.
"""

from dataclasses import replace
from itertools import combinations, islice

import numpy as np

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..spatial.coordinates import retract
from ..system import work_arrays
from ..system.characteristic_sizes import constraint_sizes, coordinate_sizes
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .constraint_jacobian import InitialState, assemble_position, row_names

#: Constraints of rotations.
ROTATION_CONSTRAINTS = (at.PERPENDICULAR, at.ANGLE)
#: What joints become without so many constraints of places and of rotations.
SUBSTITUTES = {
    ("revolute", 0, 1): "universal",
    ("revolute", 0, 2): "spherical",
    ("revolute", 1, 0): "cylindrical",
    ("revolute", 1, 2): "point_on_line",
    ("fixed", 0, 3): "spherical",
    ("spherical", 1, 0): "point_on_line",
    ("spherical", 2, 0): "point_on_plane",
    ("cylindrical", 0, 2): "point_on_line",
    ("prismatic", 0, 1): "cylindrical",
    ("prismatic", 0, 3): "point_on_line",
    ("universal", 0, 1): "spherical",
    ("planar", 0, 2): "point_on_plane",
}
PLANAR_SUBSTITUTES = {
    ("revolute", 1, 0): "point_on_line",
    ("fixed", 0, 1): "revolute",
    ("fixed", 1, 0): "prismatic",
    ("prismatic", 0, 1): "point_on_line",
}

#: Relative size, of what data leave open and of what is left of a constraint without
#: the others, that rounding may have.
DATA_ROUNDING = 1e-4
#: Constraints that are open by less are met as far as numbers allow, and with less of
#: their own they follow from the others exactly.
SATISFIED, EXACT_DEPENDENCE = 1e-12, 1e-13
#: Positions in which constraints are compared, and the way from one to the next in
#: radians or sizes of the mechanism.
POSITIONS, STEP_SIZE = 12, 0.15
#: Constraints have a part in a dependency when their share of it is larger.
INVOLVED_SHARE = 1e-3
#: Choices that are compared, and the part of the best one that is good as well.
MAX_CHOICES, EQUIVALENT = 5000, 0.1


def substitution_text(system: System, rows: tuple[int, ...]) -> str:
    """Joint types that would do without some rows, in words."""
    counts = dict.fromkeys(row_names(system, rows), 0)
    for name in row_names(system, rows):
        counts[name] += 1
    return ", ".join(
        f"{name} as a {freer} joint{_axes_text(system, rows, name, freer)}"
        if freer
        else f"{name} with {counts[name]} constraint{'s'[: counts[name] > 1]} less"
        for name, freer in sorted(joint_substitutes(system, rows).items())
    )


def _axes_text(system: System, rows: tuple[int, ...], name: str, freer: str) -> str:
    """The axes of a freer joint that keeps the other constraints of a joint.

    Other ones would make singular configurations of their own. Where nothing is said
    the joint keeps its axis.
    """
    removed: dict[int, list[Array]] = {at.DISPLACEMENT: [], at.PERPENDICULAR: []}
    remaining: dict[int, list[Array]] = {at.DISPLACEMENT: [], at.PERPENDICULAR: []}
    for con in system.arrays.constraint:
        row, kind = int(con[at.ROW]), int(con[at.KIND])
        if kind in removed and row_names(system, (row,)) == [name]:
            axes = removed if row in rows else remaining
            axes[kind].append(system.arrays.real_data[con[at.C_DATA] :][:6])
    joint_type = system.scene.joints[name].type
    if freer == "universal":
        axis, second = remaining[at.PERPENDICULAR][0].reshape(2, 3)
        return f" (axis = {_format_axis(axis)}, second_axis = {_format_axis(second)})"
    if joint_type not in ("revolute", "spherical", "fixed") or freer == "cylindrical":
        return ""
    slides = (remaining if freer == "point_on_plane" else removed)[at.DISPLACEMENT]
    if not slides:
        return ""
    axis = slides[0][:3]
    if system.planar:
        axis = np.array([np.cos(slides[0][0]), np.sin(slides[0][0])])
    return f" (axis = {_format_axis(axis)})"


def _format_axis(axis: Array) -> str:
    """Digits enough for a direction at right angles to another one."""
    return f"[{', '.join(f'{x:.10g}' for x in np.round(axis, 12) + 0.0)}]"


def joint_substitutes(system: System, rows: tuple[int, ...]) -> dict[str, str | None]:
    """Types that joints become without some of their rows; None for no standard one."""
    removed: dict[str, list[int]] = {}
    for row, name in zip(rows, row_names(system, rows), strict=True):
        removed.setdefault(name, []).append(
            row_kind(system, row) in ROTATION_CONSTRAINTS
        )
    substitutes = PLANAR_SUBSTITUTES if system.planar else SUBSTITUTES
    joints = system.scene.joints
    return {
        name: substitutes.get((joints[name].type, len(own) - sum(own), sum(own)))
        if name in joints
        else None
        for name, own in removed.items()
    }


def row_kind(system: System, row: int) -> int:
    """Kind of the primitive constraint that a row belongs to."""
    first = [con for con in system.arrays.constraint if con[at.ROW] <= row]
    return int(max(first, key=lambda con: con[at.ROW])[at.KIND])


def remove_redundant(state: InitialState, initial_z: Array) -> bool:
    """Leaves out constraints that follow from others but for rounding; whether it did.

    Parameters
    ----------
    initial_z
        Positions before they were moved onto the constraints.
    """
    if state.scaled_residual <= SATISFIED and not _are_nearly_dependent(state):
        return False
    assembled_z = state.z.copy()
    state.z[:] = initial_z
    state.evaluate()
    if assemble_position(
        state, DATA_ROUNDING
    ) <= DATA_ROUNDING and _remove_dependent_rows(state):
        return True
    state.z[:] = assembled_z
    state.evaluate()
    return False


def _are_nearly_dependent(state: InitialState) -> bool:
    """True if constraints nearly follow from others, as rounding makes it."""
    if state.has_independent_remainder(DATA_ROUNDING):
        return False
    sizes = np.asarray(np.linalg.svd(state.scaled_jacobian(), compute_uv=False), float)
    state.is_independent = len(sizes) == state.system.n_rows and bool(
        (sizes > DATA_ROUNDING).all()
    )
    if not _has_rounded_values(sizes):
        return False
    return _has_rounded_values(_scaled_decomposition(state)[1])


def _has_rounded_values(sizes: Array) -> bool:
    """True if there are singular values that may be those of rounding."""
    return bool(((sizes > EXACT_DEPENDENCE) & (sizes < DATA_ROUNDING)).any())


def restore_constraints(system: System) -> System:
    """The system with all of its constraints as the scene has them."""
    if system.full_constraints is None:
        return system
    none = np.zeros((0, at.N_INACTIVE_SEGMENT), np.int64)
    arrays = system.arrays.replaced(
        constraint=system.full_constraints, inactive_segments=none
    )
    return replace(system, arrays=arrays, full_constraints=None, inactive_rows=())


def largest_residual_of_removed(
    system: System, times: Array, z: Array, v: Array
) -> float:
    """How far constraints that were left out are open at most, relative to sizes."""
    full, work, largest = restore_constraints(system), new_work_arrays(system), 0.0
    sizes = constraint_sizes(full)
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.interval_time[0] = clock
        work_arrays.evaluate(full, work, t, z[k], v[k])
        relative = np.abs(work.row[:, at.C_VALUE]) / sizes
        largest = max(largest, float(relative.max(initial=0.0)))
    return largest


def _remove_dependent_rows(state: InitialState) -> bool:
    """Leaves out what depends on other constraints in all positions."""
    before = state.system
    state.system = _split_coincident_rows(before)
    state.evaluate()
    bases = _dependencies(state)
    count = min((basis.shape[1] for basis in bases), default=0)
    if count == 0:
        state.system = before
        return False
    bases = [basis for basis in bases if basis.shape[1] == count]
    state.system = _with_inactive_rows(
        state.system, _choose_rows(state.system, bases, count)
    )
    state.evaluate()
    return True


def _split_coincident_rows(system: System) -> System:
    """Coincident points as one constraint along each axis of the first marker.

    What is left out of them then rotates with the bodies, as their dependency does.
    """
    axes = np.eye(3)
    data = [[*axis, 0.0, 0.0, 0.0] for axis in axes]
    if system.planar:
        data = [[0.0, 0.0], [0.5 * np.pi, 0.0]]
    pool, table = list(system.arrays.real_data), []
    for con in system.arrays.constraint:
        if con[at.KIND] != at.COINCIDENT:
            table.append(con)
            continue
        for k, numbers in enumerate(data):
            row = con.copy()
            row[[at.KIND, at.C_DATA]] = at.DISPLACEMENT, len(pool)
            row[at.ROW] += k
            for side in (at.SEG_A, at.SEG_B):
                row[side] += k * (con[side] >= 0)
            pool += numbers
            table.append(row)
    arrays = system.arrays.replaced(
        constraint=np.array(table, np.int64), real_data=np.array(pool)
    )
    return replace(system, arrays=arrays, full_constraints=system.arrays.constraint)


def _with_inactive_rows(system: System, rows: tuple[int, ...]) -> System:
    """The system without some constraint rows."""
    inactive = [
        (row, offset, system.arrays.body[b, at.NV])
        for row, b, offset in system.arrays.segment
        if row in rows
    ]
    table = np.array(inactive, np.int64).reshape(-1, at.N_INACTIVE_SEGMENT)
    return replace(
        system,
        arrays=system.arrays.replaced(inactive_segments=table),
        inactive_rows=rows,
    )


def _choose_rows(system: System, bases: list[Array], count: int) -> tuple[int, ...]:
    """Rows without which the others hold the mechanism well in the worst position.

    Of those that do so about as well as the best, what a joint of another type leaves
    out as well comes first, then rotations, which turn with the bodies.
    """
    from scipy.linalg import qr  # a third of a second that few scenes need

    share = np.max([np.linalg.norm(basis, axis=1) for basis in bases], axis=0)
    rows = [int(i) for i in np.flatnonzero(share > INVOLVED_SHARE)]
    owners = row_names(system, tuple(rows))
    passive = [i for i, n in zip(rows, owners, strict=True) if n in system.scene.joints]
    involved = passive if len(passive) >= count else rows
    rotation_rows = {i for i in involved if row_kind(system, i) in ROTATION_CONSTRAINTS}
    involved.sort(key=lambda i: i not in rotation_rows)
    pivoted = qr(bases[0][involved].T, mode="r", pivoting=True)[1][:count]
    first_choice = [[involved[i] for i in pivoted]]
    choices = np.array(
        [*first_choice, *islice(combinations(involved, count), MAX_CHOICES)], int
    )
    worst_values = np.min(
        [np.linalg.svd(basis[choices], compute_uv=False)[:, -1] for basis in bases],
        axis=0,
    )
    candidates = np.flatnonzero(worst_values >= EQUIVALENT * worst_values.max())

    def rank(k: int) -> tuple[int, int, float]:
        rows = tuple(int(i) for i in choices[k])
        named = sum(freer is None for freer in joint_substitutes(system, rows).values())
        return (
            named,
            -len(rotation_rows.intersection(rows)),
            -round(float(worst_values[k]), 6),
        )

    return tuple(int(i) for i in choices[min(map(int, candidates), key=rank)])


def _dependencies(state: InitialState) -> list[Array]:
    """Bases of the dependencies (rows, k), at the state and where it can move to.

    Along free motions both ways, and with the drives. None where nothing that it could
    move to keeps the joints together. The state is as before afterwards.
    """
    z, t, bases = state.z.copy(), state.t, [_dependency_basis(state)]
    can_move = False
    for sign in (1.0, -1.0):
        state.z[:], state.t = z, t
        state.evaluate()
        for _ in range(POSITIONS):
            step, duration = _next_step(state, sign)
            if not step.any():
                break
            can_move = True
            if not _move_along(state, step, duration):
                break
            bases.append(_dependency_basis(state))
    state.z[:], state.t = z, t
    state.evaluate()
    return bases if len(bases) > 1 or not can_move else []


def _next_step(state: InitialState, sign: float) -> tuple[Array, float]:
    """A step along a mixture of free motions and with the drives; how long it takes."""
    system, sizes = state.system, state.balanced_sizes()
    left, values, right = _scaled_decomposition(state)
    relative = sizes / coordinate_sizes(system)
    rank = int(np.sum(values > DATA_ROUNDING))
    free = right[rank:]
    step = np.cos(np.arange(len(free))) @ free
    step *= sign * STEP_SIZE / max(_max_abs(relative * step), 1e-300)
    if sign < 0.0:
        return step * sizes, 0.0
    zero_velocity = np.zeros(system.n_velocities)
    work_arrays.evaluate(system, state.work, state.t, state.z, zero_velocity)
    drift = state.work.row[:, at.C_RATE]
    norms = np.linalg.norm(state.dense_jacobian() * sizes, axis=1)
    scaled = drift / np.where(norms > 0.0, norms, 1.0)
    driven = -right[:rank].T @ ((left[:, :rank].T @ scaled) / values[:rank])
    speed = max(_max_abs(relative * driven), 1e-300)
    duration = min(STEP_SIZE / speed, (system.breaks[0] - state.t) / POSITIONS)
    return (step + duration * driven) * sizes, duration


def _max_abs(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _move_along(state: InitialState, step: Array, duration: float) -> bool:
    """Moves the state along a step, or a part of it; False if joints come apart."""
    z, t, frames = state.z.copy(), state.t, state.work.frame.copy()
    for part in (1.0, 0.5, 0.25, 0.125):
        state.z[:], state.t = z, t + part * duration
        retract(state.system.arrays, frames, state.z, part * step)
        state.evaluate()
        if assemble_position(state, DATA_ROUNDING) <= DATA_ROUNDING:
            return True
    return False


def _scaled_decomposition(state: InitialState) -> tuple[Array, Array, Array]:
    """U (rows, .), singular values and V^T of C for balanced sizes of coordinates.

    Rows have length 1; those that nothing can move are left out, zero in U.
    """
    C = state.dense_jacobian() * state.balanced_sizes()
    norms = np.linalg.norm(C, axis=1)
    active = norms > 0.0
    left, sizes, right = np.linalg.svd(C[active] / norms[active, None])
    full_left = np.zeros((len(C), left.shape[1]))
    full_left[active] = left
    return full_left, sizes, right


def _dependency_basis(state: InitialState) -> Array:
    """Orthonormal columns that C^T maps to less than rounding of data."""
    left, sizes, _ = _scaled_decomposition(state)
    return left[:, int(np.sum(sizes > DATA_ROUNDING)) :]
