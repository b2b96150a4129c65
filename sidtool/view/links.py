"""Drawings of springs, dampers, actuators and rods between two markers. Each is a mesh
along x from 0 to 1, which is scaled to the distance of its ends and rotated to their
direction.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Actuator,
    SceneFile,
    SpringDamper,
    marker_names,
    marker_reference,
)
from sidtool.formats.scene.connections import force_coordinate
from sidtool.solver.system.rotated_markers import shortest_rotation
from sidtool.solver.system.system import GROUND_NAME, System

from ..field.body_field import CORNERS, tube

Indices = NDArray[np.int64]
#: The axis of the meshes.
X = np.array([1.0, 0.0, 0.0])

#: Radii of coils, cylinder and rod, as fractions of the mechanism; half the thickness
#: of a wire; number of coils of a spring, and of straight pieces per coil.
_COIL, _CYLINDER, _ROD, _WIRE = 0.02, 0.012, 0.005, 0.003
_COILS, _PIECES = 8, 12
#: Coordinates of joints along which a force is drawn between the markers.
_DISTANCES = ("displacement", "length")
#: Fraction of the length of a spring that is straight at each end; fraction of a
#: cylinder.
_STRAIGHT, _OUTER = 0.12, 0.55

#: Colours by kind of link.
COLOURS = {
    "rod": "#555555",
    "damper": "#777777",
    "actuator": "#cc79a7",
    "spring": "#333333",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyMotion:
    """Motion of all bodies but the ground.

    Attributes
    ----------
    t : (nt,) [s]
    places, turns : by body, origins (nt, 3) [m] and orientations (nt, 3, 3)
    elastic : by body, (nt, nq)
    """

    t: Array
    places: Mapping[str, Array]
    turns: Mapping[str, Array]
    elastic: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Anchor:
    """A point of a body, or of the ground, whose name is empty.

    position : (3,) in the body frame, or in space [m]
    shapes : (3, nq)
    """

    body: str
    position: Array
    shapes: Array

    def path(self, motion: BodyMotion, scale: float) -> Array:
        """Return the path (nt, 3) [m] with deformations magnified by `scale`."""
        if not self.body:
            return np.tile(self.position, (len(motion.t), 1))
        local = self.position + scale * motion.elastic[self.body] @ self.shapes.T
        turned = np.einsum("tij,tj->ti", motion.turns[self.body], local)
        return np.asarray(motion.places[self.body] + turned)


@dataclass(frozen=True, eq=False)
class Link:
    """A connection of two markers.

    Attributes
    ----------
    kind : spring, damper, actuator or rod
    positions : (n, 3), x from 0 to 1, y and z in metres
    triangles : (m, 3)
    """

    name: str
    kind: str
    ends: tuple[Anchor, Anchor]
    positions: Array
    triangles: Indices

    def corners(self, motion: BodyMotion, row: int, scale: float) -> Array:
        """Return the corners (m, 3, 3) [m] of its triangles at one time."""
        a, b = (end.path(motion, scale)[row] for end in self.ends)
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length if length else X
        stretched = self.positions * [length, 1.0, 1.0]
        return np.asarray(
            (a + stretched @ shortest_rotation(X, along).T)[self.triangles]
        )


def scene_links(system: System, size: float) -> tuple[Link, ...]:
    """Return the connections between markers of a scene.

    Parameters
    ----------
    size : of the mechanism [m]
    """
    meshes = {kind: make(size) for kind, make in _MESHES.items()}
    bodies = {data.name: data for data in system.bodies}
    links = []
    for name, kind, markers in _linked_markers(system.scene):
        ends = []
        for owner, marker in map(marker_reference, markers):
            node = bodies[owner].node(marker)
            body = "" if owner == GROUND_NAME else owner
            ends.append(Anchor(body, node.position, node.phi.m0))
        links.append(Link(name, kind, (ends[0], ends[1]), *meshes[kind]))
    return tuple(links)


def _linked_markers(scene: SceneFile) -> list[tuple[str, str, tuple[str, ...]]]:
    """Return name, kind and markers of each link.

    A force on a displacement of a joint is one between the markers of the joint; one on
    an angle is not drawn.
    """
    links = []
    for name, joint in scene.joints.items():
        if joint.type == "distance":
            links.append((name, "rod", marker_names(joint)))
    for name, force in scene.forces.items():
        if not isinstance(force, SpringDamper | Actuator):
            continue
        markers: tuple[str, ...] | None = force.markers
        if force.joint is not None and force_coordinate(force, scene) in _DISTANCES:
            markers = marker_names(scene.joints[force.joint])
        if markers is not None:
            links.append((name, _force_kind(force), markers))
    return links


def _force_kind(force: SpringDamper | Actuator) -> str:
    if isinstance(force, Actuator):
        return "actuator"
    return "spring" if force.stiffness or force.table else "damper"


def _sweep_tube(line: Array, radius: Any) -> tuple[Array, Indices]:
    """Return a square tube around a line with cross-sections perpendicular to x."""
    arms = np.multiply.outer(np.broadcast_to(radius, len(line)), CORNERS)
    positions = np.repeat(line[:, None], 4, axis=1)
    positions[..., 1:] += arms
    return positions.reshape(-1, 3), tube(len(line))


def _rod_mesh(size: float) -> tuple[Array, Indices]:
    line = np.zeros((2, 3))
    line[1, 0] = 1.0
    return _sweep_tube(line, _ROD * size)


def _cylinder_mesh(size: float) -> tuple[Array, Indices]:
    """Return the mesh of a piston rod in a cylinder."""
    line = np.zeros((4, 3))
    line[:, 0] = [0.0, _OUTER, _OUTER, 1.0]
    wide, thin = _CYLINDER * size, _ROD * size
    return _sweep_tube(line, np.array([wide, wide, thin, thin]))


def _spring_mesh(size: float) -> tuple[Array, Indices]:
    share = np.linspace(0.0, 1.0, _COILS * _PIECES + 1)
    angle = 2.0 * np.pi * _COILS * share
    coil = np.column_stack([share, np.cos(angle), np.sin(angle)])
    coil *= [1.0 - 2.0 * _STRAIGHT, _COIL * size, _COIL * size]
    coil[:, 0] += _STRAIGHT
    ends = np.array([[0.0, 0.0, 0.0], [_STRAIGHT, 0.0, 0.0]])
    line = np.concatenate([ends, coil, [1.0, 0.0, 0.0] - ends[::-1]])
    return _sweep_tube(line, _WIRE * size)


_MESHES = {
    "rod": _rod_mesh,
    "damper": _cylinder_mesh,
    "actuator": _cylinder_mesh,
    "spring": _spring_mesh,
}
