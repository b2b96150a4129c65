"""Points of a study: cost, error, Pareto front, recommendation.

Reference motion of a study, and errors relative to it.

The error of a run is its greatest difference to the reference at the output times,
relative to the variation of each output in the run. The uncertainty of the reference
follows from its changes with the integrator, the mesh and the number of modes. If an
event ends the runs, it ends all of them at almost the same time; this is the last time
that is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import unit_of

from .outputs import MAX_REPEATS, RunRecord, record_run, timed_run
from .variants import TIGHTEST_SETTINGS, Setting

if TYPE_CHECKING:
    from sidtool.formats.result import Result
    from sidtool.solver.system.system import System

#: Relative difference of two references above which an output is unpredictable;
#: relative change by meshes and modes above which it is not converged.
MAX_UNPREDICTABILITY, MAX_MESH_CHANGE = 1e-3, 0.1
#: Ratio of two successive changes by halvings of the mesh: default, smallest and
#: largest value for the estimate of the remaining error.
DEFAULT_CONVERGENCE_RATIO, MIN_CONVERGENCE_RATIO, MAX_CONVERGENCE_RATIO = (
    2.0 / 3.0,
    1.0 / 3.0,
    0.75,
)
#: Outputs are constant except for rounding if they vary by less than these fractions of
#: their own values, or of the largest variation of an output with their unit.
CONSTANT_TOLERANCE, VARIATION_TOLERANCE = 1e-12, 1e-9
#: Unpredictable outputs are also constant if they vary by less than this factor times
#: the rounding error of terms that cancel.
MUCH = 1e3


@dataclass(frozen=True)
class Point:
    """Cost and error of one setting; `message` is not empty when it failed.

    Attributes
    ----------
    error : relative error of the worst output: the difference to the reference plus the
        uncertainty of the reference
    is_resolved : False if the difference is less than that uncertainty
    choices : value by axis
    size : number of elastic coordinates of all bodies
    dofs : degrees of freedom of the meshes of models
    conversion : processor time of their conversion [s]
    errors : errors of single outputs
    diagnostics : of the run
    """

    setting: Setting
    error: float
    seconds: float
    steps: int
    message: str = ""
    is_resolved: bool = True
    choices: Mapping[str, str] = field(default_factory=dict)
    size: int = 0
    dofs: int = 0
    conversion: float = 0.0
    errors: Mapping[str, float] = field(default_factory=dict)
    diagnostics: tuple[Diagnostic, ...] = ()


def skipped_point(choices: Mapping[str, str], setting: Setting, message: str) -> Point:
    """Return a point without a run, and the reason."""
    return Point(setting, np.inf, np.inf, 0, message, choices=choices)


def point_of(
    record: RunRecord,
    reference: Reference,
    choices: Mapping[str, str],
    setting: Setting,
    size: int,
) -> Point:
    """Return the point of a run compared with the reference."""
    if record.message:
        skipped = skipped_point(choices, setting, record.message)
        return replace(skipped, diagnostics=record.diagnostics)
    errors = reference.of(record)
    sums = errors + reference.floors
    worst = int(sums.argmax())
    return Point(
        setting,
        float(sums[worst]),
        record.seconds,
        record.steps,
        is_resolved=bool(errors[worst] > reference.floors[worst]),
        choices=choices,
        size=size,
        errors=dict(zip(reference.names, errors.tolist(), strict=True)),
        diagnostics=record.diagnostics,
    )


def recommend_point(points: Iterable[Point], wanted: float) -> Point | None:
    """Return the fastest point whose error is at most `wanted`, or None."""
    good = [p for p in points if p.error <= wanted]
    return min(good, key=lambda p: p.seconds, default=None)


def pareto_front(
    points: Sequence[Point], cost: Callable[[Point], float]
) -> list[Point]:
    """Return the Pareto front: points that no other beats in error at no more cost.

    The cheapest is first. The front ends where errors are not resolved.
    """
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (cost(p), p.error)):
        less = not best or (best[-1].is_resolved and point.error < best[-1].error)
        if less and np.isfinite(point.error):
            best.append(point)
    return best


def measure_setting(
    system: System,
    setting: Setting,
    reference: Reference | None,
    repeats: int = MAX_REPEATS,
) -> Point:
    """Return cost (the least of several runs) and error of one setting of a compiled
    scene.
    """
    from sidtool.solver.system.errors import SimulationError

    try:
        result, seconds = timed_run(system, setting, repeats)
    except SimulationError as failure:
        return skipped_point({}, setting, str(failure))
    error = reference.error(result) if reference else np.nan
    return Point(setting, error, seconds, int(result.counters["steps"]))


class StoppedEarly(InputError):
    """Raised if the reference or the unchanged scene cannot be run to its end."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The motion that errors are measured against.

    Attributes
    ----------
    names : outputs that are compared
    values : (nt, n) their time histories
    scale : (n,) variation: largest minus least value
    floors : (n,) relative errors of the reference itself
    left_out : outputs that vary by rounding only
    unpredictable : relative difference of two references, by output: chaotic motion, or
        a motion through a bifurcation
    unconverged : relative change by mesh and modes, for outputs with a large change
    seconds : solve time of the tighter run [s]
    model : description of the model
    diagnostics : of the tighter run
    """

    names: tuple[str, ...]
    values: np.ndarray
    scale: np.ndarray
    floors: np.ndarray
    left_out: tuple[str, ...]
    unpredictable: Mapping[str, float]
    seconds: float
    unconverged: Mapping[str, float] = field(default_factory=dict)
    model: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()

    @property
    def uncertainty(self) -> float:
        """Return the least error that can be resolved."""
        return float(self.floors.max())

    def errors(self, values: np.ndarray) -> np.ndarray:
        """Return relative differences (n,) of outputs (nt, n), resolved or not."""
        count = min(len(values), len(self.values))
        differences = np.abs(values[:count] - self.values[:count])
        return np.asarray(differences.max(axis=0) / self.scale)

    def of(self, record: RunRecord) -> np.ndarray:
        """Return the relative differences of the outputs of a run."""
        return self.errors(record.columns(self.names))

    def error(self, result: Result) -> float:
        """Return the greatest relative difference of the outputs of a run.

        The result is at least the uncertainty of the reference; smaller errors are not
        resolved.
        """
        rows = {name: i for i, name in enumerate(result.names)}
        values = np.asarray(result.values)[:, [rows[name] for name in self.names]]
        return max(float(self.errors(values).max()), self.uncertainty)


def make_reference(system: System, outputs: Sequence[str] = ()) -> Reference:
    """Make the reference of a compiled scene if only the integration is studied.

    Raises
    ------
    InputError : the scene records nothing, or not the given `outputs`.
    SimulationError : the reference stopped early.
    """
    from sidtool.solver import simulate

    check_recorded(system.scene.outputs.record)
    tight, check = (
        record_run(simulate(system, integrator=integrator, rtol=rtol), system=system)
        for integrator, rtol in TIGHTEST_SETTINGS
    )
    return reference_of_runs(tuple(outputs) or tight.names, tight, check)


def check_recorded(names: Sequence[str]) -> None:
    """Check that there is an output to compare."""
    if not names:
        raise InputError(
            "the scene records no outputs, so that there is nothing to compare",
            place="outputs.record",
            expected='names such as ["piston.x"]',
        )


def reference_of_runs(
    names: Sequence[str],
    tight: RunRecord,
    check: RunRecord,
    coarser: Sequence[RunRecord] = (),
    fewer: Sequence[RunRecord] = (),
    model: str = "",
) -> Reference:
    """Make the reference from two runs of one model by different methods, and from runs
    of coarser models.

    coarser, fewer : runs by the method of `check` with coarser meshes, the finest of
        them first, and with fewer modes

    Raises
    ------
    InputError : there is no output that can be compared.
    """
    count = min(len(c.values) for c in (tight, check, *coarser, *fewer))
    values, others = (c.columns(names)[:count] for c in (tight, check))
    meshes, modes = (
        [others, *(c.columns(names)[:count] for c in poorer)]
        for poorer in (coarser, fewer)
    )
    scale = np.ptp(values, axis=0)
    differences = np.abs(values - others).max(axis=0)
    rounding = tight.rounding_of(names)
    models = mesh_error_estimate(_successive_changes(meshes)) + sum(
        _successive_changes(modes), np.zeros(len(names))
    )
    predictable = differences <= MAX_UNPREDICTABILITY * scale
    moving = is_varying(names, values, scale, rounding)
    moving &= predictable | (scale > MUCH * rounding)
    good = moving & predictable & (models <= MAX_MESH_CHANGE * scale)

    def shares(rows: np.ndarray, of: np.ndarray) -> dict[str, float]:
        return {
            str(names[i]): float(of[i] / scale[i])
            for i in map(int, np.flatnonzero(rows))
        }

    unpredictable = shares(moving & ~predictable, differences)
    unconverged = shares(moving & predictable & ~good, models)
    if not good.any():
        raise _nothing_to_compare(unpredictable, unconverged)
    return Reference(
        names=tuple(names[i] for i in map(int, np.flatnonzero(good))),
        values=values[:, good],
        scale=scale[good],
        floors=(differences + models)[good] / scale[good],
        left_out=tuple(n for n, m in zip(names, moving, strict=True) if not m),
        unpredictable=unpredictable,
        seconds=tight.seconds,
        unconverged=unconverged,
        model=model,
        diagnostics=tight.diagnostics,
    )


def _successive_changes(histories: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the largest changes (n,) from each time history (nt, n) to the next."""
    return [
        np.abs(a - b).max(axis=0)
        for a, b in zip(histories, histories[1:], strict=False)
    ]


