"""Names with wildcards stand for the outputs that a scene has."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool import Scene
from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import expand_names, has_wildcard, known_outputs, read_scene
from sidtool.formats.sid_files import read_sid
from tests.places import SLIDER_CRANK


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("rod.q*", ["rod.q1", "rod.q2", "rod.q3", "rod.q4", "rod.q5"]),
        ("*k.ang*e", ["crank.angle"]),
        ("*_pin.angle", ["crank_pin.angle", "piston_pin.angle"]),
        ("*.pin.v*", ["crank.pin.vx", "crank.pin.vy"]),
        ("rod.*.ux", ["rod.crank_pin.ux", "rod.piston_pin.ux"]),
        ("slider.f*", [f"slider.{q}" for q in ("fx", "fy", "force", "f1")]),
        ("piston.x", ["piston.x"]),
        ("bearing.f*", [f"bearing.{q}" for q in ("fx", "fy", "f1", "f2")]),
        ("energy.e*", ["energy.elastic"]),
        ("cra*.v*_body", ["crank.vx_body", "crank.vy_body"]),
        ("piston.mom*", ["piston.momentum_x", "piston.momentum_y"]),
        ("rod.piston*.w*", ["rod.piston_pin.wz"]),
        ("piston.w*", ["piston.wz"]),
    ],
)
def test_patterns(pattern: str, names: list[str]) -> None:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    sids = {"rod": read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")}
    found = expand_names([pattern, pattern], scene, sids)
    assert list(found) == names


def test_nothing_found_is_told() -> None:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    with pytest.raises(InputError, match=r"called 'rot'; expected .*perhaps rod$"):
        expand_names(["rot.*"], scene, {})
    with pytest.raises(InputError, match=r"no output 'k\*'; expected one of x, y, vx"):
        expand_names(["pist*.k*"], scene, {})


def test_what_a_gear_has_is_found_and_told() -> None:
    """Its force is its multiplier; it was said that nothing has its name."""
    body = {"mass": 1.0, "inertia": 1.0}
    hinges = {f"h{b}": {"type": "revolute", "markers": ["ground", b]} for b in "ab"}
    gear = {"type": "gear", "joints": ["ha", "hb"], "ratio": 2.0}

    def found(name: str) -> tuple[str, ...]:
        scene = Scene(
            dimension="planar",
            time={"end": 1.0},
            bodies={"a": body, "b": body},
            joints={**hinges, "wheels": gear},
            outputs={"record": [name]},
        )
        return expand_names(scene.outputs.record, scene, {})

    assert found("wheels.*") == ("wheels.f1",)
    with pytest.raises(InputError, match=r"wheels has no 'q\*'; expected one of f1$"):
        found("wheels.q*")


def test_wildcards_find_what_the_whole_of_a_body_leaves_out() -> None:
    """Each name is one of the scene; those in body axes are zero in the plane."""
    scene = Scene(
        dimension="spatial",
        time={"end": 1.0, "output_step": 1.0},
        bodies={
            "top": {"mass": 1.0, "inertia": [1.0] * 3, "markers": {"tip": {}}},
            "bob": {"mass": 1.0},
        },
    )
    found = expand_names(["*.w*_body", "*.quaternion_0", "top.tip.rot*"], scene, {})
    assert found[:3] == ("top.wx_body", "top.wy_body", "top.wz_body")
    assert found[3:] == ("top.quaternion_0", *(f"top.tip.rotation_{i}" for i in "xyz"))
    assert not set(found) & set(expand_names(["top.*", "top.tip.*"], scene, {}))
    assert scene.with_({"outputs.record": list(found)}).outputs.record == found


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("slider.x", "the joint slider has no 'x'; expected one of displacement"),
        ("motor.angle", "the drive motor has no 'angle'; expected one of fx, fy, mz"),
        ("push.angle", "the force push has no 'angle'; expected one of fx, fy, mz"),
        ("push.torque", "the force push has no 'torque'; expected one of fx, fy, mz"),
        ("puss.fx", "no joint, drive or force 'puss'; expected .*perhaps push"),
    ],
)
def test_what_connections_have_is_told(name: str, match: str) -> None:
    scene = Scene(
        dimension="planar",
        time={"end": 1.0, "output_step": 1.0},
        bodies={"cart": {"mass": 1.0, "inertia": 1.0}},
        joints={"slider": {"type": "prismatic", "markers": ["ground", "cart"]}},
        drives={
            "motor": {"joint": "slider", "function": {"type": "constant", "value": 0}}
        },
        forces={
            "push": {
                "type": "spring_damper",
                "markers": ["ground", "cart"],
                "stiffness": 1.0,
            }
        },
    )
    with pytest.raises(InputError, match=match):
        scene.with_({"outputs.record": [name]})


def test_all_known_names_are_valid(tmp_path: Path) -> None:
    """Each is recorded by a scene file without complaint."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    names = list(
        known_outputs(scene, {"rod": read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")})
    )
    assert len(names) == len(set(names)) > 80
    assert not any(map(has_wildcard, names))
    listed = ", ".join(f'"{name}"' for name in names)
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    head = text[: text.index("[outputs]")]
    file = tmp_path / "all.toml"
    file.write_text(f"{head}[outputs]\nrecord = [{listed}]\n", encoding="utf-8")
    assert read_scene(file).outputs.record == tuple(names)
