"""Runs of the models of a scene, each done once, and differences between them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import (
    EqualStages,
    NamedStages,
    count_within,
    has_listener,
    report_stage,
)
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.storage.operating_system import busy_seconds

from .candidates import Choice, scene_of_model, with_recorded_outputs
from .validity import check_validity

if TYPE_CHECKING:
    from sidtool.solver.system.system import System

Compile = Callable[[SceneFile, Mapping[str, SID]], "System"]
#: Tolerance for equal times of two runs, relative to the time span.
TIME_RESOLUTION = 1e-9
#: Runs shorter than this [s] are timed this number of times.
SHORT_RUN_SECONDS, SHORT_RUN_REPEATS = 0.1, 2


@dataclass(frozen=True)
class Setting:
    """Integrator, tolerance and step of a run."""

    integrator: str
    rtol: float


def expected_runs(finest: Choice, dimension: str) -> dict[str, float]:
    """Return the approximate number of runs of each stage of a search."""
    flexible = [kept for _, kept in finest.kept if kept]
    return {
        "reference": 2.0,
        "plane": 1.0 if dimension == "spatial" else 0.0,
        "rigid bodies": 2.0 * len(flexible),
        "shape functions": sum(map(len, flexible)) + 4.0,
        "terms": 2.0 * len(flexible),
        "integration": 8.0,
        "errors": 3.0,
    }


@dataclass(frozen=True, eq=False)
class PartialRun:
    """An initial interval of a run; the result is None if the run failed.

    Attributes
    ----------
    seconds : solve time [s] of the requested part
    """

    result: Result | None
    seconds: float


@dataclass
class RunCounter:
    """Counter of the runs of a search."""

    runs: int = 0


@dataclass
class Runs:
    """Runs of the models of one scene; each is compiled and run at most once.

    compile : function that compiles a scene with its SIDs
    names : outputs that are recorded
    expected : approximate number of runs of each stage of a search, see `begin`
    counter : counts runs, also those of other scenes of the same search
    whole : runs over the full interval, if these cover an initial interval
    """

    scene: SceneFile
    sids: Mapping[str, SID]
    compile: Compile
    names: tuple[str, ...]
    expected: Mapping[str, float] = field(default_factory=dict)
    counter: RunCounter = field(default_factory=RunCounter)
    whole: Runs | None = None
    _systems: dict[Choice, System] = field(default_factory=dict)
    _results: dict[tuple[Choice, Setting], Result | None] = field(default_factory=dict)
    _seconds: dict[tuple[Choice, Setting], float] = field(default_factory=dict)
    _begun: dict[tuple[Choice, Setting], PartialRun] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.parts = NamedStages(self.expected)
        self._steps = EqualStages(1)

    @property
    def count(self) -> int:
        """Return the number of runs so far."""
        return self.counter.runs

    def begin(self, part: str) -> None:
        """Start a stage of the search."""
        self.parts.enter(part)
        self._steps = EqualStages(self.expected[part])

    def max_change_by(
        self, others: Mapping[str, SID], choice: Choice, setting: Setting
    ) -> Array:
        """Return the changes (n,) by other SIDs of some bodies; infinite
        without a run.
        """
        again = self.with_other_sids(others, self.names)
        one, other = self.attempt(choice, setting), again.attempt(choice, setting)
        return self.max_differences((choice, one), (choice, other))

    def with_other_sids(
        self,
        others: Mapping[str, SID],
        names: tuple[str, ...],
        scene: SceneFile | None = None,
    ) -> Runs:
        """Return runs of the same search with other SIDs of some bodies and another
        scene.
        """
        scene, sids = scene or self.scene, {**self.sids, **others}
        again = Runs(scene, sids, self.compile, names, self.expected, self.counter)
        again.parts, again._steps = self.parts, self._steps
        return again

    def shortened_to(self, end: float) -> Runs:
        """Return runs of the same search that end earlier."""
        scene = self.scene
        time = scene.time.model_copy(update={"end": end})
        short = self.with_other_sids(
            {}, self.names, scene.model_copy(update={"time": time})
        )
        short.whole = self
        return short

    def tight_run(self, choice: Choice, setting: Setting) -> Result:
        """Return a run that must succeed.

        Raises
        ------
        InputError : the scene cannot be simulated.
        OutsideTheory : it left linear theory so far that its numbers are meaningless.
        SimulationError : the run stopped early.
        """
        from sidtool.solver.system.errors import SimulationError

        key = choice, setting
        known = self._results.get(key)
        if known is None:
            self.counter.runs += 1
            self._steps.next()
            with count_within(self._steps):
                listener = self._progress_callback(setting)
                try:
                    known, took, _ = _timed_run(
                        self._system(choice), setting, progress=listener
                    )
                except SimulationError as stop:
                    if stop.result is not None and stop.result.warnings:
                        check_validity(stop.result)
                    raise
            self._results[key], self._seconds[key] = known, took
        return known

    def attempt(self, choice: Choice, setting: Setting) -> Result | None:
        """Return a run, or None if this model cannot be run."""
        from sidtool.solver.system.errors import SimulationError

        key = choice, setting
        if key not in self._results:
            try:
                self.tight_run(choice, setting)
            except (InputError, SimulationError):
                self._results[key] = None
        return self._results[key]

    def seconds(
        self, choice: Choice, setting: Setting, short: float = SHORT_RUN_SECONDS
    ) -> float:
        """Return the least solve time out of several runs [s]; infinite if the run
        failed.

        short : longer runs [s] are not repeated; neither are runs of an initial
            interval
        """
        key = choice, setting
        if self.attempt(choice, setting) is None:
            return np.inf
        for _ in range(SHORT_RUN_REPEATS - 1 if self.whole is None else 0):
            if self._seconds[key] > short:
                break
            _, took, _ = _timed_run(self._system(choice), setting)
            self._seconds[key] = min(self._seconds[key], took)
        return self._seconds[key]

    def cost(self, choice: Choice, setting: Setting) -> float:
        """Return the solve time of these runs as a share of that [s] of a full run."""
        return self.run_initial_interval(choice, setting).seconds

    def run_initial_interval(self, choice: Choice, setting: Setting) -> PartialRun:
        """Return the initial interval of a full run; only this interval is computed.
        Tolerances of steps depend on the length of a run; those of the full run are
        used.
        """
        key = choice, setting
        if key not in self._begun:
            self._begun[key] = self._begin(choice, setting)
        return self._begun[key]

    def _begin(self, choice: Choice, setting: Setting) -> PartialRun:
        from sidtool.solver.system.errors import SimulationError

        if self.whole is None:
            seconds = self.seconds(choice, setting)
            return PartialRun(self.attempt(choice, setting), seconds)
        begin, end = self.scene.time.start, self.scene.time.end
        now = [begin]
        self.counter.runs += 1
        try:
            result, took, last = _timed_run(
                self.whole._system(choice),
                setting,
                progress=now.append,
                stop=lambda: "seen" if now[-1] >= end else "",
            )
        except (InputError, SimulationError):
            return PartialRun(None, np.inf)
        if last < end and not result.completed:
            return PartialRun(None, np.inf)
        return PartialRun(result, took * (end - begin) / (last - begin))

    def difference(self, one: Choice, other: Choice, setting: Setting) -> Array:
        """Return the largest differences (n,) of two models with the same
        integration.
        """
        a, b = self.attempt(one, setting), self.attempt(other, setting)
        return self.max_differences((one, a), (other, b))

    def max_differences(
        self, one: tuple[Choice, Result | None], other: tuple[Choice, Result | None]
    ) -> Array:
        """Return the largest differences (n,) over time; infinite if a run failed."""
        (first, a), (second, b) = one, other
        if a is None or b is None:
            return np.full(len(self.names), np.inf)
        return max_difference(
            (a.t, self.columns(first, a)), (b.t, self.columns(second, b))
        )

    def columns(self, choice: Choice, result: Result) -> Array:
        """Outputs (nt, n); zero where the model has none."""
        zero = np.zeros(len(result.t))
        known = [result[n] if choice.has_output(n) else zero for n in self.names]
        return np.column_stack(known)

    def rounding(self, choice: Choice, result: Result) -> Array:
        """Return the effect of rounding on outputs (n,), see `rounding_levels`."""
        from .rounding_levels import rounding_levels

        known = [name for name in self.names if choice.has_output(name)]
        levels = rounding_levels(result, self._system(choice), known)
        level_of = dict(zip(known, levels, strict=True))
        return np.array([level_of.get(name, 0.0) for name in self.names])

    def _progress_callback(self, setting: Setting) -> Callable[[float], None] | None:
        """Return a callback that reports the progress of a run if there is a
        listener.
        """
        if not has_listener():
            return None
        begin, end = self.scene.time.start, self.scene.time.end
        text = f"choosing: run {self.count}: {setting.integrator} {setting.rtol:.0e}"
        report_stage(text)
        return lambda t: report_stage(text, (t - begin) / (end - begin))

    def _system(self, choice: Choice) -> System:
        if choice not in self._systems:
            names = tuple(filter(choice.has_output, self.names))
            content = with_recorded_outputs(
                scene_of_model(self.scene, choice, self.sids), names
            )
            self._systems[choice] = self.compile(content, self.sids)
        return self._systems[choice]


def _timed_run(
    system: System, setting: Setting, **more: Any
) -> tuple[Result, float, float]:
    """Return a run, its solve time [s] without other programs, and its end time.

    Raises
    ------
    SimulationError : the run stopped early without a request.
    """
    from sidtool.solver import simulate
    from sidtool.solver.system.errors import SimulationError

    began = time.perf_counter(), time.thread_time()
    method, rtol = setting.integrator, setting.rtol
    try:
        result = simulate(system, integrator=method, rtol=rtol, **more)
    except SimulationError as stop:
        if "stop" not in more or stop.result is None:
            raise
        result = stop.result
    passed, worked = time.perf_counter() - began[0], time.thread_time() - began[1]
    share = busy_seconds(passed, worked) / passed
    took = float(result.counters["seconds"]) * share
    return result, took, float(result.t[-1])


def max_difference(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return the largest differences (n,) of two motions, each given by times (nt,) and
    outputs (nt, n); infinite if one of them ended early.
    """
    (t, a), (u, b) = one, other
    count = min(len(t), len(u))
    same = np.abs(t[:count] - u[:count]) <= TIME_RESOLUTION * max(np.ptp(t), np.ptp(u))
    if abs(len(t) - len(u)) > 1 or not same[:-1].all():
        return np.full(a.shape[1], np.inf)
    return np.asarray(np.abs((a[:count] - b[:count])[same]).max(axis=0, initial=0.0))
