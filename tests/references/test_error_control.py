"""What is asked for is what comes out: errors within ten times the tolerance.

The default integrators on three published problems; `benchmarks.error_control` has all
tolerances and methods.
"""

from __future__ import annotations

import pytest

from solver import simulate

from .error_control import CASES, compiled, relative_error

TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-7, 1e-10)
HONEST = 10.0


@pytest.mark.parametrize("integrator", ["radau5", "radau9"])
@pytest.mark.parametrize("case", CASES)
def test_errors_stay_within_ten_times_the_tolerance(case: str, integrator: str) -> None:
    for rtol in TOLERANCES:
        result = simulate(compiled(case), integrator=integrator, rtol=rtol)
        assert relative_error(case, result) < HONEST * rtol, rtol
