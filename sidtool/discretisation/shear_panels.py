"""Stiffness of shear panels, which carry shear flows along their edges alone.

The stresses of a panel are those whose resultants act along its straight edges: Airy's
function is u v / w, where (u : v : w) are the linear functions of the position that map
the quadrilateral to the unit square. It is bilinear along straight lines between
opposite edges, so that no edge has a normal stress. On a parallelogram these are
uniform; on other quadrilaterals they are the shear flows of S. J. Garvey, "The
quadrilateral shear panel", Aircraft Engineering 23 (5), 1951, as in Nastran. Each
edge hands half of its resultant to either node. By statics the four forces act along
the diagonals, so that they balance on warped panels, too.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

#: Points and weights of the quadrature along an edge of the unit square.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_POINTS, _WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2


def shear_panel_stiffness(corners: Array, law: Array, axis: Array) -> Array:
    """Return the stiffness (ne, 24, 24) of panels by displacements and rotations.

    Parameters
    ----------
    corners : (ne, 4, 3) positions of the nodes around convex panels [m]
    law : (ne, 3, 3) membrane forces by strains xx, yy, xy in the material axes [N/m]
    axis : (ne, 3) directions whose projections are the material axis x
    """
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    normal = _unit(np.cross(first, second))
    x = _unit(axis - np.einsum("ea,ea->e", axis, normal)[:, None] * normal)
    axes = np.stack([x, np.cross(normal, x)], axis=1)
    size = np.linalg.norm(first, axis=1)[:, None, None]
    arms = (corners - corners.mean(axis=1, keepdims=True)) / size
    flat = np.einsum("eia,eka->eik", arms, axes)
    forms = _projective_forms(flat)
    slopes, _ = _airy_function(forms, flat)
    jump = (np.roll(slopes, -1, axis=1) - np.roll(slopes, 1, axis=1)) / 2
    forces = np.stack([jump[..., 1], -jump[..., 0]], axis=2)
    flexibility = _flexibility(forms, flat, np.asarray(np.linalg.inv(law)))
    rows = np.zeros((len(corners), 4, 6))
    rows[..., :3] = np.einsum("eik,eka->eia", forces, axes)
    by_dofs = rows.reshape(-1, 24)
    products = by_dofs[:, :, None] * by_dofs[:, None, :]
    return np.asarray(products / flexibility[:, None, None])


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _projective_forms(flat: Array) -> Array:
    """(ne, 3, 3) coefficients of u, v and w by x, y and 1."""
    p = np.concatenate([flat, np.ones((*flat.shape[:2], 1))], axis=2)
    sides = np.stack([p[:, 1], p[:, 3], -p[:, 0]], axis=2)
    weights = np.linalg.solve(sides, p[:, 2][..., None])
    b, d, a = (weights[:, k] * p[:, i] for k, i in ((0, 1), (1, 3), (2, 0)))
    return np.asarray(np.linalg.inv(np.stack([b - a, d - a, a], axis=2)))


def _airy_function(forms: Array, points: Array) -> tuple[Array, Array]:
    """Slopes (ne, k, 2) and second derivatives (ne, k, 2, 2) of u v / w."""
    values = np.einsum("efa,eka->fek", forms[:, :, :2], points)
    u, v, w = values + forms[:, :, 2].T[:, :, None]
    du, dv, dw = (forms[:, None, k, :2] for k in range(3))
    u, v, w = u[..., None], v[..., None], w[..., None]
    slopes = (v * du + u * dv) / w - u * v / w**2 * dw
    u, v, w = u[..., None], v[..., None], w[..., None]
    curved = (
        _symmetric(du, dv) / w + 2 * u * v / w**3 * dw[..., None] * dw[..., None, :]
    )
    curved = curved - (v * _symmetric(du, dw) + u * _symmetric(dv, dw)) / w**2
    return slopes, curved


def _symmetric(a: Array, b: Array) -> Any:
    return a[..., None] * b[..., None, :] + b[..., None] * a[..., None, :]


def _flexibility(forms: Array, flat: Array, compliance: Array) -> NDArray[np.float64]:
    """(ne,) twice the energy of the stresses."""
    r, s = (x.ravel() for x in np.meshgrid(_POINTS, _POINTS))
    shares = np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], axis=1)
    along = np.stack([s - 1, 1 - s, s, -s], axis=1)
    across = np.stack([r - 1, -r, r, 1 - r], axis=1)
    a, b = (np.einsum("ki,eic->ekc", by, flat) for by in (along, across))
    area = np.outer(_WEIGHTS, _WEIGHTS).ravel() * abs(
        a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    )
    _, curved = _airy_function(forms, np.einsum("ki,eic->ekc", shares, flat))
    stress = np.stack([curved[..., 1, 1], curved[..., 0, 0], -curved[..., 0, 1]], 2)
    return np.asarray(np.einsum("ek,eka,eab,ekb->e", area, stress, compliance, stress))
