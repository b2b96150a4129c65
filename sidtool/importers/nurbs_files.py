"""Files of one or several NURBS patches.

Three formats, distinguished by ending and content:

- Our own, TOML or JSON: ``format = "sidtool patches"``, ``version = 1`` and one table
  ``[patches.NAME]`` per patch with the keys degrees, knots, control_points and weights
  of a model file's geometry (two directions: plane, three: volume).
- geomdl JSON (NURBS-Python 5): surfaces with ``control_points`` in one list, v running
  fastest, and volumes with v fastest, then u, then w.
- G+Smo XML: TensorBSpline and TensorNurbs of two and three directions, the first one
  running fastest.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.toml.reading import read_data

from ..geometry.nurbs_patch import NurbsPatch
from .gismo import (
    check_count,
    make_patch,
    read_gismo,
    required_array,
    required_entry,
    to_grid,
)


def read_patches(path: str | Path) -> dict[str, NurbsPatch]:
    """The patches of a file by their names.

    Raises
    ------
    InputError : the file is not valid; the error names file and patch.
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".xml":
            return read_gismo(path)
        data = read_data(path)
        if data.get("format") == "sidtool patches":
            return _from_sidtool(data)
        if isinstance(data.get("shape"), dict):
            return _from_geomdl(data["shape"])
    except InputError as error:
        raise error.located(path) from None
    raise InputError(
        "is no patch file",
        source=path,
        expected='format = "sidtool patches", a geomdl JSON file or a G+Smo XML file',
    )


def _from_sidtool(data: Mapping[str, Any]) -> dict[str, NurbsPatch]:
    if data.get("version") != 1:
        raise InputError(
            f"found {data.get('version')!r}", place="version", expected="1"
        )
    tables = data.get("patches")
    if not isinstance(tables, dict) or not tables:
        raise InputError("is missing", place="patches", expected="tables of patches")
    result = {}
    for name, table in tables.items():
        place = f"patches.{name}"
        points = required_array(table, "control_points", place)
        weights = (
            required_array(table, "weights", place)
            if isinstance(table, dict) and "weights" in table
            else np.ones(points.shape[:-1])
        )
        degrees = required_entry(table, "degrees", place)
        knots = required_entry(table, "knots", place)
        result[name] = make_patch(degrees, knots, points, weights, place)
    return result


def _from_geomdl(shape: Mapping[str, Any]) -> dict[str, NurbsPatch]:
    letters = {"surface": "uv", "volume": "uvw"}.get(str(shape.get("type")))
    if letters is None:
        raise InputError(
            f"found {shape.get('type')!r}",
            place="shape.type",
            expected="surface or volume",
        )
    items = shape.get("data")
    if not isinstance(items, list) or not items:
        raise InputError("is missing", place="shape.data", expected="a list of patches")
    if shape.get("count", len(items)) != len(items):
        raise InputError(
            f"announces {shape['count']!r} patches and holds {len(items)}",
            place="shape.count",
            expected="as many as it announces",
        )
    result = {}
    for i, item in enumerate(items):
        place = f"shape.data[{i}]"
        _check_keys(item, letters, place)
        sizes = [required_entry(item, f"size_{x}", place) for x in letters]
        net = required_entry(item, "control_points", place)
        points = required_array(net, "points", f"{place}.control_points")
        check_count(points, sizes, place)
        weights = np.ones(len(points))
        if "weights" in net:
            weights = required_array(net, "weights", f"{place}.control_points").ravel()
        order = (0, 1) if len(letters) == 2 else (2, 0, 1)
        result[f"patch{i + 1}"] = make_patch(
            [required_entry(item, f"degree_{x}", place) for x in letters],
            [required_entry(item, f"knotvector_{x}", place) for x in letters],
            to_grid(points, sizes, order),
            to_grid(weights[:, None], sizes, order)[..., 0],
            place,
        )
    return result


def _check_keys(item: Any, letters: str, place: str) -> None:
    """Check that a table has only keys of the patch and of its display.

    Raises
    ------
    InputError : the patch is trimmed, or has a key that is not known.
    """
    if not isinstance(item, dict):
        return
    trims = item.get("trims")
    if isinstance(trims, dict):
        trims = trims.get("data")
    if trims:
        raise InputError(
            "has trim curves, which are not supported",
            place=f"{place}.trims",
            expected="whole patches",
        )
    shaped = {f"{key}_{x}" for key in _BY_DIRECTION for x in letters}
    unknown = sorted(set(item) - shaped - _OF_PATCH)
    if unknown:
        raise InputError(
            "is not known",
            place=f"{place}.{unknown[0]}",
            expected=f"one of {', '.join(sorted(shaped | _OF_PATCH))}",
        )


_BY_DIRECTION = ("degree", "knotvector", "size", "delta", "sample_size")
_OF_PATCH = {
    "control_points",
    "delta",
    "dimension",
    "id",
    "name",
    "opt",
    "rational",
    "reversed",
    "sample_size",
    "trims",
    "type",
}
