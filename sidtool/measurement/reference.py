"""Reference motion of a study, and the errors that can be told from it.

The error of a run is its greatest difference to the reference at the output times,
relative to the variation of each output in the run. How far errors can be told is seen
from what the reference itself still changes with: the integrator, the mesh, the number
of modes. Events that end runs end them all at almost the same time, the last of the
times that are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import unit_of

from .outputs import RunRecord, record_run
from .variants import TIGHTEST_SETTINGS

if TYPE_CHECKING:
    from sidtool.formats.result import Result
    from sidtool.solver.system.system import System


class StoppedEarly(InputError):
    """The reference, or the scene as it is, cannot be run to its end."""


#: Outputs whose references differ by more than this part of their variation cannot be
#: predicted; those that meshes and modes still change by more are not converged.
MAX_UNPREDICTABILITY, MAX_MESH_CHANGE = 1e-3, 0.1
#: The last change by a halving of the mesh over the one before, where that is not
#: known, and at least and at most as what is left of changes is told.
DEFAULT_CONVERGENCE_RATIO, MIN_CONVERGENCE_RATIO, MAX_CONVERGENCE_RATIO = (
    2.0 / 3.0,
    1.0 / 3.0,
    0.75,
)
#: Outputs that vary by less than these parts of their own values, or of the largest
#: variation of an output of their unit, hold rounding only.
CONSTANT_TOLERANCE, VARIATION_TOLERANCE = 1e-12, 1e-9
#: So do outputs that cannot be predicted and vary by less than so many times of what
#: rounding leaves where terms cancel.
MUCH = 1e3


@dataclass(frozen=True, eq=False)
class Reference:
    """The motion that errors are measured against.

    Attributes
    ----------
    names : outputs that are compared
    values : (nt, n) their course
    scale : (n,) variation, greatest less least value
    floors : (n,) relative errors of the reference itself
    left_out : outputs that hold rounding only
    unpredictable : outputs in which two references differ, and by which part of their
        variation: a chaotic motion, or one that passes a bifurcation
    unconverged : outputs that mesh and modes still change by a large part
    seconds : solve time of the tighter one
    model : what it is a run of
    notes, warnings : of the tighter run
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
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def uncertainty(self) -> float:
        """The least error that can be resolved."""
        return float(self.floors.max())

    def errors(self, values: np.ndarray) -> np.ndarray:
        """Return relative differences (n,) of outputs (nt, n), resolved or not."""
        count = min(len(values), len(self.values))
        differences = np.abs(values[:count] - self.values[:count])
        return np.asarray(differences.max(axis=0) / self.scale)

    def of(self, found: RunRecord) -> np.ndarray:
        """The same of a run."""
        return self.errors(found.columns(self.names))

    def error(self, result: Result) -> float:
        """Return the greatest relative difference of the outputs of a run.

        It is at least the uncertainty of the reference: less is not resolved.
        """
        return max(float(self.of(record_run(result)).max()), self.uncertainty)


def make_reference(system: System, outputs: Sequence[str] = ()) -> Reference:
    """The reference of a compiled scene whose integration alone is studied.

    Raises
    ------
    InputError : the scene records nothing, or not what `outputs` asks for.
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
    """From two runs of one model by different methods, and from poorer models.

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
        notes=tight.notes,
        warnings=tight.warnings,
    )


def _successive_changes(courses: Sequence[np.ndarray]) -> list[np.ndarray]:
    """From each course (nt, n) to the next, (n,)."""
    return [
        np.abs(a - b).max(axis=0) for a, b in zip(courses, courses[1:], strict=False)
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
    """Changes (n,) over those by the halving before, as far as they are believed."""
    if before is None:
        return np.full(len(change), DEFAULT_CONVERGENCE_RATIO)
    ratios = np.full(len(change), MAX_CONVERGENCE_RATIO)
    np.divide(change, before, out=ratios, where=change < MAX_CONVERGENCE_RATIO * before)
    return np.maximum(ratios, MIN_CONVERGENCE_RATIO)


def is_varying(
    names: Sequence[str], values: np.ndarray, scale: np.ndarray, rounding: np.ndarray
) -> np.ndarray:
    """Which outputs vary by more than rounding, (n,).

    names, values, scale : outputs, their values (nt, n) and variation (n,)
    rounding : (n,) what it may leave of terms that cancel, see `rounding_levels`
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
        return InputError(
            f"no output can be predicted: {reference_difference_text(unpredictable)}",
            place="outputs.record",
            expected="a shorter time span, over which the motion is predictable",
        )
    if unconverged:
        return InputError(
            f"no output is converged: {refinement_change_text(unconverged)}",
            place="--over",
            expected="finer meshes and more modes among the values, or other outputs",
        )
    return InputError(
        "no output can be told from rounding",
        place="outputs.record",
        expected="outputs that move",
    )


def reference_difference_text(unpredictable: Mapping[str, float]) -> str:
    """How far two references differ in each output, in words."""
    return (
        f"two references differ in {_output_differences(unpredictable)} of its "
        "variation"
    )


def refinement_change_text(unconverged: Mapping[str, float]) -> str:
    """How far the last steps of mesh and modes change each output, in words."""
    return (
        f"mesh and modes still change {_output_differences(unconverged)} of its "
        "variation"
    )


def _output_differences(found: Mapping[str, float]) -> str:
    return ", ".join(f"{name} by {100 * part:.2g} %" for name, part in found.items())
