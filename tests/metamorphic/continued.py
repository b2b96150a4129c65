"""A run that is continued from its own middle, in a scene that starts there."""

from __future__ import annotations

import numpy as np

from .case import Case, Values, run
from .descriptions import used_coordinates
from .ingredients import Random, coordinates_of
from .said import Said, copied, kind, owner, with_table
from .states import started_at, with_corners

ROW = 10


def continued(case: Case, rng: Random) -> Said | None:
    """Positions and velocities after half the time are a new scene's start.

    Scenes in space cannot say whole turns of joints: there angles start anew within
    half a turn, and nothing that depends on them may have left that.
    """
    seen = with_corners(case)
    half = copied(seen)
    half["time"]["end"] = half["time"]["start"] + ROW * half["time"]["output_step"]
    seen = with_table(seen, half)
    found = run(seen, rtol=1e-10)
    turns = {} if case.planar else _turns(case, found)
    if any((owner(m), kind(m)) in used_coordinates(case.table) for m in turns):
        return None
    table = started_at(case, seen, found, -1)
    table["time"]["start"] = half["time"]["end"]

    def back(values: Values) -> Values:
        return {name: v + turns.get(name, 0.0) for name, v in values.items()}

    return Said(with_table(case, table), back, first=ROW)


def _turns(case: Case, found: Values) -> dict[str, float]:
    """Whole turns that undriven joints have made until the end of a run."""
    turn, joints = 2.0 * np.pi, case.table["joints"]
    driven = {(d.get("joint"), d["coordinate"]) for d in case.table["drives"].values()}
    names = [
        f"{joint}.{coordinate}"
        for joint, entry in joints.items()
        for coordinate in coordinates_of(entry["type"])
        if "angle" in coordinate and (joint, coordinate) not in driven
    ]
    made = {name: turn * round(float(found[name][-1, 0]) / turn) for name in names}
    return {name: angle for name, angle in made.items() if angle}
