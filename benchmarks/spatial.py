"""The founding slider-crank in space against the same in the plane."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sidtool.study import Setting, timed_run

from . import scenes
from .machine import describe_machine
from .plots import plot_scaling
from .precision import errors_of, truth_of
from .report import Report, Table

RTOLS = (1e-3, 1e-4, 1e-6, 1e-8)
REPEATS = 5


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure both by turns; the plot goes to `folder`."""
    from sidtool.solver.integrators.registry import INTEGRATORS
    from sidtool.solver.system.errors import SimulationError

    plane, space = scenes.slider_crank(), scenes.spatial_slider_crank()
    truth, _ = truth_of(plane)
    rows = []
    lines: dict[str, list[tuple[float, float]]] = {}
    for integrator in INTEGRATORS:
        for rtol in RTOLS:
            setting = Setting(integrator, rtol=rtol)
            try:
                flat, full, errors, steps = _both(plane, space, setting, truth)
            except SimulationError as stopped:
                say(f"  {integrator} {rtol:.0e}: {stopped}")
                continue
            say(f"  {integrator} {rtol:.0e}: {full / flat:.2f}")
            rows.append(
                [integrator, f"{rtol:.0e}", f"{flat:.4f}", f"{full:.4f}"]
                + [f"{full / flat:.2f}", *steps, *(f"{e:.1e}" for e in errors)]
            )
            lines.setdefault(integrator, []).append((rtol, full / flat))
    plot_scaling(folder / f"{name}.png", lines, "tolerance", "time in space / in plane")
    header = ["integrator", "tolerance", "planar s", "spatial s", "ratio"]
    header += ["planar steps", "spatial steps", "planar error q1", "spatial error q1"]
    return Report(
        title="The slider-crank in space",
        tables=[Table("Time in space over time in the plane:", header, rows, True)],
        plot=f"{name}.png",
        machine=describe_machine(),
    )


def _both(
    plane: object, space: object, setting: Setting, truth: dict[str, np.ndarray]
) -> tuple[float, float, list[float], list[str]]:
    """Least times of runs by turns, errors of q1, steps."""
    seconds, errors, steps = [], [], []
    for system in (plane, space):
        result, _ = timed_run(system, setting, repeats=1)  # type: ignore[arg-type]
        values = {key: result[key] for key in result.names}
        errors.append(errors_of(values, {"rod.q1": truth["rod.q1"]})[0])
        steps.append(str(result.counters["steps"]))
    for _ in range(REPEATS):
        for system in (plane, space):
            seconds.append(timed_run(system, setting, repeats=1)[1])  # type: ignore[arg-type]
    return min(seconds[::2]), min(seconds[1::2]), errors, steps
