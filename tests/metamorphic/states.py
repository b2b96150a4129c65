"""States of runs, seen from what is recorded, and scenes that start there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.sid import Array

from .case import Case, Table, Values
from .poses import Pose, replaced
from .said import as_spin, components, copied, spin


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
    """Position and orientation of a body, from where its markers are."""
    x = values[f"{name}.x"][row]
    if case.planar:
        angle = float(values[f"{name}.angle"][row, 0])
        return Pose.of({"position": tuple(x), "axis_angle": (0.0, 0.0, angle)})
    markers = case.body(name)["markers"]
    inner = np.array([_place(case, name, marker, values, row) for marker in markers])
    outer = np.array([values[f"{name}.{marker}.x"][row] - x for marker in markers])
    left, _, right = np.linalg.svd(outer.T @ inner)
    return Pose(x, left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _place(case: Case, name: str, marker: str, values: Values, row: int) -> Array:
    """Where a marker is in the body frame."""
    if name not in case.sids:
        return Pose.of(case.body(name)["markers"][marker]).x
    node = case.sids[name].node(case.node(f"{name}.{marker}"))
    return np.asarray(node.position + values[f"{name}.{marker}.u"][row])


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
