"""Incompatible modes: displacements of each direction inside an element.

The functions b_i = xi_i (1 - xi_i) bend elements; b_i (1 - 2 xi_j) with i != j twist
warped ones and keep the volume of skew ones. Amplitudes of the latter have no component
along axis j, where b_j (1 - 2 xi_i) strains alike.

Linear prisms always have the quadratic functions L_i L_j of their triangle and
b = zeta (1 - zeta) along their axis. Those of the triangle let a bent prism contract
across, and its cross section warp: transverse shear that is the gradient of a quadratic
deflection, which locks plates, does no work; that of torsion, which is no gradient,
does. Fewer quadrature points instead would leave torsion free.

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

#: Elements that have incompatible modes where the model asks for them: the cube's.
RELIEVED_KINDS = ("quad4", "hex8")
#: Elements that always have them.
ALWAYS_RELIEVED = ("wedge6",)


def relieved(
    batch: ElementBatch, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """A batch at the element's quadrature points with its internal modes."""
    if element.name in ALWAYS_RELIEVED:
        functions = 4
        free = np.eye(functions * element.dimension)
        directions = np.broadcast_to(free, (len(batch.nodes), *free.shape))
    else:
        _, centre = element.at(np.full((1, element.dimension), 0.5))
        directions = _directions(np.swapaxes(positions[batch.nodes], 1, 2) @ centre[0])
    return replace(
        batch,
        internal=internal_slopes(element, batch.gradients, batch.measures),
        directions=directions,
        inner=internal_values(element.name, element.points),
    )


def internal_values(kind: str, points: Array) -> Array:
    """(g, k) the functions that are displacements, at reference points (g, d).

    They are zero at all nodes. Those that twist cubes count by their strains alone: as
    displacements, of which mass and markers are made, they would change frequencies of
    coarse parts by 5e-4.
    """
    if kind not in ALWAYS_RELIEVED:
        return points * (1 - points)
    x, y, z = points.T
    rest = 1 - x - y
    return np.stack([x * y, y * rest, rest * x, z * (1 - z)], axis=1)


def internal_gradients(kind: str, points: Array) -> Array:
    """(g, k, d) of `internal_values`, by the reference coordinates."""
    line = 1 - 2 * points
    if kind not in ALWAYS_RELIEVED:
        return line[:, :, None] * np.eye(points.shape[1])
    x, y, _ = points.T
    rest, none = 1 - x - y, np.zeros(len(points))
    rows = [
        (y, x, none),
        (-y, rest - y, none),
        (rest - x, -x, none),
        (none, none, line[:, 2]),
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def internal_slopes(
    element: ReferenceElement, gradients: Array, measures: Array
) -> Array:
    """(ne, g, k, d) gradients of the internal modes in space [1/m].

    They come less their mean over the element, so that uniform stress does no work on
    them and the patch test is passed.

    Parameters
    ----------
    gradients : (ne, g, m, d) of the nodal functions in space [1/m]
    measures : (ne, g) quadrature weights times Jacobian determinants [m^d]
    """
    natural = internal_gradients(element.name, element.points)
    if element.name not in ALWAYS_RELIEVED:
        natural = np.concatenate([natural, _twisting(element.points)], axis=1)
    slopes = natural @ np.linalg.pinv(element.gradients) @ gradients
    shares = measures / measures.sum(axis=1, keepdims=True)
    means = np.einsum("eg,egkb->ekb", shares, slopes)
    return np.asarray(slopes - means[:, None], float)


def _twisting(points: Array) -> Array:
    """(g, d (d - 1), d) gradients of b_i (1 - 2 xi_j) by the reference coordinates."""
    d = points.shape[1]
    line, bow = 1 - 2 * points, points * (1 - points)
    natural = np.zeros((len(line), d * (d - 1), d))
    for k, (i, j) in enumerate(permutations(range(d), 2)):
        natural[:, k, i] = line[:, i] * line[:, j]
        natural[:, k, j] = -2 * bow[:, i]
    return natural


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
