"""Coordinate systems of Nastran bulk data: nodes in the basic system."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .cards import Card

Point = tuple[float, float, float]


@dataclass(frozen=True)
class CoordinateSystem:
    """A rectangular (R), cylindrical (C) or spherical (S) system.

    Attributes
    ----------
    points : origin, a point of the z axis and one of the xz plane: nodes of CORD1, or
        places in the system `parent` of CORD2
    """

    label: int
    kind: str
    parent: int
    points: tuple[Point, ...] | tuple[int, ...]
    place: str


def systems_of(card: Card) -> list[CoordinateSystem]:
    """The systems of a card: one of CORD2, one or two of CORD1."""
    kind = card.name[-1]
    if card.name.startswith("CORD2"):
        values = [card.real(i, "a coordinate") for i in range(2, 11)]
        points = tuple((values[i], values[i + 1], values[i + 2]) for i in (0, 3, 6))
        label = card.integer(0, "a system")
        parent = card.integer(1, "a system", 0)
        return [CoordinateSystem(label, kind, parent, points, card.place)]
    systems = []
    for start in (0, 4):
        if card.word(start):
            label, *nodes = (card.integer(start + i, "a number") for i in range(4))
            systems.append(CoordinateSystem(label, kind, 0, tuple(nodes), card.place))
    return systems


class CoordinateSystems:
    """Positions and axes of systems in the basic one."""

    def __init__(
        self,
        nodes: Mapping[int, Point],
        local: Mapping[int, tuple[int, str]],
        systems: Mapping[int, CoordinateSystem],
    ) -> None:
        self._nodes, self._local, self._systems = nodes, local, systems
        self._known: dict[int, tuple[Array, Array]] = {}
        self._open: list[int] = []

    def node(self, label: int) -> Point:
        """A node in the basic system."""
        place = self._nodes[label]
        if label in self._local:
            system, where = self._local[label]
            place = self._basic(place, system, where)
        return place

    def named(self, label: int, place: str, who: str = "the card") -> Point:
        """A node in the basic system, which a card names.

        Raises
        ------
        InputError : it is not defined.
        """
        if label not in self._nodes:
            raise InputError(
                f"{who} names node {label}, which is not defined",
                place=place,
                expected="a node of this file",
            )
        return self.node(label)

    def is_rectangular(self, label: int, place: str) -> bool:
        """Whether the axes of a system are the same everywhere."""
        self.frame(label, place)
        return self._systems[label].kind == "R"

    def direction(self, node: int, label: int, number: int) -> Array:
        """The unit vector of a direction 1 to 3 that a system gives at a node.

        Raises
        ------
        InputError : the node is on the axis of a cylindrical or spherical system.
        """
        if label == 0:
            return np.asarray(np.eye(3)[number - 1])
        place = self._local.get(node, (0, ""))[1]
        origin, (x, y, z) = self.frame(label, place)
        arm = np.array(self.node(node)) - origin
        kind = self._systems[label].kind
        if kind == "R":
            return np.asarray((x, y, z)[number - 1])
        if kind == "C" and number == 3:  # also on the axis
            return np.asarray(z)
        across = arm - (arm @ z) * z
        if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(arm) or not arm.any():
            raise InputError(
                f"node {node} is on the axis of the system {label} of its directions",
                place=place,
                expected="directions that exist there",
            )
        r = across / np.linalg.norm(across)
        around = np.cross(z, r)
        if kind == "C":
            return np.asarray((r, around, z)[number - 1])
        out = arm / np.linalg.norm(arm)
        return np.asarray((out, np.cross(around, out), around)[number - 1])

    def _basic(self, point: Point, label: int, place: str) -> Point:
        """A point of a system in the basic one."""
        if label == 0:
            return point
        origin, axes = self.frame(label, place)
        x = origin + axes.T @ _to_rectangular(point, self._systems[label].kind)
        return float(x[0]), float(x[1]), float(x[2])

    def frame(self, label: int, place: str) -> tuple[Array, Array]:
        """Origin, and rows x, y, z in the basic system.

        Raises
        ------
        InputError : the system is not defined, in terms of itself, or has no axes.
        """
        if label == 0:
            return np.zeros(3), np.eye(3)
        if label in self._known:
            return self._known[label]
        if label not in self._systems or label in self._open:
            what = "in terms of itself" if label in self._open else "not defined"
            raise InputError(
                f"coordinate system {label} is {what}",
                place=place,
                expected="a system of this file",
            )
        system = self._systems[label]
        self._open.append(label)
        points = [self._point(system, point) for point in system.points]
        self._open.pop()
        a, b, c = (np.array(point) for point in points)
        y = np.cross(b - a, c - a)
        if not np.linalg.norm(y) > 1e-12 * np.linalg.norm(b - a) * np.linalg.norm(
            c - a
        ):
            raise InputError(
                f"the points of coordinate system {label} lie on one line",
                place=system.place,
                expected="origin, a point of the z axis, one of the xz plane",
            )
        z, y = (v / np.linalg.norm(v) for v in (b - a, y))
        self._known[label] = (a, np.array([np.cross(y, z), y, z]))
        return self._known[label]

    def _point(self, system: CoordinateSystem, point: Point | int) -> Point:
        if not isinstance(point, int):
            return self._basic(point, system.parent, system.place)
        return self.named(point, system.place, f"coordinate system {system.label}")


def _to_rectangular(point: Point, kind: str) -> Array:
    """Radius and angles in degrees as x, y, z."""
    r, first, second = point
    if kind == "R":
        return np.array(point)
    angle = np.radians(first)
    if kind == "C":
        return np.array([r * np.cos(angle), r * np.sin(angle), second])
    turn = np.radians(second)
    across = r * np.sin(angle)
    return np.array([across * np.cos(turn), across * np.sin(turn), r * np.cos(angle)])
