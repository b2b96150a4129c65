"""Forces that act in joints, as pictures show them."""

from __future__ import annotations

from typing import Any

import pytest
from numpy.testing import assert_array_equal

from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.view.links import scene_links

SPRING = {"type": "spring_damper", "stiffness": 10.0}
DAMPER = {"type": "spring_damper", "damping": 1.0}
ACTUATOR = {"type": "actuator", "function": {"type": "constant", "value": 1.0}}


@pytest.mark.parametrize(
    ("force", "kind"), [(SPRING, "spring"), (DAMPER, "damper"), (ACTUATOR, "actuator")]
)
@pytest.mark.parametrize("joint", ["prismatic", "cylindrical", "revolute"])
def test_forces_on_displacements_join_the_markers_of_the_joint(
    force: dict[str, Any], kind: str, joint: str
) -> None:
    inertia = [0.1, 0.1, 0.1]
    body = {
        "mass": 1.0,
        "inertia": inertia,
        "markers": {"p": {"position": [0.5, 0, 0]}},
    }
    acting = force | {"joint": "guide"}
    if joint == "cylindrical":
        acting["coordinate"] = "displacement"
    scene = SceneFile.checked(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "time": {"end": 1.0, "output_step": 1.0},
            "ground": {"markers": {"w": {"position": [0.0, 2.0, 0.0]}}},
            "bodies": {"a": body},
            "joints": {"guide": {"type": joint, "markers": ["ground.w", "a.p"]}},
            "forces": {"f": acting},
        },
        "test",
    )
    links = scene_links(compile_scene(scene), 1.0)
    if joint == "revolute":  # an angle has no line
        assert not links
        return
    (link,) = links
    assert (link.name, link.kind) == ("f", kind)
    assert [end.body for end in link.ends] == ["", "a"]
    assert_array_equal(link.ends[0].position, [0.0, 2.0, 0.0])
    assert_array_equal(link.ends[1].position, [0.5, 0.0, 0.0])
