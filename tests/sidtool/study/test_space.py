"""`sidtool study --over` of a bar in space: meshes, reductions, frames, terms."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.measurement.variants import BodyVariants, Variant
from sidtool.pipeline.model_cache import BodyModel
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.body_data import body_data
from sidtool.study import run_study

from .parts import ONE, bar, turning_bar


def test_a_twisting_bar_is_studied_without_terms(tmp_path: Path) -> None:
    """Its rotary inertia turns with it; that is no geometric stiffening to take out."""
    path = tmp_path / "bar.json"
    path.write_text(json.dumps(bar()), encoding="utf-8")
    scene = turning_bar()
    axes = {"reduction": ("craig_bampton",), "terms": ("none", "quadratic")}
    study = run_study(scene, axes, models={"bar": [path]}, settings=ONE)
    assert [p.message for p in study.points] == [""] * 2


def test_meshes_and_reductions_in_space(tmp_path: Path) -> None:
    """Against runs of the same models that are made by hand."""
    path = tmp_path / "bar.json"
    path.write_text(json.dumps(bar()), encoding="utf-8")
    scene = turning_bar()
    axes = {"mesh": (-1, 0), "reduction": ("modal", "craig_bampton")}
    study = run_study(scene, axes, models={"bar": [path]}, settings=ONE, differ=2)
    assert not any(p.message for p in study.points)
    names = study.reference.names
    size = {(p.choices["mesh"], p.choices["reduction"]): p.size for p in study.points}
    assert size["0", "craig_bampton"] > size["0", "modal"] == size["-1", "modal"] == 4
    richest = bar_by_hand(scene, names, 8, "craig_bampton")
    scale = np.ptp(richest, axis=0)
    for point in study.points:
        elements = 8 if point.choices["mesh"] == "0" else 4
        values = bar_by_hand(scene, names, elements, point.choices["reduction"])
        expected = np.abs(values - richest).max(axis=0) / scale
        assert list(point.errors.values()) == pytest.approx(expected, abs=2e-5)


def bar_by_hand(
    scene: SceneFile, names: tuple[str, ...], elements: int, method: str
) -> np.ndarray:
    model = ModelFile.model_validate(bar(elements, method))
    sids = {"bar": sid_from_model(model, lambda _: None)}
    system = compile_scene(scene, ".", sids)
    result = simulate(system, integrator="radau13", rtol=1e-10)
    return np.column_stack([result[name] for name in names])


def test_frames_of_models_keep_their_interfaces(tmp_path: Path) -> None:
    """What a tangent frame clamps is an interface of others: the same shape functions.

    Without it the base of a chord would move as modes that are held at the tip allow.
    """
    path = tmp_path / "bar.json"
    path.write_text(json.dumps(bar(method="craig_bampton")), encoding="utf-8")
    axes = {"frame": ("tangent", "chord", "buckens")}
    study = run_study(turning_bar(), axes, models={"bar": [path]}, settings=ONE)
    assert [p.message for p in study.points] == [""] * 3
    assert len({p.size for p in study.points}) == 1
    assert max(p.error for p in study.points) < 1e-2


RATIOS = {"type": "modal", "ratio": [0.01 * k for k in range(1, 11)]}
RAYLEIGH = {"type": "rayleigh", "alpha": 300.0}


@pytest.mark.parametrize(
    ("own", "of_scene", "of_model"),
    [
        ("tangent", RATIOS, None),
        ("chord", RATIOS, None),
        ("buckens", RATIOS, None),
        ("buckens", {"type": "modal", "ratio": 0.3}, None),
        ("chord", {"type": "frequency"}, None),
        ("tangent", RAYLEIGH, None),
        ("tangent", None, RAYLEIGH),
        ("chord", None, RAYLEIGH),
        ("buckens", None, RAYLEIGH),
        ("tangent", {"type": "sid"}, RAYLEIGH),
    ],
)
def test_frames_keep_the_damping_of_a_law(
    tmp_path: Path,
    own: str,
    of_scene: dict[str, Any] | None,
    of_model: dict[str, Any] | None,
) -> None:
    """A law holds in the frame of the model; other frames describe the same body.

    The shape functions differ by rigid motions, which neither store nor dissipate
    energy: the eigenvalues of De with respect to Ke are the same in all frames.
    """
    content = turning_bar().model_dump(mode="json", by_alias=True, exclude_none=True)
    content["bodies"]["bar"]["damping"] = of_scene
    scene = SceneFile.model_validate(content)
    data = bar(method="craig_bampton")
    data["reduction"]["interfaces"] = ["root", "tip"]
    markers = {"tangent": {"marker": "root"}, "chord": {"markers": ["root", "tip"]}}
    frame = {"type": own, **markers.get(own, {})}
    path = tmp_path / "bar.json"
    path.write_text(
        json.dumps(data | {"damping": of_model, "frame": frame}), encoding="utf-8"
    )
    bodies = BodyVariants(scene, {}, {"bar": [BodyModel(path, tmp_path)]})
    found = []
    for kind in dict.fromkeys((own, "tangent", "chord", "buckens")):
        variant = Variant(frame=kind)
        (changed,) = bodies.to_convert(variant).values()
        sid = sid_from_model(changed, lambda _: None)
        bodies = replace(bodies, sids={"bar": sid} | dict(bodies.sids))
        as_simulated, sids = bodies.as_scene(variant, {"bar": sid})
        body = body_data("bar", as_simulated.bodies["bar"], sids, planar=False).sid
        found.append(eigh(body.De.m0, body.Ke.m0, eigvals_only=True))
    assert found[0].max() > 0.0
    for other in found[1:]:
        assert other == pytest.approx(found[0], rel=1e-6, abs=1e-9 * found[0].max())
