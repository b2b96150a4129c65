"""`sidtool study --over`: models, meshes, modes, frames and terms side by side."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import sidtool
from sidtool.cli import run
from sidtool.convert import sid_from_model
from sidtool.formats.model import ModelFile
from sidtool.formats.model.refine import refined
from sidtool.formats.scene import SceneFile
from sidtool.plot.precision import draw_front
from sidtool.solver import compile_scene, simulate
from sidtool.study import Ended, Point, Setting, front, study
from sidtool.study import whole as whole_module

from .accuracy.arms import cantilever, spun, swinging
from .beams import beam, beam_data

IGA = {"type": "iga", "degrees": [3, 2], "elements": [8, 1]}
Q4 = {"type": "q4", "elements": [20, 2], "formulation": "incompatible_modes"}
ONE = (Setting("radau9", rtol=1e-6),)


@pytest.fixture
def models(tmp_path: Path) -> list[Path]:
    """A unit cantilever as Q4 and as IGA, with two modes."""
    found = []
    for name, mesh in (("q4", Q4), ("iga", IGA)):
        data = beam_data(mesh, reduction={"method": "modal", "modes": 2})
        found.append(tmp_path / f"{name}.json")
        found[-1].write_text(json.dumps(data))
    return found


def test_errors_are_those_of_runs_by_hand(models: list[Path]) -> None:
    """Against dop853 on the finest mesh with most modes, all made without the study."""
    scene = swinging(0.4)
    found = study(
        scene,
        {"mesh": (-1, 0), "modes": (1, 3)},
        models={"arm": models[:1]},
        settings=ONE,
    )
    assert found.varied == ("mesh", "modes") and len(found.points) == 4
    names, recorded = found.reference.names, scene.outputs.record
    assert names
    richest = by_hand(scene, 0, 3, integrator="dop853", rtol=1e-11)
    scale = np.ptp(richest, axis=0)
    for point in found.points:
        level, modes = (int(point.choices[axis]) for axis in found.varied)
        values = by_hand(scene, level, modes, integrator="dop853", rtol=1e-11)
        errors = np.abs(values - richest).max(axis=0) / scale
        assert tuple(point.errors) == names
        for name in names:
            error = errors[recorded.index(name)]
            assert point.errors[name] == pytest.approx(error, rel=0.05, abs=1e-6)
        assert point.error >= max(point.errors.values())
        assert point.size == modes
    assert {p.dofs for p in found.points} == {2 * 11 * 2, 2 * 21 * 3}


def by_hand(scene: Any, level: int, modes: int, **how: Any) -> np.ndarray:
    model = beam(Q4, reduction={"method": "modal", "modes": modes})
    finer = refined(model, level)
    assert finer is not None
    system = compile_scene(scene, Path("."), {"arm": sid_from_model(finer, str)})
    return np.asarray(simulate(system, **how).values)


def test_no_modes_are_a_rigid_body(models: list[Path]) -> None:
    """Of a model with modes alone the physical pendulum stays; interfaces deform."""
    scene = swinging(0.4)
    found = study(scene, {"modes": (0, 2)}, models={"arm": models[:1]}, settings=ONE)
    rigid = next(p for p in found.points if p.choices["modes"] == "0")
    assert rigid.size == 0
    richest = by_hand(scene, 0, 2, integrator="dop853", rtol=1e-11)
    turn = turned(np.linspace(0.0, 0.4, len(richest)))
    for k, places in enumerate((np.cos(turn), np.sin(turn))):
        error = np.abs(places - richest[:, k]).max() / np.ptp(richest[:, k])
        told = rigid.errors[scene.outputs.record[k]]
        assert told == pytest.approx(error, rel=1e-3, abs=1e-6)
    axes = {"modes": (0, 2), "reduction": ("craig_bampton",)}
    tied = study(scene, axes, models={"arm": models[:1]}, settings=ONE)
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
    found = study(
        swinging(0.4), {"mesh": (-1, 0)}, models={"arm": models}, settings=ONE
    )
    assert {p.choices["model"] for p in found.points} == {"q4", "iga"}
    assert "iga" in found.reference.model
    worst = {p.choices["model"]: p.error for p in found.points}
    assert worst["q4"] > worst["iga"]
    assert all(p.conversion > 0.0 for p in found.points)


def test_finished_points_are_not_computed_again(
    models: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an end in the middle only the rest is run, and a wider study adds to it."""
    calls: list[Any] = []
    original = whole_module.run

    def counted(task: Any) -> Any:
        calls.append(task)
        return original(task)

    monkeypatch.setattr(whole_module, "run", counted)
    keep, given = tmp_path / "points", {"arm": models[1:]}
    again: dict[str, Any] = {"models": given, "settings": ONE, "keep": keep}

    def stop() -> str:
        return "enough" if len(calls) == 5 else ""

    axes = {"modes": (1, 2, 3, 4)}
    with pytest.raises(Ended, match="enough"):
        study(swinging(0.4), axes, stop=stop, **again)
    assert len(calls) == 5
    first = study(swinging(0.4), axes, **again)
    assert len(calls) == 3 + 4
    monkeypatch.setattr(whole_module, "convert", lambda _: pytest.fail("converted"))
    second = study(swinging(0.4), axes, **again)
    assert len(calls) == 3 + 4
    assert [p.error for p in second.points] == [p.error for p in first.points]
    assert [p.seconds for p in second.points] == [p.seconds for p in first.points]
    assert second.points[0].conversion == first.points[0].conversion > 0.0
    study(swinging(0.41), axes | {"modes": (1,)}, **again)
    assert len(calls) > 7


