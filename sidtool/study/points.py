"""What one point of a study costs and gives, and which of all are the best."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .measuring import REPEATS, Course, timed
from .reference import Reference
from .settings import Setting

if TYPE_CHECKING:
    from sidtool.solver.system.scene import System


@dataclass(frozen=True)
class Point:
    """What one setting costs and gives; `message` is not empty when it failed.

    Attributes
    ----------
    error : of the worst output, relative: the difference to the reference, and what
        this may err itself
    told : False where the difference is less than that
    choices : value by axis
    size : elastic coordinates of all bodies
    dofs : degrees of freedom of the meshes of models
    conversion : processor seconds that these took to convert
    errors : of single outputs, as found
    """

    setting: Setting
    error: float
    seconds: float
    steps: int
    message: str = ""
    told: bool = True
    choices: Mapping[str, str] = field(default_factory=dict)
    size: int = 0
    dofs: int = 0
    conversion: float = 0.0
    errors: Mapping[str, float] = field(default_factory=dict)


def skipped(choices: Mapping[str, str], setting: Setting, message: str) -> Point:
    """A point without a run, and why."""
    return Point(setting, np.inf, np.inf, 0, message, choices=choices)


def point_of(
    course: Course,
    reference: Reference,
    choices: Mapping[str, str],
    setting: Setting,
    size: int,
) -> Point:
    """A run beside the reference."""
    if course.message:
        return skipped(choices, setting, course.message)
    errors = reference.of(course)
    sums = errors + reference.floors
    worst = int(sums.argmax())
    return Point(
        setting,
        float(sums[worst]),
        course.seconds,
        course.steps,
        told=bool(errors[worst] > reference.floors[worst]),
        choices=choices,
        size=size,
        errors=dict(zip(reference.names, errors.tolist(), strict=True)),
    )


def recommended(points: Iterable[Point], wanted: float) -> Point | None:
    """The fastest point whose error is at most `wanted`; None if there is none."""
    good = [p for p in points if p.error <= wanted]
    return min(good, key=lambda p: p.seconds, default=None)


def front(points: Sequence[Point], cost: Callable[[Point], float]) -> list[Point]:
    """The Pareto front: points of which none other has less error for no more cost,
    the cheapest first. It ends where errors cannot be told any more."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (cost(p), p.error)):
        less = not best or (best[-1].told and point.error < best[-1].error)
        if less and np.isfinite(point.error):
            best.append(point)
    return best


def measure(
    system: System,
    setting: Setting,
    reference: Reference | None,
    repeats: int = REPEATS,
) -> Point:
    """The cost of one setting of a compiled scene, the least of several runs, and its
    error."""
    from sidtool.solver.errors import SimulationError

    try:
        result, seconds = timed(system, setting, repeats)
    except SimulationError as failure:
        return skipped({}, setting, str(failure))
    error = reference.error(result) if reference else np.nan
    return Point(setting, error, seconds, int(result.counters["steps"]))
