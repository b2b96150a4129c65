"""Animation of a result: a page for a browser, or a film.

Page that plays a mechanism in 3D, in any browser and without a network.

three.js is taken from an installed package. Compared for a page that needs no network:
three.js 0.63 MB (MIT); k3d 2.6 MB, vtk.js and plotly each over 3 MB, and none of them
moves a deforming surface without sending all of its points for every picture.
"""

import base64
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from sidtool import __version__
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import escape
from sidtool.formats.base.sid import Array
from sidtool.formats.file_names import check_ending, kind_by_ending
from sidtool.formats.result import Result
from sidtool.formats.scene import expand_names, unit_of
from sidtool.formats.storage.atomic import atomic_path
from sidtool.solver.simulation.replay import scene_of

from ..field.body_surfaces import BodySurface, body_surfaces
from ..field.surface import decimate
from ..pipeline.extra_outputs import outputs_at
from ..plot.curves import draw_curves_svg, output_errors
from ..plot.figure import COLOURS
from .body_fields import ColourRange, Given, colour_ranges, find_fields, fitting_scale
from .film import vertical_axis, view_directions
from .links import COLOURS as LINK_COLOURS, Link
from .motion import SampledMotion, sample_motion

#: Total number of triangles above which bodies are decimated; number for slow browsers.
MOST_TRIANGLES, FEW_TRIANGLES = 250_000, 20_000
#: Time between two pictures beyond which a browser counts as slow [ms].
SLOW_FRAME_TIME = 60
#: Selectable playback speeds.
PLAYBACK_SPEEDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 1, 2, 5, 10, 30)
#: Range of the playing time for the initial speed [s].
_MIN_PLAYING_TIME, _MAX_PLAYING_TIME = 3.0, 90.0
_BODY_COLOURS = COLOURS[:6]
#: Scripts of the page, in order.
_SCRIPT_FILES = ("body.js", "camera.js", "player.js")

#: The package that ships three.js with its orbit controls as one minified file.
PACKAGE = "jupyter_threejs_sage"
#: Number of outputs drawn next to the motion: default and largest.
_DEFAULT_OUTPUTS, _MAX_OUTPUTS = 12, 40


def player_page(
    motion: SampledMotion,
    bodies: Sequence[BodySurface],
    columns: Mapping[str, Array],
    *,
    errors: Mapping[str, float] | None = None,
    title: str,
    colour: str = "",
    scale: float = 1.0,
    notes: Sequence[str] = (),
    generator: str = "sidtool",
) -> str:
    """Return the page as text.

    Parameters
    ----------
    columns : outputs at the times of the motion, drawn next to it
    errors : estimated errors of some outputs, drawn as bands around their curves
    colour : initial colouring: "", "displacement" or "stress"
    scale : initial magnification of deformations
    notes : notes at the top of the page

    Raises
    ------
    InputError : three.js is not installed, or there is nothing to colour by.
    """
    ranges = colour_ranges(motion, bodies, colour)
    sentences = [*notes]
    total = sum(len(body.triangles) for body in bodies)
    entries = []
    for number, body in enumerate(bodies):
        share = len(body.triangles) / max(total, 1)
        triangles = decimate(
            body.positions, body.triangles, int(share * MOST_TRIANGLES)
        )
        few = decimate(body.positions, triangles, int(share * FEW_TRIANGLES) + 12)
        entries.append(_body_data(motion, body, triangles, few, number))
    drawn_triangles = sum(entry.pop("count") for entry in entries)
    if drawn_triangles < total:
        sentences.append(f"thinned to {drawn_triangles} of {total} surface triangles")
    content = {
        "t": _pack_numbers(motion.t, "<f8"),
        "size": motion.size,
        "up": vertical_axis(motion.scene).tolist(),
        "views": {
            name: view.tolist() for name, view in view_directions(motion.scene).items()
        },
        "view": "front" if motion.scene.dimension == "planar" else "iso",
        "triangles": drawn_triangles,
        "slowest": SLOW_FRAME_TIME,
        "speeds": PLAYBACK_SPEEDS,
        "speed": _playback_speed(float(motion.t[-1] - motion.t[0])),
        "scale": scale,
        "colour": colour,
        "colours": {
            name: _colour_legend(colour_range) for name, colour_range in ranges.items()
        },
        "palette": _colour_palette(),
        "bodies": entries,
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "body": joint.body,
                "position": joint.position.tolist(),
                "shapes": joint.shapes.tolist(),
            }
            for joint in motion.joints
        ],
        "links": [_link_data(link) for link in motion.links],
    }
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return Template(_read_template("player.html")).substitute(
        title=escape(title or "Motion"),
        notes=escape("; ".join(sentences)),
        generator=escape(generator),
        style=_read_template("player.css"),
        plots=_output_plots(motion, columns, errors or {}),
        data=text.replace("<", "\\u003c"),
        library=three_js(),
        player="".join(map(_read_template, _SCRIPT_FILES)),
    )


