"""A random scene that grows: bodies, joints, loops, drives, gears.

Bodies are joined one after the other, each where its joint puts it, so that every loop
closes as drawn: a joint that closes one is put where its two bodies are. What would
leave a constraint that others imply, or nearly so, is left out again.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.solver.analyses.dense_equations import DenseEquations
from sidtool.solver.initial_state.assembly import assemble
from tests.bodies import Cloud
from tests.metamorphic.generator.case import Case, Table, compiled
from tests.metamorphic.generator.ingredients import (
    JOINTS,
    NODES,
    Random,
    any_pose,
    cloud,
    function,
    joint,
    rigid_body,
)
from tests.metamorphic.generator.poses import IDENTITY, Pose

END = 0.8
#: Least singular value of the scaled constraint Jacobian.
INDEPENDENT = 0.03
#: Kinds that may close a loop.
CLOSING = {
    "planar": ("distance", "coincident", "point_on_line", "revolute"),
    "spatial": (
        "distance",
        "point_on_plane",
        "point_on_line",
        "spherical",
        "coincident",
        "universal",
    ),
}


class Sketch:
    """A scene that grows; poses of all bodies are known."""

    def __init__(self, rng: Random, planar: bool) -> None:
        self.rng, self.planar = rng, planar
        self.kind = "planar" if planar else "spatial"
        self.poses: dict[str, Pose] = {"ground": IDENTITY}
        self.clouds: dict[str, Cloud] = {}
        self.sids: dict[str, SID] = {}
        self.coordinates: dict[tuple[str, str], float] = {}
        self.markers: dict[str, int] = {}
        self.table: Table = {
            "format": "sidtool scene",
            "version": 1,
            "dimension": self.kind,
            "time": {"start": 0.0, "end": END, "output_step": END / 20},
            "gravity": [0.0, -5.0] if planar else [0.5, 1.0, -4.0],
            "ground": {"markers": {}},
            "bodies": {},
            "joints": {},
            "drives": {},
            "forces": {},
        }

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def name(self, table: str) -> str:
        return f"{table[0]}{len(self.table[table]) + 1}"

    def case(self) -> Case:
        return Case(self.table, self.sids, clouds=self.clouds)

    def marker(self, body: str, pose: Pose | None = None) -> tuple[str, Pose]:
        """A marker of a body and its pose there; one node of a flexible body."""
        if body in self.sids:
            node = str(self.rng.integers(1, NODES + 1))
            position = self.sids[body].node(node).position
            return f"{body}.n{node}", Pose(position, np.eye(3))
        pose = pose or any_pose(self.rng, self.planar, 0.4)
        owner = self.table["ground"] if body == "ground" else self.table["bodies"][body]
        name = f"m{len(owner['markers']) + 1}"
        owner["markers"][name] = pose.table(self.planar)
        return f"{body}.{name}", pose

    def angle(self, text: str) -> float:
        """Of a marker in the plane, with all turns that are said; else zero."""
        if not self.planar:
            return 0.0
        name, marker = text.split(".")
        if name == "ground":
            return float(self.table["ground"]["markers"][marker]["angle"])
        body = self.table["bodies"][name]
        own = 0.0 if name in self.sids else body["markers"][marker]["angle"]
        return float(own + body["initial"]["angle"])

    def turns(self, first: str, second: str) -> float:
        """Whole turns of the second marker beyond the first one, as an angle."""
        turn = 2.0 * np.pi
        return turn * round((self.angle(second) - self.angle(first)) / turn)

    def add_body(
        self,
        parent: str | None,
        flexible: float = 0.5,
        kinds: tuple[str, ...] | None = None,
    ) -> None:
        """A body, joined to another one unless it is free."""
        name = self.name("bodies")
        if self.chance(flexible):
            found = cloud(self.rng, self.planar)
            self.clouds[name] = found
            self.sids[name] = _sid(self.rng, found)
            markers = {f"n{k}": str(k) for k in range(1, NODES + 1)}
            body: Table = {"sid": name, "markers": markers, "quadratic_inertia": True}
        else:
            body = rigid_body(self.rng, self.planar)
        self.table["bodies"][name] = body
        ends = None
        if parent is None:
            self.poses[name] = any_pose(self.rng, self.planar, 0.5)
        else:
            kind = str(self.rng.choice(kinds or JOINTS[self.kind]))
            first, at = self.marker(parent)
            second, mine = self.marker(name)
            label = self.name("joints")
            table, between, coordinates = joint(self.rng, kind, self.planar)
            ends = (first, second)
            self.table["joints"][label] = {**table, "markers": [*ends]}
            for coordinate, value in coordinates.items():
                self.coordinates[label, coordinate] = value
            place = self.poses[parent].then(at).then(between)
            self.poses[name] = place.then(mine.inverse)
        body["initial"] = self.poses[name].table(self.planar)
        if ends and self.planar:
            body["initial"]["angle"] -= self.turns(*ends)

    def close(self) -> None:
        """A joint between bodies that have their places."""
        names = list(self.poses)
        first, second = (str(n) for n in self.rng.choice(names, 2, replace=False))
        if second in self.sids or second == "ground":
            first, second = second, first
        kind = str(self.rng.choice(CLOSING[self.kind]))
        if second in self.sids or second == "ground":
            kind = "distance"
        a, at = self.marker(first)
        label = self.name("joints")
        if kind == "distance":
            b, mine = self.marker(second)
            ends = [self.poses[first].then(at).x, self.poses[second].then(mine).x]
            length = float(np.linalg.norm(ends[1] - ends[0]))
            if not length:  # the two markers are one place: no rod fits between them
                return
            table: Table = {"type": kind, "length": length}
            coordinates = {"length": length}
        else:
            table, between, coordinates = joint(self.rng, kind, self.planar)
            place = self.poses[first].then(at).then(between)
            b, _ = self.marker(second, self.poses[second].inverse.then(place))
            if "angle" in coordinates:
                coordinates["angle"] += self.turns(a, b)
        self.table["joints"][label] = {**table, "markers": [a, b]}
        if self.independent():
            for coordinate, value in coordinates.items():
                self.coordinates[label, coordinate] = value
        else:
            del self.table["joints"][label]

    def drive(self, key: tuple[str, str]) -> None:
        """Prescribes a coordinate of a joint."""
        label, size = self.name("drives"), 0.4
        if key[1] == "length":  # which has no direction at zero
            size = min(0.05, 0.2 * self.coordinates[key])
        self.table["drives"][label] = {
            "joint": key[0],
            "coordinate": key[1],
            "function": function(self.rng, self.coordinates[key], size, END),
        }
        if not self.independent():
            del self.table["drives"][label]

    def couple(self) -> None:
        """A gear between two coordinates that are not driven."""
        free = [key for key in self.undriven() if key[1] != "length"]
        if len({key[0] for key in free}) < 2:
            return
        first, second = (free[k] for k in self.rng.choice(len(free), 2, replace=False))
        if first[0] == second[0]:
            return
        ratio = float(self.rng.choice([-2.0, -1.0, 1.0, 2.0]))
        label = self.name("joints")
        offset = self.coordinates[second] - ratio * self.coordinates[first]
        self.table["joints"][label] = {
            "type": "gear",
            "joints": [first[0], second[0]],
            "coordinate": [first[1], second[1]],
            "ratio": ratio,
            "offset": offset,
        }
        if not self.independent():
            del self.table["joints"][label]

    def undriven(self) -> list[tuple[str, str]]:
        driven = {
            (d.get("joint"), d["coordinate"]) for d in self.table["drives"].values()
        }
        return [key for key in self.coordinates if key not in driven]

    def independent(self) -> bool:
        """No constraint is nearly implied by the others."""
        try:
            jacobian = constraints(self.case())
        except InputError:  # constraints that contradict each other's rates
            return False
        if jacobian.shape[0] > jacobian.shape[1]:
            return False
        return least(jacobian) > INDEPENDENT


def least(jacobian: Array) -> float:
    """The least singular value: how independent constraints are."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    return float(values[-1]) if len(values) else np.inf


def constraints(case: Case, last: Result | None = None) -> Array:
    """(rows, n) Jacobian, rows of unit length, in units of energy.

    last : of a run with all joints kept; its last state is taken, default the start
    """
    system, start = assemble(compiled(case, keep_joints=True))
    t, z, v = 0.0, start.z, start.v
    if last is not None:
        t, z, v = float(last.t[-1]), last.positions[-1], last.velocities[-1]
    mechanics = DenseEquations(system, t, t)
    mechanics.set_scale(start.z)
    mechanics.evaluate(z, v)
    jacobian: Array = mechanics.jacobian
    sizes = np.linalg.norm(jacobian, axis=1, keepdims=True)
    return jacobian / np.maximum(sizes, 1e-300)


def _sid(rng: Random, found: Cloud) -> SID:
    frequencies = 2.0 * np.pi * np.sort(rng.uniform(4.0, 15.0, found.phi.shape[-1]))
    Ke = np.diag(frequencies**2)
    ratio = float(rng.choice([0.0, 0.02]))
    return found.sid(Ke, 2.0 * ratio * np.diag(frequencies), NODES)
