"""Incompatible modes: displacements of each direction inside an element.

The functions b_i = xi_i (1 - xi_i) bend elements; b_i (1 - 2 xi_j) with i != j twist
warped ones and keep the volume of skew ones. Amplitudes of the latter have no component
along axis j, where b_j (1 - 2 xi_i) strains alike.

Sources: R. L. Taylor, P. J. Beresford, E. L. Wilson, "A non-conforming element for
stress analysis", Int. J. Numer. Methods Eng. 10, 1976, for the first functions;
U. Andelfinger, E. Ramm, "EAS-elements for two-dimensional, three-dimensional, plate and
shell structures and their equivalence to HR-elements", Int. J. Numer. Methods Eng. 36,
1993, for the strains of all (EAS-21); E. L. Wilson, A. Ibrahimbegovic, "Use of
incompatible displacement modes for the calculation of element stiffnesses or
stresses", Finite Elem. Anal. Des. 7, 1990, for the correction by the mean.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

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
    _, centre = element.at(np.full((1, element.dimension), 0.5))
    jacobians = np.swapaxes(positions[batch.nodes], 1, 2) @ centre[0]
    return replace(
        batch,
        internal=internal_slopes(element, batch.gradients, batch.measures),
        directions=_directions(jacobians),
        inner=internal_values(element.points),
    )


def internal_values(points: Array) -> Array:
    """(g, d) the b_i at reference points (g, d); zero at all nodes.

    The other functions count by their strains alone: as displacements, of which mass
    and markers are made, they would change frequencies of coarse parts by 5e-4.
    """
    return points * (1 - points)


def internal_slopes(
    element: ReferenceElement, gradients: Array, measures: Array
) -> Array:
    """(ne, g, d d, d) gradients of the internal modes in space [1/m].

    They come less their mean over the element, so that uniform stress does no work on
    them and the patch test is passed.

    Parameters
    ----------
    gradients : (ne, g, m, d) of the nodal functions in space [1/m]
    measures : (ne, g) quadrature weights times Jacobian determinants [m^d]
    """
    d = element.dimension
    line, bow = 1 - 2 * element.points, internal_values(element.points)
    natural = np.zeros((len(line), d * d, d))
    natural[:, range(d), range(d)] = line
    for k, (i, j) in enumerate(permutations(range(d), 2), d):
        natural[:, k, i] = line[:, i] * line[:, j]
        natural[:, k, j] = -2 * bow[:, i]
    slopes = natural @ np.linalg.pinv(element.gradients) @ gradients
    shares = measures / measures.sum(axis=1, keepdims=True)
    means = np.einsum("eg,egkb->ekb", shares, slopes)
    return np.asarray(slopes - means[:, None], float)


def _directions(jacobians: Array) -> Array:
    """(ne, d^3, r) amplitudes that internal modes may have; Jacobians (ne, d, d)."""
    d = jacobians.shape[-1]
    dual = np.linalg.inv(jacobians)
    dual /= np.linalg.norm(dual, axis=2, keepdims=True)
    found = np.zeros((len(dual), d**3, d * d + d * (d - 1) ** 2))
    found[:, range(d * d), range(d * d)] = 1
    column = d * d
    for k, (_, j) in enumerate(permutations(range(d), 2), d):
        for across in set(range(d)) - {j}:
            found[:, k * d : (k + 1) * d, column] = dual[:, across]
            column += 1
    return found
