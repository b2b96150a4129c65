"""What the meshes of models leave open."""

from __future__ import annotations

import json
from dataclasses import replace
from math import log, pi
from pathlib import Path
from typing import Any

import pytest

import sidtool
from sidtool.accuracy import mesh_choice, reference_run
from sidtool.accuracy.mesh_choice import RefinedBodies, refine_bodies
from sidtool.accuracy.reference_run import Reference
from sidtool.formats.scene import SceneFile
from sidtool.measurement import cache
from sidtool.measurement.request import requested
from sidtool.pipeline.model_cache import Refinement
from sidtool.pipeline.scene_models import body_models
from sidtool.solver import compile_scene
from sidtool.study import Setting, run_study
from tests.codes import codes, only, with_code

from ..beams import beam_data
from .arms import refined

#: A block of one metre in height.
SIDE, THICKNESS, MODULUS, FORCE = 1.0, 0.01, 1e9, 1e3


@pytest.fixture(autouse=True)
def _kept_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")
    monkeypatch.chdir(tmp_path)


def run_of(bodies: RefinedBodies, scene: sidtool.Scene) -> sidtool.Result:
    """The motion of a scene with the bodies of a search."""
    return sidtool.simulate(bodies.scene(scene), sids=bodies.sids({}), rtol=1e-8)


#: What each halving of the mesh adds to the displacement under the force: Flamant's is
#: 2 F / (pi E t) ln(1 / r) at the distance r of a force on an edge.
ADDS = 2.0 * FORCE * log(2.0) / (pi * MODULUS * THICKNESS)


def pulled(cells: int, length: int = 1) -> sidtool.Scene:
    """A block, clamped at its left edge, pulled at one point of its right edge."""
    data = beam_data({"type": "q4", "elements": [cells * length, cells]})
    corners = [[[x, -SIDE / 2], [x, SIDE / 2]] for x in (0.0, length * SIDE)]
    data["geometry"] |= {"control_points": corners, "thickness": THICKNESS}
    data["material"] |= {"youngs_modulus": MODULUS, "density": 1e3}
    Path("block.json").write_text(json.dumps(data), encoding="utf-8")
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 0.9, "end": 1.0}
    pull = {"type": "force", "marker": "block.tip", "force": [FORCE, 0.0]}
    markers = {"root": 1, "tip": 2}
    return sidtool.Scene(
        dimension="planar",
        time={"end": 1.0, "output_step": 0.05},
        bodies={"block": {"model": "block.json", "markers": markers}},
        joints={"clamp": {"type": "fixed", "markers": ["ground", "block.root"]}},
        forces={"pull": pull | {"function": ramp}},
        outputs={"record": ["block.tip.ux"]},
    )


def test_a_point_force_has_mesh_errors_that_do_not_decrease() -> None:
    """Half of the last change was reported, but the next halving changes as much."""
    result = pulled(2).simulate(accuracy={"block.tip.ux": "3e-4 m"})
    assert result.accuracy is not None
    (mesh,) = (line for line in result.accuracy.budget if line.part == "mesh")
    assert 2.5 * ADDS < mesh.errors["block.tip.ux"] < 3.5 * ADDS
    assert only(result, "N604").subject == "block"
    with pytest.raises(sidtool.InputError, match=r"N617.*N604") as refused:
        refined(pulled(2), {"block.tip.ux": "1e-4 m"})
    assert "tip of block" in (refused.value.expected or "")
    model = json.loads(Path("block.json").read_text(encoding="utf-8"))
    model["markers"]["tip"] |= {"tie": {"type": "distributing", "to": "right"}}
    for key in ("edge", "at"):
        model["markers"]["tip"].pop(key)
    scene = pulled(2)
    Path("block.json").write_text(json.dumps(model), encoding="utf-8")
    tied = refined(scene, {"block.tip.ux": "1e-4 m"})
    assert tied.errors.max() < 1e-4 and not with_code(tied, "N604")


def test_a_study_reports_mesh_errors_that_do_not_decrease() -> None:
    axes = {"mesh": (-1, 0, 1), "reduction": ("attachment",)}
    scene, setting = pulled(4, 20), Setting("radau9", rtol=1e-4)
    models = {"block": [Path("block.json")]}
    reference = run_study(scene, axes, models=models, settings=(setting,)).reference
    (open_,) = reference.floors * reference.scale
    assert 2.5 * ADDS < open_ < 3.5 * ADDS


def test_an_output_that_modes_alone_do_not_move_is_judged() -> None:
    """The first mode bends; along the block nothing moves without a static answer."""
    scene = pulled(1, 20)
    result = run_of(refined(scene, {"block.tip.ux": 0.2}), scene)
    stretched = 20.0 * FORCE / (MODULUS * THICKNESS * SIDE)
    assert result["block.tip.ux"][-1] == pytest.approx(stretched, rel=0.2)


