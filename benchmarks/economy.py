"""Shape functions and time of the search for a wanted accuracy, against an oracle.

The oracle knows the true error: it removes the shape function with the smallest
resulting error, one by one, as long as the request of 1e-3 is kept. The best run is the
fastest one of its model among integrators at their loosest tolerances. All seconds are
those of the processor. Where the best run is long there is no oracle, which would run
for an hour.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from sidtool.accuracy.plan import make_accuracy_plan
from sidtool.accuracy.reference_run import Reference, make_reference
from sidtool.accuracy.selection import fastest_setting
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.measurement.candidates import (
    Choice,
    finest_model,
    scene_of_model,
    shape_function_candidates,
    with_recorded_outputs,
)
from sidtool.measurement.request import requested
from sidtool.measurement.runs import Runs, Setting
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.body_data import read_sids
from sidtool.solver.system.system import System
from tests.metamorphic.generator.case import Case, scene_of
from tests.metamorphic.generator.scenes import random_scene
from tests.sidtool.accuracy.hand_written import drive, yoke

from .machine import describe_machine
from .report import Report, Table

WANTED = 1e-3
CRANK = Path(__file__).parents[1] / "examples" / "slider_crank"
#: Requested outputs of the slider-crank example, one at a time.
OUTPUTS = ("piston.x", "rod.q1", "piston_pin.fx")
#: Random scenes, each with a requested marker position of a flexible body.
SEEDS = (2006, 2013, 2036, 2050, 2052, 2077, 2107, 2114)
HEADER = ["scene", "output", "all", "oracle", "chosen", "search s", "best run s"]
#: Scenes whose best run takes over a second: an output, and how long they go on [s].
LONG = {
    "founding": ("rod.q1", 1200.0),
    "scotch yoke": ("slot.fx", 280.0),
    "drive": ("bearing.fz", 25.0),
}
MADE = {"scotch yoke": yoke, "drive": drive}
HEADER_LONG = ["scene", "output", "runs", "search s", "finest run s", "chosen run s"]
HEADER_LONG += ["search / chosen"]


def oracle(runs: Runs, reference: Reference) -> Choice:
    """The model that greedy removal with the true errors comes to."""

    def use(choice: Choice) -> float:
        errors = runs.difference(reference.choice, choice, reference.setting)
        return reference.used_share(errors)

    choice = reference.choice
    while candidates := shape_function_candidates(choice):
        less = min((choice.without(c) for c in candidates), key=use)
        if use(less) > 1.0:
            break
        choice = less
    return choice


def row(
    name: str,
    scene: SceneFile,
    sids: Mapping[str, SID],
    output: str,
    compile_: Callable[[SceneFile, Mapping[str, SID]], System],
) -> list[str]:
    """All, the oracle's and the chosen shape functions; seconds."""
    scene = with_recorded_outputs(scene, (output,))
    began = time.process_time()
    plan = make_accuracy_plan(scene, sids, WANTED, compile_, keep=False)
    took = time.process_time() - began
    request = requested(scene, sids, WANTED)
    runs = Runs(scene, sids, compile_, request.names)
    reference = make_reference(runs, finest_model(scene, sids), request)
    best = oracle(runs, reference)
    found = fastest_setting(runs, reference, best, 1.0)
    chosen = sum(
        len(body.numbers(sids[n].nq)) for n, body in plan.scene.sid_bodies.items()
    )
    counts = [sum(len(k) for _, k in c.kept) for c in (reference.choice, best)]
    return [
        name,
        output,
        *map(str, counts),
        str(chosen),
        f"{took:.2f}",
        f"{_seconds(runs, best, found.setting):.4f}" if found else "",
    ]


def _seconds(runs: Runs, choice: Choice, setting: Setting) -> float:
    """Processor seconds of one run more of a model, the least of three."""
    content = scene_of_model(runs.scene, choice, runs.sids)
    system = runs.compile(content, runs.sids)
    return min(_run_seconds(system, setting) for _ in range(3))


def _run_seconds(system: System, setting: Setting) -> float:
    began = time.process_time()
    simulate(system, integrator=setting.integrator, rtol=setting.rtol)
    return time.process_time() - began


def long_row(
    name: str,
    scene: SceneFile,
    sids: Mapping[str, SID],
    compile_: Callable[[SceneFile, Mapping[str, SID]], System],
) -> list[str]:
    """The search, with the run that it delivers, beside the finest run of the chosen
    tolerance, and the chosen one."""
    output, end = LONG[name]
    more = {"end": end, "output_step": end / 2000}
    time_ = scene.time.model_copy(update=more)
    scene = with_recorded_outputs(scene.model_copy(update={"time": time_}), (output,))
    began = time.process_time()
    plan = make_accuracy_plan(scene, sids, WANTED, compile_, keep=False)
    took = time.process_time() - began
    accuracy = plan.scene.accuracy
    setting = Setting(accuracy.integrator, accuracy.rtol)
    whole = scene_of_model(scene, finest_model(scene, sids), sids)
    systems = compile_(plan.scene, plan.sids), compile_(whole, sids)
    chosen, fine = (
        min(_run_seconds(system, setting) for _ in range(3)) for system in systems
    )
    ratio = f"{took / chosen:.1f}"
    numbers = [f"{took:.1f}", f"{fine:.2f}", f"{chosen:.2f}", ratio]
    return [name, output, str(plan.report.runs), *numbers]


def _random(seed: int, say: Callable[[str], object]) -> list[str] | None:
    case: Case = random_scene(seed)
    scene = scene_of(case)

    def compiled(content: SceneFile, sids: Mapping[str, SID]) -> System:
        return compile_scene(content, ".", sids, drives=case.drives, forces=case.forces)

    name = next(n for n in scene.sid_bodies if n in case.sids)
    marker = case.sids[name].nodes[-1].id
    try:
        return row(f"seed {seed}", scene, case.sids, f"{name}.{marker}.x", compiled)
    except InputError as refused:
        say(f"  seed {seed}: {refused.problem}")
        return None


def _here(content: SceneFile, sids: Mapping[str, SID]) -> System:
    return compile_scene(content, ".", sids)


def run(folder: Path, name: str, say: Callable[[str], object]) -> Report:
    crank = read_scene(CRANK / "slider_crank.toml")
    rods = read_sids(crank, CRANK, {})

    def compiled(content: SceneFile, sids: Mapping[str, SID]) -> System:
        return compile_scene(content, CRANK, sids)

    rows = []
    for output in OUTPUTS:
        rows.append(row("founding", crank, rods, output, compiled))
        say("  " + " ".join(rows[-1]))
    for seed in SEEDS:
        found = _random(seed, say)
        if found is not None:
            rows.append(found)
            say("  " + " ".join(rows[-1]))
    long = []
    for name_ in LONG:
        if name_ in MADE:
            scene, sids = MADE[name_](False)
            long.append(long_row(name_, scene, sids, _here))
        else:
            long.append(long_row(name_, crank, rods, compiled))
        say("  " + " ".join(long[-1]))
    ratios = [int(r[4]) / max(int(r[3]), 1) for r in rows if int(r[3])]
    worst = max(ratios, default=1.0)
    return Report(
        title="Shape functions and time of the search, against an oracle",
        tables=[
            Table(f"wanted {WANTED:g}, seconds of the processor", HEADER, rows),
            Table("long runs, seconds of the processor", HEADER_LONG, long),
        ],
        remarks=[f"Chosen shape functions are at most {worst:.2f} of the oracle's."],
        machine=describe_machine(),
    )
