"""Runs of compiled scenes: outputs over time and computing time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.diagnostics import Diagnostic, each_once

from .rounding_levels import rounding_levels
from .variants import Setting

if TYPE_CHECKING:
    from sidtool.formats.result import Result
    from sidtool.solver.system.system import System

#: Runs are repeated up to this total time [s], or this number of times.
MIN_TOTAL_SECONDS, MAX_REPEATS = 0.3, 5
#: An integrator that takes longer than this [s], and this factor longer than another
#: one with no larger error, is not tried with tighter tolerances.
LONG_RUN_SECONDS, HOPELESS_RATIO = 1.0, 20.0


@dataclass(frozen=True, eq=False)
class RunRecord:
    """Outputs and cost of a run.

    Attributes
    ----------
    names : outputs that the model has
    values : (nt, n) their values at output times
    rounding : (n,) effect of rounding on each, see `rounding_levels`, only for runs
        that are done once
    seconds : least solve time of several runs
    message : reason why there is no run; everything else is empty then
    diagnostics : of the result, or why it failed
    times : (nt,) output times [s]
    """

    names: tuple[str, ...]
    values: np.ndarray
    rounding: tuple[float, ...] = ()
    seconds: float = np.inf
    steps: int = 0
    message: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()
    times: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Return outputs (nt, n); zero for outputs that the model does not have."""
        zero, rows = (
            np.zeros(len(self.values)),
            {n: i for i, n in enumerate(self.names)},
        )
        known = [self.values[:, rows[n]] if n in rows else zero for n in names]
        return np.column_stack(known)

    def rounding_of(self, names: Sequence[str]) -> np.ndarray:
        """Return the effect of rounding on outputs (n,); zero if it is not known."""
        known = dict(zip(self.names, self.rounding, strict=False))
        return np.array([known.get(name, 0.0) for name in names])


def failed_run(message: str, diagnostics: Iterable[Diagnostic] = ()) -> RunRecord:
    """Return the record of a run that failed."""
    found = each_once(diagnostics)
    return RunRecord((), np.zeros((0, 0)), message=message, diagnostics=found)


def record_run(
    result: Result,
    seconds: float | None = None,
    system: System | None = None,
) -> RunRecord:
    """Return the record of a result.

    Parameters
    ----------
    system : compiled scene of a reference run, to compute the effect of rounding
    """
    levels = () if system is None else rounding_levels(result, system, result.names)
    return RunRecord(
        result.names,
        np.asarray(result.values),
        tuple(map(float, levels)),
        float(result.counters["seconds"]) if seconds is None else seconds,
        int(result.counters["steps"]),
        diagnostics=result.diagnostics,
        times=np.asarray(result.t),
    )


def timed_run(
    system: System, setting: Setting, repeats: int = MAX_REPEATS
) -> tuple[Result, float]:
    """Return a run and its least solve time out of several [s].

    Raises
    ------
    SimulationError : the run stopped early.
    """
    from sidtool.solver import simulate

    seconds: list[float] = []
    while len(seconds) < repeats and sum(seconds) < MIN_TOTAL_SECONDS:
        result = simulate(
            system,
            integrator=setting.integrator,
            rtol=setting.rtol,
            step=setting.step,
        )
        seconds.append(float(result.counters["seconds"]))
    return result, min(seconds)


def is_hopeless(
    seconds: float, error: float, others: Iterable[tuple[float, float]]
) -> bool:
    """Return whether a run is much slower than another one with no larger error.

    others : seconds and errors of other runs
    """
    return LONG_RUN_SECONDS < seconds < np.inf and any(
        HOPELESS_RATIO * time < seconds and other <= error for time, other in others
    )
