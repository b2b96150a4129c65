"""Body frames: where the frame sits and what does not move in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from formats.errors import InputError
from formats.model import TangentFrame

from ..frontends.finite_element_model import FiniteElementModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Frame:
    """A body frame, parallel to the axes of the model.

    Attributes
    ----------
    origin : (3,) in the axes of the model [m]
    held : (ndof,) the degrees of freedom that vanish in this frame
    """

    origin: Array
    held: NDArray[np.bool_]


def tangent_frame(model: FiniteElementModel, settings: TangentFrame) -> Frame:
    """The frame of a marker on clamped edges, where nothing moves or turns.

    Raises
    ------
    InputError : the marker does not lie on the clamped edges.
    """
    held = np.zeros(model.ndof, bool)
    for edge in settings.clamped_edges:
        held[model.dofs(model.node_sets[edge])] = True
    marker = model.marker(settings.marker)
    if not held[marker.displacement.indices].all():
        edges = " and ".join(settings.clamped_edges)
        raise InputError(
            f"marker {settings.marker} is not on the clamped edge {edges}",
            place="frame.marker",
            expected="a marker that does not move in its own frame",
        )
    return Frame(origin=marker.position, held=held)


#: The frames by the `frame.type` of a model file.
FRAMES: dict[str, Callable[[FiniteElementModel, TangentFrame], Frame]] = {
    "tangent": tangent_frame
}
