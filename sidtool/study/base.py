"""The scene of a study, run once before anything is compared with it."""

from __future__ import annotations

from collections.abc import Sequence

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result

from ..accuracy.outside import check_inside
from .axes import Variant
from .finest import RunOf
from .plan import Plan
from .reference import StoppedEarly
from .settings import tight
from .tasks import Run, compiled


def check_base(plan: Plan, names: Sequence[str], run_of: RunOf) -> None:
    """Variants of what leaves the theory all err by what no reference knows.

    Of a study that varies more than integrators. A scene that leaves it as it is, for
    want of geometric stiffening or a frame that bends less, may stay inside with all
    that its models have.

    Raises
    ------
    InputError : the run stops early.
    OutsideTheory : a body leaves what its SID describes.
    """
    if not set(plan.varied) - {"integrator"}:
        return
    problems: list[InputError] = []
    for variant in (Variant(), *plan.richest()[:1]):
        try:
            task, _ = run_of(variant, tight(plan.settings)[0], names)
            check_inside(_result(task))
        except InputError as error:
            problems.append(error)
        else:
            return
    raise problems[0]


def _result(task: Run) -> Result:
    """With the accuracy of the scene.

    Raises
    ------
    StoppedEarly : the run stops early.
    """
    from sidtool.solver import simulate
    from sidtool.solver.errors import SimulationError

    try:
        return simulate(compiled(task.scene, task.sids, task.programs))
    except SimulationError as stop:
        raise StoppedEarly(
            f"the scene as it is {stop}",
            place="--over",
            expected="a scene that runs to its end",
        ) from None
