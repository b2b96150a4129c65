"""A run: from a compiled scene to a result."""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata

import numpy as np

from formats.errors import InputError
from formats.result import Event, FlexibleBody, Result
from formats.scene import output_times
from formats.sid import Array

from . import assembly, events, outputs, warmup
from .bodies import amplitudes, frequencies
from .body_measures import expected_bodies, reached_bodies
from .energy_history import History, is_wanted
from .errors import SimulationError
from .integrators import INTEGRATORS, Integrator, stepping
from .kernels import layout as at
from .kernels import newton
from .kernels.layout import Work
from .kernels.newton import Memory
from .kernels.pointers import kernels
from .scene import System
from .storage import new_memory, new_work

#: Steps between two reports of progress.
CHUNK = 500
#: Constraints are met when they are open by less than this part of the size: at least
#: what rounding allows, at most what keeps the drift invisible.
CLOSED = (1e-13, 1e-11)
#: Tolerance per step in units of the requested relative error: errors of undamped
#: vibrations add up from step to step.
STEP_TOLERANCE = 0.3

Progress = Callable[[float], None]
Foresee = Callable[[Mapping[str, FlexibleBody]], None]

_FAILURES = {
    stepping.TOO_SMALL: "the step size fell below what the time resolves: the motion "
    "is not smooth here, or a body is blocked",
    stepping.OFF_CONSTRAINTS: "the constraints could not be met at the end of a step; "
    "a smaller fixed step may help",
    stepping.NOT_FINITE: "a coordinate became infinite or undefined",
    stepping.NO_CONVERGENCE: "Newton's iteration did not converge with the fixed step; "
    "a smaller one may help",
    stepping.CRAWLING: "the scene is stiff: stability, not accuracy, keeps the steps "
    "of this explicit method so short that the run would take hundreds of thousands; "
    "use radau5 or radau9",
}


@dataclass(frozen=True)
class Settings:
    """How a run is made: integrator, relative tolerance, or a fixed step [s].

    radius : spectral radius at infinite frequency, of methods that have one
    """

    integrator: str
    rtol: float
    step: float | None
    radius: float

    def told(self, method: Integrator) -> dict[str, str | float]:
        """For the result."""
        told: dict[str, str | float] = {
            "integrator": self.integrator,
            "rtol": self.rtol,
            "step": self.step or 0.0,
        }
        return told | ({"spectral_radius": self.radius} if method.damps else {})


def simulate(
    system: System,
    *,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    spectral_radius: float | None = None,
    progress: Progress | None = None,
    foresee: Foresee | None = None,
) -> Result:
    """Integrates a compiled scene over its time span.

    Parameters
    ----------
    integrator : name in `solver.integrators.INTEGRATORS`, default as in the scene
    rtol : tolerated error relative to the largest motion, default as in the scene
    step : fixed step [s]; replaces the error control
    spectral_radius : of generalised_alpha, 0 to 1, default as in the scene
    progress : called with the simulated time [s] from time to time
    foresee : called before the first step with what is expected of flexible bodies

    Raises
    ------
    InputError : unknown integrator, or no start position meets the constraints.
    SimulationError : the run stopped early; its `result` holds what was computed.
    """
    settings = _settings(system, integrator, rtol, step, spectral_radius)
    method = INTEGRATORS[settings.integrator]
    warmup.ensure(system.planar, [method.step_loop], say_compiling)
    began = time.perf_counter()
    system, start = assembly.assemble(system)
    expected = expected_bodies(system, start)
    if foresee is not None:
        foresee(expected)
    run = _Run(system, method, settings, start)
    assembled = time.perf_counter()
    failure = run.go(progress)
    solved = time.perf_counter()
    seconds = {"seconds_assembly": assembled - began, "seconds": solved - assembled}
    result = run.result(seconds, failure, expected)
    if failure:
        raise SimulationError(result.message, result)
    return result


def say_compiling(text: str) -> None:
    """Tells a person who waits why; nobody waits where there is no terminal."""
    if sys.stderr.isatty():
        print(f"sidtool: {text}", file=sys.stderr, flush=True)


