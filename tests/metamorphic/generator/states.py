"""States of runs, seen from what is recorded, and scenes that start there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array
from tests.metamorphic.generator.case import Case, Table, Values
from tests.metamorphic.generator.poses import Pose, replaced
from tests.metamorphic.generator.said import as_spin, components, copied, spin


def with_corners(case: Case) -> Case:
    """Measures of the whole motion, from which every state can be said again.

    Three more markers on each rigid body tell its orientation.
    """
    table, measures = copied(case), list(case.measures)
    for name, body in table["bodies"].items():
        measures += [f"{name}.{kind}" for kind in "xvw"]
        if case.planar:
            measures.append(f"{name}.angle")
        elif name not in case.sids:
            for axis, corner in zip("xyz", np.eye(3), strict=True):
                body["markers"][f"corner{axis}"] = {"position": corner.tolist()}
        measures += [f"{name}.{marker}.x" for marker in body["markers"]]
        if name in case.sids:
            measures += [f"{name}.q", f"{name}.vq"]
            measures += [f"{name}.{marker}.u" for marker in body["markers"]]
    return replace(case, table=table, measures=tuple(dict.fromkeys(measures)))


def pose_at(case: Case, name: str, values: Values, row: int) -> Pose:
    """Position and orientation of a body in a row."""
    rows = {k: v[[row]] for k, v in values.items() if k.startswith(f"{name}.")}
    return Pose(values[f"{name}.x"][row], rotations(case, name, rows)[0])


def rotations(case: Case, name: str, values: Values) -> Array:
    """(nt, 3, 3) from where the markers of a body are, or from its angle."""
    if case.planar:
        angle = values[f"{name}.angle"][:, 0]
        R = np.broadcast_to(np.eye(3), (len(angle), 3, 3)).copy()
        R[:, 0, 0] = R[:, 1, 1] = np.cos(angle)
        R[:, 1, 0] = np.sin(angle)
        R[:, 0, 1] = -R[:, 1, 0]
        return R
    x, markers = values[f"{name}.x"], case.body(name)["markers"]
    outer = np.stack([values[f"{name}.{m}.x"] - x for m in markers], axis=1)
    inner = np.stack([_places(case, name, m, values) for m in markers], axis=1)
    left, _, right = np.linalg.svd(np.swapaxes(outer, 1, 2) @ inner)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return np.asarray(left @ right)


def _places(case: Case, name: str, marker: str, values: Values) -> Array:
    """(nt, 3) where a marker is in the body frame."""
    if name not in case.sids:
        own = Pose.of(case.body(name)["markers"][marker]).x
        return np.broadcast_to(own, values[f"{name}.x"].shape)
    node = case.sids[name].node(case.node(f"{name}.{marker}"))
    return np.asarray(node.position + values[f"{name}.{marker}.u"])


def started_at(case: Case, seen: Case, values: Values, row: int) -> Table:
    """The table of a case with all bodies as they were in a row of a run of `seen`."""
    table, planar = copied(case), case.planar
    for name, body in table["bodies"].items():
        initial = body["initial"]
        if planar:
            initial["angle"] = float(values[f"{name}.angle"][row, 0])
        body["initial"] = replaced(
            initial, pose_at(seen, name, values, row), planar
        ) | {
            "velocity": components(values[f"{name}.v"][row], planar),
            "angular_velocity": spin(as_spin(values[f"{name}.w"][row]), planar),
        }
        if name in case.sids:
            for key, what in (("elastic", "q"), ("elastic_velocity", "vq")):
                body["initial"][key] = values[f"{name}.{what}"][row].tolist()
    return table
