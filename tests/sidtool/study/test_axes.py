"""`sidtool study --over`: models, meshes, modes, frames and terms side by side."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import sidtool
from sidtool.formats.model.refine import refine_model
from sidtool.formats.scene import SceneFile
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.plot.studies import draw_front
from sidtool.solver import compile_scene, simulate
from sidtool.study import Point, Setting, pareto_front, run_study
from tests.codes import only, with_code

from ..accuracy.arms import cantilever, spun, swinging
from ..beams import beam
from .parts import IGA, ONE, Q4

whole_module = importlib.import_module("sidtool.study.run_study")


def test_errors_are_those_of_runs_by_hand(models: list[Path]) -> None:
    """Against dop853 on the finest mesh with most modes, all made without the study."""
    scene = swinging(0.4)
    study = run_study(
        scene,
        {"mesh": (-1, 0), "modes": (1, 3)},
        models={"arm": models[:1]},
        settings=ONE,
    )
    assert study.varied == ("mesh", "modes") and len(study.points) == 4
    names, recorded = study.reference.names, scene.outputs.record
    assert names
    richest = by_hand(scene, 0, 3, integrator="dop853", rtol=1e-11)
    scale = np.ptp(richest, axis=0)
    for point in study.points:
        level, modes = (int(point.choices[axis]) for axis in study.varied)
        values = by_hand(scene, level, modes, integrator="dop853", rtol=1e-11)
        errors = np.abs(values - richest).max(axis=0) / scale
        assert tuple(point.errors) == names
        for name in names:
            error = errors[recorded.index(name)]
            assert point.errors[name] == pytest.approx(error, rel=0.05, abs=1e-6)
        assert point.error >= max(point.errors.values())
        assert point.size == modes
    assert {p.dofs for p in study.points} == {2 * 11 * 2, 2 * 21 * 3}


def by_hand_of(scene: Any, modes: int, **how: Any) -> np.ndarray:
    system = compile_scene(scene, Path("."), {"arm": cantilever(modes)})
    return np.asarray(simulate(system, **how).values)


def by_hand(scene: Any, level: int, modes: int, **how: Any) -> np.ndarray:
    model = beam(Q4, reduction={"method": "modal", "modes": modes})
    finer = refine_model(model, level)
    assert finer is not None
    system = compile_scene(scene, Path("."), {"arm": sid_from_model(finer, str)})
    return np.asarray(simulate(system, **how).values)


def test_no_modes_are_a_rigid_body(models: list[Path]) -> None:
    """Of a model with modes alone the physical pendulum stays; interfaces deform."""
    scene = swinging(0.4)
    study = run_study(
        scene, {"modes": (0, 2)}, models={"arm": models[:1]}, settings=ONE
    )
    rigid = next(p for p in study.points if p.choices["modes"] == "0")
    assert rigid.size == 0
    richest = by_hand(scene, 0, 2, integrator="dop853", rtol=1e-11)
    turn = turned(np.linspace(0.0, 0.4, len(richest)))
    for k, places in enumerate((np.cos(turn), np.sin(turn))):
        error = np.abs(places - richest[:, k]).max() / np.ptp(richest[:, k])
        told = rigid.errors[scene.outputs.record[k]]
        assert told == pytest.approx(error, rel=1e-3, abs=1e-6)
    axes = {"modes": (0, 2), "reduction": ("craig_bampton",)}
    tied = run_study(scene, axes, models={"arm": models[:1]}, settings=ONE)
    assert {p.size - int(p.choices["modes"]) for p in tied.points} == {3}


def turned(times: np.ndarray) -> np.ndarray:
    """The angle of a slender bar of length 1 that falls from level about its end."""
    inertia = (1.0 + 0.01**2) / 12.0 + 0.25

    def fall(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -0.15 * np.cos(y[0]) / inertia]

    found = solve_ivp(fall, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-10)
    return np.asarray(found.y[0])


def test_models_are_put_side_by_side(models: list[Path]) -> None:
    """The reference is the model that its own refinement changes least: smooth IGA."""
    study = run_study(
        swinging(0.4), {"mesh": (-2, -1, 0)}, models={"arm": models}, settings=ONE
    )
    assert {p.choices["model"] for p in study.points} == {"q4", "iga"}
    assert "iga" in study.reference.model
    worst = {p.choices["model"]: p.error for p in study.points}
    assert worst["q4"] > worst["iga"]
    assert all(p.conversion > 0.0 for p in study.points)


def test_all_frames_give_the_same_motion() -> None:
    """Small deformations: where the frame sits changes them in second order only."""
    scene = swinging(0.4, outputs={"record": ["arm.tip.y", "arm.tip.uy", "arm.y"]})
    study = run_study(scene, {"frame": ()}, sids={"arm": cantilever(3)}, settings=ONE)
    assert study.reference.names == ("arm.tip.y",)
    assert set(study.dropped) == {"arm.tip.uy", "arm.y"}
    assert {p.choices["frame"] for p in study.points} > {"chord", "buckens"}
    assert all(p.error < 1e-3 for p in study.points)


def test_damping_laws_hold_in_the_frame_of_the_sid() -> None:
    """Evaluated in each frame they were others, which changed a force by 40 %."""
    arm = {"sid": "arm", "markers": {"root": 1, "tip": 2}}
    arm["damping"] = {"type": "rayleigh", "alpha": 20.0, "beta": 0.0}
    scene = swinging(
        0.4, bodies={"arm": arm}, outputs={"record": ["pin.fx", "pin.fy", "arm.tip.y"]}
    )
    study = run_study(
        scene,
        {"frame": ("tangent", "buckens")},
        sids={"arm": cantilever(3)},
        settings=ONE,
    )
    assert max(p.error for p in study.points) < 2e-3


def test_changes_by_the_last_modes_are_part_of_the_error() -> None:
    """The third elastic coordinate is there in the richest variant alone."""
    scene = swinging(0.4, outputs={"record": ["arm.q*", "arm.tip.x"]})
    study = run_study(
        scene, {"modes": (0, 1, 3)}, sids={"arm": cantilever(3)}, settings=ONE
    )
    assert study.reference.unconverged["arm.q3"] == pytest.approx(1.0, abs=0.1)
    assert with_code(study, "N734")[0].subject == "arm.q3"
    rigid, one, whole = sorted(study.points, key=lambda p: p.size)
    assert (rigid.size, one.size, whole.size) == (0, 1, 3)
    assert rigid.error > one.error > whole.error >= study.reference.uncertainty
    assert not whole.is_resolved


def test_the_error_of_the_reference_is_part_of_an_error() -> None:
    """Four shape functions differ from five by as much as five may be wrong: the error
    against eight was reported as that difference, and is larger.
    """
    scene = swinging(0.1, outputs={"record": ["arm.tip.x"]})
    points = run_study(
        scene, {"modes": (1, 4, 5)}, sids={"arm": cantilever(5)}, settings=ONE
    ).points
    rich, poor = (
        np.ravel(by_hand_of(scene, modes, integrator="dop853", rtol=1e-11))
        for modes in (8, 4)
    )
    true = np.abs(poor - rich).max() / np.ptp(rich)
    four = next(p for p in points if p.size == 4)
    assert max(four.errors.values()) < true < four.error


def test_limiting_outputs_are_named_with_a_remedy() -> None:
    """The tip bends by what the modes make of it, and is carried round by the drive."""
    scene, sids = spun(0.5, 4.0), {"arm": cantilever(3)}
    study = run_study(scene, {"modes": (1, 2)}, sids=sids, settings=ONE)
    assert study.reference.uncertainty > 2e-3
    limit = only(study, "N730")
    assert limit.data["limiting"] == ("arm.tip.uy",)
    assert "more modes" in limit.remedy and "--of arm.tip.x" in limit.remedy
    more = run_study(scene, {"modes": (1, 2, 3)}, sids=sids, settings=ONE)
    alone = run_study(
        scene, {"modes": (1, 2)}, outputs=["arm.tip.x"], sids=sids, settings=ONE
    )
    for better in (more, alone):
        assert better.reference.uncertainty < 2e-4
        assert not with_code(better, "N730")


@pytest.mark.parametrize("pairs", [[(1.0, 0.1)], [(1.0, 0.1), (2.0, 0.3)]])
def test_a_front_of_one_point_is_drawn(pairs: list[tuple[float, float]]) -> None:
    figure = Figure()
    panel = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    panel.set(xlim=(0.0, 3.0), ylim=(0.0, 1.0))
    draw_front(panel, [(*pair, True) for pair in pairs])
    panel.axis("off")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert (np.asarray(canvas.buffer_rgba())[..., :3] < 128).any()


def test_a_spin_needs_its_geometric_stiffening() -> None:
    """Ten times the first frequency: without stiffening the motion diverges or is
    wrong.
    """
    scene = spun(2.5, 12.0, outputs={"record": ["arm.tip.x", "arm.tip.y", "hub.mz"]})
    study = run_study(
        scene,
        {"terms": ()},
        sids={"arm": cantilever(2, stiffened=True)},
        settings=ONE,
    )
    errors = {p.choices["terms"]: p.error for p in study.points}
    assert errors["none"] > 10.0 * errors["stiffening"]
    assert errors["all"] < 1e-4


def test_nothing_dominates_the_front() -> None:
    pairs = [(3.0, 1e-3), (1.0, 1e-2), (2.0, 5e-2), (4.0, 1e-6), (4.0, 1e-5)]
    points = [Point(Setting("radau9", 1e-6), e, s, 1) for s, e in pairs]
    best = pareto_front(points, lambda p: p.seconds)
    assert [(p.seconds, p.error) for p in best] == [
        (1.0, 1e-2),
        (3.0, 1e-3),
        (4.0, 1e-6),
    ]


def test_the_front_ends_at_the_first_unresolved_error() -> None:
    """Of points that the reference does not resolve the cheapest is the best."""
    rows = [(1.0, 1e-2, True), (2.0, 4e-5, False), (9.0, 3e-5, False)]
    setting = Setting("radau9", 1e-6)
    points = [Point(setting, e, s, 1, is_resolved=r) for s, e, r in rows]
    assert [p.seconds for p in pareto_front(points, lambda p: p.seconds)] == [1.0, 2.0]


ARM = {"sid": "arm", "markers": {"root": 1, "tip": 2}, "quadratic_inertia": False}


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (spun(2.5, 4.0), "N40[45] arm"),
        (
            swinging(gravity=[0.0, -3.0], bodies={"arm": ARM}),
            "the scene as it is stopped",
        ),
    ],
)
def test_large_deformations_are_reported_before_anything_is_compared(
    scene: SceneFile, message: str, models: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After one run of the scene, and one of its richest variant: no reference."""
    requested: list[Any] = []
    monkeypatch.setattr(
        whole_module, "best_reference", lambda *rest: requested.append(rest)
    )
    with pytest.raises(sidtool.InputError, match=message):
        run_study(
            scene,
            {"mesh": (-1, 0, 1), "modes": (1, 2)},
            models={"arm": models[:1]},
            settings=ONE,
        )
    assert not requested


