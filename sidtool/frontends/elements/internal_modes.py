"""Incompatible modes: displacements xi (1 - xi) of each direction inside an element.

Source: R. L. Taylor, P. J. Beresford, E. L. Wilson, "A non-conforming element for
stress analysis", Int. J. Numer. Methods Eng. 10, 1976.
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
    slopes = internal_slopes(
        element,
        positions[batch.nodes],
        element.points,
        batch.measures / element.weights,
    )
    return replace(batch, internal=slopes)


def internal_slopes(
    element: ReferenceElement, corners: Array, points: Array, determinants: Array
) -> Array:
    """(ne, g, d, d) gradients of the internal modes in space [1/m].

    They are differentiated with the Jacobian at the centre, scaled by the ratio of
    determinants, so that their strains vanish in the mean and the patch test is
    passed.

    Parameters
    ----------
    corners : (ne, m, d) node positions
    points : (g, d) in the reference element
    determinants : (ne, g) of the Jacobian there
    """
    d = element.dimension
    _, centre = element.at(np.full((1, d), 0.5))
    jacobians = np.swapaxes(corners, 1, 2) @ centre[0]
    slopes = np.zeros((len(points), d, d))
    slopes[:, range(d), range(d)] = 1 - 2 * points
    ratio = np.linalg.det(jacobians)[:, None] / determinants
    internal: Array = slopes @ np.linalg.inv(jacobians)[:, None]
    return internal * ratio[..., None, None]
