"""Runs of models of a scene, each made once, and how much two of them differ."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.progress import Course, Steps, along, is_heard, reached
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID, Array
from sidtool.formats.storage.operating_system import busy_seconds

from .candidates import Choice, as_scene, recording
from .outside import check_inside

if TYPE_CHECKING:
    from sidtool.solver.system.scene import System

Compile = Callable[[SceneFile, Mapping[str, SID]], "System"]
#: Times of two runs are the same within this part of the time span.
SAME_TIME = 1e-9
#: Runs that last less than this [s] are timed this often.
SHORT, REPEATS = 0.1, 2


@dataclass(frozen=True)
class Setting:
    """How a run is integrated."""

    integrator: str
    rtol: float


def expected_runs(finest: Choice, dimension: str) -> dict[str, float]:
    """About how many runs each part of a search makes."""
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
class Begun:
    """The beginning of a run, None where there is none.

    seconds : solve time [s] of the part that is asked for
    """

    result: Result | None
    seconds: float


@dataclass
class Counter:
    """How many runs a search has made."""

    runs: int = 0


@dataclass
class Runs:
    """Models of one scene, compiled and run at most once each.

    compile : makes a system of a scene and its SIDs
    names : outputs that are recorded
    expected : about how many runs each part of a search makes, see `begin`
    counter : counts runs, also those of other scenes of the same search
    whole : runs of all of the time, of which these are the first part
    """

    scene: SceneFile
    sids: Mapping[str, SID]
    compile: Compile
    names: tuple[str, ...]
    expected: Mapping[str, float] = field(default_factory=dict)
    counter: Counter = field(default_factory=Counter)
    whole: Runs | None = None
    _systems: dict[Choice, System] = field(default_factory=dict)
    _results: dict[tuple[Choice, Setting], Result | None] = field(default_factory=dict)
    _seconds: dict[tuple[Choice, Setting], float] = field(default_factory=dict)
    _begun: dict[tuple[Choice, Setting], Begun] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.parts = Course(self.expected)
        self._steps = Steps(1)

    @property
    def count(self) -> int:
        """Runs so far."""
        return self.counter.runs

    def begin(self, part: str) -> None:
        """A part of the search begins."""
        self.parts.enter(part)
        self._steps = Steps(self.expected[part])

    def changed_by(
        self, others: Mapping[str, SID], choice: Choice, setting: Setting
    ) -> Array:
        """What other SIDs of some bodies change (n,); infinite without a run."""
        again = self.elsewhere(others, self.names)
        one, other = self.attempt(choice, setting), again.attempt(choice, setting)
        return self.between((choice, one), (choice, other))

    def elsewhere(
        self,
        others: Mapping[str, SID],
        names: tuple[str, ...],
        scene: SceneFile | None = None,
    ) -> Runs:
        """Runs of the same search with other SIDs of some bodies, in another scene."""
        scene, sids = scene or self.scene, {**self.sids, **others}
        again = Runs(scene, sids, self.compile, names, self.expected, self.counter)
        again.parts, again._steps = self.parts, self._steps
        return again

    def until(self, end: float) -> Runs:
        """Runs of the same search that end earlier."""
        scene = self.scene
        time = scene.time.model_copy(update={"end": end})
        short = self.elsewhere({}, self.names, scene.model_copy(update={"time": time}))
        short.whole = self
        return short

    def tight(self, choice: Choice, setting: Setting) -> Result:
        """A run that has to succeed.

        Raises
        ------
        InputError : the scene cannot be simulated.
        OutsideTheory : it left linear theory so far that its numbers mean nothing.
        SimulationError : the run stopped early.
        """
        from sidtool.solver.errors import SimulationError

        key = choice, setting
        kept = self._results.get(key)
        if kept is None:
            self.counter.runs += 1
            self._steps.next()
            with along(self._steps):
                told = self._told(setting)
                try:
                    kept, took, _ = _timed(self._system(choice), setting, progress=told)
                except SimulationError as stop:
                    if stop.result is not None and stop.result.warnings:
                        check_inside(stop.result)
                    raise
            self._results[key], self._seconds[key] = kept, took
        return kept

    def attempt(self, choice: Choice, setting: Setting) -> Result | None:
        """A run, or None where this model cannot be run."""
        from sidtool.solver.errors import SimulationError

        key = choice, setting
        if key not in self._results:
            try:
                self.tight(choice, setting)
            except (InputError, SimulationError):
                self._results[key] = None
        return self._results[key]

    def seconds(self, choice: Choice, setting: Setting, short: float = SHORT) -> float:
        """The least solve time out of several runs [s]; infinite if there is none.

        short : runs that last longer [s] are not repeated, nor are those of a part
        """
        key = choice, setting
        if self.attempt(choice, setting) is None:
            return np.inf
        for _ in range(REPEATS - 1 if self.whole is None else 0):
            if self._seconds[key] > short:
                break
            _, took, _ = _timed(self._system(choice), setting)
            self._seconds[key] = min(self._seconds[key], took)
        return self._seconds[key]

    def cost(self, choice: Choice, setting: Setting) -> float:
        """What these runs take of the solve time [s] of one that goes on to its end."""
        return self.begun(choice, setting).seconds

    def begun(self, choice: Choice, setting: Setting) -> Begun:
        """This part of a run that goes on to its end, which is only begun.

        Tolerances of steps depend on how long a run is: this one has those of the
        whole.
        """
        key = choice, setting
        if key not in self._begun:
            self._begun[key] = self._begin(choice, setting)
        return self._begun[key]

    def _begin(self, choice: Choice, setting: Setting) -> Begun:
        from sidtool.solver.errors import SimulationError

        if self.whole is None:
            seconds = self.seconds(choice, setting)
            return Begun(self.attempt(choice, setting), seconds)
        begin, end = self.scene.time.start, self.scene.time.end
        now = [begin]
        self.counter.runs += 1
        try:
            result, took, last = _timed(
                self.whole._system(choice),
                setting,
                progress=now.append,
                stop=lambda: "seen" if now[-1] >= end else "",
            )
        except (InputError, SimulationError):
            return Begun(None, np.inf)
        if last < end and not result.completed:
            return Begun(None, np.inf)
        return Begun(result, took * (end - begin) / (last - begin))

    def difference(self, one: Choice, other: Choice, setting: Setting) -> Array:
        """Largest differences (n,) of two models that are integrated alike."""
        a, b = self.attempt(one, setting), self.attempt(other, setting)
        return self.between((one, a), (other, b))

    def between(
        self, one: tuple[Choice, Result | None], other: tuple[Choice, Result | None]
    ) -> Array:
        """Largest differences (n,) over time; infinite where there is no run."""
        (first, a), (second, b) = one, other
        if a is None or b is None:
            return np.full(len(self.names), np.inf)
        return apart((a.t, self.columns(first, a)), (b.t, self.columns(second, b)))

    def columns(self, choice: Choice, result: Result) -> Array:
        """Outputs (nt, n); zero where the model has none."""
        zero = np.zeros(len(result.t))
        known = [result[n] if choice.knows(n) else zero for n in self.names]
        return np.column_stack(known)

    def rounding(self, choice: Choice, result: Result) -> Array:
        """What rounding may leave of outputs, (n,), see `rounding_levels`."""
        from ..study.rounding_levels import rounding_levels

        known = [name for name in self.names if choice.knows(name)]
        levels = rounding_levels(result, self._system(choice), known)
        found = dict(zip(known, levels, strict=True))
        return np.array([found.get(name, 0.0) for name in self.names])

    def _told(self, setting: Setting) -> Callable[[float], None] | None:
        """Tells how far a run is, if somebody listens."""
        if not is_heard():
            return None
        begin, end = self.scene.time.start, self.scene.time.end
        text = f"choosing: run {self.count}: {setting.integrator} {setting.rtol:.0e}"
        reached(text)
        return lambda t: reached(text, (t - begin) / (end - begin))

    def _system(self, choice: Choice) -> System:
        if choice not in self._systems:
            names = tuple(filter(choice.knows, self.names))
            content = recording(as_scene(self.scene, choice, self.sids), names)
            self._systems[choice] = self.compile(content, self.sids)
        return self._systems[choice]


def _timed(
    system: System, setting: Setting, **more: Any
) -> tuple[Result, float, float]:
    """A run, its solve time [s] without that of other programs, and how far it came.

    Raises
    ------
    SimulationError : the run stopped early, and nobody asked it to.
    """
    from sidtool.solver import simulate
    from sidtool.solver.errors import SimulationError

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


def apart(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Largest differences (n,) of two motions, each times (nt,) and outputs (nt, n);
    infinite where one of them ended early."""
    (t, a), (u, b) = one, other
    count = min(len(t), len(u))
    same = np.abs(t[:count] - u[:count]) <= SAME_TIME * max(np.ptp(t), np.ptp(u))
    if abs(len(t) - len(u)) > 1 or not same[:-1].all():
        return np.full(a.shape[1], np.inf)
    return np.asarray(np.abs((a[:count] - b[:count])[same]).max(axis=0, initial=0.0))