def _read_template(name: str) -> str:
    return (resources.files("sidtool.view") / name).read_text(encoding="utf-8")


def _body_data(
    motion: SampledMotion,
    body: BodySurface,
    triangles: NDArray[np.int64],
    few: Any,
    number: int,
) -> dict[str, Any]:
    used, rows = np.unique(triangles, return_inverse=True)
    name = body.name
    shapes, sizes = _quantise_shapes(body.shapes[used])
    entry: dict[str, Any] = {
        "name": name,
        "colour": _BODY_COLOURS[number % len(_BODY_COLOURS)],
        "positions": _pack_numbers(body.positions[used], "<f4"),
        "triangles": _pack_numbers(rows, "<u4"),
        "coarse": None,
        "sketched": body.is_sketched,
        "shapes": shapes,
        "shape_sizes": sizes,
        "stress": None,
        "places": _pack_numbers(motion.places[name], "<f4"),
        "turns": _pack_numbers(_quaternions(motion.turns[name]), "<f4"),
        "elastic": _pack_numbers(motion.elastic[name], "<f4"),
        "count": len(triangles),
    }
    if len(few) < len(triangles):
        entry["coarse"] = _pack_numbers(np.searchsorted(used, few), "<u4")
    if body.stress is not None and body.nq:
        entry["stress"], entry["stress_sizes"] = _quantise_shapes(body.stress[used])
        if body.initial_stress.any():
            entry["initial_stress"] = _pack_numbers(body.initial_stress[used], "<f4")
    return entry


def _link_data(link: Link) -> dict[str, Any]:
    return {
        "name": link.name,
        "kind": link.kind,
        "colour": LINK_COLOURS[link.kind],
        "positions": _pack_numbers(link.positions, "<f4"),
        "triangles": _pack_numbers(link.triangles, "<u4"),
        "ends": [
            {
                "body": end.body,
                "position": end.position.tolist(),
                "shapes": end.shapes.tolist(),
            }
            for end in link.ends
        ],
    }


def _quaternions(turns: Array) -> Array:
    """Return quaternions (nt, 4) x, y, z, w with continuous signs for interpolation."""
    quaternions = Rotation.from_matrix(turns).as_quat()
    signs = np.where(
        np.einsum("ta,ta->t", quaternions[1:], quaternions[:-1]) < 0, -1.0, 1.0
    )
    quaternions[1:] *= np.cumprod(signs)[:, None]
    return np.asarray(quaternions, float)


def _quantise_shapes(shapes: Array) -> tuple[str, list[float]]:
    """Return shapes (n, c, nq) as 16-bit fractions of the largest entry of each
    mode.
    """
    sizes = np.abs(shapes).max(axis=(0, 1), initial=0.0)
    safe = np.where(sizes > 0, sizes, 1.0)
    shares = np.round(np.moveaxis(shapes / safe, 2, 0) * 32767)
    return _pack_numbers(shares, "<i2"), sizes.tolist()


def _pack_numbers(numbers: ArrayLike, kind: str) -> str:
    return base64.b64encode(
        np.ascontiguousarray(numbers, dtype=kind).tobytes()
    ).decode()


def _colour_legend(colour_range: ColourRange) -> dict[str, Any]:
    return {
        "title": colour_range.title,
        "unit": colour_range.unit,
        "most": colour_range.most,
        "per": colour_range.per,
    }


def _colour_palette() -> str:
    from matplotlib import colormaps

    colours = colormaps["viridis"](np.arange(256))[:, :3]
    return _pack_numbers(np.round(255 * colours), "<u1")


def _playback_speed(duration: float) -> float:
    """Return the playback speed nearest to 1 with a suitable playing time."""
    if _MIN_PLAYING_TIME <= duration <= _MAX_PLAYING_TIME or duration <= 0:
        return 1
    wanted = duration / (
        2 * _MIN_PLAYING_TIME if duration < _MIN_PLAYING_TIME else _MAX_PLAYING_TIME
    )
    return min(PLAYBACK_SPEEDS, key=lambda speed: abs(np.log(speed / wanted)))


