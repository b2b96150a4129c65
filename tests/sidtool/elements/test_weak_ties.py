"""Patches that touch in part, overlap, or are finer than the tolerance."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile, read_model
from sidtool.geometry.nurbs_patch import (
    NurbsPatch,
    open_uniform_knots,
    patch_from_model,
    refine_patch,
)
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from tests.codes import codes, only, with_code

from ..models import annulus, rod_data
from .test_frontend_patches import split, written


def box(*ends: tuple[float, float], turn: float = 0.0) -> NurbsPatch:
    """A rectangle or a cuboid between the ends of its directions, turned about z."""
    grid = np.stack(np.meshgrid(*ends, indexing="ij"), -1).astype(float)
    c, s = np.cos(turn), np.sin(turn)
    grid[..., :2] = grid[..., :2] @ np.array([[c, s], [-s, c]])
    knots = tuple(np.array([0.0, 0, 1, 1]) for _ in ends)
    return NurbsPatch((1,) * len(ends), knots, grid, np.ones(grid.shape[:-1]))


def model_of(
    folder: Path,
    patches: dict[str, NurbsPatch],
    elements: int,
    clamp: list[str],
    degree: int = 2,
    **geometry: Any,
) -> ModelFile:
    written(folder / "patches.json", patches)
    d = next(iter(patches.values())).points.shape[1]
    data = rod_data(
        {"type": "iga", "degrees": [degree] * d, "elements": [elements] * d}
    )
    data["geometry"] = {"type": "patches", "file": "patches.json", **geometry}
    if d == 2:
        data["geometry"]["thickness"] = 0.1
    data["geometry"]["edges"] = {"foot": clamp}
    data["frame"] = {"type": "tangent", "marker": "foot", "clamp": "foot"}
    at: Any = 0.5 if d == 2 else [0.5, 0.5]
    data["markers"] = {"foot": {"node": 1, "edge": clamp[0], "at": at}}
    data["reduction"]["modes"] = 3
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return read_model(folder / "model.json")


#: Parts as patches that touch in part, the same as patches that share whole sides, the
#: sides to clamp, and how many ties there are.
PARTS: dict[str, Any] = {
    "L of squares": (
        {"a": box((0, 1), (0, 1)), "b": box((1, 1.5), (0, 0.5))},
        {
            "a": box((0, 1), (0, 0.5)),
            "c": box((0, 1), (0.5, 1)),
            "b": box((1, 1.5), (0, 0.5)),
        },
        (["a.bottom"], ["a.bottom"]),
        1,
    ),
    "T": (
        {"a": box((0, 1), (0, 0.3)), "b": box((0.4, 0.6), (0.3, 0.8))},
        {
            "a": box((0, 0.4), (0, 0.3)),
            "c": box((0.4, 0.6), (0, 0.3)),
            "d": box((0.6, 1), (0, 0.3)),
            "b": box((0.4, 0.6), (0.3, 0.8)),
        },
        (["a.left"], ["a.left"]),
        1,
    ),
    "two on one side": (
        {
            "a": box((0, 1), (0, 0.3)),
            "b": box((0, 0.5), (0.3, 0.8)),
            "c": box((0.5, 1), (0.3, 0.8)),
        },
        {"a": box((0, 1), (0, 0.3)), "b": box((0, 1), (0.3, 0.8))},
        (["a.bottom"], ["a.bottom"]),
        2,
    ),
    "blocks": (
        {
            "a": box((0, 1), (0, 0.3), (0, 0.4)),
            "b": box((0.4, 0.7), (0.3, 0.8), (0, 0.4)),
        },
        {
            "a": box((0, 0.4), (0, 0.3), (0, 0.4)),
            "c": box((0.4, 0.7), (0, 0.3), (0, 0.4)),
            "d": box((0.7, 1), (0, 0.3), (0, 0.4)),
            "b": box((0.4, 0.7), (0.3, 0.8), (0, 0.4)),
        },
        (["a.left"], ["a.left"]),
        1,
    ),
}


@pytest.mark.parametrize("name", PARTS)
def test_sides_on_a_part_of_a_side_are_tied(tmp_path: Path, name: str) -> None:
    """They were glued where control points coincide: f1 was 11 to 42 % too low."""
    parts, conforming, (clamp, same), count = PARTS[name]
    space = "blocks" in name
    fine = (3, 4) if space else (6, 12)
    found = []
    for elements in fine:
        model = model_of(tmp_path, parts, elements, clamp)
        sid = sid_from_model(model)
        assert len(with_code(sid, "N123")) == count
        found.append(np.sqrt(np.diag(sid.Ke.m0)))
    model = model_of(tmp_path, conforming, fine[1], same)
    exact = sid_from_model(model)
    assert sid.mass == pytest.approx(exact.mass, rel=1e-12)
    assert_allclose(sid.J.m0, exact.J.m0, atol=1e-10 * np.abs(exact.J.m0).max())
    expected = np.sqrt(np.diag(exact.Ke.m0))
    errors = [np.abs(f / expected - 1).max() for f in found]
    assert errors[1] < 0.035
    assert errors[1] < errors[0]


def sector(inner: float, outer: float, start: float, end: float) -> NurbsPatch:
    """A part of a ring between two radii and two angles [deg]."""
    middle, half = np.deg2rad((start + end) / 2), np.deg2rad((end - start) / 2)
    angles = middle + half * np.array([-1.0, 0.0, 1.0])
    weights = np.array([1.0, np.cos(half), 1.0])
    arc = np.column_stack([np.cos(angles), np.sin(angles)]) / weights[:, None]
    knots = (np.array([0.0, 0, 1, 1]), np.array([0.0, 0, 0, 1, 1, 1]))
    return NurbsPatch(
        (1, 2), knots, np.stack([inner * arc, outer * arc]), np.stack([weights] * 2)
    )


def test_an_arc_on_a_part_of_an_arc_is_tied(tmp_path: Path) -> None:
    """A lug on a curved arm; the mass is that of the sectors."""
    lug = sector(1.3, 1.7, 25, 55)
    whole = {"a": sector(1, 1.3, 0, 90), "b": lug}
    split = {f"a{i}": sector(1, 1.3, *ends) for i, ends in enumerate(_CUTS)}
    errors = []
    exact = sid_from_model(model_of(tmp_path, split | {"b": lug}, 10, ["a0.bottom"]))
    for elements in (5, 10):
        sid = sid_from_model(model_of(tmp_path, whole, elements, ["a.bottom"]))
        tie = only(sid, "N123")
        assert (tie.subject, tie.data["master"]) == ("b.left", "a.right")
        squares = np.diag(sid.Ke.m0) / np.diag(exact.Ke.m0)
        errors.append(np.abs(np.sqrt(squares) - 1).max())
    area = np.pi / 4 * (1.3**2 - 1) + np.pi / 12 * (1.7**2 - 1.3**2)
    assert sid.mass == pytest.approx(7850 * 0.1 * area, rel=1e-12)
    assert errors[1] < 0.035
    assert errors[1] < 0.6 * errors[0]


_CUTS = ((0, 25), (25, 55), (55, 90))


@pytest.mark.parametrize("name", PARTS)
def test_ties_pass_the_patch_test(tmp_path: Path, name: str) -> None:
    """Linear fields do not feel the tie, and the body moves as one rigid piece."""
    parts, _, (clamp, _), count = PARTS[name]
    turned = {key: box(*_ends(patch), turn=0.7) for key, patch in parts.items()}
    body = finite_element_model(model_of(tmp_path, turned, 3, clamp))
    assert codes(body) == ["N123"] * count
    d = body.dimension
    slope = np.random.default_rng(1).normal(size=(d, d))
    u = (body.positions @ slope.T).ravel()
    force = (body.stiffness @ u).reshape(-1, d)
    surface = np.unique(np.concatenate(list(body.node_sets.values())))
    tied = np.concatenate([body.node_sets[tie.subject] for tie in body.diagnostics])
    inside = np.setdiff1d(np.arange(len(force)), surface)
    assert_allclose(force[inside], 0, atol=1e-9 * np.abs(force).max())
    assert tied.size
    values = np.linalg.eigvalsh(body.stiffness.toarray())
    rigid = d * (d + 1) // 2
    assert np.abs(values[:rigid]).max() < 1e-9 * values[rigid]


def _ends(patch: NurbsPatch) -> list[tuple[float, float]]:
    low, high = patch.points.min(axis=0), patch.points.max(axis=0)
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]


REFUSED: dict[str, Any] = {
    "touch in part, and neither lies wholly": {
        "a": box((0, 1), (0, 0.5)),
        "b": box((0.3, 1.4), (0.5, 1)),
    },
    "patches a and b overlap near": {
        "a": box((0, 1), (0, 0.5)),
        "b": box((0.95, 1.4), (0, 0.5)),
    },
    "overlap": {"a": box((0, 1), (0, 0.5)), "b": box((0.4, 0.6), (0.1, 0.9))},
    "patches a and c overlap": {
        "a": box((0, 1), (0, 0.5)),
        "b": box((1, 2), (0, 0.5)),
        "c": box((0, 1), (0, 0.5)),
    },
    "patch b is not joined to patch a": {
        "a": box((0, 1), (0, 0.5)),
        "b": box((1, 2), (0.5, 1)),
    },
    "patch c is not joined": {
        "a": box((0, 1), (0, 0.5), (0, 1)),
        "b": box((1, 2), (0, 0.5), (0, 1)),
        "c": box((1, 2), (0.5, 1), (1, 2)),
    },
}


@pytest.mark.parametrize("message", REFUSED)
def test_sides_that_cannot_be_joined_are_refused(tmp_path: Path, message: str) -> None:
    model = model_of(tmp_path, REFUSED[message], 2, ["a.left"])
    with pytest.raises(InputError, match=message):
        finite_element_model(model)


@pytest.mark.parametrize("tolerance", [1e-9, 1e-2])
def test_the_tolerance_does_not_melt_refined_patches(
    tmp_path: Path, tolerance: float
) -> None:
    """At 1e-2 it joined neighbouring control points: 843 Hz became 3 473 Hz."""
    shape = annulus({"type": "iga", "degrees": [3, 3], "elements": [2, 2]}).geometry
    whole = patch_from_model(shape)
    first, second = split(whole, 1)
    patches = {"a": first, "b": second}
    model = model_of(tmp_path, patches, 40, ["a.bottom"], 3, tolerance=tolerance)
    body = finite_element_model(model)
    assert len(body.positions) == 43 * (2 * 43 - 1)


@pytest.mark.parametrize("gap", [1e-5, 1e-3])
def test_a_gap_within_the_tolerance_is_closed(tmp_path: Path, gap: float) -> None:
    """The body moves as one rigid piece: no stiffness against its rotation."""
    patches = {"a": box((0, 1), (0, 0.5)), "b": box((1 + gap, 2), (0, 0.5))}
    model = model_of(tmp_path, patches, 3, ["a.left"], tolerance=2 * gap)
    body = finite_element_model(model)
    assert len(body.positions) == 5 * 9
    rigid = body.rigid_body_modes()
    resisting = np.abs(body.stiffness @ rigid).max()
    assert resisting < 1e-10 * np.abs(body.stiffness).max()


def refined_across(patch: NurbsPatch, *spans: int) -> NurbsPatch:
    """With so many knot spans in all directions but the first."""
    across = (open_uniform_knots(1, count) for count in spans)
    return refine_patch(patch, patch.degrees, (patch.knots[0], *across))


@pytest.mark.parametrize("dimension, spans", [(2, 4), (2, 16), (3, 2)])
def test_the_finer_side_of_a_tie_is_held_between_knots(
    tmp_path: Path, dimension: int, spans: int
) -> None:
    """Two coarse patches on the finer end of a third move in no way in which four
    patches of its knots cannot, and in all ways of three coarse ones: frequencies lie
    between theirs. They were 2 % too low. The springs of a tie give way by 1e-5.
    """
    depth, fine = ((0.0, 0.2),) * (dimension - 2), (spans,) * (dimension - 2)
    low, high = (0.0, 0.25), (0.25, 0.5)
    beside = {"b": box((0.5, 1), low, *depth), "c": box((0.5, 1), high, *depth)}
    end = box((0, 0.5), (0, 0.5), *depth)
    halves = {"a": box((0, 0.5), low, *depth), "d": box((0, 0.5), high, *depth)}

    def frequencies(patches: dict[str, NurbsPatch], *clamp: str) -> np.ndarray:
        model = model_of(tmp_path, patches, 1, [*clamp], degree=3)
        return np.sqrt(np.diag(sid_from_model(model).Ke.m0))

    found = frequencies({"a": refined_across(end, spans, *fine), **beside}, "a.left")
    conforming = {
        name: refined_across(patch, spans // 2, *fine)
        for name, patch in (halves | beside).items()
    }
    least = frequencies(conforming, "a.left", "d.left")
    assert (found > (1 - 1e-5) * least).all()
    assert (found < frequencies({"a": end, **beside}, "a.left")).all()
