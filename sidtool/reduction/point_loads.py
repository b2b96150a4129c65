"""Markers at a single point of a plane body or a solid, where compliance has no limit.

The displacement under a force at a point of an elastic continuum is infinite: on a mesh
it grows with the logarithm of the element size in plane bodies, and with its reciprocal
in solids (Flamant's and Boussinesq's solutions). A tie spreads the force.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..elements.finite_element_model import FiniteElementModel

_GROWTH = {
    2: ("plane body", "with the logarithm of the element size"),
    3: ("solid", "with the reciprocal of the element size"),
}


def point_markers(body: FiniteElementModel, held: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the markers at single points of a plane body or a solid that can move.

    held : (ndof,) degrees of freedom that are clamped in the frame
    """
    if body.dof_table is not None:
        return ()
    return tuple(
        marker.name
        for marker in body.markers
        if marker.gradient is not None and not held[marker.displacement.indices].all()
    )


def point_marker_note(
    body: FiniteElementModel, held: NDArray[np.bool_]
) -> tuple[Diagnostic, ...]:
    """Return N163 on markers whose compliance does not converge."""
    names = point_markers(body, held)
    if not names:
        return ()
    kind, growth = _GROWTH[body.dimension]
    return (diagnose("N163", ", ".join(names), kind=kind, growth=growth),)
