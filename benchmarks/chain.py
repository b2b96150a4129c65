"""A chain of N flexible links: time per step against N."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from . import scenes
from .machine import describe_machine
from .plots import plot_scaling
from .report import Report, Table
from .scaling import exponent
from .step_costs import STEP, step_costs

LINKS = (2, 4, 8, 16, 32, 64, 128, 256)
FITTED = (8, 256)
STEPS = 40


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure steps of a fixed size; the plot goes to `folder`."""
    lines = step_costs(lambda n: scenes.chain(n, STEP * STEPS), LINKS, "links", say)
    plot_scaling(folder / f"{name}.png", lines, "links", "microseconds a step")
    rows = [
        [str(links), *(f"{points[k][1]:.0f}" for points in lines.values())]
        for k, links in enumerate(LINKS)
    ]
    fits = [f"{exponent(points, *FITTED):.3f}" for points in lines.values()]
    rows.append([f"exponent, {FITTED[0]} to {FITTED[1]}", *fits])
    return Report(
        title="A chain of N flexible links, four modes each",
        tables=[Table("Microseconds a step of 1 ms:", ["N", *lines], rows, True)],
        plot=f"{name}.png",
        machine=describe_machine(),
    )
