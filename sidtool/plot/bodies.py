"""Bodies with their shape functions, meshes with their markers; in the plane or in 3D.

The window of every picture holds all that is drawn in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.field import Field, mismatch
from sidtool.formats.model import ModelFile
from sidtool.formats.sid import SID

from ..field.body_field import sample_body
from ..frontends.registry import finite_element_model
from ..view.drawn_bodies import Drawn, of_field, of_sid
from ..view.surface import border, thinned
from .figure import COLOURS, saved, styled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Largest displacement in a picture, as a share of the body's length.
_EXAGGERATION = 0.09
#: Shape functions and triangles that are drawn at most.
_MOST, _TRIANGLES = 17, 20_000
#: Out of the plane by less than this share of its extent a body is flat.
_FLAT = 1e-6
_NODES = 40
#: Names of marks that are nearer, as a share of the extent, would cover each other.
_APART = 0.12


@dataclass(frozen=True, eq=False)
class Picture:
    """One pair of axes: a surface, coloured by values or plainly, and marks on it."""

    title: str
    positions: Array
    triangles: Indices
    values: Array | None = None
    rest: Array | None = None
    marks: dict[str, Array] = field(default_factory=dict)
    groups: dict[str, Array] = field(default_factory=dict)
    lines: tuple[Array, ...] = ()
    meshed: bool = False


def plot_sid(path: Path, sid: SID, content: Field | None = None) -> list[str]:
    """Draw a body and its shape functions, exaggerated to the same size.

    content : its full field; without it lines between the nodes are drawn

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
    drawn = _drawn(sid, content)
    told = [] if content is not None else ["drawn from the nodes of the SID"]
    title = f"{_clean(sid.title) or 'body'}: {sid.mass:.4g} kg"
    names = [_name(sid, k) for k in range(sid.nq)]
    return told + _plot_shapes(path, drawn, title, _node_marks(sid), names)


def _plot_shapes(
    path: Path, drawn: Drawn, title: str, marks: dict[str, Array], names: list[str]
) -> list[str]:
    """A body at rest, and every shape function with its name."""
    length = float(np.ptp(drawn.positions, axis=0).max()) or 1.0
    faces = thinned(drawn.positions, drawn.triangles, _TRIANGLES)
    pictures = [Picture(title, drawn.positions, faces, marks=marks)]
    for name, shape in zip(
        names[:_MOST], np.moveaxis(drawn.shapes, 2, 0), strict=False
    ):
        moved = np.linalg.norm(shape, axis=1)
        size = float(moved.max(initial=0.0)) or 1.0
        place = drawn.positions + shape * (_EXAGGERATION * length / size)
        pictures.append(Picture(name, place, faces, moved / size, rest=drawn.positions))
    _plot(path, pictures)
    if len(names) > _MOST:
        return [f"the first {_MOST} of {len(names)} shape functions are drawn"]
    return []


def plot_field(path: Path, content: Field) -> list[str]:
    """Draw a body and its shape functions from its full field alone."""
    drawn = of_field("body", content)
    names = [f"q{k + 1}" for k in range(content.nq)]
    title = _clean(content.title) or "body"
    marks = {str(i): place for i, place in enumerate(content.places[:_NODES], 1)}
    return _plot_shapes(path, drawn, title, marks, names)


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
    picture = Picture(
        f"{_clean(model.title) or 'model'}: {body.ndof} degrees of freedom",
        sampled.positions,
        faces,
        marks={marker.name: marker.position for marker in body.markers},
        groups=groups,
        lines=tuple(nets),
        meshed=True,
    )
    _plot(path, [picture])
    told = ["grey lines: the control net"] if nets else []
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


