"""Error against time: integrators and tolerances over one scene.

The error of a run is its greatest difference to a reference of tight tolerance at the
output times, relative to the variation of each output in the run. The difference of two
references by different integrators says how far errors can be told, and which outputs
cannot be predicted over the time span at all. Events that end
runs end them all at almost the same time, the last of the times that are compared.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.study import StudyFile, StudyPoint

from .report.tables import table

if TYPE_CHECKING:
    from sidtool.formats.result import Result
    from sidtool.solver.system.scene import System

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
#: Integrators and tolerances of the two references.
TIGHT = (("radau13", 1e-12), ("radau9", 1e-11))
#: Outputs whose references differ by more than this part of their variation cannot be
#: predicted.
TRUSTED = 1e-3
#: Outputs that vary by less than these parts of their own values, or of the largest
#: variation of an output of their kind, hold rounding only.
CONSTANT, UNMOVED = 1e-12, 1e-9
#: Of the largest force of a joint, the part that rounding leaves of its components.
ROUNDED_FORCE = 1e-12
#: Outputs that are forces and moments.
FORCE = re.compile(r"[fm][xyz]|f\d+")
#: Runs are repeated until they have taken this long in all [s], or this often.
ENOUGH, REPEATS = 0.3, 5
#: An integrator that takes longer than this [s], and so many times as long as another
#: one for no less error, is not tried with tighter tolerances.
LONG, HOPELESS = 1.0, 20.0

Say = Callable[[str], None]


@dataclass(frozen=True)
class Setting:
    """How one run is made; `step` [s] replaces the error control by `rtol`."""

    integrator: str
    rtol: float | None = None
    step: float | None = None

    @property
    def value(self) -> str:
        return f"{self.rtol:.0e}" if self.step is None else f"{self.step:g} s"

    @property
    def key(self) -> str:
        """The lines of `[accuracy]` that ask for it."""
        kind, number = ("rtol", self.rtol) if self.step is None else ("step", self.step)
        return f'integrator = "{self.integrator}", {kind} = {number:g}'


@dataclass(frozen=True)
class Point:
    """What one setting costs and gives; `message` is not empty when it failed."""

    setting: Setting
    error: float
    seconds: float
    steps: int
    message: str = ""


@dataclass(frozen=True, eq=False)
class Reference:
    """The motion that errors are measured against.

    Attributes
    ----------
    names : outputs that are compared
    values : (nt, n) their course
    scale : (n,) variation, greatest less least value
    uncertainty : relative difference of two references
    left_out : outputs that hold rounding only
    unpredictable : outputs in which two references differ, and by which part of their
        variation: a chaotic motion, or one that passes a bifurcation
    seconds : solve time of the tighter one
    """

    names: tuple[str, ...]
    values: np.ndarray
    scale: np.ndarray
    uncertainty: float
    left_out: tuple[str, ...]
    unpredictable: Mapping[str, float]
    seconds: float

    def error(self, result: Result) -> float:
        """Greatest relative difference of the outputs of a run.

        At least the uncertainty of the reference: less cannot be told.
        """
        count = min(len(result.t), len(self.values))
        found = np.column_stack([result[name] for name in self.names])[:count]
        errors = np.abs(found - self.values[:count]).max(axis=0)
        return max(float((errors / self.scale).max()), self.uncertainty)


@dataclass(frozen=True)
class Study:
    """All points of a scene and their reference."""

    points: tuple[Point, ...]
    reference: Reference


def study(
    system: System,
    settings: Iterable[Setting] | None = None,
    outputs: Sequence[str] = (),
    say: Say | None = None,
) -> Study:
    """Run every setting over a compiled scene.

    Parameters
    ----------
    settings : default all integrators at `TOLERANCES`; of integrators that turn out
        to be far too slow, tighter tolerances are left out
    outputs : names of the outputs that count, default all that the scene records
    say : called with a line before every run

    Raises
    ------
    InputError : the scene records nothing, or not what `outputs` asks for.
    SimulationError : the reference stopped early.
    """
    say = say or _silent
    reference = make_reference(system, outputs, say)
    chosen = list(default_settings() if settings is None else settings)
    for integrator in dict.fromkeys(s.integrator for s in chosen):
        _warm(system, next(s for s in chosen if s.integrator == integrator), say)
    points: list[Point] = []
    slow: dict[str, float] = {}
    for setting in chosen:
        if (setting.rtol or np.inf) < slow.get(setting.integrator, 0.0):
            points.append(Point(setting, np.inf, np.inf, 0, "left out, far too slow"))
            continue
        say(f"{setting.integrator} {setting.value}")
        point = measure(system, setting, reference)
        if setting.rtol and is_hopeless(
            point.seconds, point.error, ((p.seconds, p.error) for p in points)
        ):
            slow[setting.integrator] = setting.rtol
        points.append(point)
    return Study(tuple(points), reference)


def is_hopeless(
    seconds: float, error: float, others: Iterable[tuple[float, float]]
) -> bool:
    """Whether a run is far slower than another of no more error.

    others : seconds and errors of other runs
    """
    return LONG < seconds < np.inf and any(
        HOPELESS * time < seconds and other <= error for time, other in others
    )


def _silent(_: str) -> None:
    return None


def default_settings(
    integrators: Sequence[str] = (),
    tolerances: Sequence[float] = (),
    steps: Sequence[float] = (),
) -> list[Setting]:
    """Every integrator with every tolerance and fixed step; "auto" if asked for.

    Raises
    ------
    InputError : an integrator is not known.
    """
    from sidtool.solver.integrators import INTEGRATORS
    from sidtool.solver.integrators.automatic import AUTO

    known = (AUTO, *INTEGRATORS)
    for name in integrators:
        if name not in known:
            raise InputError(
                f"there is no integrator {name!r}",
                expected=f"one of {', '.join(known)}",
            )
    chosen = integrators or tuple(INTEGRATORS)
    if not tolerances and not steps:
        tolerances = TOLERANCES
    return [Setting(name, rtol=rtol) for name in chosen for rtol in tolerances] + [
        Setting(name, step=step) for name in chosen for step in steps
    ]


def make_reference(
    system: System, outputs: Sequence[str] = (), say: Say = _silent
) -> Reference:
    """The tight reference and what it is good for; see `study`."""
    from sidtool.solver import simulate

    if not system.scene.outputs.record:
        raise InputError(
            "the scene records no outputs, so that there is nothing to compare",
            place="outputs.record",
            expected='names such as ["piston.x"]',
        )
    runs = []
    for integrator, rtol in TIGHT:
        say(f"reference by {integrator} {rtol:.0e}")
        runs.append(simulate(system, integrator=integrator, rtol=rtol))
    tight, check = runs
    names = _known(tight, outputs)
    count = min(len(tight.t), len(check.t))
    values = np.column_stack([tight[name] for name in names])[:count]
    others = np.column_stack([check[name] for name in names])[:count]
    scale = np.ptp(values, axis=0)
    differences = np.abs(values - others).max(axis=0)
    moving = moves(names, values, scale, tight.multipliers)
    good = moving & (differences <= TRUSTED * scale)
    unpredictable = {
        str(name): float(difference / size)
        for name, difference, size in zip(
            *(np.array(x)[moving & ~good] for x in (names, differences, scale)),
            strict=True,
        )
    }
    if not good.any():
        raise _nothing_to_compare(unpredictable)
    return Reference(
        names=tuple(n for n, g in zip(names, good, strict=True) if g),
        values=values[:, good],
        scale=scale[good],
        uncertainty=float((differences[good] / scale[good]).max()),
        left_out=tuple(n for n, m in zip(names, moving, strict=True) if not m),
        unpredictable=unpredictable,
        seconds=float(tight.counters["seconds"]),
    )


def moves(
    names: Sequence[str], values: np.ndarray, scale: np.ndarray, forces: np.ndarray
) -> np.ndarray:
    """Which outputs vary by more than rounding, (n,); forces, of joints and drives,
    tell how large those are that cancel in some of their components."""
    kinds = [name.rpartition(".")[2].rstrip("0123456789") for name in names]
    largest = [
        max(s for s, k in zip(scale, kinds, strict=True) if k[:-1] == kind[:-1])
        for kind in kinds
    ]
    floor = np.maximum(
        CONSTANT * np.abs(values).max(axis=0), UNMOVED * np.array(largest)
    )
    of_forces = [FORCE.fullmatch(name.rpartition(".")[2]) is not None for name in names]
    floor[of_forces] = np.maximum(
        floor[of_forces], ROUNDED_FORCE * np.abs(forces).max(initial=0.0)
    )
    return np.asarray(scale > floor)


def _nothing_to_compare(unpredictable: Mapping[str, float]) -> InputError:
    if unpredictable:
        return InputError(
            f"no output can be predicted: {differing(unpredictable)}",
            place="outputs.record",
            expected="a shorter time span, over which the motion is predictable",
        )
    return InputError(
        "no output can be told from rounding",
        place="outputs.record",
        expected="outputs that move",
    )


def differing(unpredictable: Mapping[str, float]) -> str:
    """How far two references differ in each output, in words."""
    parts = [f"{name} by {100 * part:.2g} %" for name, part in unpredictable.items()]
    return f"two references differ in {', '.join(parts)} of its variation"


def _known(result: Result, outputs: Sequence[str]) -> tuple[str, ...]:
    for name in outputs:
        result[name]
    return tuple(outputs) or result.names


def _warm(system: System, setting: Setting, say: Say) -> None:
    """Loads the kernels, which must not count as the time of the first run."""
    say(f"loading {setting.integrator}")
    measure(system, setting, None, repeats=1)


def measure(
    system: System,
    setting: Setting,
    reference: Reference | None,
    repeats: int = REPEATS,
) -> Point:
    """The cost of one setting, the least of several runs, and its error."""
    from sidtool.solver.errors import SimulationError

    try:
        result, seconds = timed(system, setting, repeats)
    except SimulationError as failure:
        return Point(setting, np.inf, np.inf, 0, str(failure))
    error = reference.error(result) if reference else np.nan
    return Point(setting, error, seconds, int(result.counters["steps"]))


def timed(
    system: System, setting: Setting, repeats: int = REPEATS
) -> tuple[Result, float]:
    """A run and its least solve time out of several [s].

    Raises
    ------
    SimulationError : the run stopped early.
    """
    from sidtool.solver import simulate

    seconds: list[float] = []
    while len(seconds) < repeats and sum(seconds) < ENOUGH:
        result = simulate(
            system,
            integrator=setting.integrator,
            rtol=setting.rtol,
            step=setting.step,
        )
        seconds.append(float(result.counters["seconds"]))
    return result, min(seconds)


def recommended(points: Iterable[Point], wanted: float) -> Point | None:
    """The fastest point whose error is at most `wanted`; None if there is none."""
    good = [p for p in points if p.error <= wanted]
    return min(good, key=lambda p: p.seconds, default=None)


def study_table(result: Study) -> str:
    """All points, one line each."""
    rows = [
        [
            p.setting.integrator,
            p.setting.value,
            str(p.steps) if not p.message else "",
            f"{p.seconds:.4f}" if not p.message else "",
            f"{p.error:.1e}" if not p.message else p.message,
        ]
        for p in result.points
    ]
    return table(["integrator", "setting", "steps", "seconds", "error"], rows)


def recommendation_table(points: Sequence[Point], wanted: Iterable[float]) -> str:
    """The recommended setting for each wanted error."""
    rows = []
    for error in wanted:
        best = recommended(points, error)
        if best is None:
            rows.append([f"{error:.0e}", "", "", "none of these settings reaches it"])
            continue
        rows.append(
            [f"{error:.0e}", f"{best.error:.1e}", f"{best.seconds:.4f}"]
            + [best.setting.key]
        )
    return table(["wanted", "error", "seconds", "[accuracy]"], rows)


def study_file(result: Study, title: str) -> StudyFile:
    """A study as it is kept."""
    points = tuple(
        StudyPoint(
            integrator=p.setting.integrator,
            rtol=p.setting.rtol,
            step=p.setting.step,
            error=p.error if np.isfinite(p.error) else None,
            seconds=p.seconds if np.isfinite(p.seconds) else None,
            steps=p.steps,
            message=p.message,
        )
        for p in result.points
    )
    reference = result.reference
    return StudyFile(
        title=title,
        outputs=reference.names,
        uncertainty=reference.uncertainty,
        points=points,
    )


def plot_study(path: Path, content: StudyFile) -> None:
    """Work against precision, one line per integrator.

    Raises
    ------
    InputError : no setting gave an error.
    """
    from .plot.precision import plot_precision

    lines: dict[str, list[tuple[float, float]]] = {}
    for p in content.points:
        if not p.message and p.error and p.seconds:
            name = p.integrator + ("" if p.step is None else ", fixed step")
            lines.setdefault(name, []).append((p.error, p.seconds))
    if not lines:
        raise InputError("holds no errors to draw", expected="a study with runs")
    plot_precision(path, lines, f"relative error, {content.title}")
