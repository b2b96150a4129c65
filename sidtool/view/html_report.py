"""Report of a run as one page of HTML without other files."""

import base64
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import escape, html_table
from sidtool.formats.base.sid import SID
from sidtool.formats.base.stress import stress_nodes
from sidtool.formats.diagnostics import Diagnostic, plain_text
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import check_ending
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.result import Result, has_meaningless_numbers, units_in
from sidtool.formats.scene import RigidBody, SceneFile, SidBody
from sidtool.solver.simulation.replay import scene_of
from sidtool.solver.system.sid_terms import has_quadratic_inertia

from ..plot.figure import figure_style
from ..plot.results import draw_result
from ..report.input_files import scene_parts
from ..report.result import (
    budget_table,
    contributions,
    decision_table,
    error_table,
    event_rows,
    run_overview,
)
from ..report.tables import TextBlock, named_values, text_table
from .animation import animation_data
from .body_fields import fitting_scale
from .film import snapshots
from .html_page import figure_markup, write_page


def write_report(
    path: Path, result: Result, fields: Mapping[str, Any], folder: Path
) -> list[str]:
    """Write the page; return texts on parts that could not be shown.

    fields : full fields of flexible bodies, or their files, by body
    folder : folder of the files of the scene

    Raises
    ------
    InputError, OSError : the result holds no scene, or the page cannot be written.
    """
    check_ending(path, "page")
    scene, notes = scene_of(result), list[Diagnostic]()
    title = result.title or "Simulation"
    ended = escape(result.message) or "complete"
    state = "state" if result.completed else "state bad"
    kind = "failed: " if has_meaningless_numbers(result) else "unfinished: "
    kind = "" if result.completed else kind
    parts = [
        f"<h1>{escape(title)}</h1><p class='{state}'>{kind}{ended}</p>",
        *_snapshots(result, fields, folder, notes),
        "<h2>Scene</h2>",
        *(part.html for part in scene_parts(scene)),
        "<h2>What was modelled, and what was left out</h2>",
        body_model_rows(scene, result).html,
        *_flexible_bodies_section(result),
        "<h2>Method, accuracy and cost</h2>",
        run_overview(result).html,
        *_accuracy_section(result),
        *_event_section(result),
        *_output_section(result, notes),
        "<h2>Versions</h2>",
        named_values(result.versions.items()).html,
    ]
    write_page(path, title, parts)
    warn_of_each(notes)
    return [each.line for each in notes if not each.is_warning]


def _snapshots(
    result: Result, fields: Mapping[str, Any], folder: Path, notes: list[Diagnostic]
) -> Iterator[str]:
    """Draw the mechanism at the start, in the middle and at the end."""
    try:
        animation = animation_data(result, fields, folder)
    except InputError as error:
        text = f"there are no pictures of the mechanism: {error}"
        notes.append(plain_text(text))
        return
    count = len(animation.motion.t)
    rows = sorted({0, count // 2, count - 1}) if count else []
    scale = fitting_scale(animation.motion, animation.bodies)
    yield "<h2>Mechanism</h2><div class='pictures'>"
    for row, image in zip(
        rows, snapshots(animation.motion, animation.bodies, rows, scale), strict=True
    ):
        data = base64.b64encode(image).decode()
        yield f"<figure><img alt='mechanism' src='data:image/png;base64,{data}'>"
        yield f"<figcaption>t = {animation.motion.t[row]:.6g} s</figcaption></figure>"
    yield "</div>"
    for body in animation.bodies:
        if body.is_sketched:
            yield f"<p>{escape(body.name)} is drawn from {escape(body.source)}.</p>"
    if scale != 1:
        yield f"<p>Deformations are drawn {scale:g} times as large.</p>"


def _flexible_bodies_section(result: Result) -> Iterator[str]:
    """Return expectations and contributions of the shape functions of flexible
    bodies.
    """
    for name, body in result.bodies.items():
        yield f"<p>{escape(name)}: {escape(body.before)}</p>"
        yield contributions(name, body).html


def _accuracy_section(result: Result) -> Iterator[str]:
    if result.accuracy is not None:
        for part in (error_table, budget_table, decision_table):
            yield part(result.accuracy).html


def _event_section(result: Result) -> Iterator[str]:
    rows = event_rows(result.events)
    if rows:
        yield "<h2>Events</h2>" + html_table(rows, ("event", "kind", "t [s]"))


def _output_section(result: Result, remarks: list[Diagnostic]) -> Iterator[str]:
    """Return a table of ranges with units, and curves."""
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
    with figure_style():
        page, notes = draw_result(result)
    remarks += notes
    yield figure_markup(page)
    yield "".join(f"<p>{escape(note.line)}</p>" for note in notes)


def body_model_rows(scene: SceneFile, result: Result) -> TextBlock:
    """Return a row for each body: its model, and what is included and neglected."""
    rows, planar = [], scene.dimension == "planar"
    for name, body in scene.bodies.items():
        if isinstance(body, RigidBody):
            taken = "mass" if body.inertia is None else "mass, inertia"
            neglected = "deformation" + (", rotation" if body.inertia is None else "")
            rows.append([name, "rigid", taken, neglected])
        else:
            terms, missing = _flexible_body_row(body, result.sids.get(name), planar)
            rows.append([name, "taken as rigid" if body.rigid else "flexible"])
            rows[-1] += [
                ", ".join(terms),
                ", ".join(missing) or "nothing that is known",
            ]
    return text_table(["body", "kind", "modelled", "left out"], rows)


def _flexible_body_row(
    body: SidBody, sid: SID | None, planar: bool
) -> tuple[list[str], list[str]]:
    """Describe which parts of a SID are included and neglected."""
    if sid is None:
        return ["as its SID says"], []
    if body.rigid:
        return ["mass, inertia, places of nodes"], ["all shape functions"]
    damping = "De of the SID" if body.damping is None else body.damping.type
    damped = body.damping is not None or sid.De.m0.any()
    used = len(body.numbers(sid.nq))
    taken = [f"{used} of {sid.nq} shape functions of the SID"]
    taken += [f"damping ({damping})"] if damped else []
    neglected = ["all other shape functions"]
    neglected += [] if damped else ["damping"]
    quadratic = has_quadratic_inertia(body, sid, planar)
    stiffens = has_stiffening(sid) and body.geometric_stiffening
    for present, what in (
        (stiffens, "geometric stiffening"),
        (bool(stress_nodes(sid)), "stresses"),
        (sid.Ke.first_order(sid.nq).any(), "elastic forces quadratic in q"),
        (quadratic or stiffens, "inertia terms quadratic in q"),
    ):
        (taken if present else neglected).append(what)
    return taken, neglected
