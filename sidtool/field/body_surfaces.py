"""Surfaces of the bodies of a scene, each in its body frame, and of rigid shapes."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.field import Field
from sidtool.formats.scene import (
    Box,
    Cylinder,
    RigidBody,
    SceneFile,
    Shape,
    Sphere,
    orientation_matrix,
    position_3d,
)
from sidtool.formats.storage.unreadable import failure_reason
from sidtool.solver.system.body_data import BodyData

from .surface import box, convex_hull, inertia_box, node_bars, plate_surface

Indices = NDArray[np.int64]
Mesh = tuple[Array, Indices]

#: Points of a circle, and of half of one from pole to pole.
CIRCLE, MERIDIAN = 48, 25
#: Bytes before the triangles of a binary STL, and of each triangle.
_HEAD = 84
_TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]
)
_NUMBER = rb"([-+0-9.eE]+)"
_VERTEX = re.compile(rb"vertex\s+" + rb"\s+".join([_NUMBER] * 3))

#: Text in pictures of flexible bodies whose nodes only are known.
_UNKNOWN_SURFACE_TEXT = "(its surface is not known)"
_BARS_TEXT = f"joined to their neighbours {_UNKNOWN_SURFACE_TEXT}"


def shape_mesh(shape: Shape, folders: Sequence[Path], place: str) -> Mesh:
    """Points (n, 3) in the body frame [m] and triangles (m, 3), which face outwards.

    Parameters
    ----------
    folders : where a relative path of a file may begin
    place : of the shape in the scene

    Raises
    ------
    InputError : there is no such file, or it is no STL.
    """
    if isinstance(shape, Box):
        points, triangles = box(np.array(shape.size))
    elif isinstance(shape, Cylinder):
        half, radius = 0.5 * shape.length, shape.radius
        outline = [(-half, 0.0), (-half, radius), (half, radius), (half, 0.0)]
        points, triangles = _revolved(np.array(outline))
    elif isinstance(shape, Sphere):
        angle = np.linspace(0.0, np.pi, MERIDIAN)
        meridian = shape.radius * np.column_stack([-np.cos(angle), np.sin(angle)])
        meridian[[0, -1], 1] = 0.0
        points, triangles = _revolved(meridian)
    else:
        points, triangles = read_stl(_found(shape.file, folders, place))
        points = shape.scale * points
    frame = shape.placement
    return points @ orientation_matrix(frame).T + position_3d(frame), triangles


def read_stl(path: Path) -> Mesh:
    """Points and triangles of an STL file, binary or as text.

    Raises
    ------
    InputError : it cannot be read, or is no STL.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(failure_reason(error), source=path) from None
    count = int.from_bytes(content[80:84], "little")
    if len(content) == _HEAD + count * _TRIANGLE.itemsize and len(content) > _HEAD:
        corners = np.frombuffer(content, _TRIANGLE, count, _HEAD)["corners"]
    else:
        vertices = _VERTEX.findall(content)
        try:
            corners = np.array(vertices, dtype=float).reshape(-1, 3, 3)
        except ValueError:
            corners = np.zeros((0, 3, 3))
    if not len(corners) or not np.isfinite(corners).all():
        raise InputError("is no STL file", source=path, expected="triangles")
    points, rows = np.unique(
        corners.reshape(-1, 3).astype(float), axis=0, return_inverse=True
    )
    return points, rows.reshape(-1, 3).astype(np.int64)


def _found(file: str, folders: Sequence[Path], place: str) -> Path:
    for folder in folders:
        if (folder / file).is_file():
            return folder / file
    raise InputError(
        f"there is no file {file}",
        place=f"{place}.file",
        expected="it beside the result, or in the working folder",
    )


def _revolved(outline: Array) -> Mesh:
    """The surface that an outline (k, 2) of z and radius [m] sweeps around z."""
    angle = 2.0 * np.pi * np.arange(CIRCLE) / CIRCLE
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = np.zeros((len(outline), CIRCLE, 3))
    rings[..., :2] = outline[:, 1, None, None] * circle
    rings[..., 2] = outline[:, 0, None]
    triangles = []
    for ring in range(len(outline) - 1):
        a = CIRCLE * ring + np.arange(CIRCLE)
        b = CIRCLE * ring + (np.arange(CIRCLE) + 1) % CIRCLE
        if outline[ring, 1] > 0:
            triangles.append(np.column_stack([a, b, b + CIRCLE]))
        if outline[ring + 1, 1] > 0:
            triangles.append(np.column_stack([a, b + CIRCLE, a + CIRCLE]))
    return rings.reshape(-1, 3), np.concatenate(triangles)


