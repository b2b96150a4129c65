"""All motions that are known beside the solver, by name."""

from __future__ import annotations

from .motions import Case, clamped, on_bushing, on_hinge, on_rail
from .turning import four_bars, pendulum, sledge, top


def _cases() -> dict[str, Case]:
    cases = {}
    for exponent in (0, -3, -6, -9):
        size = 10.0**exponent
        cases[f"spring {size:.0e} m"] = on_rail(size, 0.0, "displaced")
        cases[f"hinge {size:.0e} rad"] = on_hinge(size)
    for start in ("struck", "loaded"):
        cases[f"spring 1e-06 m, {start}"] = on_rail(1e-6, 0.0, start)
    cases["spring 1e-06 m at 1000 m"] = on_rail(1e-6, 1e3, "displaced")
    cases["bushing 1e-06 m"] = on_bushing(1e-6)
    cases["free top, 8 turns"] = top([1.0, 2.0, 3.0], [1.0, 0.5, 10.0], 5.0)
    cases["free top, 60 turns"] = top([1.0, 2.0, 2.5], [60.0, 20.0, 40.0], 5.0)
    cases["free top, 300 turns"] = top([1.0, 2.0, 3.0], [30.0, 20.0, 370.0], 5.0)
    cases["heavy top, 100 turns"] = top([1.0, 1.0, 0.6], [0.0, 1.0, 300.0], 2.0, 0.5)
    cases["pendulum"] = pendulum(0.0, 10.0)
    cases["pendulum, 30 turns"] = pendulum(40.0, 5.0)
    cases["pendulum with friction"] = pendulum(0.0, 5.0, 0.3)
    cases["stick and slip"] = sledge(5.0, 1e-3, 20.0, 3.0)
    cases["sharp friction"] = sledge(2.0, 1e-4, 20.0, 13.0)
    for size in (1e-3, 1e-9):
        cases[f"clamped body, {size:.0e}"] = clamped(size)
    cases["four bars (A02)"] = four_bars()
    return cases


CASES = _cases()
