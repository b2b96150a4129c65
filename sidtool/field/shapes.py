"""Meshes of the shapes that a scene gives to its rigid bodies."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Box,
    Cylinder,
    Shape,
    Sphere,
    orientation_matrix,
    position_3d,
)
from sidtool.formats.storage.unreadable import failure_reason

from .surface import box

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
