"""Motion of a mechanism as GIF or MP4, drawn by matplotlib; directions of view."""

import io
import shutil
import tempfile
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import iterate_with_progress
from sidtool.formats.base.sid import Array
from sidtool.formats.base.stress import von_mises
from sidtool.formats.scene import SceneFile, as_3d
from sidtool.formats.storage.atomic import atomic_path

from ..field.body_surfaces import BodySurface
from ..field.surface import decimate
from ..plot.figure import COLOURS, NotebookFigure, figure_style
from .body_fields import ColourRange, colour_ranges
from .links import COLOURS as LINK_COLOURS
from .motion import SampledMotion

#: Largest number of pictures, pictures per second, triangles of a picture.
_MAX_PICTURES, _FRAME_RATE, _MAX_TRIANGLES = 100, 20, 7000
_SIZE, _DPI = (6.4, 4.4), 100
#: Fractions of the page: margin around bodies, start of the title, end of the legend.
_MARGIN, _TITLE, _LEGEND = 0.04, 0.91, 0.2
#: Margin around the visible part of single pictures [pixels].
_CROP_MARGIN = 12
#: Fraction of a colour that does not depend on the direction of a triangle.
_AMBIENT_LIGHT = 0.55


def write_film(
    path: Path,
    motion: SampledMotion,
    bodies: Sequence[BodySurface],
    colour: str,
    scale: float,
) -> list[str]:
    """Write a film in the format of its ending.

    Returns
    -------
    notes on what was omitted

    Raises
    ------
    InputError : ffmpeg is not installed, or there is nothing to colour by.
    """
    ranges = colour_ranges(motion, bodies, colour)
    writer = _film_writer(path)
    total = sum(len(body.triangles) for body in bodies)
    parts = _decimated_bodies(bodies)
    rows = np.linspace(0, len(motion.t) - 1, min(_MAX_PICTURES, len(motion.t)))
    with figure_style(), tempfile.TemporaryDirectory() as folder:
        chosen = np.round(rows).astype(int).tolist()
        stage = Stage(motion, bodies, parts, ranges.get(colour), colour, scale)
        stage.fit(chosen)
        stage.write_sketch_note(bodies)
        whole = Path(folder) / path.name
        with writer.saving(stage.page, str(whole), _DPI):
            for row in iterate_with_progress(chosen, "drawing pictures"):
                stage.show(row)
                writer.grab_frame()
        with atomic_path(path) as temporary:
            shutil.copyfile(whole, temporary)
    drawn_triangles, notes = sum(map(len, parts)), []
    if drawn_triangles < total:
        notes.append(f"thinned to {drawn_triangles} of {total} surface triangles")
    if len(rows) < len(motion.t):
        notes.append(f"{len(rows)} pictures of {len(motion.t)}")
    return notes


def snapshots(
    motion: SampledMotion,
    bodies: Sequence[BodySurface],
    rows: Sequence[int],
    scale: float,
) -> list[bytes]:
    """Return pictures (PNG) of some rows of a motion, with bodies in their colours. All
    have the same window, cropped to the visible part of all pictures.
    """
    with figure_style():
        stage = Stage(motion, bodies, _decimated_bodies(bodies), None, "", scale)
        stage.fit(rows)
        stage.page.set_dpi(2 * _DPI)
        pictures = [stage.picture(row) for row in rows]
    has_ink = np.any([(p[..., :3] < 250).any(axis=2) for p in pictures], axis=0)
    window = np.s_[:, :]
    if has_ink.any():
        places = np.argwhere(has_ink)
        (low, left), (high, right) = (
            places.min(axis=0),
            places.max(axis=0) + _CROP_MARGIN,
        )
        window = np.s_[
            max(low - _CROP_MARGIN, 0) : high, max(left - _CROP_MARGIN, 0) : right
        ]
    return [_png_bytes(picture[window]) for picture in pictures]


def _png_bytes(picture: Any) -> bytes:
    from matplotlib.image import imsave

    stream = io.BytesIO()
    imsave(stream, np.ascontiguousarray(picture), format="png")
    return stream.getvalue()


def _decimated_bodies(bodies: Sequence[BodySurface]) -> list[Any]:
    """Return the triangles of each body, decimated to the limit of a picture."""
    total = sum(len(body.triangles) for body in bodies)
    return [
        decimate(
            b.positions, b.triangles, 12 + _MAX_TRIANGLES * len(b.triangles) // total
        )
        for b in bodies
    ]