def bar(frame: dict[str, Any], modes: int = 2, elements: int = 4) -> None:
    """Writes the model of a square bar of steel of half a metre on the x axis."""
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "density": 8e3},
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [0.5, 0.0, 0.0],
            "section": {"shape": "rectangle", "height": 0.01, "width": 0.01},
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": frame,
        "markers": {
            "a": {"node": 1, "parameters": [0.0]},
            "b": {"node": 2, "parameters": [1.0]},
        },
        "reduction": {"method": "modal", "modes": modes},
    }
    Path("link.json").write_text(json.dumps(data), encoding="utf-8")


def with_bar(**content: Any) -> sidtool.Scene:
    return sidtool.Scene(
        dimension="planar",
        time={"end": 1.0, "output_step": 0.1},
        bodies={"link": {"model": "link.json", "markers": {"a": 1, "b": 2}}},
        **content,
    )


def test_a_link_between_two_pins_stretches_by_static_shape_functions() -> None:
    """Its chord holds no pin: the second one moves along it. Of modes alone the force
    would need more than there can be: stretched by F L / EA."""
    bar({"type": "chord", "markers": ["a", "b"]})
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 0.9, "end": 1.0}
    pins = {
        "pin": {"type": "revolute", "markers": ["ground", "link.a"]},
        "guide": {"type": "point_on_line", "markers": ["ground", "link.b"]},
    }
    pull = {"type": "force", "marker": "link.b", "force": [1e4, 0.0], "function": ramp}
    scene = with_bar(
        joints=pins, forces={"pull": pull}, outputs={"record": ["link.b.ux"]}
    )
    result = run_of(refined(scene, 1e-5), scene)
    stretched = 1e4 * 0.5 / (2e11 * 0.01 * 0.01)
    assert result["link.b.ux"][-1] == pytest.approx(stretched, rel=1e-5)


def test_elastic_coordinates_are_judged_where_another_mesh_has_them_too() -> None:
    """A square bar bends in any direction of each frequency: two shape functions of it
    turn with the mesh, and what is not there after another does not count."""
    bar({"type": "tangent", "marker": "a", "clamp": "start"}, 4)
    ramp = {"type": "sine_ramp", "of": "rate", "from": 0.0, "to": 0.8, "end": 3.0}
    scene = with_bar(
        joints={"hub": {"type": "revolute", "markers": ["ground", "link.a"]}},
        drives={"spin": {"joint": "hub", "function": ramp}},
        outputs={"record": ["link.q*", "link.b.uy"]},
    )
    found = refined(scene, 1e-2)
    assert any("link.q1" in each.subject for each in with_code(found, "N615"))


def test_a_model_of_many_modes_is_compared_with_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """60 modes were compared with the 48 that the search makes at most."""
    monkeypatch.setattr(mesh_choice, "MAX_MODES", 1)
    scene = pulled(1, 20).with_({"outputs.record": ["block.tip.uy", "block.tip.ux"]})
    modes = only(refined(scene, {"block.tip.ux": 0.2}), "N613")
    assert (modes.data["first"], modes.data["last"]) == (1, 2)


@pytest.mark.parametrize("method", ["modal", "craig_bampton"])
def test_a_coarse_mesh_is_compared_with_all_modes_that_it_has(method: str) -> None:
    """One clamped element has 6, two with fixed ends too: 8 modes of 6 were refused."""
    elements = 1 if method == "modal" else 2
    bar({"type": "tangent", "marker": "a", "clamp": "start"}, 4, elements)
    if method != "modal":
        model = json.loads(Path("link.json").read_text(encoding="utf-8"))
        model["reduction"] = {"method": method, "interfaces": ["b"], "modes": 4}
        Path("link.json").write_text(json.dumps(model), encoding="utf-8")
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 0.9, "end": 1.0}
    pull = {"type": "force", "marker": "link.b", "force": [0, 1.0], "function": ramp}
    scene = with_bar(
        joints={"clamp": {"type": "fixed", "markers": ["ground", "link.a"]}},
        forces={"pull": pull},
        outputs={"record": ["link.b.uy"]},
    )
    found = refined(scene, 1e-2)
    deflection = 0.5**3 / (3.0 * 2e11 * 0.01**4 / 12.0)
    uy = run_of(found, scene)["link.b.uy"]
    assert uy[-1] == pytest.approx(deflection, rel=1e-2)
    modes = only(found, "N613")
    assert (modes.data["first"], modes.data["last"]) == (4, 6)


#: Codes of models of a size or of a material that looks like other units.
UNUSUAL_SIZE = ("N101", "N103")


