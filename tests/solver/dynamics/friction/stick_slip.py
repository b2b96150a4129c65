"""Dry friction of one coordinate, integrated beside the solver: events and all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


@dataclass(frozen=True)
class Rub:
    """x'' = push(t, x, v) + t / m with friction t.

    need(t, x) : friction that holds v = 0
    hold(t, x) : the most that sticking friction is
    slide(t, x, v, s) : x'' while sliding with the sign s
    """

    need: Callable[[float, float], float]
    hold: Callable[[float, float], float]
    slide: Callable[[float, float, float, float], float]

    def motion(self, x: float, v: float, end: float) -> list[tuple[str, float, float]]:
        """("slip" or "stick", time, x) of each change; a reversal is a slip."""
        t, found = 0.0, []
        sense = float(np.sign(v))
        while t < end:
            if sense == 0.0:
                t, sense = self._loose(t, x, end)
                if sense == 0.0:
                    break
                found.append(("slip", t, x))
                continue
            t, x = self._stop(t, x, v, sense, end)
            v = 0.0
            if t >= end:
                break
            need = self.need(t, x)
            sense = float(np.sign(-need)) if abs(need) > self.hold(t, x) else 0.0
            found.append(("slip" if sense else "stick", t, x))
        return found

    def _stop(
        self, t: float, x: float, v: float, s: float, end: float
    ) -> tuple[float, float]:
        def still(t: float, y: np.ndarray) -> float:
            return float(y[1])

        still.terminal = True  # type: ignore[attr-defined]
        still.direction = -s  # type: ignore[attr-defined]
        found = solve_ivp(
            lambda t, y: [y[1], self.slide(t, y[0], y[1], s)],
            (t, end),
            [x, v],
            method="DOP853",
            rtol=1e-12,
            atol=1e-14,
            events=still,
        )
        return float(found.t[-1]), float(found.y[0, -1])

    def _loose(self, t: float, x: float, end: float) -> tuple[float, float]:
        def excess(t: float) -> float:
            return abs(self.need(t, x)) - self.hold(t, x)

        if excess(t) > 0.0:
            return t, float(np.sign(-self.need(t, x)))
        times = np.linspace(t, end, 2_001).tolist()
        later = next((k for k, when in enumerate(times) if excess(when) > 0.0), None)
        if later is None:
            return end, 0.0
        when = float(brentq(excess, *times[later - 1 : later + 1], xtol=1e-15))
        return when, float(np.sign(-self.need(when, x)))
