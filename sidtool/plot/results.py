"""Results: outputs over time, spectra, energies, residuals of constraints."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result, units_in
from sidtool.formats.scene import expanded
from sidtool.solver.afterwards import scene_of

from ..afterwards import outputs, outputs_at, played_outputs
from . import courses
from .courses import Curve, curves_of, draw, errors_of, grouped, labels_of
from .figure import saved, styled, use_log_scale
from .words import broken, legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: Points of a curve at least, and pairs of axes at most.
_POINTS, _MOST = 2000, 12
#: Width of a page, height of a row [inch], and letters in a line of its title.
_WIDTH, _ROW, _LETTERS = 7.5, 1.55, 90
#: Uncertainty between output times that is told of.
_TOLD = 0.005
#: What outputs differ by, relative to their range, where every other output time is
#: left out, that output times do not follow; such outputs named at most.
_UNRESOLVED, _NAMED = 0.3, 4
ENERGIES = ("energy.kinetic", "energy.elastic", "energy.potential")
RESIDUALS = ("constraint.position", "constraint.velocity")
KINDS = ("outputs", "spectrum", "energy", "drift")


def plot_result(
    path: Path,
    result: Result,
    kind: str = "outputs",
    names: str | Iterable[str] | None = None,
) -> list[str]:
    """Draw what a result says over time, or its spectrum.

    Curves are drawn from states between the output times, interpolated and projected
    on the constraints.

    Parameters
    ----------
    kind : one of `KINDS`
    names : outputs to draw, with wildcards; default those that were recorded

    Returns
    -------
    sentences on what was left out, or is uncertain

    Raises
    ------
    InputError : the result holds too few times, or there is no such output.
    """
    with styled():
        page, told = drawn(result, kind, names)
        saved(page, path)
    return told


def drawn(
    result: Result, kind: str = "outputs", names: str | Iterable[str] | None = None
) -> tuple[Figure, list[str]]:
    """The figure, and sentences on what was left out, or is uncertain."""
    if len(result.t) < 2:
        raise InputError(
            f"holds {len(result.t)} output times", expected="at least two for a curve"
        )
    if kind == "energy":
        return _energy(result)
    told: list[str] = []
    wanted = list(RESIDUALS) if kind == "drift" else _wanted(result, names)
    groups = grouped(wanted)
    if len(groups) > _MOST:
        told.append(f"{_MOST} of {len(groups)} pairs of axes are drawn")
        groups = groups[:_MOST]
    wanted = [name for group in groups for name in group]
    if kind == "spectrum":
        page, more = _spectrum(result, wanted)
        return page, told + more
    t, columns, uncertain = _dense(result, wanted)
    with styled():
        errors, units = errors_of(result), units_in(result)
        page, rows = courses.drawn(t, groups, columns, errors, units, (_WIDTH, _ROW))
        for place in rows if kind == "drift" else ():
            use_log_scale(place.yaxis)
        _finish(page, rows, result, "t [s]")
    return page, told + uncertain


def _wanted(result: Result, names: str | Iterable[str] | None) -> list[str]:
    if names is None:
        if not result.names:
            raise InputError(
                "recorded no outputs", place="--outputs", expected='such as "rod.q*"'
            )
        return list(result.names)
    listed = names.split(",") if isinstance(names, str) else list(names)
    listed = [name.strip() for name in listed if name.strip()]
    return list(expanded(listed, scene_of(result), result.sids))


def _dense(
    result: Result, names: list[str]
) -> tuple[Array, dict[str, Array], list[str]]:
    """Outputs at many times; recorded ones that cannot be evaluated where they are."""
    if "analysis" in result.settings:
        return result.t, outputs(result, names), []
    if len(result.t) > _POINTS:
        columns = outputs(result, names)
        return result.t, columns, _fast([n for n in names if _alternates(columns[n])])
    t = _times(result.t)
    columns, again = played_outputs(result, names, t)
    if again is None:
        return t, columns, []
    known = again.outputs()
    off = again.unresolved(known)
    fast = [name for name in columns if off.get(name, 0.0) > _UNRESOLVED]
    columns |= {name: np.interp(t, result.t, known[name]) for name in fast}
    followed = max((v / 16.0 for k, v in off.items() if k not in fast), default=0.0)
    return t, columns, [*_uncertain(max(followed, again.uncertainty())), *_fast(fast)]


def _alternates(values: Array) -> bool:
    """Whether lines between every other value miss the values between these."""
    middle = 0.5 * (values[:-2:2] + values[2::2])
    off = np.abs(values[1:-1:2] - middle).max()
    return bool(off > _UNRESOLVED * np.ptp(values))


def _times(t: Array) -> Array:
    count = max(1, -(-_POINTS // (len(t) - 1)))
    shares = np.arange(count) / count
    inner = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
    return np.append(inner, t[-1])


def _uncertain(off: float) -> list[str]:
    if off < _TOLD:
        return []
    return [
        f"between output times curves may be off by {off:.1%} of their range: a "
        "smaller output_step shows more"
    ]


def _fast(names: list[str]) -> list[str]:
    """What is said of outputs that output times do not follow."""
    if not names:
        return []
    named = ", ".join(names[:_NAMED])
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    vary = "varies" if len(names) == 1 else "vary"
    return [
        f"{named}{more} {vary} faster than the output times follow: straight lines "
        "between recorded values; a smaller output_step shows what lies between"
    ]


def _energy(result: Result) -> tuple[Figure, list[str]]:
    """Kinetic, elastic and potential energy and their sum; what is recorded besides."""
    more = [n for n in result.names if n.startswith("energy.") and n not in ENERGIES]
    t, columns, told = _dense(result, [*ENERGIES, *more])
    total = np.sum([columns[name] for name in ENERGIES], axis=0)
    with styled():
        errors = errors_of(result)
        parts = curves_of(ENERGIES, columns, errors, "energy.")
        parts.append(Curve("sum", total))
        change = [Curve("change of the sum", total - total[0])]
        change += curves_of(more, columns, errors, "energy.")
        labels = [labels_of(parts), labels_of(change)]
        page, axes = courses.stacked(labels, _WIDTH, 1.3 * _ROW)
        draw(axes[0], t, parts, "energy [J]")
        draw(axes[1], t, change, "energy [J]" if more else "change of the sum [J]")
        _finish(page, axes, result, "t [s]")
    return page, told


def _spectrum(result: Result, names: list[str]) -> tuple[Figure, list[str]]:
    """Amplitudes of a Hann window over the whole run, up to half the rate of output
    times."""
    count = max(8, len(result.t))
    t = np.linspace(result.t[0], result.t[-1], count)
    columns = outputs_at(result, names, t)
    groups = grouped(names)
    step = t[1] - t[0]
    frequencies = np.fft.rfftfreq(count, step)[1:]
    with styled():
        page, rows = courses.stacked(groups, _WIDTH, 1.1 * _ROW)
        for place, group in zip(rows, groups, strict=True):
            for name in group:
                place.plot(frequencies, amplitudes(columns[name])[1:], label=name)
            use_log_scale(place.yaxis)
            unit = units_in(result)(group[0])
            place.set_ylabel(
                broken(f"amplitude [{unit}]" if unit else "amplitude", 1.2)
            )
            legend(place)
            place.set_xlim(0.0, frequencies[-1])
        _finish(page, rows, result, "frequency [Hz]")
    return page, [f"up to {frequencies[-1]:.4g} Hz, half the rate of the output times"]


def amplitudes(values: Array) -> Array:
    """Of evenly spaced values less their mean, by a Hann window: a sine of amplitude
    one that lasts many periods has a peak of one."""
    window = np.hanning(len(values))
    spectrum = np.fft.rfft((values - values.mean()) * window)
    return np.asarray(2.0 * np.abs(spectrum) / window.sum())


def _finish(page: Any, rows: Any, result: Result, label: str) -> None:
    rows[-1].set_xlabel(label)
    if result.title:
        title = textwrap.fill(result.title, _LETTERS)
        page.suptitle(title, fontsize="medium")
