"""Possible simplifications of a model, and models as scenes.

`planar_scene` writes a spatial scene whose motion stays in a plane z = const as a
planar scene. Out-of-plane forces, stiffness and inertia are omitted, as are joints that
only keep bodies in the plane. It does not check that the motion stays there: the planar
scene is run and compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.scene import (
    SceneFile,
    SidBody,
    is_elastic,
    is_section_force,
    is_stress,
    parse_output as parsed,
)
from sidtool.formats.scene.base import Placement, as_3d, orientation_matrix
from sidtool.formats.scene.outputs import MULTIPLIER
from sidtool.formats.toml.reading import validate_data
from sidtool.solver.system.stiffening import can_remove_stiffening

Numbers = tuple[int, ...]

FLEXIBILITY = "flexibility"
SHAPE = "shape function"
SHAPES = "shape functions"
STIFFENING = "geometric stiffening"
QUADRATIC = "quadratic inertia"
SPACE = "space"

#: Tolerance for directions along z or in the plane.
ALIGNMENT_TOLERANCE = 1e-9
#: Tolerance for out-of-plane components, relative to the size of their kind.
IN_PLANE = 1e-9
#: Quantities that are zero in the plane z = 0.
OUT_OF_PLANE_QUANTITIES = frozenset(
    ["z", "uz", "vz", "az", "wx", "wy", "fz", "mx", "my"]
    + ["vz_body", "wx_body", "wy_body", "quaternion_1", "quaternion_2"]
    + ["rotation_x", "rotation_y", "momentum_z"]
    + ["angular_momentum_x", "angular_momentum_y", "sigma_yz", "sigma_xz"]
)
_Table = dict[str, Any]
#: For each type of joint: its planar type if the axis is z, its planar type if the axis
#: lies in the plane, and its default axis.
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_KINDS: dict[str, tuple[str | None, str | None, tuple[float, float, float]]] = {
    "revolute": ("revolute", "fixed", _Z),
    "prismatic": ("fixed", "prismatic", _X),
    "cylindrical": ("revolute", "prismatic", _Z),
    "planar": (None, "prismatic", _Z),
    "point_on_line": ("coincident", "point_on_line", _X),
    "point_on_plane": (None, "point_on_line", _Z),
}


@dataclass(frozen=True)
class Candidate:
    """A possible simplification of a model.

    Attributes
    ----------
    body : name of the body; empty for the reduction to the plane
    number : number of a shape function
    numbers : numbers of shape functions that are omitted together
    """

    body: str
    what: str
    number: int | None = None
    numbers: Numbers = ()


@dataclass(frozen=True)
class Choice:
    """A model: what it retains of each flexible body.

    Attributes
    ----------
    kept : shape functions by number; none for a rigid body
    quadratic : bodies with quadratic inertia
    unstiffened : bodies without their geometric stiffening
    flat : whether a spatial scene is reduced to a planar one
    """

    kept: tuple[tuple[str, Numbers], ...]
    quadratic: frozenset[str]
    unstiffened: frozenset[str] = frozenset()
    flat: bool = False

    def without(self, *candidates: Candidate) -> Choice:
        """Return the model without some candidates."""
        retained, unstiffened, quadratic = (
            dict(self.kept),
            self.unstiffened,
            self.quadratic,
        )
        flat = self.flat
        for c in candidates:
            if c.what == FLEXIBILITY:
                retained[c.body] = ()
            elif c.what == SHAPE:
                retained[c.body] = tuple(k for k in retained[c.body] if k != c.number)
            elif c.what == SHAPES:
                retained[c.body] = tuple(
                    k for k in retained[c.body] if k not in c.numbers
                )
            elif c.what == STIFFENING:
                unstiffened = unstiffened | {c.body}
            elif c.what == SPACE:
                flat = True
            else:
                quadratic = quadratic - {c.body}
        return Choice(tuple(retained.items()), quadratic, unstiffened, flat)

    def is_part_of(self, whole: Choice) -> bool:
        """Return whether a model retains nothing that another one omits."""
        own, all_ = dict(self.kept), dict(whole.kept)
        retains_less = own.keys() == all_.keys() and all(
            set(numbers) <= set(all_[name]) for name, numbers in own.items()
        )
        return retains_less and self.quadratic <= whole.quadratic

    def elastic(self, name: str) -> bool:
        return bool(dict(self.kept).get(name))

    def has_output(self, output: str) -> bool:
        """Return whether the model has an output."""
        name, numbers_by_body = parsed(output), dict(self.kept)
        if name.owner not in numbers_by_body:
            return True
        if is_stress(name.quantity) or is_section_force(name):
            return bool(numbers_by_body[name.owner])
        if name.marker or not is_elastic(name.quantity):
            return True
        if output.endswith("*"):
            return bool(numbers_by_body[name.owner])
        return int(name.quantity.lstrip("vq")) in numbers_by_body[name.owner]


def finest_model(scene: SceneFile, sids: Mapping[str, SID]) -> Choice:
    """Return the model with all shape functions and terms of the scene and its SIDs."""
    numbers_by_body, quadratic = {}, set()
    for name, body in scene.sid_bodies.items():
        sid = sids[name]
        numbers_by_body[name] = body.numbers(sid.nq)
        if numbers_by_body[name] and sid.Oe.first_order(sid.nq).any():
            quadratic.add(name)
    return Choice(tuple(numbers_by_body.items()), frozenset(quadratic))


def bodies_with_stiffening(
    scene: SceneFile, sids: Mapping[str, SID], flat: bool = False
) -> dict[str, bool]:
    """Return the bodies with geometric stiffening, and whether it can be omitted."""
    planar = flat or scene.dimension == "planar"
    return {
        name: can_remove_stiffening(sids[name], planar)
        for name, body in scene.sid_bodies.items()
        if body.geometric_stiffening and not body.rigid and has_stiffening(sids[name])
    }


def scene_of_model(
    scene: SceneFile, choice: Choice, sids: Mapping[str, SID]
) -> SceneFile:
    """Return the scene of a model, without a requested accuracy.

    Raises
    ------
    InputError : the model is planar, but the scene cannot be.
    """
    bodies: dict[str, Any] = dict(scene.bodies)
    for name, numbers in choice.kept:
        bodies[name] = _reduced_body(bodies[name], name, numbers, choice, sids[name].nq)
    accuracy = scene.accuracy.model_copy(update={"wanted": None})
    reduced = scene.model_copy(update={"bodies": bodies, "accuracy": accuracy})
    if not choice.flat:
        return reduced
    planar = planar_scene(reduced)
    if planar is None:
        raise InputError("the scene cannot be written in the plane z = 0")
    return planar


def with_recorded_outputs(scene: SceneFile, names: tuple[str, ...]) -> SceneFile:
    """Return the scene with these outputs recorded."""
    outputs = scene.outputs.model_copy(update={"record": names})
    return scene.model_copy(update={"outputs": outputs})


def _reduced_body(
    body: SidBody, name: str, numbers: Numbers, choice: Choice, nq: int
) -> Any:
    if not numbers:
        return body.model_copy(update={"rigid": True})
    before = body.numbers(nq)
    initial = {}
    for key in ("elastic", "elastic_velocity"):
        values = getattr(body.initial, key)
        if values is not None and len(values) == len(before):
            pairs = zip(before, values, strict=True)
            initial[key] = tuple(value for k, value in pairs if k in numbers)
    whole = len(numbers) == nq
    return body.model_copy(
        update={
            "shape_functions": None if whole else numbers,
            "geometric_stiffening": body.geometric_stiffening
            and name not in choice.unstiffened,
            "quadratic_inertia": name in choice.quadratic,
            "initial": body.initial.model_copy(update=initial),
        }
    )


def loaded_nodes(scene: SceneFile, name: str) -> dict[str, str]:
    """Return the nodes of a body where joints, drives and forces act, as
    written there.
    """
    known = scene.sid_bodies[name].markers
    parts = (*scene.joints.values(), *scene.forces.values(), *scene.drives.values())
    texts = [text for part in parts for text in getattr(part, "markers", None) or ()]
    texts += [text for part in parts if (text := getattr(part, "marker", None))]
    named = (text.partition(".") for text in texts)
    return {m: known.get(m, m) for owner, _, m in named if owner == name and m}


def shape_function_candidates(choice: Choice) -> list[Candidate]:
    """Return one candidate for each shape function."""
    return [Candidate(n, SHAPE, k) for n, numbers in choice.kept for k in numbers]


def with_all_shapes(choice: Choice, all_: Choice) -> Choice:
    """Return the model with the shape functions of another one."""
    return replace(choice, kept=all_.kept)


def with_all_terms(choice: Choice, all_: Choice) -> Choice:
    """Return the model with the terms of another one."""
    return replace(choice, quadratic=all_.quadratic, unstiffened=all_.unstiffened)


class _NotPlanar(Exception):
    pass


def planar_scene(scene: SceneFile) -> SceneFile | None:
    """Return the planar scene, or None if bodies, joints or forces leave the plane."""
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    quantities = (name.rpartition(".")[2] for name in scene.outputs.record)
    if any(map(MULTIPLIER.fullmatch, quantities)):
        return None
    content["dimension"] = "planar"
    try:
        _to_plane(content, scene)
        return validate_data(content, SceneFile)
    except (_NotPlanar, InputError):
        return None


def is_out_of_plane(output: str) -> bool:
    """Return whether an output is zero in a planar scene."""
    name = parsed(output)
    owner_is_sum = name.owner in ("momentum", "angular_momentum")
    if owner_is_sum:
        return (name.quantity == "z") == (name.owner == "momentum")
    return name.quantity in OUT_OF_PLANE_QUANTITIES


def _to_plane(content: _Table, scene: SceneFile) -> None:
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
            table["markers"][name] = _planar_placement(marker)


def _planar_placement(placement: Placement) -> _Table:
    """Return position and angle in the plane."""
    turn = orientation_matrix(placement)
    if abs(turn[2, 2] - 1.0) > ALIGNMENT_TOLERANCE:
        raise _NotPlanar
    x, y, _ = as_3d(placement.position)
    angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return {"position": [float(x), float(y)], "angle": angle}


def _initial(table: _Table, initial: Any) -> None:
    for key in ("axis_angle", "quaternion", "matrix"):
        table.pop(key, None)
    table |= _planar_placement(initial)
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
    """Return "along" for an axis along +z, "across" for an axis in the plane."""
    vector = as_3d(tuple(axis) if axis is not None else default)
    vector /= np.linalg.norm(vector)
    if vector[2] > 1.0 - ALIGNMENT_TOLERANCE:
        return "along"
    if abs(vector[2]) > ALIGNMENT_TOLERANCE:
        raise _NotPlanar
    return "across"


def _joint(table: _Table) -> _Table | None:
    """Return the joint in the plane, or None if it only keeps bodies in the plane."""
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
        raise _NotPlanar
    along, across, default = _KINDS[kind]
    direction = _direction(table.get("axis"), default)
    planar_type = along if direction == "along" else across
    axis = list(table.pop("axis", default)[:2])
    if planar_type is None:
        return None
    if kind in ("planar", "point_on_plane"):
        axis = [-axis[1], axis[0]]
    keeps = {"axis": axis} if planar_type in ("prismatic", "point_on_line") else {}
    second = table.pop("second_axis", None)
    if second is not None:
        if planar_type not in ("revolute", "prismatic") or kind == "planar":
            raise _NotPlanar
        if _direction(second, default) != direction:
            raise _NotPlanar
        if planar_type == "prismatic":
            keeps["second_axis"] = list(second[:2])
    return table | {"type": planar_type} | keeps


def _drive(table: _Table) -> _Table | None:
    if "joint" in table or table["coordinate"] in ("x", "y"):
        return table
    if table["coordinate"] == "z":
        return None
    if _direction(table.pop("axis"), _Z) != "along":
        raise _NotPlanar
    return table | {"coordinate": "angle"}


def _in_plane_part(values: list[Any]) -> list[Any]:
    """Return stiffness or damping of x, y and the angle without out-of-plane
    coupling.
    """
    inside, across = (0, 1, 5), (2, 3, 4)
    if not isinstance(values[0], list):
        return [values[k] for k in inside]
    if any(values[i][j] != 0.0 for i in across for j in inside):
        raise _NotPlanar
    return [[values[i][j] for j in inside] for i in inside]


def _force(table: _Table) -> None:
    if "force" in table and table["type"] == "force":
        table["force"] = table["force"][:2]
    if "torque" in table:
        table["torque"] = table["torque"][2]
    if table["type"] == "bushing":
        if table.pop("shaft", "z") != "z":
            raise _NotPlanar
        for key in ("stiffness", "damping"):
            if key in table:
                table[key] = _in_plane_part(table[key])
