"""R2: the slider-crank of the IVP test set, with the matrices of its source."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from formats.scene import SceneFile
from solver import compile_scene
from solver.scene import System
from tests.references import test_simeon as source

from .machine import describe_machine
from .precision import (
    at_equal_error,
    ode_runs,
    own_runs,
    plot_runs,
    remark_on_callers,
    runs_table,
    settled,
    truth_of,
)
from .report import Report

WANTED = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
PEERS = ("scipy Radau", "scipy BDF", "IDA (scikit-sundae)")


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure all programs; the plot goes to `folder`."""
    system = simeon()
    truth, uncertainty = truth_of(system)
    last = {key: abs(truth[key][-1] - source.END[key]) for key in truth}
    runs = own_runs(system, truth, say) + ode_runs(system, truth, say)
    runs = settled(runs, WANTED)
    plot_runs(folder / f"{name}.png", runs, "max |dq1| / max |q1|")
    return Report(
        title="Slider-crank of the IVP test set (Simeon), 0.1 s",
        tables=[
            at_equal_error(
                runs,
                WANTED,
                PEERS,
                "Seconds to reach an error of q1 (max |dq1| / max |q1|), and how many "
                "times as long the others take with their best setting:",
            ),
            runs_table(runs, truth, "All runs that no faster one of the method beats:"),
        ],
        remarks=[
            f"The reference is good to {uncertainty:.0e} and ends "
            + " and ".join(
                f"{off:.0e} from the published {k}" for k, off in last.items()
            )
            + ". "
            + remark_on_callers(system)
        ],
        plot=f"{name}.png",
        machine=describe_machine(),
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
