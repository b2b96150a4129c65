"""Registry of the integrators, and the automatic choice of one.

An integrator is a function that prepares a `StepFunction`: its storage, and
``advance(control, limit)``, which makes at most `limit` steps and returns one of the
codes of `loop_state`. Its state is that storage and the `StepLoopState` that all share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..spatial import system_arrays as at
from ..system.system import System

if TYPE_CHECKING:
    from ..compiler.tables import Table
    from ..linear.factor_storage import Kernels, Memory
    from ..spatial.system_arrays import WorkArrays
    from ..system.system import System
    from .loop_state import StepLoopState

AUTO = "auto"
#: Loose tolerances do not pay for the larger stages of the higher order.
LOOSE_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class StepFunction:
    """Step function of a run.

    Attributes
    ----------
    advance
        ``advance(control, limit)`` makes at most `limit` steps, see `loop_state`.
    storage
        What the method keeps from one step to the next.
    """

    advance: Callable[[StepLoopState, int], int]
    storage: Table


@dataclass(frozen=True)
class Integrator:
    """One entry of the registry.

    Attributes
    ----------
    order
        Order of convergence of positions.
    dense_degree
        Degree of its dense output as a polynomial of time.
    complex_pairs
        Complex eigenvalues of its Newton matrix.
    step_loop
        Its entry kernel, as module:name in `solver`.
    singular_loop
        Another one that takes it past singular configurations, if it needs one.
    prepare
        Makes the step function of a run.
    explicit
        Stability may limit its steps, which it then counts.
    has_spectral_radius
        Its spectral radius can be chosen.
    """

    title: str
    order: int
    dense_degree: int
    complex_pairs: int
    step_loop: str
    prepare: Callable[
        [System, Kernels, WorkArrays, Memory, StepLoopState], StepFunction
    ]
    explicit: bool = False
    has_spectral_radius: bool = False
    singular_loop: str = ""


def _radau(stages: int) -> Integrator:
    def prepare(
        system: System,
        kernels: Kernels,
        work: WorkArrays,
        memory: Memory,
        control: StepLoopState,
    ) -> StepFunction:
        from ..compiler import precompile
        from . import loop_state, radau, radau_stages

        storage = system.cached_by_topology(radau_stages.stages_maker, stages)()
        parts = kernels, system.arrays, work, memory

        def advance(control: StepLoopState, limit: int) -> int:
            before = memory.steps
            code = radau.advance(*parts, control, storage, limit)
            if code != loop_state.NEAR_SINGULARITY:
                return code
            precompile.ensure_step_loop(passing)
            from . import radau as radau_passing

            left = limit - (memory.steps - before)
            return radau_passing.advance_past_singularity(
                *parts, control, storage, left
            )

        return StepFunction(advance, storage)

    title = f"Radau IIA of order {2 * stages - 1}, index 1, projected"
    loop = "integrators.radau:advance"
    passing = "integrators.radau:advance_past_singularity"
    pairs = (stages - 1) // 2
    return Integrator(
        title, 2 * stages - 1, stages, pairs, loop, prepare, singular_loop=passing
    )


def _trapezoidal(
    system: System,
    kernels: Kernels,
    work: WorkArrays,
    memory: Memory,
    control: StepLoopState,
) -> StepFunction:
    from . import trapezoidal

    storage = trapezoidal.new_slopes(system.n_positions, system.n_velocities)
    return StepFunction(
        lambda control, limit: trapezoidal.advance(
            kernels, system.arrays, work, memory, control, storage, limit
        ),
        storage,
    )


def _dop853(
    system: System,
    kernels: Kernels,
    work: WorkArrays,
    memory: Memory,
    control: StepLoopState,
) -> StepFunction:
    from . import dop853_tableau, explicit_runge_kutta

    tableau = dop853_tableau.tableau()
    storage = explicit_runge_kutta.new_slopes(system.n_positions, system.n_velocities)
    return StepFunction(
        lambda control, limit: explicit_runge_kutta.advance(
            kernels, system.arrays, work, memory, tableau, control, storage, limit
        ),
        storage,
    )


def _generalised_alpha(
    system: System,
    kernels: Kernels,
    work: WorkArrays,
    memory: Memory,
    control: StepLoopState,
) -> StepFunction:
    from ..system.characteristic_sizes import coordinate_sizes
    from . import generalised_alpha, generalised_alpha_step as alpha_table

    rho = control.spectral_radius
    sizes = coordinate_sizes(system)
    storage = alpha_table.new_alpha_memory(system.arrays, rho, sizes)
    return StepFunction(
        lambda control, limit: generalised_alpha.advance(
            kernels, system.arrays, work, memory, control, storage, limit
        ),
        storage,
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
        "integrators.explicit_runge_kutta:advance",
        _dop853,
        explicit=True,
    ),
    "generalised_alpha": Integrator(
        "Generalised-alpha, index 3",
        2,
        3,
        0,
        "integrators.generalised_alpha:advance",
        _generalised_alpha,
        has_spectral_radius=True,
    ),
}


def all_step_loops() -> set[str]:
    """The entry kernels of all integrators, as module:name."""
    methods = INTEGRATORS.values()
    return {loop for m in methods for loop in (m.step_loop, m.singular_loop) if loop}


@dataclass(frozen=True)
class IntegratorChoice:
    """An integrator, and the one that continues if the scene is found to be stiff."""

    first: str
    when_stiff: str = ""


def choose_integrator(
    system: System, rtol: float, step: float | None
) -> IntegratorChoice:
    """The explicit method for rigid bodies, Radau for all else.

    The fastest vibrations of flexible bodies are hardly ever part of the motion, but an
    explicit method has to follow them. Springs can be as stiff: that is seen in the
    run.
    """
    implicit = "radau5" if rtol >= LOOSE_TOLERANCE else "radau9"
    if step is not None or system.arrays.body[:, at.NQ].any():
        return IntegratorChoice(implicit)
    return IntegratorChoice("dop853", implicit)
