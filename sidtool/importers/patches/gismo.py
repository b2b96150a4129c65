"""Patches of G+Smo XML files."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.storage.unreadable import unreadable

from ...geometry.patch import NurbsPatch
from .parts import check_count, grid, patch_of


def patches_of_gismo(path: Path) -> dict[str, NurbsPatch]:
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError, LookupError) as error:
        raise InputError(str(error), expected="valid XML") from None
    except OSError as error:
        raise unreadable(path, "a file", error) from None
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
        ids = [_integer(word, place) for word in (node.text or "").split()]
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
    degrees = [_integer(v.get("degree"), f"{place}: KnotVector") for v in vectors]
    knots = [_numbers(v.text, f"{place}: KnotVector") for v in vectors]
    d = _integer(coefs.get("geoDim"), f"{place}: coefs geoDim")
    flat = _numbers(coefs.text, f"{place}: coefs")
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
        weights = np.array(_numbers(text.text, f"{place}: weights"))
    order = tuple(range(k))[::-1]
    return patch_of(
        degrees,
        knots,
        grid(points, sizes, order),
        grid(weights[:, None], sizes, order)[..., 0],
        place,
    )


def _numbers(text: str | None, place: str) -> list[float]:
    try:
        numbers = [float(word) for word in (text or "").split()]
    except ValueError as error:
        raise InputError(str(error), place=place, expected="numbers") from None
    if not np.isfinite(numbers).all():
        raise InputError("is not finite", place=place, expected="finite numbers")
    return numbers


def _integer(text: str | None, place: str) -> int:
    try:
        return int(text or "")
    except ValueError:
        raise InputError(
            f"found {text!r}", place=place, expected="an integer"
        ) from None