def test_the_choice_does_not_depend_on_the_size_of_a_scene() -> None:
    """Lengths and E times 1000, times the root of it (Froude's similarity)."""
    found = []
    for size in (1.0, 1000.0):
        bar({"type": "tangent", "marker": "a"}, elements=2)
        model = json.loads(Path("link.json").read_text(encoding="utf-8"))
        model["material"]["youngs_modulus"] *= size
        model["geometry"]["end"][0] *= size
        for key in ("height", "width"):
            model["geometry"]["section"][key] *= size
        Path("link.json").write_text(json.dumps(model), encoding="utf-8")
        scene = with_bar(
            gravity=[0.0, -9.81],
            joints={"pin": {"type": "revolute", "markers": ["ground", "link.a"]}},
            outputs={"record": ["link.b.x"]},
        )
        times = {"end": 0.1 * size**0.5, "output_step": 0.01 * size**0.5}
        scene = scene.with_({f"time.{key}": value for key, value in times.items()})
        run = scene.simulate(accuracy={"link.b.x": f"{1e-5 * size} m"})
        report = run.accuracy
        assert report is not None
        choice = [(d.body, d.what, d.number, d.kept) for d in report.decisions]
        known = [code for code in codes(run) if code not in UNUSUAL_SIZE]
        found.append(((choice, known), run["link.b.x"] / size))
    (small, motion), (large, larger) = found
    assert large == small
    assert larger == pytest.approx(motion, abs=2e-6)


def test_loads_that_begin_at_once_are_named_where_modes_have_no_end() -> None:
    """A bar on two pins that gravity takes from rest: the force in a pin jumps, and no
    number of modes has the jump."""
    bar({"type": "chord", "markers": ["a", "b"]})
    pins = {
        "pin": {"type": "revolute", "markers": ["ground", "link.a"]},
        "guide": {"type": "point_on_line", "markers": ["ground", "link.b"]},
    }
    record = {"record": ["pin.fy"]}
    scene = with_bar(joints=pins, gravity=[0.0, -9.81], outputs=record)
    short = scene.with_({"time.end": 0.01, "time.output_step": 2e-5})
    with pytest.raises(sidtool.InputError, match="loads that do not begin at once"):
        refined(short, 1e-4)


def test_bodies_are_simulated_once_while_they_are_refined() -> None:
    """A change was between two runs, of which the search had made the first before."""
    scene = pulled(2)
    models = body_models(scene, Path())
    sids = {"block": models["block"].sid(Refinement()).sid}
    sizes: list[int] = []

    def compiled(content: SceneFile, found: Any) -> Any:
        if content.time.end == scene.time.end:
            sizes.append(found["block"].nq)
        return compile_scene(content, ".", found)

    request = requested(scene, sids, {"block.tip.ux": "1e-3 m"})
    found = refine_bodies(scene, sids, models, request, compiled)
    mine = found.refinements["block"]
    assert (mine.level, mine.modes, len(mine.static)) == (1, 2, 2)
    # as it is, with static shapes, two modes, a finer mesh, and with stiffening
    assert len(sizes) == 5


def link(length: float, height: float, width: float, name: str) -> None:
    """A steel beam of eight elements and three modes, clamped to its frame."""
    section = {"shape": "rectangle", "height": height, "width": width}
    ends = {"start": [0.0, 0.0, 0.0], "end": [length, 0.0, 0.0]}
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": 2.1e11,
            "poissons_ratio": 0.3,
            "density": 7850.0,
        },
        "geometry": {"type": "beam", **ends, "section": section},
        "discretisation": {"type": "beam", "elements": 8},
        "frame": {"type": "tangent", "marker": "a", "clamp": "start"},
        "markers": {
            "a": {"node": 1, "parameters": [0.0]},
            "b": {"node": 2, "parameters": [1.0]},
        },
        "reduction": {"method": "modal", "modes": 3},
        "damping": {"type": "rayleigh", "beta": 1e-5},
    }
    Path(name).write_text(json.dumps(data), encoding="utf-8")


def test_changes_by_steps_are_not_taken_for_those_by_meshes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """More modes may need shorter steps than those that the first reference took: the
    torque changed by 0.01 N m from mesh to mesh, where it changes by 1e-5, and halvings
    that hardly helped refused a request. Here the first steps are far too long.
    """
    link(0.6, 0.012, 0.03, "link.json")
    turn = {"type": "smooth_step", "from": 0.02, "to": 0.2, "end": 0.3}
    arm = with_bar(
        gravity=[0.0, -9.81],
        initial={"state": "static"},
        joints={"hub": {"type": "revolute", "markers": ["ground", "link.a"]}},
        drives={"motor": {"joint": "hub", "function": turn}},
        outputs={"record": ["link.b.y", "motor.mz"]},
    ).with_({"time.end": 0.3, "time.output_step": 0.005})
    loose = [Setting("radau5", 1e-1)]

    def make_reference(*given: Any) -> Reference:
        found = reference_run.make_reference(*given)
        return replace(found, setting=loose.pop() if loose else found.setting)

    monkeypatch.setattr(mesh_choice, "make_reference", make_reference)
    result = refined(arm, {"link.b.y": "1e-5 m", "motor.mz": "0.1 %"})
    assert not loose and not with_code(result, "N604")
    assert only(result, "N612").data["halvings"] == 1


