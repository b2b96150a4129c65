"""Steps in which constraints lose their independence and gain it again."""

from __future__ import annotations

from numba import float64, types

from ..compiler.compiling import inner
from ..space.layout import F1
from .stepping import CONTROL

#: Columns of `Control.crossed` before both states of a step.
BEGAN, LASTED, STATES = range(3)
#: Steps that are kept.
MOST = 24
#: Independence falls straight towards a singular configuration and rises straight
#: behind it: parts of that by which steps over it are known.
RISEN, FALLEN = 1.5, 0.9
#: Independence that steps which resolve a passage see at its least.
LITTLE = 0.05


@inner(types.void(CONTROL, float64, float64, float64, F1, F1))
def note_crossing(control, h, before, slope, z1, v1):
    """Keeps the states at both ends of a step that may pass a singular configuration.

    before, slope : of the independence, at its beginning and over the step before
    """
    now, fall = control.independence, -slope * h
    over = before + now < RISEN * fall and now > before - FALLEN * fall
    beside = fall > 0.0 and before < LITTLE and now > before
    if not (over or beside):
        return
    k = control.crossings
    control.crossings += 1
    if k >= control.crossed.shape[0]:
        return
    kept, n, m = control.crossed[k], len(z1), len(v1)
    kept[BEGAN], kept[LASTED] = control.time, h
    for i in range(n):
        kept[STATES + i] = control.z[i]
        kept[STATES + n + m + i] = z1[i]
    for i in range(m):
        kept[STATES + n + i] = control.v[i]
        kept[STATES + n + m + n + i] = v1[i]
