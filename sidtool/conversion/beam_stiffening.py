"""Geometric stiffness of beams from their stress resultants.

A point (y, z) of a cross-section moves with the gradient g_x = a + y b + z c along the
beam, and with g_y and g_z across it:

    a = (u', v', w'),   b = (-kz, 0, theta'),   c = (ky, -theta', 0),
    g_y = (-psi_z, 0, theta),   g_z = (psi_y, -theta, 0),

with the rotation (theta, psi_y, psi_z) of the cross-section and its curvatures ky, kz.
The integral of sigma_xx g_x . g_x + 2 sigma_xy g_x . g_y + 2 sigma_xz g_x . g_z over
a doubly symmetric section, with the stresses of its resultants N, My, Mz, Qy, Qz and T,
is the quadratic form below. The torsional moment acts through
integral (y sigma_xz) = -integral (z sigma_xy) = T / 2.

In a beam that is bent at rest by ky0 and kz0 a fibre has the length 1 + z ky0 - y kz0:
what strains it is divided by that, (0, psi_z, -psi_y) of a is not, and volumes are
multiplied by it. To first order this adds (ky0 My + kz0 Mz) (psi_y^2 + psi_z^2) and
T theta (ky0 psi_y + kz0 psi_z).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frontends.beams.material import BeamMaterial

Array = NDArray[np.float64]


def beam_stiffness(material: BeamMaterial, states: Array, shapes: Array) -> Array:
    """(n, nq, nq) geometric stiffness of the stresses of displacements (ndof, n).

    Parameters
    ----------
    states : (ndof, n) displacements whose stress acts
    shapes : (ndof, nq)
    """
    a, b, c, across_y, across_z = _gradients(material, shapes)
    iy, iz = material.gyration.T[:, :, None, None]
    normal = _product(a, a) + iz * _product(b, b) + iy * _product(c, c)
    resultants = np.moveaxis(material.resultants_of(states), 1, 0)
    normal_force, shear_y, shear_z, twisting, bending_y, bending_z = resultants
    terms = (
        (normal_force, normal),
        (bending_y, 2 * _product(a, c)),
        (-bending_z, 2 * _product(a, b)),
        (shear_y, 2 * _product(a, across_y)),
        (shear_z, 2 * _product(a, across_z)),
        (twisting, _product(b, across_z) - _product(c, across_y)),
        *_of_bent_ones(material, resultants, shapes),
    )
    total: Array = sum(
        np.einsum("p,pn,pkl->nkl", material.weights, force, form)
        for force, form in terms
    )
    return (total + np.swapaxes(total, 1, 2)) / 2


def _gradients(material: BeamMaterial, shapes: Array) -> tuple[Array, ...]:
    """a, b, c, g_y and g_z at the points, (p, 3, nq) each."""
    strain = np.moveaxis(material.strains_of(shapes), 1, 0)
    turn = np.moveaxis(material.turns_of(shapes), 1, 0)
    stretch, shear_y, shear_z, twist, curved_y, curved_z = strain
    theta, psi_y, psi_z = turn
    zero = np.zeros_like(theta)
    vectors = (
        (stretch, psi_z + shear_y, shear_z - psi_y),
        (-curved_z, zero, twist),
        (curved_y, -twist, zero),
        (-psi_z, zero, theta),
        (psi_y, -theta, zero),
    )
    return tuple(np.stack(vector, axis=1) for vector in vectors)


def _of_bent_ones(
    material: BeamMaterial, resultants: Array, shapes: Array
) -> tuple[tuple[Array, Array], ...]:
    """Forces (p, n) and forms (p, nq, nq) that curvature at rest adds."""
    _, ky, kz = material.curvatures.T[:, :, None]
    if not (ky.any() or kz.any()):
        return ()
    *_, twisting, bending_y, bending_z = resultants
    turns = material.turns_of(shapes)
    across = turns[:, 1:]
    along = (ky * turns[:, 1] + kz * turns[:, 2])[:, None]
    return (
        (ky * bending_y + kz * bending_z, _product(across, across)),
        (twisting, _product(turns[:, :1], along)),
    )


def _product(first: Array, second: Array) -> Array:
    """(p, nq, nq) scalar products of two vector fields (p, 3, nq)."""
    return np.einsum("pck,pcl->pkl", first, second)
