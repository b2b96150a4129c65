"""Simulation run: from a compiled scene to a result."""

import time
from collections.abc import Callable, Iterable
from itertools import chain

from sidtool.formats.diagnostics import Diagnostic, without
from sidtool.formats.result import InMemory, Result, Sink

from ..diagnostics.run_summary import initialise
from ..initial_state.integrator_start import run_settings
from ..system.errors import SimulationError
from ..system.system import System
from .preparation import allocate, compile_kernels, plan_outputs, prepare_run
from .recorder import Recorder
from .result import (
    build_result,
    find_warnings,
    may_exceed_linear_theory,
    meaningless_numbers,
    stop_causes,
)
from .run_loop import Progress, Run

DiagnosticCallback = Callable[[Diagnostic], None]


def simulate(
    system: System,
    *,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    spectral_radius: float | None = None,
    progress: Progress | None = None,
    report_diagnostic: DiagnosticCallback | None = None,
    diagnostics: Iterable[Diagnostic] = (),
    into: Sink | None = None,
    stop: Callable[[], str] | None = None,
    emit_warning: DiagnosticCallback | None = None,
    all_warnings: bool = False,
    unfinished: Result | None = None,
) -> Result:
    """Integrates a compiled scene over its time span.

    Parameters
    ----------
    integrator
        Name in `sidtool.solver.integrators.INTEGRATORS` or "auto", default as in the
        scene.
    rtol
        Tolerated error relative to the largest motion, default as in the scene.
    step
        Fixed step [s]; replaces the error control.
    spectral_radius
        Of generalised_alpha, 0 to 1, default as in the scene.
    progress
        Called with the simulated time [s] from time to time.
    report_diagnostic
        Called before the first step with each diagnostic of the scene.
    diagnostics
        Of the scene, for the result.
    into
        Takes the rows of the result while the run goes on, and the result at its end,
        whose tables are then empty; default they are kept in memory.
    stop
        Asked from time to time why the run is to end before its time, if at all.
    emit_warning
        Called after the run with each of the warnings of the result, if a body may
        have left linear theory; they take time to compute.
    all_warnings
        It is called after all runs that were finished instead, and after no others.
    unfinished
        A run of this scene and these settings that stopped, or that is complete to an
        earlier end; this one goes on from its last state, and its result is that of
        both.

    Raises
    ------
    InputError
        Unknown integrator, or no start position meets the constraints.
    SimulationError
        The run stopped early, or a body deformed by more than its own size, so that its
        numbers mean nothing; `result` holds what was computed.
    """
    settings = run_settings(system, integrator, rtol, step, spectral_radius)
    compile_kernels(system, settings)
    started = time.perf_counter()
    report_implausible_inputs(system, report_diagnostic)
    start = prepare_run(
        system, settings, chain(system.diagnostics, diagnostics), unfinished
    )
    plan = plan_outputs(start)
    arrays = allocate(start, plan, start.times)
    memory_sink = InMemory()
    recorder = Recorder(start, plan.energy_integrals, into or memory_sink)
    run = Run(start, plan, arrays, recorder)
    assembled = time.perf_counter()
    stopped = run.integrate(progress, stop)
    solved = time.perf_counter() - assembled - recorder.seconds
    failure = () if stopped is None else stop_causes(run, stopped)
    run.finish(failed=stopped is not None)
    failure = failure or meaningless_numbers(run)
    seconds = {"seconds_assembly": assembled - started, "seconds": solved}
    result = build_result(
        run, seconds, failure, memory_sink.arrays() if into is None else {}
    )
    if start.resume is not None:
        result = start.resume.join(result)
    if into is not None:
        into.finish(result)
    emits = not failure if all_warnings else may_exceed_linear_theory(run)
    if emit_warning is not None and emits:
        for diagnostic in find_warnings(run, result):
            emit_warning(diagnostic)
    if failure:
        raise SimulationError(failure, result)
    return result


def report_implausible_inputs(
    system: System, report_diagnostic: DiagnosticCallback | None
) -> None:
    """Report what is implausible in a scene before it is run."""
    if report_diagnostic is not None:
        found = system.cached(initialise).implausible_inputs
        for each in without(found, system.scene.diagnostics.ignore):
            report_diagnostic(each)
