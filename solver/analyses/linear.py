"""Linearisation of an assembled mechanism: frequencies, damping ratios, mode shapes.

The state is perturbed within the constraints: positions by N y and velocities by
V y + N w, with N the null space of the constraint Jacobian and V what keeps the
velocities consistent. Then, eq. (23),

    y' = N^T E N y + w,    w' = N^T (da/dz N + da/dv V) y + N^T da/dv N w,

with E as in `kernels.coordinates`. States of the laws of drives, which are among w,
move positions by Q x and velocities by V x as well, the smallest that keep the
constraints. The derivatives of the accelerations a follow from those of what eq. (3)
leaves at the state's own accelerations and multipliers, by central differences: it is
solved at the state only. Beside it a body with first-order terms of Ct and Cr may have
no positive mass matrix. The state should be an equilibrium, or a steady motion such as
a constant rotation, where these matrices do not depend on time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array
from sidtool.formats.sid_mass import skew

from ..recording.outputs import velocity_names
from ..space import layout as at
from ..start.assembly import assemble
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .held import state_entries, unsampled
from .mechanics import (
    Mechanics,
    least_squares,
    null_space,
    refuse_prescribed,
)
from .point_axes import turning_of_points
from .rubbing import mechanics_at
from .static import static_equilibrium

#: Perturbation, relative to the size of the mechanism.
PERTURBATION = 1e-6
STATES = ("static", "start")
#: A state is near another one that differs by less than this part of the sizes; what is
#: left of the accelerations there, relative to them.
NEAR, STEADY = 0.05, 1e-6
#: Ways below this share of the sizes lead nowhere; frequencies that differ by less than
#: this share are the same, and those below this share of the square of the highest are
#: rounding.
AT_REST, SAME, ROUNDING = 1e-12, 0.01, 1e-11


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Natural modes about a state.

    eigenvalues : (n,) [1/s], one of each complex pair, by growing frequency
    frequencies : (n,) |eigenvalue| / 2 pi [Hz]
    damping_ratios : (n,) -Re / |eigenvalue|; 1 or more (in size) without oscillation
    shapes : (n, velocity coordinates) complex, displacements in the body frames, the
        largest entry 1
    names : of the velocity coordinates
    z, v : the state
    notes : what has to be known of it
    """

    eigenvalues: np.ndarray
    frequencies: Array
    damping_ratios: Array
    shapes: np.ndarray
    names: tuple[str, ...]
    z: Array
    v: Array
    notes: tuple[str, ...] = ()


def linearise(
    system: System,
    about: str = "static",
    state: tuple[Array, Array] | None = None,
    time: float | None = None,
) -> Linearisation:
    """Natural modes of a scene.

    Parameters
    ----------
    about : "static", the static equilibrium, or "start", the assembled start with its
        velocities
    state : (z_I, z_II) instead, as in a result's positions and velocities
    time : of the drives at that state [s], default the start

    Raises
    ------
    InputError : there is no such state, or the start cannot be assembled, or friction
        of a joint has no derivative there.
    SimulationError : there is no static equilibrium, the state is a singular
        configuration, or its inertia is not positive.
    """
    refuse_prescribed(system)
    system, told = unsampled(system)
    if about not in STATES:
        raise InputError(f"found {about!r}", expected=f"one of {', '.join(STATES)}")
    if state is not None:
        system, _ = assemble(system)
        z, v = (np.array(part, float) for part in state)
        _check_size(system, z, v)
    elif about == "static":
        found = static_equilibrium(system)
        system, z, v = found.system, found.z, found.v
    else:
        system, start = assemble(system)
        z, v = start.z, start.v
    t = system.scene.time.start if time is None else time
    mechanics = mechanics_at(system, t, z, v)
    mechanics.set_scale(z, stiffness=0.0)
    matrix, motion, moved = state_matrix(mechanics, z, v)
    notes = _unsteady(mechanics, matrix, motion, moved, z, v)
    notes += (*mechanics.notes(), *told)
    return replace(_modes(mechanics, matrix, moved, z, v), notes=notes)


def _unsteady(
    mechanics: Mechanics,
    matrix: Array,
    motion: Array,
    moved: Array,
    z: Array,
    v: Array,
) -> tuple[str, ...]:
    """Whether the state is far from rest and from steady motion, and what leaves it.

    Near is where the equations, taken as linear, have such a state. It may be near and
    have other modes: a column that nothing compresses yet accelerates, and is stiff.
    """
    mechanics.evaluate(z, v)
    a, slow = mechanics.accelerations()[0], v / mechanics.scale
    left = motion.T @ (a - turning_of_points(mechanics, slow, a) @ slow)
    forces = np.concatenate([np.zeros(len(matrix) - len(left)), -left])
    shift = np.linalg.lstsq(matrix, forces, rcond=1e-10)[0]
    sizes = coordinate_sizes(mechanics.system) / mechanics.scale
    way = np.abs(moved @ shift) / sizes
    rest = np.abs(matrix @ shift - forces).max(initial=0.0)
    names = velocity_names(mechanics.system)
    first = names[int(np.argmax(np.abs(motion @ left) / sizes))]
    if way.max(initial=0.0) < NEAR and rest <= STEADY * np.abs(left).max(initial=0.0):
        if way.max(initial=0.0) < AT_REST:
            return ()
        there, *_ = state_matrix(mechanics, mechanics.moved(z, moved @ shift), v)
        mechanics.evaluate(z, v)
        return _changed_modes(matrix, there, first)
    return (
        f"the state is neither near rest nor near a steady motion, {first} "
        "accelerates: modes tell of small motions about such states only",
    )


