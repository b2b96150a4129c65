"""Numbers of a SID in the order in which kernels read them."""

from typing import Any

import numpy as np

from sidtool.formats.base.sid import J_INDICES, SID, Array, Node, Taylor
from sidtool.formats.storage.cache import cached_by_identity

from ..dynamics.body import MATRICES, SCALARS, VECTORS
from ..spatial.system_arrays import (
    DIAGONAL_DE,
    DIAGONAL_KE,
    DIAGONAL_ME,
    HAS_CR1,
    HAS_CT1,
    HAS_KE1,
    HAS_OE1,
    HAS_QUADRATIC_J,
    STIFFENED,
)
from .sid_terms import (
    cr1,
    ct1,
    cubic_stiffness,
    has_second_order,
    oe1,
    without_rotation_blocks,
)
from .stiffening import FreeShapes, MeanAxes, free_shapes, mean_axes

#: Couplings in Me and De below this part of its diagonal are rounding.
ROUNDING = 1e-13


@cached_by_identity
def term_flags(sid: SID, quadratic_inertia: bool) -> int:
    """Which optional terms the equations of a SID have, and shapes of its matrices."""
    plain, nq, stiffened = without_rotation_blocks(sid), sid.nq, has_second_order(sid)
    applies = {
        HAS_CR1: plain.Cr.first_order(nq).any(),
        HAS_OE1: plain.Oe.first_order(nq).any(),
        HAS_CT1: sid.Ct.first_order(nq).any(),
        HAS_QUADRATIC_J: quadratic_inertia and plain.Oe.first_order(nq).any(),
        HAS_KE1: sid.Ke.first_order(nq).any(),
        DIAGONAL_ME: is_diagonal(elastic_mass(sid)) and not stiffened,
        STIFFENED: stiffened,
        DIAGONAL_KE: is_diagonal(sid.Ke.m0),
        DIAGONAL_DE: is_diagonal(damping_matrix(sid)),
    }
    return sum(bit for bit, needed in applies.items() if needed)


def _ke1(sid: SID) -> list[Array]:
    """The first-order term of Ke, if there is one; see `cubic_stiffness`."""
    return [cubic_stiffness(sid)] if sid.Ke.first_order(sid.nq).any() else []


def stiffened_inertia(sid: SID, planar: bool) -> tuple[MeanAxes, FreeShapes]:
    """What the inertia of a stiffened body is made of; zero for others."""
    if has_second_order(sid):
        axes = mean_axes(sid, ct1(sid), cr1(sid), oe1(sid), planar)
        return axes, free_shapes(sid, elastic_mass(sid), cr1(sid), planar)
    n, zero = (sid.nq, sid.nq), np.zeros((3, 3))
    d2_inertia, d_inertia = np.zeros((*n, 3, 3)), np.zeros((sid.nq, 3, 3))
    axes = MeanAxes(
        np.zeros((sid.nq, 3)), zero, d_inertia, d2_inertia, np.zeros((3, *n))
    )
    return axes, FreeShapes(np.zeros(n), np.zeros((3, *n)))


@cached_by_identity
def pack_sid(sid_: SID, planar: bool) -> Array:
    """The reals of a body in the order of `equations.blocks`."""
    pairs = [(2, 2)] if planar else J_INDICES
    translation, rotation = slice(2 if planar else 3), slice(2 if planar else 0, 3)
    matrix = slice(2, 3) if planar else slice(6)
    if not sid_.nq:
        J0, H0 = sid_.J.m0[matrix, 0], np.zeros(len(pairs))
        return np.concatenate([[sid_.mass], sid_.mdCM.m0[translation, 0], J0, H0])
    sid, nq = without_rotation_blocks(sid_), sid_.nq
    cr1_term = cr1(sid)
    axes, free = stiffened_inertia(sid_, planar)
    values: dict[str, Any] = {
        "mass": sid.mass,
        "mdCM": sid.mdCM.m0[translation, 0],
        "J0": sid.J.m0[matrix, 0],
        "H0": [axes.inertia[a, b] for a, b in pairs],
        "Ct0": sid.Ct.m0.T[translation],
        "Cr0": sid.Cr.m0.T[rotation],
        "J1": sid.J.first_order(nq)[:, matrix, 0].T,
        "Oe0": sid.Oe.m0.T[matrix],
        "ksigma": sid.ksigma.m0[:, 0],
        "theta_k": axes.theta.T[rotation],
        "H_derivative": [axes.d_inertia[:, a, b] for a, b in pairs],
        "Ke": sid.Ke.m0,
        "De": damping_matrix(sid_),
        "Cr1": cr1_term[rotation],
        "Ge": (cr1_term - cr1_term.transpose(0, 2, 1))[rotation],
        "Oe1": oe1(sid)[matrix],
        "Ct1": ct1(sid)[translation],
        "coupling": axes.coupling[rotation],
        "H_second_derivative": [axes.d2_inertia[:, :, a, b] for a, b in pairs],
        "free_rotation": free.rotation_coupling[rotation],
        "free_mass": free.mass,
    }
    names = [*SCALARS, *VECTORS, *MATRICES]
    blocks = [*(values[name] for name in names), *_ke1(sid)]
    return np.concatenate([np.ravel(block) for block in blocks])


