"""Whether BDF would pay: evaluations of the equations by IDA and by radau9."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from sidtool.formats.base.sid import Array
from sidtool.solver import simulate
from sidtool.solver.system.system import System

from . import scenes
from .machine import describe_machine
from .peers.equations import Equations
from .peers.ode import solve
from .precision import errors_of, sizes, truth_of
from .report import Report, Table
from .simeon import simeon

IDA = "IDA (scikit-sundae)"
RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
WANTED = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


class Counted(Equations):
    """Equations that count how often they are evaluated."""

    calls = 0

    def __call__(self, t: float, y: Array) -> Array:
        self.calls += 1
        return super().__call__(t, y)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure; nothing is plotted."""
    rows = []
    for title, system in (
        ("founding slider-crank", scenes.slider_crank()),
        ("Simeon (R2)", simeon()),
    ):
        truth, _ = truth_of(system)
        bdf, own = _bdf(system, truth, say), _own(system, truth)
        for wanted in WANTED:
            cells = [_least(bdf, wanted), _least(own, wanted)]
            ratio = f"{cells[0] / cells[1]:.1f}" if all(cells) else ""
            texts = [str(cell) if cell else "not reached" for cell in cells]
            rows.append([title, f"{wanted:.0e}", *texts, ratio])
    caption = "Evaluations of the equations of motion to reach an error:"
    return Report(
        title="Would BDF pay?",
        tables=[Table(caption, ["scene", "error", "IDA", "radau9", "ratio"], rows)],
        remarks=[
            "IDA is SUNDIALS' BDF of order 1 to 5 with variable step, on the same "
            "equations of index 1, its Jacobians by differences included. Errors are "
            "the largest of all outputs. The tables of the slider-cranks have the "
            "seconds."
        ],
        machine=describe_machine(),
    )


def _bdf(
    system: System, truth: Mapping[str, Array], say: Callable[[str], None]
) -> list[tuple[float, int]]:
    """Error and evaluations for each tolerance; none without the program."""
    scale = sizes(simulate(system, rtol=1e-6))
    found = []
    for rtol in RTOLS:
        equations = Counted(system)
        try:
            values, _ = solve(equations, IDA, rtol, scale)
        except ImportError:
            say(f"{IDA} is not installed: left out")
            return []
        except (RuntimeError, ValueError) as error:
            say(f"{IDA} {rtol:.0e}: {error}")
            continue
        found.append((max(errors_of(values, truth)), equations.calls))
    return found


def _own(system: System, truth: Mapping[str, Array]) -> list[tuple[float, int]]:
    found = []
    for rtol in RTOLS:
        result = simulate(system, integrator="radau9", rtol=rtol)
        values = {name: result[name] for name in result.names}
        evaluations = int(result.counters["evaluations"])
        found.append((max(errors_of(values, truth)), evaluations))
    return found


def _least(found: list[tuple[float, int]], wanted: float) -> int:
    """The fewest evaluations with at most the wanted error; 0 for none."""
    return min((count for error, count in found if error <= wanted), default=0)
