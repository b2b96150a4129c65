"""Bode plots of frequency responses.

Pictures of Campbell diagrams.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .figure import COLOURS, draw_legend, saved_figure, use_log_scale, wrap_label

if TYPE_CHECKING:
    from sidtool.solver.analyses.campbell import CampbellDiagram
    from sidtool.solver.analyses.frequency_response import FrequencyResponse


#: Height of a panel for labels [inch].
_LABEL_ROOM = 2.2
#: Steps of the ticks of a phase [deg].
PHASE_STEP = 45.0

_STYLES = {"forward": "-", "backward": "--", "": ":"}
_WHIRL_NAMES = {"forward": "forward", "backward": "backward", "": "no whirl"}


def plot_response(path: Path | None, response: FrequencyResponse) -> Any:
    """Draw magnitude and phase over frequency, with dots at the peaks; return the
    figure.

    path : picture to write, None for none
    """
    f = response.frequencies
    is_log = bool(f.min() > 0.0 and f.max() > 10.0 * f.min())
    with saved_figure(path, 2, 1, size=(6.0, 5.2)) as (upper, lower):
        units = {*response.units}
        for k, name in enumerate(response.output_names):
            colour = COLOURS[k % len(COLOURS)]
            unit = response.units[k] if len(units) > 1 else ""
            label = f"{name} [{unit}]" if unit else name
            upper.plot(f, response.magnitude[:, k], color=colour, label=label)
            lower.plot(f, np.degrees(response.phase[:, k]), color=colour)
            peaks = [
                (peak.frequency, peak.magnitude)
                for peak in response.peaks
                if peak.output == name and math.isfinite(peak.magnitude)
            ]
            if peaks:
                upper.plot(*zip(*peaks, strict=True), "o", color=colour, markersize=3)
        if np.nanmax(response.magnitude, initial=0.0) > 0.0:
            use_log_scale(upper.yaxis)
        if is_log:
            use_log_scale(upper.xaxis)
            use_log_scale(lower.xaxis)
        lower.yaxis.set_major_locator(_phase_ticks(response))
        unit = f" [{units.pop()}]" if len(units) == 1 and "" not in units else ""
        only = response.output_names[0] if len(response.output_names) == 1 else ""
        label = f"{only or 'magnitude'}{unit}"
        upper.set_ylabel(wrap_label(label, _LABEL_ROOM))
        lower.set_ylabel("phase [deg]")
        lower.set_xlabel(f"frequency of {response.excitation} [Hz]")
        if not only:
            draw_legend(upper)
    return upper.figure


def _phase_ticks(response: FrequencyResponse) -> Any:
    from matplotlib.ticker import MultipleLocator

    degrees = np.degrees(response.phase)
    span = float(np.ptp(degrees[np.isfinite(degrees)])) if degrees.size else 0.0
    return MultipleLocator(PHASE_STEP * max(1, math.ceil(span / (8 * PHASE_STEP))))


def plot_campbell(
    path: Path | None, diagram: CampbellDiagram, orders: tuple[float, ...] = (1.0,)
) -> Any:
    """Draw frequencies in inertial axes over the speed, with lines of the orders and
    dots at the critical speeds; return the figure.

    Without rotation they are drawn over the parameter.

    path : picture to write, None for none
    """
    is_rotating = bool(diagram.speeds.any())
    x = diagram.speeds if is_rotating else diagram.values
    with saved_figure(path, size=(6.0, 4.2)) as axes:
        named: set[str] = set()
        for k in range(diagram.inertial_frequencies.shape[1]):
            colour = COLOURS[k % len(COLOURS)]
            for direction, style in _STYLES.items():
                shown = _segments(diagram.whirl[:, k], direction)
                if not shown.any():
                    continue
                y = np.where(shown, diagram.inertial_frequencies[:, k], np.nan)
                axes.plot(x, y, style, color=colour)
                named.add(direction)
        top = axes.get_ylim()[1]
        if is_rotating:
            for order in orders:
                label = f"{order:g} per revolution"
                line = order * x / (2.0 * np.pi)
                axes.plot(x, line, color="0.5", linewidth=0.8, label=label)
            for each in diagram.critical_speeds:
                hertz = each.order * each.speed / (2.0 * np.pi)
                axes.plot(each.speed, hertz, "o", color="black", markersize=3.5)
            for direction in (d for d in _STYLES if d in named):
                name = _WHIRL_NAMES[direction]
                axes.plot([], [], _STYLES[direction], color="0.2", label=name)
            draw_legend(axes)
        axes.set_ylim(0.0, top)
        axes.set_xlabel("speed [rad/s]" if is_rotating else diagram.key)
        axes.set_ylabel("frequency in inertial axes [Hz]")
    return axes.figure


def _segments(whirl: np.ndarray, direction: str) -> np.ndarray:
    """Points of one direction, and those before where the direction changes."""
    own = whirl == direction
    own[:-1] |= own[1:]
    return np.asarray(own)
