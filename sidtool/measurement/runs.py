"""Runs of the models of a scene, each done once, and differences between them.

Limits of the linear theory of a SID, and coordinates comparable between two SIDs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
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
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.result import OutputError, Result
from sidtool.formats.result.accuracy_report import (
    MAX_DEFLECTION,
    MAX_ROTATION,
    deformation_diagnostics,
    stiffening_diagnostic,
)
from sidtool.formats.scene import SceneFile, is_elastic, parse_output as parsed
from sidtool.formats.storage.operating_system import busy_seconds

from .candidates import Choice, scene_of_model, with_recorded_outputs

if TYPE_CHECKING:
    from sidtool.solver.system.system import System


#: Largest relative change of stiffness that a SID without geometric stiffening may
#: neglect.
MAX_UNMODELLED_STIFFENING = 0.25

#: Relative tolerance for equal frequencies: a shape function has the same frequency in
#: two bases, and its neighbours have others.
SAME_FREQUENCY_TOLERANCE = 0.05
Compile = Callable[[SceneFile, Mapping[str, SID]], "System"]
#: Tolerance for equal times of two runs, relative to the time span.
TIME_RESOLUTION = 1e-9
#: Runs shorter than this [s] are timed this number of times.
SHORT_RUN_SECONDS, SHORT_RUN_REPEATS = 0.1, 2


class OutsideTheory(InputError):
    """Raised if a body leaves the range of its SID, so that errors cannot be
    estimated.
    """


def check_validity(result: Result) -> None:
    """Check the finest run at its output times and ends of steps.

    Raises
    ------
    OutsideTheory : a body bends by more than a tenth of its length, rotates elastically
        by more than 0.15 rad, or lacks a geometric stiffening that matters.
    """
    for name, body in result.bodies.items():
        place = f"bodies.{name}"
        measure = body.found or body.expected
        lacks_stiffening = not measure.carried and not measure.axial
        if lacks_stiffening and (
            measure.diverges or abs(measure.ratio) > MAX_UNMODELLED_STIFFENING
        ):
            raise OutsideTheory(
                stiffening_diagnostic(name, measure).message_line,
                place=place,
                expected="a SID with geometric stiffening",
            )
        for beyond in deformation_diagnostics(name, body.deflection, body.rotation):
            parts = math.ceil(
                max(body.deflection / MAX_DEFLECTION, body.rotation / MAX_ROTATION)
            )
            raise OutsideTheory(
                beyond.message_line,
                place=place,
                expected=f"the body cut into {parts} or more, each a SID of its own, "
                "tied by joints of type fixed; `simulate` without `wanted` gives "
                "numbers whose error is not known",
            )


def missing_stiffening_diagnostics(
    stiffness: Mapping[str, float], change: OutputError, matters: bool
) -> Iterator[Diagnostic]:
    """Diagnose geometric stiffening that the models of bodies lack (N606).

    stiffness : relative change of stiffness that it would cause, by body
    change : largest change of an output by all of it
    matters : whether it changes an output by more than is allowed, and considerably

    Raises
    ------
    OutsideTheory : it matters, and changes a stiffness by more than a quarter.
    """
    for name, ratio in stiffness.items():
        found = diagnose("N606", name, ratio=ratio, **change.values())
        if matters and abs(ratio) > MAX_UNMODELLED_STIFFENING:
            raise OutsideTheory(
                found.message_line,
                place=f"bodies.{name}",
                expected="a model with a table [stiffening]",
            )
        if change.error > change.allowed:
            yield found


def elastic_coordinates(name: str, result: Result) -> np.ndarray:
    """Return elastic coordinates (nt, nq) in the order of the SID; zero for omitted
    ones.
    """
    sid: SID = result.sids[name]
    q = np.zeros((len(result.t), sid.nq))
    for k in range(sid.nq):
        column = f"{name}.q{k + 1}"
        if column in result.position_names:
            q[:, k] = result.positions[:, result.position_names.index(column)]
    return q


def is_incomparable(
    output: str, before: Mapping[str, SID], after: Mapping[str, SID]
) -> bool:
    """Return whether an output belongs to a shape function that another SID lacks. The
    result is also True if the shape function cannot be distinguished from others there.
    """
    name = parsed(output)
    if name.marker or not is_elastic(name.quantity) or name.owner not in before:
        return False
    sids = before[name.owner], after[name.owner]
    number = int(name.quantity.lstrip("vq")) - 1
    return sids[0] is not sids[1] and not _is_in_both(number, *sids)


def _is_in_both(number: int, *sids: SID) -> bool:
    """Return whether a shape function is the only one near its frequency in both
    SIDs.
    """
    squares = [np.diag(sid.Ke.m0) / np.diag(sid.Me.m0) for sid in sids]
    if number >= min(map(len, squares)):
        return False
    own = squares[0][number]
    near = [
        np.abs(values - own) <= 2.0 * SAME_FREQUENCY_TOLERANCE * own
        for values in squares
    ]
    return all(rows[number] and rows.sum() == 1 for rows in near)


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