@cached_by_identity
def pack_spatial_marker(node: Node) -> Array:
    """Position, orientation (rows), Phi and Psi of a marker in space."""
    frame, shapes = nearest_rotation(node.AP.m0), shape_functions(node, planar=False)
    return np.concatenate([node.position, frame.ravel(), shapes.ravel()])


def nearest_rotation(matrix: Array) -> Array:
    """The rotation nearest to a matrix."""
    left, _, right = np.linalg.svd(matrix)
    return left @ right


def pack_planar_marker(node: Node, angle: float) -> Array:
    """Position, angle, Phi (x then y) and Psi of a marker in the plane."""
    pose = [*node.position[:2], angle]
    return np.concatenate([pose, shape_functions(node, planar=True).ravel()])


def shape_functions(node: Node, planar: bool) -> Array:
    """Phi and Psi of a marker at q = 0, as rows: x y and z, or all six."""
    if planar:
        return np.vstack([node.phi.m0[:2], node.psi.m0[2:]])
    return np.vstack([node.phi.m0, node.psi.m0])


def pack_stiffening(shapes: Taylor, rows: slice) -> Array:
    """m1 of Phi or Psi as (row, k, l), symmetric in k and l; empty for none."""
    if shapes.m1 is None or not shapes.m1[:, rows].any():
        return np.zeros(0)
    term = np.moveaxis(shapes.m1[:, rows], 1, 0)
    return (0.5 * (term + term.transpose(0, 2, 1))).ravel()


@cached_by_identity
def elastic_mass(sid: SID) -> Array:
    """Me, symmetric; diagonal where it is so but for rounding."""
    return _clean_diagonal(symmetrise(sid.Me.m0))


@cached_by_identity
def damping_matrix(sid: SID) -> Array:
    """De; diagonal where it is so but for rounding."""
    return _clean_diagonal(sid.De.m0)


def _clean_diagonal(matrix: Array) -> Array:
    diagonal = np.diag(matrix)
    size = np.sqrt(np.abs(np.outer(diagonal, diagonal)))
    coupled = np.abs(matrix - np.diag(diagonal)) > ROUNDING * size
    return matrix if coupled.any() else np.diag(diagonal)


def is_diagonal(matrix: Array) -> bool:
    return not (matrix - np.diag(np.diag(matrix))).any()


def symmetrise(matrix: Array) -> Array:
    """The symmetric part of a matrix."""
    return 0.5 * (matrix + matrix.T)


def quaternion(matrix: Array) -> Array:
    """Unit quaternions (..., 4), scalar first, scalar >= 0, of rotation matrices (...,
    3, 3).
    """
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    candidates = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], wx, wy, wz],
            [wx, 1 + m[0, 0] - m[1, 1] - m[2, 2], xy, xz],
            [wy, xy, 1 - m[0, 0] + m[1, 1] - m[2, 2], yz],
            [wz, xz, yz, 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    largest = np.argmax(np.diagonal(candidates), axis=-1)
    best = np.take_along_axis(candidates, largest[None, None], axis=0)[0]
    best = np.moveaxis(best / np.linalg.norm(best, axis=0), 0, -1)
    return np.where(best[..., :1] < 0.0, -best, best)
