"""Consistent initial conditions: positions and velocities that meet the constraints.

Positions are found by a damped Gauss-Newton iteration, velocities by one linear
projection, both with the smallest change in the metric M + tau^2 K and without moving
bodies that the user fixed. Redundant constraints are found by rank.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from formats.errors import InputError
from formats.scene import as_3d, rotation
from formats.sid import Array

from . import kernel_calls
from .alignment import align, check_alignment
from .bodies import quaternion
from .kernels import layout as at
from .kernels.coordinates import retract
from .kernels.newton import Memory
from .newton_rows import with_slack
from .scene import GROUND_NAME, System
from .storage import new_memory, new_work

ITERATIONS = 60
#: Times of each smooth interval at which prescribed frames are compared.
SAMPLES = 21
#: Rows of the constraint Jacobian count as dependent below this relative size.
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Start:
    """A consistent state: z_I and z_II."""

    z: Array
    v: Array


def guess(system: System) -> Start:
    """The state that the scene file states.

    Raises
    ------
    InputError : wrong number of elastic coordinates.
    """
    z, v = np.zeros(system.n_positions), np.zeros(system.n_velocities)
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.name == GROUND_NAME:
            continue
        initial = system.scene.bodies[data.name].initial
        matrix = rotation(initial)
        rigid = row[at.NP] - row[at.NQ]
        p, u = row[at.POS], row[at.VEL]
        if row[at.RD] > 0:
            axes = 2 if system.planar else 3
            z[p : p + axes] = as_3d(initial.position)[:axes]
            v[u : u + axes] = (matrix.T @ as_3d(initial.velocity))[:axes]
            if system.planar and rigid == 3:
                z[p + 2] = initial.angle or np.arctan2(matrix[1, 0], matrix[0, 0])
                v[u + 2] = float(np.ravel(initial.angular_velocity or 0.0)[-1])
            elif rigid == 7:
                z[p + 3 : p + 7] = quaternion(matrix)
                v[u + 3 : u + 6] = _angular_velocity(initial.angular_velocity, matrix)
        z[p + rigid : p + row[at.NP]] = _elastic(initial, "elastic", data)
        v[u + row[at.RD] : u + row[at.NV]] = _elastic(initial, "elastic_velocity", data)
    return Start(z, v)


def _angular_velocity(value: object, matrix: Array) -> Array:
    """Inertial components, as files hold them, in the body frame."""
    if value is None:
        return np.zeros(3)
    return matrix.T @ np.asarray(value, float)


def _elastic(initial: object, key: str, data: object) -> Array:
    nq = data.sid.nq  # type: ignore[attr-defined]
    values = getattr(initial, key, None)
    if values is None:
        return np.zeros(nq)
    if len(values) != nq:
        raise InputError(
            f"has {len(values)} values",
            place=f"bodies.{data.name}.initial.{key}",  # type: ignore[attr-defined]
            expected=f"{nq}, one for each elastic coordinate of the SID",
        )
    return np.array(values)


def assemble(system: System) -> tuple[System, Start]:
    """A consistent start, and the system with its redundant constraints marked.

    Raises
    ------
    InputError : the start position cannot be reached, or constraints contradict.
    """
    start = guess(system)
    if system.n_rows == 0:
        return system, start
    state = _State(system, start)
    align(system, state.work, state.z)
    state.evaluate()
    _check_rods(state)
    _reach_positions(state)
    check_alignment(system, state.work)
    if system.from_start:
        _measure_start(state)
    _reach_velocities(state)
    system = state.system
    _check_prescribed(state)
    system = _mark_redundant(state)
    return system, Start(state.z, state.v)


class _State:
    """The state in hand, with dense matrices of its constraints."""

    def __init__(self, system: System, start: Start) -> None:
        self.system = system
        self.z, self.v = start.z.copy(), start.v.copy()
        self.work = new_work(system)
        self.memory: Memory = new_memory(system, 0)
        self.t = system.scene.time.start
        self.free = _free_coordinates(system)
        self.ignored = np.zeros(system.n_rows, bool)
        self.ignored[[row for _, row in system.from_start]] = True
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

    def jacobian(self) -> Array:
        C = dense_jacobian(self.system, self.work.C)
        C[self.ignored] = 0.0
        return C

    def smallest(self, right: Array) -> tuple[Array, float]:
        """x with C x = right, smallest in the metric, and what remains of right."""
        C = self.jacobian()[:, self.free]
        W = self.weight()[np.ix_(self.free, self.free)]
        compliance = np.linalg.solve(W, C.T)
        S = C @ compliance
        scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
        scale[np.diag(S) <= 1e-300] = 0.0
        scaled = S * np.outer(scale, scale)
        solution = np.linalg.lstsq(scaled, scale * right, rcond=RANK_TOLERANCE)[0]
        x = np.zeros(self.system.n_velocities)
        x[self.free] = compliance @ (scale * solution)
        left = float(np.max(np.abs(C @ x[self.free] - right), initial=0.0))
        return x, left

    def weight(self) -> Array:
        W = np.zeros((self.system.n_velocities, self.system.n_velocities))
        for row in self.system.arrays.body:
            n, o, first = row[at.NV], row[at.BLOCK], row[at.VEL]
            entries = self.work.M[o : o + n * n] + self.memory.metric[o : o + n * n]
            W[first : first + n, first : first + n] = entries.reshape(n, n)
        return W + 1e-14 * np.trace(W) / max(1, len(W)) * np.eye(len(W))


def _free_coordinates(system: System) -> Array:
    """Velocity coordinates of bodies that the assembly may move."""
    free = []
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.name != GROUND_NAME and system.scene.bodies[data.name].initial.fixed:
            continue
        free += list(range(row[at.VEL], row[at.VEL] + row[at.NV]))
    return np.array(free, int)


def dense_jacobian(system: System, C: Array) -> Array:
    """The constraint Jacobian as a dense (rows, velocities) matrix."""
    arrays = system.arrays
    dense = np.zeros((system.n_rows, system.n_velocities))
    for row, b, offset in arrays.segment:
        n, first = arrays.body[b, at.NV], arrays.body[b, at.VEL]
        dense[row, first : first + n] += C[offset : offset + n]
    return dense


def _reach_positions(state: _State) -> None:
    system = state.system
    goal = 1e-13 * system.length
    size = np.max(np.abs(state.residual))
    for _ in range(ITERATIONS):
        if size <= goal:
            return
        step, _ = state.smallest(-state.residual)
        base, base_size, fraction = state.z.copy(), size, 1.0
        frame = state.work.frame.copy()
        while fraction > 1e-4:
            state.z[:] = base
            retract(system.arrays, frame, state.z, fraction * step)
            state.evaluate()
            size = np.max(np.abs(state.residual))
            if size < base_size:
                break
            fraction *= 0.5
        else:
            state.z[:] = base
            state.evaluate()
            size = base_size
            break
    if size > 1e-10 * system.length:
        raise InputError(
            f"the start position cannot be assembled: {_worst(system, state.residual)}",
            place="bodies.*.initial",
            expected="initial positions from which all joints and drives can be met",
        )


def _measure_start(state: _State) -> None:
    """Constants of constraints that keep what they are at the start."""
    system = state.system
    pool = system.arrays.pool.copy()
    for entry, row in system.from_start:
        pool[entry] = state.work.row[row, at.C_VALUE]
    _check_rods(state)
    state.system = replace(system, arrays=system.arrays.replaced(pool=pool))
    state.ignored[:] = False
    state.evaluate()


def _check_rods(state: _State) -> None:
    """Raises constraints without a direction: the two ends of a rod coincide."""
    for row in state.system.rows:
        values = state.work.row[row.first : row.first + row.count]
        if not np.isfinite(values).all():
            raise InputError(
                f"the markers of {row.name} coincide at the start",
                place=f"joints.{row.name}",
                expected="two points at a distance",
            )


def _worst(system: System, residual: Array) -> str:
    """Names the constraints with the largest residuals."""
    sizes: dict[str, float] = {}
    for row in system.rows:
        part = np.abs(residual[row.first : row.first + row.count])
        sizes[row.name] = max(sizes.get(row.name, 0.0), float(part.max()))
    largest = max(sizes.values())
    worst = sorted(sizes, key=lambda name: -sizes[name])[:3]
    worst = [name for name in worst if sizes[name] > 1e-6 * largest]
    return ", ".join(f"{name} is open by {sizes[name]:.3g}" for name in worst)


def _reach_velocities(state: _State) -> None:
    state.evaluate()
    rates = state.work.row[:, at.C_RATE].copy()
    change, left = state.smallest(-rates)
    state.v += change
    state.evaluate()
    moving = float(np.max(np.abs(state.v), initial=0.0))
    size = max(1.0, float(np.max(np.abs(rates))), moving)
    if left > 1e-8 * size:
        residual = state.work.row[:, at.C_RATE]
        raise InputError(
            f"the joints and drives contradict each other at velocity level: "
            f"{_worst(state.system, residual)} per second",
            place="joints",
            expected="drives and joints that can move together",
        )


def _check_prescribed(state: _State) -> None:
    """Constraints between prescribed frames must hold all the time: nothing can give.

    Raises
    ------
    InputError : drives and joints prescribe different motions.
    """
    system, time = state.system, state.system.scene.time
    held = np.isin(np.arange(system.n_rows), system.arrays.segment[:, at.S_ROW])
    if held.all():
        return
    edges = (time.start, *system.breaks)
    for begin, end in pairwise(edges):
        state.work.clock[0] = 0.5 * (begin + end)
        for t in np.linspace(begin, end, SAMPLES):
            kernel_calls.evaluate(system, state.work, t, state.z, state.v)
            open_rows = np.where(held, 0.0, state.residual)
            if np.max(np.abs(open_rows)) > 1e-8 * system.length:
                raise InputError(
                    f"the mechanism is over-constrained: at t = {t:.6g} s "
                    f"{_worst(system, open_rows)}, and no coordinate can give way",
                    place="joints",
                    expected="drives and joints that prescribe the same motion",
                )
    state.start()


def _mark_redundant(state: _State) -> System:
    """Constraint rows that depend on the others get slack on their diagonal."""
    system = state.system
    C = state.jacobian()
    norms = np.linalg.norm(C, axis=1)
    scaled = C / np.where(norms > 0.0, norms, 1.0)[:, None]
    redundant = _dependent_rows(scaled)
    _check_accelerations(state, redundant)
    if not redundant:
        return system
    slack = np.zeros(system.n_rows)
    slack[list(redundant)] = _schur_size(state, C)
    return replace(system, redundant=redundant, arrays=with_slack(system.arrays, slack))


def _dependent_rows(matrix: Array) -> tuple[int, ...]:
    """Rows that follow from the others: those that pivoting leaves for the last."""
    rows, columns = matrix.shape
    sizes = np.linalg.svd(matrix, compute_uv=False)
    bound = RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))
    if rows <= columns and np.all(sizes > bound):
        return ()
    from scipy.linalg import qr  # a third of a second that few scenes need

    _, R, order = qr(matrix.T, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R)) if R.size else np.zeros(0)
    rank = int(np.sum(pivots > bound))
    return tuple(sorted(int(i) for i in order[rank:]))


def _schur_size(state: _State, C: Array) -> float:
    """A typical entry on the diagonal of C M^-1 C^T."""
    diagonal = np.einsum("ij,ji->i", C, np.linalg.solve(state.weight(), C.T))
    return float(np.median(diagonal[diagonal > 0.0])) if diagonal.any() else 1.0


def _check_accelerations(state: _State, redundant: tuple[int, ...]) -> None:
    if not redundant:
        return
    gamma = state.work.row[:, at.C_GAMMA].copy()
    C = state.jacobian()
    solution = np.linalg.lstsq(C, gamma, rcond=RANK_TOLERANCE)[0]
    left = np.abs(C @ solution - gamma)
    if left.max() > 1e-7 * max(1.0, float(np.max(np.abs(gamma)))):
        names = ", ".join(dict.fromkeys(names_of_rows(state.system, redundant)))
        raise InputError(
            f"the mechanism is over-constrained: {names} cannot be accelerated as "
            "the other joints and drives demand",
            place="joints",
            expected="as many constraints as the mechanism can follow",
        )


def names_of_rows(system: System, rows: tuple[int, ...]) -> list[str]:
    """The joints and drives that constraint rows belong to."""
    return [
        next(r.name for r in system.rows if r.first <= i < r.first + r.count)
        for i in rows
    ]
