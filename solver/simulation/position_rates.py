"""Positions and their rates at many states: derivatives of z_I' = Z z_II, tangents."""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.sid_mass import skew

from ..spatial import system_arrays as at
from ..system.system import System


@dataclass(frozen=True, eq=False)
class PositionRates:
    """Derivatives of z_I' = Z z_II at states, for positions without counted rotations.

    Attributes
    ----------
    rate : (states, positions)
        Z z_II.
    Z : (states, positions, velocities)
        By velocities; it also maps tangent vectors to changes of positions.
    by_position : (states, positions, positions)
        By positions.
    to_tangent : (states, velocities, positions)
        Changes of positions as tangent vectors, see `spatial.coordinates`.
    """

    rate: Array
    Z: Array
    by_position: Array
    to_tangent: Array


def position_rates(system: System, z: Array, v: Array) -> PositionRates:
    """The derivatives at states (states, .)."""
    n, nz = len(z), system.n_positions - system.n_rotation_counters
    by_position, one = np.zeros((n, nz, nz)), np.zeros((nz, system.n_velocities))
    for row in system.arrays.body:
        last_z, last_v = row[at.POS] + row[at.NP], row[at.VEL] + row[at.NV]
        elastic = np.arange(row[at.NQ])
        one[last_z - 1 - elastic, last_v - 1 - elastic] = 1.0
    Z, to_tangent = (np.broadcast_to(x, (n, *x.shape)).copy() for x in (one, one.T))
    for row in system.arrays.body:
        rd, p, u = int(row[at.RD]), int(row[at.POS]), int(row[at.VEL])
        if rd == 0:
            continue
        axes = 2 if system.planar else 3
        constant = system.arrays.real_data[row[at.FRAME] :]
        x, own = slice(p, p + axes), slice(u, u + axes)
        if system.planar:
            angle = z[:, p + 2] if rd == 3 else np.full(n, constant[0])
            R = _planar_rotation(angle)
        else:
            quaternion = (
                z[:, p + 3 : p + 7] if rd == 6 else np.tile(constant[:4], (n, 1))
            )
            R = _spatial_rotation(quaternion)
        Z[:, x, own], to_tangent[:, own, x] = R, R.transpose(0, 2, 1)
        if system.planar and rd == 3:
            Z[:, p + 2, u + 2] = to_tangent[:, u + 2, p + 2] = 1.0
            normal = np.stack([-v[:, u + 1], v[:, u]], axis=1)
            by_position[:, x, p + 2] = np.einsum("nij,nj->ni", R, normal)
        elif rd == 6:
            turn = slice(p + 3, p + 7)
            E = _quaternion_rates(quaternion)
            Z[:, turn, u + 3 : u + 6] = 0.5 * E
            back = 2.0 * E.transpose(0, 2, 1)
            back /= (quaternion**2).sum(axis=1)[:, None, None]
            to_tangent[:, u + 3 : u + 6, turn] = back
            # R (dtheta x v) = -R [v] dtheta
            cross = skew(v[:, own])
            by_position[:, x, turn] = -R @ cross @ back
            by_position[:, turn, turn] = 0.5 * _right_product(v[:, u + 3 : u + 6])
    rate = np.einsum("nij,nj->ni", Z, v)
    return PositionRates(rate, Z, by_position, to_tangent)


def _planar_rotation(angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c, -s, s, c], axis=1).reshape(-1, 2, 2)


def _spatial_rotation(p: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions of any length, scalar part first."""
    p = p / np.linalg.norm(p, axis=1, keepdims=True)
    a, cross = p[:, 0, None, None], skew(p[:, 1:])
    return np.eye(3) + 2.0 * a * cross + 2.0 * cross @ cross


def _quaternion_rates(p: Array) -> Array:
    """E (n, 4, 3) with p (0, w) = E w."""
    a, b, c, d = p.T
    rows = [-b, -c, -d, a, -d, c, d, a, -b, -c, b, a]
    return np.stack(rows, axis=1).reshape(-1, 4, 3)


def _right_product(w: Array) -> Array:
    """Matrices (n, 4, 4) with p (0, w) = matrix p."""
    x, y, z = w.T
    o = np.zeros_like(x)
    rows = [o, -x, -y, -z, x, o, z, -y, y, -z, o, x, z, y, -x, o]
    return np.stack(rows, axis=1).reshape(-1, 4, 4)
