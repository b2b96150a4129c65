"""How joints with friction move at present: what `System.grip` says of them."""

from __future__ import annotations

from numba import boolean, float64, int64

from ..compiler.compiling import inner
from ..space.layout import C_RATE, LED, SENSE, SYSTEM, WORK


@inner(boolean(SYSTEM, int64))
def sticks(system, j):
    """Whether friction holds a joint; one whose motion is prescribed is never held."""
    return system.grip[j, SENSE] == 0.0 and system.grip[j, LED] == 0.0


@inner(float64(SYSTEM, WORK, int64))
def sense_of(system, work, j):
    """1 or -1 of a joint that slides; 0 where a prescribed motion rests."""
    sense, rest = system.grip[j, SENSE], system.grip[j, LED]
    rate = work.sliding.row[j, C_RATE]
    if rest == 0.0:
        return sense
    if abs(rate) <= rest:
        return 0.0
    if sense == 0.0:
        return 1.0 if rate > 0.0 else -1.0
    return sense
