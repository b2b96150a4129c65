"""Derivatives by numbers of the model of a body, through its SID."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.api.motion_problem import Point
from tests.places import ROOT

pytestmark = pytest.mark.filterwarnings("ignore::sidtool.DiagnosticWarning")

KEYS = ["material.youngs_modulus", "material.density", "geometry.section.width"]


def bar(end: float = 0.05) -> sidtool.Scene:
    """A clamped bar under its weight, given by its model."""
    scene = sidtool.Scene.load(ROOT / "examples/beam/scene.toml")
    return scene.with_({"bar.model": "beam.toml", "time.end": end})


def coarse_bar() -> sidtool.Scene:
    model = sidtool.Model.load(ROOT / "examples/beam/beam.toml")
    coarse = {"discretisation.elements": 4, "reduction.modes": 3}
    return bar().with_({"bar.model": model.with_(coarse)})


def test_a_bar_under_its_weight() -> None:
    """Deflection ~ rho / E, frequency ~ sqrt(E / rho), mass and force ~ rho b."""
    found = sidtool.sensitivity(
        bar(),
        [f"bar.model.{key}" for key in KEYS],
        ["static(bar.tip.y)", "frequency(1)", "mass(bar)", "static(wall.fy)"],
    )
    exact = [[-1, 1, 0], [0.5, -0.5, 0], [0, 1, 1], [0, 1, 1]]
    assert found.relative == pytest.approx(np.array(exact), abs=2e-6)


def test_a_vibration_by_the_time_scale() -> None:
    """Undamped, y(t; E, rho) = (rho / E) y*(t sqrt(E / rho)): dJ/dlnE = -J / 2 for an
    integral over a duration that follows, and by E and density with opposite signs.
    """
    scene = bar().with_({"bar.model": "beam.toml"})
    keys = [f"bar.model.{key}" for key in KEYS[:2]]
    model = sidtool.Model.load(ROOT / "examples/beam/beam.toml")
    scene = scene.with_({"bar.model": model.with_({"damping.beta": 0.0})})
    found = sidtool.sensitivity(
        scene, [*keys, "time.end"], ["final(bar.tip.y)"], integrator="radau9", rtol=1e-8
    )
    by_modulus, by_density, by_time = found.relative[0]
    assert by_modulus == pytest.approx(-1.0 + 0.5 * by_time, rel=1e-5)
    assert by_density == pytest.approx(1.0 - 0.5 * by_time, rel=1e-5)


def test_a_model_is_needed(tmp_path: Path) -> None:
    scene = sidtool.Scene.load(ROOT / "examples/slider_crank/slider_crank.toml")
    key = "rod.model.geometry.thickness"
    with pytest.raises(sidtool.InputError, match="model"):
        sidtool.sensitivity(scene, key, "rms(rod.q1)")
    sid = ROOT / "examples/slider_crank/rod_iga.SID_FEM"
    with pytest.raises(sidtool.InputError, match="rod"):
        sidtool.sensitivity(
            scene.with_({"rod.model": "rod_q4.toml"}),
            key,
            "rms(rod.q1)",
            sids={"rod": sid},
        )


@pytest.mark.parametrize(
    ("functional", "neighbours"),
    [("final(bar.q1)", 1), ("final(bar.tip.y)", 4)],
    ids=["state", "own"],
)
def test_an_adjoint_run_serves_all_numbers_of_a_model(
    functional: str, neighbours: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One pair of neighbours checks the gradient by the SID; each number has its own
    pair where the functional depends on shape functions itself.
    """
    keys = [f"bar.model.{key}" for key in KEYS]
    calls = list[float]()
    along = Point.neighbour_along

    def counted(point: Point, direction: Any, step: float) -> Any:
        calls.append(step)
        return along(point, direction, step)

    monkeypatch.setattr(Point, "neighbour_along", counted)
    found = sidtool.sensitivity(coarse_bar(), keys, functional, method="adjoint")
    assert len(calls) == 2 * neighbours
    direct = sidtool.sensitivity(coarse_bar(), keys, functional, method="direct")
    assert found.relative == pytest.approx(direct.relative, rel=1e-8, abs=1e-8)


def test_groups_are_sums_of_the_numbers_that_they_change() -> None:
    keys = [f"bar.model.{key}" for key in KEYS[:2]]
    groups = [f"g{k}={keys[0]}:{k},{keys[1]}:{1e-6 * k}" for k in (1, 2, 3)]
    single = sidtool.sensitivity(coarse_bar(), keys, "final(bar.q1)", method="direct")
    found = sidtool.sensitivity(coarse_bar(), groups, "final(bar.q1)", method="direct")
    by_modulus, by_density = single.derivatives[0]
    exact = [k * (by_modulus + 1e-6 * by_density) for k in (1, 2, 3)]
    assert found.derivatives[0] == pytest.approx(np.array(exact), rel=1e-12)