def _plot(path: Path, pictures: Sequence[Picture]) -> None:
    """All pictures in one window each, of the same extent."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    parts = [p.positions for p in pictures]
    parts += [np.reshape(list(p.marks.values()), (-1, 3)) for p in pictures]
    parts += [points for p in pictures for points in (*p.groups.values(), *p.lines)]
    points = np.concatenate(parts)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float((high - low).max()) or 1.0
    flat = bool((high - low)[2] <= _FLAT * extent) or _is_plate(pictures, extent)
    margin = 0.03 * extent
    window = low - margin, high + margin
    columns = 1 if len(pictures) == 1 else 2 if len(pictures) < 7 else 3
    rows = -(-len(pictures) // columns)
    width = (8.0 if columns < 3 else 11.0) / columns
    size = window[1] - window[0]
    height = width * size[1] / size[0] if flat else 0.62 * width
    height = min(max(height, 0.5), 2.0 * width) + 0.55
    with styled():
        page = Figure(
            figsize=(width * columns, height * rows + 0.2), layout="constrained"
        )
        FigureCanvasAgg(page)
        for number, picture in enumerate(pictures, 1):
            kind = {} if flat else {"projection": "3d"}
            axes = cast(Any, page.add_subplot(rows, columns, number, **kind))
            axes.set_title(picture.title, loc="left", fontsize="small")
            (_draw_flat if flat else _draw_solid)(axes, picture, *window)
        saved(page, path)


def _is_plate(pictures: Sequence[Picture], extent: float) -> bool:
    """Plane bodies are drawn from above, whatever their thickness: nothing leaves the
    plane."""
    first = pictures[0].positions
    same = all(
        len(p.positions) == len(first)
        and np.abs(p.positions[:, 2] - first[:, 2]).max(initial=0.0) <= _FLAT * extent
        for p in pictures
    )
    levels = np.unique(np.round(first[:, 2] / extent, 9))
    return same and len(levels) <= 2


def _draw_flat(axes: Any, picture: Picture, low: Array, high: Array) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    faces = picture.positions[picture.triangles][..., :2]
    if picture.rest is not None:
        axes.add_collection(
            LineCollection(
                list(_rim(picture.rest, picture.triangles)), colors="0.6", lw=0.7
            )
        )
    colours = _colours(picture)
    edge = "0.45" if picture.meshed else colours
    axes.add_collection(
        PolyCollection(list(faces), facecolors=colours, edgecolors=edge, linewidths=0.2)
    )
    for line in picture.lines:
        axes.plot(line[:, 0], line[:, 1], color="0.5", lw=0.5, marker=".", ms=1.5)
    _marks(axes, picture, 2)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]")
    axes.set_ylabel("y [m]")
    axes.set_aspect("equal")


def _rim(positions: Array, triangles: Indices) -> Array:
    """Edges of the upper side of a plane body, from above."""
    top = positions[triangles][..., 2].min(axis=1) >= positions[:, 2].max() - 1e-12
    rim = border(triangles[top] if top.any() else triangles)
    return positions[rim][..., :2]


def _draw_solid(axes: Any, picture: Picture, low: Array, high: Array) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = picture.positions[picture.triangles]
    axes.add_collection3d(
        Poly3DCollection(
            faces,
            facecolors=_shaded(faces, _colours(picture)),
            edgecolors="0.35" if picture.meshed else "none",
            linewidths=0.15,
        )
    )
    for line in picture.lines:
        axes.plot(*line.T, color="0.5", lw=0.5, marker=".", ms=1.5)
    _marks(axes, picture, 3)
    size = high - low
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(size, 0.02 * size.max()), zoom=0.8)
    for axis, share in zip("xyz", size / size.max(), strict=True):
        getattr(axes, f"set_{axis}label")(f"{axis} [m]", fontsize="x-small", labelpad=7)
        axes.locator_params(axis=axis, nbins=1 + round(2 * min(3 * share, 1)))
    axes.tick_params(labelsize="x-small")
    axes.set_proj_type("ortho")


def _colours(picture: Picture) -> Array:
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    if picture.values is None:
        plain = 0.45 + 0.55 * np.array(to_rgb(COLOURS[0]))
        return np.tile(plain, (max(len(picture.triangles), 1), 1))
    shares = picture.values[picture.triangles].mean(axis=1)
    return np.asarray(colormaps["viridis"](shares)[:, :3])


def _shaded(faces: Array, colours: Array) -> Array:
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    light = np.array([0.3, -0.6, 0.74])
    sizes = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    bright = np.abs(normals @ light) / sizes
    return np.asarray(colours[: len(faces)] * (0.6 + 0.4 * bright)[:, None])


def _marks(axes: Any, picture: Picture, d: int) -> None:
    for number, (name, points) in enumerate(picture.groups.items(), 1):
        axes.plot(*points.T[:d], ".", ms=2.5, color=COLOURS[number % 7], label=name)
    if picture.groups:
        axes.legend(fontsize="x-small", loc="upper right")
    for point in picture.marks.values():
        axes.plot(*point[:d, None], "o", ms=3.5, color=COLOURS[1], zorder=5)
    for name, point in named(picture):
        axes.text(*point[:d], f" {name}", fontsize="x-small", zorder=6)


def named(picture: Picture) -> list[tuple[str, Array]]:
    """Marks whose names are drawn: the first, and those far enough from such."""
    found: list[tuple[str, Array]] = []
    places = np.array([*picture.positions, *picture.marks.values()])
    apart = _APART * np.ptp(places, axis=0).max() if len(places) else 0.0
    for name, point in picture.marks.items():
        if all(np.linalg.norm(point - other) >= apart for _, other in found):
            found.append((name, point))
    return found
