"""One page that plays a mechanism in 3D, in any browser and without a network."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import resources
from string import Template
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from sidtool.formats.errors import InputError
from sidtool.formats.html import escape
from sidtool.formats.scene import unit_of
from sidtool.formats.sid import Array

from ..plot.courses import drawn_svg
from ..plot.figure import COLOURS
from .drawn_bodies import Drawn
from .library import three_js
from .links import COLOURS as LINK_COLOURS
from .links import Link
from .played import Played
from .ranges import Range, colour_ranges
from .surface import thinned
from .views import upward, views

#: Triangles in all beyond which bodies are thinned, and of the picture that plays
#: where a browser is slow.
MOST_TRIANGLES, FEW_TRIANGLES = 250_000, 20_000
#: Time between two pictures beyond which a browser counts as slow [ms].
SLOWEST = 60
#: Speeds to choose from.
SPEEDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 1, 2, 5, 10, 30)
#: Playing time that the speed at the beginning aims at [s].
_LEAST, _LONGEST = 3.0, 90.0
_BODY_COLOURS = COLOURS[:6]
#: What plays the motion, in the order of the page.
_SCRIPTS = ("body.js", "camera.js", "player.js")


def page(
    motion: Played,
    bodies: Sequence[Drawn],
    columns: Mapping[str, Array],
    *,
    errors: Mapping[str, float] | None = None,
    title: str,
    colour: str = "",
    scale: float = 1.0,
    told: Sequence[str] = (),
    generator: str = "sidtool",
) -> str:
    """The page as text.

    Parameters
    ----------
    columns : outputs at the times of the motion, drawn beside it
    errors : estimated, of some of these: bands around their curves
    colour : what colours bodies at the beginning: "", "displacement" or "stress"
    scale : magnification of deformations at the beginning
    told : sentences for its head

    Raises
    ------
    InputError : three.js is not installed, or there is nothing to colour by.
    """
    ranges = colour_ranges(motion, bodies)
    if colour and colour not in ranges:
        raise InputError(
            f"there is no {colour} to colour by",
            place="--colour",
            expected=" or ".join(ranges) or "a flexible body",
        )
    sentences = [*told]
    total = sum(len(body.triangles) for body in bodies)
    entries = []
    for number, body in enumerate(bodies):
        share = len(body.triangles) / max(total, 1)
        drawn = thinned(body.positions, body.triangles, int(share * MOST_TRIANGLES))
        few = thinned(body.positions, drawn, int(share * FEW_TRIANGLES) + 12)
        entries.append(_body(motion, body, drawn, few, number))
    kept = sum(entry.pop("count") for entry in entries)
    if kept < total:
        sentences.append(f"thinned to {kept} of {total} surface triangles")
    content = {
        "t": _packed(motion.t, "<f8"),
        "size": motion.size,
        "up": upward(motion.scene).tolist(),
        "views": {name: view.tolist() for name, view in views(motion.scene).items()},
        "view": "front" if motion.scene.dimension == "planar" else "iso",
        "triangles": kept,
        "slowest": SLOWEST,
        "speeds": SPEEDS,
        "speed": _speed(float(motion.t[-1] - motion.t[0])),
        "scale": scale,
        "colour": colour,
        "colours": {name: _legend(found) for name, found in ranges.items()},
        "palette": _palette(),
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
        "links": [_link(link) for link in motion.links],
    }
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return Template(_part("player.html")).substitute(
        title=escape(title or "Motion"),
        told=escape("; ".join(sentences)),
        generator=escape(generator),
        style=_part("player.css"),
        plots=_plots(motion, columns, errors or {}),
        data=text.replace("<", "\\u003c"),
        library=three_js(),
        player="".join(map(_part, _SCRIPTS)),
    )


def _part(name: str) -> str:
    return (resources.files("sidtool.view") / name).read_text(encoding="utf-8")


def _body(
    motion: Played, body: Drawn, drawn: NDArray[np.int64], few: Any, number: int
) -> dict[str, Any]:
    used, rows = np.unique(drawn, return_inverse=True)
    name = body.name
    shapes, sizes = _shares(body.shapes[used])
    entry: dict[str, Any] = {
        "name": name,
        "colour": _BODY_COLOURS[number % len(_BODY_COLOURS)],
        "positions": _packed(body.positions[used], "<f4"),
        "triangles": _packed(rows, "<u4"),
        "coarse": None,
        "sketched": body.sketched,
        "shapes": shapes,
        "shape_sizes": sizes,
        "stress": None,
        "places": _packed(motion.places[name], "<f4"),
        "turns": _packed(_quaternions(motion.turns[name]), "<f4"),
        "elastic": _packed(motion.elastic[name], "<f4"),
        "count": len(drawn),
    }
    if len(few) < len(drawn):
        entry["coarse"] = _packed(np.searchsorted(used, few), "<u4")
    if body.stress is not None and body.nq:
        entry["stress"], entry["stress_sizes"] = _shares(body.stress[used])
        if body.initial_stress.any():
            entry["initial_stress"] = _packed(body.initial_stress[used], "<f4")
    return entry


def _link(link: Link) -> dict[str, Any]:
    return {
        "name": link.name,
        "kind": link.kind,
        "colour": LINK_COLOURS[link.kind],
        "positions": _packed(link.positions, "<f4"),
        "triangles": _packed(link.triangles, "<u4"),
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
    """(nt, 4) x, y, z, w; neighbours on one side, so that none turns the long way."""
    found = Rotation.from_matrix(turns).as_quat()
    signs = np.where(np.einsum("ta,ta->t", found[1:], found[:-1]) < 0, -1.0, 1.0)
    found[1:] *= np.cumprod(signs)[:, None]
    return np.asarray(found, float)


def _shares(shapes: Array) -> tuple[str, list[float]]:
    """(n, c, nq) as shares of the largest entry of each mode in 16 bits."""
    sizes = np.abs(shapes).max(axis=(0, 1), initial=0.0)
    safe = np.where(sizes > 0, sizes, 1.0)
    shares = np.round(np.moveaxis(shapes / safe, 2, 0) * 32767)
    return _packed(shares, "<i2"), sizes.tolist()


def _packed(numbers: ArrayLike, kind: str) -> str:
    return base64.b64encode(
        np.ascontiguousarray(numbers, dtype=kind).tobytes()
    ).decode()


def _legend(found: Range) -> dict[str, Any]:
    return {
        "title": found.title,
        "unit": found.unit,
        "most": found.most,
        "per": found.per,
    }


def _palette() -> str:
    from matplotlib import colormaps

    colours = colormaps["viridis"](np.arange(256))[:, :3]
    return _packed(np.round(255 * colours), "<u1")


def _speed(duration: float) -> float:
    """1 where that plays neither too short nor too long."""
    if _LEAST <= duration <= _LONGEST or duration <= 0:
        return 1
    wanted = duration / (2 * _LEAST if duration < _LEAST else _LONGEST)
    return min(SPEEDS, key=lambda speed: abs(np.log(speed / wanted)))


def _plots(
    motion: Played, columns: Mapping[str, Array], errors: Mapping[str, float]
) -> str:
    if not columns or len(motion.t) < 2:
        return ""
    units = partial(unit_of, scene=motion.scene)
    svg, left, right = drawn_svg(motion.t, columns, errors, units)
    mark = f'<div class="cursor" data-left="{left:.6f}" data-right="{right:.6f}"></div>'
    return f'<div class="plot">{svg}{mark}</div>'
