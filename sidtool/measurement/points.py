"""Points of a study: cost, error, Pareto front, recommendation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.diagnostics import Diagnostic

from .outputs import MAX_REPEATS, RunRecord, timed_run
from .reference import Reference
from .variants import Setting

if TYPE_CHECKING:
    from sidtool.solver.system.system import System


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
