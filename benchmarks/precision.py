"""Error beside time for sidtool and its peers over one scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.solver import simulate
from sidtool.solver.system.system import System
from sidtool.study import (
    Setting,
    is_hopeless,
    make_reference,
    measure_setting,
    timed_run,
)

from .peers.equations import Equations, sizes
from .peers.ode import LONGEST, METHODS, solve
from .plots import plot_lines
from .report import Table

Say = Callable[[str], None]
RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
PEER_RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


@dataclass(frozen=True)
class Run:
    """One run of one program: (error of each output), seconds, and how it was made.

    `again` runs it once more and returns the seconds.
    """

    method: str
    setting: str
    errors: tuple[float, ...]
    seconds: float
    again: Callable[[], float]


def errors_of(
    values: Mapping[str, Array], truth: Mapping[str, Array]
) -> tuple[float, ...]:
    """Greatest error of every output, relative to its greatest value."""
    return tuple(
        float(np.abs(values[name] - right).max() / np.abs(right).max())
        for name, right in truth.items()
    )


def own_settings(
    steps: Iterable[float] = (), rtols: Sequence[float] = RTOLS
) -> list[Setting]:
    """All integrators with error control, coarse to fine, and with fixed steps."""
    from sidtool.solver.integrators.registry import INTEGRATORS

    fixed = [*steps]
    return [
        setting
        for name in INTEGRATORS
        for setting in (
            *(Setting(name, rtol=rtol) for rtol in rtols),
            *(Setting(name, step=step) for step in fixed),
        )
    ]


def own_runs(
    system: System,
    truth: Mapping[str, Array],
    say: Say,
    settings: Iterable[Setting],
) -> list[Run]:
    """Runs of sidtool; finer tolerances are left out of integrators far behind."""
    runs = list[Run]()
    ready, slow = set[str](), set[str]()
    for setting in settings:
        name = setting.integrator
        if name not in ready:
            measure_setting(system, setting, None, repeats=1)
            ready.add(name)
        if name in slow and setting.step is None:
            say(f"  {name} {setting.value} left out, far too slow")
            continue
        run = _own_run(system, truth, setting)
        if run is None:
            say(f"  {name} {setting.value} stopped early")
            continue
        others = ((r.seconds, max(r.errors)) for r in runs)
        if is_hopeless(run.seconds, max(run.errors), others):
            slow.add(name)
        runs.append(run)
        say(line(run))
    return runs


def _own_run(
    system: System, truth: Mapping[str, Array], setting: Setting
) -> Run | None:
    from sidtool.solver.system.errors import SimulationError

    try:
        result, seconds = timed_run(system, setting)
    except SimulationError:
        return None
    values = {name: result[name] for name in result.names}
    kind = "" if setting.step is None else ", fixed step"
    method = f"sidtool {setting.integrator}{kind}"
    return Run(
        method,
        setting.value,
        errors_of(values, truth),
        seconds,
        lambda: timed_run(system, setting, repeats=1)[1],
    )


def ode_runs(system: System, truth: Mapping[str, Array], say: Say) -> list[Run]:
    """scipy's solvers and IDA on the index-1 equations, as far as they are here."""
    equations = Equations(system)
    say(f"  a call of the equations from Python takes {1e6 * equations.cost():.0f} us")
    scale = sizes(simulate(system, integrator="radau5", rtol=1e-6))
    runs = []
    for method in METHODS:
        for rtol in PEER_RTOLS:
            began = time.perf_counter()
            try:
                values, seconds = solve(equations, method, rtol, scale)
            except ImportError:
                say(f"{method} is not installed: left out")
                break
            except (RuntimeError, ValueError) as error:
                say(f"{method} {rtol:.0e}: {error}")
                continue
            again = partial(_ode_seconds, equations, method, rtol, scale)
            errors = errors_of(values, truth)
            run = Run(method, f"{rtol:.0e}", errors, seconds, again)
            runs.append(run)
            say(line(run))
            if time.perf_counter() - began > LONGEST:
                break
    return runs


def _ode_seconds(equations: Equations, method: str, rtol: float, scale: Array) -> float:
    return solve(equations, method, rtol, scale)[1]