def mesh_error_estimate(changes: Sequence[np.ndarray]) -> np.ndarray | float:
    """Estimate the remaining discretisation error (n,) of the finest mesh.

    A geometric series of the last two changes gives it, but at least half of the last
    one, where second order would give a third. Changes by forces at points of plane
    bodies and solids do not decrease.

    Parameters
    ----------
    changes : (n,) changes by halvings, the last first
    """
    if not changes:
        return 0.0
    ratios = convergence_ratios(*changes[:2])
    return np.asarray(ratios / (1.0 - ratios) * changes[0])


def convergence_ratios(
    change: np.ndarray, before: np.ndarray | None = None
) -> np.ndarray:
    """Return ratios (n,) of changes to those of the previous halving, within limits."""
    if before is None:
        return np.full(len(change), DEFAULT_CONVERGENCE_RATIO)
    ratios = np.full(len(change), MAX_CONVERGENCE_RATIO)
    np.divide(change, before, out=ratios, where=change < MAX_CONVERGENCE_RATIO * before)
    return np.maximum(ratios, MIN_CONVERGENCE_RATIO)


def is_varying(
    names: Sequence[str], values: np.ndarray, scale: np.ndarray, rounding: np.ndarray
) -> np.ndarray:
    """Return a mask (n,) of outputs that vary by more than rounding.

    names, values, scale : outputs, their values (nt, n) and variation (n,)
    rounding : (n,) rounding error of terms that cancel, see `rounding_levels`
    """
    units = [unit_of(name) for name in names]
    largest: dict[str, float] = {}
    for unit, s in zip(units, scale, strict=True):
        largest[unit] = max(largest.get(unit, 0.0), s)
    of_unit = np.array([largest[unit] if unit else 0.0 for unit in units])
    floor = np.maximum(
        CONSTANT_TOLERANCE * np.abs(values).max(axis=0), VARIATION_TOLERANCE * of_unit
    )
    return np.asarray(scale > np.maximum(floor, rounding))