def _changed_modes(here: Array, there: Array, first: str) -> tuple[str, ...]:
    """Whether the matrix of the state of rest beside the own has other frequencies."""
    own, other = (np.sort(np.abs(np.linalg.eigvals(m))) for m in (here, there))
    if own.shape != other.shape:
        return ()
    apart = np.abs(own**2 - other**2)
    change = apart / np.maximum(own**2, ROUNDING * own.max(initial=0.0) ** 2)
    k = int(np.argmax(change > 2 * SAME)) if len(change) else 0
    if not len(change) or change[k] <= 2 * SAME:
        return ()
    f, g = (values[k] / (2.0 * np.pi) for values in (own, other))
    return (
        f"the state is near rest or steady motion, but {first} accelerates, so that "
        f"loads which stiffen or soften are not there yet: {f:.4g} Hz here is {g:.4g} "
        'Hz in that state; look about it, by initial = { state = "static" }',
    )


def _check_size(system: System, z: Array, v: Array) -> None:
    wanted = (system.n_positions,), (system.n_velocities,)
    if (z.shape, v.shape) != wanted:
        raise InputError(
            f"the state has {z.size} positions and {v.size} velocities",
            place="state",
            expected=f"{wanted[0][0]} and {wanted[1][0]} of the same scene, compiled "
            "in the same way",
        )


def state_matrix(
    mechanics: Mechanics, z: Array, v: Array
) -> tuple[Array, Array, Array]:
    """Matrix of (y, w), the (n, d) scaled free directions N, states of laws last, and
    how (y, w) move the positions, (n, y and w).

    States are among w only: what they add up to does not matter.
    """
    mechanics.evaluate(z, v)
    mechanics.refuse_singular()
    C, M, E = mechanics.jacobian, mechanics.mass, _frame_motion(mechanics)
    N, places = _free_directions(mechanics.system, C)
    d = N.shape[1]
    Z = mechanics.unconstrained(N)
    inertia = Z.T @ M @ N
    a, multipliers = mechanics.accelerations()
    W = turning_of_points(mechanics, v / mechanics.scale, a)
    by_z, by_v = _derivatives(mechanics, z, v, a, multipliers)
    E, by_v = E - W, replace(by_v, force=by_v.force - M @ W, gamma=by_v.gamma - C @ W)
    states = np.zeros_like(N)
    states[:, places:] = N[:, places:]
    moved = np.hstack([N, least_squares(C, -by_v.value @ states)])
    rates = by_z.rate @ moved
    rates[:, d:] += by_v.rate @ states
    driven = least_squares(C, -rates)
    driven[:, d:] += N
    matrix = np.zeros((2 * d, 2 * d))
    matrix[:d] = N.T @ E @ moved
    matrix[:d, d:] += np.eye(d)
    force = by_z.force @ moved + by_v.force @ driven
    gamma = by_z.gamma @ moved + by_v.gamma @ driven
    right = Z.T @ (force - M @ least_squares(C, gamma))
    matrix[d:] = mechanics.solve_inertia(inertia, right)
    kept = [*range(places), *range(d, 2 * d)]
    return matrix[np.ix_(kept, kept)], N, moved[:, kept]


def _free_directions(system: System, C: Array) -> tuple[Array, int]:
    """The null space of C, states of laws last, and how many are no states."""
    _, states = state_entries(system)
    others = np.setdiff1d(np.arange(C.shape[1]), states)
    moving = null_space(C[:, others])
    N = np.zeros((C.shape[1], moving.shape[1] + len(states)))
    N[others, : moving.shape[1]] = moving
    N[states, moving.shape[1] :] = np.eye(len(states))
    return N, moving.shape[1]


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


def _modes(
    mechanics: Mechanics, matrix: Array, moved: Array, z: Array, v: Array
) -> Linearisation:
    values, vectors = np.linalg.eig(matrix)
    kept = [k for k in np.argsort(np.abs(values)) if values[k].imag >= 0.0]
    values = values[kept]
    shapes = (moved @ vectors[:, kept]).T * mechanics.scale
    for shape in shapes:
        largest = shape[np.argmax(np.abs(shape))] if len(shape) else 1.0
        shape /= largest if largest != 0.0 else 1.0
    size = np.abs(values)
    return Linearisation(
        eigenvalues=values,
        frequencies=size / (2.0 * np.pi),
        damping_ratios=-values.real / np.where(size > 0.0, size, 1.0),
        shapes=shapes,
        names=velocity_names(mechanics.system),
        z=z,
        v=v,
    )
