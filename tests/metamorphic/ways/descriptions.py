"""Order, names, markers, joints, functions and forces, said in other ways."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.metamorphic.generator import functions, laws
from tests.metamorphic.generator.case import Case, Table, Values
from tests.metamorphic.generator.ingredients import Random, coordinates_of
from tests.metamorphic.generator.said import (
    Said,
    copied,
    kind,
    owner,
    with_table,
    without,
)
from tests.metamorphic.generator.scenes import with_measures
from tests.metamorphic.ways.worlds import with_signs

PARTS = ("bodies", "joints", "drives", "forces")


def recorded(case: Case, rng: Random) -> Said:
    """Joint forces and energies are recorded where they were not, or no more."""
    has = any(kind(name) == "f" for name in case.measures)
    return Said(with_measures(case, forces=not has))


def balanced(case: Case, rng: Random) -> Said:
    """The energy balance is recorded, which needs the forces of all joints."""
    return Said(replace(case, measures=(*case.measures, "energy.balance")))


def kept_joints(case: Case, rng: Random) -> Said:
    """No joint is used up to describe where a body is."""
    return Said(case, settings={"keep_joints": True})


def reordered(case: Case, rng: Random) -> Said:
    """Bodies, joints, drives and forces in another order."""
    table = copied(case)
    for part in PARTS:
        names = list(table[part])
        table[part] = {
            names[k]: table[part][names[k]] for k in rng.permutation(len(names))
        }
    return Said(with_table(case, table))


def renamed(case: Case, rng: Random) -> Said:
    """Everything has another name."""
    names = [name for part in PARTS for name in case.table[part]]
    order = rng.permutation(len(names))
    new = {name: f"n{k}{name[0]}" for name, k in zip(names, order, strict=True)}

    def other(text: str) -> str:
        head, *tail = text.split(".")
        return ".".join([new.get(head, head), *tail])

    def walk(value: Any, key: str = "") -> Any:
        if key in ("joint", "marker", "reference"):
            return other(value)
        if key in ("markers", "joints") and isinstance(value, list):
            return [other(text) for text in value]
        if isinstance(value, dict):
            if laws.is_law(value if "type" in value else None):
                return laws.renamed(value, other)
            return {k: walk(v, k) for k, v in value.items()}
        return value

    table = walk(copied(case))
    for part in PARTS:
        table[part] = {new[name]: entry for name, entry in table[part].items()}
    measures = {other(measure): measure for measure in case.measures}
    renewed = Case(
        table, {new[name]: sid for name, sid in case.sids.items()}, tuple(measures)
    )
    return Said(renewed, lambda found: {measures[k]: v for k, v in found.items()})


def exchanged(case: Case, rng: Random) -> Said:
    """First and second marker of joints and forces between points exchanged."""
    table = copied(case)
    signs: dict[tuple[str, str], float] = {}
    swapped = set()
    for name, joint in table["joints"].items():
        if joint["type"] in (
            "planar",
            "point_on_line",
            "point_on_plane",
            "gear",
            "coupling",
        ):
            continue
        joint["markers"] = joint["markers"][::-1]
        swapped.add(name)
        for coordinate in coordinates_of(joint["type"]):
            signs[name, coordinate] = 1.0 if coordinate == "length" else -1.0
        if joint["type"] == "universal":
            joint["axis"], joint["second_axis"] = joint["second_axis"], joint["axis"]
    _cross_universals(table, signs)
    with_signs(table, signs)
    for force in table["forces"].values():
        if force["type"] in ("spring_damper", "actuator") and "markers" in force:
            force["markers"] = force["markers"][::-1]
    moved = {
        n
        for n in swapped
        if table["joints"][n]["type"] in ("prismatic", "distance", "cylindrical")
    }

    def back(values: Values) -> Values:
        new = {}
        for name, value in values.items():
            part, what = owner(name), kind(name)
            if part in swapped and what in ("f", "m"):
                value = -value
            if part in swapped and what in ("angle_1", "angle_2"):
                new[f"{part}.angle_{3 - int(what[-1])}"] = -value
                continue
            new[name] = signs.get((part, what), 1.0) * value
        return without(new, lambda n: kind(n) == "m" and owner(n) in moved)

    return Said(with_table(case, table), back)


def _cross_universals(table: Table, signs: dict[tuple[str, str], float]) -> None:
    """angle_1 of an exchanged universal joint is the old angle_2, with a sign."""
    crossed = {name for name, c in signs if c == "angle_1"}

    def other(name: str, coordinate: str) -> str:
        if name in crossed:
            return f"angle_{3 - int(coordinate[-1])}"
        return coordinate

    for part in (*table["drives"].values(), *table["forces"].values()):
        if "joint" in part:
            part["coordinate"] = other(part["joint"], part["coordinate"])
    for joint in table["joints"].values():
        if "joints" in joint:
            pairs = zip(joint["joints"], joint["coordinate"], strict=True)
            joint["coordinate"] = [other(*pair) for pair in pairs]


def callables(case: Case, rng: Random) -> Said | None:
    """Drives and forces by Python callables without derivatives."""
    table = copied(case)
    if not _functions(table):
        return None
    given = {}
    for part in ("drives", "forces"):
        entries = {n: e for n, e in table[part].items() if e in _functions(table)}
        given[part] = {n: functions.value(e["function"]) for n, e in entries.items()}
        for entry in entries.values():
            entry["function"] = {"type": "callable"}
    return Said(with_table(case, table, **given))


def polynomials(case: Case, rng: Random) -> Said | None:
    """Steps, tables and Hermite pieces by the coefficients of their polynomials."""
    table = copied(case)
    for part in _functions(table):
        part["function"] = functions.as_polynomial(part["function"])
    return None if table == case.table else Said(with_table(case, table))


def _functions(table: Table) -> list[Table]:
    """Drives and forces by functions of time."""
    parts = (*table["drives"].values(), *table["forces"].values())
    found = [part for part in parts if "function" in part]
    return [part for part in found if not laws.is_law(part["function"])]


def used_coordinates(table: Table) -> set[tuple[str, str]]:
    """(joint, coordinate) that drives, forces and gears act on, or that laws read."""
    users = (*table["drives"].values(), *table["forces"].values())
    used = {(u["joint"], u["coordinate"]) for u in users if "joint" in u}
    used |= {laws.measured(u["function"]) for u in users if _obeys_law(u)}
    for joint in table["joints"].values():
        if "joints" in joint:
            used |= set(zip(joint["joints"], joint["coordinate"], strict=True))
    return used


def _obeys_law(part: Table) -> bool:
    return laws.is_law(part.get("function"))


def other_joints(case: Case, rng: Random) -> Said | None:
    """Each joint by a freer one and a drive that holds, or two that do the same."""
    table = copied(case)
    used = {name for name, _ in used_coordinates(table)}
    changed = set()
    for name, joint in case.table["joints"].items():
        if "friction" in joint:
            continue  # which other joints do not have
        new = (
            _planar_joint(joint, name in used) if case.planar else _spatial_joint(joint)
        )
        if new is None:
            continue
        changed.add(name)
        extra, hold = new
        table["joints"][name] = extra[0]
        for k, more in enumerate(extra[1:]):
            table["joints"][f"{name}_{k}"] = more
        if hold:
            key = "joint" if hold[0] == "joint" else "marker"
            drive: Table = {"coordinate": hold[1]}
            drive |= {"function": {"type": "constant", "value": hold[2]}}
            if key == "joint":
                drive["joint"] = name
            else:
                drive |= {
                    "marker": joint["markers"][1],
                    "reference": joint["markers"][0],
                }
            table["drives"][f"{name}_held"] = drive
    if not changed:
        return None
    measures = tuple(
        m
        for m in case.measures
        if not (
            owner(m) in changed
            and m.split(".")[-1]
            not in coordinates_of(table["joints"][owner(m)]["type"])
        )
    )
    return Said(with_table(case, table, measures=measures))


Change = tuple[list[Table], tuple[Any, ...] | None]


def _planar_joint(joint: Table, used: bool) -> Change | None:
    kind, markers = joint["type"], joint.get("markers")
    if kind == "fixed":
        return [{"type": "revolute", "markers": markers}], ("joint", "angle", 0.0)
    if kind == "coincident":
        return [joint | {"type": "revolute"}], None
    if kind == "revolute" and not used:
        return [joint | {"type": "coincident"}], None
    if kind == "prismatic":
        return [joint | {"type": "point_on_line"}], ("marker", "angle", 0.0)
    return None


def _spatial_joint(joint: Table) -> Change | None:
    kind, markers = joint["type"], joint.get("markers")
    if kind == "fixed":
        return [{"type": "revolute", "markers": markers}], ("joint", "angle", 0.0)
    if kind == "revolute":
        return [joint | {"type": "cylindrical"}], ("joint", "displacement", 0.0)
    if kind == "prismatic":
        return [joint | {"type": "cylindrical"}], ("joint", "angle", 0.0)
    if kind == "spherical":
        return [joint | {"type": "coincident"}], None
    if kind == "coincident":
        line = {"type": "point_on_line", "markers": markers, "axis": [0.3, -0.5, 0.8]}
        return [line, line | {"type": "point_on_plane"}], None
    return None


def couplings(case: Case, rng: Random) -> Said | None:
    """Gears as couplings, and couplings of two joints as gears."""
    table = copied(case)
    for name, joint in table["joints"].items():
        where = {key: joint[key] for key in ("joints", "coordinate") if key in joint}
        if joint["type"] == "gear":
            weights = {"weights": [-joint["ratio"], 1.0], "offset": joint["offset"]}
            table["joints"][name] = {"type": "coupling", **weights, **where}
        elif joint["type"] == "coupling" and len(joint["joints"]) == 2:
            first, second = joint["weights"]
            ratio = {"ratio": -first / second, "offset": joint["offset"] / second}
            table["joints"][name] = {"type": "gear", **ratio, **where}
    return None if table == case.table else Said(with_table(case, table))


def springs(case: Case, rng: Random) -> Said | None:
    """Springs without a rest length beside actuators; linear parts as tables."""
    table = copied(case)
    found = {
        n: f
        for n, f in table["forces"].items()
        if "stiffness" in f and f["type"] == "spring_damper"
    }
    if not found:
        return None
    for name, force in found.items():
        where = {k: force[k] for k in ("markers", "joint", "coordinate") if k in force}
        powers = np.polynomial.Polynomial([0.0, *force["stiffness"]])
        plain = powers(np.polynomial.Polynomial([-force["rest"], 1.0])).coef
        push = {"type": "constant", "value": -float(plain[0])}
        table["forces"][name] = {"type": "actuator", "function": push, **where}
        ways = np.array([-10.0, -1.0, 3.0, 10.0])
        law = {"deflection": ways.tolist(), "force": (plain[1] * ways).tolist()}
        line = {"type": "spring_damper", "table": law, **where}
        table["forces"][f"{name}_line"] = line
        rest = plain[2:].tolist()
        if rest:
            curve = {"type": "spring_damper", "stiffness": [0.0, *rest], **where}
            table["forces"][f"{name}_curve"] = curve
        damper = {"type": "spring_damper", "damping": force.get("damping", 0.0)}
        table["forces"][f"{name}_damper"] = damper | where
    return Said(with_table(case, table))


def halved_forces(case: Case, rng: Random) -> Said | None:
    """Each force twice, with half the strength."""
    if not case.table["forces"]:
        return None
    table = copied(case)
    halves = {}
    for name, force in table["forces"].items():
        if force["type"] in ("force", "actuator"):
            force["function"] = functions.scaled(force["function"], 0.5)
        for key in ("stiffness", "damping"):
            if key in force:
                force[key] = (0.5 * np.array(force[key])).tolist()
        if "table" in force:
            force["table"]["force"] = [0.5 * f for f in force["table"]["force"]]
        if force["type"] == "friction":
            force |= {key: 0.5 * force[key] for key in ("force", "viscous")}
        halves[name], halves[f"{name}_too"] = force, force
    table["forces"] = halves
    return Said(with_table(case, table))
