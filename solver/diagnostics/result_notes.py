"""Diagnostics of the recorded rows of a run."""

from collections.abc import Iterable, Iterator

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.base.stress import has_peak_nodes, stress_nodes
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import PEAK_STRESS, SceneFile, expand_names, parse_output
from sidtool.formats.text import counted_noun

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
from ..output.stick_slip import sticking_joints
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

    def diagnostics(
        self, outputs: Iterable[str] | None = None
    ) -> tuple[Diagnostic, ...]:
        """Return what has to be known of the rows (N232 to N234).

        Parameters
        ----------
        outputs
            Only their forces are looked at, default those of all joints.
        """
        return (
            *inactive_constraint_notes(self.system, self._widest),
            *undetermined_force_notes(self._told, self._undetermined, outputs),
            *self.undefined_notes(),
        )

    def undefined_notes(self) -> Iterator[Diagnostic]:
        """Outputs and multipliers that are not numbers (N234)."""
        if self._count:
            names = ", ".join(n for n in self._names if n in self._undefined)
            yield diagnose("N234", names, t=self._first, count=self._count)


def output_time_notes(scene: SceneFile, last: float) -> Iterator[Diagnostic]:
    """An output grid that misses the end of the run (N327)."""
    span = scene.time.end - scene.time.start
    is_grid = scene.time.output_times is None
    if is_grid and scene.time.end - last > EQUAL_TIME * span:
        yield diagnose("N327", last=last, end=scene.time.end)


def peak_stress_notes(system: System) -> Iterator[Diagnostic]:
    """Peaks over nodes that were not chosen where the stress is largest (N430)."""
    scene, sids = system.scene, system.sids
    bodies = {
        name: stress_nodes(sids[name])
        for name, body in scene.sid_bodies.items()
        if name in sids and not body.rigid and not has_peak_nodes(sids[name])
    }
    if not any(bodies.values()):
        return
    recorded = expand_names(scene.outputs.record, scene, sids)
    for name, nodes in bodies.items():
        if nodes and f"{name}.{PEAK_STRESS}" in recorded:
            yield diagnose("N430", name, count=len(nodes))


def callable_notes(system: System) -> Iterator[Diagnostic]:
    """Functions that a program gave instead of those of the scene (N328)."""
    for name, shortest in system.shortest_features.items():
        yield diagnose("N328", name, shortest=shortest)


def sampled_loop_notes(
    system: System, control: loop_state.StepLoopState, z: Array
) -> Iterator[Diagnostic]:
    """Laws that are sampled while what they act on runs away (N512).

    Parameters
    ----------
    z
        Positions at the start.
    """
    sampled = {e.name: float(e.sample_period) for e in system.forces if e.sample_period}
    growth, largest = np.abs(control.z - z), 0.0
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.is_scene_body:  # and no state of a law, which may be of any unit
            own = growth[row[at.POS] : row[at.POS] + row[at.NP]]
            largest = max(largest, float(own.max(initial=0.0)))
    if sampled and largest > RUNAWAY_SIZE * max(system.length, 1.0):
        periods = list(sampled.values())
        yield diagnose("N512", ", ".join(sampled), largest=largest, periods=periods)


def inactive_constraint_notes(system: System, largest: float) -> Iterator[Diagnostic]:
    """Constraints that contradict others by the rounding of data (N232).

    Parameters
    ----------
    largest
        How far they are open at most, relative to sizes.
    """
    if system.inactive_rows:
        yield diagnose(
            "N232",
            count=len(system.inactive_rows),
            residual=largest,
            substitution=substitution_text(system, system.inactive_rows),
        )


def _sticks(system: System) -> bool:
    """True if friction holds a joint at the end of a run."""
    if system.friction_history is None:
        return False
    return bool(sticking_joints(system.friction_history.current_states).any())


