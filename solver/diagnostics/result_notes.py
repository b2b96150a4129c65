"""Notes on the recorded rows of a run."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.base.stress import has_peak_nodes, stress_nodes
from sidtool.formats.scene import PEAK_STRESS, SceneFile, expand_names, parse_output

from ..initial_state import sparse_jacobian
from ..initial_state.constraint_jacobian import dense_jacobian, row_names
from ..initial_state.integrator_start import RunSettings, piece_step_fraction
from ..initial_state.overconstraint import (
    largest_residual_of_removed,
    substitution_text,
)
from ..integrators import loop_state, step_size
from ..integrators.step_limits import OVERSHOOT
from ..output.columns import RecordedOutputs, multiplier_names
from ..output.reactions import COMPONENTS
from ..spatial import system_arrays as at
from ..spatial.system_arrays import WorkArrays
from ..system import work_arrays
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System
from ..system.work_arrays import new_work_arrays

#: Times are the same when they differ by less than this part of the time span.
EQUAL_TIME = 1e-9
#: Sizes of the mechanism that no coordinate of a controlled one passes.
RUNAWAY_SIZE = 1e6
#: Errors within so many times the requested one keep the promise.
PROMISE_FACTOR = 10.0
#: Turns from which on radau13 does not keep a relative tolerance above the second.
MANY_TURNS, MAX_RADAU13_TOLERANCE = 20.0, 1e-4
#: Rotations below this are rounding [rad].
ROTATION_ROUNDING = 1e-12


class OutputNotes:
    """What has to be known of recorded rows, block by block."""

    def __init__(self, system: System) -> None:
        self.system, self._told = system, system
        self._widest = 0.0
        self._undetermined: set[int] = set()
        self._undefined: set[str] = set()
        self._names: tuple[str, ...] = ()
        self._first, self._count = 0.0, 0

    def add(self, t: Array, recorded: RecordedOutputs) -> None:
        """What was recorded at the times t (nt,)."""
        z, v = recorded.samples.z, recorded.samples.v
        if self.system.inactive_rows:
            widest = largest_residual_of_removed(self.system, t, z, v)
            self._widest = max(self._widest, widest)
        self._told = recorded.system
        self._undetermined.update(recorded.undetermined)
        self._names = (*recorded.names, *multiplier_names(self.system))
        values = np.hstack([recorded.values, recorded.multipliers])
        missing = ~np.isfinite(values)
        missing_times = t[missing.any(axis=1)]
        if len(missing_times):
            self._first = self._first if self._count else float(missing_times[0])
            self._count += len(missing_times)
            columns = zip(self._names, np.any(missing, axis=0).tolist(), strict=True)
            self._undefined.update(name for name, bad in columns if bad)

    def sentences(self, outputs: Iterable[str] | None = None) -> tuple[str, ...]:
        """Parameters
        ----------
        outputs
            Only their forces are spoken of, default those of all joints.
        """
        return (
            *inactive_constraint_notes(self.system, self._widest),
            *undetermined_force_notes(self._told, self._undetermined, outputs),
            *self.undefined_notes(),
        )

    def undefined_notes(self) -> list[str]:
        """Of outputs and multipliers that are not numbers."""
        if not self._count:
            return []
        names = ", ".join(n for n in self._names if n in self._undefined)
        more = f" and at {self._count - 1} other times" if self._count > 1 else ""
        return [
            f"{names} could not be computed at t = {self._first:.9g} s{more}:"
            " the constraints depend on each other there (singular configuration)"
        ]


def output_time_notes(scene: SceneFile, last: float) -> list[str]:
    """Of an output grid that misses the end of the run."""
    span = scene.time.end - scene.time.start
    if (
        scene.time.output_times is not None
        or scene.time.end - last <= EQUAL_TIME * span
    ):
        return []
    return [
        f"the last output time is {last:g} s and not the end, "
        f"{scene.time.end:g} s: output_step does not divide the time span"
    ]


def peak_stress_notes(system: System) -> list[str]:
    """Of peaks over nodes that nobody chose where the stress is largest."""
    scene, sids = system.scene, system.sids
    bodies = {
        name: stress_nodes(sids[name])
        for name, body in scene.sid_bodies.items()
        if name in sids and not body.rigid and not has_peak_nodes(sids[name])
    }
    if not any(bodies.values()):
        return []
    recorded = expand_names(scene.outputs.record, scene, sids)
    return [
        f"{name}.{PEAK_STRESS} is the largest stress of {len(nodes)} nodes, not known "
        "to be the peak of the body: convert its model without peak_points = 0"
        for name, nodes in bodies.items()
        if nodes and f"{name}.{PEAK_STRESS}" in recorded
    ]


def callable_notes(system: System) -> list[str]:
    """Of functions that a program gave instead of those of the scene."""
    return [
        f"{name}: given by a program, of which only values can be seen; what lasts "
        f"less than {shortest:.3g} s may be missed. The result keeps what was seen"
        for name, shortest in system.shortest_features.items()
    ]


def sampled_loop_notes(
    system: System, control: loop_state.StepLoopState, z: Array
) -> list[str]:
    """Of laws that are sampled while what they act on runs away.

    Parameters
    ----------
    z
        Positions at the start.
    """
    sampled = {e.name: e.sample_period for e in system.forces if e.sample_period}
    largest = float(np.abs(control.z - z).max(initial=0.0))
    if not sampled or not largest > RUNAWAY_SIZE * max(system.length, 1.0):
        return []
    laws = ", ".join(f"{name} every {step:.3g} s" for name, step in sampled.items())
    return [
        f"coordinates grew to {largest:.2g}: a loop of the laws that are sampled "
        f"({laws}) looks unstable; smaller gains or a shorter sample_time may hold it"
    ]


def inactive_constraint_notes(system: System, largest: float) -> list[str]:
    """Of constraints that contradict others by the rounding of data.

    Parameters
    ----------
    largest
        How far they are open at most, relative to sizes.
    """
    if not system.inactive_rows:
        return []
    count = len(system.inactive_rows)
    follow = "constraint follows" if count == 1 else "constraints follow"
    return [
        f"the mechanism is over-constrained: {count} {follow} from the others but for "
        f"the rounding of the data, which leaves them open by up to {largest:.1e} of "
        "its size; it moves without them. The same without contradiction: "
        f"{substitution_text(system, system.inactive_rows)}"
    ]


def rounding_notes(
    system: System, control: loop_state.StepLoopState, rtol: float, steps: int
) -> list[str]:
    """Of motions that are so small against coordinates that rounding hides errors."""
    rows = system.arrays.body[system.arrays.body[:, at.RD] > 0]
    if control.fixed_step == 1 or len(rows) == 0:
        return []
    axes = 2 if system.planar else 3
    distance = np.abs(
        np.array([control.z[p : p + axes] for p in rows[:, at.POS]])
    ).max()
    span = max(system.length, float(distance))
    rounding = step_size.RESOLVED * step_size.ROUNDED * span
    motion = control.largest_motion
    turns = control.largest_rotation > ROTATION_ROUNDING  # of what has no extent
    if 0.0 < motion < rounding and not turns:
        return [
            f"nothing moves by more than rounding of coordinates, {rounding:.0e} m: "
            f"{_rest_cause(system, control)}"
        ]
    least = rounding * (steps if control.shares_tolerance == 1 else 1)
    if not 0.0 < PROMISE_FACTOR * rtol * motion < least:
        return []
    return [
        f"motions of {motion:.1g} m are small against coordinates of {span:.3g} m: "
        f"rounding hides errors below {least:.0e} m, and rtol = {rtol:g} is not "
        "promised; put the origin near to the motion, or ask for less"
    ]


def _rest_cause(system: System, control: loop_state.StepLoopState) -> str:
    """What keeps a scene where it is."""
    work, t = new_work_arrays(system), control.time
    work.interval_time[0] = float(system.clocks(np.array([t]))[0])
    work_arrays.evaluate(system, work, t, control.z, control.v)
    rank = _constraint_rank(system, work)
    if rank == system.n_velocities:
        return "joints and drives leave no motion"
    free = system.n_velocities - rank
    return f"no force acts along the {free} coordinates that joints and drives leave"


def _constraint_rank(system: System, work: WorkArrays) -> int:
    """How many coordinates the constraints take."""
    if system.n_rows >= sparse_jacobian.LARGE_SCENE_ROWS:
        sparse = sparse_jacobian.scaled_sparse_jacobian(system, work.C)
        rows = sparse_jacobian.IndependentRows(sparse)
        if rows.are_clear(0.0):
            return int(np.sum(~rows.dependent))
    C = dense_jacobian(system, work.C) * coordinate_sizes(system)
    return int(np.linalg.matrix_rank(C)) if C.size else 0


def rotation_error_notes(
    control: loop_state.StepLoopState, settings: RunSettings
) -> list[str]:
    """Of rotations in which what Newton's iteration leaves of long steps adds up."""
    turns = float(control.largest_angular_velocity * control.duration)
    turns /= 2.0 * np.pi
    is_loose = settings.rtol > MAX_RADAU13_TOLERANCE and settings.step is None
    free = control.errors_accumulate == 1
    if (
        settings.integrator != "radau13"
        or not (is_loose and free)
        or turns < MANY_TURNS
    ):
        return []
    return [
        f"radau13 takes so long steps that errors add up over {turns:.0f} turns: "
        f"rtol = {settings.rtol:g} is not promised; radau9 keeps it, and so does "
        f"rtol = {MAX_RADAU13_TOLERANCE:g}"
    ]


