"""Bodies with their shape functions, meshes with their markers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.field import Field, mismatch
from sidtool.formats.model import ModelFile
from sidtool.formats.sid import SID

from ..field.body_field import sample_body
from ..frontends.registry import finite_element_model
from ..view.drawn_bodies import Drawn, of_field, of_sid
from ..view.surface import thinned
from .figure import saved, styled
from .pictures import Picture, drawn

Array = NDArray[np.float64]

#: Largest displacement in a picture, as a share of the body's length.
_EXAGGERATION = 0.09
#: Shape functions and triangles that are drawn at most.
_MOST, _TRIANGLES = 17, 20_000
#: Nodes of a SID that are marked at most.
_NODES = 40


def plot_sid(path: Path, sid: SID, content: Field | None = None) -> list[str]:
    """Draw a body and its shape functions, exaggerated to the same size.

    content : its full field; without it the hull of the nodes, or bars between them,
        is drawn, and the picture says so

    Returns
    -------
    sentences on what was left out

    Raises
    ------
    InputError : the field is not that of the SID, or the SID has no nodes.
    """
    if content is not None and (wrong := mismatch(content, sid)):
        raise InputError(
            f"the field {wrong}",
            place="--field",
            expected="the field that was written with this SID",
        )
    if content is None and not sid.nodes:
        raise InputError(
            "has no nodes to draw", expected="a SID with nodes, or a field"
        )
    body = _drawn(sid, content)
    title = f"{_clean(sid.title) or 'body'}: {sid.mass:.4g} kg"
    names = [_name(sid, k) for k in range(sid.nq)]
    return _plot_shapes(path, body, title, _node_marks(sid), names)


def _plot_shapes(
    path: Path, body: Drawn, title: str, marks: dict[str, Array], names: list[str]
) -> list[str]:
    """A body at rest, and every shape function with its name."""
    length = float(np.ptp(body.positions, axis=0).max()) or 1.0
    faces = thinned(body.positions, body.triangles, _TRIANGLES)
    pictures = [Picture(title, body.positions, faces, marks=marks)]
    for name, shape in zip(names[:_MOST], np.moveaxis(body.shapes, 2, 0), strict=False):
        moved = np.linalg.norm(shape, axis=1)
        size = float(moved.max(initial=0.0)) or 1.0
        place = body.positions + shape * (_EXAGGERATION * length / size)
        pictures.append(Picture(name, place, faces, moved / size, rest=body.positions))
    heading = f"drawn from {body.source}" if body.sketched else ""
    told = ([heading] if heading else []) + _plot(path, pictures, heading)
    if len(names) > _MOST:
        told.append(f"the first {_MOST} of {len(names)} shape functions are drawn")
    return told


def plot_field(path: Path, content: Field) -> list[str]:
    """Draw a body and its shape functions from its full field alone."""
    body = of_field("body", content)
    names = [f"q{k + 1}" for k in range(content.nq)]
    title = _clean(content.title) or "body"
    marks = {str(i): place for i, place in enumerate(content.places[:_NODES], 1)}
    return _plot_shapes(path, body, title, marks, names)


def plot_model(path: Path, model: ModelFile) -> list[str]:
    """Draw the mesh of a model with its markers, what they are tied to, and the
    control net of NURBS.

    Raises
    ------
    InputError : the body cannot be made.
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
    faces = thinned(sampled.positions, sampled.triangles, _TRIANGLES)
    d = body.dimension
    nets = [
        np.pad(line, ((0, 0), (0, 3 - d)))
        for patch, _ in body.patches
        for line in _net(patch.control_points)
    ]
    if not len(faces):
        groups["nodes"] = sampled.positions
    elif body.outlines:
        groups["nodes"] = np.pad(body.positions, ((0, 0), (0, 3 - body.dimension)))
    picture = Picture(
        f"{_clean(model.title) or 'model'}: {body.ndof} degrees of freedom",
        sampled.positions,
        faces,
        marks={marker.name: marker.position for marker in body.markers},
        groups=groups,
        lines=tuple(nets),
        meshed=not body.outlines,  # pieces of beams are no elements
    )
    told = _plot(path, [picture])
    if nets:
        told.append("grey lines: the control net")
    if len(faces) < len(sampled.triangles):
        told.append(f"thinned to {len(faces)} of {len(sampled.triangles)} triangles")
    return told


def _net(control: Array) -> list[Array]:
    """Lines along all directions of a grid of control points."""
    found: list[Array] = []
    for axis in range(control.ndim - 1):
        rows = np.moveaxis(control, axis, -2)
        found += list(rows.reshape(-1, *rows.shape[-2:]))
    return found


def _drawn(sid: SID, content: Field | None) -> Drawn:
    if content is not None:
        return of_field("body", content)
    places = np.array([node.position for node in sid.nodes])
    return of_sid("body", sid, 0.02 * (float(np.ptp(places, axis=0).max()) or 1.0))


def _node_marks(sid: SID) -> dict[str, Array]:
    return {node.id: node.position for node in sid.nodes[:_NODES]}


def _name(sid: SID, k: int) -> str:
    """Number, frequency of this coordinate alone, and label of a shape function."""
    with np.errstate(all="ignore"):
        square = sid.Ke.m0[k, k] / sid.Me.m0[k, k]
        hertz = np.sqrt(square) / (2 * np.pi)
    label = _clean(sid.labels[k])
    told = f", {hertz:.4g} Hz" if np.isfinite(hertz) else ""
    return f"q{k + 1}{told}" + (f" ({label})" if label and "Hz" not in label else "")


def _clean(text: str) -> str:
    return " ".join(text.split())


def _plot(path: Path, pictures: Sequence[Picture], heading: str = "") -> list[str]:
    """Writes pictures; a sentence on names for which there was no room."""
    with styled():
        page, unnamed = drawn(pictures, heading)
        saved(page, path)
    if not unnamed:
        return []
    marks = sum(len(picture.marks) for picture in pictures)
    return [f"{len(unnamed)} of {marks} names of markers have no room in the picture"]
