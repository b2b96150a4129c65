"""Remedies for locking: reduced integration and incompatible modes.

Reduced integration keeps the work of uniform stress exact, so that distorted elements
and those with curved edges pass the patch test: the mean of the gradients over an
element is that of the full rule.

Incompatible modes: the functions b_i = xi_i (1 - xi_i) bend elements; b_i (1 - 2 xi_j)
with i != j twist warped ones and keep the volume of skew ones. Amplitudes of the latter
have no component along axis j, where b_j (1 - 2 xi_i) has the same strain.

Linear prisms always have the quadratic functions L_i L_j of their triangle and b = zeta
(1 - zeta) along their axis. Those of the triangle let a bent prism contract
transversely, and its cross-section warp. Transverse shear that is the gradient of a
quadratic deflection, which locks plates, then does no work; that of torsion, which is
no gradient, does. Fewer quadrature points instead would leave torsion without
stiffness.

Sources: T. J. R. Hughes, "Generalization of selective integration procedures to
anisotropic and nonlinear media", Int. J. Numer. Methods Eng. 15, 1980, for the means;
J.-S. Chen, M. Hillman, M. Rueter, "An arbitrary order variationally consistent
integration for Galerkin meshfree methods", Int. J. Numer. Methods Eng. 95, 2013, for
the correction; R. L. Taylor, P. J. Beresford, E. L. Wilson, "A non-conforming element
for stress analysis", Int. J. Numer. Methods Eng. 10, 1976, for the first functions;
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

from sidtool.formats.base.complex_step import analytic_norm
from sidtool.formats.base.taylor import Array

from ..mesh.quadrature_rules import prism_rule, quadrature_rule
from ..mesh.reference_elements import ReferenceElement, reference_element
from .solid_elements import ElementBatch, mapped_batch

#: Fewer points, exact to degree 2 (in the triangle of a prism), as of Abaqus' and
#: CalculiX' C3D10 and C3D15: what strains of quadratic elements need.
_REDUCED_RULES = {"tet10": quadrature_rule("tet", 2), "wedge15": prism_rule(2, 4)}


def extrapolation(kind: str, where: Array, *, relieved: bool) -> Array | None:
    """(g,) weights of the stiffness' points for the strain at a reference point.

    Strains at these points are more accurate than elsewhere in the element. The result
    is None for elements whose strains are equally accurate everywhere.

    Parameters
    ----------
    relieved : whether the element has internal modes: their slopes are right at its
        points, where uniform stress does no work on them
    """
    if not relieved and kind not in _REDUCED_RULES:
        return None
    points = (
        _REDUCED_RULES[kind][0]
        if kind in _REDUCED_RULES
        else reference_element(kind).points
    )
    fields = np.vstack(
        [_linear_fields(kind, points), _linear_fields(kind, where[None])]
    )
    return np.asarray(np.linalg.solve(fields[:-1].T, fields[-1]))


def _linear_fields(kind: str, points: Array) -> Array:
    """Return as many fields as points.

    Linear fields; those of a linear element with internal modes; along the axis of
    prisms as many powers as there are heights.
    """
    if kind in KINDS_WITH_INCOMPATIBLE_MODES:
        return reference_element(kind).at(points)[0]
    flat = np.column_stack([np.ones(len(points)), points])
    if kind == "tet10":
        return flat
    heights = points[:, 2:] ** np.arange(3 if kind == "wedge15" else 2)
    return (flat[:, :3, None] * heights[:, None, :]).reshape(len(points), -1)


def with_reduced_integration(
    batch: ElementBatch, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """Return a batch with reduced integration, for elements that lock less with it."""
    kind = element.name
    if kind not in _REDUCED_RULES:
        return batch
    points, weights = _REDUCED_RULES[kind]
    values, gradients = reference_element(kind).at(points)
    few = mapped_batch(batch.nodes, positions, values[None], gradients[None], weights)
    volume = batch.measures.sum(axis=1)
    measures = few.measures * (volume / few.measures.sum(axis=1))[:, None]
    missing = _gradient_integrals(batch.measures, batch.gradients)
    missing -= _gradient_integrals(measures, few.gradients)
    shift = missing / volume[:, None, None]
    return replace(few, gradients=few.gradients + shift[:, None], measures=measures)


def _gradient_integrals(measures: Array, gradients: Array) -> Array:
    """(ne, m, d) of the gradients over each element."""
    return np.asarray(np.einsum("eg,egmd->emd", measures, gradients))


#: Elements with optional incompatible modes.
KINDS_WITH_INCOMPATIBLE_MODES = ("quad4", "hex8")
#: Elements that always have incompatible modes.
KINDS_ALWAYS_INCOMPATIBLE = ("wedge6",)


def with_incompatible_modes(
    batch: ElementBatch, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """A batch at the element's quadrature points with its internal modes."""
    if element.name in KINDS_ALWAYS_INCOMPATIBLE:
        functions = 4
        free = np.eye(functions * element.dimension)
        directions = np.broadcast_to(free, (len(batch.nodes), *free.shape))
    else:
        _, centre = element.at(np.full((1, element.dimension), 0.5))
        directions = _allowed_amplitudes(
            np.swapaxes(positions[batch.nodes], 1, 2) @ centre[0]
        )
    return replace(
        batch,
        internal=internal_slopes(element, batch.gradients, batch.measures),
        directions=directions,
        inner=internal_values(element.name, element.points),
    )


