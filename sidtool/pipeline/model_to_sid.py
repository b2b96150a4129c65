"""Convert a model file to a SID or a full field."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import null_space_with_step
from sidtool.formats.base.progress import NamedStages, count_within, report_stage
from sidtool.formats.base.sid import SID, Array, Node, Taylor
from sidtool.formats.diagnostics import Diagnostic, diagnose, without
from sidtool.formats.field import Field
from sidtool.formats.model import ModelFile, RayleighDamping, read_model
from sidtool.formats.plausibility import body_warnings, check_body, material_warnings
from sidtool.formats.sid_mass import skew
from sidtool.formats.toml.files import locate_errors

from ..conversion.body_sections import add_sections
from ..conversion.element_accuracy import element_notes
from ..conversion.geometric_stiffness import add_geometric_stiffening
from ..conversion.inertia_integrals import body_inertia
from ..conversion.prestress import InitialStress, add_prestress, check_prestress
from ..conversion.stress_recovery import (
    PointChoice,
    add_stress_recovery,
    check_stress,
)
from ..discretisation.registry import finite_element_model, refuse_extreme_numbers
from ..eigensolvers.factorisation import expected_gigabytes
from ..eigensolvers.slepc import use_engine
from ..elements.finite_element_model import (
    FiniteElementModel,
    MarkerRows,
    moving_dofs,
)
from ..elements.mass_properties import geometry_mass_notes
from ..field.body_field import body_field
from ..reduction.admissible_space import AdmissibleSpace
from ..reduction.basis_error import assess_basis, held_marker_note, spin_stress_note
from ..reduction.body_frames import FRAMES, Frame, clamped_dofs
from ..reduction.methods import REDUCTIONS, ReducedBasis
from ..reduction.reduced_basis import point_marker_note

__all__ = ["finite_element_model", "sid_from_model"]


#: Stages of a conversion and their approximate relative durations.
_STAGE_WEIGHTS = {
    "discretising": 4.0,
    "reducing": 5.0,
    "measuring the shape functions": 1.0,
    "prestress": 1.0,
    "integrating the inertia": 0.5,
    "geometric stiffening": 2.0,
    "stress": 1.0,
    "evaluating the full field": 2.0,
}

#: Clamped nodes lie on a line if their moment of inertia about it is below this share.
_ON_A_LINE = 1e-12


def sid_from_model(
    model: ModelFile | str | Path,
    progress: Callable[[str], None] | None = None,
    engine: str | None = None,
) -> SID:
    """Discretise and reduce one body, and assemble its SID.

    Parameters
    ----------
    model : a model, or the path of a model file
    progress : called with the name of every stage at its start, and with counts inside
        long stages
    engine : solver of the equations, one of `eigensolvers.engine.ENGINES`; default the
        fastest that is installed

    Raises
    ------
    InputError : the model is not valid; the error names the key, and the file if given
        by path.
    """
    return convert_model(model, progress, engine).sid


def field_from_model(
    model: ModelFile | str | Path,
    progress: Callable[[str], None] | None = None,
    engine: str | None = None,
) -> tuple[SID, Field]:
    """Convert a model as `sid_from_model`, and return the full field of the body."""
    found = convert_model(model, progress, engine, with_field=True)
    assert found.field is not None
    return found.sid, found.field


@dataclass(frozen=True, eq=False)
class ConvertedModel:
    """A converted model.

    Attributes
    ----------
    field : full field of the body, on request
    degrees_of_freedom : of the mesh
    """

    sid: SID
    field: Field | None
    degrees_of_freedom: int


def convert_model(
    model: ModelFile | str | Path,
    progress: Callable[[str], None] | None = None,
    engine: str | None = None,
    with_field: bool = False,
) -> ConvertedModel:
    """Convert a model as `sid_from_model`, with its field on request."""
    report = progress or (lambda _: None)
    with use_engine(engine, progress):
        content = model if isinstance(model, ModelFile) else read_model(model)
        lengths = _stage_durations(content, with_field)
        with (
            locate_errors(content),
            refuse_extreme_numbers(),
            count_within(NamedStages(lengths)) as parts,
        ):
            return _convert(content, report, with_field, parts)


def _stage_durations(model: ModelFile, with_field: bool) -> dict[str, float]:
    """Return the approximate share of time of each stage of this conversion."""
    stiffening = model.stiffening
    left_out = {
        "prestress": not (stiffening and stiffening.prestress),
        "geometric stiffening": not stiffening,
        "stress": not model.stress,
        "evaluating the full field": not with_field,
    }
    return {name: x for name, x in _STAGE_WEIGHTS.items() if not left_out.get(name)}


def _convert(
    model: ModelFile,
    progress: Callable[[str], None],
    with_field: bool,
    parts: NamedStages,
) -> ConvertedModel:
    def begin(part: str, text: str = "") -> None:
        parts.enter(part)
        report_stage(text or part)
        progress(text or part)

    found: list[Diagnostic] = []
    if model.material is not None:
        material = model.material
        found += material_warnings(material.youngs_modulus, material.density)
    for name in model.unread_names(model.parameters):
        reason = "no formula reads it"
        found.append(diagnose("N145", f"parameters.{name}", reason=reason))
    begin("discretising")
    body = finite_element_model(model)
    found += [*body.diagnostics, *geometry_mass_notes(body)]
    frame = FRAMES[model.frame.type](body, model.frame)
    found += _check_requested_outputs(body, model)
    gigabytes = expected_gigabytes(body.positions, body.ndof)
    size = f"{body.ndof} degrees of freedom, which may take {gigabytes:.1f} GB"
    begin("reducing", f"reducing {size}")
    found += element_notes(body)
    basis = REDUCTIONS[model.reduction.method](body, frame, model.reduction)
    found += basis.diagnostics
    begin("measuring the shape functions")
    quality = assess_basis(body, frame, basis, model)
    if quality is not None:
        found.append(quality.diagnostic)
    if held_marker := held_marker_note(body, frame, basis, model):
        found.append(held_marker)
    if spin := spin_stress_note(body, basis, frame, model):
        found.append(spin)
    held = frame.held
    if frame.rows is None:
        held = clamped_dofs(body, frame, model.reduction.fixed_names)
    found += point_marker_note(body, held)
    basis = replace(basis, space=None)
    sid, basis, initial = sid_of_basis(model, body, frame, basis, held, begin=begin)
    compliance_shares = None if quality is None else quality.carried
    sid = replace(sid, carried=compliance_shares)
    check_body(sid)
    found += body_warnings(sid)
    kept = without(found, model.diagnostics.ignore)
    sid = replace(sid, diagnostics=kept)
    field = None
    if with_field:
        begin("evaluating the full field")
        field = body_field(sid, body, frame, basis, initial)
    return ConvertedModel(sid, field, body.ndof)


def sid_of_basis(
    model: ModelFile,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    held: NDArray[np.bool_],
    *,
    begin: Callable[[str], None] = lambda _: None,
    loaded: AdmissibleSpace | None = None,
    choose: PointChoice | None = None,
) -> tuple[SID, ReducedBasis, InitialStress | None]:
    """Assemble the SID of a reduced body with prestress, stiffening and stress.

    Parameters
    ----------
    held : (ndof,) mask of the degrees of freedom that are clamped in the frame
    begin : called with the name of every stage at its start
    loaded : space in which loads deform the body, by default that of its frame
    choose : function that returns the points of peak stress, see `add_stress_recovery`

    Returns
    -------
    the SID, the shape functions of the prestressed body, and its initial stress
    """
    stiffening, initial = model.stiffening, None
    if stiffening and stiffening.prestress:
        begin("prestress")
        initial = add_prestress(
            body, frame, basis, stiffening.prestress, stiffening, model.frame, loaded
        )
        basis = initial.basis
    begin("integrating the inertia")
    sid = assembled_sid(body, frame, basis, model.damping, title=model.title, held=held)
    sid = replace(sid, from_matrices=model.comes_as_matrices)
    if initial is not None:
        sid = replace(sid, ksigma=Taylor(initial.force[:, None]))
    sid = add_sections(sid, body, frame, basis)
    if stiffening:
        begin("geometric stiffening")
        sid = add_geometric_stiffening(sid, body, frame, basis, stiffening, loaded)
    if model.stress:
        begin("stress")
        settings = model.stress
        sid = add_stress_recovery(sid, body, frame, basis, settings, initial, choose)
    return sid, basis, initial


def _check_requested_outputs(
    body: FiniteElementModel, model: ModelFile
) -> list[Diagnostic]:
    """Refuse stress and stiffening that the body cannot have, before expensive steps.

    Returns
    -------
    diagnostics of outputs that are incomplete
    """
    if model.stiffening:
        check_prestress(body, model.stiffening, model.frame)
    return check_stress(body, model.stress) if model.stress else []


def assembled_sid(
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    damping: RayleighDamping | None = None,
    *,
    title: str = "",
    held: NDArray[np.bool_] | None = None,
) -> SID:
    """Assemble the SID of a discretised body with given frame and shape functions.

    Parameters
    ----------
    held : (ndof,) mask of the degrees of freedom that are clamped in the frame; by
        default those that define it
    """
    nq = len(basis.labels)
    held = frame.held if held is None else held
    mass, inertia = body_inertia(body, frame.origin, basis.shapes)
    blocks: dict[str, Any] = dict(inertia)
    blocks["ksigma"] = Taylor(np.zeros((nq, 1)))
    blocks["Ke"] = Taylor(basis.stiffness)
    blocks["De"] = Taylor(_damping_matrix(blocks["Me"].m0, basis.stiffness, damping))
    return SID(
        mass=mass,
        labels=basis.labels,
        nodes=tuple(_sid_node(body, m, frame, basis, held) for m in body.markers),
        title=title,
        **blocks,
    )


def _damping_matrix(me: Array, ke: Array, damping: RayleighDamping | None) -> Array:
    if damping is None:
        return np.zeros_like(ke)
    return damping.alpha * me + damping.beta * ke


def _sid_node(
    body: FiniteElementModel,
    marker: MarkerRows,
    frame: Frame,
    basis: ReducedBasis,
    held: NDArray[np.bool_],
) -> Node:
    phi = marker.displacement @ basis.shapes
    psi = _free_rotations(body, marker, held) @ (marker.rotation @ basis.shapes)
    return Node(
        id=str(marker.node),
        origin=Taylor((marker.position - frame.origin)[:, None], phi.T[:, :, None]),
        phi=Taylor(phi),
        psi=Taylor(psi),
        AP=Taylor(np.eye(3), skew(psi.T)),
    )


def _free_rotations(
    body: FiniteElementModel, marker: MarkerRows, held: NDArray[np.bool_]
) -> Array:
    """Return the projection (3, 3) on the rotations that clamped nodes near a marker
    allow.

    The displacement gradient next to a clamped edge would rotate a point of the edge,
    although the edge itself cannot rotate. Markers with rotational degrees of freedom
    (beams, ties) keep all rotations.
    """
    moving = moving_dofs(marker.displacement)
    if marker.gradient is None or not held[moving].all():
        return np.eye(3)
    dofs = np.union1d(moving, moving_dofs(marker.gradient))
    around = np.isin(body.table, dofs).any(axis=1)
    clamped = (held[body.table] | (body.table < 0)).all(axis=1)
    arms = np.zeros(((around & clamped).sum(), 3), body.positions.dtype)
    arms[:, : body.dimension] = body.positions[around & clamped]
    crossed = skew(arms - marker.position).reshape(-1, 3)
    sizes, turns = np.linalg.eigh(crossed.real.T @ crossed.real)
    free = turns[:, sizes <= _ON_A_LINE * sizes[-1]]
    free = null_space_with_step(crossed, free)
    return np.asarray(free @ np.linalg.solve(free.T @ free, free.T))