def test_all_frames_tell_the_same_motion() -> None:
    """Small deformations: where the frame sits changes them in second order only."""
    scene = swinging(0.4, outputs={"record": ["arm.tip.y", "arm.tip.uy", "arm.y"]})
    found = study(scene, {"frame": ()}, sids={"arm": cantilever(3)}, settings=ONE)
    assert found.reference.names == ("arm.tip.y",)
    assert set(found.dropped) == {"arm.tip.uy", "arm.y"}
    assert {p.choices["frame"] for p in found.points} > {"chord", "buckens"}
    assert all(p.error < 1e-3 for p in found.points)


def test_damping_laws_hold_in_the_frame_of_the_sid() -> None:
    """Evaluated in each frame they were others, which changed a force by 40 %."""
    arm = {"sid": "arm", "markers": {"root": 1, "tip": 2}}
    arm["damping"] = {"type": "rayleigh", "alpha": 20.0, "beta": 0.0}
    scene = swinging(
        0.4, bodies={"arm": arm}, outputs={"record": ["pin.fx", "pin.fy", "arm.tip.y"]}
    )
    found = study(
        scene,
        {"frame": ("tangent", "buckens")},
        sids={"arm": cantilever(3)},
        settings=ONE,
    )
    assert max(p.error for p in found.points) < 2e-3


def test_what_the_last_modes_change_is_not_called_converged() -> None:
    """The third elastic coordinate is there in the richest variant alone."""
    scene = swinging(0.4, outputs={"record": ["arm.q*", "arm.tip.x"]})
    found = study(
        scene, {"modes": (0, 1, 3)}, sids={"arm": cantilever(3)}, settings=ONE
    )
    assert found.reference.unconverged["arm.q3"] == pytest.approx(1.0, abs=0.1)
    rigid, one, whole = sorted(found.points, key=lambda p: p.size)
    assert (rigid.size, one.size, whole.size) == (0, 1, 3)
    assert rigid.error > one.error >= whole.error == found.reference.uncertainty
    assert not whole.told


def test_what_keeps_a_reference_from_being_sharp_is_told_with_what_helps() -> None:
    """The tip bends by what the modes make of it, and is carried round by the drive."""
    scene, sids = spun(0.5, 4.0), {"arm": cantilever(3)}
    found = study(scene, {"modes": (1, 2)}, sids=sids, settings=ONE)
    assert found.reference.uncertainty > 2e-3
    told = found.report()
    assert "That is due to arm.tip.uy (3e-03); more modes would tell more." in told
    assert "The others are known to 3e-05: --of arm.tip.x compares" in told
    more = study(scene, {"modes": (1, 2, 3)}, sids=sids, settings=ONE)
    alone = study(
        scene, {"modes": (1, 2)}, outputs=["arm.tip.x"], sids=sids, settings=ONE
    )
    for better in (more, alone):
        assert better.reference.uncertainty < 2e-4
        assert "That is due to" not in better.report()


@pytest.mark.parametrize("pairs", [[(1.0, 0.1)], [(1.0, 0.1), (2.0, 0.3)]])
def test_a_front_of_one_point_is_drawn(pairs: list[tuple[float, float]]) -> None:
    figure = Figure()
    panel = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    panel.set(xlim=(0.0, 3.0), ylim=(0.0, 1.0))
    draw_front(panel, pairs)
    panel.axis("off")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert (np.asarray(canvas.buffer_rgba())[..., :3] < 128).any()