def _nothing_to_compare(
    unpredictable: Mapping[str, float], unconverged: Mapping[str, float]
) -> InputError:
    if unpredictable:
        (first, *_) = unpredictable_outputs(unpredictable)
        return InputError(
            f"no output can be predicted: {first.message_line}",
            place="outputs.record",
            expected="a shorter time span, over which the motion is predictable",
        )
    if unconverged:
        (first, *_) = unconverged_outputs(unconverged)
        return InputError(
            f"no output is converged: {first.message_line}",
            place="--over",
            expected="finer meshes and more modes among the values, or other outputs",
        )
    return InputError(
        "no output exceeds rounding",
        place="outputs.record",
        expected="outputs that move",
    )


def unpredictable_outputs(differences: Mapping[str, float]) -> Iterator[Diagnostic]:
    """Diagnose outputs in which two references differ, the worst first (N732)."""
    for name in sorted(differences, key=lambda name: -differences[name]):
        yield diagnose("N732", name, difference=differences[name])


def unconverged_outputs(changes: Mapping[str, float]) -> Iterator[Diagnostic]:
    """Diagnose outputs that mesh and modes still change, the worst first (N734)."""
    for name in sorted(changes, key=lambda name: -changes[name]):
        yield diagnose("N734", name, change=changes[name])
