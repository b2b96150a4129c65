"""Incompatible modes: displacements xi (1 - xi) of each direction inside an element.

Sources: R. L. Taylor, P. J. Beresford, E. L. Wilson, "A non-conforming element for
stress analysis", Int. J. Numer. Methods Eng. 10, 1976, for the modes and the Jacobian
at the centre; E. L. Wilson, A. Ibrahimbegovic, "Use of incompatible displacement modes
for the calculation of element stiffnesses or stresses", Finite Elem. Anal. Des. 7,
1990, for the correction by the mean.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .reference import ReferenceElement
from .solid import ElementBatch

Array = NDArray[np.float64]

#: Elements that have incompatible modes: the cube's.
RELIEVED_KINDS = ("quad4", "hex8")


def relieved(
    batch: ElementBatch, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """A batch at the element's quadrature points with its internal modes."""
    slopes = internal_slopes(element, positions[batch.nodes], batch.measures)
    return replace(batch, internal=slopes, inner=internal_values(element.points))


def internal_values(points: Array) -> Array:
    """(g, d) the internal modes at reference points (g, d); zero at all nodes."""
    return points * (1 - points)


def internal_slopes(
    element: ReferenceElement, corners: Array, measures: Array
) -> Array:
    """(ne, g, d, d) gradients of the internal modes in space [1/m].

    They are differentiated with the Jacobian at the centre, less their mean over the
    element, so that uniform stress does no work on them and the patch test is passed.

    Parameters
    ----------
    corners : (ne, m, d) node positions
    measures : (ne, g) quadrature weights times Jacobian determinants [m^d]
    """
    d = element.dimension
    _, centre = element.at(np.full((1, d), 0.5))
    jacobians = np.swapaxes(corners, 1, 2) @ centre[0]
    slopes = np.zeros((len(element.points), d, d))
    slopes[:, range(d), range(d)] = 1 - 2 * element.points
    shares = measures / measures.sum(axis=1, keepdims=True)
    means = np.einsum("eg,gkb->ekb", shares, slopes)
    apart = slopes - means[:, None]
    return np.asarray(apart @ np.linalg.inv(jacobians)[:, None], float)
