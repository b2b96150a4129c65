"""Figure of an optimisation: functionals and variables over the iterations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from sidtool.formats.base.sid import Array

from .figure import saved_figure, wrap_label

#: Width of the figure, height of a panel and of the axis below all [inch].
_WIDTH, _PANEL, _AXIS = 7.0, 1.6, 0.6


def plot_history(
    path: Path | None, panels: Sequence[tuple[str, Array, Sequence[float]]]
) -> Any:
    """Draw a panel for each quantity.

    Parameters
    ----------
    path : file to write (.png, .svg, .pdf)
    panels : label, values over the iterations, limits as dashed lines
    """
    size = _WIDTH, _AXIS + _PANEL * len(panels)
    with saved_figure(path, len(panels), size=size) as drawn:
        all_axes = np.atleast_1d(drawn)
        for axes, (label, values, limits) in zip(all_axes, panels, strict=True):
            axes.plot(values, "o-", markersize=3)
            for limit in limits:
                axes.axhline(limit, color="0.4", linestyle="--", linewidth=0.8)
            axes.set_ylabel(wrap_label(label, _PANEL))
        all_axes[-1].set_xlabel("iteration")
        all_axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return all_axes[0].figure


def plot_fit(
    path: Path | None, panels: Sequence[tuple[str, Array, Array, Array]]
) -> Any:
    """Draw measured and fitted values of outputs over time.

    Parameters
    ----------
    path : file to write (.png, .svg, .pdf)
    panels : label, times, measured and fitted values
    """
    size = _WIDTH, _AXIS + 2.0 * _PANEL * max(1, len(panels))
    with saved_figure(path, max(1, len(panels)), size=size) as drawn:
        all_axes = np.atleast_1d(drawn)
        for axes, (label, times, measured, fitted) in zip(
            all_axes, panels, strict=False
        ):
            axes.plot(times, measured, ".", markersize=3, label="measured")
            axes.plot(times, fitted, linewidth=1.0, label="fitted")
            axes.set_ylabel(wrap_label(label, _PANEL))
        all_axes[0].legend(loc="upper right")
        all_axes[-1].set_xlabel("t [s]")
    return all_axes[0].figure
