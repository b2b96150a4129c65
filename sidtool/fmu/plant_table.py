"""All tables and arrays of a unit as one table, the plant.

C sees the same table as a structure (`c_source`). A copy of it, with all that it
refers to, is an instance of the unit (`c_source`).
"""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import Event, SceneFile
from sidtool.solver.compiler.tables import Table, TableType
from sidtool.solver.initial_state.integrator_start import (
    RunSettings,
)
from sidtool.solver.initial_state.overconstraint import restore_constraints
from sidtool.solver.integrators import output_sampling, radau_stages
from sidtool.solver.integrators.loop_state import StepLoopState
from sidtool.solver.integrators.radau_stages import RadauStages
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.linear.factor_storage import Kernels, Memory
from sidtool.solver.output.samples import StateSampler, new_output_arrays, output_work
from sidtool.solver.simulation.preparation import (
    RunStart,
    allocate,
    plan_whole_steps,
    prepare_run,
)
from sidtool.solver.spatial.system_arrays import (
    Integers2,
    OutputArrays,
    Reals,
    Reals2,
    Reals3,
    SystemArrays,
    WorkArrays,
)
from sidtool.solver.system.system import System


class Plant(Table):
    """State of an instance, and what it calls kernels with.

    Attributes
    ----------
    now
        Communication point: time of the outputs [s].
    interval_start, interval_end
        Smooth interval of the step at hand [s]; a new one begins at each break.
    last_sample_time
        Time at which sampled laws were asked last [s].
    must_restart
        1 if the step loop has to begin anew at `now`, as an input jumped.
    outputs_known
        1 if the arrays from `frames` on belong to `now`.
    kernels, system, work, memory, control, stages
        Arguments of the step loop, see `sidtool.solver.integrators`.
    sampler_work, sampler_memory
        What `sample` writes beside its outputs.
    output_system, output_work, output
        Arguments of the kernels of forces and energies.
    constraint_tolerance, interval, time, interval_time, step_z, step_v, row_blocks
    row_sizes, multiplier_sizes, largest_multiplier
        Arguments of `sample` and of the kernels of forces.
    z, v, frames, points, accelerations, multipliers, factors, friction
        State at `now` and what follows from it, see `Samples`.
    friction_forces
        Forces along coordinates with friction.
    input_goals, input_values
        Values that inputs were set to, and those at `now`.
    ending_event
        1 and the number of the event that has ended the motion, or 0.
    event_sides, event_sizes, event_counts
        Of events that end the motion: 1 above the value and -1 below, largest magnitude
        of the quantity, and how often it crossed the value.
    """

    now: float
    interval_start: float
    interval_end: float
    last_sample_time: float
    must_restart: int
    outputs_known: int
    ending_event: int
    kernels: Kernels
    system: SystemArrays
    work: WorkArrays
    memory: Memory
    control: StepLoopState
    stages: RadauStages
    sampler_work: WorkArrays
    sampler_memory: Memory
    output_system: SystemArrays
    output_work: WorkArrays
    output: OutputArrays
    constraint_tolerance: Reals2
    interval: Reals
    time: Reals
    interval_time: Reals
    step_z: Reals2
    step_v: Reals2
    z: Reals2
    v: Reals2
    frames: Reals3
    points: Reals3
    accelerations: Reals2
    multipliers: Reals2
    factors: Reals2
    friction: Reals3
    friction_forces: Reals2
    row_blocks: Integers2
    row_sizes: Reals
    multiplier_sizes: Reals
    largest_multiplier: Reals
    input_goals: Reals
    input_values: Reals
    event_sides: Reals
    event_sizes: Reals
    event_counts: Reals


PLANT = TableType(Plant)


@dataclass(frozen=True, eq=False)
class PlantTables:
    """The plant of a scene at its start.

    Attributes
    ----------
    start : settings and initial state
    system : the system that is integrated
    output_system : the same with all constraints, whose forces are reported
    """

    start: RunStart
    system: System
    output_system: System
    plant: Plant


def ending_events(scene: SceneFile) -> dict[str, Event]:
    """Events that end the motion, by name."""
    events = scene.events.items()
    return {name: event for name, event in events if event.action == "stop"}


def plant_tables(system: System, settings: RunSettings) -> PlantTables:
    """Allocate the tables of a unit, at the initial state of its scene.

    Raises
    ------
    InputError : no initial state meets the constraints.
    """
    start = prepare_run(system, settings, (), None)
    method, system = INTEGRATORS[settings.integrator], start.system
    n, m = system.n_positions, system.n_velocities
    run = allocate(start, plan_whole_steps(start), np.zeros(0))
    control = run.control
    sampler = StateSampler(system, start.tolerances)
    full = restore_constraints(system)
    frame, point = sampler.work.frame.shape, sampler.work.point.shape
    n_friction = len(system.friction_joints)
    arrays = {
        "interval": (2,),
        "time": (1,),
        "interval_time": (1,),
        "step_z": (1, n),
        "step_v": (3, m),
        "z": (1, n),
        "v": (1, m),
        "frames": (1, *frame),
        "points": (1, *point),
        "accelerations": (1, m),
        "multipliers": (1, system.n_rows),
        "factors": (1, len(system.forces)),
        "friction": (1, n_friction, output_sampling.N_FRICTION_OUTPUT),
        "friction_forces": (1, n_friction),
        "row_sizes": (system.n_rows,),
        "multiplier_sizes": (1,),
        "largest_multiplier": (1,),
        "input_goals": (len(system.scene.inputs),),
        "input_values": (len(system.scene.inputs),),
    }
    n_events = len(ending_events(system.scene))
    arrays |= {
        "event_sides": (n_events,),
        "event_sizes": (n_events,),
        "event_counts": (n_events,),
    }
    plant = Plant(
        now=control.time,
        interval_start=control.time,
        interval_end=system.breaks[0],
        last_sample_time=-np.inf,
        must_restart=1,
        kernels=run.kernels,
        system=system.arrays,
        work=run.work,
        memory=run.memory,
        control=control,
        stages=system.cached_by_topology(
            radau_stages.stages_maker, method.dense_degree
        )(),
        sampler_work=sampler.work,
        sampler_memory=sampler.memory,
        output_system=full.output_rows,
        output_work=output_work(full, sampler.work),
        output=new_output_arrays(full, 1),
        constraint_tolerance=np.ascontiguousarray(start.tolerances),
        row_blocks=np.zeros((2, system.n_rows), np.int64),
        **{name: np.zeros(shape) for name, shape in arrays.items()},
    )
    initial = [signal.initial for signal in system.scene.inputs.values()]
    plant.event_sizes[:] = [abs(e.value) for e in ending_events(system.scene).values()]
    plant.input_goals[:] = plant.input_values[:] = initial
    return PlantTables(start, system, full, plant)
