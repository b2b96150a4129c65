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

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import integer_of_text, real_of_text
from sidtool.formats.base.sid import Array
from sidtool.formats.model.tables import check_knots
from sidtool.formats.storage.unreadable import unreadable_error
from sidtool.formats.toml.reading import read_data

from ..geometry.nurbs_patch import NurbsPatch, scale_knots

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


def read_gismo(path: Path) -> dict[str, NurbsPatch]:
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(str(error), expected="valid XML") from None
    except OSError as error:
        raise unreadable_error(path, "a file", error) from None
    result: dict[str, NurbsPatch] = {}
    for node in root.iter("Geometry"):
        kind, name = node.get("type", ""), f"patch{node.get('id', len(result))}"
        directions = kind[-1:]
        if not kind.startswith(("TensorBSpline", "TensorNurbs")) or directions not in (
            "2",
            "3",
        ):
            raise InputError(
                f"is of type {kind!r}",
                place=f"geometry {name}",
                expected="TensorBSpline or TensorNurbs of 2 or 3 directions",
            )
        if name in result:
            raise InputError(
                "is given twice",
                place=f"geometry {name}",
                expected="an id of its own for every Geometry",
            )
        result[name] = _gismo_patch(node, int(directions), f"geometry {name}")
    if not result:
        raise InputError("holds no Geometry", expected="a G+Smo file of patches")
    _check_multipatch(root, set(result))
    return result


def _check_multipatch(root: ElementTree.Element, patches: set[str]) -> None:
    """A table of patches, if there is one, lists all of them.

    Raises
    ------
    InputError : there are several, or it lists others.
    """
    tables = list(root.iter("MultiPatch"))
    if len(tables) > 1:
        raise InputError(
            f"holds {len(tables)} MultiPatch", expected="one MultiPatch, one body"
        )
    for table in tables:
        node = table.find("patches")
        if node is None:
            continue
        place = "MultiPatch: patches"
        ids = [_parse_integer(word, place) for word in (node.text or "").split()]
        if node.get("type") == "id_range" and len(ids) == 2:
            ids = list(range(ids[0], ids[1] + 1))
        listed = {f"patch{i}" for i in ids}
        if listed != patches:
            differ = ", ".join(sorted(listed ^ patches))
            raise InputError(
                f"differs from the Geometry of the file: {differ}",
                place=place,
                expected="every Geometry of the file, and no other",
            )


def _gismo_patch(node: ElementTree.Element, k: int, place: str) -> NurbsPatch:
    vectors = list(node.iter("KnotVector"))
    coefs = node.find("coefs")
    if len(vectors) != k or coefs is None:
        raise InputError(
            f"has {len(vectors)} KnotVector and "
            f"{'no' if coefs is None else 'one'} coefs",
            place=place,
            expected=f"{k} KnotVector and one coefs",
        )
    degrees = [_parse_integer(v.get("degree"), f"{place}: KnotVector") for v in vectors]
    knots = [_parse_numbers(v.text, f"{place}: KnotVector") for v in vectors]
    d = _parse_integer(coefs.get("geoDim"), f"{place}: coefs geoDim")
    flat = _parse_numbers(coefs.text, f"{place}: coefs")
    if d < 1 or len(flat) % d:
        raise InputError(
            f"has {len(flat)} numbers",
            place=f"{place}: coefs",
            expected=f"a multiple of geoDim = {d}",
        )
    points = np.array(flat).reshape(-1, d)
    sizes = [len(u) - p - 1 for u, p in zip(knots, degrees, strict=True)]
    check_count(points, sizes, place)
    text = node.find(".//weights")
    weights = np.ones(len(points))
    if text is not None:
        weights = np.array(_parse_numbers(text.text, f"{place}: weights"))
    order = tuple(range(k))[::-1]
    return make_patch(
        degrees,
        knots,
        to_grid(points, sizes, order),
        to_grid(weights[:, None], sizes, order)[..., 0],
        place,
    )


def _parse_numbers(text: str | None, place: str) -> list[float]:
    numbers = []
    for word in (text or "").split():
        try:
            numbers.append(real_of_text(word))
        except ValueError:
            raise InputError(
                f"found {word[:60]!r}", place=place, expected="finite numbers"
            ) from None
    return numbers


def _parse_integer(text: str | None, place: str) -> int:
    try:
        return integer_of_text(text or "")
    except ValueError:
        raise InputError(
            f"found {text!r}", place=place, expected="an integer"
        ) from None


def make_patch(
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
        vector = [float(x) for x in required_array({"k": knots[i]}, "k", where).ravel()]
        check_knots(vector, degrees[i], points.shape[i], where)
        scaled.append(scale_knots(np.array(vector)))
    return NurbsPatch(tuple(degrees), tuple(scaled), points, weights)


def to_grid(values: Array, sizes: list[int], order: tuple[int, ...]) -> Array:
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


def required_entry(table: Any, key: str, place: str) -> Any:
    if not isinstance(table, dict) or key not in table:
        raise InputError("is missing", place=f"{place}.{key}", expected="a value")
    return table[key]


def required_array(table: Any, key: str, place: str) -> Array:
    value = required_entry(table, key, place)
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
