"""`auto`: the integrator that measurement found best for a kind of scene.

The figures stand in `benchmarks/results`, page "Which integrator by default".
"""

from __future__ import annotations

from dataclasses import dataclass

from ..space import layout as at
from ..system.scene import System

AUTO = "auto"
#: Loose tolerances do not pay for the larger stages of the higher order.
LOOSE = 1e-3


@dataclass(frozen=True)
class Choice:
    """An integrator, and the one that goes on where the scene turns out to be stiff."""

    first: str
    when_stiff: str = ""


def choose(system: System, rtol: float, step: float | None) -> Choice:
    """The explicit method for rigid bodies, Radau for all else.

    The fastest vibrations of flexible bodies are hardly ever part of the motion, but
    an explicit method has to follow them. Springs can be as stiff: that is seen in
    the run.
    """
    implicit = "radau5" if rtol >= LOOSE else "radau9"
    if step is not None or system.arrays.body[:, at.NQ].any():
        return Choice(implicit)
    return Choice("dop853", implicit)