def blade(name: str, elements: int, **reduction: Any) -> sidtool.Scene:
    """A slender steel blade on a hub that a torque spins up to 16 rad/s."""
    link(1.2, 0.006, 0.04, name)
    data = json.loads(Path(name).read_text(encoding="utf-8"))
    data |= {"reduction": reduction, "stiffening": {}}
    data["discretisation"]["elements"] = elements
    Path(name).write_text(
        json.dumps({k: data[k] for k in data if k != "damping"}), encoding="utf-8"
    )
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 1.0, "end": 1.0}
    motor = {"type": "force", "marker": "hub", "torque": 12.0, "function": ramp}
    return sidtool.Scene(
        dimension="planar",
        time={"end": 1.2, "output_step": 0.05},
        bodies={
            "hub": {"mass": 2.0, "inertia": 0.02},
            "blade": {"model": name, "markers": {"root": 1}},
        },
        joints={
            "axle": {"type": "revolute", "markers": ["ground", "hub"]},
            "clamp": {"type": "fixed", "markers": ["hub", "blade.root"]},
        },
        forces={"motor": motor},
        outputs={"record": ["axle.angle"]},
    )


def test_how_far_its_own_rotation_stretches_a_body_is_judged() -> None:
    """The stretch is rho w^2 L^3 / 3 E = 5.7e-6 m at the tip; the lowest mode that has
    it is the twelfth or so in frequency, and modes before it change nothing. The
    reference has the static answers to a pull at the tip, to uniform accelerations and
    to the centrifugal load, without which it is off by 7e-7 rad."""
    static = {"interfaces": ["b"], "modes": 6, "centrifugal": True}
    fine = blade("fine.json", 128, method="attachment", **static)
    true = fine.simulate(rtol=1e-9)["axle.angle"]
    coarse = blade("blade.json", 8, method="modal", modes=2)
    result = coarse.simulate(accuracy={"axle.angle": "1e-5 rad"})
    estimate = result.accuracy.absolute()["axle.angle"]
    assert abs(result["axle.angle"] - true).max() < estimate <= 1e-5
    decisions = result.accuracy.decisions
    (static,) = (d for d in decisions if d.what == "static shape functions")
    assert static.kept and (static.unit, static.output) == ("rad", "axle.angle")


def test_elastic_coordinates_of_a_coupler_are_judged() -> None:
    """Both of its ends turn as far: rounding told the signs of its shape functions,
    which changed from mesh to mesh, by twice the amplitude."""
    link(0.5, 0.004, 0.02, "link.json")
    data = json.loads(Path("link.json").read_text(encoding="utf-8"))
    data["frame"] = {"type": "chord", "markers": ["a", "b"]}
    Path("link.json").write_text(json.dumps(data), encoding="utf-8")
    crank = {"mass": 1.0, "inertia": 0.01, "markers": {"top": {"position": [0.0, 0.1]}}}
    rocker = {
        "mass": 1.0,
        "inertia": 0.01,
        "markers": {"top": {"position": [0.0, 0.25]}},
        "initial": {"position": [0.5, -0.15]},
    }
    pairs = {
        "crank_pin": ["ground", "crank"],
        "first": ["crank.top", "link.a"],
        "second": ["link.b", "rocker.top"],
        "rocker_pin": ["rocker", "ground.foot"],
    }
    speed = {"type": "sine_ramp", "of": "rate", "from": 0.0, "to": 0.3, "end": 6.0}
    scene = sidtool.Scene(
        dimension="planar",
        time={"end": 0.6, "output_step": 0.01},
        ground={"markers": {"foot": {"position": [0.5, -0.15]}}},
        bodies={
            "crank": crank,
            "rocker": rocker,
            "link": {
                "model": "link.json",
                "markers": {"a": 1, "b": 2},
                "initial": {"position": [0.0, 0.1]},
            },
        },
        joints={n: {"type": "revolute", "markers": m} for n, m in pairs.items()},
        drives={"turn": {"joint": "crank_pin", "function": speed}},
        outputs={"record": ["link.q1"]},
    )
    result = refined(scene, {"link.q1": 1e-2})
    assert only(result, "N612").data["halvings"] == 1