def settled(runs: Sequence[Run], errors: Iterable[float], rounds: int = 4) -> list[Run]:
    """The runs with those that decide the ratios timed again, by turns.

    A machine that others use changes its speed within minutes; what runs by turns
    meets the same load. The least time of each counts.
    """
    methods = dict.fromkeys(run.method for run in runs)
    chosen: dict[int, Run] = {}
    for error in errors:
        for group in ("sidtool", *methods):
            best = fastest((r for r in runs if r.method.startswith(group)), error)
            if best is not None and best.seconds < LONGEST:
                chosen[id(best)] = best
    least = {key: [run.seconds] for key, run in chosen.items()}
    for _ in range(rounds):
        for key, run in chosen.items():
            least[key].append(run.again())
    return [
        replace(run, seconds=min(least.get(id(run), [run.seconds]))) for run in runs
    ]


def truth_of(system: System) -> tuple[dict[str, Array], float]:
    """Outputs of the reference at tight tolerance, and how far it is to be trusted."""
    reference = make_reference(system)
    values = dict(zip(reference.names, reference.values.T, strict=True))
    return values, reference.uncertainty


def line(run: Run) -> str:
    """One run on one line."""
    errors = "  ".join(f"{error:.1e}" for error in run.errors)
    return f"  {run.method:32s} {run.setting:>10s}  {run.seconds:9.4f} s  {errors}"


def front(runs: Iterable[Run], which: int = 0) -> list[Run]:
    """The runs that no faster one beats in error, fastest first."""
    best: list[Run] = []
    for run in sorted(runs, key=lambda r: r.seconds):
        if not best or run.errors[which] < best[-1].errors[which]:
            best.append(run)
    return best


def fastest(runs: Iterable[Run], error: float, which: int = 0) -> Run | None:
    """The fastest run with at most this error."""
    good = [run for run in runs if run.errors[which] <= error]
    return min(good, key=lambda r: r.seconds, default=None)


def runs_table(runs: Sequence[Run], names: Iterable[str], caption: str) -> Table:
    """Per method the runs that are worth their time."""
    rows = []
    for method in dict.fromkeys(run.method for run in runs):
        for run in front(r for r in runs if r.method == method):
            errors = [f"{error:.1e}" for error in run.errors]
            rows.append([method, run.setting, f"{run.seconds:.4f}", *errors])
    header = ["method", "setting", "seconds", *(f"error {n}" for n in names)]
    return Table(caption, header, rows)


def at_equal_error(
    runs: Sequence[Run], errors: Iterable[float], peers: Sequence[str], caption: str
) -> Table:
    """Seconds to reach each error: sidtool's best setting, and the peers' over it."""
    own = [run for run in runs if run.method.startswith("sidtool")]
    found = [p for p in peers if any(run.method == p for run in runs)]
    rows = []
    for error in errors:
        best = fastest(own, error)
        if best is None:
            rows.append([f"{error:.0e}", "not reached", "", *[""] * len(found)])
            continue
        setting = f"{best.method.removeprefix('sidtool ')} {best.setting}"
        cells = [_ratio(runs, peer, error, best.seconds) for peer in found]
        rows.append([f"{error:.0e}", f"{best.seconds:.4f}", setting, *cells])
    header = ["error", "sidtool s", "with", *found]
    return Table(caption, header, rows, summary=True)


def _ratio(runs: Iterable[Run], peer: str, error: float, own: float) -> str:
    theirs = [run for run in runs if run.method == peer]
    best = fastest(theirs, error)
    if best is not None:
        return f"{best.seconds / own:.1f} x"
    longest = max(theirs, key=lambda r: r.seconds)
    return f"not reached ({longest.seconds:.1f} s)"


def remark_on_callers(system: System) -> str:
    """Why solvers that call the kernels from Python are slower than they could be."""
    cost = 1e6 * Equations(system).cost()
    return (
        f"scipy and IDA call sidtool's kernels from Python, {cost:.0f} us a call, "
        "most of it spent on passing arguments; they form Jacobians by differences."
    )


def plot_runs(path: Path, runs: Sequence[Run], label: str) -> None:
    """Work against precision, per method the runs that are worth their time."""
    lines = {}
    for method in dict.fromkeys(run.method for run in runs):
        points = front(r for r in runs if r.method == method and 0 < r.errors[0] < 1)
        if points:
            lines[method] = [(run.errors[0], run.seconds) for run in points]
    plot_lines(path, lines, label)
