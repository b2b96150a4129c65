"""The richest variant of a scene, and what its motion still changes with."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sidtool.formats.errors import InputError

from .axes import Variant, with_choice
from .measuring import Course
from .plan import Plan
from .reference import Reference, StoppedEarly, reference_of
from .settings import Setting, tight
from .tasks import Run

#: Of coarser meshes and of fewer modes, how many there are.
MESHES, MODES = 2, 1

RunOf = Callable[[Variant, Setting, Sequence[str]], tuple[Run, int]]


def best_reference(
    plan: Plan,
    names: Sequence[str],
    run_of: RunOf,
    tight_runs: Callable[[Sequence[Run]], list[Course]],
) -> Reference:
    """Of the richest variants of all models that which its last refinement changes
    least.

    Raises
    ------
    InputError : none can be run.
    """
    found: list[Reference] = []
    problems: list[InputError] = []
    for model in range(plan.bodies.models):
        variants = [v for v in plan.richest() if v.model == model]
        try:
            found.append(_reference(plan, variants, names, run_of, tight_runs))
        except InputError as error:
            problems.append(error)
    if not found:
        raise problems[0]
    return min(found, key=lambda reference: reference.uncertainty)


def _reference(
    plan: Plan,
    variants: Sequence[Variant],
    names: Sequence[str],
    run_of: RunOf,
    tight_runs: Callable[[Sequence[Run]], list[Course]],
) -> Reference:
    """Of the first variant that can be run, by size among those of the same terms."""
    first, second = tight(plan.settings)
    problem: InputError | None = None
    for variant in _by_size(variants, names, run_of, first):
        try:
            coarser = _poorer(plan, variant, "mesh", MESHES)
            fewer = _poorer(plan, variant, "modes", MODES)
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
            return reference_of(names, tight_run, check, meshes, modes, title)
        problem = problem or StoppedEarly(
            f"the reference {messages[0]}",
            place="--over",
            expected="a scene whose richest variant can be run to its end",
        )
    assert problem is not None
    raise problem


def _by_size(
    variants: Sequence[Variant],
    names: Sequence[str],
    run_of: RunOf,
    setting: Setting,
) -> list[Variant]:
    """Those with all terms first, and the largest of them."""
    sizes: dict[Variant, int] = {}
    for variant in variants:
        try:
            sizes[variant] = run_of(variant, setting, names)[1]
        except InputError:
            sizes[variant] = -1
    terms = list(dict.fromkeys(v.terms for v in variants))
    return sorted(variants, key=lambda v: (terms.index(v.terms), -sizes[v]))


def _poorer(plan: Plan, variant: Variant, axis: str, count: int) -> list[Variant]:
    """With less on an axis, so many steps at most, the next one first."""
    own = getattr(variant, axis)
    values = sorted(v for v in plan.values.get(axis, ()) if v is not None)
    below = [v for v in values if own is not None and v < own]
    return [with_choice(variant, axis, v) for v in below[: -count - 1 : -1]]
