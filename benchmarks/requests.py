"""Requests of single outputs from 1e-1 to 1e-6: selected models and their cost.

The founding slider-crank, and an arm in space that swings about an axis askew to its
own and to its weight. Errors are those against a run that the search has never seen:
everything that the SIDs have, radau13 at 1e-12.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from sidtool.accuracy.plan import make_accuracy_plan
from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.measurement.candidates import (
    finest_model,
    scene_of_model,
    with_recorded_outputs,
)
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.body_data import read_sids
from sidtool.solver.system.system import System
from tests.sidtool.accuracy.arms import swinging
from tests.sidtool.beams import beam

from .machine import describe_machine
from .report import Report, Table

EXAMPLES = Path(__file__).parents[1] / "examples"
#: Outputs of the founding scene: a position, an elastic coordinate, a bearing force.
CRANK = ("piston.x", "rod.q1", "piston_pin.fx")
#: Of the arm, and a stress.
ARM = ("arm.tip.x", "arm.q1", "pin.fx", "arm.root.sigma_xy")
REQUESTS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
METHOD, TIGHT = "radau13", 1e-12
HEADER = ["wanted", "estimate", "error", "kept", "integrator", "rtol", "steps", "s"]


def arm_sid() -> SID:
    """Three bending modes of a uniform arm, with stress."""
    return sid_from_model(
        beam(
            {"type": "iga", "degrees": [3, 2], "elements": [10, 1]},
            reduction={"method": "modal", "modes": 3},
            stress={},
        )
    )


def swinging_arm() -> SceneFile:
    """It falls from level, about an axis across the plane and along the arm."""
    axis = [0.3, 0.2, 1.0]
    pin = {"type": "revolute", "markers": ["ground", "arm.root"], "axis": axis}
    return swinging(
        3.0,
        title="Arm in space",
        dimension="spatial",
        gravity=[0.0, -0.2, 0.1],
        joints={"pin": pin},
        outputs={"record": list(ARM)},
    )


def compiled(folder: Path, scene: SceneFile, sids: Mapping[str, SID]) -> System:
    return compile_scene(scene, folder, sids)


def table_of(
    folder: Path,
    scene: SceneFile,
    sids: Mapping[str, SID],
    output: str,
    say: Callable[[str], object],
) -> Table:
    """All requests of one output."""
    compile_ = partial(compiled, folder)
    scene = with_recorded_outputs(scene, (output,))
    whole = scene_of_model(scene, finest_model(scene, sids), sids)
    exact = simulate(compile_(whole, sids), integrator=METHOD, rtol=TIGHT)
    rows = []
    for wanted in REQUESTS:
        plan = make_accuracy_plan(scene, sids, wanted, compile_, keep=False)
        result = simulate(compile_(plan.scene, plan.sids))
        line = plan.report.budget[-1]
        rows.append(
            [
                f"{wanted:.0e}",
                f"{plan.report.outputs[0].relative:.1e}",
                f"{_error(output, result, exact):.1e}",
                next(b.choice for b in plan.report.budget if "shape" in b.part),
                plan.scene.accuracy.integrator,
                f"{plan.scene.accuracy.rtol:.1e}",
                str(result.counters["steps"]),
                f"{line.seconds:.4f}",
            ]
        )
        say(f"  {output} {' '.join(rows[-1])}")
    return Table(f"{scene.title}, {output}", HEADER, rows)


def _error(output: str, found: Result, exact: Result) -> float:
    difference = np.abs(found[output] - exact[output]).max()
    return float(difference / np.ptp(exact[output]))


def run(folder: Path, name: str, say: Callable[[str], object]) -> Report:
    place = EXAMPLES / "slider_crank"
    crank = read_scene(place / "slider_crank.toml")
    rods = read_sids(crank, place, {})
    tables = [table_of(place, crank, rods, output, say) for output in CRANK]
    arm = swinging_arm()
    sids = {"arm": arm_sid()}
    tables += [table_of(place, arm, sids, output, say) for output in ARM]
    return Report(
        title="What an accuracy needs, from 1e-1 to 1e-6",
        tables=tables,
        machine=describe_machine(),
    )
