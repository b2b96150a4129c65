"""A run: from a compiled scene to a result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from sidtool.formats.result import Event, FlexibleBody, Result
from sidtool.formats.scene import output_times
from sidtool.formats.sid import Array

from . import warmup
from .advice import notes
from .advice.bifurcations import crossings
from .advice.body_measures import expected_bodies, reached_bodies
from .advice.stopping import (
    CAUSES,
    explained,
    lost_inertia,
    near_singular,
    singular,
    too_light,
)
from .errors import SimulationError
from .integrators import INTEGRATORS, Advance, newton_steps, recording, stepping
from .integrators.singular import NEAR
from .kernels import newton
from .kernels.layout import Work
from .kernels.newton import Memory
from .kernels.pointers import kernels
from .recording import dense, events, outputs
from .recording.energy_history import History, is_wanted
from .recording.sampling import sample
from .recording.visited import Visited
from .start import assembly
from .start.displacements import told_displacements
from .start.new_control import closed_below, new_control
from .start.settings import Settings, made_with, settings_of
from .start.turn_counts import keep_turns, lost_turn
from .system.scene import System
from .system.storage import new_memory, new_work
from .versions import versions

#: Steps between two reports of progress.
CHUNK = 500

Progress = Callable[[float], None]
Foresee = Callable[[Mapping[str, FlexibleBody]], None]


def simulate(
    system: System,
    *,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    spectral_radius: float | None = None,
    progress: Progress | None = None,
    foresee: Foresee | None = None,
    told: Iterable[str] = (),
) -> Result:
    """Integrates a compiled scene over its time span.

    Parameters
    ----------
    integrator : name in `sidtool.solver.integrators.INTEGRATORS` or "auto", default as
        in the scene
    rtol : tolerated error relative to the largest motion, default as in the scene
    step : fixed step [s]; replaces the error control
    spectral_radius : of generalised_alpha, 0 to 1, default as in the scene
    progress : called with the simulated time [s] from time to time
    foresee : called before the first step with what is expected of flexible bodies
    told : sentences for the notes of the result

    Raises
    ------
    InputError : unknown integrator, or no start position meets the constraints.
    SimulationError : the run stopped early; its `result` holds what was computed.
    """
    settings = settings_of(system, integrator, rtol, step, spectral_radius)
    loops = [INTEGRATORS[name].step_loop for name in settings.possible]
    warmup.ensure(system.planar, loops)
    began = time.perf_counter()
    system, start = assembly.assemble(system)
    expected = expected_bodies(system, start)
    if foresee is not None:
        foresee(expected)
    run = _Run(system, settings, start, expected, (*system.told, *told))
    assembled = time.perf_counter()
    failure = run.go(progress)
    solved = time.perf_counter()
    seconds = {"seconds_assembly": assembled - began, "seconds": solved - assembled}
    result = run.result(seconds, failure)
    if failure:
        raise SimulationError(result.message, result)
    return result


class _Run:
    """Storage and step function of one run."""

    def __init__(
        self,
        system: System,
        settings: Settings,
        start: assembly.Start,
        expected: Mapping[str, FlexibleBody],
        told: tuple[str, ...],
    ) -> None:
        self.system, self.settings, self.start = system, settings, start
        self.expected, self.told = expected, told
        methods = [INTEGRATORS[name] for name in settings.possible]
        self.method, self.switched = methods[0], math.nan
        self.work: Work = new_work(system)
        self.memory: Memory = new_memory(system, max(m.pairs for m in methods))
        self.kernels = kernels(system.planar)
        self.times = output_times(system.scene)
        self.closed = closed_below(system, settings)
        points = dense.Points(max(m.dense for m in methods))
        self.watch = None
        if system.scene.events:
            self.watch = events.Watch(system, self.kernels, self.closed, points)
        self.history = History(points) if is_wanted(system.scene) else None
        self.inside = self.watch is not None or self.history is not None
        worst = [body.expected.time for body in expected.values()]
        self.visited = Visited(system, worst) if expected else None
        shares, self.limit = np.zeros(0), CHUNK
        if self.inside:
            shares, self.limit = points.wanted(), dense.CHUNK
        elif expected:
            shares = dense.wanted_ends(fixed=settings.step is not None)
            self.limit = dense.END_CHUNK
        self.points = points
        self.control = new_control(
            system, settings, start, self.times, shares, self.closed
        )
        self.breaks: list[events.Moment] = []
        self.advance = self._prepare()

    def _prepare(self) -> Advance:
        return self.method.prepare(
            self.system, self.kernels, self.work, self.memory, self.control
        )

    def go(self, progress: Progress | None) -> str:
        """Integrates over all smooth intervals; the reason if one is not finished."""
        for stop in self.system.breaks:
            status = self._enter(stop)
            if status != 0:
                return singular(self.system, self.work, self.now, status)
            code = stepping.CHUNK
            while code == stepping.CHUNK:
                code = self.advance(self.limit)
                if self._look_inside():
                    return ""
                if self._is_hard(code):
                    self._switch()
                    status = self._enter(stop)
                    if status != 0:
                        return singular(self.system, self.work, self.now, status)
                    code = stepping.CHUNK
                if progress is not None:
                    progress(self.now)
            if code != stepping.REACHED:
                return self._failure(code)
            self._note_breaks(stop)
        return ""

    @property
    def now(self) -> float:
        """Time that was reached [s]."""
        return float(self.control.real[stepping.TIME])

    def _is_hard(self, code: int) -> bool:
        """Whether another method has to go on: stiffness, or a singular position."""
        waits = self.settings.when_stiff and math.isnan(self.switched)
        if not waits or code not in (stepping.CHUNK, stepping.CRAWLING):
            return False
        whole = self.control.whole
        if whole[stepping.CROSSING] == NEAR:
            return True
        stiff = whole[stepping.STIFF]
        return bool(stepping.STIFF_PART * stiff > self.memory.counters[newton.STEPS])

    def _switch(self) -> None:
        """Goes on from here with the method for hard scenes."""
        self.method, self.switched = INTEGRATORS[self.settings.when_stiff], self.now
        self.advance = self._prepare()

    def _told(self) -> dict[str, str | float]:
        """How the run was made, for the result."""
        settings = self.settings
        name = settings.integrator
        if not math.isnan(self.switched):
            name += f", then {settings.when_stiff} from t = {self.switched:.6g} s"
        told: dict[str, str | float] = {"integrator": name, "rtol": settings.rtol}
        told["step"] = settings.step or 0.0
        if self.method.damps:
            told["spectral_radius"] = settings.radius
        return told

    def _notes(self) -> Iterator[str]:
        """What a reader has to know of the numbers."""
        yield from self.told
        yield from crossings(
            self.system, self.kernels, self.control, self.settings.rtol
        )
        yield from told_displacements(self.system, self.start, self.settings.rtol)
        if self.now >= self.system.scene.time.end and not self._end():
            yield from notes.of_output_times(self.system.scene, self.times)
        yield from notes.of_programs(self.system)
        yield from notes.hidden_errors(
            self.system,
            self.control,
            self.settings.rtol,
            int(self.memory.counters[newton.STEPS]),
        )
        yield from notes.passed_over(self.system, self.control, self.settings)

    def _note_breaks(self, t: float) -> None:
        """Keeps the state where drives or forces are not smooth."""
        z, v = self.control.z.copy(), self.control.v.copy()
        for name in self.system.causes.get(t, ()):
            self.breaks.append(events.Moment(name, "break", t, z, v))

    def _look_inside(self) -> bool:
        """Keeps what is wanted of the last steps; True when the run ends in them."""
        if not self.inside:
            if self.visited is not None:
                self.visited.add(dense.taken_ends(self.control))
            return False
        steps = dense.taken(self.control)
        if self.visited is not None:
            self.visited.add(self.points.ends(steps))
        if self.history is not None:
            self.history.add(steps)
        return self.watch is not None and self.watch.look(steps)

    def _enter(self, end: float) -> int:
        """Starts a smooth interval, with no memory of steps before; 0, or the code of
        a singular system."""
        control, real, begin = self.control, self.control.real, self.now
        real[stepping.STOP] = end
        real[stepping.OLD_STEP] = 0.0
        real[stepping.FACTORED_STEP] = 0.0
        real[stepping.FRONTIER] = np.inf
        control.whole[stepping.WELL] = newton_steps.OFTEN
        control.whole[stepping.NEEDS_JACOBIAN] = 1
        control.whole[stepping.PREDICT] = 0
        self.work.clock[0] = 0.5 * (begin + end)
        if self.settings.step is not None:
            count = max(1, int(np.ceil((end - begin) / self.settings.step - 1e-9)))
            real[stepping.STEP] = (end - begin) / count
        status: int = recording.begin(
            self.kernels,
            self.system.arrays,
            self.work,
            self.memory,
            begin,
            control.z,
            control.v,
        )
        if status == 0:
            keep_turns(self.system, self.work, control.z)
            control.measured[:, :2] = self.work.measure
        return status

    def _failure(self, code: int) -> str:
        cause = CAUSES.get(code, f"code {code}")
        if code in (stepping.TOO_SMALL, stepping.OFF_CONSTRAINTS):
            cause = lost_turn(self.system, self.work, self.control) or cause
        worst = outputs.busiest_body(self.system, self.control)
        text = f"stopped at t = {self.now:.9g} s: {cause} (fastest change: {worst})"
        text += (
            lost_inertia(self.system, self.work)
            or too_light(self.system, self.work)
            or near_singular(self.control)
        )
        if self.system.redundant:
            rows = assembly.names_of_rows(self.system, self.system.redundant)
            names = ", ".join(dict.fromkeys(rows))
            text += f"; redundant at the start, perhaps contradicting now: {names}"
        return text

    def result(self, seconds: dict[str, float], failure: str) -> Result:
        t, z, v = self._recorded(bool(failure))
        recorded = self._record(t, z, v)
        if failure and not np.isfinite(recorded.samples.accelerations[-1:]).all():
            t, z, v = t[:-1], z[:-1], v[:-1]
            recorded = self._record(t, z, v)
        bodies = self._reached(t, z, v)
        return Result(
            title=self.system.scene.title,
            names=recorded.names,
            t=t,
            values=recorded.values,
            positions=z,
            velocities=v,
            multipliers=recorded.multipliers,
            position_names=outputs.position_names(self.system),
            velocity_names=outputs.velocity_names(self.system),
            multiplier_names=outputs.multiplier_names(self.system),
            counters=self._counters() | seconds,
            drift={
                "position": float(self.control.real[stepping.DRIFT]),
                "velocity": float(self.control.real[stepping.DRIFT_RATE]),
            },
            settings=self._told(),
            bodies=bodies,
            events=self._events(),
            scene=made_with(self.system.scene, self.settings),
            notes=(*self._notes(), *notes.of_run(self.system, t, recorded)),
            versions=versions(),
            completed=not failure,
            message=explained(failure, bodies) or self._end(),
        )

    def _reached(self, t: Array, z: Array, v: Array) -> Mapping[str, FlexibleBody]:
        """What flexible bodies met, at output times and at the ends of steps."""
        if self.visited is None or not len(t):
            return self.expected
        between = self.visited.until(t[-1])
        states = [(t, between.t), (z, between.z), (v, between.v)]
        order = np.argsort(np.concatenate(states[0]), kind="stable")
        t, z, v = (np.concatenate(pair)[order] for pair in states)
        samples = sample(
            self.system, self.kernels, self.work, self.memory, t, z, v, self.closed
        )
        return reached_bodies(self.system, samples, t, self.expected)

    def _record(self, t: Array, z: Array, v: Array) -> outputs.Recorded:
        return outputs.record(
            self.system,
            self.kernels,
            self.work,
            self.memory,
            t,
            z,
            v,
            self.closed,
            self.history,
        )

    def _recorded(self, failed: bool) -> tuple[Array, Array, Array]:
        """Times, z and v at the output times, and last where the run ended early."""
        control = self.control
        count = int(control.whole[stepping.OUTPUT])
        found = (self.times, control.out_z, control.out_v)
        last = None
        if self.watch is not None and self.watch.ended:
            last = self.watch.moments[-1]
        elif failed and np.isfinite([*control.z, *control.v]).all():
            last = events.Moment("", "stop", self.now, control.z, control.v)
        if last is None:
            return found[0][:count], found[1][:count], found[2][:count]
        count = int(np.searchsorted(self.times[:count], last.t))
        t = np.append(self.times[:count], last.t)
        z, v = (
            np.vstack([rows[:count], end])
            for rows, end in zip(found[1:], (last.z, last.v), strict=True)
        )
        return t, z, v

    def _counters(self) -> dict[str, int | float]:
        stiff = int(self.control.whole[stepping.STIFF])
        explicit = {"stiff_steps": stiff} if self.method.explicit else {}
        return _counters(self.memory) | explicit

    def _events(self) -> tuple[Event, ...]:
        moments = [*self.breaks, *(self.watch.moments if self.watch else [])]
        moments.sort(key=lambda moment: moment.t)
        return events.events_of(
            moments, self.system, self.kernels, self.closed, self.history
        )

    def _end(self) -> str:
        """What ended the run before the end of the time span, if an event did."""
        if self.watch is None or not self.watch.ended:
            return ""
        t = self.watch.moments[-1].t
        return f"event {self.watch.ended} ended the run at t = {t:.9g} s"


def _counters(memory: Memory) -> dict[str, int | float]:
    names = {
        "steps": newton.STEPS,
        "rejected": newton.REJECTED,
        "evaluations": newton.EVALUATIONS,
        "jacobians": newton.JACOBIANS,
        "factorisations": newton.FACTORISATIONS,
        "newton_iterations": newton.ITERATIONS,
        "projections": newton.PROJECTIONS,
    }
    return {name: int(memory.counters[i]) for name, i in names.items()}
