"""Integrators: step loops on compiled scenes, one registry line each.

An integrator is a function that prepares its storage and coefficients and returns
`advance(control, limit)`, which makes at most `limit` steps and returns one of the
codes of `stepping`. It keeps its state in the `Control` that all share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..linear.memory import Kernels, Memory
    from ..space.layout import Work
    from ..system.scene import System
    from .stepping import Control

Advance = Callable[["Control", int], int]


@dataclass(frozen=True)
class Integrator:
    """One entry of the registry.

    order : order of convergence of positions
    dense : degree of its dense output as a polynomial of time
    pairs : complex eigenvalues of its Newton matrix
    step_loop : its entry kernel, as module:name in `solver`
    passing_loop : another one that takes it past singular positions, if it needs one
    prepare : makes the step function of a run
    explicit : stability may limit its steps, which it then counts
    damps : its spectral radius can be chosen
    """

    title: str
    order: int
    dense: int
    pairs: int
    step_loop: str
    prepare: Callable[[System, Kernels, Work, Memory, Control], Advance]
    explicit: bool = False
    damps: bool = False
    passing_loop: str = ""


def _radau(stages: int) -> Integrator:
    def prepare(
        system: System, kernels: Kernels, work: Work, memory: Memory, control: Control
    ) -> Advance:
        from .. import warmup
        from . import stepping
        from .radau import method as radau
        from .radau import table

        storage = system.lasting(table.stages, stages)()
        parts = kernels, system.arrays, work, memory

        def advance(control: Control, limit: int) -> int:
            before = memory.steps
            code = radau.advance(*parts, control, storage, limit)
            if code != stepping.BESIDE:
                return code
            warmup.ensure_loop(passing)
            from .radau import passing as radau_passing

            left = limit - (memory.steps - before)
            return radau_passing.advance(*parts, control, storage, left)

        return advance

    title = f"Radau IIA of order {2 * stages - 1}, index 1, projected"
    loop = "integrators.radau.method:advance"
    passing = "integrators.radau.passing:advance"
    pairs = (stages - 1) // 2
    return Integrator(
        title, 2 * stages - 1, stages, pairs, loop, prepare, passing_loop=passing
    )


def _trapezoidal(
    system: System, kernels: Kernels, work: Work, memory: Memory, control: Control
) -> Advance:
    from . import trapezoidal

    storage = trapezoidal.new_slopes(system.n_positions, system.n_velocities)
    return lambda control, limit: trapezoidal.advance(
        kernels, system.arrays, work, memory, control, storage, limit
    )


def _explicit(
    system: System, kernels: Kernels, work: Work, memory: Memory, control: Control
) -> Advance:
    from . import dop853, explicit

    tableau = dop853.tableau()
    storage = explicit.new_slopes(system.n_positions, system.n_velocities)
    return lambda control, limit: explicit.advance(
        kernels, system.arrays, work, memory, tableau, control, storage, limit
    )


def _generalised_alpha(
    system: System, kernels: Kernels, work: Work, memory: Memory, control: Control
) -> Advance:
    from ..system.sizes import coordinate_sizes
    from .alpha import generalised_alpha
    from .alpha import table as alpha_table

    rho = control.radius
    sizes = coordinate_sizes(system)
    storage = alpha_table.new_alpha(system.arrays, rho, sizes)
    return lambda control, limit: generalised_alpha.advance(
        kernels, system.arrays, work, memory, control, storage, limit
    )


INTEGRATORS: dict[str, Integrator] = {
    "radau5": _radau(3),
    "radau9": _radau(5),
    "radau13": _radau(7),
    "trapezoidal": Integrator(
        "Trapezoidal rule, index 1, projected",
        2,
        3,
        0,
        "integrators.trapezoidal:advance",
        _trapezoidal,
    ),
    "dop853": Integrator(
        "Explicit Runge-Kutta of order 8 (Dormand-Prince), index 1, projected",
        8,
        7,
        0,
        "integrators.explicit:advance",
        _explicit,
        explicit=True,
    ),
    "generalised_alpha": Integrator(
        "Generalised-alpha, index 3",
        2,
        3,
        0,
        "integrators.alpha.generalised_alpha:advance",
        _generalised_alpha,
        damps=True,
    ),
}


def all_step_loops() -> set[str]:
    """The entry kernels of all integrators, as module:name."""
    methods = INTEGRATORS.values()
    return {loop for m in methods for loop in (m.step_loop, m.passing_loop) if loop}
