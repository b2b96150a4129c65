"""Error asked for against error found, on three published problems."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from solver import simulate
from solver.errors import SimulationError
from solver.integrators import INTEGRATORS
from tests.references.error_control import CASES, compiled, relative_error

from .machine import describe_machine
from .report import Report, Table

TOLERANCES = tuple(10.0**-k for k in range(3, 11))


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Run all integrators with all tolerances."""
    header = ["tolerance", *INTEGRATORS]
    tables = []
    stops: list[str] = []
    for case in CASES:
        rows = []
        for rtol in TOLERANCES:
            cells = [_ratio(case, method, rtol, stops) for method in INTEGRATORS]
            rows.append([f"{rtol:.0e}", *cells])
            say(f"  {case}, {rtol:.0e}: {', '.join(cells)}")
        tables.append(Table(f"{case}: error divided by the tolerance", header, rows))
    return Report(
        title="Error asked for and error found",
        tables=tables,
        remarks=[
            "Errors of elastic coordinates are relative to the largest of them, of "
            "places to the size of the mechanism, of angles to a radian. *-*: the run "
            "stopped and told why:",
            *stops,
        ],
        machine=describe_machine(),
    )


def _ratio(case: str, integrator: str, rtol: float, stops: list[str]) -> str:
    try:
        result = simulate(compiled(case), integrator=integrator, rtol=rtol)
    except SimulationError as stop:
        stops.append(f"{case}, {integrator}, {rtol:.0e}: {stop}")
        return "-"
    return f"{relative_error(case, result) / rtol:.2g}"
