"""Joints that do without constraints which follow from others, in words."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.scene import System
from .consistent import names_of_rows

#: Constraints of rotations.
TURNING = (at.PERPENDICULAR, at.ANGLE)
#: What joints become without so many constraints of places and of rotations.
FREER = {
    ("revolute", 0, 1): "universal",
    ("revolute", 0, 2): "spherical",
    ("revolute", 1, 0): "cylindrical",
    ("revolute", 1, 2): "point_on_line",
    ("fixed", 0, 3): "spherical",
    ("spherical", 1, 0): "point_on_line",
    ("spherical", 2, 0): "point_on_plane",
    ("cylindrical", 0, 2): "point_on_line",
    ("prismatic", 0, 1): "cylindrical",
    ("prismatic", 0, 3): "point_on_line",
    ("universal", 0, 1): "spherical",
    ("planar", 0, 2): "point_on_plane",
}
FREER_IN_THE_PLANE = {
    ("revolute", 1, 0): "point_on_line",
    ("fixed", 0, 1): "revolute",
    ("fixed", 1, 0): "prismatic",
    ("prismatic", 0, 1): "point_on_line",
}


def advice(system: System, rows: tuple[int, ...]) -> str:
    """Joint types that would do without some rows, in words."""
    counts = dict.fromkeys(names_of_rows(system, rows), 0)
    for name in names_of_rows(system, rows):
        counts[name] += 1
    return ", ".join(
        f"{name} as a {freer} joint{_axes(system, rows, name, freer)}"
        if freer
        else f"{name} with {counts[name]} constraint{'s'[: counts[name] > 1]} less"
        for name, freer in sorted(freer_joints(system, rows).items())
    )


def _axes(system: System, rows: tuple[int, ...], name: str, freer: str) -> str:
    """The axes of a freer joint that keeps the other constraints of a joint.

    Other ones would make singular configurations of their own. Where nothing is said
    the joint keeps its axis.
    """
    left: dict[int, list[Array]] = {at.ALONG: [], at.PERPENDICULAR: []}
    kept: dict[int, list[Array]] = {at.ALONG: [], at.PERPENDICULAR: []}
    for con in system.arrays.constraint:
        row, kind = int(con[at.ROW]), int(con[at.KIND])
        if kind in left and names_of_rows(system, (row,)) == [name]:
            found = left if row in rows else kept
            found[kind].append(system.arrays.pool[con[at.C_DATA] :][:6])
    was = system.scene.joints[name].type
    if freer == "universal":
        axis, second = kept[at.PERPENDICULAR][0].reshape(2, 3)
        return f" (axis = {_written(axis)}, second_axis = {_written(second)})"
    if was not in ("revolute", "spherical", "fixed") or freer == "cylindrical":
        return ""
    slides = (kept if freer == "point_on_plane" else left)[at.ALONG]
    if not slides:
        return ""
    axis = slides[0][:3]
    if system.planar:
        axis = np.array([np.cos(slides[0][0]), np.sin(slides[0][0])])
    return f" (axis = {_written(axis)})"


def _written(axis: Array) -> str:
    """Digits enough for a direction at right angles to another one."""
    return f"[{', '.join(f'{x:.10g}' for x in np.round(axis, 12) + 0.0)}]"


def freer_joints(system: System, rows: tuple[int, ...]) -> dict[str, str | None]:
    """Types that joints become without some of their rows; None for no standard one."""
    lost: dict[str, list[int]] = {}
    for row, name in zip(rows, names_of_rows(system, rows), strict=True):
        lost.setdefault(name, []).append(kind_of_row(system, row) in TURNING)
    known = FREER_IN_THE_PLANE if system.planar else FREER
    joints = system.scene.joints
    return {
        name: known.get((joints[name].type, len(own) - sum(own), sum(own)))
        if name in joints
        else None
        for name, own in lost.items()
    }


def kind_of_row(system: System, row: int) -> int:
    """Kind of the primitive constraint that a row belongs to."""
    first = [con for con in system.arrays.constraint if con[at.ROW] <= row]
    return int(max(first, key=lambda con: con[at.ROW])[at.KIND])
