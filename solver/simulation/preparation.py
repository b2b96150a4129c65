"""Preparation of a run: its start, the plan of its outputs, and its arrays.

Each step gives one frozen object, from which the later ones are made:

- `prepare_run` : settings, consistent initial state, output times -> `RunStart`
- `plan_outputs` : what looks into the steps of the run -> `OutputPlan`
- `allocate` : work arrays, factors, state of the step loop -> `RunArrays`
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.result import Result
from sidtool.formats.scene import OutputTimes

from ..compiler import precompile
from ..diagnostics.run_summary import InitialisedSystem, initialise
from ..dynamics.equations_of_motion import kernel_pointers
from ..initial_state.assembly import StateVectors
from ..initial_state.integrator_start import (
    RunSettings,
    constraint_tolerances,
    new_step_loop_state,
)
from ..integrators.loop_state import StepLoopState
from ..integrators.registry import INTEGRATORS, Integrator
from ..linear.factor_storage import Kernels, Memory
from ..output import dense_output, events
from ..output.dense_output import OutputTimeBuffer, StepPoints
from ..output.energies import EnergyIntegrals, needs_energy_integrals
from ..output.events import StickSlipEvents
from ..output.resume import ResumeState, resume_state
from ..output.samples import StateSampler, needs_body_quantities
from ..output.stick_slip import with_friction_states
from ..spatial.system_arrays import WorkArrays
from ..system.sensors import OutputTimesAtSamples
from ..system.system import System
from ..system.work_arrays import new_memory, new_work_arrays

#: Steps between two reports of progress.
STEPS_PER_REPORT = 500


@dataclass(frozen=True, eq=False)
class RunStart:
    """What a run begins with.

    Attributes
    ----------
    settings : integrator, tolerance or fixed step
    initialised : the system at its start
    system : the same system, with a place for the states of friction joints
    diagnostics : of the scene, for the result
    resume : where an unfinished run ended, None for a new run
    times : output times
    tolerances : (rows,) largest residuals of the constraints
    """

    settings: RunSettings
    initialised: InitialisedSystem
    system: System
    diagnostics: Iterable[Diagnostic]
    resume: ResumeState | None
    times: OutputTimesAtSamples
    tolerances: Array

    @property
    def initial(self) -> StateVectors:
        """Positions and velocities that meet the constraints."""
        return self.initialised.start

    @cached_property
    def scene_diagnostics(self) -> tuple[Diagnostic, ...]:
        """`diagnostics`, which can be iterated once, for all who read them."""
        return tuple(self.diagnostics)

    @property
    def begin(self) -> StateVectors:
        """The state in which this run begins: the initial one, or that of `resume`."""
        return self.initial if self.resume is None else self.resume.start

    @cached_property
    def methods(self) -> list[Integrator]:
        """Integrators that may be used, the first one first."""
        return [INTEGRATORS[name] for name in self.settings.integrators]


def compile_kernels(system: System, settings: RunSettings) -> None:
    """Compile the kernels that a run needs, if they are not stored."""
    loops = [INTEGRATORS[name].step_loop for name in settings.integrators]
    needs_bodies = needs_body_quantities(system.scene)
    precompile.ensure_compiled(system.planar, loops, needs_bodies)


def prepare_run(
    system: System,
    settings: RunSettings,
    diagnostics: Iterable[Diagnostic],
    unfinished: Result | None,
) -> RunStart:
    """Find a consistent start, or the state in which an unfinished run ended.

    Raises
    ------
    InputError
        No start position meets the constraints, or the run cannot be resumed.
    """
    initialised = system.cached(initialise)
    resume = None
    if unfinished is not None:
        resume = resume_state(initialised.system, settings, unfinished)
    prepared = with_friction_states(initialised.system)
    return RunStart(
        settings=settings,
        initialised=initialised,
        system=prepared,
        diagnostics=diagnostics,
        resume=resume,
        times=OutputTimesAtSamples(prepared),
        tolerances=constraint_tolerances(prepared, settings),
    )


@dataclass(frozen=True, eq=False)
class OutputPlan:
    """What looks into the steps of a run, and at which points.

    Attributes
    ----------
    points : points of a step at which its dense output is evaluated
    event_detector : finds the events of the scene, None if there are none
    energy_integrals : dissipated and supplied energy, None if no output needs them
    stick_slip_events : changes of friction states, None without friction joints
    fractions : points that the step loop stores, see `StepLoopState`
    step_limit : steps of one call of the step loop
    looks_inside_steps : True if more than the ends of steps is needed
    """

    points: StepPoints
    event_detector: events.EventDetector | None
    energy_integrals: EnergyIntegrals | None
    stick_slip_events: StickSlipEvents | None
    fractions: Array
    step_limit: int
    looks_inside_steps: bool


def plan_outputs(start: RunStart) -> OutputPlan:
    """Choose what looks into the steps of a run: events, energies, friction."""
    system, settings, tolerances = start.system, start.settings, start.tolerances
    points = dense_output.step_points(max(m.dense_degree for m in start.methods))
    detector = integrals = stick_slip = None
    if system.scene.events:
        detector = events.EventDetector(system, tolerances, points)
    if needs_energy_integrals(system.scene):
        sums = None if start.resume is None else start.resume.energy_sums
        integrals = EnergyIntegrals(StateSampler(system, tolerances), points, sums)
    if system.friction_joints:
        stick_slip = StickSlipEvents(system, tolerances, points, settings.rtol)
    fractions, limit = np.zeros(0), STEPS_PER_REPORT
    inside = any(part is not None for part in (detector, integrals, stick_slip))
    if inside:
        limit = dense_output.STEPS_PER_CHUNK
        fractions = points.fractions_of_steps(limit)
    elif system.flexible:
        fractions = dense_output.end_fractions(fixed=settings.step is not None)
        limit = dense_output.ENDS_PER_CHUNK
    return OutputPlan(points, detector, integrals, stick_slip, fractions, limit, inside)


def plan_whole_steps(start: RunStart, count: int = 1) -> OutputPlan:
    """The plan of a motion that is advanced by so many steps each time, with all points
    of these.
    """
    plan = plan_outputs(start)
    return replace(plan, fractions=plan.points.fractions_of_steps(count))


@dataclass(frozen=True, eq=False)
class RunArrays:
    """Arrays of a run that its kernels write.

    Attributes
    ----------
    work : work arrays of the equations of motion
    memory : factors and accelerations
    kernels : addresses of the kernels of the equations of motion
    window : output times of the step loop
    control : state of the step loop at the begin of the run
    """

    work: WorkArrays
    memory: Memory
    kernels: Kernels
    window: OutputTimeBuffer
    control: StepLoopState


def allocate(
    start: RunStart, plan: OutputPlan, times: OutputTimes | Array
) -> RunArrays:
    """Allocate the arrays of a run, with the state in which it begins.

    Parameters
    ----------
    times : output times of the step loop [s]
    """
    system = start.system
    window = OutputTimeBuffer(times, system.n_positions + system.n_velocities)
    control = new_step_loop_state(
        system,
        start.settings,
        start.begin,
        window.size,
        plan.fractions,
        start.tolerances,
    )
    if start.resume is not None:
        control.time = control.start_time = start.resume.t
    return RunArrays(
        work=new_work_arrays(system),
        memory=new_memory(system, max(m.complex_pairs for m in start.methods)),
        kernels=kernel_pointers(system.planar),
        window=window,
        control=control,
    )
