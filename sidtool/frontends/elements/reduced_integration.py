"""Strains at fewer points, where full integration makes bending elements too stiff.

The work of uniform stress stays exact, so that distorted elements and those with curved
edges pass the patch test: the mean of the gradients over an element is that of the full
rule.

Sources: T. J. R. Hughes, "Generalization of selective integration procedures to
anisotropic and nonlinear media", Int. J. Numer. Methods Eng. 15, 1980, for the
means; J.-S. Chen, M. Hillman, M. Rueter, "An arbitrary order variationally consistent
integration for Galerkin meshfree methods", Int. J. Numer. Methods Eng. 95, 2013, for
the correction.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .internal_modes import RELIEVED_KINDS
from .quadrature_rules import prism_rule, quadrature_rule
from .reference import ReferenceElement, reference_element
from .solid import ElementBatch, mapped_batch

Array = NDArray[np.float64]

#: Fewer points, exact to degree 2 (in the triangle of a prism), as of Abaqus' and
#: CalculiX' C3D10 and C3D15: what strains of quadratic elements need.
_FEWER = {"tet10": quadrature_rule("tet", 2), "wedge15": prism_rule(2, 4)}


def extrapolation(kind: str, where: Array, *, relieved: bool) -> Array | None:
    """(g,) weights of the stiffness' points for the strain at a reference point.

    Strains at these points are better than those elsewhere in the element. None for
    elements whose strains are as good anywhere.

    Parameters
    ----------
    relieved : whether the element has internal modes: their slopes are right at its
        points, where uniform stress does no work on them
    """
    if not relieved and kind not in _FEWER:
        return None
    points = _FEWER[kind][0] if kind in _FEWER else reference_element(kind).points
    fields = np.vstack([_linear(kind, points), _linear(kind, where[None])])
    return np.asarray(np.linalg.solve(fields[:-1].T, fields[-1]), float)


def _linear(kind: str, points: Array) -> Array:
    """As many fields as points: linear ones; those of a linear element with internal
    modes; along the axis of prisms as many powers as there are heights."""
    if kind in RELIEVED_KINDS:
        return reference_element(kind).at(points)[0]
    flat = np.column_stack([np.ones(len(points)), points])
    if kind == "tet10":
        return flat
    heights = points[:, 2:] ** np.arange(3 if kind == "wedge15" else 2)
    return (flat[:, :3, None] * heights[:, None, :]).reshape(len(points), -1)


def with_fewer_points(
    batch: ElementBatch, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """A batch of the stiffness at fewer points, of the elements that lock less then."""
    kind = element.name
    if kind not in _FEWER:
        return batch
    points, weights = _FEWER[kind]
    values, gradients = reference_element(kind).at(points)
    few = mapped_batch(batch.nodes, positions, values[None], gradients[None], weights)
    volume = batch.measures.sum(axis=1)
    measures = few.measures * (volume / few.measures.sum(axis=1))[:, None]
    missing = _integral(batch.measures, batch.gradients)
    missing -= _integral(measures, few.gradients)
    shift = missing / volume[:, None, None]
    return replace(few, gradients=few.gradients + shift[:, None], measures=measures)


def _integral(measures: Array, gradients: Array) -> Array:
    """(ne, m, d) of the gradients over each element."""
    return np.asarray(np.einsum("eg,egmd->emd", measures, gradients), float)
