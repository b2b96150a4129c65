"""Figures of bodies with their shape functions, and of meshes with their markers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.field import Field, mismatch_text
from sidtool.formats.model import ModelFile

from ..discretisation.registry import finite_element_model
from ..field.body_field import sample_body
from ..field.body_surfaces import BodySurface, surface_of_field, surface_of_sid
from ..field.surface import decimate
from .body_pictures import BodyPicture, draw_bodies
from .figure import figure_style, save_figure

#: Largest displacement in a picture, as a share of the body's length.
_EXAGGERATION = 0.09
#: Largest numbers of drawn shape functions and triangles.
_MAX_SHAPES, _MAX_TRIANGLES = 17, 20_000
#: Largest number of marked nodes of a SID.
_MAX_MARKED_NODES = 40


def plot_sid(path: Path, sid: SID, content: Field | None = None) -> list[str]:
    """Draw a body and its shape functions, exaggerated to the same size.

    Parameters
    ----------
    content : its full field; without it the hull of the nodes, or bars between them,
        is drawn, with a note in the picture

    Returns
    -------
    notes on what was omitted

    Raises
    ------
    InputError : the field is not that of the SID, or the SID has no nodes.
    """
    if content is not None and (wrong := mismatch_text(content, sid)):
        raise InputError(
            f"the field {wrong}",
            place="--field",
            expected="the field that was written with this SID",
        )
    if content is None and not sid.nodes:
        raise InputError(
            "has no nodes to draw", expected="a SID with nodes, or a field"
        )
    body = _body_surface(sid, content)
    title = f"{_without_control_characters(sid.title) or 'body'}: {sid.mass:.4g} kg"
    names = [_shape_title(sid, k) for k in range(sid.nq)]
    return _plot_shapes(path, body, title, _node_marks(sid), names)


def _plot_shapes(
    path: Path, body: BodySurface, title: str, marks: dict[str, Array], names: list[str]
) -> list[str]:
    """Draw the undeformed body, and every shape function with its name."""
    length = float(np.ptp(body.positions, axis=0).max()) or 1.0
    faces = decimate(body.positions, body.triangles, _MAX_TRIANGLES)
    pictures = [BodyPicture(title, body.positions, faces, marks=marks)]
    for name, shape in zip(
        names[:_MAX_SHAPES], np.moveaxis(body.shapes, 2, 0), strict=False
    ):
        moved = np.linalg.norm(shape, axis=1)
        size = float(moved.max(initial=0.0)) or 1.0
        place = body.positions + shape * (_EXAGGERATION * length / size)
        pictures.append(
            BodyPicture(name, place, faces, moved / size, rest=body.positions)
        )
    heading = f"drawn from {body.source}" if body.is_sketched else ""
    notes = ([heading] if heading else []) + _write_pictures(path, pictures, heading)
    if len(names) > _MAX_SHAPES:
        notes.append(
            f"the first {_MAX_SHAPES} of {len(names)} shape functions are drawn"
        )
    return notes


def plot_field(path: Path, content: Field) -> list[str]:
    """Draw a body and its shape functions from its full field alone."""
    body = surface_of_field("body", content)
    names = [f"q{k + 1}" for k in range(content.nq)]
    title = _without_control_characters(content.title) or "body"
    marks = {
        str(i): place for i, place in enumerate(content.places[:_MAX_MARKED_NODES], 1)
    }
    return _plot_shapes(path, body, title, marks, names)


def plot_model(path: Path, model: ModelFile) -> list[str]:
    """Draw the mesh of a model with its markers, their ties, and the control net of
    NURBS.

    Raises
    ------
    InputError : the body cannot be discretised.
    """
    body = finite_element_model(model)
    sampled = sample_body(body)
    groups = {}
    for name, marker in model.markers.items():
        if marker.tie is not None:
            nodes = np.unique(
                np.concatenate([body.node_sets[n] for n in marker.tie.names])
            )
            places = np.pad(body.positions[nodes], ((0, 0), (0, 3 - body.dimension)))
            groups[f"{name}: {marker.tie.type} tie"] = places
    faces = decimate(sampled.positions, sampled.triangles, _MAX_TRIANGLES)
    d = body.dimension
    nets = [
        np.pad(line, ((0, 0), (0, 3 - d)))
        for patch, _ in body.patches
        for line in _control_net(patch.control_points)
    ]
    if not len(faces):
        groups["nodes"] = sampled.positions
    elif body.outlines:
        groups["nodes"] = np.pad(body.positions, ((0, 0), (0, 3 - body.dimension)))
    picture = BodyPicture(
        f"{_without_control_characters(model.title) or 'model'}: {body.ndof} degrees "
        "of freedom",
        sampled.positions,
        faces,
        marks={marker.name: marker.position for marker in body.markers},
        groups=groups,
        lines=tuple(nets),
        meshed=not body.outlines,  # segments of beams are no elements
    )
    notes = _write_pictures(path, [picture])
    if nets:
        notes.append("grey lines: the control net")
    if len(faces) < len(sampled.triangles):
        notes.append(f"thinned to {len(faces)} of {len(sampled.triangles)} triangles")
    return notes


def _control_net(control: Array) -> list[Array]:
    """Return lines along all directions of a grid of control points."""
    lines: list[Array] = []
    for axis in range(control.ndim - 1):
        rows = np.moveaxis(control, axis, -2)
        lines += list(rows.reshape(-1, *rows.shape[-2:]))
    return lines


def _body_surface(sid: SID, content: Field | None) -> BodySurface:
    if content is not None:
        return surface_of_field("body", content)
    places = np.array([node.position for node in sid.nodes])
    return surface_of_sid(
        "body", sid, 0.02 * (float(np.ptp(places, axis=0).max()) or 1.0)
    )


def _node_marks(sid: SID) -> dict[str, Array]:
    return {node.id: node.position for node in sid.nodes[:_MAX_MARKED_NODES]}


def _shape_title(sid: SID, k: int) -> str:
    """Return number, frequency (of this coordinate alone) and label of a shape
    function.
    """
    with np.errstate(all="ignore"):
        square = sid.Ke.m0[k, k] / sid.Me.m0[k, k]
        hertz = np.sqrt(square) / (2 * np.pi)
    label = _without_control_characters(sid.labels[k])
    frequency_text = f", {hertz:.4g} Hz" if np.isfinite(hertz) else ""
    return f"q{k + 1}{frequency_text}" + (
        f" ({label})" if label and "Hz" not in label else ""
    )


def _without_control_characters(text: str) -> str:
    return " ".join(text.split())


def _write_pictures(
    path: Path, pictures: Sequence[BodyPicture], heading: str = ""
) -> list[str]:
    """Write pictures; return a note on names without room."""
    with figure_style():
        page, unnamed = draw_bodies(pictures, heading)
        save_figure(page, path)
    if not unnamed:
        return []
    marks = sum(len(picture.marks) for picture in pictures)
    return [f"{len(unnamed)} of {marks} names of markers have no room in the picture"]