def rounding_notes(
    system: System, control: loop_state.StepLoopState, rtol: float, steps: int
) -> Iterator[Diagnostic]:
    """Motions so small against coordinates that rounding hides errors (N323, N324)."""
    rows = system.arrays.body[system.arrays.body[:, at.RD] > 0]
    if control.fixed_step == 1 or len(rows) == 0:
        return
    axes = 2 if system.planar else 3
    distance = np.abs(
        np.array([control.z[p : p + axes] for p in rows[:, at.POS]])
    ).max()
    span = max(system.length, float(distance))
    rounding = step_size.RESOLVED * step_size.ROUNDED * span
    motion = control.largest_motion
    turns = control.largest_rotation > ROTATION_ROUNDING  # of what has no extent
    if 0.0 < motion < rounding and not turns:
        free = _free_coordinates(system, control)
        count = counted_noun(free, "free coordinate")
        reason = f"no force acts along the {count}"
        remedy = "Give a force, gravity or an initial velocity."
        if free and _sticks(system):
            reason = "friction holds its joints"
            remedy = "Give a larger force, or less friction."
        elif not free:
            reason = "joints and drives leave no motion"
            remedy = "Free a joint, or move a drive."
        yield diagnose(
            "N324", rounding=rounding, reason=reason, remedy=remedy, free=free
        )
        return
    least = rounding * (steps if control.shares_tolerance == 1 else 1)
    if 0.0 < PROMISE_FACTOR * rtol * motion < least:
        yield diagnose("N323", rounding=least, rtol=rtol, motion=motion, size=span)


def _free_coordinates(system: System, control: loop_state.StepLoopState) -> int:
    """Velocity coordinates that the constraints leave free."""
    work, t = new_work_arrays(system), control.time
    work.interval_time[0] = float(system.clocks(np.array([t]))[0])
    work_arrays.evaluate(system, work, t, control.z, control.v)
    return system.n_velocities - _constraint_rank(system, work)


def _constraint_rank(system: System, work: WorkArrays) -> int:
    """How many coordinates the constraints take."""
    if system.n_rows >= sparse_jacobian.LARGE_SCENE_ROWS:
        sparse = sparse_jacobian.scaled_sparse_jacobian(system, work.C)
        rows = sparse_jacobian.IndependentRows(sparse)
        if rows.are_clear(0.0):
            return int(np.sum(~rows.dependent))
    C = dense_jacobian(system, work.C) * coordinate_sizes(system)
    return int(np.linalg.matrix_rank(C)) if C.size else 0


def skipped_feature_notes(
    system: System, control: loop_state.StepLoopState, settings: RunSettings
) -> Iterator[Diagnostic]:
    """Pulses and zones too narrow for the fixed steps that met them (N326)."""
    if settings.step is None:
        return
    share = piece_step_fraction(settings)
    until = control.time
    found: list[tuple[str, str, float, int, float]] = []
    for name, known in system.features.items():
        is_skipped = (share * OVERSHOOT * known.lengths < settings.step) & (
            known.starts < until
        )
        is_skipped[:-1] &= known.starts[1:] > system.scene.time.start
        if is_skipped.any():
            k = int(np.flatnonzero(is_skipped)[0])
            begin = max(float(known.starts[k]), system.scene.time.start)
            narrow, count = (
                float(known.lengths[is_skipped].min()),
                int(is_skipped.sum()),
            )
            found.append((name, "time", narrow, count, begin))
    for k, (count, last_time) in enumerate(control.passed_features):
        force = system.forces[k // 2]
        known = force.law.rate_features() if k % 2 else force.law.features()
        if count:
            what = "rate" if k % 2 else "deflection"
            narrow = float(known.lengths.min())
            found.append((force.name, what, narrow, int(count), float(last_time)))
    if found:
        names, quantities, lengths, counts, times = map(list, zip(*found, strict=True))
        yield diagnose(
            "N326",
            step=settings.step,
            features=[_feature_text(*each) for each in found],
            names=names,
            quantities=quantities,
            lengths=lengths,
            counts=counts,
            times=times,
        )


def _feature_text(name: str, quantity: str, length: float, count: int, t: float) -> str:
    """A pulse or a zone that steps may pass over, in words."""
    if quantity == "time":
        return f"{name} ({length:.3g} s long at t = {t:.6g} s)"
    times = "once" if count == 1 else f"{count} times"
    return f"{name} ({quantity} {length:.3g}, {times} from t = {t:.6g} s)"


def undetermined_force_notes(
    system: System, rows: Iterable[int], outputs: Iterable[str] | None = None
) -> Iterator[Diagnostic]:
    """Joints and drives whose forces the motion does not determine (N233).

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
        return
    count, others = len(system.redundant), [n for n in sharing if n not in reported]
    reason = "singular configuration"
    if count:
        reason = f"{count} redundant constraint" + ("s" if count > 1 else "")
    yield diagnose(
        "N233",
        ", ".join(reported),
        reason=reason,
        shared_with=others,
        redundant=count,
    )


def _is_reaction(name: object) -> bool:
    quantity = name.quantity  # type: ignore[attr-defined]
    numbered = quantity[:1] == "f" and (quantity[1:] == "*" or quantity[1:].isdigit())
    return quantity in COMPONENTS or numbered
