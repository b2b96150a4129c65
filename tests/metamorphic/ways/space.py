"""A planar scene written in space: bodies that can only move flat."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.scene import as_3d
from tests.metamorphic.generator.case import Case, Table
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.poses import Pose
from tests.metamorphic.generator.said import (
    Said,
    as_spin,
    copied,
    kind,
    owner,
    with_table,
)
from tests.metamorphic.ways.descriptions import used_coordinates
from tests.metamorphic.ways.rewritten_bodies import inertia_3d

NORMAL = [0.0, 0.0, 1.0]


def in_space(case: Case, rng: Random) -> Said | None:
    """The same in space, without a constraint that others imply.

    A joint that hangs a body on bodies before it keeps it in the plane; one that closes
    a loop is one of points and lines that lie in the plane already.
    """
    if not case.planar:
        return None
    if any(
        "marker" in d and "angle" in d.values() for d in case.table["drives"].values()
    ):
        return None  # space prescribes a whole rotation
    turned = _turned(case)
    used = {name for name, _ in used_coordinates(case.table)}
    if turned & (used | set(case.table["forces"])):
        return None  # space does not know the whole turns that the plane counts
    table = copied(case)
    table["dimension"] = "spatial"
    table["gravity"] = _flat(table["gravity"])
    owners = [table["ground"], *(b for b in table["bodies"].values() if "mass" in b)]
    for part in owners:
        for name, marker in part["markers"].items():
            part["markers"][name] = Pose.of(marker).table(planar=False)
    for body in table["bodies"].values():
        initial = body["initial"]
        initial |= {"velocity": _flat(initial["velocity"])}
        initial["angular_velocity"] = as_spin(initial["angular_velocity"]).tolist()
        place = Pose.of(initial).table(planar=False)
        initial.pop("angle", None)
        body["initial"] = initial | place
        if "mass" in body:
            body["inertia"] = inertia_3d(body["inertia"]).tolist()
            body["centre_of_mass"] = _flat(body["centre_of_mass"])
    joints = _joints(table)
    if joints is None:
        return None
    table["joints"] = joints
    for force in table["forces"].values():
        if force["type"] == "force":
            force["force"] = _flat(force["force"])
            force["torque"] = as_spin(force["torque"]).tolist()
        if force["type"] == "bushing":
            for key in ("stiffness", "damping"):
                x, y, turn = force[key]
                force[key] = [x, y, x, turn, turn, turn]
    told = {"revolute", "prismatic", "fixed", "distance"}
    other = {n for n, joint in table["joints"].items() if joint["type"] not in told}
    measures = tuple(
        m
        for m in case.measures
        if owner(m) not in other
        and not (owner(m) in turned and kind(m) == "angle")
        and not (kind(m) == "angle" and owner(m) in table["bodies"])
    )
    return Said(with_table(case, table, measures=measures))


def _turned(case: Case) -> set[str]:
    """Joints and bushings whose angle is beyond half a turn at the start."""

    def angle(text: str) -> float:
        body, _, marker = text.partition(".")
        if case.is_flexible(body):
            return float(case.body(body)["initial"]["angle"])
        part = case.table["ground"] if body == "ground" else case.body(body)
        own = part["markers"][marker].get("angle", 0.0) if marker else 0.0
        return float(own + part.get("initial", {}).get("angle", 0.0))

    found = set()
    for name, part in (case.table["joints"] | case.table["forces"]).items():
        if "markers" in part and part["type"] != "spring_damper":
            first, second = part["markers"]
            if abs(angle(second) - angle(first)) > np.pi:
                found.add(name)
    return found


def _flat(vector: Any) -> list[float]:
    return [float(x) for x in as_3d(tuple(vector))]


def _joints(table: Table) -> dict[str, Table] | None:
    """Joints of the tree with all their constraints, closing ones without any spare."""
    used = {name for name, _ in used_coordinates(table)}
    group = {name: name for name in ("ground", *table["bodies"])}

    def root(name: str) -> str:
        return name if group[name] == name else root(group[name])

    found: dict[str, Table] = {}
    for name, joint in table["joints"].items():
        if "joints" in joint:
            found[name] = joint
            continue
        first, second = (root(text.split(".")[0]) for text in joint["markers"])
        closes = first == second or joint["type"] == "distance"
        loose = closes or joint["type"] == "point_on_line"
        needed = name in used or "friction" in joint
        if loose and needed and joint["type"] != "distance":
            return None  # the joint in space lacks the coordinate
        found |= _closing(name, joint) if closes else _hanging(name, joint)
        if not closes:
            group[max(first, second)] = min(first, second)
    for name in {root(body) for body in table["bodies"]} - {root("ground")}:
        found[f"{name}flat"] = {
            "type": "planar",
            "markers": ["ground", _any(table, name)],
        }
    return found


def _any(table: Table, name: str) -> str:
    return f"{name}.n1" if "sid" in table["bodies"][name] else name


def _hanging(name: str, joint: Table) -> dict[str, Table]:
    kind, markers = joint["type"], joint["markers"]
    if kind == "coincident":
        return {name: {"type": "revolute", "markers": markers}}
    if kind != "point_on_line":
        axis = {"axis": _flat(joint["axis"])} if "axis" in joint else {}
        return {name: joint | axis}
    plane = {"type": "planar", "markers": markers}
    return {name: _across(joint), f"{name}_flat": plane}


def _closing(name: str, joint: Table) -> dict[str, Table]:
    kind, markers = joint["type"], joint["markers"]
    if kind == "distance":
        return {name: joint}
    if kind == "point_on_line":
        return {name: _across(joint)}
    return {name: {"type": "point_on_line", "markers": markers, "axis": NORMAL}}


def _across(joint: Table) -> Table:
    x, y = joint["axis"]
    return {"type": "point_on_plane", "markers": joint["markers"], "axis": [-y, x, 0.0]}
