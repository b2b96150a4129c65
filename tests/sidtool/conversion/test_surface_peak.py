"""The peak of the von Mises stress is that of the surface by default."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID
from sidtool.formats.base.stress import has_peak_nodes, peak_stress, stress_nodes
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import simulate
from tests.codes import codes
from tests.solver.scenes import compiled, scene

from ..models import Q4, rod

THICKNESS = 0.01


def arc(radius: float, begin: float, end: float) -> tuple[list[Any], float]:
    """Control points of a circular arc, and the weight of the middle one."""
    weight = float(np.cos((end - begin) / 2))
    angles = np.array([begin, (begin + end) / 2, end])
    sizes = radius * np.array([1.0, 1.0 / weight, 1.0])
    points = sizes[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return points.tolist(), weight


def between(inner: list[Any], outer: list[Any], weights: list[Any]) -> dict[str, Any]:
    """A patch between two curves of degree 2."""
    return {
        "degrees": [1, 2],
        "knots": [[0, 0, 1, 1], [0, 0, 0, 1, 1, 1]],
        "control_points": [inner, outer],
        "weights": weights,
    }


def drawn(
    folder: Path, patches: list[Any], ends: tuple[str, str], mesh: dict[str, Any]
) -> SID:
    """A plane body of patches that is loaded at two sides, by default with a peak."""
    geometry: dict[str, Any] = {"type": "nurbs", **patches[0]}
    if len(patches) > 1:
        tables = {f"p{k}": patch for k, patch in enumerate(patches)}
        data = {"format": "sidtool patches", "version": 1, "patches": tables}
        path = folder / "patches.json"
        path.write_text(json.dumps(data), encoding="utf-8")
        geometry = {"type": "patches", "file": str(path)}
    model = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "density": 7850.0},
        "geometry": geometry | {"thickness": THICKNESS},
        "discretisation": mesh,
        "markers": {
            name: {"node": k, "tie": {"type": "distributing", "to": to}}
            for k, (name, to) in enumerate(zip("ab", ends, strict=True), 1)
        },
        "frame": {"type": "buckens"},
        "reduction": {"method": "attachment", "interfaces": ["a", "b"], "modes": 0},
        "stress": {},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sid_from_model(validate_data(model, ModelFile))


def pulled(sid: SID, load: np.ndarray) -> float:
    """The peak stress under opposite loads (nq,) at both ends."""
    q = np.linalg.lstsq(sid.Ke.m0, load, rcond=1e-10)[0]
    return float(peak_stress(sid, q[None])[0])


@pytest.mark.parametrize(
    ("count", "mesh", "close"),
    [
        (1, {"type": "iga", "degrees": [2, 2], "elements": [4, 8]}, 3e-3),
        (3, {"type": "iga", "degrees": [3, 3], "elements": [6, 4]}, 3e-3),
        (1, {"type": "q4", "elements": [16, 48]}, 1e-2),
    ],
)
def test_a_thick_ring_in_bending(
    tmp_path: Path, count: int, mesh: dict[str, Any], close: float
) -> None:
    """A quarter of one, its largest stress is that of the inner side (S. Timoshenko,
    J. N. Goodier, Theory of Elasticity, 1951, section 27)."""
    a, b, moment = 0.1, 0.2, 1000.0
    angles = np.linspace(0.0, np.pi / 2, count + 1)
    patches = []
    for begin, end in zip(angles[:-1], angles[1:], strict=True):
        inner, weight = arc(a, begin, end)
        outer, _ = arc(b, begin, end)
        patches.append(between(inner, outer, [[1.0, weight, 1.0]] * 2))
    ends = ("bottom", "top") if count == 1 else ("p0.bottom", f"p{count - 1}.top")
    sid = drawn(tmp_path, patches, ends, mesh)
    turned = sid.node(2).psi.m0[2] - sid.node(1).psi.m0[2]
    log = np.log(b / a)
    scale = (b**2 - a**2) ** 2 - 4.0 * a**2 * b**2 * log**2
    exact = 4.0 * moment / (THICKNESS * scale) * (2.0 * b**2 * log - b**2 + a**2)
    assert pulled(sid, turned * moment) == pytest.approx(exact, rel=close)


def test_a_large_plate_with_a_hole(tmp_path: Path) -> None:
    """Three times the stress far away, of Kirsch, and for a square plate (a / h)^2 more
    by about 9."""
    radius, half, force = 0.05, 1.0, 1e4
    patches = []
    for k in range(4):
        begin = (k - 0.5) * np.pi / 2
        inner, weight = arc(radius, begin, begin + np.pi / 2)
        corners = np.array([inner[0], inner[2]]) * half * np.sqrt(2.0) / radius
        outer = [corners[0], corners.mean(axis=0), corners[1]]
        points = [point.tolist() for point in outer]
        patches.append(between(inner, points, [[1.0, weight, 1.0], [1.0] * 3]))
    graded = (np.linspace(0.0, 1.0, 7)[1:-1] ** 2).tolist()
    even = np.linspace(0.0, 1.0, 4)[1:-1].tolist()
    knots = [[0.0] * 5 + inside + [1.0] * 5 for inside in (graded, even)]
    mesh = {"type": "iga", "degrees": [4, 4], "knots": knots}
    sid = drawn(tmp_path, patches, ("p2.right", "p0.right"), mesh)
    moved = sid.node(2).phi.m0[0] - sid.node(1).phi.m0[0]
    far = force / (2.0 * half * THICKNESS)
    expected = 3.0 + 9.0 * (radius / half) ** 2
    assert pulled(sid, moved * force) == pytest.approx(expected * far, rel=1e-2)


@cache
def with_peak_nodes(count: int, first: int) -> SID:
    return sid_from_model(rod(Q4, stress={"peak_points": count, "first_node": first}))


@pytest.mark.parametrize("ending", [".SID_FEM", ".h5"])
@pytest.mark.parametrize(("count", "first"), [(0, 10001), (5, 10001), (5, 301)])
def test_peak_nodes_are_not_known_by_their_numbers(
    tmp_path: Path, ending: str, count: int, first: int
) -> None:
    """Markers may have the numbers 10001 and more, peak nodes others."""
    sid = with_peak_nodes(count, first)
    if first != 10001 or not count:
        moved = {"1": "10001", "2": "20002"}
        nodes = [replace(node, id=moved.get(node.id, node.id)) for node in sid.nodes]
        sid = replace(sid, nodes=tuple(nodes))
    path = tmp_path / f"rod{ending}"
    write_sid(path, sid)
    again = read_sid(path)
    assert has_peak_nodes(sid) == has_peak_nodes(again) == bool(count)
    assert again.title == sid.title
    # of another program, and written again
    foreign = replace(sid, has_peak_nodes=None)
    write_sid(path, foreign)
    assert not has_peak_nodes(foreign) and not has_peak_nodes(read_sid(path))
    # of an earlier version
    earlier = replace(foreign, written_by="sidtool 0.1")
    assert has_peak_nodes(earlier) or first != 10001 or not count


@pytest.mark.parametrize("count", [None, 0, 5])
def test_a_peak_of_markers_only_is_noted(count: int | None) -> None:
    """By the conversion, and by runs that record it, of any SID."""
    table = {} if count is None else {"peak_points": count}
    sid = sid_from_model(rod(Q4, stress=table))
    assert ("N170" in codes(sid)) == (count == 0)
    assert has_peak_nodes(sid) == (count != 0)
    assert len(stress_nodes(sid)) > 2 or count == 0
    hinge = {"type": "revolute", "markers": ["ground", "rod.a"]}
    described = scene(
        {"rod": {"sid": "-", "markers": {"a": 1, "b": 2}}},
        {"hinge": hinge},
        end=1e-4,
        gravity=[0.0, -9.81],
        record=["rod.peak_von_mises"],
    )
    found = codes(simulate(compiled(described, rod=sid)))
    assert ("N430" in found) == (count == 0)
