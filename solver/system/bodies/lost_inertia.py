"""Whether a body keeps its inertia with the moments of inertia of first order.

J m0 + J m1 q lacks the term q.Me.q, which keeps the mass matrix positive. What is left
of it for the frame, beside the shape functions, may be little: of a clamped bar with
many modes almost nothing. The lacking term is more than that at small deformations.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.result.bodies import LARGE
from sidtool.formats.scene import SidBody
from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import (
    IN_PLANE,
    SPATIAL,
    body_size,
    coupled_mass_matrix,
)
from sidtool.formats.storage.kept import kept

from .blocks import has_second_order


def has_quadratic_inertia(body: SidBody, sid: SID, planar: bool) -> bool:
    """Whether a body of a scene keeps the term q.Me.q: as the scene says, else where it
    would lose its inertia without."""
    if body.quadratic_inertia is not None:
        return body.quadratic_inertia
    return body.frame != "held" and not body.rigid and loses_inertia(sid, planar)


@kept
def loses_inertia(sid: SID, planar: bool) -> bool:
    """Whether the mass matrix of first order is not positive at some deformation in one
    shape function that linear theory of deformation describes."""
    if has_second_order(sid) or not sid.Oe.first_order(sid.nq).any():
        return False
    axes = list(IN_PLANE[2] if planar else SPATIAL)
    scale = np.sqrt(np.abs(sid.Me.m0.diagonal()) / (sid.mass or 1.0))
    for node in sid.nodes:
        scale = np.maximum(scale, np.abs(node.phi.m0).max(axis=0))
    largest = LARGE * body_size(sid) / np.where(scale > 0.0, scale, np.inf)
    return any(
        _least_left(coupled_mass_matrix(sid, q), axes) <= 0.0
        for way in (1.0, -1.0)
        for q in np.diag(way * largest)
    )


def _least_left(M: Array, axes: list[int]) -> float:
    """Smallest eigenvalue of what the shape functions leave of the inertia of the
    frame, in units of all of it."""
    frame, both, elastic = M[np.ix_(axes, axes)], M[6:, axes], M[6:, 6:]
    size = np.sqrt(np.abs(frame.diagonal()))
    size = np.where(size > 0.0, size, 1.0)
    left = (frame - both.T @ np.linalg.lstsq(elastic, both)[0]) / np.outer(size, size)
    return float(np.linalg.eigvalsh(0.5 * (left + left.T))[0])
