"""Reduction methods by the `reduction.method` of a model file.

A reductor takes a body, its frame and the settings, and reduces the body to a
`ReducedBasis`, whose `reconstruct` goes back to the displacement of the whole body. The
space of the body as frame and `fix` hold it may be given, with its factors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.model.reduction import (
    AttachmentReduction,
    CraigBamptonReduction,
    HertingReduction,
    KrylovReduction,
    ModalReduction,
)

from ..frontends.finite_element_model import FiniteElementModel
from .basis import Family, ReducedBasis, finished, hertz, oriented
from .frames import Frame, motion_names, motion_rows
from .krylov import krylov_vectors
from .space import Space, admissible
from .user import user_shapes

__all__ = ["COMPARED", "REDUCTIONS", "ReducedBasis", "modal_truncation", "oriented"]

Array = NDArray[np.float64]

#: Frequencies of the full mesh by which a basis is judged after the reduction.
COMPARED = 10
#: Loads that move a body by less than this part of the largest motion act on supports.
HELD = 1e-12


def modal_truncation(
    model: FiniteElementModel,
    frame: Frame,
    settings: ModalReduction,
    space: Space | None = None,
) -> ReducedBasis:
    """The lowest elastic modes of the body as it is held, or free; mass-normalised.

    See `oriented` for their signs.

    Raises
    ------
    InputError : the model has fewer degrees of freedom than modes are asked for.
    """
    space = space or admissible(model, frame, settings.fixed_names)
    values, shapes = space.modes(settings.modes)
    if frame.rows is not None:
        normal = Family("normal", shapes)
        return replace(finished(model, frame, [normal], "Eigen Mode"), space=space)
    return ReducedBasis(
        shapes=oriented(shapes, model),
        stiffness=np.diag(values),
        labels=tuple(
            f"Eigen Mode{i:5d} :{f:13.3f} Hz" for i, f in enumerate(hertz(values), 1)
        ),
        shares={"normal": np.ones(len(values))},
        space=space,
    )


def craig_bampton(
    model: FiniteElementModel,
    frame: Frame,
    settings: CraigBamptonReduction,
    space: Space | None = None,
) -> ReducedBasis:
    """Constraint modes of the interfaces and modes with fixed interfaces.

    Source: R. Craig, M. Bampton, "Coupling of substructures for dynamic analyses",
    AIAA J. 6 (7), 1968.
    """
    outer = space or admissible(model, frame, settings.fixed_names)
    inner, constraint = _constraint_modes(model, outer, settings)
    _, normal = inner.modes(settings.modes)
    families = [Family("fixed-interface mode", normal), constraint]
    return replace(finished(model, frame, families, "Craig-Bampton"), space=outer)


def attachment(
    model: FiniteElementModel,
    frame: Frame,
    settings: AttachmentReduction,
    space: Space | None = None,
) -> ReducedBasis:
    """Normal modes, static answers to unit loads at markers and to its own inertia.

    Source: R. Craig, "Structural Dynamics", Wiley 1981, chapter 19.
    """
    space = space or admissible(model, frame, settings.fixed_names)
    _, normal = space.modes(settings.modes, COMPARED)
    rows, names = _interface_rows(model, settings.interfaces, settings.rotations)
    families = [
        Family("normal mode", normal),
        Family("attachment mode", space.static(rows.T), names),
    ]
    if settings.inertia_relief:
        families.append(_inertia_relief(model, frame, space))
    if settings.centrifugal:
        loads = model.mass @ model.linear_fields(frame.origin)
        families.append(Family("centrifugal mode", space.static(loads)))
    return replace(finished(model, frame, families, "Attachment"), space=space)


def herting(
    model: FiniteElementModel,
    frame: Frame,
    settings: HertingReduction,
    space: Space | None = None,
) -> ReducedBasis:
    """Constraint modes, inertia-relief modes, and modes with free interfaces.

    The normal modes enter relative to the constraint modes, which does not change the
    space.

    Source: D. Herting, "A general purpose, multi-stage, component modal synthesis
    method", Finite Elements in Analysis and Design 1, 1985.
    """
    outer = space or admissible(model, frame, settings.fixed_names)
    inner, constraint = _constraint_modes(model, outer, settings)
    _, normal = outer.modes(settings.modes, COMPARED)
    relief = _inertia_relief(model, frame, inner)
    families = [Family("free-interface mode", normal), constraint, relief]
    return replace(finished(model, frame, families, "Herting"), space=outer)


def krylov(
    model: FiniteElementModel,
    frame: Frame,
    settings: KrylovReduction,
    space: Space | None = None,
) -> ReducedBasis:
    """Rational Krylov vectors that match the transfer functions between markers.

    See `krylov_vectors`. Of a body that its frame accelerates, the answers to uniform
    accelerations are matched as well.
    """
    space = space or admissible(model, frame, settings.fixed_names)
    rows, names = _interface_rows(model, settings.interfaces, settings.rotations)
    loads = [rows.T]
    if not space.rigid.shape[1]:
        loads.append(model.mass @ model.rigid_body_modes(frame.origin))
        names += tuple(f"acceleration {i + 1}" for i in range(loads[1].shape[1]))
    columns = np.hstack(loads)
    moved = np.linalg.norm(space.static(columns), axis=0)
    felt = moved > HELD * moved.max(initial=0.0)
    names = tuple(name for name, there in zip(names, felt, strict=True) if there)
    families = [
        Family(f"at {f:g} Hz", shapes, tuple(f"{n} at {f:g} Hz" for n in names) * m)
        for f, shapes, m in krylov_vectors(space, columns[:, felt], settings)
    ]
    return replace(finished(model, frame, families, "Krylov"), space=space)


def _interface_rows(
    model: FiniteElementModel, interfaces: tuple[str, ...], rotations: bool
) -> tuple[Array, tuple[str, ...]]:
    markers = [model.marker(name) for name in interfaces]
    rows = [motion_rows(model, marker, rotations=rotations) for marker in markers]
    names = [motion_names(model, marker, rotations=rotations) for marker in markers]
    return np.vstack(rows), tuple(name for group in names for name in group)


def _constraint_modes(
    model: FiniteElementModel,
    outer: Space,
    settings: CraigBamptonReduction | HertingReduction,
) -> tuple[Space, Family]:
    """The space with fixed interfaces, and static answers to unit motions of these."""
    rows, _ = _interface_rows(model, settings.interfaces, settings.rotations)
    inner = outer.with_constraints(rows)
    count, before = len(inner.constraints), len(outer.constraints)
    motions = np.eye(count)[:, before:]
    shapes = inner.static(np.zeros((model.ndof, count - before)), motions)
    return inner, Family("constraint mode", shapes)


def _inertia_relief(model: FiniteElementModel, frame: Frame, space: Space) -> Family:
    """Static answers to uniform accelerations; none of a body that is free."""
    shapes = np.zeros((model.ndof, 0))
    if not space.rigid.shape[1]:
        rigid = model.rigid_body_modes(frame.origin)
        shapes = space.static(model.mass @ rigid)
    return Family("inertia-relief mode", shapes)


Reduction = Callable[..., ReducedBasis]

#: One line adds a method.
REDUCTIONS: dict[str, Reduction] = {
    "modal": modal_truncation,
    "craig_bampton": craig_bampton,
    "attachment": attachment,
    "herting": herting,
    "krylov": krylov,
    "user": user_shapes,
}
