"""Section forces along bodies, with their envelopes over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Section
from sidtool.formats.base.taylor import Array
from sidtool.formats.diagnostics import Diagnostic, plain_text
from sidtool.formats.result import Result
from sidtool.formats.scene import SECTION_FORCES, matching_names

from ..pipeline.extra_outputs import outputs
from .figure import COLOURS, legend_columns, new_figure, order_by_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE = (7.5, 7.0)


@dataclass(frozen=True, eq=False)
class SectionHistory:
    """Section forces of a body over time.

    Attributes
    ----------
    names : of the sections, by their distance from the start
    positions : (n,) distances along the sections from the first one [m]
    values : (nt, n, 6) N, Vy, Vz, T, My, Mz
    """

    names: tuple[str, ...]
    positions: Array
    values: Array


def section_history(result: Result, body: str, member: str = "") -> SectionHistory:
    """Return the section forces of a body at all output times.

    Parameters
    ----------
    member : of a frame, empty otherwise

    Raises
    ------
    InputError : the body has no sections.
    """
    sid = result.sids.get(body)
    if sid is None or not sid.sections:
        raise InputError(
            f"{body} has no sections",
            expected="a body with [section_forces], converted to an .h5 file",
        )
    sections = [s for s in sid.sections if _member(s) == member]
    if not member:
        sections = sorted(sections, key=lambda section: -section.part.mass)
    places = np.array([section.node.position for section in sections])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    wanted = [f"{body}.{s.name}.{q}" for s in sections for q in SECTION_FORCES]
    columns = outputs(result, wanted)
    values = np.stack([columns[name] for name in wanted], axis=1)
    return SectionHistory(
        names=tuple(section.name for section in sections),
        positions=np.concatenate([[0.0], np.cumsum(steps)]),
        values=values.reshape(len(result.t), len(sections), 6),
    )


def _member(section: Section) -> str:
    """Return the member of a frame, empty for other sections."""
    return section.name.rpartition(".")[0]


def bodies_with_sections(result: Result) -> list[str]:
    """Return the bodies of a result that have sections."""
    return [name for name, sid in result.sids.items() if _has_several(sid)]


def _has_several(sid: SID) -> bool:
    return len(sid.sections) > 1


def draw_sections(
    result: Result, names: str | Iterable[str] | None = None
) -> tuple[Figure, list[Diagnostic]]:
    """Return the figure of section forces, and the largest of each.

    Bands reach from the least to the largest value over time; a line is the state in
    which the moment of a section is largest.

    Parameters
    ----------
    names : of bodies, with wildcards; default all that have sections
    """
    known = bodies_with_sections(result)
    listed = names.split(",") if isinstance(names, str) else list(names or ["*"])
    found = [matching_names(name.strip(), known) for name in listed]
    bodies = list(dict.fromkeys(body for part in found for body in part))
    if not bodies:
        raise InputError(
            "has no bodies with sections" if not known else "there is no such body",
            place="--outputs",
            expected=" or ".join(known) or "bodies with [section_forces]",
        )
    page, axes = new_figure(3, 2, _SIZE)
    notes = []
    beams = [
        (body, member)
        for body in bodies
        for member in dict.fromkeys(map(_member, result.sids[body].sections))
    ]
    for (body, member), colour in zip(beams, cycle(COLOURS), strict=False):
        history = section_history(result, body, member)
        beam = f"{body}.{member}".rstrip(".")
        moments = np.linalg.norm(history.values[:, :, 3:], axis=2).max(axis=1)
        at = int(moments.argmax())
        label = f"{beam}, t = {result.t[at]:.4g} s"
        for k, place in enumerate(axes.T.ravel()):
            curves = history.values[:, :, k]
            low, high = curves.min(axis=0), curves.max(axis=0)
            place.fill_between(history.positions, low, high, color=colour, alpha=0.2)
            place.plot(history.positions, curves[at], color=colour, label=label)
        notes.append(plain_text(f"{beam}: {_extremes(result, history)}"))
    for name, place in zip(SECTION_FORCES, axes.T.ravel(), strict=True):
        place.set_ylabel(f"{name} [{'N' if name[0] in 'NV' else 'N m'}]")
    for place in axes[-1]:
        place.set_xlabel("along the body [m]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    columns = legend_columns(labels, _SIZE[0])
    entries = order_by_rows(handles, labels, columns)
    page.legend(*entries, loc="outside lower center", ncols=columns)
    if result.title:
        page.suptitle(result.title, fontsize="medium")
    return page, notes


def _extremes(result: Result, history: SectionHistory) -> str:
    """The largest magnitude of each section force, where and when."""
    texts = []
    for k, name in enumerate(SECTION_FORCES):
        values = history.values[:, :, k]
        row, column = np.unravel_index(np.abs(values).argmax(), values.shape)
        unit = "N" if name[0] in "NV" else "N m"
        texts.append(
            f"{name} {values[row, column]:.4g} {unit} at {history.names[column]}, "
            f"{result.t[row]:.4g} s"
        )
    return "; ".join(texts)
