"""A run that is continued from its own middle, in a scene that starts there."""

from __future__ import annotations

from .case import Case, run
from .ingredients import Random
from .said import Said, copied, with_table
from .states import started_at, with_corners

ROW = 10


def continued(case: Case, rng: Random) -> Said:
    """Positions and velocities after half the time are a new scene's start."""
    seen = with_corners(case)
    half = copied(seen)
    half["time"]["end"] = half["time"]["start"] + ROW * half["time"]["output_step"]
    seen = with_table(seen, half)
    table = started_at(case, seen, run(seen, rtol=1e-10), -1)
    table["time"]["start"] = half["time"]["end"]
    return Said(with_table(case, table), first=ROW)