def _settings(
    system: System,
    integrator: str | None,
    rtol: float | None,
    step: float | None,
    radius: float | None,
) -> Settings:
    accuracy = system.scene.accuracy
    name = integrator or accuracy.integrator
    if name not in INTEGRATORS:
        raise InputError(
            f"there is no integrator {name!r}",
            place="accuracy.integrator",
            expected=f"one of {', '.join(INTEGRATORS)}",
        )
    rtol = accuracy.rtol if rtol is None else rtol
    step = accuracy.step if step is None else step
    if not 1e-13 <= rtol <= 0.1:
        raise InputError(f"rtol is {rtol:g}", expected="a number from 1e-13 to 0.1")
    if step is not None and not step > 0.0:
        raise InputError(f"step is {step:g}", expected="a positive number of seconds")
    radius = accuracy.spectral_radius if radius is None else radius
    if not 0.0 <= radius <= 1.0:
        raise InputError(f"spectral_radius is {radius:g}", expected="0 to 1")
    return Settings(name, rtol, step, radius)


class _Run:
    """Storage and step function of one run."""

    def __init__(
        self,
        system: System,
        method: Integrator,
        settings: Settings,
        start: assembly.Start,
    ) -> None:
        self.system, self.method, self.settings = system, method, settings
        self.work: Work = new_work(system)
        self.memory: Memory = new_memory(system, method.pairs)
        self.kernels = kernels(system.planar)
        self.times = output_times(system.scene)
        self.closed = _closed(system, settings)
        self.watch = None
        if system.scene.events:
            self.watch = events.Watch(system, self.kernels, self.closed, method.dense)
        shares = np.zeros(0) if self.watch is None else self.watch.shares
        self.control = _new_control(
            system, settings, start, self.times, shares, self.closed
        )
        self.history = History() if is_wanted(system.scene) else None
        self.breaks: list[events.Moment] = []
        self.begin = system.scene.time.start
        self.advance = method.prepare(
            system, self.kernels, self.work, self.memory, self.control
        )

    def go(self, progress: Progress | None) -> str:
        """Integrates over all smooth intervals; the reason if one is not finished."""
        control = self.control
        now = self.begin
        limit = CHUNK if self.watch is None else events.CHUNK
        for stop in self.system.breaks:
            self._enter(now, stop)
            self._remember()
            code = stepping.CHUNK
            while code == stepping.CHUNK:
                code = self.advance(limit if self.history is None else 1)
                self._remember()
                if self.watch is not None and self.watch.look(control):
                    return ""
                if progress is not None:
                    progress(float(control.real[stepping.TIME]))
            if code != stepping.REACHED:
                return self._failure(code)
            self._note_breaks(stop)
            now = stop
        return ""

    def _note_breaks(self, t: float) -> None:
        """Keeps the state where drives or forces are not smooth."""
        z, v = self.control.z.copy(), self.control.v.copy()
        for name in self.system.causes.get(t, ()):
            self.breaks.append(events.Moment(name, "break", t, z, v))

    def _remember(self) -> None:
        """Keeps the state at the end of a step when powers are to be integrated."""
        if self.history is not None:
            t = float(self.control.real[stepping.TIME])
            self.history.add(t, self.control.z, self.control.v)

    def _enter(self, begin: float, end: float) -> None:
        """Starts a smooth interval: no memory of steps before."""
        control, real = self.control, self.control.real
        real[stepping.TIME], real[stepping.STOP] = begin, end
        real[stepping.OLD_STEP] = 0.0
        real[stepping.FACTORED_STEP] = 0.0
        control.whole[stepping.NEEDS_JACOBIAN] = 1
        control.whole[stepping.PREDICT] = 0
        self.work.clock[0] = 0.5 * (begin + end)
        if self.settings.step is not None:
            count = max(1, int(np.ceil((end - begin) / self.settings.step - 1e-9)))
            real[stepping.STEP] = (end - begin) / count
        status = stepping.begin(
            self.kernels,
            self.system.arrays,
            self.work,
            self.memory,
            begin,
            control.z,
            control.v,
        )
        if status != 0:
            raise SimulationError(_singular(self.system, begin, status))

    def _failure(self, code: int) -> str:
        t = self.control.real[stepping.TIME]
        cause = _FAILURES.get(code, f"code {code}")
        worst = outputs.busiest_body(self.system, self.control)
        text = f"stopped at t = {t:.9g} s: {cause} (fastest change: {worst})"
        if self.system.redundant:
            rows = assembly.names_of_rows(self.system, self.system.redundant)
            names = ", ".join(dict.fromkeys(rows))
            text += f"; redundant at the start, perhaps contradicting now: {names}"
        return text

    def result(
        self,
        seconds: dict[str, float],
        failure: str,
        expected: Mapping[str, FlexibleBody],
    ) -> Result:
        t, z, v = self._recorded()
        recorded = outputs.record(
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
        bodies = reached_bodies(self.system, recorded.samples, t, expected)
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
            settings=self.settings.told(self.method),
            bodies=bodies,
            events=self._events(),
            scene=self.system.scene.model_dump_json(by_alias=True, exclude_none=True),
            versions=versions(),
            completed=not failure,
            message=_explained(failure, bodies) or self._end(),
        )

    def _recorded(self) -> tuple[Array, Array, Array]:
        """Times, z and v at the output times, and last where an event ended the run."""
        count = int(self.control.whole[stepping.OUTPUT])
        found = (self.times, self.control.out_z, self.control.out_v)
        if self.watch is None or not self.watch.ended:
            return found[0][:count], found[1][:count], found[2][:count]
        last = self.watch.moments[-1]
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


