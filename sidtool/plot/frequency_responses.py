"""Bode plots of frequency responses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .figure import COLOURS, draw_legend, saved_figure, use_log_scale, wrap_label

if TYPE_CHECKING:
    from sidtool.solver.analyses.frequency_response import FrequencyResponse

#: Height of a panel for labels [inch].
_LABEL_ROOM = 2.2
#: Steps of the ticks of a phase [deg].
PHASE_STEP = 45.0


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
