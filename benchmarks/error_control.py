"""Requested error and measured error: published problems, and known motions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sidtool.solver import simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.errors import SimulationError
from tests.references import motions
from tests.references.error_control import CASES, compiled, relative_error
from tests.references.motion_cases import CASES as MOTIONS
from tests.references.motions import Case

from .machine import describe_machine
from .report import Report, Table

#: For known motions. Those of order 2 would take hours for tolerances from the second
#: number on, and on known motions below the third.
KNOWN, LEAST, FINE = (1e-3, 1e-4, 1e-6, 1e-8), 1e-7, 1e-5
TOLERANCES = tuple(10.0**-k for k in range(3, 11))


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Run all integrators with all tolerances."""
    header = ["tolerance", *INTEGRATORS]
    tables = []
    stops: list[str] = []
    for case in CASES:
        rows = []
        for rtol in TOLERANCES:
            cells = [
                _ratio(case, name, rtol, stops)
                if method.order > 2 or rtol > LEAST
                else ""
                for name, method in INTEGRATORS.items()
            ]
            rows.append([f"{rtol:.0e}", *cells])
            say(f"  {case}, {rtol:.0e}: {', '.join(cells)}")
        tables.append(Table(f"{case}: error divided by the tolerance", header, rows))
    tables += [_motions(rtol, say, stops) for rtol in KNOWN]
    return Report(
        title="Requested error and measured error",
        tables=tables,
        remarks=[
            "Errors of elastic coordinates are relative to the largest of them, of "
            "places to the size of the mechanism, of angles to a radian; of known "
            "motions, relative to the largest motion of their kind. *n*: the result "
            "notes that rounding hides such errors. *-*: the run stopped and told why:",
            *stops,
        ],
        machine=describe_machine(),
    )


def _motions(rtol: float, say: Callable[[str], None], stops: list[str]) -> Table:
    """Motions that are known beside the solver, at one tolerance."""
    methods = [n for n, found in INTEGRATORS.items() if rtol > FINE or found.order > 2]
    rows = []
    for name, case in MOTIONS.items():
        cells = [_known(name, case, method, rtol, stops) for method in methods]
        rows.append([name, *cells])
        say(f"  {name}, {rtol:.0e}: {', '.join(cells)}")
    caption = f"Known motions at {rtol:.0e}: error divided by the tolerance"
    return Table(caption, ["motion", *methods], rows)


def _known(
    name: str, case: Case, integrator: str, rtol: float, stops: list[str]
) -> str:
    try:
        result = simulate(case.make(), integrator=integrator, rtol=rtol)
    except SimulationError as stop:
        stops.append(f"{name}, {integrator}, {rtol:.0e}: {stop}")
        return "-"
    noted = any("rounding hides" in note for note in result.notes)
    error = motions.relative_error(case, result) / rtol
    return f"{error:.2g}{' n' if noted else ''}"


def _ratio(case: str, integrator: str, rtol: float, stops: list[str]) -> str:
    try:
        result = simulate(compiled(case), integrator=integrator, rtol=rtol)
    except SimulationError as stop:
        stops.append(f"{case}, {integrator}, {rtol:.0e}: {stop}")
        return "-"
    return f"{relative_error(case, result) / rtol:.2g}"
