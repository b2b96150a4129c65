"""Figures of bodies with their shape functions, and of meshes with their markers.

Pictures of bodies side by side, from above or in space, all at one scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.proj3d import proj_transform
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.field import Field, mismatch_text
from sidtool.formats.model import ModelFile

from ..discretisation.registry import finite_element_model
from ..field.body_field import sample_body
from ..field.body_surfaces import BodySurface, surface_of_field, surface_of_sid
from ..field.surface import border_edges, decimate
from .figure import (
    COLOURS,
    LEGEND_ROW_HEIGHT,
    NotebookFigure,
    figure_style,
    legend_columns,
    order_by_rows,
    place_names,
    save_figure,
    text_boxes,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Indices = NDArray[np.int64]


#: Viewing direction [degree].
_ELEVATION, _AZIMUTH = 30.0, -60.0
#: Margins around the box for ticks: left, right, below, above [inch].
_TICK_MARGINS = (0.35, 0.85, 0.75, 0.1)
#: Smallest distance of two ticks, horizontal and vertical [inch].
_TICK_DISTANCE_X, _TICK_DISTANCE_Y = 0.4, 0.17
#: Distances from an axis to its label that are tried; matplotlib scales them with the
#: length of the axis.
_LABEL_PADS = (*range(-6, 60, 3), *range(60, 300, 12))
#: Smallest edge of the box relative to the longest; largest ratio of height to width.
_MIN_EDGE_RATIO, _MAX_HEIGHT_RATIO = 0.04, 1.0

#: Out-of-plane extent, relative to the size, below which a body is flat.
_PLANE_TOLERANCE = 1e-6
#: Heights of a title and of the margin of a picture [inch].
_TITLE, _MARGIN = 0.25, 0.1


class BodyAxes:
    """Axes with a common window for any number of pictures.

    Parameters
    ----------
    low, high : (3,) corners of the window [m]
    width : of a picture on the page [inch]
    """

    def __init__(self, low: Array, high: Array, width: float) -> None:
        spare = (
            np.clip(_MIN_EDGE_RATIO * (high - low).max() - (high - low), 0.0, None) / 2
        )
        self.low, self.high = low - spare, high + spare
        self.width = width
        self.pads: dict[str, int] = {}
        e, a = np.radians([_ELEVATION, _AZIMUTH])
        #: (2, 3) projection of the unit vector of each axis on the page
        self.sight = np.array(
            [
                [-np.sin(a), np.cos(a), 0.0],
                [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)],
            ]
        )
        left, right, below, above = _TICK_MARGINS
        visible_extent = np.abs(self.sight) @ (self.high - self.low)
        free = np.array(
            [width - left - right, _MAX_HEIGHT_RATIO * width - below - above]
        )
        #: inches on the page per metre
        self.scale = float((free / visible_extent).min())
        self.height = float(self.scale * visible_extent[1]) + below + above

    def add(self, page: Figure, x: float, y: float) -> Any:
        """Add axes in a part of a page with the lower left corner at x, y [inch]."""
        left, right, below, above = _TICK_MARGINS
        side = max(self.width, self.height)
        middle = np.array(
            [x + (self.width + left - right) / 2, y + (self.height + below - above) / 2]
        )
        corner, total = middle - side / 2, page.get_size_inches()
        place = (*(corner / total), *(side / total))
        axes = cast(Any, page.add_axes(place, projection="3d"))
        axes.computed_zorder = False  # points inside bores are visible through the body
        axes.patch.set_visible(False)
        axes.set_proj_type("ortho")
        axes.view_init(_ELEVATION, _AZIMUTH)
        lows, highs = self.low, self.high
        limits = zip("xyz", lows, highs, strict=True)
        axes.set(**{f"{name}lim": ends for name, *ends in limits})
        for number, name in enumerate("xyz"):
            axes.set(**{f"{name}ticks": self._ticks(number)})
        axes.tick_params(labelsize="x-small", pad=0)
        self._zoom(axes, middle)
        self._label(axes)
        return axes

    def _label(self, axes: Any) -> None:
        """Set the names of the axes as close as the tick labels allow."""
        if len(self.pads) < 3:
            axes.figure.draw_without_rendering()  # places tick labels
        for name in "xyz":
            axis, set_label = (
                getattr(axes, f"{name}axis"),
                getattr(axes, f"set_{name}label"),
            )
            label = partial(set_label, f"{name} [m]", fontsize="x-small")
            if name in self.pads:
                label(labelpad=self.pads[name])
                continue
            others = text_boxes(axes, axis.label)
            for pad in _LABEL_PADS:
                label(labelpad=pad)
                if _is_label_free(axis, others):
                    self.pads[name] = pad
                    break

    def _zoom(self, axes: Any, middle: Array) -> None:
        """Scale the box to its size and centre it at `middle` [inch]."""
        size = self.high - self.low
        axes.set_box_aspect(tuple(size), zoom=1.0)  # matplotlib modifies arrays
        wanted = np.linalg.norm(self.sight @ size) * self.scale
        zoom = wanted / np.linalg.norm(np.diff(self._ends(axes), axis=0))
        axes.set_box_aspect(tuple(size), zoom=float(zoom))
        off = (middle - self._ends(axes).mean(axis=0)) / axes.figure.get_size_inches()
        axes.set_position(axes.get_position(original=True).translated(*off))

    def _ends(self, axes: Any) -> Array:
        """Return the positions (2, 2) of the lowest and the highest corner of the box
        [inch].
        """
        projected = self.project(axes, [self.low, self.high])
        return np.asarray(axes.transData.transform(projected) / axes.figure.dpi)

    def _ticks(self, number: int) -> list[float]:
        """Return the ticks of an axis, at distances at which their numbers do not
        overlap.
        """
        low, high = self.low[number], self.high[number]
        across, up = self.scale * np.abs(self.sight[:, number])
        distance = min(
            _TICK_DISTANCE_X / max(across, 1e-12), _TICK_DISTANCE_Y / max(up, 1e-12)
        )
        count = max(1, int((high - low) / distance))
        for bins in range(count, 0, -1):
            ticks = MaxNLocator(bins, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
            visible = [float(tick) for tick in ticks if low <= tick <= high]
            if visible and (len(visible) < 2 or visible[1] - visible[0] >= distance):
                return visible
        return [0.0] if low <= 0 <= high else [float((low + high) / 2)]

    def project(self, axes: Any, points: Any) -> Array:
        """Return the projections (n, 2) of points (n, 3), in the data of the axes."""
        axes.apply_aspect()
        x, y, _ = proj_transform(*np.reshape(points, (-1, 3)).T, axes.get_proj())
        return np.column_stack([x, y])

    def occupied_box(self, page: Figure, x: float, y: float) -> Bbox:
        """Return the part of a page that a picture occupies [pixels]."""
        corners = np.array([[x, y], [x + self.width, y + self.height]])
        return Bbox(corners * page.dpi)


def _is_label_free(axis: Any, others: Sequence[Bbox]) -> bool:
    """Return whether the label of an axis overlaps none of the boxes of others."""
    axis.draw(axis.figure.canvas.get_renderer())  # places the label
    mine = axis.label.get_window_extent().padded(2)
    return not any(mine.overlaps(box) for box in others)


@dataclass(frozen=True, eq=False)
class BodyPicture:
    """One picture: a surface, coloured by values or uniformly, and marks on it.

    Attributes
    ----------
    marks : points with names
    groups : points with a colour, by their text in the legend
    """

    title: str
    positions: Array
    triangles: Indices
    values: Array | None = None
    rest: Array | None = None
    marks: dict[str, Array] = field(default_factory=dict)
    groups: dict[str, Array] = field(default_factory=dict)
    lines: tuple[Array, ...] = ()
    meshed: bool = False


def draw_bodies(
    pictures: Sequence[BodyPicture], heading: str = ""
) -> tuple[Figure, list[str]]:
    """Draw all pictures in windows of the same extent.

    Parameters
    ----------
    heading : text above all of them

    Returns
    -------
    the page, and the names of marks without room
    """
    low, high = _common_window(pictures)
    extent = float((high - low).max())
    flat = bool((high - low)[2] <= _PLANE_TOLERANCE * extent) or _is_plate(
        pictures, extent
    )
    margin = 0.03 * extent
    window = low - margin, high + margin
    return (_draw_flat_page if flat else _draw_solid_page)(pictures, window, heading)


def _common_window(pictures: Sequence[BodyPicture]) -> tuple[Array, Array]:
    parts = [p.positions for p in pictures]
    parts += [np.reshape(list(p.marks.values()), (-1, 3)) for p in pictures]
    parts += [points for p in pictures for points in (*p.groups.values(), *p.lines)]
    points = np.concatenate(parts)
    low, high = points.min(axis=0), points.max(axis=0)
    return (low, high) if np.ptp(points, axis=0).any() else (low - 0.5, high + 0.5)


def _picture_grid(count: int) -> tuple[int, int, float]:
    """Return rows, columns, and the width of one picture [inch]."""
    columns = 1 if count == 1 else 2 if count < 7 else 3
    return -(-count // columns), columns, (8.0 if columns < 3 else 11.0) / columns


def _is_plate(pictures: Sequence[BodyPicture], extent: float) -> bool:
    """Return whether a body is plane; plane bodies are drawn from above."""
    first = pictures[0].positions
    same = all(
        len(p.positions) == len(first)
        and np.abs(p.positions[:, 2] - first[:, 2]).max(initial=0.0)
        <= _PLANE_TOLERANCE * extent
        for p in pictures
    )
    levels = np.unique(np.round(first[:, 2] / extent, 9))
    return same and len(levels) <= 2


def _draw_flat_page(
    pictures: Sequence[BodyPicture], window: tuple[Array, Array], heading: str
) -> tuple[Figure, list[str]]:
    rows, columns, width = _picture_grid(len(pictures))
    low, high = window
    size = high - low
    height = min(max(width * size[1] / size[0], 0.5), 2.0 * width) + 0.55
    below = _legend_height(pictures, width * columns)
    page = NotebookFigure((width * columns, height * rows + 0.2 + below))
    every = []
    for number, picture in enumerate(pictures, 1):
        axes = cast(Any, page.add_subplot(rows, columns, number))
        axes.set_title(picture.title, loc="left", fontsize="small")
        _draw_flat(axes, picture)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]")
        axes.set_ylabel("y [m]")
        axes.set_aspect("equal")
        every.append(axes)
    if heading:
        page.suptitle(heading, fontsize="small", x=0.01, ha="left")
    _draw_legend(page, every, loc="outside lower left")
    page.draw_without_rendering()
    page.set_layout_engine("none")
    left = []
    for axes, picture in zip(every, pictures, strict=True):
        places = {name: point[:2] for name, point in picture.marks.items()}
        room = Bbox.intersection(axes.bbox.padded(0.2 * page.dpi), page.bbox)
        left += place_names(axes, places, room or page.bbox)
    return page, left


def _draw_solid_page(
    pictures: Sequence[BodyPicture], window: tuple[Array, Array], heading: str
) -> tuple[Figure, list[str]]:
    rows, columns, width = _picture_grid(len(pictures))
    shape = BodyAxes(*window, width)
    cell = shape.height + _TITLE
    above = _TITLE if heading else 0.0
    below = _legend_height(pictures, width * columns)
    page = NotebookFigure((width * columns, cell * rows + _MARGIN + above + below))
    page.set_layout_engine("none")
    total = page.get_figheight()
    every, corners = [], []
    for number, picture in enumerate(pictures):
        row, column = divmod(number, columns)
        x, top = column * width, total - above - row * cell
        axes = shape.add(page, x, top - cell)
        _place_text(page, x + 0.1, top - 0.06, picture.title)
        _draw_solid(axes, picture)
        every.append(axes)
        corners.append((x, top - cell))
    if heading:
        _place_text(page, 0.1, total - 0.06, heading)
    _draw_legend(page, every, loc="lower left")
    page.draw_without_rendering()
    left = []
    for axes, picture, corner in zip(every, pictures, corners, strict=True):
        projected = shape.project(axes, list(picture.marks.values()))
        places = dict(zip(picture.marks, projected, strict=True))
        left += place_names(axes, places, shape.occupied_box(page, *corner))
    return page, left


def _place_text(page: Figure, x: float, y: float, text: str) -> None:
    """Write a text at a position on the page [inch]."""
    width, height = page.get_size_inches()
    page.text(x / width, y / height, text, fontsize="small", va="top")


def _legend_height(pictures: Sequence[BodyPicture], width: float) -> float:
    labels = [name for picture in pictures for name in picture.groups]
    return LEGEND_ROW_HEIGHT * -(-len(labels) // legend_columns(labels, width - 0.4))


def _draw_legend(page: Any, every: Sequence[Any], loc: str) -> None:
    """Draw the legend of groups of points below all pictures."""
    entries = [axes.get_legend_handles_labels() for axes in every]
    handles = [handle for part, _ in entries for handle in part]
    labels = [label for _, part in entries for label in part]
    if labels:
        columns = legend_columns(labels, page.get_figwidth() - 0.4)
        handles, labels = order_by_rows(handles, labels, columns)
        page.legend(handles, labels, loc=loc, ncols=columns, borderaxespad=0.2)


def _draw_flat(axes: Any, picture: BodyPicture) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    faces = picture.positions[picture.triangles][..., :2]
    if picture.rest is not None:
        rim = list(_outline_edges(picture.rest, picture.triangles))
        axes.add_collection(LineCollection(rim, colors="0.6", lw=0.7))
    colours = _face_colours(picture)
    edge = "0.45" if picture.meshed else colours
    axes.add_collection(
        PolyCollection(list(faces), facecolors=colours, edgecolors=edge, linewidths=0.2)
    )
    _draw_points(axes, picture, 2)


def _outline_edges(positions: Array, triangles: Indices) -> Array:
    """Return the edges of the upper side of a plane body, from above."""
    top = positions[triangles][..., 2].min(axis=1) >= positions[:, 2].max() - 1e-12
    rim = border_edges(triangles[top] if top.any() else triangles)
    return positions[rim][..., :2]


def _draw_solid(axes: Any, picture: BodyPicture) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = picture.positions[picture.triangles]
    axes.add_collection3d(
        Poly3DCollection(
            faces,
            facecolors=_shade_faces(faces, _face_colours(picture)),
            edgecolors="0.35" if picture.meshed else "none",
            linewidths=0.15,
        ),
        autolim=False,
    )
    _draw_points(axes, picture, 3)


def _face_colours(picture: BodyPicture) -> Array:
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    if picture.values is None:
        plain = 0.45 + 0.55 * np.array(to_rgb(COLOURS[0]))
        return np.tile(plain, (max(len(picture.triangles), 1), 1))
    shares = picture.values[picture.triangles].mean(axis=1)
    return np.asarray(colormaps["viridis"](shares)[:, :3])


def _shade_faces(faces: Array, colours: Array) -> Array:
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    light = np.array([0.3, -0.6, 0.74])
    sizes = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    bright = np.abs(normals @ light) / sizes
    return np.asarray(colours[: len(faces)] * (0.6 + 0.4 * bright)[:, None])


def _draw_points(axes: Any, picture: BodyPicture, d: int) -> None:
    for line in picture.lines:
        axes.plot(*line.T[:d], color="0.5", lw=0.5, marker=".", ms=1.5)
    for number, (name, points) in enumerate(picture.groups.items(), 1):
        colour = COLOURS[number % 7]
        axes.plot(*points.T[:d], ".", ms=2.5, color=colour, label=name, zorder=4)
    for point in picture.marks.values():
        axes.plot(*point[:d, None], "o", ms=3.5, color=COLOURS[1], zorder=5)


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
    outlined = bool(body.outlines())
    if not len(faces):
        groups["nodes"] = sampled.positions
    elif outlined:
        groups["nodes"] = np.pad(body.positions, ((0, 0), (0, 3 - body.dimension)))
    picture = BodyPicture(
        f"{_without_control_characters(model.title) or 'model'}: {body.ndof} degrees "
        "of freedom",
        sampled.positions,
        faces,
        marks={marker.name: marker.position for marker in body.markers},
        groups=groups,
        lines=tuple(nets),
        meshed=not outlined,  # segments of beams are no elements
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