def _output_plots(
    motion: SampledMotion, columns: Mapping[str, Array], errors: Mapping[str, float]
) -> str:
    if not columns or len(motion.t) < 2:
        return ""
    units = partial(unit_of, scene=motion.scene)
    svg, left, right = draw_curves_svg(motion.t, columns, errors, units)
    mark = f'<div class="cursor" data-left="{left:.6f}" data-right="{right:.6f}"></div>'
    return f'<div class="plot">{svg}{mark}</div>'


def three_js() -> str:
    """Return the newest three.js of the package as one script.

    Raises
    ------
    InputError : the package is not installed.
    """
    try:
        folders = list((resources.files(PACKAGE) / "static").iterdir())
    except (ModuleNotFoundError, FileNotFoundError):
        raise InputError(
            "the page needs three.js, which is not installed",
            expected='pip install "sidtool[view]", or a film: -o motion.gif',
        ) from None
    releases = [f for f in folders if re.fullmatch(r"r\d+", f.name)]
    newest = max(releases, key=lambda folder: int(folder.name[1:]))
    script = (newest / "three.min.js").read_text(encoding="utf-8")
    return script.replace("</script", "<\\/script")


@dataclass(frozen=True, eq=False)
class AnimationData:
    """Bodies and motion of a result.

    Attributes
    ----------
    notes : notes on omissions, and on the source of drawn bodies
    """

    motion: SampledMotion
    bodies: list[BodySurface]
    notes: list[str]


def animation_data(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> AnimationData:
    """Return the bodies and the motion of a result.

    Parameters
    ----------
    fields : full fields of flexible bodies, or their files, by body
    folder : folder of the files of the scene, searched before the working folder

    Raises
    ------
    InputError : the result does not hold its scene, or a field is not that of its SID.
    """
    folders = [folder or Path("."), Path(".")]
    motion = sample_motion(result, folders=folders)
    known = find_fields(motion.scene, result.sids, fields or {}, folders)
    bodies = body_surfaces(
        motion.scene, motion.system.bodies, known, motion.size, folders
    )
    notes = [*motion.notes]
    notes += [f"{body.name} is drawn from {body.source}" for body in bodies if body.nq]
    return AnimationData(motion, bodies, notes)


def animate(
    result: Result,
    path: str | Path,
    *,
    fields: Given | None = None,
    outputs: str | Iterable[str] | None = None,
    colour: str = "",
    scale: float | None = None,
    folder: Path | None = None,
) -> list[str]:
    """Write the motion of a result as a page (.html) or a film (.gif, .mp4).

    Parameters
    ----------
    outputs : outputs drawn next to the motion of a page; default the first recorded
        ones
    colour : "" for a colour by body, "displacement" or "stress"
    scale : magnification of deformations; by default one that makes them visible
    fields, folder : see `animation_data`

    Returns
    -------
    notes on the source of drawn bodies and on omissions

    Raises
    ------
    InputError : a wrong ending, output, field or colour; something is not installed.
    """
    path = Path(path)
    check_ending(path, kind_by_ending(path, "page", "film"))
    data = animation_data(result, fields, folder)
    scale = fitting_scale(data.motion, data.bodies) if scale is None else scale
    notes = list(data.notes)
    if scale != 1:
        notes.insert(0, f"deformations are drawn {scale:g} times as large")
    if path.suffix.lower() != ".html":
        from .film import write_film

        return [*notes, *write_film(path, data.motion, data.bodies, colour, scale)]
    columns, more = _output_columns(result, data.motion.t, outputs)
    text = player_page(
        data.motion,
        data.bodies,
        columns,
        errors=output_errors(result),
        title=result.title,
        colour=colour,
        scale=scale,
        notes=data.notes,
        generator=f"sidtool {__version__}",
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return [*notes, *more]


def _output_columns(
    result: Result, t: Array, names: str | Iterable[str] | None
) -> tuple[dict[str, Array], list[str]]:
    """Return outputs at the times of the pictures."""
    notes = []
    if names is None:
        wanted = list(result.names)
        if len(wanted) > _DEFAULT_OUTPUTS:
            notes = [
                f"the first {_DEFAULT_OUTPUTS} of {len(wanted)} outputs are drawn "
                "beside it"
            ]
        wanted = wanted[:_DEFAULT_OUTPUTS]
    else:
        listed = names.split(",") if isinstance(names, str) else list(names)
        listed = [name.strip() for name in listed if name.strip()]
        wanted = list(expand_names(listed, scene_of(result), result.sids))
        if len(wanted) > _MAX_OUTPUTS:
            raise InputError(
                f"{len(wanted)} outputs are more than a page shows",
                place="--outputs",
                expected=f"at most {_MAX_OUTPUTS}",
            )
    if not wanted:
        return {}, notes
    return outputs_at(result, wanted, t), notes
