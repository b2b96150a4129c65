"""Content of `info` and reports on a scene: degrees of freedom, mass, forces."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.diagnostics.record import plain_text
from sidtool.formats.result import Event, Result
from sidtool.report.input_files import describe_scene
from sidtool.report.result import describe_result, event_rows
from sidtool.solver import compile_scene, describe

COUNTED = re.compile(
    r"degrees of freedom: (-?\d+), of (\d+) velocity coordinates \((\d+) elastic\), "
    r"(\d+) constraints and (\d+) redundancies"
)


def bar(x: float, y: float, turned: bool, spatial: bool) -> dict[str, Any]:
    ends = {"a": [-0.5, 0.0], "b": [0.5, 0.0]}
    angle = math.pi / 2 if turned else 0.0
    if not spatial:
        place: dict[str, Any] = {"position": [x, y], "angle": angle}
        markers = {n: {"position": p} for n, p in ends.items()}
        return {"mass": 1.5, "inertia": 1.0, "markers": markers, "initial": place}
    place = {"position": [x, y, 0.0], "axis_angle": [0.0, 0.0, angle]}
    markers = {n: {"position": [*p, 0.0]} for n, p in ends.items()}
    return {"mass": 1.5, "inertia": [1.0] * 3, "markers": markers, "initial": place}


def four_bar(spatial: bool, drives: dict[str, Any]) -> sidtool.Scene:
    """A square of three bars with four hinges: one degree of freedom; in space three
    constraints too many."""
    far = [1.0, 0.0, 0.0] if spatial else [1.0, 0.0]
    ends = {"o": ["ground", "l.a"], "p": ["l.b", "t.a"]}
    ends |= {"q": ["t.b", "r.b"], "s": ["r.a", "ground.far"]}
    return sidtool.Scene.checked(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial" if spatial else "planar",
            "time": {"end": 1.0},
            "ground": {"markers": {"far": {"position": far}}},
            "bodies": {
                "l": bar(0.0, 0.5, True, spatial),
                "t": bar(0.5, 1.0, False, spatial),
                "r": bar(1.0, 0.5, True, spatial),
            },
            "joints": {n: {"type": "revolute", "markers": m} for n, m in ends.items()},
            "drives": drives,
        },
        "test",
    )


def test_functions_have_the_names_of_their_keys() -> None:
    turn = {"type": "smooth_step", "from": 0.1, "to": 0.4, "end": 2.0}
    scene = four_bar(False, {"motor": {"joint": "p", "function": turn}})
    assert "smooth_step (from 0.1, to 0.4, end 2)" in describe_scene(scene)


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("driven", [False, True])
def test_degrees_of_freedom_are_counted(spatial: bool, driven: bool) -> None:
    """Gruebler's count less the redundancies; a drive of an inner hinge takes one."""
    push = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0, 0.1]}]}
    drives = {"motor": {"joint": "p", "function": push}} if driven else {}
    lines = describe(compile_scene(four_bar(spatial, drives)))
    found = next(filter(None, map(COUNTED.fullmatch, lines)))
    freedom, free, elastic, constraints, redundant = map(int, found.groups())
    assert freedom == (0 if driven else 1) and elastic == 0
    assert free == (18 if spatial else 9)
    assert redundant == (3 if spatial else 0)
    assert constraints == free - freedom + redundant
    assert "total mass: 4.5 kg" in lines


def test_parameters_of_forces_and_bodies_are_listed() -> None:
    scene = four_bar(False, {}).with_(
        {
            "forces.spring": {
                "type": "spring_damper",
                "joint": "o",
                "stiffness": 1234.0,
                "damping": 5.5,
                "rest": 0.25,
            },
            "forces.control": {
                "type": "actuator",
                "joint": "o",
                "function": {"type": "pid", "measured": "o.angle", "p": 77.0, "d": 8.0},
            },
        }
    )
    text = describe_scene(scene)
    for number in (
        "stiffness 1234",
        "damping 5.5",
        "rest 0.25",
        "p 77",
        "d 8",
        "1.5 kg",
    ):
        assert number in text, number


def test_knots_of_a_function_are_one_row() -> None:
    import numpy as np

    none = np.zeros(0)
    knots = [Event("cam", "break", 0.1 * k, none, none, none) for k in range(1, 200)]
    passing = Event("dead_centre", "rising", 0.35, none, none, none)
    rows = event_rows([*knots, passing])
    assert rows == [
        ("dead_centre", "rising", "0.35"),
        ("cam", "199 breaks", "0.1 to 19.9"),
    ]


def test_a_large_scene_and_a_long_result_fit_on_a_screen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """45 lines, with fewer rows in each table; `-v` has all. A robot had 54 lines."""
    names = [f"bar{k}" for k in range(12)]
    scene = four_bar(True, {}).with_(
        {
            "bodies": {name: bar(0.0, 0.0, False, True) for name in names},
            "joints": {
                f"pin_of_{name}": {
                    "type": "spherical",
                    "markers": ["ground", f"{name}.a"],
                }
                for name in names
            },
            "forces": {
                f"pull_of_{name}": {
                    "type": "force",
                    "marker": f"{name}.b",
                    "force": [1, 0, 0],
                }
                for name in names
            },
            "events": {f"stop_of_{name}": {"quantity": f"{name}.x"} for name in names},
            "outputs.record": [f"{name}.*" for name in names],
        }
    )
    scene.save(tmp_path / "scene.toml")
    for options, fits in (([], True), (["-v"], False)):
        assert run(["info", str(tmp_path / "scene.toml"), *options]) == 0
        text = capsys.readouterr().out
        assert (len(text.splitlines()) <= 45) == fits
        assert ("stop_of_bar11" in text) != fits
        assert "total mass: 18 kg" in text
    none = np.zeros(0)
    result = Result(
        title="Long",
        t=np.linspace(0.0, 1.0, 3),
        names=tuple(f"{name}.x" for name in names),
        values=np.ones((3, 12)),
        positions=np.zeros((3, 0)),
        velocities=np.zeros((3, 0)),
        multipliers=np.zeros((3, 0)),
        events=tuple(
            Event(f"e{k}", "rising", 0.1, none, none, none) for k in range(30)
        ),
        diagnostics=tuple(plain_text(f"fact {k}") for k in range(30)),
    )
    assert len(describe_result(result).splitlines()) <= 45
    assert "fact 29" in describe_result(result, verbose=True)
