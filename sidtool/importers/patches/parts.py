"""What the readers of patches have in common."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model.checks import check_knots

from ...geometry.patch import NurbsPatch

Array = NDArray[np.float64]


def patch_of(
    degrees: Any, knots: Any, points: Array, weights: Array, place: str
) -> NurbsPatch:
    k = points.ndim - 1
    for name, value in (("degrees", degrees), ("knots", knots)):
        if not isinstance(value, list) or len(value) != k:
            raise InputError(
                f"{name} does not have {k} entries",
                place=place,
                expected="one for every direction of control_points",
            )
    if points.shape[-1] == 3 and k == 2 and not points[..., 2].any():
        points = points[..., :2]
    if points.shape[-1] != k:
        raise InputError(
            f"has {k} directions in {points.shape[-1]} dimensions",
            place=place,
            expected="plane patches in the plane z = 0, or volumes in space",
        )
    if weights.shape != points.shape[:-1] or not (weights > 0).all():
        raise InputError(
            "the weights do not fit",
            place=place,
            expected="one positive weight for every control point",
        )
    scaled = []
    for i in range(k):
        where = f"{place}: knots[{i}]"
        if not isinstance(degrees[i], int) or degrees[i] < 1:
            raise InputError(
                f"found {degrees[i]!r}",
                place=f"{place}: degrees[{i}]",
                expected="an integer of at least 1",
            )
        vector = [float(x) for x in array_of({"k": knots[i]}, "k", where).ravel()]
        check_knots(vector, degrees[i], points.shape[i], where)
        u = np.array(vector)
        scaled.append((u - u[0]) / (u[-1] - u[0]))
    return NurbsPatch(tuple(degrees), tuple(scaled), points, weights)


def grid(values: Array, sizes: list[int], order: tuple[int, ...]) -> Array:
    """Values in one list as a grid by direction; `order` from slowest to fastest."""
    if len(values) != np.prod(sizes):
        raise InputError(
            f"has {len(values)} weights for {np.prod(sizes)} control points",
            expected="one for each",
        )
    grid = values.reshape(*(sizes[i] for i in order), -1)
    return np.transpose(grid, (*np.argsort(order), len(order)))


def check_count(points: Array, sizes: list[Any], place: str) -> None:
    if any(not isinstance(n, int) or n < 2 for n in sizes) or len(points) != np.prod(
        sizes
    ):
        raise InputError(
            f"has {len(points)} control points",
            place=place,
            expected=" x ".join(map(str, sizes)),
        )


def entry(table: Any, key: str, place: str) -> Any:
    if not isinstance(table, dict) or key not in table:
        raise InputError("is missing", place=f"{place}.{key}", expected="a value")
    return table[key]


def array_of(table: Any, key: str, place: str) -> Array:
    value = entry(table, key, place)
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.ndim == 0 or not array.size or not np.isfinite(array).all():
        raise InputError(
            "is no regular list of finite numbers",
            place=f"{place}.{key}",
            expected="nested lists of the same length",
        )
    return array
