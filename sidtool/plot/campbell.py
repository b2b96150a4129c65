"""Pictures of Campbell diagrams."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .figure import COLOURS, draw_legend, saved_figure

if TYPE_CHECKING:
    from sidtool.solver.analyses.campbell import CampbellDiagram

_STYLES = {"forward": "-", "backward": "--", "": ":"}
_WHIRL_NAMES = {"forward": "forward", "backward": "backward", "": "no whirl"}


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