def _film_writer(path: Path) -> Any:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if path.suffix.lower() == ".gif":
        return PillowWriter(fps=_FRAME_RATE)
    if not FFMpegWriter.isAvailable():
        raise InputError(
            "ffmpeg is not installed, which writes MP4",
            source=path,
            expected="an installed ffmpeg, or a film -o motion.gif",
        )
    return FFMpegWriter(fps=_FRAME_RATE)


class Stage:
    """A figure of a mechanism that is redrawn for each time."""

    def __init__(
        self,
        motion: SampledMotion,
        bodies: Sequence[BodySurface],
        triangles: Sequence[Any],
        colour_range: ColourRange | None,
        colour: str,
        scale: float,
    ) -> None:
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        self.motion, self.bodies, self.triangles = motion, bodies, triangles
        self.range, self.colour, self.scale = colour_range, colour, scale
        self.page = NotebookFigure(_SIZE, layout=None)
        stage = self.page.add_axes((0, 0, 1, 0.94), projection="3d")
        self.axes = cast(Any, stage)
        self.faces = Poly3DCollection([np.zeros((3, 3))], linewidths=0)
        self.faces.set_clip_on(False)  # the axes are a square in the middle of the page
        self.axes.add_collection3d(self.faces)
        self._place()
        if colour_range is not None:
            self._legend(colour_range)

    def fit(self, rows: Sequence[int]) -> None:
        """Fit the window to all bodies at these times, with the legend below."""
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for row in rows:
            points = np.concatenate([part.reshape(-1, 3) for part in self._faces(row)])
            pixels = self._pixels(points)
            low, high = (
                np.minimum(low, pixels.min(axis=0)),
                np.maximum(high, pixels.max(axis=0)),
            )
        size = np.array(_SIZE) * _DPI
        bottom = _LEGEND if self.range is not None else _MARGIN
        room = size * [1 - 2 * _MARGIN, _TITLE - bottom]
        middle = size * [0.5, (_TITLE + bottom) / 2]
        zoom = float((room / np.maximum(high - low, 1e-9 * size)).min())
        unit = np.eye(3) * self.motion.size
        sight = self._pixels(np.concatenate([np.zeros((1, 3)), unit]))
        across = np.linalg.pinv((sight[1:] - sight[0]).T / self.motion.size)
        # the pixel that does not move when the axes are magnified
        fixed = self._pixels(self.motion.centre[None])[0]
        aim = (low + high) / 2 - (middle - fixed) / zoom
        self._centre_view(self.motion.centre + across @ (aim - fixed), zoom)

    def _centre_view(self, centre: Array, zoom: float) -> None:
        """Show a position in the middle of the axes."""
        half = 0.55 * self.motion.size
        for which, middle in zip("xyz", centre, strict=True):
            self.axes.set(**{f"{which}lim": (middle - half, middle + half)})
        self.axes.set_box_aspect((1, 1, 1), zoom=zoom)

    def _pixels(self, points: Array) -> Array:
        """Return the projections (n, 2) of points on the page."""
        from mpl_toolkits.mplot3d.proj3d import proj_transform

        self.axes.apply_aspect()
        x, y, _ = proj_transform(*points.T, self.axes.get_proj())
        return np.asarray(self.axes.transData.transform(np.column_stack([x, y])))

    def _place(self) -> None:
        """Set the viewing direction."""
        axes, motion = self.axes, self.motion
        self._centre_view(motion.centre, 1.0)
        axes.set_proj_type("ortho")
        axes.set_axis_off()
        up = vertical_axis(motion.scene)
        vertical = "xyz"[int(np.abs(up).argmax())]
        planar = motion.scene.dimension == "planar"
        if planar:
            axes.view_init(elev=90, azim=-90, roll=0)
        else:
            direction = view_directions(motion.scene)["iso"]
            x, y, z = np.roll(direction, 2 - "xyz".index(vertical))
            axes.view_init(
                elev=np.degrees(np.arctan2(z, np.hypot(x, y))),
                azim=np.degrees(np.arctan2(y, x)),
                vertical_axis=vertical,
            )
        self.light = (
            np.array([0.3, 0.4, 1.0])
            if planar
            else view_directions(motion.scene)["iso"]
        )
        self.light = self.light / np.linalg.norm(self.light)

    def _legend(self, colour_range: ColourRange) -> None:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        bar = self.page.add_axes((0.08, 0.13, 0.3, 0.025))
        scale = Normalize(0, colour_range.most / colour_range.per)
        self.page.colorbar(
            ScalarMappable(scale, "viridis"), cax=bar, orientation="horizontal"
        ).set_label(f"{colour_range.title} [{colour_range.unit}]")

    def write_sketch_note(self, bodies: Sequence[BodySurface]) -> None:
        """Write below the picture which bodies are sketches."""
        unknown = ", ".join(body.name for body in bodies if body.is_sketched)
        if unknown:
            text = textwrap.shorten(f"surface not known: {unknown}", 90)
            self.page.text(0.02, 0.01, text, fontsize="small", color="0.4")

    def show(self, row: int) -> None:
        """Draw one time."""
        from matplotlib.colors import to_rgb

        corners = self._faces(row)
        plain = [self._colours(k, body, row) for k, body in enumerate(self.bodies)]
        plain += [
            np.tile(to_rgb(LINK_COLOURS[link.kind]), (len(link.triangles), 1))
            for link in self.motion.links
        ]
        colours = list(map(self._shaded, corners, plain))
        self.faces.set_verts(np.concatenate(corners))
        self.faces.set_facecolor(np.concatenate(colours))
        self.page.suptitle(f"t = {self.motion.t[row]:.4g} s", fontsize="medium")

    def _faces(self, row: int) -> list[Array]:
        """Return the corners (n, 3, 3) [m] of the triangles of each body, then of each
        link, at one time.
        """
        corners = []
        for body, triangles in zip(self.bodies, self.triangles, strict=True):
            moved = body.shapes @ self.motion.elastic[body.name][row]
            local = body.positions + self.scale * moved
            place = self.motion.places[body.name][row]
            world = place + local @ self.motion.turns[body.name][row].T
            corners.append(world[triangles])
        links = self.motion.links
        return [
            *corners,
            *(link.corners(self.motion, row, self.scale) for link in links),
        ]

    def picture(self, row: int) -> Any:
        """Return a picture of one time without its title, (height, width, 4) from 0 to
        255.
        """
        self.show(row)
        self.page.suptitle("")
        self.page.canvas.draw()
        return np.array(cast(Any, self.page.canvas).buffer_rgba())

    def _colours(self, number: int, body: BodySurface, row: int) -> Array:
        from matplotlib import colormaps
        from matplotlib.colors import to_rgb

        triangles = self.triangles[number]
        plain = np.tile(to_rgb(COLOURS[number % 6]), (len(triangles), 1))
        if self.range is None or not body.nq:
            return plain
        q = self.motion.elastic[body.name][row]
        if self.colour == "displacement":
            values = np.linalg.norm(body.shapes @ q, axis=1)
        elif body.stress is None:
            return plain
        else:
            values = von_mises(body.initial_stress + body.stress @ q)
        shares = values[triangles].mean(axis=1) / self.range.most
        return np.asarray(colormaps["viridis"](shares)[:, :3])

    def _shaded(self, faces: Array, colours: Array) -> Array:
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        sizes = np.linalg.norm(normals, axis=1)
        bright = np.abs(normals @ self.light) / np.maximum(sizes, 1e-300)
        return colours * (_AMBIENT_LIGHT + (1 - _AMBIENT_LIGHT) * bright)[:, None]


def vertical_axis(scene: SceneFile) -> Array:
    """Return the vertical axis: against gravity; without gravity y of planar scenes and
    z of others.
    """
    gravity = as_3d(scene.gravity)
    size = float(np.linalg.norm(gravity))
    if size > 0:
        axis = int(np.abs(gravity).argmax())
        if abs(gravity[axis]) > 0.99 * size and not _perpendicular_axis(scene, axis):
            return np.eye(3)[axis] * -np.sign(gravity[axis])
    return np.eye(3)[1 if scene.dimension == "planar" else 2]


def _perpendicular_axis(scene: SceneFile, axis: int) -> bool:
    return scene.dimension == "planar" and axis == 2


def view_directions(scene: SceneFile) -> dict[str, Array]:
    """Return viewing directions by name: unit vectors from the mechanism to the eye."""
    up = vertical_axis(scene)
    if scene.dimension == "planar":
        front = np.array([0.0, 0.0, 1.0])
        side = np.cross(up, front)
    else:
        side = np.eye(3)[0 if abs(up[0]) < 0.5 else 1]
        front = np.cross(side, up)
    top = up + 1e-4 * front
    iso = front + 0.6 * side + 0.5 * up
    return {"iso": iso, "front": front, "top": top, "side": side}
