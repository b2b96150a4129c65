"""Optional keys of a scene, left out or written with the values that the docs give.

`DEFAULTS` holds, for each table of a scene file, what its optional keys mean if they
are left out. Some properties of a scene are first set to their defaults, so that there
is something to leave out: axes (the markers are turned), gravity, damping, ...
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, get_args

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import as_3d
from sidtool.formats.scene.forces import Force
from sidtool.formats.scene.joints import Joint
from sidtool.formats.scene.laws import ForceFunction
from tests.metamorphic.generator.case import Case, Table
from tests.metamorphic.generator.ingredients import Random, coordinates_of
from tests.metamorphic.generator.poses import ORIENTATIONS, Pose, replaced
from tests.metamorphic.generator.said import Said, copied, with_table
from tests.metamorphic.generator.scenes import settled

#: Share of the keys that are left out, and of what is set to its default before.
LEFT_OUT, RESET = 0.8, 0.5
X, Y, Z = np.eye(3)
#: Where axes of joints point that a scene does not state.
AXES = {
    "revolute": Z,
    "prismatic": X,
    "cylindrical": Z,
    "universal": X,
    "planar": Z,
    "point_on_line": X,
    "point_on_plane": Z,
}
#: Joints whose axis is fixed to both markers.
ORIENTING = ("revolute", "prismatic", "cylindrical", "planar")

#: The value of a key that is left out, of a table of a case; None if there is none.
Default = Callable[[Case, Table], Any]


def _is(value: Any) -> Default:
    return lambda case, table: value


def _zeros(planar: int, spatial: int) -> Default:
    """Zero components; one component is a number."""

    def zeros(case: Case, table: Table) -> Any:
        count = planar if case.planar else spatial
        return 0.0 if count == 1 else [0.0] * count

    return zeros


def _axis(case: Case, joint: Table) -> Any:
    if case.planar and joint["type"] == "revolute":
        return None  # planar scenes know it
    axis = AXES.get(joint["type"])
    return None if axis is None else axis[: 2 if case.planar else 3].tolist()


def _second_axis(case: Case, joint: Table) -> Any:
    """Bodies are placed as the joint needs them: the same axis, seen from both."""
    if joint["type"] == "universal":
        return Y.tolist()
    if joint["type"] not in ORIENTING:
        return None
    if case.planar and joint["type"] == "revolute":
        return None
    if any(map(case.is_flexible, _bodies(joint))):
        return None  # deformation turns their markers
    return joint.get("axis", _axis(case, joint))


def _coordinate(case: Case, table: Table) -> Any:
    joint = case.table["joints"].get(table.get("joint"))
    return coordinates_of(joint["type"])[0] if joint else None


def _coordinates(case: Case, joint: Table) -> Any:
    kinds = [case.table["joints"][name]["type"] for name in joint["joints"]]
    return [coordinates_of(kind)[0] for kind in kinds]


def _written(key: str) -> Default:
    """What the scene was drawn with: a constant is that of the start."""
    return lambda case, table: table.get(key)


def _all_shape_functions(case: Case, body: Table) -> Any:
    return list(range(1, case.sids[body["sid"]].nq + 1))


def _anti_windup(case: Case, law: Table) -> Any:
    p, i, d = (law.get(key, 0.0) for key in "pid")
    if "limits" not in law:
        return None
    return (math.sqrt(abs(d / i)) if d else abs(p / i)) if i else None


def _static(case: Case, friction: Table) -> Any:
    return None if "stribeck_velocity" in friction else friction["coefficient"]


def _undeformed(case: Case, initial: Table) -> Any:
    for name, body in case.table["bodies"].items():
        if body.get("initial") is initial:
            return [0.0] * case.sids[name].nq
    return None


def _interpolation(case: Case, table: Table) -> Any:
    moves = any(table is d["function"] for d in case.table["drives"].values())
    return "smooth" if moves else "linear"


def _no_turn(case: Case, place: Table) -> Any:
    stated = any(key in place for key in ORIENTATIONS if key != "matrix")
    return None if case.planar or stated else np.eye(3).tolist()


def _no_angle(case: Case, place: Table) -> Any:
    return 0.0 if case.planar else None


PLACE: dict[str, Default] = {
    "position": _zeros(2, 3),
    "angle": _no_angle,
    "matrix": _no_turn,
}
START = PLACE | {
    "velocity": _zeros(2, 3),
    "angular_velocity": _zeros(1, 3),
    "fixed": _is(False),
}
COUPLED: dict[str, Default] = {
    "coordinate": _coordinates,
    "offset": _written("offset"),
}
ORIENTED: dict[str, Default] = {"axis": _axis, "second_axis": _second_axis}
PAIR: dict[str, Default] = {"coordinate": _coordinate}
#: By class of `formats.scene` and key.
DEFAULTS: dict[str, dict[str, Default]] = {
    "SceneFile": {
        "tables": _is({}),
        "gravity": _zeros(2, 3),
        "title": _is(""),
        "parameters": _is({}),
        "accuracy": _is({}),
        "inputs": _is({}),
        "initial": _is({}),
        "events": _is({}),
        "joints": _is({}),
        "drives": _is({}),
        "forces": _is({}),
        "ground": _is({"markers": {}}),
        "diagnostics": _is({}),
    },
    "Diagnostics": {"ignore": _is([])},
    "Start": {"state": _is("stated")},
    "Accuracy": {"integrator": _is("radau9"), "spectral_radius": _is(0.8)},
    "Time": {"start": _is(0.0)},
    "Ground": {"markers": _is({})},
    "Marker": PLACE,
    "Initial": START,
    "ElasticInitial": START | {"elastic": _undeformed, "elastic_velocity": _undeformed},
    "RigidBody": {
        "centre_of_mass": _zeros(2, 3),
        "markers": _is({}),
        "initial": _is({}),
    },
    "SidBody": {
        "frame": _is("free"),
        "rigid": _is(False),
        "shape_functions": _all_shape_functions,
        "geometric_stiffening": _is(True),
        "damping": _is({"type": "sid"}),
        "markers": _is({}),
        "initial": _is({}),
    },
    "Revolute": ORIENTED,
    "Prismatic": ORIENTED,
    "Cylindrical": ORIENTED,
    "PlanarJoint": ORIENTED,
    "Universal": ORIENTED,
    "PointOnLine": {"axis": _axis},
    "PointOnPlane": {"axis": _axis},
    "Distance": {"length": _written("length")},
    "Gear": COUPLED,
    "Coupling": COUPLED,
    "JointFriction": {
        "static": _static,
        "viscous": _is(0.0),
    },
    "Drive": {
        "reference": lambda case, table: "ground" if "marker" in table else None,
        "coordinate": _coordinate,
        "of": _is("value"),
    },
    "PointForce": {
        "force": _zeros(2, 3),
        "torque": _zeros(1, 3),
        "axes": _is("inertial"),
        "function": _is({"type": "constant", "value": 1.0}),
    },
    "SpringDamper": PAIR | {"rest": _is(0.0), "damping": _is([0.0])},
    "Characteristic": {"interpolation": _is("linear")},
    "Actuator": PAIR | {"rest": _is(0.0)},
    "Bushing": {"damping": _zeros(3, 6)},
    "Friction": PAIR | {"viscous": _is(0.0)},
    "Harmonic": {"offset": _is(0.0), "phase": _is(0.0)},
    "SmoothStep": {"start": _is(0.0), "continuity": _is(2)},
    "Spline": {
        "interpolation": _interpolation,
        "ends": _is("not-a-knot"),
        "scale": _is(1.0),
    },
    "Expression": {"parameters": _is({}), "states": _is({})},
    "Pid": {
        "reference": _is(0.0),
        "p": _is(0.0),
        "i": _is(0.0),
        "d": _is(0.0),
        "anti_windup": _anti_windup,
    },
}


def _class_names(*unions: Any) -> dict[str, str]:
    """Class of each kind of table by its `type`."""
    kinds = [kind for union in unions for kind in get_args(get_args(union)[0])]
    return {kind.model_fields["type"].default: kind.__name__ for kind in kinds}


JOINTS, FORCES = _class_names(Joint), _class_names(Force)
FUNCTIONS = _class_names(ForceFunction)
#: What a scene may do without, by class; of functions only where they act as forces.
SPARE = {
    "SceneFile": ("gravity",),
    "RigidBody": ("centre_of_mass",),
    "SidBody": ("damping", "geometric_stiffening"),
    "JointFriction": ("stribeck_velocity", "viscous"),
    "PointForce": ("axes", "function", "torque"),
    "SpringDamper": ("damping",),
    "Bushing": ("damping",),
    "Friction": ("viscous",),
    "SmoothStep": ("continuity",),
    "Spline": ("ends",),
}
SPARE_OF_FORCES = {
    "Harmonic": ("offset", "phase"),
    "SmoothStep": ("start",),
    "Spline": ("interpolation",),
    "Pid": ("reference", "i"),
}


def keys_left_out(case: Case, rng: Random) -> Said | None:
    """Optional keys are left out of one scene, and written in the other one."""
    table = copied(case)
    bare = with_table(case, table)
    _turn_markers(bare, rng)
    _drop_spare(bare, rng)
    base = settled(bare)
    full, short = copied(base), copied(base)
    written, left_out = with_table(base, full), with_table(base, short)
    for kind, part in _tables(written):
        for key, default in DEFAULTS.get(kind, {}).items():
            value = default(written, part)
            if key not in part and value is not None:
                part[key] = value
    for kind, part in _tables(left_out):
        for key, default in DEFAULTS.get(kind, {}).items():
            value = default(left_out, part)
            if key in part and _equal(part[key], value) and rng.random() < LEFT_OUT:
                del part[key]
    return Said(left_out, base=written)


def _drop_spare(case: Case, rng: Random) -> None:
    drives = [drive["function"] for drive in case.table["drives"].values()]
    for kind, part in _tables(case):
        keys = SPARE.get(kind, ())
        if not any(part is function for function in drives):
            keys += SPARE_OF_FORCES.get(kind, ())
        for key in keys:
            if key in part and rng.random() < RESET:
                del part[key]
        if kind == "JointFriction" and "stribeck_velocity" not in part:
            part["static"] = part["coefficient"]
        if kind == "Pid" and rng.random() < RESET:
            part["limits"] = [-1.5, 1.5]
    if rng.random() < RESET:
        for body in case.table["bodies"].values():
            for key in ("velocity", "angular_velocity", "elastic_velocity"):
                body["initial"].pop(key, None)


def _turn_markers(case: Case, rng: Random) -> None:
    """Turn both markers of some joints, so that their axes are the default ones."""
    table, users = case.table, Counter(_marker_names(case.table))
    for joint in table["joints"].values():
        if "axis" not in joint or any(map(case.is_flexible, _bodies(joint))):
            continue
        ends = joint["markers"]
        free = all(users[end] == 1 and end.count(".") == 1 for end in ends)
        if not free or rng.random() > RESET:
            continue
        kind = joint["type"]
        R = _rotation_to(kind, joint)
        for end in ends:
            name, marker = end.split(".")
            part = table["ground"] if name == "ground" else table["bodies"][name]
            old = part["markers"][marker]
            pose = Pose.of(old).then(Pose(np.zeros(3), R))
            part["markers"][marker] = replaced(old, pose, case.planar)
            if case.planar:  # both angles change alike, turns and all
                angle = float(np.arctan2(R[1, 0], R[0, 0]))
                part["markers"][marker]["angle"] = old.get("angle", 0.0) + angle
        joint["axis"] = _axis(case, joint)
        if kind == "universal":
            joint["second_axis"] = Y.tolist()


def _rotation_to(kind: str, joint: Table) -> Array:
    """A rotation (3, 3) that takes the default axes of a joint to its own."""
    axis = as_3d(joint["axis"]) / np.linalg.norm(joint["axis"])
    if len(joint["axis"]) == 2:
        second = np.cross(Z, axis)
    else:
        other = joint.get("second_axis", np.eye(3)[np.argmin(np.abs(axis))])
        second = other - axis * (axis @ other)
        second /= np.linalg.norm(second)
    own = np.column_stack([axis, second, np.cross(axis, second)])
    return own @ np.roll(np.eye(3), -int(np.argmax(AXES[kind])), axis=0)


def _marker_names(table: Table) -> Iterator[str]:
    for kind in ("joints", "drives", "forces"):
        for part in table[kind].values():
            yield from part.get("markers", ())
            yield from (part[key] for key in ("marker", "reference") if key in part)


def _bodies(joint: Table) -> list[str]:
    return [end.partition(".")[0] for end in joint["markers"]]


def _equal(value: Any, default: Any) -> bool:
    if isinstance(default, list):
        return np.shape(value) == np.shape(default) and bool(np.all(value == default))
    return default is not None and bool(value == default)


def _tables(case: Case) -> Iterator[tuple[str, Table]]:
    """Tables of a scene that have optional keys, inner ones first, by class."""
    table = case.table
    for part in (*table["drives"].values(), *table["forces"].values()):
        function = part.get("function", {})
        if function:
            yield FUNCTIONS[function["type"]], function
        if "table" in part:
            yield "Characteristic", part["table"]
    for joint in table["joints"].values():
        if "friction" in joint:
            yield "JointFriction", joint["friction"]
        yield JOINTS[joint["type"]], joint
    yield from (("Drive", drive) for drive in table["drives"].values())
    yield from ((FORCES[force["type"]], force) for force in table["forces"].values())
    for body in table["bodies"].values():
        flexible = "sid" in body
        if not flexible:
            yield from (("Marker", marker) for marker in body["markers"].values())
        yield "ElasticInitial" if flexible else "Initial", body["initial"]
        yield "SidBody" if flexible else "RigidBody", body
    if "ground" in table:
        yield from (("Marker", m) for m in table["ground"].get("markers", {}).values())
    for key, kind in (("time", "Time"), ("accuracy", "Accuracy"), ("initial", "Start")):
        yield kind, table.setdefault(key, {})
    yield "SceneFile", table
