"""10 000 revolutions of the founding slider-crank: drift and energy.

Driven at full speed and damped, every revolution is the same once the start has died
out: what differs is what the integration loses or gains. Left to itself, undamped and
with exact inertia, the mechanism keeps its energy, and what it loses is numerical; the
rod rings with all its modes, whose periods the steps resolve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Taylor
from sidtool.formats.result import Result
from sidtool.solver.system.system import System
from sidtool.study import Setting, timed_run

from . import scenes
from .machine import describe_machine
from .report import Report, Table

REVOLUTIONS, FREE, PER_TURN = 10_000, 1_000, 8
SPEED = 12.0 * math.pi
TURN = 2.0 * math.pi / SPEED
#: Revolutions after which the start has died out.
SETTLED = 100
DRIVEN = (
    Setting("radau5", 1e-5),
    Setting("radau9", 1e-5),
    Setting("radau9", 1e-7),
)
UNDAMPED = (Setting("radau9", 1e-5),)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Both mechanisms with each setting."""
    tables = []
    for title, header, system, measure, settings in (
        (
            f"Driven, {REVOLUTIONS} revolutions",
            ["x", "q1"],
            driven(),
            repetition,
            DRIVEN,
        ),
        (f"Free, {FREE} revolutions", ["energy lost"], free(), energy_lost, UNDAMPED),
    ):
        rows = []
        for setting in settings:
            result, seconds = timed_run(system, setting, repeats=1)
            cells = [setting.integrator, setting.value, f"{seconds:.0f}"]
            cells += [str(result.counters["steps"])]
            cells += [f"{value:.1e}" for value in result.drift.values()]
            cells += [f"{value:.1e}" for value in measure(result)]
            say(f"  {title}: {', '.join(cells)}")
            rows.append(cells)
        common = ["integrator", "tolerance", "seconds", "steps", "|c|", "|dc/dt|"]
        tables.append(Table(f"{title}:", [*common, *header], rows))
    return Report(
        title="Thousands of revolutions of the flexible slider-crank",
        tables=tables,
        remarks=[
            "|c| and |dc/dt| are the largest residuals of the constraints [m, m/s]. x "
            "and q1: the largest difference between revolutions after the first "
            f"{SETTLED}, relative to the largest value. Energy lost: the greatest "
            "change of the energy, relative to it."
        ],
        machine=describe_machine(),
    )


def _table(revolutions: int, **changes: Any) -> dict[str, Any]:
    table = scenes.founding(**changes)
    table["time"] = {"end": revolutions * TURN, "output_step": TURN / PER_TURN}
    return table


def driven() -> System:
    """The crank at full speed from the start."""
    table = _table(REVOLUTIONS, outputs={"record": ["piston.x", "rod.q1"]})
    pieces = [{"from": 0.0, "coefficients": [0.0, SPEED]}]
    table["drives"]["crank_angle"]["function"]["pieces"] = pieces
    return scenes.compiled(table, rod=scenes.rod())


def free() -> System:
    """No drive and no damping; the crank starts at full speed."""
    table = _table(FREE, outputs={"record": ["energy.kinetic", "energy.elastic"]})
    table["drives"] = {}
    table["bodies"]["crank"]["initial"] = {"angular_velocity": SPEED}
    table["bodies"]["rod"]["quadratic_inertia"] = True
    rod = scenes.rod()
    undamped = replace(rod, De=Taylor(np.zeros_like(rod.De.m0)))
    return scenes.compiled(table, rod=undamped)


def repetition(result: Result) -> list[float]:
    found = []
    for name in result.names:
        turns = result[name][:-1].reshape(REVOLUTIONS, PER_TURN)[SETTLED:]
        found.append(float(np.ptp(turns, axis=0).max() / np.abs(turns).max()))
    return found


def energy_lost(result: Result) -> list[float]:
    energy = result["energy.kinetic"] + result["energy.elastic"]
    return [float(np.ptp(energy) / energy[0])]
