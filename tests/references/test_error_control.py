"""Errors stay within ten times the requested tolerance.

All integrators on three published problems; `benchmarks.error_control` has all
tolerances. Methods of order 2 would take minutes for the tightest ones.
"""

from __future__ import annotations

import pytest

from sidtool.solver import simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.errors import SimulationError

from .error_control import CASES, compiled, relative_error

TOLERANCES = (1e-3, 1e-6, 1e-10)
LOOSE = (1e-3, 1e-4)
HONEST = 10.0


@pytest.mark.parametrize("integrator", [*INTEGRATORS, "auto"])
@pytest.mark.parametrize("case", CASES)
def test_errors_stay_within_ten_times_the_tolerance(case: str, integrator: str) -> None:
    method = INTEGRATORS.get(integrator)
    for rtol in LOOSE if method and method.order == 2 else TOLERANCES:
        result = simulate(compiled(case), integrator=integrator, rtol=rtol)
        assert relative_error(case, result) < HONEST * rtol, rtol


def test_generalised_alpha_stops_where_rounding_hides_errors() -> None:
    """What was computed so far is kept, and as good as rounding allows."""
    case, rtol = "Simeon", 1e-8
    with pytest.raises(SimulationError, match="N306") as failure:
        simulate(compiled(case), integrator="generalised_alpha", rtol=rtol)
    result = failure.value.result
    assert result is not None and not result.completed
    assert result.diagnostics[0].data["rtol"] == rtol
    assert result.t[-1] > 0.4 * compiled(case).scene.time.end
    assert relative_error(case, result) < 2e-7


@pytest.mark.parametrize("integrator", ["trapezoidal", "generalised_alpha"])
def test_a_tolerance_that_numbers_do_not_resolve_is_refused(integrator: str) -> None:
    with pytest.raises(SimulationError, match="t = 0 s: N306") as failure:
        simulate(compiled("Simeon"), integrator=integrator, rtol=1e-10)
    assert [each.code for each in failure.value.diagnostics] == ["N306"]
