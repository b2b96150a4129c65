"""Reduction methods by the `reduction.method` of a model file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formats.errors import InputError
from formats.model import ModalReduction

from ..frontends.finite_element_model import FiniteElementModel
from .eigen import free_body_shift, lowest_eigenpairs
from .frames import Frame

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """Shape functions of a body.

    Attributes
    ----------
    shapes : (ndof, nq)
    stiffness : (nq, nq) shapes^T K shapes
    labels : nq texts for the SID
    """

    shapes: Array
    stiffness: Array
    labels: tuple[str, ...]

    def reconstruct(self, q: ArrayLike) -> Array:
        """The displacement of every degree of freedom, (ndof,), for q (nq,)."""
        return self.shapes @ np.asarray(q, float)


def modal_truncation(
    model: FiniteElementModel, frame: Frame, settings: ModalReduction
) -> ReducedBasis:
    """The lowest modes of the body held in its frame, mass-normalised.

    See `oriented` for their signs.

    Raises
    ------
    InputError : the model has fewer degrees of freedom than modes are asked for.
    """
    free = np.flatnonzero(~frame.held)
    stiffness = model.stiffness[free][:, free]
    mass = model.mass[free][:, free]
    shift = 0.0
    if free.size == model.ndof:
        shift = free_body_shift(stiffness, mass, model.positions)
    try:
        values, vectors = lowest_eigenpairs(
            stiffness, mass, settings.modes, shift=shift
        )
    except InputError as error:
        raise InputError(
            error.problem, place="reduction.modes", expected=error.expected
        ) from None
    shapes = np.zeros((model.ndof, settings.modes))
    shapes[free] = vectors
    return ReducedBasis(
        shapes=oriented(shapes, model),
        stiffness=np.diag(values),
        labels=tuple(_label(i + 1, value) for i, value in enumerate(values)),
    )


def oriented(shapes: Array, model: FiniteElementModel) -> Array:
    """The same shape functions with signs that do not depend on the solver.

    A shape function is positive in the largest component of its displacement at the
    last marker of the model file at which it moves; if it moves at none, in the
    largest component of all.
    """
    signs = [_sign(shape, model) for shape in shapes.T]
    return shapes * signs


def _sign(shape: Array, model: FiniteElementModel) -> float:
    visible = 1e-6 * np.abs(shape).max()
    for marker in reversed(model.markers):
        motion = marker.displacement @ shape
        largest = motion[np.argmax(np.abs(motion))]
        if abs(largest) > visible:
            return np.sign(largest)
    return np.sign(shape[np.argmax(np.abs(shape))])


def _label(number: int, eigenvalue: float) -> str:
    hertz = np.sqrt(max(eigenvalue, 0.0)) / (2 * np.pi)
    return f"Eigen Mode{number:5d} :{hertz:13.3f} Hz"


Reduction = Callable[[FiniteElementModel, Frame, ModalReduction], ReducedBasis]

#: One line adds a method.
REDUCTIONS: dict[str, Reduction] = {"modal": modal_truncation}
