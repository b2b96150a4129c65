"""The matrix of small motions of an assembled mechanism, eq. (23).

The state is perturbed within the constraints: positions by N y and velocities by
V y + N w, with N the null space of the constraint Jacobian and V what keeps the
velocities consistent. Then

    y' = N^T E N y + w,    w' = N^T (da/dz N + da/dv V) y + N^T da/dv N w,

with E as in `kernels.coordinates`. States of the laws of drives, which are among w,
move positions by Q x and velocities by V x as well, the smallest that keep the
constraints. Of rigid bodies that are fixed to each other the first one tells the
motion: in the place of N^T stands the inverse of its rows of N then. The derivatives
of the accelerations a follow from those of what eq. (3) leaves at the state's own
accelerations and multipliers, by central differences: it is
solved at the state only. Beside it a body with first-order terms of Ct and Cr may have
no positive mass matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.sid import Array
from sidtool.formats.sid_mass import skew

from ..space import layout as at
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .axes import independent_rows, turning
from .held import state_entries
from .mechanics import Mechanics, least_squares, null_space

#: Perturbation, relative to the size of the mechanism.
PERTURBATION = 1e-6


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """Small motions (y, w) about a state.

    matrix : of (y, w)
    motion : (n, d) scaled free directions N, states of laws last
    moved : (n, y and w) how (y, w) move the positions
    z, v : the state
    spins : (bodies, 3) of the axes in which each body is seen, see `own_axes`
    """

    matrix: Array
    motion: Array
    moved: Array
    z: Array
    v: Array
    spins: Array


def state_matrix(
    mechanics: Mechanics, z: Array, v: Array, spins: Array
) -> SmallMotions:
    """The small motions about a state.

    States are among w only: what they add up to does not matter.

    spins : of the axes in which each body is seen, see `own_axes`
    """
    mechanics.evaluate(z, v)
    mechanics.refuse_singular()
    C, M, E = mechanics.jacobian, mechanics.mass, _frame_motion(mechanics)
    across = _across(mechanics.system) * mechanics.scale
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    N, places = _free_directions(mechanics.system, C, across / lengths)
    d = N.shape[1]
    rows = independent_rows(mechanics)
    read = N.T if rows.all() else np.linalg.pinv(N[rows])

    def particular(right: Array) -> Array:
        """A solution of C x = right, without a part along N in the leading rows."""
        x = least_squares(C, right)
        return x if rows.all() else np.asarray(x - N @ (read @ x[rows]))

    Z = mechanics.unconstrained(N)
    inertia = Z.T @ M @ N
    a, multipliers = mechanics.accelerations()
    W = turning(mechanics, spins)
    by_z, by_v = _derivatives(mechanics, z, v, a, multipliers)
    E, by_v = E - W, replace(by_v, force=by_v.force - M @ W, gamma=by_v.gamma - C @ W)
    states = np.zeros_like(N)
    states[:, places:] = N[:, places:]
    moved = np.hstack([N, least_squares(C, -by_v.value @ states)])
    rates = by_z.rate @ moved
    rates[:, d:] += by_v.rate @ states
    driven = particular(-rates)
    driven[:, d:] += N
    matrix = np.zeros((2 * d, 2 * d))
    matrix[:d] = read @ (E @ moved)[rows]
    matrix[:d, d:] += np.eye(d)
    force = by_z.force @ moved + by_v.force @ driven
    gamma = by_z.gamma @ moved + by_v.gamma @ driven
    right = Z.T @ (force - M @ particular(gamma))
    matrix[d:] = mechanics.solve_inertia(inertia, right)
    kept = [*range(places), *range(d, 2 * d)]
    return SmallMotions(matrix[np.ix_(kept, kept)], N, moved[:, kept], z, v, spins)


def _free_directions(system: System, C: Array, across: Array) -> tuple[Array, int]:
    """The null space of C, states of laws last, and how many are no states.

    across : (n, velocities) momenta that vanish as well, see `_across`
    """
    _, states = state_entries(system)
    others = np.setdiff1d(np.arange(C.shape[1]), states)
    moving = null_space(np.vstack([C, across])[:, others])
    N = np.zeros((C.shape[1], moving.shape[1] + len(states)))
    N[others, : moving.shape[1]] = moving
    N[states, moving.shape[1] :] = np.eye(len(states))
    return N, moving.shape[1]


def _across(system: System) -> Array:
    """(n, velocities) momenta across the plane of a planar scene, which are zero."""
    found = [np.zeros((0, system.n_velocities))]
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.across is not None:
            first = int(row[at.VEL] + row[at.RD])
            rows = np.zeros((len(data.across), system.n_velocities))
            rows[:, first : first + data.across.shape[1]] = data.across
            found.append(rows)
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class _Change:
    """By the n scaled coordinates: f + C^T lambda - M a (n, n), and of the constraints
    their values, rates and gamma - C a (rows, n)."""

    force: Array
    value: Array
    rate: Array
    gamma: Array


def _derivatives(
    mechanics: Mechanics, z: Array, v: Array, a: Array, multipliers: Array
) -> tuple[_Change, _Change]:
    """Central differences by positions and by velocities, at fixed a and lambda."""
    n, rows = len(v), len(multipliers)
    found = []
    deltas = PERTURBATION * coordinate_sizes(mechanics.system) / mechanics.scale
    for moves in (True, False):
        change = _Change(np.zeros((n, n)), *(np.zeros((rows, n)) for _ in range(3)))
        for k, delta in enumerate(deltas):
            step = np.zeros(n)
            step[k] = delta
            for sign in (1.0, -1.0):
                if moves:
                    mechanics.evaluate(mechanics.moved(z, sign * step), v)
                else:
                    mechanics.evaluate(z, v + sign * step * mechanics.scale)
                C, weight = mechanics.jacobian, sign / (2.0 * delta)
                left = mechanics.force + C.T @ multipliers - mechanics.mass @ a
                change.force[:, k] += weight * left
                residual = mechanics.residual
                change.value[: len(residual), k] += weight * residual
                change.rate[:, k] += weight * mechanics.rates
                change.gamma[:, k] += weight * (mechanics.gamma - C @ a)
        found.append(change)
    return found[0], found[1]


def _frame_motion(mechanics: Mechanics) -> Array:
    """E in z_I' = E z_I + z_II of tangents, scaled: frames that move on.

    Unlike that of `kernels.coordinates` it holds tangents in axes that turn with the
    bodies, in which a steady rotation stands still.
    """
    system, n = mechanics.system, mechanics.system.n_velocities
    E = np.zeros((n, n))
    frames = system.frames(mechanics.work.frame)
    for row, frame in zip(system.arrays.body, frames, strict=True):
        u, rd = int(row[at.VEL]), int(row[at.RD])
        if rd == 3 and system.planar:
            (vx, vy), (w,) = frame["v"], frame["w"]
            E[u, u + 2], E[u + 1, u + 2] = -vy, vx
            E[u, u + 1], E[u + 1, u] = w, -w
        elif rd == 6:
            V, W = skew(frame["v"]), skew(frame["w"])
            E[u : u + 3, u + 3 : u + 6] = -V
            E[u : u + 3, u : u + 3] = E[u + 3 : u + 6, u + 3 : u + 6] = -W
    return E * mechanics.scale / mechanics.scale[:, None]
