"""A scene in other units of length, mass and time."""

from __future__ import annotations

import numpy as np

from tests.metamorphic.generator import functions, laws
from tests.metamorphic.generator.case import Case, Table, Values
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.said import Said, copied, kind, with_table
from tests.metamorphic.ways import damping
from tests.solver.transformed import Units, sid_in


def in_units(case: Case, rng: Random) -> Said:
    """Lengths, masses and times in other units."""
    case = damping.as_matrices(case, ("frequency",))  # which counts in hertz
    units = Units(*(float(x) for x in rng.choice([1e-3, 0.1, 7.0, 1e3], 3)))
    table, length, time = copied(case), units.length, units.time
    force, torque, angular = units.force, units.torque, 1.0 / time
    for key in ("start", "end", "output_step"):
        table["time"][key] *= time
    _scale(table, "gravity", units.factor(1, 0, -2))
    for part in (
        table["ground"],
        *(b for b in table["bodies"].values() if "mass" in b),
    ):
        for marker in part["markers"].values():
            _scale(marker, "position", length)
    for body in table["bodies"].values():
        _scale(body.get("damping", {}), "alpha", angular)
        _scale(body.get("damping", {}), "beta", time)
        _scale(body, "mass", units.mass)
        _scale(body, "inertia", units.factor(2, 1))
        _scale(body, "centre_of_mass", length)
        for key, factor in {
            "position": length,
            "velocity": length / time,
            "angular_velocity": angular,
            "elastic_velocity": angular,
        }.items():
            _scale(body["initial"], key, factor)
    lengths = ("displacement", "length", "x", "y", "z")
    for joint in table["joints"].values():
        _scale(joint, "length", length)
        rubbing = joint.get("friction", {})
        for key in ("radius", "length"):
            _scale(rubbing, key, length)
        _scale(rubbing, "stribeck_velocity", length / time)
        turns = joint["type"] == "revolute"
        _scale(rubbing, "viscous", time * (torque if turns else force / length))
        if joint["type"] == "gear":
            first, second = (
                length if c in lengths else 1.0 for c in joint["coordinate"]
            )
            joint["ratio"] *= second / first
            joint["offset"] *= second
        if joint["type"] == "coupling":
            ways = [length if c in lengths else 1.0 for c in joint["coordinate"]]
            joint["weights"] = (np.array(joint["weights"]) / ways).tolist()
    for drive in table["drives"].values():
        factor = length if drive["coordinate"] in lengths else 1.0
        function = functions.in_time_unit(drive["function"], time)
        drive["function"] = functions.scaled(function, factor)
    for entry in table["forces"].values():
        turns = entry.get("coordinate", "").startswith("angle")
        _scale_force(entry, torque if turns else force, 1.0 if turns else length, units)
    sids = {name: sid_in(sid, units) for name, sid in case.sids.items()}
    factors = {
        "x": length,
        "v": length / time,
        "w": angular,
        "vq": angular,
        "f": force,
        "m": torque,
        "kinetic": torque,
        "elastic": torque,
        "displacement": length,
        "length": length,
    }

    def back(values: Values) -> Values:
        return {k: v / factors.get(kind(k), 1.0) for k, v in values.items()}

    return Said(with_table(case, table, sids=sids), back)


def _scale_force(entry: Table, force: float, way: float, units: Units) -> None:
    time, law = units.time, entry.get("function")
    if laws.is_law(law):
        turns = laws.measured(law)[1].startswith("angle")
        read = 1.0 if turns else units.length
        entry["function"] = laws.in_units(law, force, read, time)
        return
    if "function" in entry:
        entry["function"] = functions.in_time_unit(entry["function"], time)
    if entry["type"] == "actuator":
        entry["function"] = functions.scaled(entry["function"], force)
    if entry["type"] == "force":
        _scale(entry, "force", units.force)
        _scale(entry, "torque", units.torque)
    if entry["type"] == "spring_damper":
        _scale(entry, "rest", way)
        _scale(entry, "damping", force / (way / time))
        for k, value in enumerate(entry.get("stiffness", ())):
            entry["stiffness"][k] = value * force / way ** (k + 1)
        if "table" in entry:
            _scale(entry["table"], "deflection", way)
            _scale(entry["table"], "force", force)
    if entry["type"] == "friction":
        _scale(entry, "force", force)
        _scale(entry, "speed", way / time)
        _scale(entry, "viscous", force / (way / time))
    if entry["type"] == "bushing":
        half = 2 if len(entry["stiffness"]) == 3 else 3
        for key, power in (("stiffness", 0), ("damping", 1)):
            entry[key] = [
                value
                * time**power
                * (units.factor(0, 1, -2) if k < half else units.torque)
                for k, value in enumerate(entry[key])
            ]


def _scale(table: Table, key: str, factor: float) -> None:
    if table.get(key) is not None:
        table[key] = (factor * np.array(table[key])).tolist()