@dataclass(frozen=True, eq=False)
class BodySurface:
    """One body.

    Attributes
    ----------
    positions : (n, 3) undeformed [m]
    triangles : (m, 3)
    shapes : (n, 3, nq) displacement per elastic coordinate
    stress : (n, 6, nq) per elastic coordinate [Pa], or None
    initial_stress : (n, 6) [Pa]
    source : text on the source of the surface
    """

    name: str
    positions: Array
    triangles: Indices
    shapes: Array
    stress: Array | None = None
    initial_stress: Array = field(default_factory=lambda: np.zeros((0, 6)))
    source: str = ""

    @property
    def nq(self) -> int:
        """Number of elastic coordinates."""
        return self.shapes.shape[2]

    @property
    def is_sketched(self) -> bool:
        """Whether the surface of a flexible body is not known."""
        return self.source.endswith(_UNKNOWN_SURFACE_TEXT)


def body_surfaces(
    scene: SceneFile,
    bodies: tuple[BodyData, ...],
    fields: Mapping[str, Field],
    size: float,
    folders: Sequence[Path] = (Path("."),),
) -> list[BodySurface]:
    """Return the surfaces of all bodies except the ground.

    fields : of flexible bodies, as far as they are known
    size : of the mechanism, by which sketches are scaled [m]
    folders : folders of relative paths of shape files

    Raises
    ------
    InputError : the file of a shape cannot be read.
    """
    surfaces = []
    for data in bodies:
        if data.name not in scene.bodies:
            continue
        if data.name in fields:
            elastic = data.sid.nq > 0
            surfaces.append(surface_of_field(data.name, fields[data.name], elastic))
        elif isinstance(body := scene.bodies[data.name], RigidBody):
            if body.shape is None:
                surfaces.append(_rigid_body_lines(data, size))
            else:
                surfaces.append(_shaped(data.name, body.shape, folders))
        else:
            surfaces.append(surface_of_sid(data.name, data.sid, 0.02 * size))
    return surfaces


def surface_of_field(name: str, content: Field, elastic: bool = True) -> BodySurface:
    """The surface of a body; a plane one with its thickness.

    elastic : False for a body that the scene takes as rigid
    """
    if not len(content.triangles):
        size = float(np.ptp(content.positions, axis=0).max())
        turns = np.zeros_like(content.shapes)
        lines = node_bars(content.positions, content.shapes, turns, 0.01 * size)
        return BodySurface(name, *lines, source=f"the nodes of its field, {_BARS_TEXT}")
    used, rows = np.unique(content.triangles, return_inverse=True)
    surface = plate_surface(
        content.positions[used], rows.reshape(-1, 3), content.thickness
    )
    copies = used[surface.copies]
    nq = content.nq if elastic else 0
    stress = None if content.stress is None else content.stress[copies][..., :nq]
    return BodySurface(
        name=name,
        positions=surface.positions,
        triangles=surface.triangles,
        shapes=content.shapes[copies][..., :nq],
        stress=stress,
        initial_stress=content.initial_stress[copies],
        source="its full field",
    )


def surface_of_sid(name: str, sid: SID, width: float) -> BodySurface:
    """The hull of the nodes of a SID; where they fill no volume, bars between
    neighbours, which bend with their rotations.

    width : of the bars [m]
    """
    places = np.array([node.position for node in sid.nodes]).reshape(-1, 3)
    if len(places) < 2:
        places = np.vstack([np.zeros((1, 3)), places])
        zero = np.zeros((1, 3, sid.nq))
        phi, psi = (np.concatenate([zero, part]) for part in sid.shapes)
    else:
        phi, psi = sid.shapes
    solid = convex_hull(places, phi)
    if solid is not None:
        return BodySurface(
            name,
            *solid,
            source=f"the hull of the nodes of its SID {_UNKNOWN_SURFACE_TEXT}",
        )
    lines = node_bars(places, phi, psi, width)
    return BodySurface(name, *lines, source=f"the nodes of its SID, {_BARS_TEXT}")


def _shaped(name: str, shape: Shape, folders: Sequence[Path]) -> BodySurface:
    """Return the surface of a rigid body with a shape in the scene."""
    place = f"bodies.{name}.shape"
    positions, triangles = shape_mesh(shape, folders, place)
    no_shapes = np.zeros((len(positions), 3, 0))
    return BodySurface(name, positions, triangles, no_shapes, source=f"a {shape.type}")


def _rigid_body_lines(data: BodyData, size: float) -> BodySurface:
    """Return lines between the markers of a rigid body and its centre of mass.

    A single point is a box with the proportions of its moments of inertia.
    """
    sid = data.sid
    centre = sid.mdCM.m0[:, 0] / sid.mass
    places = [*(node.position for node in sid.nodes if node.id), centre]
    points = np.unique(np.round(places, 12), axis=0)
    if len(points) == 1:
        return BodySurface(data.name, *inertia_box(sid, centre, size), source="a box")
    no_shapes = np.zeros((len(points), 3, 0))
    lines = node_bars(points, no_shapes, no_shapes, 0.03 * size)
    return BodySurface(data.name, *lines, source="lines between its markers")
