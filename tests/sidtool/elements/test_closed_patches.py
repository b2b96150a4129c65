"""Patches that close on themselves or shrink to a point: rings, tubes, disks, balls."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import spherical_jn

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.model.refine import refine_model as with_finer_mesh
from sidtool.formats.toml.reading import validate_data
from sidtool.geometry.nurbs_patch import (
    evaluate_grid,
    k_refined_knots,
    patch_from_model,
    refine_patch,
)
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from tests.codes import only

from ..models import rod_data

STEEL = {"youngs_modulus": 210e9, "poissons_ratio": 0.3, "density": 7850.0}
W = np.sqrt(0.5)
#: A full circle of radius 1 by four quadratic arcs, continuous at its inner knots.
CIRCLE = np.array(
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]],
    float,
)
CIRCLE_KNOTS = [0, 0, 0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1, 1, 1]
CIRCLE_WEIGHTS = np.array([1, W, 1, W, 1, W, 1, W, 1])
LINE = [0, 0, 1, 1]
#: Half a circle from pole to pole by two quadratic arcs.
ARC = np.array([[0, -1], [1, -1], [1, 0], [1, 1], [0, 1]], float)
ARC_KNOTS = [0, 0, 0, 0.5, 0.5, 1, 1, 1]


def free(geometry: dict[str, Any], discretisation: dict[str, Any]) -> ModelFile:
    """A free body whose only marker is somewhere inside."""
    data = rod_data(discretisation, geometry=geometry, material=STEEL)
    data["frame"] = {"type": "buckens"}
    k = len(geometry["degrees"])
    data["markers"] = {"m": {"node": 1, "parameters": [0.4] * k}}
    data["reduction"] = {"method": "modal", "modes": 3}
    return validate_data(data, ModelFile)


def ring(
    discretisation: dict[str, Any], inner: float = 0.9, thickness: float = 0.1
) -> ModelFile:
    geometry = {
        "type": "nurbs",
        "degrees": [1, 2],
        "knots": [LINE, CIRCLE_KNOTS],
        "control_points": [(inner * CIRCLE).tolist(), CIRCLE.tolist()],
        "weights": [CIRCLE_WEIGHTS.tolist()] * 2,
        "thickness": thickness,
    }
    return free(geometry, discretisation)


def disk(discretisation: dict[str, Any], share: int = 4) -> ModelFile:
    """Radius 1, its left side the centre; `share` quarters of it."""
    last = 2 * share + 1
    knots = [x for x in CIRCLE_KNOTS if x < share / 4] + [share / 4] * 3
    geometry = {
        "type": "nurbs",
        "degrees": [1, 2],
        "knots": [LINE, knots],
        "control_points": [[[0.0, 0.0]] * last, CIRCLE[:last].tolist()],
        "weights": [CIRCLE_WEIGHTS[:last].tolist()] * 2,
        "thickness": 0.1,
    }
    return free(geometry, discretisation)


def tube(discretisation: dict[str, Any], inner: float = 0.5) -> ModelFile:
    """Outer radius 1, length 1; with `inner` 0 a cylinder whose left face is its axis.

    u runs outwards, v round, w along the axis.
    """
    net = [[[[*(r * p), z] for z in (0.0, 1.0)] for p in CIRCLE] for r in (inner, 1.0)]
    geometry = {
        "type": "nurbs_volume",
        "degrees": [1, 2, 1],
        "knots": [LINE, CIRCLE_KNOTS, LINE],
        "control_points": np.array(net).tolist(),
        "weights": np.broadcast_to(CIRCLE_WEIGHTS[None, :, None], (2, 9, 2)).tolist(),
    }
    return free(geometry, discretisation)


def ball(discretisation: dict[str, Any], inner: float = 0.0) -> ModelFile:
    """Radius 1: u from the inner radius, v round, w from pole to pole."""
    net = [
        [[[r * x * p[0], r * x * p[1], r * z] for x, z in ARC] for p in CIRCLE]
        for r in (inner, 1.0)
    ]
    weights = CIRCLE_WEIGHTS[:, None] * np.array([1, W, 1, W, 1])
    geometry = {
        "type": "nurbs_volume",
        "degrees": [1, 2, 2],
        "knots": [LINE, CIRCLE_KNOTS, ARC_KNOTS],
        "control_points": np.array(net).tolist(),
        "weights": [weights.tolist()] * 2,
    }
    return free(geometry, discretisation)


def iga(degree: int, *elements: int) -> dict[str, Any]:
    degrees = [degree] * len(elements)
    return {"type": "iga", "degrees": degrees, "elements": list(elements)}


def hertz(model: ModelFile, count: int = 2) -> np.ndarray:
    """Lowest elastic frequencies of a free body."""
    reduction = {"method": "modal", "modes": count}
    sid = sid_from_model(model.with_({"reduction": reduction}))
    return np.sqrt(np.diag(sid.Ke.m0)) / (2 * np.pi)


def thin_ring(inner: float) -> float:
    """Two waves of a thin ring in its plane (Love): f of n = 2 for radius, height.

    omega^2 = E h^2 / (12 rho R^4) n^2 (n^2 - 1)^2 / (n^2 + 1).
    """
    radius, height = (1 + inner) / 2, 1 - inner
    speed = np.sqrt(STEEL["youngs_modulus"] / STEEL["density"] / 12)
    return speed * height / radius**2 * np.sqrt(36 / 5) / (2 * np.pi)


@pytest.mark.parametrize(
    "settings",
    [
        iga(4, 1, 16),
        iga(5, 2, 8),
        {"type": "iga", "degrees": [2, 4], "functions": [3, 47]},
        {"type": "q4", "elements": [2, 96]},
    ],
    ids=str,
)
def test_a_ring_of_one_patch_is_closed(settings: dict[str, Any]) -> None:
    """Thin-ring theory is right to O((h/R)^2); a slit ring has a sixth of it."""
    inner = 0.96
    frequencies = hertz(ring(settings, inner))
    assert_allclose(frequencies, thin_ring(inner), rtol=6e-3)
    assert_allclose(frequencies[0], frequencies[1], rtol=3e-3)


def test_quadrilaterals_and_iga_agree_on_a_thick_ring() -> None:
    exact = hertz(ring(iga(6, 2, 16), 0.5))
    mesh = hertz(ring({"type": "q4", "elements": [18, 180]}, 0.5))
    assert_allclose(mesh, exact, rtol=1e-3)


@pytest.mark.parametrize("degree", [2, 3])
def test_rings_converge_with_order_2p(degree: int) -> None:
    exact = hertz(ring(iga(7, 2, 16), 0.6))
    errors = [hertz(ring(iga(degree, n, 8 * n), 0.6)) / exact - 1 for n in (2, 4)]
    assert (errors[1] > 0).all()
    rate = np.log2(errors[0] / errors[1])
    assert (rate > 2 * degree - 0.4).all(), rate


BODIES = {
    "ring": (ring(iga(2, 1, 8)), np.pi * (1 - 0.9**2) * 0.1),
    "disk": (disk(iga(2, 2, 8)), np.pi * 0.1),
    "quarter disk": (disk(iga(3, 2, 4), 1), np.pi / 4 * 0.1),
    "tube": (tube(iga(2, 1, 4, 1)), np.pi * 0.75),
    "cylinder": (tube(iga(2, 1, 4, 1), 0.0), np.pi),
    "ball": (ball(iga(2, 1, 4, 2)), 4 / 3 * np.pi),
    "hollow ball": (ball(iga(2, 1, 4, 2), 0.5), 4 / 3 * np.pi * 7 / 8),
}


@pytest.mark.parametrize("name", BODIES)
def test_every_point_is_one(name: str) -> None:
    """Mass is exact, rigid motions are free, and no two control points coincide."""
    model, volume = BODIES[name]
    body = finite_element_model(model)
    assert body.scalar_mass is not None
    assert body.scalar_mass.sum() == pytest.approx(7850 * volume, rel=1e-11)
    near = np.linalg.norm(body.positions[:, None] - body.positions, axis=2)
    assert (near + np.eye(len(near)) > 1e-6).all()


@cache
def exact_tube(inner: float) -> np.ndarray:
    return hertz(tube(iga(4, 1, 8, 1), inner))


@pytest.mark.parametrize(
    ("kind", "inner"), [("hex8", 0.0), ("hex8", 0.5), ("hex20", 0.5), ("tet10", 0.0)]
)
def test_meshes_of_tubes_and_cylinders_are_closed(kind: str, inner: float) -> None:
    settings = {"type": kind, "elements": [2, 16, 2]}
    model = tube(settings, inner)
    body = finite_element_model(model)
    near = np.linalg.norm(body.positions[:, None] - body.positions, axis=2)
    assert (near + np.eye(len(near)) > 1e-6).all()
    tolerance = 0.09 if kind == "hex8" else 0.02
    assert_allclose(hertz(model), exact_tube(inner), rtol=tolerance)


def test_a_disk_of_quadrilaterals() -> None:
    exact = hertz(disk(iga(5, 3, 8)))
    errors = [
        hertz(disk({"type": "q4", "elements": [n, 6 * n]})) / exact - 1 for n in (8, 16)
    ]
    assert (np.abs(errors[-1]) < 4e-3).all()
    assert (np.abs(errors[0]) > 3 * np.abs(errors[1])).all()


def test_a_side_on_a_part_of_the_other_is_tied() -> None:
    """A ring whose end is wider than its start, inwards and outwards alike.

    As stiff as the same ring that tapers and has sides alike, but for the step.
    """
    model = ring(iga(3, 1, 16), 0.8)
    net = np.array(model.geometry.control_points)
    net[0, -1] *= 0.9
    wide = model.geometry.model_copy(
        update={"control_points": tuple(map(tuple, net.tolist()))}
    )
    body = finite_element_model(model.model_copy(update={"geometry": wide}))
    plain = hertz(model)
    assert "geometry.bottom" in only(body, "N123").line
    frequencies = hertz(model.model_copy(update={"geometry": wide}))
    assert_allclose(frequencies, plain, rtol=0.1)
    q4 = model.model_copy(
        update={
            "geometry": wide,
            "discretisation": ring({"type": "q4", "elements": [2, 40]}).discretisation,
        }
    )
    with pytest.raises(InputError, match="iga"):
        finite_element_model(q4)


@pytest.mark.parametrize("functions", [False, True])
@pytest.mark.parametrize("degree", [2, 3, 5])
def test_k_refinement_keeps_the_continuity_of_inner_knots(
    degree: int, functions: bool
) -> None:
    """Spans of 0.2, 0.3 and 0.5, C0 and C1 between them."""
    knots = np.array([0, 0, 0, 0.2, 0.2, 0.5, 1, 1, 1])
    found = k_refined_knots(knots, 2, degree, 10)
    ends, counts = np.unique(found, return_counts=True)
    assert_allclose(np.diff(ends), 0.1)
    smooth = degree - counts[1:-1]
    expected = np.full(9, degree - 1)
    expected[[1, 4]] = 0, 1
    assert (smooth == expected).all()
    mirrored = k_refined_knots(1 - knots[::-1], 2, degree, 7)
    assert_allclose(1 - mirrored[::-1], k_refined_knots(knots, 2, degree, 7))
    model = ring(iga(degree, 1, 4))
    patch = patch_from_model(model.geometry)
    fine = refine_patch(
        patch,
        (2, degree),
        tuple(
            k_refined_knots(k, p, q, 9)
            for k, p, q in zip(patch.knots, patch.degrees, (2, degree), strict=True)
        ),
    )
    x = np.linspace(0, 1, 41)
    assert_allclose(evaluate_grid(fine, (x, x)), evaluate_grid(patch, (x, x)))


def test_numbers_that_the_knot_spans_do_not_allow_are_noted() -> None:
    """At least the requested number, with a note; no note if the numbers fit."""
    settings = {"type": "iga", "degrees": [2, 2], "functions": [3, 26]}
    body = finite_element_model(ring(settings))
    patch, _ = body.patches[0]
    assert patch.shape[0] == 3 and patch.shape[1] >= 26
    note = only(body, "N155")
    assert note.subject == "discretisation.functions[1]"
    assert note.data == {"found": patch.shape[1], "requested": 26}
    fitting = {"type": "iga", "degrees": [2, 2], "functions": [3, patch.shape[1]]}
    assert finite_element_model(ring(fitting)).diagnostics == ()


def test_a_ball_has_the_torsion_of_a_ball() -> None:
    """Lamb 1882: five modes 0T2 at k R = 2.50113, j_2(k R) - k R j_3(k R) = 0.

    The root of d/dr (j_2(k r) / r) = 0 at r = R, independent of Poisson's ratio.
    """
    root = brentq(lambda x: spherical_jn(2, x) - x * spherical_jn(3, x), 2, 3)
    shear = STEEL["youngs_modulus"] / 2 / (1 + STEEL["poissons_ratio"])
    expected = root * np.sqrt(shear / STEEL["density"]) / (2 * np.pi)
    frequencies = hertz(ball(iga(3, 2, 8, 3)), 5)
    assert_allclose(frequencies, expected, rtol=2e-3)


@pytest.mark.parametrize("degree", [2, 3])
def test_meshes_of_closed_patches_are_halved(degree: int) -> None:
    """Each knot span is halved, whether functions or elements are requested."""

    def spans(model: ModelFile | None) -> list[int]:
        assert model is not None
        ((patch, _),) = finite_element_model(model).patches
        return [len(np.unique(knots)) - 1 for knots in patch.knots]

    ((patch, _),) = finite_element_model(ring(iga(degree, 2, 12))).patches
    functions = {
        "type": "iga",
        "degrees": [degree] * 2,
        "functions": list(patch.shape),
    }
    for settings in (functions, iga(degree, 2, 12)):
        model = ring(settings)
        assert spans(model) == [2, 12]
        assert spans(with_finer_mesh(model, 1)) == [4, 24]
        assert spans(with_finer_mesh(model, -1)) == [1, 8]
