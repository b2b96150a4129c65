"""Accelerations of spatial frames and markers at recorded states."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..kernels import layout as at
from ..kernels.spatial_columns import ALPHA, PA, PAL, A, D, R, T
from ..system.bodies import elastic_rates
from ..system.scene import System


def complete(
    system: System, z: Array, frames: Array, points: Array, accelerations: Array
) -> None:
    """Adds R (a + alpha x d + Phi(q) q'') to the accelerations at zero z_II'."""
    for (_, name), m in system.markers.items():
        b = int(system.arrays.marker[m, at.M_BODY])
        node = system.bodies[b].node(name)
        row = system.arrays.body[b]
        q = z[:, row[at.POS] + row[at.NP] - row[at.NQ] : row[at.POS] + row[at.NP]]
        linear, angular, elastic = _split(row, accelerations)
        point, rotation = points[:, m], frames[:, b, R : R + 9].reshape(-1, 3, 3)
        turn = point[:, T : T + 9].reshape(-1, 3, 3)
        local = linear + np.cross(angular, point[:, D : D + 3])
        local = local + elastic_rates(node.phi, q, elastic)
        twist = np.einsum("tij,tj->ti", turn, elastic_rates(node.psi, q, elastic))
        point[:, PA : PA + 3] += np.einsum("tij,tj->ti", rotation, local)
        spin = np.einsum("tij,tj->ti", rotation, angular + twist)
        point[:, PAL : PAL + 3] += spin
    for b, row in enumerate(system.arrays.body):
        linear, angular, _ = _split(row, accelerations)
        frames[:, b, A : A + 3] += linear
        frames[:, b, ALPHA : ALPHA + 3] += angular


def _split(row: Array, accelerations: Array) -> tuple[Array, Array, Array]:
    """Linear (nt, 3), angular (nt, 3) and elastic (nt, nq) accelerations of a body."""
    first, rd = int(row[at.VEL]), int(row[at.RD])
    rigid = np.zeros((len(accelerations), 6))
    rigid[:, :rd] = accelerations[:, first : first + rd]
    elastic = accelerations[:, first + rd : first + int(row[at.NV])]
    return rigid[:, :3], rigid[:, 3:], elastic
