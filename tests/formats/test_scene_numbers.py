"""Other numbers in a scene: as if the whole scene were read again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.toml.files import File

from ..sidtool.api.test_compiled import ARM

#: A pendulum beside the arm, with tables and lists in each other.
MORE = """
[ground.markers.base]
position = [0.0, 0.0, 0.5]

[bodies.swing]
mass = 1.0
inertia = [0.1, 0.1, 0.1]

[joints.hinge]
type = "revolute"
markers = ["ground.base", "swing"]
axis = [0.0, 1.0, 0.0]

[drives.turn]
joint = "hinge"
[drives.turn.function]
type = "polynomial"
pieces = [
    { from = 0.0, to = 0.04, start = [0, 0, 0], end = [1, 0, 0] },
    { from = 0.04, coefficients = [1.0] },
]

[forces.push]
type = "force"
marker = "load"
force = [1.0, 0.0, 0.0]
function = { type = "expression", value = "a*sin(t)", parameters = { a = 0.5 } }
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> sidtool.Scene:
    path = tmp_path_factory.mktemp("arm") / "arm.toml"
    path.write_text(ARM + MORE, encoding="utf-8")
    return sidtool.Scene.load(path)


@pytest.mark.parametrize(
    "changes",
    [
        {"arm.mass": 3},
        {"bodies.arm.mass": 3.5, "arm.centre_of_mass": (0.1, 0.0, 0.2)},
        {"time.end": 1.0, "time.output_step": 0.5, "accuracy.rtol": 1e-9},
        {"gravity": [0.0, 0.0, -1.6]},
        {"arm.markers.wrist.position[0]": 0.75},
        {"shoulder.friction.coefficient": 0.0},
        {"motor.function.reference": 0.3},
        {"parameters.reach": 0.7},
        {"load.initial.velocity": [0.0, 1.0, 0.0]},
        {"load.initial.position": ["2*reach", 0.0, 0.0]},
        {"title": "other"},
        {"load.initial.fixed": True},
        {"ground.markers.base.position": [0, 0, 1]},
        {"arm.initial.velocity": [0, 1, 0], "arm.initial.velocity[1]": 2},
        {"shoulder.axis[0]": 0.5, "spring.stiffness": 21},
        {"turn.function.pieces[0].to": 0.5, "turn.function.pieces[1].from": 0.5},
        {"turn.function.pieces[0].end[0]": 2, "push.function.parameters.a": 0.25},
        {"shoulder.friction.static": np.float64(0.3)},
    ],
)
def test_one_number_is_as_the_whole(
    scene: sidtool.Scene, changes: dict[str, Any]
) -> None:
    found, expected = scene.with_(changes), File.with_(scene, changes)
    assert found == expected and found.file_data() == expected.file_data()
    assert found.model_dump_json() == expected.model_dump_json()
    assert found.source == expected.source and type(found) is sidtool.Scene
    again = {"parameters.reach": 0.9}
    assert found.with_(again) == expected.with_(again)


def test_other_parts_stay_the_same_objects(scene: sidtool.Scene) -> None:
    found = scene.with_({"load.mass": 5.0})
    assert found.bodies["arm"] is scene.bodies["arm"]
    assert found.joints is scene.joints
    assert scene.bodies["load"].mass == 0.4
    found = scene.with_({"turn.function.pieces[0].end[0]": 1, "spring.stiffness": 7})
    assert found.bodies is scene.bodies and found.forces["push"] is scene.forces["push"]


@pytest.mark.parametrize(
    "changes",
    [
        {"arm.mass": -3.0},
        {"arm.mas": 3.0},
        {"nothing.mass": 3.0},
        {"arm": 3.0},
        {"arm.mass.x": 3.0},
        {"arm.markers.wrist.position[7]": 3.0},
        {"time.end": -1.0},
        {"gravity": 9.81},
        {"": 1.0},
        {"shoulder.axis": [0.0, 0.0, 0.0]},
        {"arm.mass": float("nan")},
        {"turn.function.pieces[0].to": 0.05},
        {"turn.function.pieces[2].from": 0.05},
        {"time.end": 0.02, "time.start": 0.03},
        {"arm.markers.elbow.position": [0.0, 0.0]},
        {"motor.function.i": 1.0, "outputs.record": ["motor.state.nothing"]},
        {"arm.inertia": [0.01, -0.09, 0.09], "load.initial.velocity": [1.0]},
        {"shoulder.friction.static": 0.1},
    ],
)
def test_errors_are_those_of_the_whole(
    scene: sidtool.Scene, changes: dict[str, Any]
) -> None:
    with pytest.raises(InputError) as found:
        scene.with_(changes)
    with pytest.raises(InputError) as expected:
        File.with_(scene, changes)
    assert str(found.value) == str(expected.value)
