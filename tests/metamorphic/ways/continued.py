"""A run that is continued from its own middle, in a scene that starts there."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sidtool.formats.base.sid import Array
from tests.metamorphic.generator.case import Case, Table, Values, run
from tests.metamorphic.generator.ingredients import Random, coordinates_of
from tests.metamorphic.generator.poses import Pose
from tests.metamorphic.generator.said import Said, copied, kind, owner, with_table
from tests.metamorphic.generator.states import rotations, started_at, with_corners
from tests.metamorphic.ways.descriptions import used_coordinates

ROW = 10


def continued(case: Case, rng: Random) -> Said | None:
    """Positions and velocities after half the time are a new scene's start.

    Scenes in space cannot say whole turns of joints: there angles start anew within
    half a turn, and nothing that depends on them may have left that.
    """
    forces = case.table["forces"].values()
    if any(force.get("function", {}).get("type") == "pid" for force in forces):
        return None  # a scene cannot say the state of a controller
    seen = with_corners(case)
    half = copied(seen)
    half["time"]["end"] = half["time"]["start"] + ROW * half["time"]["output_step"]
    seen = with_table(seen, half)
    found = run(seen, rtol=1e-10)
    turns = {} if case.planar else _turns(case, found)
    if any((owner(m), kind(m)) in used_coordinates(case.table) for m in turns):
        return None
    if any(_has_turned(seen, force, found) for force in forces):
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


def _has_turned(case: Case, force: Table, found: Values) -> bool:
    """Whether a bushing, or its shaft, has made half a turn from rest."""
    if force["type"] != "bushing" or case.planar:
        return False
    a, b = (_orientations(case, text, found) for text in force["markers"])
    R = np.swapaxes(a, 1, 2) @ b
    if "shaft" not in force:
        q = Rotation.from_matrix(R).as_quat()
        jumps = np.einsum("ni,ni->n", q[:-1], q[1:]) < 0.0
        return bool((q[0, 3] < 0.0) ^ (q[-1, 3] < 0.0) ^ (jumps.sum() % 2 == 1))
    k = "xyz".index(force["shaft"])
    i, j = (k + 1) % 3, (k + 2) % 3
    twist = np.unwrap(np.arctan2(R[:, j, i] - R[:, i, j], R[:, i, i] + R[:, j, j]))
    return bool(abs(twist[-1]) > np.pi)


def _orientations(case: Case, text: str, found: Values) -> Array:
    """(nt, 3, 3) of a marker; nodes of flexible bodies as undeformed."""
    name, marker = text.split(".")
    if name == "ground":
        return Pose.of(case.table["ground"]["markers"][marker]).R[None]
    own = rotations(case, name, found)
    if case.is_flexible(name):
        return own
    return np.asarray(own @ Pose.of(case.body(name)["markers"][marker]).R)