def test_a_spin_needs_its_geometric_stiffening() -> None:
    """Ten times the first frequency: without it the tip leaves (diverges or errs)."""
    scene = spun(2.5, 12.0, outputs={"record": ["arm.tip.x", "arm.tip.y", "hub.mz"]})
    found = study(
        scene,
        {"terms": ()},
        sids={"arm": cantilever(2, stiffened=True)},
        settings=ONE,
    )
    errors = {p.choices["terms"]: p.error for p in found.points}
    assert errors["none"] > 10.0 * errors["stiffening"]
    assert errors["all"] < 1e-4


def test_nothing_dominates_the_front() -> None:
    pairs = [(3.0, 1e-3), (1.0, 1e-2), (2.0, 5e-2), (4.0, 1e-6), (4.0, 1e-5)]
    points = [Point(Setting("radau9", 1e-6), e, s, 1) for s, e in pairs]
    best = front(points, lambda p: p.seconds)
    assert [(p.seconds, p.error) for p in best] == [
        (1.0, 1e-2),
        (3.0, 1e-3),
        (4.0, 1e-6),
    ]


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (spun(2.5, 4.0), "outside of"),
        (swinging(gravity=[0.0, -3.0]), "the scene as it is stopped"),
    ],
)
def test_what_is_outside_is_said_before_anything_is_compared(
    scene: SceneFile, message: str, models: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After one run of the scene, and one of its richest variant: no reference."""
    asked: list[Any] = []
    monkeypatch.setattr(
        whole_module, "best_reference", lambda *rest: asked.append(rest)
    )
    with pytest.raises(sidtool.InputError, match=message):
        study(
            scene,
            {"mesh": (-1, 0, 1), "modes": (1, 2)},
            models={"arm": models[:1]},
            settings=ONE,
        )
    assert not asked


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
        coarse = refined(beam(mesh), -1)
        assert coarse is not None
        assert getattr(coarse.discretisation, key) == expected


def written(folder: Path) -> Path:
    path = folder / "scene.json"
    content = swinging(0.3).model_dump(mode="json", by_alias=True, exclude_none=True)
    content["bodies"]["arm"] |= {"model": "iga.json"}
    del content["bodies"]["arm"]["sid"]
    path.write_text(json.dumps(content))
    return path


def test_the_command_draws_fronts_and_goes_on(
    models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In two processes; a scene whose body is its model."""
    path, out = written(tmp_path), tmp_path / "out"
    command = ["study", str(path), "--over", "modes=1:2:3,terms=none:quadratic"]
    command += ["--rtol", "1e-4", "--rtol", "1e-6", "-o", str(out), "--jobs"]
    assert run([*command, "2"]) == 0
    text = capsys.readouterr().out
    assert "Least error for the time" in text and "Least error for the size" in text
    with (out / "study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 12 and {row["modes"] for row in rows} == {"1", "2", "3"}
    points = sorted((out / "points").iterdir())
    assert run([*command, "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert sorted((out / "points").iterdir()) == points
    assert [p["error"] for p in told["points"]] == [float(r["error"]) for r in rows]
    assert "Pareto front" in (out / "study.svg").read_text()
    assert run(["plot", str(out / "study.json"), "-o", str(tmp_path / "a.png")]) == 0
    assert sidtool.read(out / "study.json").varied == ("modes", "terms", "integrator")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--over", "meshes"],
        ["--over", "modes=few"],
        ["--over", "frame=free"],
        ["--over", "modes", "--model", "leg=iga.json"],
        ["--over", "modes", "--model", "arm"],
        ["--over", "reduction,modes", "--of", "arm.q1"],
        ["--over", "modes", "--dask", "tcp://127.0.0.1:9"],
    ],
)
def test_wrong_wishes_are_refused(
    arguments: list[str],
    models: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path)
    assert run(["study", str(path), "--jobs", "1", *arguments]) == 2
    assert "expected" in capsys.readouterr().err


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    distributed = pytest.importorskip(
        "distributed", reason="dask and distributed are not installed"
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as made:
        yield made.scheduler_address


def test_a_cluster_of_two_workers_tells_the_same(
    cluster: str, models: list[Path], tmp_path: Path
) -> None:
    axes = {"modes": (1, 2)}
    given: dict[str, Any] = {"models": {"arm": models[1:]}, "settings": ONE}
    here = study(swinging(0.3), axes, **given)
    there = study(swinging(0.3), axes, dask=cluster, keep=tmp_path / "kept", **given)
    assert [p.choices for p in there.points] == [p.choices for p in here.points]
    for one, other in zip(here.points, there.points, strict=True):
        assert other.error == pytest.approx(one.error, rel=1e-6, abs=1e-9)
        assert other.steps == one.steps


def test_the_command_computes_on_the_cluster(
    cluster: str, models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is left to do for this process, which tells the same."""
    command = [
        "study",
        str(written(tmp_path)),
        "--over",
        "modes=1:2,terms=none:quadratic",
    ]
    command += ["--rtol", "1e-6", "--json", "-o", str(tmp_path / "out")]
    assert run([*command, "--dask", cluster]) == 0
    there = json.loads(capsys.readouterr().out)
    points = sorted((tmp_path / "out" / "points").iterdir())
    assert run([*command, "--jobs", "1"]) == 0
    here = json.loads(capsys.readouterr().out)
    assert sorted((tmp_path / "out" / "points").iterdir()) == points
    assert len(there["points"]) == 4
    assert [p["error"] for p in there["points"]] == [p["error"] for p in here["points"]]


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
    found = study(swinging(0.2), SIX, models=given, settings=settings, differ=1)
    assert found.varied == (*SIX, "integrator") and found.whole == 2**6
    assert len(found.points) == 7
    assert not any(p.message for p in found.points)
    assert all(set(p.choices) == set(SIX) for p in found.points)


def test_a_twisting_bar_is_studied_without_terms(tmp_path: Path) -> None:
    """Its rotary inertia turns with it; that is no geometric stiffening to take out."""
    path = tmp_path / "bar.json"
    path.write_text(json.dumps(bar()))
    scene = turning_bar()
    axes = {"reduction": ("craig_bampton",), "terms": ("none", "quadratic")}
    found = study(scene, axes, models={"bar": [path]}, settings=ONE)
    assert [p.message for p in found.points] == [""] * 2


def test_meshes_and_reductions_in_space(tmp_path: Path) -> None:
    """Against runs of the same models that are made by hand."""
    path = tmp_path / "bar.json"
    path.write_text(json.dumps(bar()))
    scene = turning_bar()
    axes = {"mesh": (-1, 0), "reduction": ("modal", "craig_bampton")}
    found = study(scene, axes, models={"bar": [path]}, settings=ONE, differ=2)
    assert not any(p.message for p in found.points)
    names = found.reference.names
    size = {(p.choices["mesh"], p.choices["reduction"]): p.size for p in found.points}
    assert size["0", "craig_bampton"] > size["0", "modal"] == size["-1", "modal"] == 4
    richest = bar_by_hand(scene, names, 8, "craig_bampton")
    scale = np.ptp(richest, axis=0)
    for point in found.points:
        elements = 8 if point.choices["mesh"] == "0" else 4
        values = bar_by_hand(scene, names, elements, point.choices["reduction"])
        expected = np.abs(values - richest).max(axis=0) / scale
        assert list(point.errors.values()) == pytest.approx(expected, abs=2e-5)


def bar(elements: int = 8, method: str = "modal") -> dict[str, Any]:
    """Bends in two directions and twists; clamped at its root."""
    reduction: dict[str, Any] = {"method": method, "modes": 4}
    if method != "modal":
        reduction["interfaces"] = ["tip"]
    return {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": 2e9,
            "poissons_ratio": 0.3,
            "density": 2000.0,
        },
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [0.5, 0.0, 0.0],
            "section": {"shape": "rectangle", "height": 0.02, "width": 0.01},
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0.0]},
            "tip": {"node": 2, "parameters": [1.0]},
        },
        "reduction": reduction,
        "damping": {"type": "rayleigh", "beta": 1e-4},
    }


def turning_bar() -> SceneFile:
    """On a hinge across both axes of bending, let go from level."""
    hinge = {"type": "revolute", "markers": ["ground", "bar.root"]}
    return SceneFile.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": [0.0, 0.0, -9.81],
            "time": {"end": 0.1, "output_step": 0.01},
            "bodies": {"bar": {"sid": "bar", "markers": {"root": 1, "tip": 2}}},
            "joints": {"hinge": hinge | {"axis": [0.0, 1.0, 0.3]}},
            "outputs": {"record": ["bar.tip.x", "bar.tip.y", "bar.tip.z"]},
        }
    )


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
    path.write_text(json.dumps(bar(method="craig_bampton")))
    axes = {"frame": ("tangent", "chord", "buckens")}
    found = study(turning_bar(), axes, models={"bar": [path]}, settings=ONE)
    assert [p.message for p in found.points] == [""] * 3
    assert len({p.size for p in found.points}) == 1
    assert max(p.error for p in found.points) < 1e-2
