"""Runs of models of a scene, each made once, and how much two of them differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID, Array

from .candidates import Choice, as_scene, recording

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


@dataclass
class Runs:
    """Models of one scene, compiled and run at most once each.

    compile : makes a system of a scene and its SIDs
    names : outputs that are recorded
    count : runs so far
    """

    scene: SceneFile
    sids: Mapping[str, SID]
    compile: Compile
    names: tuple[str, ...]
    say: Callable[[str], None]
    count: int = 0
    _systems: dict[Choice, System] = field(default_factory=dict)
    _results: dict[tuple[Choice, Setting], Result | None] = field(default_factory=dict)
    _seconds: dict[tuple[Choice, Setting], float] = field(default_factory=dict)

    def tight(self, choice: Choice, setting: Setting) -> Result:
        """A run that has to succeed.

        Raises
        ------
        InputError : the scene cannot be simulated.
        SimulationError : the run stopped early.
        """
        from sidtool.solver import simulate

        key = choice, setting
        kept = self._results.get(key)
        if kept is None:
            self.say(f"run {self.count + 1}: {setting.integrator} {setting.rtol:.0e}")
            self.count += 1
            system = self._system(choice)
            kept = simulate(
                system, integrator=setting.integrator, rtol=setting.rtol, step=None
            )
            self._results[key] = kept
            self._seconds[key] = float(kept.counters["seconds"])
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

    def seconds(self, choice: Choice, setting: Setting) -> float:
        """The least solve time out of several runs [s]; infinite if there is none."""
        from sidtool.solver import simulate

        key = choice, setting
        if self.attempt(choice, setting) is None:
            return np.inf
        for _ in range(REPEATS - 1):
            if self._seconds[key] > SHORT:
                break
            again = simulate(
                self._system(choice), integrator=setting.integrator, rtol=setting.rtol
            )
            took = float(again.counters["seconds"])
            self._seconds[key] = min(self._seconds[key], took)
        return self._seconds[key]

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
        span = self.scene.time.end - self.scene.time.start
        count = min(len(a.t), len(b.t))
        same = np.abs(a.t[:count] - b.t[:count]) <= SAME_TIME * span
        if abs(len(a.t) - len(b.t)) > 1 or not same[:-1].all():
            return np.full(len(self.names), np.inf)
        columns = self.columns(first, a)[:count] - self.columns(second, b)[:count]
        return np.asarray(np.abs(columns[same]).max(axis=0, initial=0.0))

    def columns(self, choice: Choice, result: Result) -> Array:
        """Outputs (nt, n); zero where the model has none."""
        zero = np.zeros(len(result.t))
        known = [result[n] if choice.knows(n) else zero for n in self.names]
        return np.column_stack(known)

    def _system(self, choice: Choice) -> System:
        if choice not in self._systems:
            names = tuple(filter(choice.knows, self.names))
            content = recording(as_scene(self.scene, choice, self.sids), names)
            self._systems[choice] = self.compile(content, self.sids)
        return self._systems[choice]
