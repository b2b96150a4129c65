"""The same mechanism described differently: moved, renamed, reordered, in other units.

All functions take the table of a scene as `SceneFile.model_dump` gives it and return a
new one; joints that name the ground itself name its marker `origin` afterwards.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array, Node, Taylor
from sidtool.formats.scene import Placement, as_3d, orientation_matrix

Table = dict[str, Any]
ORIENTATIONS = ("angle", "axis_angle", "quaternion", "matrix")


def moved(table: Table, shift: list[float], turn: Placement) -> Table:
    """Everything turned about the origin and then shifted."""
    new = copy.deepcopy(table)
    planar = table["dimension"] == "planar"
    axes, R = (2 if planar else 3), orientation_matrix(turn)

    def place(placement: Table) -> Table:
        found = Placement(**{k: placement[k] for k in ORIENTATIONS if k in placement})
        rest = {k: v for k, v in placement.items() if k not in ORIENTATIONS}
        position = R @ as_3d(rest.get("position")) + as_3d(tuple(shift))
        rest["position"] = position[:axes].tolist()
        if planar:
            return rest | {"angle": (found.angle or 0.0) + (turn.angle or 0.0)}
        return rest | {"matrix": (R @ orientation_matrix(found)).tolist()}

    markers = new.setdefault("ground", {}).setdefault("markers", {})
    markers.setdefault("origin", {})
    for name in markers:
        markers[name] = place(markers[name])
    for body in new["bodies"].values():
        initial = body["initial"] = place(body.get("initial", {}))
        turning = ["velocity"] if planar else ["velocity", "angular_velocity"]
        for key in turning:
            if initial.get(key) is not None:
                initial[key] = (R @ as_3d(tuple(initial[key])))[:axes].tolist()
    if new.get("gravity") is not None:
        new["gravity"] = (R @ as_3d(tuple(new["gravity"])))[:axes].tolist()
    return _with_origin(new)


def _with_origin(table: Table) -> Table:
    for part in (*table["joints"].values(), *table.get("forces", {}).values()):
        if "markers" in part:
            names = part["markers"]
            part["markers"] = [
                "ground.origin" if name == "ground" else name for name in names
            ]
    return table


def renamed(table: Table) -> Table:
    """All names reversed, and all tables sorted by them."""
    parts = {key: table.get(key, {}) for key in ("bodies", "joints", "drives")}
    parts["forces"] = table.get("forces", {})
    names = {name: f"n{name[::-1]}" for part in parts.values() for name in part}

    def other(text: str) -> str:
        head, *tail = text.split(".")
        return ".".join([names.get(head, head), *tail])

    new = copy.deepcopy(table)
    for key, part in parts.items():
        new[key] = {names[k]: copy.deepcopy(part[k]) for k in sorted(part)[::-1]}
        for entry in new[key].values():
            for word in ("marker", "joint", "reference"):
                if word in entry:
                    entry[word] = other(entry[word])
            if isinstance(entry.get("markers"), list):
                entry["markers"] = [other(text) for text in entry["markers"]]
    new["outputs"]["record"] = [other(text) for text in table["outputs"]["record"]]
    return new


def reordered(table: Table) -> Table:
    """Bodies, joints and forces in the opposite order."""
    new = copy.deepcopy(table)
    for key in ("bodies", "joints", "forces"):
        new[key] = dict(reversed(new.get(key, {}).items()))
    return new


def reversed_joints(table: Table) -> Table:
    """First and second marker exchanged, where a joint treats both alike.

    The markers of each joint must be parallel at the start and its axes the same in
    both; driven angles change their sign.
    """
    new = copy.deepcopy(table)
    for name, joint in new["joints"].items():
        if joint["type"] not in ("revolute", "coincident", "spherical", "universal"):
            continue
        joint["markers"] = joint["markers"][::-1]
        if joint["type"] == "universal":
            joint["axis"], joint["second_axis"] = joint["second_axis"], joint["axis"]
        for drive in new["drives"].values():
            if drive.get("joint") == name:
                _negate(drive["function"])
    return new


def _negate(function: Table) -> None:
    for piece in function["pieces"]:
        for key in ("start", "end", "coefficients"):
            if piece.get(key) is not None:
                piece[key] = [-value for value in piece[key]]


@dataclass(frozen=True)
class Units:
    """Numbers of the new units in one of the old: millimetres in a metre are 1000."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def factor(self, length: int = 0, mass: int = 0, time: int = 0) -> float:
        """Of a quantity with these dimensions."""
        return self.length**length * self.mass**mass * self.time**time

    @property
    def force(self) -> float:
        return self.factor(1, 1, -2)

    @property
    def torque(self) -> float:
        return self.factor(2, 1, -2)