def internal_values(kind: str, points: Array) -> Array:
    """(g, k) the functions that are displacements, at reference points (g, d).

    They are zero at all nodes. Modes that twist cubes contribute strains only. As
    displacements in mass and markers they would change frequencies of coarse parts by
    5e-4.
    """
    if kind not in KINDS_ALWAYS_INCOMPATIBLE:
        return points * (1 - points)
    x, y, z = points.T
    rest = 1 - x - y
    return np.stack([x * y, y * rest, rest * x, z * (1 - z)], axis=1)


def internal_gradients(kind: str, points: Array) -> Array:
    """(g, k, d) of `internal_values`, by the reference coordinates."""
    line = 1 - 2 * points
    if kind not in KINDS_ALWAYS_INCOMPATIBLE:
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

    Their mean over the element is subtracted, so that uniform stress does no work on
    them and the patch test is passed.

    Parameters
    ----------
    gradients : (ne, g, m, d) of the nodal functions in space [1/m]
    measures : (ne, g) quadrature weights times Jacobian determinants [m^d]
    """
    natural = internal_gradients(element.name, element.points)
    if element.name not in KINDS_ALWAYS_INCOMPATIBLE:
        natural = np.concatenate([natural, _twisting_gradients(element.points)], axis=1)
    slopes = natural @ np.linalg.pinv(element.gradients) @ gradients
    shares = measures / measures.sum(axis=1, keepdims=True)
    means = np.einsum("eg,egkb->ekb", shares, slopes)
    return np.asarray(slopes - means[:, None])


def _twisting_gradients(points: Array) -> Array:
    """(g, d (d - 1), d) gradients of b_i (1 - 2 xi_j) by the reference coordinates."""
    d = points.shape[1]
    line, bubble = 1 - 2 * points, points * (1 - points)
    natural = np.zeros((len(line), d * (d - 1), d))
    for k, (i, j) in enumerate(permutations(range(d), 2)):
        natural[:, k, i] = line[:, i] * line[:, j]
        natural[:, k, j] = -2 * bubble[:, i]
    return natural


def _allowed_amplitudes(jacobians: Array) -> Array:
    """(ne, d^3, r) amplitudes that internal modes may have; Jacobians (ne, d, d)."""
    d = jacobians.shape[-1]
    dual = np.linalg.inv(jacobians)
    dual /= analytic_norm(dual, axis=2, keepdims=True)
    count = d * d + d * (d - 1) ** 2
    amplitudes = np.zeros((len(dual), d**3, count), dual.dtype)
    amplitudes[:, range(d * d), range(d * d)] = 1
    column = d * d
    for k, (_, j) in enumerate(permutations(range(d), 2), d):
        for across in set(range(d)) - {j}:
            amplitudes[:, k * d : (k + 1) * d, column] = dual[:, across]
            column += 1
    return amplitudes
