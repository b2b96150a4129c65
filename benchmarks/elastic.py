"""A body with 5 ... 200 elastic coordinates: cost of a step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sidtool.solver.system.system import System

from . import scenes
from .machine import describe_machine
from .plots import plot_scaling
from .report import Report, Table
from .scaling import exponent
from .step_costs import Lines, step_costs

MODES = (5, 10, 20, 50, 100, 200)
TIME = {"end": 0.1, "output_step": 0.01}


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure steps of a fixed size; the plot goes to `folder`."""
    lines = step_costs(_system, MODES, "modes", say)
    plot_scaling(folder / f"{name}.png", lines, "elastic coordinates", "us a step")
    return Report(
        title="Slider-crank with 5 to 200 elastic coordinates",
        tables=[_table(lines)],
        plot=f"{name}.png",
        machine=describe_machine(),
    )


def _system(modes: int) -> System:
    return scenes.slider_crank(modes, time=TIME)


def _table(lines: Lines) -> Table:
    """Cost and local exponent, that is between neighbours."""
    rows = []
    for k, modes in enumerate(MODES):
        cells = []
        for points in lines.values():
            near = points[max(k - 1, 0) : k + 1]
            slope = f"{exponent(near, 0, modes):.2f}" if k else ""
            cells += [f"{points[k][1]:.0f}", slope]
        rows.append([str(modes), *cells])
    header = ["modes"]
    for name in lines:
        header += [name, "exponent"]
    caption = "Microseconds a step of 1 ms, and the exponent since the line before:"
    return Table(caption, header, rows, summary=True)
