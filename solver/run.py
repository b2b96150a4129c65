"""A run: from a compiled scene to a result."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from itertools import chain

from sidtool.formats.result import FlexibleBody, InMemory, Result, Sink

from . import warmup
from .account import may_leave_theory, result_of, why_failed
from .advice.prepared import Prepared, prepare
from .errors import SimulationError
from .integrators import INTEGRATORS
from .recording.resuming import past_of
from .recording.told import tells_of_bodies
from .running import Progress, Run
from .start.settings import settings_of
from .system.scene import System

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
    tell: Callable[[str], None] | None = None,
    told: Iterable[str] = (),
    into: Sink | None = None,
    stop: Callable[[], str] | None = None,
    warn: Callable[[str], None] | None = None,
    unfinished: Result | None = None,
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
    tell : called before the first step with what is to be asked or known of the scene
    told : sentences for the notes of the result
    into : takes the rows of the result while the run goes on, and the result at its
        end, whose tables are then empty; default they are kept in memory
    stop : asked from time to time why the run is to end before its time, if at all
    warn : called after the run with each of the warnings of the result that a large
        deformation is the cause of
    unfinished : a run of this scene and these settings that stopped, or that is
        complete to an earlier end; this one goes on from its last state, and its result
        is that of both

    Raises
    ------
    InputError : unknown integrator, or no start position meets the constraints.
    SimulationError : the run stopped early, or a body deformed by more than its own
        size, so that its numbers mean nothing; `result` holds what was computed.
    """
    settings = settings_of(system, integrator, rtol, step, spectral_radius)
    loops = [INTEGRATORS[name].step_loop for name in settings.possible]
    warmup.ensure(system.planar, loops, tells_of_bodies(system.scene))
    began = time.perf_counter()
    ready = announced(system, foresee, tell)
    kept = InMemory()
    told = chain(system.told, told)
    past = None if unfinished is None else past_of(ready.system, settings, unfinished)
    run = Run(ready, settings, told, into or kept, past)
    assembled = time.perf_counter()
    failure = run.go(progress, stop)
    solved = time.perf_counter() - assembled - run.recorder.seconds
    run.end(bool(failure))
    failure = why_failed(run, failure)
    seconds = {"seconds_assembly": assembled - began, "seconds": solved}
    result = result_of(run, seconds, failure, kept.arrays() if into is None else {})
    if past is not None:
        result = past.joined(result)
    if into is not None:
        into.finish(result)
    if warn is not None and may_leave_theory(run):
        for text in result.warnings:
            warn(text)
    if failure:
        raise SimulationError(result.message, result)
    return result


def announced(
    system: System, foresee: Foresee | None, tell: Callable[[str], None] | None
) -> Prepared:
    """What a run begins with, said as `simulate` does before it."""
    ready = system.once(prepare)
    if tell is not None:
        for sentence in ready.asked:
            tell(sentence)
    if foresee is not None:
        foresee(ready.expected)
    return ready
