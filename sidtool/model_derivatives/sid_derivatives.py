"""Derivatives of the SID of a model by its design variables.

The model is discretised with an imaginary step in the variable, and the functions of a
conversion then carry the step through frame, reduction and SID. Shape functions keep
their sign and normalisation, so that SID + e dSID is the SID of the model with the
variable changed by a small e. Modes of one frequency are differentiated as a subspace,
in which case Ke + e dKe is not diagonal: it holds the frequencies of the changed model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import NODE_SHAPES, SID, Taylor
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.toml.files import locate_errors

from ..conversion.stress_recovery import (
    PointChoice,
    StressPoint,
    peak_points,
    points_at,
)
from ..discretisation.registry import finite_element_model
from ..elements.finite_element_model import FiniteElementModel
from ..pipeline.model_to_sid import sid_of_basis
from ..reduction.admissible_space import AdmissibleSpace
from ..reduction.body_frames import FRAMES, Frame, clamped_dofs
from ..reduction.complex_step_space import NominalSpaces, complex_step_space
from ..reduction.methods import REDUCTIONS, ReducedBasis
from .design_variables import DesignVariable, VariableLike, design_variable
from .sid_with_derivatives import SidDerivatives

__all__ = ["DifferentiableBody", "SidDerivatives", "sid_derivatives"]

#: Shape functions agree to this share of the largest displacement.
_SAME = 1e-6
#: Geometries that other programs discretise, or whose matrices are all there is.
_NOT_OWN = "an own discretisation; matrices and CalculiX elements have no derivatives"


def sid_derivatives(
    model: ModelFile | str | Path, variables: Sequence[VariableLike]
) -> SidDerivatives:
    """Return the SID of a model and the derivative of each block by design variables.

    Parameters
    ----------
    model : a model, or the path of a model file
    variables : keys of numbers of the model, as "material.youngs_modulus" or
        "geometry.control_points[1][0][1]", parameters, and `ShapeVariable`

    Raises
    ------
    InputError : there is no such number, it changes the structure of the model, or the
        model is discretised by another program.
    """
    content = model if isinstance(model, ModelFile) else read_model(model)
    with locate_errors(content):
        body = DifferentiableBody(content)
        found = [design_variable(content, variable) for variable in variables]
        derivatives = {one.name: body.derivative(one) for one in found}
        values = {one.name: one.value for one in found}
        markers = {name: str(m.node) for name, m in content.markers.items()}
        return SidDerivatives(body.sid, values, derivatives, markers)


class DifferentiableBody:
    """A model, discretised and reduced once for the derivatives by all variables."""

    def __init__(self, model: ModelFile) -> None:
        if model.comes_as_matrices:
            raise InputError("has no derivatives", place="geometry", expected=_NOT_OWN)
        self.model = model
        body = finite_element_model(model)
        frame = FRAMES[model.frame.type](body, model.frame)
        self._spaces = NominalSpaces(body, frame)
        self._fixed = getattr(model.reduction, "fixed_names", ())
        space, loaded = self._reduced_spaces(body, frame)
        places: list[tuple[int, int]] = []

        def choose(*arguments: Any) -> list[StressPoint]:
            points = peak_points(*arguments)
            places.extend(point.place for point in points)
            return points

        converted = _converted(model, body, frame, space, loaded, choose)
        self.sid, self.basis = converted
        self._points = points_at(places)

    def derivative(self, variable: DesignVariable) -> SID:
        """Return the derivative of every block by a variable, in the form of a SID."""
        model = variable.with_imaginary_step(self.model)
        # Sections have no derivatives, and their displacements by jumps are real.
        body = replace(finite_element_model(model), cuts=())
        frame = FRAMES[model.frame.type](body, model.frame)
        space, loaded = self._reduced_spaces(body, frame)
        sid, basis = _converted(model, body, frame, space, loaded, self._points)
        self._check_shapes(basis)
        return _mapped(sid, lambda values: np.imag(values) / variable.step)

    def _reduced_spaces(
        self, body: FiniteElementModel, frame: Frame
    ) -> tuple[AdmissibleSpace, AdmissibleSpace | None]:
        """Return the spaces of the reduction and of loads on the body."""
        space = complex_step_space(body, frame, self._fixed, self._spaces)
        if not self.model.stiffening:
            return space, None
        return space, complex_step_space(body, frame, (), self._spaces)

    def _check_shapes(self, basis: ReducedBasis) -> None:
        """Check that shape functions with a step are those of the SID."""
        own, found = self.basis.shapes, basis.shapes.real
        size = np.abs(own).max(initial=0.0)
        if own.shape != found.shape or np.abs(own - found).max() > _SAME * size:
            raise InputError(
                "has shape functions that rounding decides about",
                place="reduction",
                expected="fewer modes, or interfaces whose loads differ more",
            )


def _converted(
    model: ModelFile,
    body: FiniteElementModel,
    frame: Frame,
    space: AdmissibleSpace,
    loaded: AdmissibleSpace | None,
    choose: PointChoice,
) -> tuple[SID, ReducedBasis]:
    """Return the SID of a discretised body, and its shape functions."""
    reduce, settings = REDUCTIONS[model.reduction.method], model.reduction
    if settings.method == "user":
        basis = reduce(body, frame, settings)
    else:
        basis = reduce(body, frame, settings, space)
    held = frame.held
    if frame.rows is None:
        fixed = getattr(settings, "fixed_names", ())
        held = clamped_dofs(body, frame, fixed)
    basis = replace(basis, space=None)
    parts = (model, body, frame, basis, held)
    sid, basis, _ = sid_of_basis(*parts, loaded=loaded, choose=choose)
    return sid, basis


def _mapped(sid: SID, change: Callable[[Any], Any]) -> SID:
    """Return a SID with a function applied to mass, all blocks and all nodes."""

    def block(value: Taylor | None) -> Any:
        if value is None:
            return None
        m1 = None if value.m1 is None else change(value.m1)
        return Taylor(change(value.m0), m1, order=value.order)

    nodes = [
        replace(node, **{name: block(getattr(node, name)) for name in NODE_SHAPES})
        for node in sid.nodes
    ]
    blocks = {name: block(value) for name, value in sid.blocks.items()}
    mass = float(change(sid.mass))
    return replace(sid, mass=mass, nodes=tuple(nodes), sections=(), **blocks)
