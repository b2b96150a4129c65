"""A run as one page of HTML that needs nothing beside it."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sidtool import __version__
from sidtool.formats.endings import check_ending
from sidtool.formats.errors import InputError
from sidtool.formats.html import escape, html_table
from sidtool.formats.result import Result, units_in
from sidtool.formats.storage.atomic import atomic_path
from sidtool.solver.afterwards import scene_of

from ..plot.figure import styled
from ..plot.results import drawn
from ..report.accuracy import accuracy_summary, budget_table, error_table
from ..report.result import contributions, course, event_rows
from ..report.scene import scene_parts
from ..report.tables import named
from ..view.animating import shown
from ..view.film import stills
from ..view.ranges import fitting_scale
from .modelled import modelled

_STYLE = """
@page { size: A4; margin: 18mm 15mm; }
body { font: 10.5pt/1.45 "DejaVu Sans", Arial, sans-serif; color: #111;
       max-width: 180mm; margin: 1.5em auto; padding: 0 1em; }
h1 { font-size: 17pt; margin: 0; }
h2 { font-size: 12.5pt; margin: 1.6em 0 .4em; border-bottom: 1px solid #888;
     break-after: avoid; }
table { border-collapse: collapse; margin: .5em 0; font-size: 9pt; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: 2px 8px 2px 0;
         border-bottom: 1px solid #ddd; overflow-wrap: break-word; }
td:first-child { white-space: nowrap; }
thead { display: table-header-group; }
tr, figure { break-inside: avoid; }
figure { margin: .5em 0; } figure svg, figure img { max-width: 100%; height: auto; }
figcaption { font-size: 9pt; color: #444; }
.pictures { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 4px; }
.state { font-weight: bold; } .bad { color: #a00; }
"""


def write_report(
    path: Path, result: Result, fields: Mapping[str, Any], folder: Path
) -> list[str]:
    """Write the page; sentences on what it could not show.

    fields : full fields of flexible bodies, or their files, by body
    folder : where files of the scene may be

    Raises
    ------
    InputError, OSError : the result holds no scene, or the page cannot be written.
    """
    check_ending(path, "page")
    scene, told = scene_of(result), list[str]()
    title = escape(result.title or "Simulation")
    ended = escape(result.message) or "complete"
    state = "state" if result.completed else "state bad"
    kind = "" if result.completed else "unfinished: "
    parts = [
        f"<h1>{title}</h1><p class='{state}'>{kind}{ended}</p>",
        *_pictures(result, fields, folder, told),
        "<h2>Scene</h2>",
        *(part.html for part in scene_parts(scene)),
        "<h2>What was modelled, and what was left out</h2>",
        modelled(scene, result).html,
        *_flexible(result),
        "<h2>Method, accuracy and cost</h2>",
        course(result).html,
        *_accuracy(result),
        *_events(result),
        *_outputs(result, told),
        "<h2>Versions</h2>",
        named(result.versions.items()).html,
    ]
    page = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        f'<meta name="generator" content="sidtool {__version__}">'
        f"<title>{title}</title><style>{_STYLE}</style></head>"
        f"<body>{''.join(parts)}</body></html>\n"
    )
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return told


def _pictures(
    result: Result, fields: Mapping[str, Any], folder: Path, told: list[str]
) -> Iterator[str]:
    """The mechanism at the start, in the middle and at the end."""
    try:
        seen = shown(result, fields, folder)
    except InputError as error:
        told.append(f"there are no pictures of the mechanism: {error}")
        return
    count = len(seen.motion.t)
    rows = sorted({0, count // 2, count - 1}) if count else []
    scale = fitting_scale(seen.motion, seen.bodies)
    yield "<h2>Mechanism</h2><div class='pictures'>"
    for row, image in zip(
        rows, stills(seen.motion, seen.bodies, rows, scale), strict=True
    ):
        data = base64.b64encode(image).decode()
        yield f"<figure><img alt='mechanism' src='data:image/png;base64,{data}'>"
        yield f"<figcaption>t = {seen.motion.t[row]:.6g} s</figcaption></figure>"
    yield "</div>"
    for body in seen.bodies:
        if body.sketched:
            yield f"<p>{escape(body.name)} is drawn from {escape(body.source)}.</p>"
    if scale != 1:
        yield f"<p>Deformations are drawn {scale:g} times as large.</p>"


def _flexible(result: Result) -> Iterator[str]:
    """Of flexible bodies, what was expected and what each shape function did."""
    for name, body in result.bodies.items():
        yield f"<p>{escape(name)}: {escape(body.before)}</p>"
        yield contributions(name, body).html


def _accuracy(result: Result) -> Iterator[str]:
    if result.accuracy is not None:
        for part in (accuracy_summary, error_table, budget_table):
            yield part(result.accuracy).html


def _events(result: Result) -> Iterator[str]:
    rows = event_rows(result.events)
    if rows:
        yield "<h2>Events</h2>" + html_table(rows, ("event", "kind", "t [s]"))


def _outputs(result: Result, told: list[str]) -> Iterator[str]:
    """A table of ranges with units, and curves."""
    if not result.names or not len(result.t):
        return
    rows, unit = [], units_in(result)
    for name, column in zip(result.names, result.values.T, strict=True):
        numbers = (column[0], np.min(column), np.max(column), column[-1])
        when = result.t[int(np.argmax(np.abs(column)))]
        cells = [f"{x:.6g}" for x in (*numbers, when)]
        rows.append((name, unit(name), *cells))
    header = ("output", "unit", "first", "least", "greatest", "last", "largest at [s]")
    yield "<h2>Outputs</h2>" + html_table(rows, header)
    if len(result.t) < 2:
        return
    with styled():
        page, notes = drawn(result)
        stream = io.StringIO()
        page.savefig(stream, format="svg", metadata={"Date": None})
    told += notes
    svg = stream.getvalue()
    yield f"<figure>{svg[svg.index('<svg') :]}</figure>"
    yield "".join(f"<p>{escape(note)}</p>" for note in notes)
