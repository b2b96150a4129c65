"""A report of sidtool beside its peers on one slider-crank: errors of q1."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from sidtool.formats.base.sid import Array
from sidtool.solver.system.system import System

from .machine import describe_machine
from .precision import (
    Run,
    at_equal_error,
    plot_runs,
    remark_on_callers,
    runs_table,
    settled,
)
from .report import Report

WANTED = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
#: Programs that `precision.ode_runs` measures.
ODE_SOLVERS = ("scipy Radau", "scipy BDF", "IDA (scikit-sundae)")
CAPTION = (
    "Seconds to reach an error of q1 (max |dq1| / max |q1|), and how many times as "
    "long the others take with their best setting:"
)


def report_on(
    system: System,
    title: str,
    runs: Iterable[Run],
    truth: Mapping[str, Array],
    peers: Sequence[str],
    remark: str,
    plot: Path,
) -> Report:
    """What decides ratios is timed again.

    truth : reference values of the compared outputs, q1 first
    """
    runs = settled(list(runs), WANTED)
    plot_runs(plot, runs, "max |dq1| / max |q1|")
    return Report(
        title=title,
        tables=[
            at_equal_error(runs, WANTED, peers, CAPTION),
            runs_table(runs, truth, "All runs that no faster one of the method beats:"),
        ],
        remarks=[f"{remark} {remark_on_callers(system)}"],
        plot=plot.name,
        machine=describe_machine(),
    )
