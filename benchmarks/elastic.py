"""A body with 5 ... 200 elastic coordinates: cost of a step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sidtool.study import Setting, timed

from . import scenes
from .machine import describe_machine
from .plots import plot_scaling
from .report import Report, Table
from .scaling import exponent

MODES = (5, 10, 20, 50, 100, 200)
STEP, END = 1e-3, 0.1
INTEGRATORS = ("radau5", "trapezoidal", "generalised_alpha")


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure steps of a fixed size; the plot goes to `folder`."""
    from solver.integrators import INTEGRATORS as KNOWN

    chosen = [i for i in INTEGRATORS if i in KNOWN]
    lines: dict[str, list[tuple[float, float]]] = {i: [] for i in chosen}
    for modes in MODES:
        system = scenes.slider_crank(modes, time={"end": END, "output_step": 0.01})
        for integrator in chosen:
            setting = Setting(integrator, step=STEP, rtol=1e-6)
            result, seconds = timed(system, setting, repeats=3)
            cost = 1e6 * seconds / result.counters["steps"]
            lines[integrator].append((modes, cost))
            say(f"  {integrator} {modes} modes: {cost:.0f} us a step")
    plot_scaling(folder / f"{name}.png", lines, "elastic coordinates", "us a step")
    return Report(
        title="Slider-crank with 5 to 200 elastic coordinates",
        tables=[_table(lines)],
        plot=f"{name}.png",
        machine=describe_machine(),
    )


def _table(lines: dict[str, list[tuple[float, float]]]) -> Table:
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
