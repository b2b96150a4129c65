"""A02 of the IFToMM library: two four-bar linkages through singular positions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from . import scenes
from .machine import describe_machine
from .precision import at_equal_error, own_runs, own_settings, plot_runs, runs_table
from .report import Report

#: Exact at 10 s: top of the left post [m].
EXACT = {"post0.b.x": 0.3284581115408154, "post0.b.y": 0.944518538178601}
WANTED = (1e-2, 1e-4, 1e-6, 1e-8)
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure sidtool's integrators; the plot goes to `folder`."""
    system = scenes.four_bars()
    truth = one_degree_of_freedom(system.scene.time.end, 100)
    runs = own_runs(system, truth, say, own_settings(rtols=RTOLS))
    plot_runs(folder / f"{name}.png", runs, "max |dx| / 1 m")
    off = {key: abs(truth[key][-1] - value) for key, value in EXACT.items()}
    return Report(
        title="Four-bar linkages (A02), N = 2, 10 s",
        tables=[
            at_equal_error(runs, WANTED, (), "Seconds to reach an error in x [m]:"),
            runs_table(runs, truth, "All runs that no faster one of the method beats:"),
        ],
        remarks=[
            "Errors are over all output times, against the motion in one coordinate, "
            "which ends "
            + " and ".join(f"{o:.0e} m from the exact {k}" for k, o in off.items())
            + ". Settings that are not listed stopped early or are beaten. A published "
            "peer (generalised-alpha, C++, another machine): 4.6e-3 in 0.047 s, 4.6e-5 "
            "in 0.376 s, 2.8e-6 in 1.35 s."
        ],
        plot=f"{name}.png",
        machine=describe_machine(),
    )


def one_degree_of_freedom(end: float, count: int) -> dict[str, np.ndarray]:
    """The posts turn alike: (N+1) / 3 + N times m L^2 against gravity, N = 2."""
    from scipy.integrate import solve_ivp

    loops = 2
    inertia = (loops + 1) / 3.0 + loops
    moment = scenes.GRAVITY * ((loops + 1) / 2.0 + loops)

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], moment / inertia * np.sin(y[0])]

    times = np.linspace(0.0, end, count + 1)
    found = solve_ivp(
        slope, (0.0, end), [0.0, 1.0], "DOP853", times, rtol=1e-13, atol=1e-13
    )
    return {"post0.b.x": np.sin(found.y[0]), "post0.b.y": np.cos(found.y[0])}
