"""R2: the slider-crank of the IVP test set, with the matrices of its source."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.system.system import System
from tests.references import test_simeon as source

from .against_peers import ODE_SOLVERS, report_on
from .precision import ode_runs, own_runs, own_settings, truth_of
from .report import Report


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure all programs; the plot goes to `folder`."""
    system = simeon()
    truth, uncertainty = truth_of(system)
    last = {key: abs(truth[key][-1] - source.END[key]) for key in truth}
    ends = " and ".join(f"{off:.0e} from the published {k}" for k, off in last.items())
    return report_on(
        system,
        "Slider-crank of the IVP test set (Simeon), 0.1 s",
        own_runs(system, truth, say, own_settings()) + ode_runs(system, truth, say),
        truth,
        ODE_SOLVERS,
        f"The reference is good to {uncertainty:.0e} and ends {ends}.",
        folder / f"{name}.png",
    )


def simeon() -> System:
    """The scene with q1 and the piston recorded over its whole time."""
    table = source.scene(True).model_dump(mode="json", by_alias=True, exclude_none=True)
    table["time"] = {"end": 0.1, "output_times": list(np.linspace(0.001, 0.1, 100))}
    table["outputs"] = {"record": ["rod.q1", "piston.x"]}
    return compile_scene(
        SceneFile.model_validate(table),
        ".",
        {"rod": source.connecting_rod()},
        accept_defects=True,
    )