def test_elements_can_be_larger() -> None:
    for mesh, key, expected in (
        ({"type": "q4", "elements": [5, 1]}, "elements", (3, 1)),
        (IGA | {"elements": [8, 3]}, "elements", (4, 2)),
        (
            {"type": "iga", "degrees": [3, 2], "functions": [11, 4]},
            "functions",
            (7, 3),
        ),
    ):
        coarse = refine_model(beam(mesh), -1)
        assert coarse is not None
        assert getattr(coarse.discretisation, key) == expected


SIX = {
    "mesh": (-1, 0),
    "modes": (1, 2),
    "reduction": ("modal", "craig_bampton"),
    "frame": ("tangent", "chord"),
    "terms": ("all", "none"),
}


def test_all_axes_together(models: list[Path]) -> None:
    """One choice at a time: the reference is converted although no point is like it."""
    settings = (*ONE, Setting("radau9", rtol=1e-8))
    given = {"arm": models[:1]}
    study = run_study(swinging(0.2), SIX, models=given, settings=settings, differ=1)
    assert study.varied == (*SIX, "integrator") and study.whole == 2**6
    assert len(study.points) == 7
    assert only(study, "N733").data["all"] == 2**6
    assert not any(p.message for p in study.points)
    assert all(set(p.choices) == set(SIX) for p in study.points)