def skipped_feature_notes(
    system: System, control: loop_state.StepLoopState, settings: RunSettings
) -> list[str]:
    """Of pulses and zones that were too narrow for the fixed steps that met them."""
    if settings.step is None:
        return []
    share = piece_step_fraction(settings)
    until, notes = control.time, []
    for name, known in system.features.items():
        is_skipped = (share * OVERSHOOT * known.lengths < settings.step) & (
            known.starts < until
        )
        is_skipped[:-1] &= known.starts[1:] > system.scene.time.start
        if is_skipped.any():
            k = int(np.flatnonzero(is_skipped)[0])
            begin = max(float(known.starts[k]), system.scene.time.start)
            narrow = known.lengths[is_skipped].min()
            notes.append(f"{name} changes within {narrow:.3g} s (t = {begin:.6g} s)")
    for k, (count, last_time) in enumerate(control.passed_features):
        force = system.forces[k // 2]
        known = force.law.rate_features() if k % 2 else force.law.features()
        if count:
            what = "rate" if k % 2 else "deflection"
            notes.append(
                f"{force.name} changes within {known.lengths.min():.3g} of its {what}, "
                f"passed {_count_text(int(count))} (first after t = {last_time:.6g} s)"
            )
    if not notes:
        return []
    return [
        f"fixed steps of {settings.step:.3g} s met what is narrower and may have "
        f"passed it unseen: {'; '.join(notes)}; steps with error control look at it"
    ]


def _count_text(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def undetermined_force_notes(
    system: System, rows: Iterable[int], outputs: Iterable[str] | None = None
) -> list[str]:
    """Of joints and drives that share loads in a way that the motion leaves open.

    Parameters
    ----------
    system, rows
        The scene whose joint forces are reported, and its constraint rows that the
        motion does not determine.
    """
    sharing = sorted(set(row_names(system, tuple(sorted(rows)))))
    reported = sharing
    if outputs is not None:
        owners = {
            name.owner for name in map(parse_output, outputs) if _is_reaction(name)
        }
        reported = [name for name in sharing if name in owners]
    if not reported:
        return []
    count, others = len(system.redundant), [n for n in sharing if n not in reported]
    why = "their constraints depend on each other in this configuration"
    if count:
        follow = "follows" if count == 1 else "follow"
        why = "the mechanism is over-constrained, "
        why += f"{count} of its constraints {follow} from others"
    shared = f", shared with {', '.join(others)}" if others else ""
    return [
        f"the forces of {', '.join(reported)} are not determined{shared}: {why}; "
        "recorded "
        "are the smallest ones that hold it, real ones depend on stiffness and fit"
    ]


def _is_reaction(name: object) -> bool:
    quantity = name.quantity  # type: ignore[attr-defined]
    numbered = quantity[:1] == "f" and (quantity[1:] == "*" or quantity[1:].isdigit())
    return quantity in COMPONENTS or numbered
