"""A chain of N flexible links: time per step against N."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sidtool.study import Setting, timed

from . import scenes
from .machine import describe_machine
from .plots import plot_scaling
from .report import Report, Table
from .scaling import exponent

LINKS = (2, 4, 8, 16, 32, 64, 128, 256)
FITTED = (8, 256)
STEP, STEPS = 1e-3, 40
INTEGRATORS = ("radau5", "trapezoidal", "generalised_alpha")


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure steps of a fixed size; the plot goes to `folder`."""
    from solver.integrators import INTEGRATORS as KNOWN

    chosen = [i for i in INTEGRATORS if i in KNOWN]
    lines: dict[str, list[tuple[float, float]]] = {i: [] for i in chosen}
    for links in LINKS:
        system = scenes.chain(links, STEP * STEPS)
        for integrator in chosen:
            setting = Setting(integrator, step=STEP, rtol=1e-6)
            result, seconds = timed(system, setting, repeats=3)
            cost = seconds / result.counters["steps"]
            lines[integrator].append((links, 1e6 * cost))
            say(f"  {integrator} N = {links}: {1e6 * cost:.0f} us a step")
    plot_scaling(folder / f"{name}.png", lines, "links", "microseconds a step")
    rows = [
        [str(links), *(f"{lines[i][k][1]:.0f}" for i in chosen)]
        for k, links in enumerate(LINKS)
    ]
    fits = [f"{exponent(lines[i], *FITTED):.3f}" for i in chosen]
    rows.append([f"exponent, {FITTED[0]} to {FITTED[1]}", *fits])
    return Report(
        title="A chain of N flexible links, four modes each",
        tables=[Table("Microseconds a step of 1 ms:", ["N", *chosen], rows, True)],
        plot=f"{name}.png",
        machine=describe_machine(),
    )
