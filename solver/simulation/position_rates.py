"""Positions and their rates at many states: derivatives of z_I' = Z z_II, tangents."""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import Array

from ..integrators import batch_evaluation
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
    nv = system.n_velocities
    Z, to_tangent = np.zeros((2, n, nv, nz))
    by_position = np.zeros((n, nz, nz))
    batch_evaluation.rates_of_states(
        system.arrays, z, v, np.zeros(nv), Z, by_position, to_tangent
    )
    rate = np.einsum("nji,nj->ni", Z, v)
    transposed = by_position.transpose(0, 2, 1)
    return PositionRates(rate, Z.transpose(0, 2, 1), transposed, to_tangent)