def _explained(failure: str, bodies: Mapping[str, FlexibleBody]) -> str:
    """The failure, and the bodies that deform without bound as its cause."""
    if not failure:
        return ""
    for name, body in bodies.items():
        for stage in (body.found, body.expected):
            if stage is not None and stage.diverges:
                failure += f"; {name} {stage.sentence()}"
                break
    return failure


def _singular(system: System, t: float, status: int) -> str:
    if status == 1:
        return (
            f"stopped at t = {t:.9g} s: the mass matrix of a body is singular; a body "
            "that can rotate needs inertia, a flexible one shape functions with mass"
        )
    return (
        f"stopped at t = {t:.9g} s: the constraints depend on each other here "
        "(singular position)"
    )


def _closed(system: System, settings: Settings) -> Array:
    """(2,) |c| and |dc/dt| below which constraints are met."""
    scene = system.scene
    near = min(max(CLOSED[0], 1e-6 * settings.rtol), CLOSED[1])
    still = CLOSED[0] / (scene.time.end - scene.time.start)
    return system.length * np.array([near, still])


def _new_control(
    system: System,
    settings: Settings,
    start: assembly.Start,
    times: Array,
    shares: Array,
    closed: Array,
) -> stepping.Control:
    scene = system.scene
    duration = scene.time.end - scene.time.start
    real, whole = np.zeros(stepping.N_REAL), np.zeros(stepping.N_WHOLE, np.int64)
    real[stepping.TOLERANCE] = STEP_TOLERANCE * settings.rtol
    real[stepping.LENGTH] = system.length
    real[stepping.PERIOD] = duration
    real[stepping.RADIUS] = settings.radius
    real[stepping.NEAR], real[stepping.STILL] = closed
    real[stepping.LARGEST] = 0.1 * duration
    real[stepping.STEP] = 1e-4 * duration * settings.rtol**0.25
    real[stepping.SPEED] = system.length / duration
    real[stepping.SPIN] = 1.0 / duration
    whole[stepping.FIXED_STEP] = int(settings.step is not None)
    n, m = system.n_positions, system.n_velocities
    count = len(times) + len(shares)
    amplitude, frequency = np.ones(m), np.ones(m)
    axes = 2 if system.planar else 3
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
        amplitude[elastic] = amplitudes(data.sid, axes)
        frequency[elastic] = frequencies(data.sid)
    return stepping.Control(
        real,
        whole,
        start.z.copy(),
        start.v.copy(),
        np.zeros(len(system.bodies)),
        amplitude,
        frequency,
        np.ones(n),
        np.ones(m),
        times,
        shares,
        np.zeros(len(shares)),
        np.zeros((count, n)),
        np.zeros((count, m)),
    )


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


def versions() -> dict[str, str]:
    """Versions of this program and of what computes under it."""
    packages = ("sidtool", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {p: _version(p) for p in packages}


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
