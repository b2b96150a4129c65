"""Accelerations of planar frames and markers at recorded states."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..kernels import layout as at
from ..kernels.planar_columns import AL, AX, COS, DX, DY, PAX, PAY, SIN, TA
from ..system.bodies import elastic_rates
from ..system.scene import System


def complete(
    system: System, z: Array, frames: Array, points: Array, accelerations: Array
) -> None:
    """Adds R (a + alpha x d + Phi(q) q'') to the accelerations at zero z_II'."""
    for (body, name), m in system.markers.items():
        b = int(system.arrays.marker[m, at.M_BODY])
        row = system.arrays.body[b]
        node = system.bodies[b].node(name)
        rigid, elastic = _split(row, accelerations)
        point, frame = points[:, m], frames[:, b]
        q = z[:, row[at.POS] + row[at.NP] - row[at.NQ] : row[at.POS] + row[at.NP]]
        q2 = elastic_rates(node.phi, q, elastic)
        ax = rigid[:, 0] - rigid[:, 2] * point[:, DY] + q2[:, 0]
        ay = rigid[:, 1] + rigid[:, 2] * point[:, DX] + q2[:, 1]
        c, s = frame[:, COS], frame[:, SIN]
        point[:, PAX] += c * ax - s * ay
        point[:, PAY] += s * ax + c * ay
        point[:, TA] += rigid[:, 2] + elastic_rates(node.psi, q, elastic)[:, 2]
        assert body == system.bodies[b].name
    for b, row in enumerate(system.arrays.body):
        rigid, _ = _split(row, accelerations)
        frames[:, b, AX : AX + 2] += rigid[:, :2]
        frames[:, b, AL] += rigid[:, 2]


def _split(row: Array, accelerations: Array) -> tuple[Array, Array]:
    """Rigid (nt, 3) and elastic (nt, nq) accelerations of a body."""
    first, rd = int(row[at.VEL]), int(row[at.RD])
    rigid = np.zeros((len(accelerations), 3))
    rigid[:, :rd] = accelerations[:, first : first + rd]
    return rigid, accelerations[:, first + rd : first + int(row[at.NV])]