#: Dimensions (length, mass, time) of blocks for elastic coordinates without unit.
BLOCKS = {
    "mdCM": (1, 1, 0),
    "J": (2, 1, 0),
    "Ct": (1, 1, 0),
    "Cr": (2, 1, 0),
    "Me": (2, 1, 0),
    "Gr": (2, 1, 0),
    "Ge": (2, 1, 0),
    "Oe": (2, 1, 0),
    "ksigma": (2, 1, -2),
    "Ke": (2, 1, -2),
    "De": (2, 1, -1),
}


def sid_in(sid: SID, units: Units) -> SID:
    """A SID in other units; its elastic coordinates keep their numbers."""
    blocks = {
        name: _times(getattr(sid, name), units.factor(*dimensions))
        for name, dimensions in BLOCKS.items()
    }
    nodes = tuple(_node_in(node, units.length) for node in sid.nodes)
    return replace(sid, mass=sid.mass * units.mass, nodes=nodes, **blocks)


def _node_in(node: Node, length: float) -> Node:
    return replace(
        node, origin=_times(node.origin, length), phi=_times(node.phi, length)
    )


def _times(term: Taylor, factor: float) -> Taylor:
    return Taylor(factor * term.m0, None if term.m1 is None else factor * term.m1)


def in_units(table: Table, units: Units) -> Table:
    """A scene of rigid and flexible bodies, springs and polynomial drives of angles."""
    new = copy.deepcopy(table)
    length, time = units.length, units.time
    for key in ("start", "end", "output_step"):
        if new["time"].get(key) is not None:
            new["time"][key] *= time
    if new.get("gravity") is not None:
        new["gravity"] = _scaled(new["gravity"], units.factor(1, 0, -2))
    for marker in new.get("ground", {}).get("markers", {}).values():
        _scale(marker, "position", length)
    for body in new["bodies"].values():
        _scale(body, "mass", units.mass)
        _scale(body, "inertia", units.factor(2, 1))
        _scale(body, "centre_of_mass", length)
        for marker in body["markers"].values() if "mass" in body else ():
            _scale(marker, "position", length)
        initial = body.get("initial", {})
        _scale(initial, "position", length)
        _scale(initial, "velocity", length / time)
        _scale(initial, "angular_velocity", 1.0 / time)
        _scale(initial, "elastic_velocity", 1.0 / time)
    for force in new.get("forces", {}).values():
        _scale(force, "rest", length)
        _scale(force, "stiffness", units.factor(0, 1, -2))
        _scale(force, "damping", units.factor(0, 1, -1))
    for drive in new["drives"].values():
        for piece in drive["function"]["pieces"]:
            _scale(piece, "from", time)
            _scale(piece, "to", time)
            for key in ("start", "end", "coefficients"):
                if piece.get(key) is not None:
                    powers = time ** -np.arange(len(piece[key]), dtype=float)
                    piece[key] = (powers * np.array(piece[key])).tolist()
    return new


def _scale(table: Table, key: str, factor: float) -> None:
    if table.get(key) is not None:
        table[key] = _scaled(table[key], factor)


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, list | tuple):
        return [_scaled(entry, factor) for entry in value]
    return factor * value


def first_modes(sid: SID, count: int) -> SID:
    """The SID with only its first elastic coordinates."""
    nq, kept = sid.nq, np.arange(count)
    columns = np.concatenate([axis * nq + kept for axis in range(3)])
    of_mode = ("Ct", "Cr", "Me", "Ge", "Oe", "ksigma", "Ke", "De")

    def cut(name: str, term: Taylor) -> Taylor:
        parts: list[Array | None] = [term.m0, term.m1]
        for order, part in enumerate(parts):
            if part is None:
                continue
            if name in of_mode:
                part = part[..., kept, :]
            if name in ("Me", "Ke", "De", "phi", "psi"):
                part = part[..., kept]
            if name in ("Gr", "Ge"):
                part = part[..., columns]
            parts[order] = part[kept] if order else part
        assert parts[0] is not None
        return Taylor(parts[0], parts[1])

    nodes = tuple(
        replace(
            node,
            **{
                name: cut(name, getattr(node, name))
                for name in ("origin", "phi", "psi", "AP")
            },
        )
        for node in sid.nodes
    )
    blocks = {name: cut(name, getattr(sid, name)) for name in BLOCKS}
    return replace(sid, labels=sid.labels[:count], nodes=nodes, **blocks)
