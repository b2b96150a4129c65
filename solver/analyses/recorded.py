"""States that an analysis found, as a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sidtool.formats.result import Result
from sidtool.formats.sid import Array
from sidtool.formats.storage.versions import versions

from ..advice.body_measures import find_state_warnings
from ..advice.notes import Remarks, of_programs
from ..errors import SimulationError
from ..recording import outputs
from ..recording.energy_history import history_between, is_wanted
from ..recording.sampling import Sampler, sample_known
from ..start.new_control import CLOSED
from ..system.bodies.turned_markers import as_written
from ..system.scene import System
from ..system.sizes import row_sizes


@dataclass(frozen=True, eq=False)
class Found:
    """A state of motion: z_I, z_II, z_II', multipliers and forces of friction."""

    z: Array
    v: Array
    a: Array
    multipliers: Array
    friction: Array


def recorded(
    system: System,
    kind: str,
    times: Array,
    states: Sequence[Found],
    message: str = "",
    notes: Sequence[str] = (),
) -> Result:
    """The scene's outputs at some states, as a result.

    message : why later states are missing, if they are

    Raises
    ------
    SimulationError : an output is not a number.
    """
    count = len(states)
    z, v, a, multipliers, friction = (
        np.array([getattr(s, part) for s in states]).reshape(count, size)
        for part, size in (
            ("z", system.n_positions),
            ("v", system.n_velocities),
            ("a", system.n_velocities),
            ("multipliers", system.n_rows),
            ("friction", len(system.rubbing)),
        )
    )
    span = system.scene.time.end - system.scene.time.start
    closed = np.outer(row_sizes(system), [1.0, 1.0 / span]) * CLOSED[0]
    sampler, history = Sampler(system, closed), None
    if is_wanted(system.scene):
        history = history_between(sampler, times, z, v)
    known = sample_known(system, sampler.work, times, z, v, a, multipliers, friction)
    found = outputs.record(sampler, times, z, v, history, known)
    remarks = Remarks(system)
    remarks.add(times, found)
    undefined = remarks.undefined()
    if undefined:
        raise SimulationError(undefined[0])
    warnings = find_state_warnings(system, z)
    told = (*warnings, *notes, *of_programs(system), *remarks.sentences())
    return Result(
        title=system.scene.title,
        names=found.names,
        t=times,
        values=found.values,
        positions=z,
        velocities=v,
        multipliers=found.multipliers,
        position_names=outputs.position_names(system),
        velocity_names=outputs.velocity_names(system),
        multiplier_names=outputs.multiplier_names(system),
        settings={"analysis": kind},
        scene=as_written(system.scene).model_dump_json(
            by_alias=True, exclude_none=True
        ),
        sids=system.sids,
        versions=versions(),
        notes=tuple(dict.fromkeys(told)),
        warnings=warnings,
        completed=not message,
        message=message,
    )
