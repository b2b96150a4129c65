"""The whole world turned, shifted, mirrored, boosted, later."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import as_3d
from tests.metamorphic.generator import functions, laws
from tests.metamorphic.generator.case import Case, Table, Values, times
from tests.metamorphic.generator.ingredients import Random, unit
from tests.metamorphic.generator.poses import Pose, replaced, turned
from tests.metamorphic.generator.said import (
    Said,
    as_spin,
    components,
    copied,
    kind,
    owner,
    spin,
    vectors_times,
    with_table,
    without,
)
from tests.metamorphic.ways.sids import in_axes

Z = np.array([0.0, 0.0, 1.0])


def turned_world(case: Case, rng: Random) -> Said:
    """Everything turned about the origin."""
    angle = float(rng.uniform(-3.0, 3.0))
    return _moved(
        case, Pose(np.zeros(3), turned(Z if case.planar else unit(rng), angle))
    )


def shifted_world(case: Case, rng: Random) -> Said:
    """Everything 30 m away."""
    shift = 30.0 * rng.normal(size=3) * ([1, 1, 0] if case.planar else 1)
    return _moved(case, Pose(shift, np.eye(3)))


def _moved(case: Case, pose: Pose) -> Said:
    table, planar = copied(case), case.planar
    R = pose.R
    angle = float(np.arctan2(R[1, 0], R[0, 0]))

    def place(old: Table) -> Table:
        start = old | ({"angle": old.get("angle", 0.0) + angle} if planar else {})
        return replaced(start, pose.then(Pose.of(old)), planar)

    markers = table["ground"]["markers"]
    for name in markers:
        markers[name] = place(markers[name])
    for body in table["bodies"].values():
        initial = body["initial"] = place(body["initial"])
        initial["velocity"] = components(R @ as_3d(initial["velocity"]), planar)
        initial["angular_velocity"] = spin(
            R @ as_spin(initial["angular_velocity"]), planar
        )
    table["gravity"] = components(R @ as_3d(table["gravity"]), planar)
    for force in table["forces"].values():
        if force["type"] == "force" and force["axes"] == "inertial":
            force["force"] = components(R @ as_3d(force["force"]), planar)
            force["torque"] = spin(R @ as_spin(force["torque"]), planar)

    def back(values: Values) -> Values:
        new = {
            k: v - pose.x if kind(k) == "x" else v - angle if _is_angle(case, k) else v
            for k, v in values.items()
        }
        return vectors_times(new, R.T)

    return Said(with_table(case, table), back)


def _is_angle(case: Case, measure: str) -> bool:
    return kind(measure) == "angle" and owner(measure) in case.table["bodies"]


def mirrored(case: Case, rng: Random) -> Said:
    """Everything seen in a mirror, right-handed frames again in all bodies."""
    S, planar = np.diag([-1.0, 1.0, 1.0]), case.planar
    table = copied(case)

    def place(old: Table) -> Table:
        pose = Pose.of(old)
        start = old | ({"angle": -old.get("angle", 0.0)} if planar else {})
        return replaced(start, Pose(S @ pose.x, S @ pose.R @ S), planar)

    owners = [table["ground"], *(b for b in table["bodies"].values() if "mass" in b)]
    for part in owners:
        part["markers"] = {name: place(m) for name, m in part["markers"].items()}
    for body in table["bodies"].values():
        initial = body["initial"] = place(body["initial"])
        initial["velocity"] = components(S @ as_3d(initial["velocity"]), planar)
        initial["angular_velocity"] = spin(
            -S @ as_spin(initial["angular_velocity"]), planar
        )
        if "mass" in body:
            body["centre_of_mass"] = components(
                S @ as_3d(body["centre_of_mass"]), planar
            )
        if np.ndim(body.get("inertia", 0.0)) == 2:
            body["inertia"] = (S @ np.array(body["inertia"]) @ S).tolist()
    for joint in table["joints"].values():
        for key in ("axis", "second_axis"):
            if key in joint:
                joint[key] = components(S @ as_3d(joint[key]), planar)
    table["gravity"] = components(S @ as_3d(table["gravity"]), planar)
    for force in table["forces"].values():
        if force["type"] == "force":
            force["force"] = components(S @ as_3d(force["force"]), planar)
            force["torque"] = spin(-S @ as_spin(force["torque"]), planar)
    turns = {
        (name, c): -1.0 if c.startswith("angle") else 1.0
        for name, joint in table["joints"].items()
        for c in ("angle", "angle_1", "angle_2", "displacement", "length")
        if "markers" in joint
    }
    with_signs(table, turns)
    for drive in table["drives"].values():
        if drive.get("coordinate") in ("x", "angle", "rotation") and "marker" in drive:
            drive["function"] = functions.scaled(drive["function"], -1.0)
        if "axis" in drive:
            drive["axis"] = components(S @ as_3d(drive["axis"]), planar)
    sids = {name: in_axes(sid, S) for name, sid in case.sids.items()}

    def back(values: Values) -> Values:
        new = vectors_times(values, S, axial=-1.0)
        return {k: -v if kind(k).startswith("angle") else v for k, v in new.items()}

    return Said(with_table(case, table, sids=sids), back)


def with_signs(table: Table, signs: dict[tuple[str, str], float]) -> None:
    """Drives, forces and gears of joints whose coordinates change their signs."""
    for drive in table["drives"].values():
        key = (drive.get("joint"), drive["coordinate"])
        drive["function"] = functions.scaled(drive["function"], signs.get(key, 1.0))
    for force in table["forces"].values():
        if "joint" not in force:
            continue
        own = signs.get((force["joint"], force["coordinate"]), 1.0)
        law = force.get("function")
        if laws.is_law(law):
            read = signs.get(laws.measured(law), 1.0)
            force["function"] = laws.in_signs(law, own, read)
        elif own == -1.0:
            _negated(force)
    for joint in table["joints"].values():
        if joint["type"] == "gear":
            pairs = zip(joint["joints"], joint["coordinate"], strict=True)
            first, second = (signs.get(pair, 1.0) for pair in pairs)
            joint["ratio"] *= first * second
            joint["offset"] *= second
        if joint["type"] == "coupling":
            keys = zip(joint["joints"], joint["coordinate"], strict=True)
            turned = [signs.get(key, 1.0) for key in keys]
            joint["weights"] = (np.array(joint["weights"]) * turned).tolist()


def _negated(force: Table) -> None:
    """A force in a joint whose coordinate changes its sign."""
    if force["type"] == "actuator":
        force["function"] = functions.scaled(force["function"], -1.0)
    if force["type"] == "spring_damper":
        force["rest"] = -force["rest"]
        assert len(force["stiffness"]) == 1


def boosted(case: Case, rng: Random) -> Said:
    """The ground on a carriage that moves, partly falling: Galilei and Einstein.

    In a frame that accelerates by -c g gravity appears as (1 + c) g.
    """
    table, planar = copied(case), case.planar
    flat = np.array([1.0, 1.0, 0.0]) if planar else np.ones(3)
    V, share = 2.0 * rng.normal(size=3) * flat, float(rng.uniform(0.3, 1.0))
    g = as_3d(table["gravity"])
    start = case.table["time"]["start"]

    def way(t: Any) -> Array:
        t = np.atleast_1d(t)[:, None] - start
        return np.asarray(V * t + 0.5 * share * g * t**2)

    def speed(t: Any) -> Array:
        return np.asarray(V + share * g * (np.atleast_1d(t)[:, None] - start))

    table["gravity"] = components((1.0 + share) * g, planar)
    carriage: Table = {"mass": 1.0, "markers": table["ground"]["markers"]}
    carriage["inertia"] = 1.0 if planar else [1.0, 1.0, 1.0]
    carriage["initial"] = {"velocity": components(V, planar)}
    carriage["markers"]["middle"] = {}
    table["ground"] = {"markers": {}}
    for k, axis in enumerate("xy" if planar else "xyz"):
        function = {
            "type": "polynomial",
            "pieces": [
                {
                    "from": start,
                    "coefficients": [0.0, float(V[k]), 0.5 * share * float(g[k])],
                }
            ],
        }
        drive = {"marker": "carriage.middle", "coordinate": axis, "function": function}
        table["drives"][f"carriage_{axis}"] = drive
    held: Table = {"marker": "carriage.middle", "function": _constant(0.0)}
    held |= (
        {"coordinate": "angle"}
        if planar
        else {"coordinate": "rotation", "axis": [0.0, 0.0, 1.0]}
    )
    table["drives"]["carriage_turn"] = held
    for body in table["bodies"].values():
        moving = as_3d(body["initial"]["velocity"]) + V
        body["initial"]["velocity"] = components(moving, planar)
    _rename_ground(table, "carriage")
    table["bodies"]["carriage"] = carriage
    t = times(case)

    def back(values: Values) -> Values:
        new = dict(values)
        for name, value in values.items():
            if kind(name) == "x":
                new[name] = value - way(t)
            if kind(name) == "v":
                new[name] = value - speed(t)
        return without(new, lambda name: name.endswith("kinetic"))

    return Said(with_table(case, table), back)


def _constant(value: float) -> Table:
    return {"type": "constant", "value": value}


def _rename_ground(table: Table, name: str) -> None:
    for part in (*table["joints"].values(), *table["forces"].values()):
        if "markers" in part:
            part["markers"] = [
                f"{name}{text[6:]}" if text.startswith("ground") else text
                for text in part["markers"]
            ]
    for drive in table["drives"].values():
        if drive.get("reference", "").startswith("ground"):
            drive["reference"] = f"{name}{drive['reference'][6:]}"


def later(case: Case, rng: Random) -> Said:
    """The same at another time of day."""
    table, delay = copied(case), float(rng.uniform(-5.0, 5.0))
    table["time"]["start"] += delay
    table["time"]["end"] += delay
    for part in (*table["drives"].values(), *table["forces"].values()):
        if "function" in part:
            part["function"] = functions.later(part["function"], delay)
    return Said(with_table(case, table))
