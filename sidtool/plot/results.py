"""Figures of results: outputs over time, spectra, energies, constraint residuals.

Section forces along bodies, with their envelopes over time.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Section
from sidtool.formats.diagnostics import Diagnostic, diagnose, plain_text
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.result import Result, units_in
from sidtool.formats.scene import SECTION_FORCES, expand_names, matching_names
from sidtool.solver.simulation.replay import scene_of

from ..pipeline.extra_outputs import interpolated_outputs, outputs, outputs_at
from . import curves
from .curves import (
    Curve,
    draw_axes,
    group_outputs,
    legend_labels,
    make_curves,
    output_errors,
)
from .figure import (
    COLOURS,
    draw_legend,
    figure_style,
    legend_columns,
    new_figure,
    order_by_rows,
    save_figure,
    use_log_scale,
    wrap_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SIZE = (7.5, 7.0)

#: Smallest number of points of a curve, and largest number of pairs of axes.
_MIN_POINTS, _MAX_AXES = 2000, 12
#: Largest number of numbers of the states at the points of a curve.
_MAX_STATE_NUMBERS = 5_000_000
#: Width of a page, height of a row [inch], letters per line of a title.
_WIDTH, _ROW, _LETTERS = 7.5, 1.55, 90
#: Uncertainty between output times that gets a note.
_NOTED_UNCERTAINTY = 0.005
#: Relative change of an output when every other output time is skipped, above which the
#: output times do not resolve it; largest number of such outputs in a note.
_UNRESOLVED_CHANGE, _MAX_NAMED_OUTPUTS = 0.3, 4
ENERGIES = ("energy.kinetic", "energy.elastic", "energy.potential")
RESIDUALS = ("constraint.position", "constraint.velocity")
KINDS = ("outputs", "spectrum", "energy", "drift", "sections")


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


def plot_result(
    path: Path,
    result: Result,
    kind: str = "outputs",
    names: str | Iterable[str] | None = None,
) -> list[str]:
    """Draw outputs of a result over time, or their spectrum.

    Curves are drawn from states between the output times, interpolated and projected
    on the constraints.

    Parameters
    ----------
    kind : one of `KINDS`
    names : outputs to draw, with wildcards; default those that were recorded. Bodies
        for sections

    Returns
    -------
    texts on what was omitted, or is uncertain; warnings are emitted

    Raises
    ------
    InputError : the result holds too few times, or there is no such output.
    """
    with figure_style():
        page, notes = draw_result(result, kind, names)
        save_figure(page, path)
    warn_of_each(notes)
    return [each.line for each in notes if not each.is_warning]


def draw_result(
    result: Result, kind: str = "outputs", names: str | Iterable[str] | None = None
) -> tuple[Figure, list[Diagnostic]]:
    """Return the figure, and diagnostics of omissions and uncertainties."""
    if kind == "sections":
        return draw_sections(result, names)
    if len(result.t) < 2:
        raise InputError(
            f"holds {len(result.t)} output times", expected="at least two for a curve"
        )
    if kind == "energy":
        return _energy_curves(result)
    notes: list[Diagnostic] = []
    wanted = list(RESIDUALS) if kind == "drift" else _requested_outputs(result, names)
    groups = group_outputs(wanted)
    if len(groups) > _MAX_AXES:
        text = f"{_MAX_AXES} of {len(groups)} pairs of axes are drawn"
        notes.append(plain_text(text))
        groups = groups[:_MAX_AXES]
    wanted = [name for group in groups for name in group]
    if kind == "spectrum":
        page, more = _spectra(result, wanted)
        return page, notes + more
    t, columns, uncertain = _dense_outputs(result, wanted)
    with figure_style():
        errors, units = output_errors(result), units_in(result)
        page, rows = curves.draw_curves(
            t, groups, columns, errors, units, (_WIDTH, _ROW)
        )
        for place in rows if kind == "drift" else ():
            use_log_scale(place.yaxis)
        _finish_figure(page, rows, result, "t [s]")
    return page, notes + uncertain


def _requested_outputs(result: Result, names: str | Iterable[str] | None) -> list[str]:
    if names is None:
        if not result.names:
            raise InputError(
                "recorded no outputs", place="--outputs", expected='such as "rod.q*"'
            )
        return list(result.names)
    listed = names.split(",") if isinstance(names, str) else list(names)
    listed = [name.strip() for name in listed if name.strip()]
    return list(expand_names(listed, scene_of(result), result.sids))


def _dense_outputs(
    result: Result, names: list[str]
) -> tuple[Array, dict[str, Array], list[Diagnostic]]:
    """Return outputs at many times; outputs that cannot be evaluated keep their
    recorded times.
    """
    if "analysis" in result.settings:
        return result.t, outputs(result, names), []
    if len(result.t) > _MIN_POINTS:
        columns = outputs(result, names)
        return (
            result.t,
            columns,
            _unresolved_note([n for n in names if _alternates(columns[n])]),
        )
    t = _dense_times(result.t, result.positions.shape[1] + result.velocities.shape[1])
    columns, again = interpolated_outputs(result, names, t)
    if again is None:
        return t, columns, []
    known = again.outputs()
    off = again.interpolation_errors(known)
    fast = [name for name in columns if off.get(name, 0.0) > _UNRESOLVED_CHANGE]
    columns |= {name: np.interp(t, result.t, known[name]) for name in fast}
    followed = max((v / 16.0 for k, v in off.items() if k not in fast), default=0.0)
    return (
        t,
        columns,
        [
            *_uncertainty_note(max(followed, again.state_interpolation_error())),
            *_unresolved_note(fast),
        ],
    )


def _alternates(values: Array) -> bool:
    """Return whether lines between every other value miss the intermediate values."""
    middle = 0.5 * (values[:-2:2] + values[2::2])
    off = np.abs(values[1:-1:2] - middle).max()
    return bool(off > _UNRESOLVED_CHANGE * np.ptp(values))


def _dense_times(t: Array, numbers: int) -> Array:
    """Return the output times and times between them.

    Parameters
    ----------
    numbers : of one state; states at the points of a curve are in memory together
    """
    points = min(_MIN_POINTS, _MAX_STATE_NUMBERS // max(1, numbers))
    count = max(1, -(-points // (len(t) - 1)))
    shares = np.arange(count) / count
    inner = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
    return np.append(inner, t[-1])


def _uncertainty_note(off: float) -> list[Diagnostic]:
    return [] if off < _NOTED_UNCERTAINTY else [diagnose("N821", share=off)]


def _unresolved_note(names: list[str]) -> list[Diagnostic]:
    """Diagnose outputs that the output times do not resolve (N820)."""
    if not names:
        return []
    more = len(names) - _MAX_NAMED_OUTPUTS
    shown = names[:_MAX_NAMED_OUTPUTS] + ([f"{more} more"] if more > 0 else [])
    return [diagnose("N820", outputs=shown, names=names)]


def _energy_curves(result: Result) -> tuple[Figure, list[Diagnostic]]:
    """Return kinetic, elastic and potential energy, their sum, and other recorded
    energies.
    """
    more = [n for n in result.names if n.startswith("energy.") and n not in ENERGIES]
    t, columns, notes = _dense_outputs(result, [*ENERGIES, *more])
    total = np.sum([columns[name] for name in ENERGIES], axis=0)
    with figure_style():
        errors = output_errors(result)
        parts = make_curves(ENERGIES, columns, errors, "energy.")
        parts.append(Curve("sum", total))
        change = [Curve("change of the sum", total - total[0])]
        change += make_curves(more, columns, errors, "energy.")
        labels = [legend_labels(parts), legend_labels(change)]
        page, axes = curves.stacked_axes(labels, _WIDTH, 1.3 * _ROW)
        draw_axes(axes[0], t, parts, "energy [J]")
        draw_axes(axes[1], t, change, "energy [J]" if more else "change of the sum [J]")
        _finish_figure(page, axes, result, "t [s]")
    return page, notes


def _spectra(result: Result, names: list[str]) -> tuple[Figure, list[Diagnostic]]:
    """Return amplitudes with a Hann window over the whole run, up to half the sampling
    rate.
    """
    count = max(8, len(result.t))
    t = np.linspace(result.t[0], result.t[-1], count)
    columns = outputs_at(result, names, t)
    groups = group_outputs(names)
    step = t[1] - t[0]
    frequencies = np.fft.rfftfreq(count, step)[1:]
    with figure_style():
        page, rows = curves.stacked_axes(groups, _WIDTH, 1.1 * _ROW)
        for place, group in zip(rows, groups, strict=True):
            for name in group:
                place.plot(
                    frequencies, amplitude_spectrum(columns[name])[1:], label=name
                )
            use_log_scale(place.yaxis)
            unit = units_in(result)(group[0])
            place.set_ylabel(
                wrap_label(f"amplitude [{unit}]" if unit else "amplitude", 1.2)
            )
            draw_legend(place)
            place.set_xlim(0.0, frequencies[-1])
        _finish_figure(page, rows, result, "frequency [Hz]")
    text = f"up to {frequencies[-1]:.4g} Hz, half the rate of the output times"
    return page, [plain_text(text)]


def amplitude_spectrum(values: Array) -> Array:
    """Return the amplitude spectrum of evenly spaced values less their mean (Hann
    window).

    A sine of amplitude one that lasts many periods has a peak of one.
    """
    window = np.hanning(len(values))
    spectrum = np.fft.rfft((values - values.mean()) * window)
    return np.asarray(2.0 * np.abs(spectrum) / window.sum())


def _finish_figure(page: Any, rows: Any, result: Result, label: str) -> None:
    rows[-1].set_xlabel(label)
    if result.title:
        title = textwrap.fill(result.title, _LETTERS)
        page.suptitle(title, fontsize="medium")
