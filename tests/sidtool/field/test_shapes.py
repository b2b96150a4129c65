"""Shapes that a scene gives to rigid bodies, in pictures and exports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.field.body_surfaces import CIRCLE, MERIDIAN, read_stl, shape_mesh
from sidtool.formats.scene import Shape
from sidtool.view.animation import animate
from sidtool.view.export import export_mesh

#: Area of a polygon with the points of a circle, to that of the circle.
ROUND = CIRCLE / (2 * np.pi) * np.sin(2 * np.pi / CIRCLE)


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """By the divergence theorem; negative where triangles face inwards."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


def is_closed(triangles: np.ndarray, points: np.ndarray) -> bool:
    """Whether each edge belongs to two triangles that run along it both ways."""
    same = np.unique(np.round(points, 12), axis=0, return_inverse=True)[1].ravel()
    edges = same[np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])]
    there, back = (set(map(tuple, e)) for e in (edges, edges[:, ::-1]))
    return there == back and len(there) == len(edges)


def stl(path: Path, points: np.ndarray, triangles: np.ndarray, text: bool) -> None:
    corners = points[triangles]
    if text:
        lines = ["solid body"]
        for triangle in corners:
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += ["vertex " + " ".join(map(repr, map(float, p))) for p in triangle]
            lines += ["endloop", "endfacet"]
        path.write_text("\n".join([*lines, "endsolid"]), encoding="ascii")
        return
    data = bytes(80) + len(corners).to_bytes(4, "little")
    for triangle in corners:
        data += bytes(12) + triangle.astype("<f4").tobytes() + bytes(2)
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("shape", "exact"),
    [
        (sidtool.Box(size=[1.0, 2.0, 3.0]), 6.0),
        (sidtool.Cylinder(radius=0.5, length=2.0), np.pi / 2 * ROUND),
        (sidtool.Sphere(radius=2.0), 4 / 3 * np.pi * 8.0 * ROUND),
    ],
)
def test_volumes_of_closed_surfaces(shape: Shape, exact: float) -> None:
    """A sphere of rings is also inscribed along its meridians, to second order."""
    points, triangles = shape_mesh(shape, (), "")
    along = 0.0 if not isinstance(shape, sidtool.Sphere) else (np.pi / MERIDIAN) ** 2
    assert is_closed(triangles, points)
    assert volume(points, triangles) == pytest.approx(exact, rel=1e-12 + along)
    placed: Any = shape.model_copy(
        update={"placement": sidtool.Marker(position=[1, 2, 3], axis_angle=[0, 1, 0])}
    )
    moved = shape_mesh(placed, (), "")[0]
    centre = (moved.min(axis=0) + moved.max(axis=0)) / 2
    assert np.allclose(centre, [1.0, 2.0, 3.0], atol=1e-12)
    assert volume(moved, triangles) == pytest.approx(volume(points, triangles))


@pytest.mark.parametrize("text", [False, True])
def test_stl_files_are_read(text: bool, tmp_path: Path) -> None:
    points, triangles = shape_mesh(sidtool.Box(size=[100.0, 50.0, 20.0]), (), "")
    stl(tmp_path / "b.stl", points, triangles, text)
    shape = sidtool.SurfaceMesh(file="b.stl", scale=1e-3)
    found = shape_mesh(shape, [tmp_path], "")
    assert volume(*found) == pytest.approx(1e-4, rel=1e-6) and is_closed(*found[::-1])
    (tmp_path / "empty.stl").write_bytes(b"solid nothing")
    with pytest.raises(sidtool.InputError, match="no STL"):
        read_stl(tmp_path / "empty.stl")


def test_bodies_are_shown_by_their_shapes(tmp_path: Path) -> None:
    """In exports and pages they move with the body; a missing file is named."""
    box = sidtool.Box(size=[0.4, 0.2, 0.1], placement={"position": [0.2, 0.0, 0.0]})
    arm = sidtool.RigidBody(
        mass=1.0,
        inertia=0.1,
        markers={"pin": {"position": [-0.2, 0.0]}},
        initial={"angular_velocity": 2.0, "velocity": [1.0, 0.0]},
        shape=box,
    )
    scene = sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=0.5, output_step=0.25),
        bodies={"arm": arm},
        outputs=sidtool.Outputs(record=["arm.*"]),
    )
    result = scene.simulate()
    (part,) = export_mesh(result).parts
    assert len(part.positions) == 8 and "box" in part.source
    for k, t in enumerate(result.t):
        c, s = np.cos(2.0 * t), np.sin(2.0 * t)
        middle = part.at(k)["points"].mean(axis=0)
        assert np.allclose(middle, [t + 0.2 * c, 0.2 * s, 0.0], atol=1e-9)
    assert animate(result, tmp_path / "m.html") is not None
    mesh = {"bodies.arm.shape": {"type": "mesh", "file": "arm.stl"}}
    other = scene.with_(mesh).simulate()
    assert np.array_equal(other.values, result.values)
    with pytest.raises(sidtool.InputError, match="no file arm.stl"):
        export_mesh(other)
    points, triangles = shape_mesh(box, (), "")
    stl(tmp_path / "arm.stl", points, triangles, False)
    (part,) = export_mesh(other, folder=tmp_path).parts
    assert len(part.positions) == 8
    with pytest.raises(sidtool.InputError, match="shape"):
        scene.with_({"bodies.arm.shape": {"type": "cone"}})
