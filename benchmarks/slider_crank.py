"""The founding slider-crank: error of q1 and of the piston beside time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from sidtool.formats.base.sid import Array

from . import scenes
from .against_peers import ODE_SOLVERS, report_on
from .precision import Run, errors_of, line, ode_runs, own_runs, own_settings, truth_of
from .report import Report

FIXED_STEPS = (1e-2, 5e-3, 2e-3, 1e-3)
#: Exudyn's steps [s], tolerances of its Newton iteration, and how often it is run.
EXUDYN = (
    (1e-2, (1e-3, 1e-5, 1e-8), 5),
    (5e-3, (1e-3, 1e-5, 1e-8), 5),
    (2e-3, (1e-3, 1e-5, 1e-8), 3),
    (1e-3, (1e-3, 1e-5, 1e-8), 3),
    (5e-4, (1e-4, 1e-8), 2),
    (2e-4, (1e-4, 1e-8), 2),
    (1e-4, (1e-5, 1e-8), 1),
    (5e-5, (1e-5, 1e-8), 1),
    (2e-5, (1e-6,), 1),
)
EXUDYN_NAME = "Exudyn generalised-alpha"


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure all programs; the plot goes to `folder`."""
    system = scenes.slider_crank()
    truth, uncertainty = truth_of(system)
    truth = {key: truth[key] for key in ("rod.q1", "piston.x")}
    runs = own_runs(system, truth, say, own_settings(FIXED_STEPS))
    runs += ode_runs(system, truth, say) + _exudyn_runs(say)
    return report_on(
        system,
        "Founding slider-crank, 3 s, five modes",
        runs,
        truth,
        (EXUDYN_NAME, *ODE_SOLVERS),
        f"The reference is good to {uncertainty:.0e}. Exudyn keeps the moments of "
        "inertia quadratic in q and is compared with a reference that does, too.",
        folder / f"{name}.png",
    )


def _exudyn_runs(say: Callable[[str], None]) -> list[Run]:
    from .peers.exudyn_slider_crank import run as solve

    system = scenes.slider_crank(quadratic_inertia=True)
    truth, _ = truth_of(system)
    truth = {key: truth[key] for key in ("rod.q1", "piston.x")}
    runs = []
    for step, tolerances, repeats in EXUDYN:
        for tolerance in tolerances:
            try:
                runs.append(_exudyn_run(solve, step, tolerance, repeats, truth))
            except ImportError:
                say("Exudyn is not installed: left out")
                return runs
            say(line(runs[-1]))
    return runs


def _exudyn_run(
    solve: Callable[..., tuple[Array, Array, float]],
    step: float,
    tolerance: float,
    repeats: int,
    truth: Mapping[str, Array],
) -> Run:
    def again() -> float:
        return solve(scenes.rod(), step, 3.0, 0.01, tolerance)[2]

    q1, x, seconds = solve(scenes.rod(), step, 3.0, 0.01, tolerance)
    least = min([seconds, *(again() for _ in range(repeats - 1))])
    errors = errors_of({"rod.q1": q1, "piston.x": x}, truth)
    setting = f"{step:g} s, {tolerance:.0e}"
    return Run(EXUDYN_NAME, setting, errors, least, again)
