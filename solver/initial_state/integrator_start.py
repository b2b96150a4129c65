"""Settings of a run, and the initial state of its step loop."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile

from ..functions.piecewise import DEGREE, merge_features
from ..integrators import loop_state, singular_configurations
from ..integrators.registry import (
    AUTO,
    INTEGRATORS,
    IntegratorChoice,
    choose_integrator,
)
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from ..system.body_data import coordinate_frequencies
from ..system.characteristic_sizes import (
    body_extents,
    constraint_sizes,
    coordinate_amplitudes,
    friction_coordinate_sizes,
)
from ..system.rotated_markers import original_scene
from ..system.system import System
from ..system.work_arrays import evaluate, new_work_arrays
from .assembly import StateVectors, dense_jacobian
from .constraint_jacobian import normalised_rows

#: Constraints are met when they are open by less than this part of the size: at least
#: what rounding allows, at most what keeps the drift invisible.
CONSTRAINT_TOLERANCES = (1e-13, 1e-11)
#: Tolerance of a step in units of the requested relative error, for methods of high
#: order: the estimate is that of a lower one. Those of order 2 share it among steps.
STEP_TOLERANCE = 0.3
#: Largest relative tolerance of a step by the order of the method. Looser ones do not
#: save steps, which the convergence of Newton's iteration limits then, and the estimate
#: of the error fails: the founding scene takes 105 to 161 steps with radau13 at 1e-3
#: and at 1e-4, with errors of up to 12.9 and of 1.2 times these.
LARGEST_TOLERANCE = {13: 1e-4}
#: Radians (or sizes of the mechanism) in a run from which on errors of free motions add
#: up, and how many times at most, by the order of the method: the longer the steps are
#: the less such errors cancel. Measured with heavy tops of 25 to 300 turns.
ACCUMULATION, NO_ACCUMULATION = (
    {5: (60.0, 3.0), 9: (10.0, 30.0), 13: (4.0, 150.0)},
    (np.inf, 1.0),
)
#: Steps are not held to less than this part, near which rounding adds up instead.
MIN_REDUCED_TOLERANCE = 1e-11
#: Velocity coordinates up to which it is asked whether drives prescribe all motions.
MAX_TESTED_COORDINATES = 300


@dataclass(frozen=True)
class RunSettings:
    """How a run is made: integrator, relative tolerance, or a fixed step [s].

    Attributes
    ----------
    requested
        Integrator that was requested, perhaps "auto".
    when_stiff
        Integrator that goes on where the scene turns out to be stiff, or empty.
    radius
        Spectral radius at infinite frequency, of methods that have one.
    """

    requested: str
    integrator: str
    when_stiff: str
    rtol: float
    step: float | None
    radius: float

    @property
    def integrators(self) -> tuple[str, ...]:
        """Integrators that may be used."""
        return tuple(name for name in (self.integrator, self.when_stiff) if name)


def run_settings(
    system: System,
    integrator: str | None,
    rtol: float | None,
    step: float | None,
    radius: float | None,
) -> RunSettings:
    accuracy = system.scene.accuracy
    name = integrator or accuracy.integrator
    if name not in (AUTO, *INTEGRATORS):
        raise InputError(
            f"there is no integrator {name!r}",
            place="accuracy.integrator",
            expected=f"one of {', '.join((AUTO, *INTEGRATORS))}",
        )
    rtol = accuracy.rtol if rtol is None else rtol
    step = accuracy.step if step is None else step
    if system.drive_law_rows and name == "generalised_alpha" and step is None:
        raise InputError(
            "generalised_alpha takes drives with laws "
            f"({', '.join(system.drive_law_rows)}) in "
            "fixed steps alone: steps of its own would be far too many",
            place="accuracy.integrator",
            expected="a fixed step (accuracy.step, --step), or auto, radau5, radau9, "
            "radau13, trapezoidal or dop853",
        )
    if not 1e-13 <= rtol <= 0.1:
        raise InputError(f"rtol is {rtol:g}", expected="a number from 1e-13 to 0.1")
    if step is not None and not step > 0.0:
        raise InputError(f"step is {step:g}", expected="a positive number of seconds")
    radius = accuracy.spectral_radius if radius is None else radius
    if not 0.0 <= radius <= 1.0:
        raise InputError(f"spectral_radius is {radius:g}", expected="0 to 1")
    choice = (
        choose_integrator(system, rtol, step)
        if name == AUTO
        else IntegratorChoice(name)
    )
    return RunSettings(name, choice.first, choice.when_stiff, rtol, step, radius)


def scene_with_settings(scene: SceneFile, settings: RunSettings) -> str:
    """The scene as JSON, with the settings that a run was made with."""
    accuracy = scene.accuracy.model_copy(
        update={
            "integrator": settings.requested,
            "rtol": settings.rtol,
            "step": settings.step,
            "spectral_radius": settings.radius,
        }
    )
    scene_with_accuracy = original_scene(scene).model_copy(
        update={"accuracy": accuracy}
    )
    return scene_with_accuracy.model_dump_json(by_alias=True, exclude_none=True)


def constraint_tolerances(system: System, settings: RunSettings) -> Array:
    """(rows, 2) |c| and |dc/dt| below which constraints are met, then joints stick."""
    scene = system.scene
    position_tolerance = min(
        max(CONSTRAINT_TOLERANCES[0], 1e-6 * settings.rtol), CONSTRAINT_TOLERANCES[1]
    )
    rate_tolerance = CONSTRAINT_TOLERANCES[0] / (scene.time.end - scene.time.start)
    sizes = [system.cached(constraint_sizes), friction_coordinate_sizes(system)]
    return np.outer(np.concatenate(sizes), [position_tolerance, rate_tolerance])


def new_step_loop_state(
    system: System,
    settings: RunSettings,
    start: StateVectors,
    times: int,
    fractions: Array,
    tolerances: Array,
) -> loop_state.StepLoopState:
    """Parameters
    ----------
    times
        Output times that it holds, see `OutputTimeBuffer`.
    """
    scene = system.scene
    duration = scene.time.end - scene.time.start
    ends, starts, lengths, corners = system.cached(_feature_arrays)
    counts = times, len(fractions), len(starts)
    control = system.cached_by_topology(_state_maker, *counts)()
    shares_tolerance = (
        INTEGRATORS[settings.integrator].order == 2 and settings.step is None
    )
    order = INTEGRATORS[settings.integrator].order
    rtol = min(settings.rtol, LARGEST_TOLERANCE.get(order, np.inf))
    control.relative_tolerance = rtol * (1.0 if shares_tolerance else STEP_TOLERANCE)
    control.time = control.start_time = scene.time.start
    control.mechanism_length = system.length
    control.duration = duration
    control.spectral_radius = settings.radius
    control.singular_time = np.inf
    control.largest_step = 0.1 * duration
    control.rotation_step_limit = np.inf
    control.retry_fraction = loop_state.RETRY_FRACTION
    control.step = 1e-4 * duration * settings.rtol**0.25
    control.fixed_step = int(settings.step is not None)
    control.shares_tolerance = int(shares_tolerance)
    control.accumulation_radians, largest_accumulation = ACCUMULATION.get(
        order, NO_ACCUMULATION
    )
    control.max_reduction = min(
        largest_accumulation, max(1.0, settings.rtol / MIN_REDUCED_TOLERANCE)
    )
    control.errors_accumulate = int(_has_free_motion(system, start))
    control.z[:] = control.initial_position[:] = start.z
    control.v[:] = start.v
    control.extent[:] = body_extents(system)
    control.largest_velocity[:] = control.scale_z[:] = control.scale_v[:] = 1.0
    control.constraint_tolerance[:] = tolerances
    control.output_times[:] = np.inf
    control.output_fractions[:] = fractions
    control.feature_offsets[:] = ends
    control.feature_starts[:] = starts
    control.feature_corners[:] = corners
    control.feature_lengths[:] = piece_step_fraction(settings) * lengths
    for k, force in enumerate(system.forces):
        if (
            force.kind == at.ANGLE_MEASURE
            and force.rotation_entry >= system.n_rotation_counters
        ):
            control.force_measures[k, -1] = 2.0 * np.pi
    return control


def _has_free_motion(system: System, start: StateVectors) -> bool:
    """True if joints and drives leave a rigid motion of a body open at the start."""
    if not system.scene.drives or system.n_velocities > MAX_TESTED_COORDINATES:
        return True
    rigid = np.ones(system.n_velocities, bool)
    for row in system.arrays.body:
        rigid[row[at.VEL] + row[at.RD] : row[at.VEL] + row[at.NV]] = False
    work = new_work_arrays(system)
    work.interval_time[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    evaluate(system, work, system.scene.time.start, start.z, start.v)
    C = normalised_rows(dense_jacobian(system, work.C)[:, rigid])
    return int(np.linalg.matrix_rank(C, tol=1e-6)) < int(rigid.sum())


def _state_maker(
    system: System, times: int, shares: int, starts: int
) -> Callable[[], loop_state.StepLoopState]:
    """Makes controls of so many output times, shares and starts of features."""
    n, m, bodies = system.n_positions, system.n_velocities, len(system.bodies)
    forces, scaled = len(system.forces), n - system.n_rotation_counters
    return loop_state.StepLoopState.maker(
        z=(n,),
        v=(m,),
        initial_position=(n,),
        extent=(bodies,),
        largest_deformation=(bodies,),
        deformation_rates=(bodies, 4),
        amplitude=system.cached_by_topology(coordinate_amplitudes),
        frequency=_coordinate_frequencies_of(system),
        largest_velocity=(m,),
        scale_z=(scaled,),
        scale_v=(m,),
        constraint_tolerance=(system.n_rows + len(system.friction_joints), 2),
        output_times=(times,),
        output_fractions=(shares,),
        fraction_times=(shares,),
        output_z=(times + shares, n),
        output_v=(times + shares, m),
        feature_offsets=(2 * forces + 2,),
        feature_starts=(starts,),
        feature_lengths=(starts,),
        feature_corners=(starts,),
        force_measures=(forces, 5),
        passed_features=(2 * forces, 2),
        crossing_steps=(
            singular_configurations.MAX_CROSSINGS,
            singular_configurations.STEP_STATES + 2 * (n + m),
        ),
    )


def _coordinate_frequencies_of(system: System) -> Array:
    """Of elastic coordinates [rad/s], and 1 of others, (n velocities,)."""
    frequencies = np.ones(system.n_velocities)
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
        frequencies[elastic] = coordinate_frequencies(data.sid)
    return frequencies


def _feature_arrays(system: System) -> tuple[IntTable, Array, Array, Array]:
    """`StepLoopState.features`, starts, lengths and corners."""
    laws = [force.law for force in system.forces]
    parts = [merge_features(list(system.features.values()))]
    parts += [axis for law in laws for axis in (law.features(), law.rate_features())]
    ends = np.cumsum([0, *(len(part.starts) for part in parts)])
    starts, lengths = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("starts", "lengths")
    )
    corners = np.concatenate([np.isin(part.starts, part.corners) for part in parts])
    return ends.astype(np.int64), starts, lengths, corners.astype(float)


def piece_step_fraction(settings: RunSettings) -> float:
    """The part of a piece that a step may go: a method of low order needs more steps
    for what a polynomial of high degree follows."""
    return min(1.0, INTEGRATORS[settings.integrator].order / DEGREE)
