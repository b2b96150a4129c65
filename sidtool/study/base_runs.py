"""First runs of a study: the scene itself, and its finest variant as the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result

from ..measurement.outputs import RunRecord
from ..measurement.reference import Reference, StoppedEarly, reference_of_runs
from ..measurement.tasks import RunTask, compile_task
from ..measurement.validity import check_validity
from ..measurement.variants import Setting, Variant, tight_settings, with_choice
from .plan import StudyPlan


def check_base_runs(plan: StudyPlan, names: Sequence[str], run_of: RunOf) -> None:
    """Check that the scene itself stays in the range of linear theory.

    Otherwise all variants share errors that no reference shows. The check applies to
    studies that vary more than integrators. A scene that leaves the range because it
    lacks geometric stiffening or a better body frame may stay inside with the full
    models.

    Raises
    ------
    InputError : the run stops early.
    OutsideTheory : a body leaves the range of its SID.
    """
    if not set(plan.varied) - {"integrator"}:
        return
    problems: list[InputError] = []
    for variant in (Variant(), *plan.finest_variants()[:1]):
        try:
            task, _ = run_of(variant, tight_settings(plan.settings)[0], names)
            check_validity(_run_base(task))
        except InputError as error:
            problems.append(error)
        else:
            return
    raise problems[0]


def _run_base(task: RunTask) -> Result:
    """Run the scene with its own accuracy.

    Raises
    ------
    StoppedEarly : the run stops early.
    """
    from sidtool.solver import simulate
    from sidtool.solver.system.errors import SimulationError

    try:
        return simulate(compile_task(task.scene, task.sids, task.programs))
    except SimulationError as stop:
        raise StoppedEarly(
            f"the scene as it is {stop}",
            place="--over",
            expected="a scene that runs to its end",
        ) from None


#: Number of runs with coarser meshes and with fewer modes for the error estimate.
COARSER_MESHES, FEWER_MODES = 2, 1

RunOf = Callable[[Variant, Setting, Sequence[str]], tuple[RunTask, int]]


def best_reference(
    plan: StudyPlan,
    names: Sequence[str],
    run_of: RunOf,
    tight_runs: Callable[[Sequence[RunTask]], list[RunRecord]],
) -> Reference:
    """Return the best converged of the finest variants of all models.

    Raises
    ------
    InputError : none can be run.
    """
    references: list[Reference] = []
    problems: list[InputError] = []
    for model in range(plan.bodies.models):
        variants = [v for v in plan.finest_variants() if v.model == model]
        try:
            references.append(
                _reference_of_variants(plan, variants, names, run_of, tight_runs)
            )
        except InputError as error:
            problems.append(error)
    if not references:
        raise problems[0]
    return min(references, key=lambda reference: reference.uncertainty)


def _reference_of_variants(
    plan: StudyPlan,
    variants: Sequence[Variant],
    names: Sequence[str],
    run_of: RunOf,
    tight_runs: Callable[[Sequence[RunTask]], list[RunRecord]],
) -> Reference:
    """Return the reference of the first variant that can be run, the largest first."""
    first, second = tight_settings(plan.settings)
    problem: InputError | None = None
    for variant in _order_by_size(variants, names, run_of, first):
        try:
            coarser = _coarser_variants(plan, variant, "mesh", COARSER_MESHES)
            fewer = _coarser_variants(plan, variant, "modes", FEWER_MODES)
            tasks = [run_of(variant, s, names)[0] for s in (first, second)]
            tasks += [run_of(v, second, names)[0] for v in (*coarser, *fewer)]
        except InputError as error:
            problem = problem or error
            continue
        tight_run, check, *others = tight_runs(tasks)
        messages = [c.message for c in (tight_run, check, *others) if c.message]
        if not messages:
            title = ", ".join(
                text if axis == "model" else f"{axis} {text}"
                for axis, text in plan.labels(variant).items()
            )
            count = len(coarser)
            meshes, modes = others[:count], others[count:]
            return reference_of_runs(names, tight_run, check, meshes, modes, title)
        problem = problem or StoppedEarly(
            f"the reference {messages[0]}",
            place="--over",
            expected="a scene whose richest variant can be run to its end",
        )
    assert problem is not None
    raise problem


def _order_by_size(
    variants: Sequence[Variant],
    names: Sequence[str],
    run_of: RunOf,
    setting: Setting,
) -> list[Variant]:
    """Sort variants: those with all terms first, and the largest of them."""
    sizes: dict[Variant, int] = {}
    for variant in variants:
        try:
            sizes[variant] = run_of(variant, setting, names)[1]
        except InputError:
            sizes[variant] = -1
    terms = list(dict.fromkeys(v.terms for v in variants))
    return sorted(variants, key=lambda v: (terms.index(v.terms), -sizes[v]))


def _coarser_variants(
    plan: StudyPlan, variant: Variant, axis: str, count: int
) -> list[Variant]:
    """Return variants that are coarser on an axis, at most `count` steps, the next
    first.
    """
    own = getattr(variant, axis)
    values = sorted(v for v in plan.values.get(axis, ()) if v is not None)
    below = [v for v in values if own is not None and v < own]
    return [with_choice(variant, axis, v) for v in below[: -count - 1 : -1]]
