"""States found by an analysis as a result."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, stop_message, without
from sidtool.formats.result import Result
from sidtool.formats.storage.hdf5_files import versions

from ..diagnostics.body_loads import find_state_warnings
from ..diagnostics.result_notes import OutputNotes, callable_notes
from ..initial_state.integrator_start import CONSTRAINT_TOLERANCES
from ..output import columns
from ..output.energies import integrals_between, needs_energy_integrals
from ..output.samples import StateSampler, sample_known_motion
from ..system.characteristic_sizes import constraint_sizes
from ..system.errors import SimulationError
from ..system.rotated_markers import original_scene
from ..system.system import System


@dataclass(frozen=True, eq=False)
class MotionState:
    """A state of motion: z_I, z_II, z_II', multipliers and friction forces."""

    z: Array
    v: Array
    a: Array
    multipliers: Array
    friction: Array


def result_of_states(
    system: System,
    kind: str,
    times: Array,
    states: Sequence[MotionState],
    failure: Sequence[Diagnostic] = (),
    diagnostics: Sequence[Diagnostic] = (),
) -> Result:
    """The scene's outputs at some states, as a result.

    Parameters
    ----------
    failure
        Why later states are missing, if they are.

    Raises
    ------
    SimulationError
        An output is not a number.
    """
    count = len(states)
    z, v, a, multipliers, friction = (
        np.array([getattr(s, part) for s in states]).reshape(count, size)
        for part, size in (
            ("z", system.n_positions),
            ("v", system.n_velocities),
            ("a", system.n_velocities),
            ("multipliers", system.n_rows),
            ("friction", len(system.friction_joints)),
        )
    )
    span = system.scene.time.end - system.scene.time.start
    tolerances = (
        np.outer(constraint_sizes(system), [1.0, 1.0 / span]) * CONSTRAINT_TOLERANCES[0]
    )
    sampler, history = StateSampler(system, tolerances), None
    if needs_energy_integrals(system.scene):
        history = integrals_between(sampler, times, z, v)
    known = sample_known_motion(
        system, sampler.work, times, z, v, a, multipliers, friction
    )
    outputs_ = columns.evaluate_outputs(sampler, times, z, v, history, known)
    remarks = OutputNotes(system)
    remarks.add(times, outputs_)
    for undefined in remarks.undefined_notes():
        raise SimulationError(undefined)
    found = (
        *failure,
        *find_state_warnings(system, z),
        *diagnostics,
        *callable_notes(system),
        *remarks.diagnostics(),
    )
    return Result(
        title=system.scene.title,
        names=outputs_.names,
        t=times,
        values=outputs_.values,
        positions=z,
        velocities=v,
        multipliers=outputs_.multipliers,
        position_names=columns.position_names(system),
        velocity_names=columns.velocity_names(system),
        multiplier_names=columns.multiplier_names(system),
        settings={"analysis": kind},
        scene=original_scene(system.scene).model_dump_json(
            by_alias=True, exclude_none=True
        ),
        sids=system.sids,
        versions=versions(),
        diagnostics=without(found, system.scene.diagnostics.ignore),
        completed=not failure,
        message=stop_message(failure),
    )


def with_failure(result: Result, failure: Sequence[Diagnostic]) -> Result:
    """A result whose numbers mean nothing, and why."""
    found = without((*failure, *result.diagnostics), ())
    message = stop_message(failure)
    return replace(result, completed=False, message=message, diagnostics=found)
