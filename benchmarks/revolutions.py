"""10 000 revolutions of the founding slider-crank: drift and energy.

Driven at full speed and damped, every revolution is the same once the start has died
out: what differs is what the integration loses or gains. Left to itself, undamped and
with exact inertia, the mechanism keeps its energy, and what it loses is numerical.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from formats.result import Result
from formats.sid import Taylor
from sidtool.study import Setting, timed
from solver.scene import System

from . import scenes
from .machine import describe_machine
from .report import Report, Table

REVOLUTIONS, PER_TURN = 10_000, 8
SPEED = 12.0 * math.pi
TURN = 2.0 * math.pi / SPEED
#: Revolutions after which the start has died out.
SETTLED = 100
SETTINGS = (
    Setting("radau5", 1e-5),
    Setting("radau9", 1e-5),
    Setting("radau9", 1e-7),
)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Both mechanisms with each setting."""
    tables = []
    for title, header, system, measure in (
        ("Driven and damped", ["x", "q1"], driven(), repetition),
        ("Free and undamped", ["energy lost"], free(), energy_lost),
    ):
        rows = []
        for setting in SETTINGS:
            result, seconds = timed(system, setting, repeats=1)
            cells = [setting.integrator, setting.value, f"{seconds:.0f}"]
            cells += [str(result.counters["steps"])]
            cells += [f"{value:.1e}" for value in result.drift.values()]
            cells += [f"{value:.1e}" for value in measure(result)]
            say(f"  {title}: {', '.join(cells)}")
            rows.append(cells)
        common = ["integrator", "tolerance", "seconds", "steps", "|c|", "|dc/dt|"]
        tables.append(Table(f"{title}:", [*common, *header], rows))
    return Report(
        title=f"{REVOLUTIONS} revolutions of the flexible slider-crank",
        tables=tables,
        remarks=[
            "|c| and |dc/dt| are the largest residuals of the constraints [m, m/s]. x "
            "and q1: the largest difference between revolutions after the first "
            f"{SETTLED}, relative to the largest value. Energy lost: the greatest "
            "change of the energy, relative to it."
        ],
        machine=describe_machine(),
    )


def _table(**changes: Any) -> dict[str, Any]:
    table = scenes.founding(**changes)
    end = REVOLUTIONS * TURN
    table["time"] = {"end": end, "output_step": TURN / PER_TURN}
    return table


def driven() -> System:
    """The crank at full speed from the start."""
    table = _table(outputs={"record": ["piston.x", "rod.q1"]})
    pieces = [{"from": 0.0, "coefficients": [0.0, SPEED]}]
    table["drives"]["crank_angle"]["function"]["pieces"] = pieces
    return scenes.compiled(table, rod=scenes.rod())


def free() -> System:
    """No drive and no damping; the crank starts at full speed."""
    table = _table(outputs={"record": ["energy.kinetic", "energy.elastic"]})
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
