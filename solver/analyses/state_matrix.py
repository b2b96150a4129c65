"""The matrix of small motions of an assembled mechanism, eq. (23).

The state is perturbed within the constraints: positions by N y and velocities by
V y + N w, with N the null space of the constraint Jacobian. The matrix is constant in
axes that follow a steady motion; `steady_axes` finds them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.sid_mass import skew

from ..spatial import system_arrays as at
from ..system.system import System
from .dense_equations import DenseEquations, least_squares, null_space
from .frozen_inputs import state_entries
from .multi_blade import BladeGroup, mixing_matrix
from .reference_axes import (
    axis_angular_velocities,
    frame_rotation_matrix,
    independent_rows,
)
from .state_derivatives import Direction, StateDerivatives, state_derivatives


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """Small motions (y, w) about a state.

    Attributes
    ----------
    matrix
        Of (y, w).
    free_directions : (n, d)
        Scaled free directions N, states of laws last.
    position_directions : (n, y and w)
        How (y, w) move the positions.
    velocity_directions : (n, y and w)
        How they change the velocities.
    drift : (y,)
        Rates of y at the state: deformations that do not stand still in the axes.
    z, v
        The state.
    omegas : (bodies, 3)
        The axes in which each body is seen, see `body_axes`.
    changes
        What follows from (y, w).
    corners
        See `LinearEquations`.
    blades
        Groups of bodies in multi-blade coordinates.
    """

    matrix: Array
    free_directions: Array
    position_directions: Array
    velocity_directions: Array
    drift: Array
    z: Array
    v: Array
    omegas: Array
    changes: Responses
    corners: tuple[Direction, ...] = ()
    blades: tuple[BladeGroup, ...] = ()


def state_matrix(
    mechanics: DenseEquations,
    z: Array,
    v: Array,
    omegas: Array,
    blades: tuple[BladeGroup, ...] = (),
) -> SmallMotions:
    """The small motions about a state.

    States are among w only: what they add up to does not matter.

    Parameters
    ----------
    omegas
        Of the axes in which each body is seen, see `body_axes`.
    blades
        Groups of bodies in multi-blade coordinates.
    """
    equations = linear_equations(mechanics, z, v)
    return small_motions(mechanics, equations.in_axes(mechanics, omegas, blades))


def small_motions(
    mechanics: DenseEquations, equations: LinearEquations
) -> SmallMotions:
    """The small motions of linearised equations, see `state_matrix`."""
    z, v = equations.z, equations.v
    N, n_positions = equations.free_directions, equations.n_positions
    d = N.shape[1]
    states = np.zeros_like(N)
    states[:, n_positions:] = N[:, n_positions:]
    held = least_squares(equations.jacobian, -equations.by_velocity.value @ states)
    motions = np.hstack([N, held])
    by_states = np.hstack([np.zeros_like(N), states])
    rates = equations.by_velocity.rate @ by_states
    free = np.hstack([np.zeros_like(N), N])
    changes = equations.responses(mechanics, motions, free, Sources(rate=rates))
    matrix = np.vstack([changes.position_rates, changes.velocity_rates])
    matrix[:d, d:] += np.eye(d)
    selected = [*range(n_positions), *range(d, 2 * d)]
    drift = _elastic_drift(mechanics, z, v, equations.axes)[equations.rows]
    return SmallMotions(
        matrix[np.ix_(selected, selected)],
        N,
        motions[:, selected],
        changes.velocities[:, selected],
        (equations.left_inverse @ drift)[:n_positions],
        z,
        v,
        equations.omegas,
        changes.selected(selected),
        equations.corners,
        equations.blades,
    )


@dataclass(frozen=True, eq=False)
class Sources:
    """Direct changes (., k) by what else changes: of the forces, and of the constraints
    their rates and gamma - C a."""

    force: Array | float = 0.0
    rate: Array | float = 0.0
    gamma: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class Responses:
    """Changes (., k) that follow from k changes of the state or of an input, scaled.

    Attributes
    ----------
    position_rates, velocity_rates
        Of (y, w); those of y are without w itself.
    displacements, velocities, accelerations : (n, k)
        Velocities and accelerations in the axes of the bodies.
    multipliers : (rows, k)
    """

    position_rates: Array
    velocity_rates: Array
    displacements: Array
    velocities: Array
    accelerations: Array
    multipliers: Array

    def selected(self, columns: Sequence[int]) -> Responses:
        """Some of the columns."""
        parts = (getattr(self, part.name) for part in fields(self))
        return Responses(*(part[:, columns] for part in parts))


@dataclass(frozen=True, eq=False)
class LinearEquations:
    """Linearised equations of motion and constraints at a state, scaled.

    Attributes
    ----------
    z, v
        The state.
    omegas : (bodies, 3)
        The axes in which each body is seen, see `body_axes`.
    jacobian, mass
        C (rows, n) and M (n, n).
    frame_rates, axes : (n, n)
        E and W of z_I' = E z_I + z_II in the axes: E is without W.
    free_directions : (n, d)
        N, states of laws last, and `n_positions` of them no states.
    test_directions, inertia
        Z, and Z^T M N; Z = N but for friction.
    rows, left_inverse
        Rows of N whose inverse resolves a motion in the free directions.
    accelerations, multipliers
        At the state.
    constraint_sizes : (rows,)
        See `DenseEquations.multipliers`.
    by_position, by_velocity
        Derivatives; those by velocities are seen in the axes.
    corners
        Directions in which forces seem to have a corner, see `corner_notes`.
    """

    z: Array
    v: Array
    omegas: Array
    jacobian: Array
    mass: Array
    frame_rates: Array
    axes: Array
    free_directions: Array
    n_positions: int
    test_directions: Array
    inertia: Array
    rows: Array
    left_inverse: Array
    accelerations: Array
    multipliers: Array
    constraint_sizes: Array
    by_position: StateDerivatives
    by_velocity: StateDerivatives
    corners: tuple[Direction, ...] = ()
    blades: tuple[BladeGroup, ...] = ()

    def particular(self, right: Array) -> Array:
        """A solution of C x = right, without a part along N in the leading rows."""
        x = least_squares(self.jacobian, right)
        if self.rows.all():
            return x
        return np.asarray(x - self.free_directions @ (self.left_inverse @ x[self.rows]))

    def in_axes(
        self,
        mechanics: DenseEquations,
        omegas: Array,
        blades: tuple[BladeGroup, ...] = (),
    ) -> LinearEquations:
        """The same equations seen in other axes; the state is the one evaluated last.

        Parameters
        ----------
        omegas
            Of the axes in which each body is seen, see `body_axes`.
        blades
            Groups of bodies in multi-blade coordinates.
        """
        mechanics.evaluate(self.z, self.v)
        W = frame_rotation_matrix(mechanics, omegas) + mixing_matrix(mechanics, blades)
        change, by_v = W - self.axes, self.by_velocity
        return replace(
            self,
            omegas=omegas,
            blades=blades,
            frame_rates=self.frame_rates - change,
            axes=W,
            by_velocity=replace(
                by_v,
                force=by_v.force - self.mass @ change,
                gamma=by_v.gamma - self.jacobian @ change,
            ),
        )

    def responses(
        self, mechanics: DenseEquations, displacements: Array, free: Array, by: Sources
    ) -> Responses:
        """What follows from displacements (n, k) and free velocities (n, k).

        Parameters
        ----------
        by
            What else changes with them.
        """
        by_z, by_v = self.by_position, self.by_velocity
        velocities = self.particular(-(by_z.rate @ displacements + by.rate)) + free
        position_rates = self.frame_rates @ displacements
        force = by_z.force @ displacements + by_v.force @ velocities + by.force
        gamma = by_z.gamma @ displacements + by_v.gamma @ velocities + by.gamma
        held = self.particular(gamma)
        right = self.test_directions.T @ (force - self.mass @ held)
        velocity_rates = mechanics.solve_inertia(self.inertia, right)
        accelerations = held + self.free_directions @ velocity_rates
        unbalanced = self.mass @ accelerations - force
        sizes = self.constraint_sizes[:, None]
        return Responses(
            self.left_inverse @ position_rates[self.rows],
            velocity_rates,
            displacements,
            velocities,
            accelerations + self.axes @ velocities,
            least_squares((self.jacobian / sizes).T, unbalanced) / sizes,
        )


def linear_equations(
    mechanics: DenseEquations,
    z: Array,
    v: Array,
    *,
    at_rest: bool = False,
) -> LinearEquations:
    """Linearise the equations about a state, each body seen in its own axes.

    Parameters
    ----------
    at_rest
        The state is an equilibrium: what is left of accelerations is rounding.

    Raises
    ------
    SimulationError
        The state is a singular configuration.
    """
    mechanics.evaluate(z, v)
    mechanics.refuse_singular()
    C, M, E = mechanics.jacobian, mechanics.mass, _frame_matrix(mechanics)
    momenta = _out_of_plane_momenta(mechanics.system) * mechanics.scale
    lengths = np.linalg.norm(momenta, axis=1, keepdims=True)
    N, n_positions = _free_directions(mechanics.system, C, momenta / lengths)
    rows = independent_rows(mechanics)
    left_inverse = N.T if rows.all() else np.linalg.pinv(N[rows])
    Z = mechanics.test_directions(N)
    inertia = Z.T @ M @ N
    if at_rest:
        a, multipliers = np.zeros(len(v)), mechanics.multipliers(-mechanics.force)
    else:
        a, multipliers = mechanics.accelerations()
    own, none = axis_angular_velocities(mechanics), np.zeros_like(E)
    by_z, by_v, corners = state_derivatives(mechanics, z, v, a, multipliers)
    return LinearEquations(
        z,
        v,
        own,
        C,
        M,
        E,
        none,
        N,
        n_positions,
        Z,
        inertia,
        rows,
        left_inverse,
        a,
        multipliers,
        mechanics.constraint_sizes,
        by_z,
        by_v,
        corners,
    )


def elastic_coordinates(system: System) -> Iterator[tuple[slice, slice]]:
    """Where positions and velocities hold the elastic coordinates of each body."""
    for row in system.arrays.body:
        position, velocity = row[at.POS] + row[at.NP], row[at.VEL] + row[at.NV]
        count = row[at.NQ]
        yield slice(position - count, position), slice(velocity - count, velocity)


def _elastic_drift(mechanics: DenseEquations, z: Array, v: Array, W: Array) -> Array:
    """Scaled rates (n,) of the elastic coordinates in axes with the matrix W."""
    drift = np.zeros(len(v))
    for positions, velocities in elastic_coordinates(mechanics.system):
        scale = mechanics.scale[velocities]
        turned = W[velocities, velocities] @ (z[positions] / scale)
        drift[velocities] = v[velocities] / scale - turned
    return drift


def _free_directions(system: System, C: Array, momenta: Array) -> tuple[Array, int]:
    """The null space of C, states of laws last, and how many are no states.

    Parameters
    ----------
    momenta : (n, velocities)
        Momenta that vanish as well, see `_out_of_plane_momenta`.
    """
    _, states = state_entries(system)
    others = np.setdiff1d(np.arange(C.shape[1]), states)
    directions = null_space(np.vstack([C, momenta])[:, others])
    N = np.zeros((C.shape[1], directions.shape[1] + len(states)))
    N[others, : directions.shape[1]] = directions
    N[states, directions.shape[1] :] = np.eye(len(states))
    return N, directions.shape[1]


def _out_of_plane_momenta(system: System) -> Array:
    """(n, velocities) momenta across the plane of a planar scene, which are zero."""
    momenta = [np.zeros((0, system.n_velocities))]
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.out_of_plane_momenta is not None:
            first = int(row[at.VEL] + row[at.RD])
            rows = np.zeros((len(data.out_of_plane_momenta), system.n_velocities))
            rows[:, first : first + data.out_of_plane_momenta.shape[1]] = (
                data.out_of_plane_momenta
            )
            momenta.append(rows)
    return np.concatenate(momenta)


def _frame_matrix(mechanics: DenseEquations) -> Array:
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
