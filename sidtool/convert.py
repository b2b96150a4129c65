"""From a model file to a SID."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.carried import Carried
from sidtool.formats.errors import warn_caller
from sidtool.formats.field import Field
from sidtool.formats.model import ModelFile, RayleighDamping, read_model
from sidtool.formats.plausible import body_questions, material_questions
from sidtool.formats.progress import Course, along, reached
from sidtool.formats.sid import SID, Node, Taylor
from sidtool.formats.sid_mass import skew
from sidtool.formats.toml.files import located

from .conversion.element_cost import element_notes
from .conversion.gram import body_inertia
from .conversion.prestress import check_prestress, prestressed
from .conversion.stiffening import stiffened
from .conversion.stress import check_stress, with_stress
from .field.body_field import body_field
from .frontends.finite_element_model import FiniteElementModel, MarkerRows
from .frontends.geometry_mass import compared_with_geometry
from .frontends.registry import finite_element_model
from .reduction.fidelity import held_sentence, judged
from .reduction.frames import FRAMES, Frame, clamped_dofs
from .reduction.memory import expected_gigabytes
from .reduction.methods import REDUCTIONS, ReducedBasis
from .reduction.point_loads import point_marker_note
from .reduction.running import running

__all__ = ["finite_element_model", "sid_from_model"]

Array = NDArray[np.float64]

#: What sentences for the user begin with, beside the names of stages.
NOTE = "note: "
#: What the sentence on the errors of the shape functions begins with.
BASIS = "basis: "

#: Parts of a conversion, and about how long they take beside each other.
_LENGTHS = {
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
    """Discretise, reduce and write down one body.

    Parameters
    ----------
    model : a model file, read already or by its path
    progress : called with the name of every stage as it begins, with counts from inside
        the longest of them, with a sentence that begins with `BASIS`, and with
        sentences that begin with `NOTE`; without it these are warnings
    engine : what solves the equations, one of `reduction.factors.ENGINES`; the fastest
        that is installed by default

    Raises
    ------
    InputError : names the file (if given by its path) and the key that is wrong.
    """
    return _made(model, progress, engine, with_field=False)[0]


def field_from_model(
    model: ModelFile | str | Path,
    progress: Callable[[str], None] | None = None,
    engine: str | None = None,
) -> tuple[SID, Field]:
    """As `sid_from_model`, with the full field of the body."""
    sid, field = _made(model, progress, engine, with_field=True)
    assert field is not None
    return sid, field


def _made(
    model: ModelFile | str | Path,
    progress: Callable[[str], None] | None,
    engine: str | None,
    with_field: bool,
) -> tuple[SID, Field | None]:
    tell = progress or _notes_only
    with running(engine, progress):
        content = model if isinstance(model, ModelFile) else read_model(model)
        lengths = _lengths(content, with_field)
        with located(content), along(Course(lengths)) as parts:
            return _convert(content, tell, with_field, parts)


def _lengths(model: ModelFile, with_field: bool) -> dict[str, float]:
    """About how much of the time each part of a conversion takes, of those it has."""
    stiffening = model.stiffening
    left_out = {
        "prestress": not (stiffening and stiffening.prestress),
        "geometric stiffening": not stiffening,
        "stress": not model.stress,
        "evaluating the full field": not with_field,
    }
    return {name: x for name, x in _LENGTHS.items() if not left_out.get(name)}


def _convert(
    model: ModelFile, progress: Callable[[str], None], with_field: bool, parts: Course
) -> tuple[SID, Field | None]:
    def begin(part: str, text: str = "") -> None:
        parts.enter(part)
        reached(text or part)
        progress(text or part)

    if model.material is not None:
        material = model.material
        for text in material_questions(material.youngs_modulus, material.density):
            progress(NOTE + text)
    begin("discretising")
    body = finite_element_model(model)
    for sentence in (*body.notes, *compared_with_geometry(body)):
        progress(NOTE + sentence)
    frame = FRAMES[model.frame.type](body, model.frame)
    for sentence in _check_wanted(body, model):
        progress(NOTE + sentence)
    gigabytes = expected_gigabytes(body.positions, body.ndof)
    size = f"{body.ndof} degrees of freedom, which may take {gigabytes:.1f} GB"
    begin("reducing", f"reducing {size}")
    for sentence in element_notes(body):
        progress(NOTE + sentence)
    basis = REDUCTIONS[model.reduction.method](body, frame, model.reduction)
    for sentence in basis.report:
        progress(sentence)
    begin("measuring the shape functions")
    carried = _told_fidelity(body, frame, basis, model, progress)
    if told := held_sentence(body, frame, basis, model):
        progress(NOTE + told)
    held = frame.held
    if frame.rows is None:
        held = clamped_dofs(body, frame, model.reduction.fixed_names)
    for sentence in point_marker_note(body, held):
        progress(NOTE + sentence)
    basis = replace(basis, space=None)
    stiffening, initial = model.stiffening, None
    if stiffening and stiffening.prestress:
        begin("prestress")
        initial = prestressed(
            body, frame, basis, stiffening.prestress, stiffening, model.frame
        )
        basis = initial.basis
    begin("integrating the inertia")
    sid = assembled_sid(body, frame, basis, model.damping, title=model.title, held=held)
    sid = replace(sid, carried=carried, from_matrices=model.comes_as_matrices)
    if initial is not None:
        sid = replace(sid, ksigma=Taylor(initial.force[:, None]))
    if stiffening:
        begin("geometric stiffening")
        sid = stiffened(sid, body, frame, basis, stiffening)
    if model.stress:
        begin("stress")
        sid = with_stress(sid, body, frame, basis, model.stress, initial)
    for text in body_questions(sid):
        progress(NOTE + text)
    if not with_field:
        return sid, None
    begin("evaluating the full field")
    return sid, body_field(sid, body, frame, basis, initial)


def _check_wanted(body: FiniteElementModel, model: ModelFile) -> list[str]:
    """Raises stress and stiffening that cannot be had before they cost time; sentences
    on what of them is not told."""
    if model.stiffening:
        check_prestress(body, model.stiffening, model.frame)
    return check_stress(body, model.stress) if model.stress else []


def _told_fidelity(
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    model: ModelFile,
    progress: Callable[[str], None],
) -> Carried | None:
    """How good the basis is; a note where it is poor."""
    told = judged(body, frame, basis, model)
    if told is None:
        return None
    progress(f"{NOTE if told.poor else ''}{BASIS}{told.text}")
    return told.carried


def assembled_sid(
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    damping: RayleighDamping | None = None,
    *,
    title: str = "",
    held: NDArray[np.bool_] | None = None,
) -> SID:
    """The SID of a discretised body with given frame and shape functions.

    Parameters
    ----------
    held : (ndof,) the degrees of freedom that are clamped in the frame; by default
        those that define it
    """
    nq = len(basis.labels)
    held = frame.held if held is None else held
    mass, inertia = body_inertia(body, frame.origin, basis.shapes)
    blocks: dict[str, Any] = dict(inertia)
    blocks["ksigma"] = Taylor(np.zeros((nq, 1)))
    blocks["Ke"] = Taylor(basis.stiffness)
    blocks["De"] = Taylor(_damping(blocks["Me"].m0, basis.stiffness, damping))
    return SID(
        mass=mass,
        labels=basis.labels,
        nodes=tuple(_node(body, m, frame, basis, held) for m in body.markers),
        title=title,
        **blocks,
    )


def _damping(me: Array, ke: Array, damping: RayleighDamping | None) -> Array:
    if damping is None:
        return np.zeros_like(ke)
    return damping.alpha * me + damping.beta * ke


def _node(
    body: FiniteElementModel,
    marker: MarkerRows,
    frame: Frame,
    basis: ReducedBasis,
    held: NDArray[np.bool_],
) -> Node:
    phi = marker.displacement @ basis.shapes
    psi = _free_turns(body, marker, held) @ (marker.rotation @ basis.shapes)
    return Node(
        id=str(marker.node),
        origin=Taylor((marker.position - frame.origin)[:, None], phi.T[:, :, None]),
        phi=Taylor(phi),
        psi=Taylor(psi),
        AP=Taylor(np.eye(3), skew(psi.T)),
    )


def _free_turns(
    body: FiniteElementModel, marker: MarkerRows, held: NDArray[np.bool_]
) -> Array:
    """(3, 3) projection on the rotations that clamped nodes around a marker leave.

    The displacement gradient beside a clamped edge turns a point on it, which the edge
    does not. Markers with a rotation of their own (beams, ties) lose nothing.
    """
    if marker.gradient is None or not held[marker.displacement.indices].all():
        return np.eye(3)
    dofs = np.union1d(marker.displacement.indices, marker.gradient.indices)
    around = np.isin(body.table, dofs).any(axis=1)
    still = (held[body.table] | (body.table < 0)).all(axis=1)
    arms = np.zeros(((around & still).sum(), 3))
    arms[:, : body.dimension] = body.positions[around & still]
    crossed = skew(arms - marker.position).reshape(-1, 3)
    sizes, turns = np.linalg.eigh(crossed.T @ crossed)
    free = turns[:, sizes <= _ON_A_LINE * sizes[-1]]
    return free @ free.T


def _notes_only(text: str) -> None:
    """Nobody listens to the stages, but notes are told."""
    if text.startswith(NOTE):
        warn_caller(text.removeprefix(NOTE))
