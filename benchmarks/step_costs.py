"""Cost of a step of fixed size against the size of a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sidtool.solver.system.system import System
from sidtool.study import Setting, timed_run

STEP = 1e-3
INTEGRATORS = ("radau5", "trapezoidal", "generalised_alpha")

#: (size, microseconds a step) of each integrator
Lines = dict[str, list[tuple[float, float]]]


def step_costs(
    systems: Callable[[int], System],
    sizes: Sequence[int],
    unit: str,
    say: Callable[[str], None],
) -> Lines:
    """Measure the integrators on the system of each size; `unit` is what is counted."""
    lines: Lines = {integrator: [] for integrator in INTEGRATORS}
    for size in sizes:
        system = systems(size)
        for integrator in INTEGRATORS:
            setting = Setting(integrator, step=STEP, rtol=1e-6)
            result, seconds = timed_run(system, setting, repeats=3)
            cost = 1e6 * seconds / result.counters["steps"]
            lines[integrator].append((size, cost))
            say(f"  {integrator} {size} {unit}: {cost:.0f} us a step")
    return lines
