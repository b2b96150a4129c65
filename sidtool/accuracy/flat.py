"""A spatial scene whose motion stays in a plane z = const, as a planar scene.

What cannot act in the plane is left out: out-of-plane forces, stiffness and inertia,
and joints that only keep bodies in it. Whether the motion does stay there is not asked
here: the planar scene is run and compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene import parse_output as parsed
from sidtool.formats.scene.base import Placement, as_3d, rotation
from sidtool.formats.scene.outputs import MULTIPLIER
from sidtool.formats.toml.reading import validated

#: A direction lies along z, or across it, up to this.
ALIGNED = 1e-9
#: What leaves the plane by less than this part of the size of its kind does not.
IN_PLANE = 1e-9
#: Quantities that are zero in the plane z = 0.
ACROSS = frozenset(
    ["z", "uz", "vz", "az", "wx", "wy", "fz", "mx", "my"]
    + ["vz_body", "wx_body", "wy_body", "quaternion_1", "quaternion_2"]
    + ["rotation_x", "rotation_y", "momentum_z"]
    + ["angular_momentum_x", "angular_momentum_y", "sigma_yz", "sigma_xz"]
)

_Table = dict[str, Any]


class _NotFlat(Exception):
    pass


def in_plane(scene: SceneFile) -> SceneFile | None:
    """The planar scene; None where bodies, joints or forces point out of the plane."""
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    quantities = (name.rpartition(".")[2] for name in scene.outputs.record)
    if any(map(MULTIPLIER.fullmatch, quantities)):
        return None
    content["dimension"] = "planar"
    try:
        _flatten(content, scene)
        return validated(content, SceneFile)
    except (_NotFlat, InputError):
        return None


def is_across(output: str) -> bool:
    """Whether a planar scene has zero for it."""
    name = parsed(output)
    owner_is_sum = name.owner in ("momentum", "angular_momentum")
    if owner_is_sum:
        return (name.quantity == "z") == (name.owner == "momentum")
    return name.quantity in ACROSS


def _flatten(content: _Table, scene: SceneFile) -> None:
    if scene.gravity is not None:
        content["gravity"] = list(scene.gravity[:2])
    _markers(content["ground"], scene.ground.markers)
    for name, body in scene.bodies.items():
        table = content["bodies"][name]
        if "mass" in table:
            _markers(table, body.markers)
            _mass(table)
        _initial(table["initial"], body.initial)
    joints = {n: _joint(table) for n, table in content["joints"].items()}
    content["joints"] = {n: table for n, table in joints.items() if table is not None}
    drives = {n: _drive(table) for n, table in content["drives"].items()}
    content["drives"] = {n: table for n, table in drives.items() if table is not None}
    for table in content["forces"].values():
        _force(table)


def _markers(table: _Table, markers: Mapping[str, Any]) -> None:
    for name, marker in markers.items():
        if isinstance(marker, Placement):
            table["markers"][name] = _placed(marker)


def _placed(placement: Placement) -> _Table:
    """Place and angle in the plane."""
    turn = rotation(placement)
    if abs(turn[2, 2] - 1.0) > ALIGNED:
        raise _NotFlat
    x, y, _ = as_3d(placement.position)
    angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return {"position": [float(x), float(y)], "angle": angle}


def _initial(table: _Table, initial: Any) -> None:
    for key in ("axis_angle", "quaternion", "matrix"):
        table.pop(key, None)
    table |= _placed(initial)
    if initial.velocity is not None:
        table["velocity"] = list(initial.velocity[:2])
    if initial.angular_velocity is not None:
        table["angular_velocity"] = initial.angular_velocity[2]


def _mass(table: _Table) -> None:
    if "centre_of_mass" in table:
        table["centre_of_mass"] = table["centre_of_mass"][:2]
    if "inertia" in table:
        zz = table["inertia"][2]
        table["inertia"] = zz[2] if isinstance(zz, list) else zz


def _direction(axis: Any, default: tuple[float, float, float]) -> str:
    """Whether an axis lies "along" z, upwards, or "across" it."""
    vector = as_3d(tuple(axis) if axis is not None else default)
    vector /= np.linalg.norm(vector)
    if vector[2] > 1.0 - ALIGNED:
        return "along"
    if abs(vector[2]) > ALIGNED:
        raise _NotFlat
    return "across"


def _joint(table: _Table) -> _Table | None:
    """The joint in the plane, None if it only keeps bodies there."""
    kind = table["type"]
    if kind in ("fixed", "distance", "gear", "coupling", "coincident"):
        return table
    if kind == "spherical":
        return table | {"type": "coincident"}
    if kind == "universal":
        axes = table.pop("axis", _X), table.pop("second_axis", _Y)
        turns = "along" in (_direction(axes[0], _X), _direction(axes[1], _Y))
        return table | {"type": "coincident" if turns else "fixed"}
    if kind not in _KINDS:
        raise _NotFlat
    along, across, default = _KINDS[kind]
    direction = _direction(table.get("axis"), default)
    found = along if direction == "along" else across
    axis = list(table.pop("axis", default)[:2])
    if found is None:
        return None
    if kind in ("planar", "point_on_plane"):
        axis = [-axis[1], axis[0]]
    keeps = {"axis": axis} if found in ("prismatic", "point_on_line") else {}
    second = table.pop("second_axis", None)
    if second is not None:
        if found not in ("revolute", "prismatic") or kind == "planar":
            raise _NotFlat
        if _direction(second, default) != direction:
            raise _NotFlat
        if found == "prismatic":
            keeps["second_axis"] = list(second[:2])
    return table | {"type": found} | keeps


#: By kind of joint: what it is in the plane if its axis is z, and if it lies in the
#: plane, and its default axis.
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_KINDS: dict[str, tuple[str | None, str | None, tuple[float, float, float]]] = {
    "revolute": ("revolute", "fixed", _Z),
    "prismatic": ("fixed", "prismatic", _X),
    "cylindrical": ("revolute", "prismatic", _Z),
    "planar": (None, "prismatic", _Z),
    "point_on_line": ("coincident", "point_on_line", _X),
    "point_on_plane": (None, "point_on_line", _Z),
}


def _drive(table: _Table) -> _Table | None:
    if "joint" in table or table["coordinate"] in ("x", "y"):
        return table
    if table["coordinate"] == "z":
        return None
    if _direction(table.pop("axis"), _Z) != "along":
        raise _NotFlat
    return table | {"coordinate": "angle"}


def _in_plane_part(values: list[Any]) -> list[Any]:
    """Stiffness or damping of x, y and the angle, which must not push out of it."""
    inside, across = (0, 1, 5), (2, 3, 4)
    if not isinstance(values[0], list):
        return [values[k] for k in inside]
    if any(values[i][j] != 0.0 for i in across for j in inside):
        raise _NotFlat
    return [[values[i][j] for j in inside] for i in inside]


def _force(table: _Table) -> None:
    if "force" in table and table["type"] == "force":
        table["force"] = table["force"][:2]
    if "torque" in table:
        table["torque"] = table["torque"][2]
    if table["type"] == "bushing":
        if table.pop("shaft", "z") != "z":
            raise _NotFlat
        for key in ("stiffness", "damping"):
            if key in table:
                table[key] = _in_plane_part(table[key])
