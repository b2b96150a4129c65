"""Optional keys of scenes: each has a default that random scenes try.

The scenes of `test_scenes` are run with and without them, too.
"""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pydantic import BaseModel

from sidtool.formats.scene import SceneFile
from tests.metamorphic.generator.rubbing import rubbing_scene
from tests.metamorphic.ways.default_keys import DEFAULTS
from tests.metamorphic.ways.transformations import compared

#: Keys without a value that could be written in their place.
NOTHING = {
    "Actuator": {"markers", "joint"},
    "Bushing": {"shaft"},
    "Drive": {"joint", "marker", "axis"},
    "ElasticInitial": {"axis_angle", "quaternion"},
    "Expression": {"limits", "sample_time"},
    "Harmonic": {"frequency", "angular_frequency"},
    "Initial": {"axis_angle", "quaternion"},
    "JointFriction": {"stribeck_velocity", "radius", "length"},
    "Marker": {"axis_angle", "quaternion"},
    "Pid": {"filter", "limits", "sample_time"},
    "Piece": {"to", "coefficients", "start", "end"},
    "PointOnLine": {"friction"},
    "Prismatic": {"friction"},
    "Revolute": {"friction"},
    "RigidBody": {"inertia", "shape"},
    "SidBody": {"sid", "model"},
    "Spline": {"file", "time", "value", "times", "values"},
    "Start": {"file", "time", "bodies", "rotations", "sids", "states"},
    "SpringDamper": {"markers", "joint", "stiffness", "table"},
    "State": {"rate", "next"},
    "Time": {"output_step", "output_times"},
    "Accuracy": {"wanted", "step"},
}
#: Those that random scenes do not have, or that choose by more than a table says.
ELSEWHERE = {
    "Accuracy": {"rtol"},
    "Drive": {"start", "start_rate"},
    "Expression": {"terms"},
    "Outputs": {"record"},
    "SceneFile": {"outputs"},
    "Screw": {"axis", "second_axis", "offset"},
    "SidBody": {"quadratic_inertia"},
    "SineRamp": {"start", "of", "offset"},
    "State": {"initial"},
}
#: Classes that random scenes do not have, or that are seen in pictures only.
OTHERS = {"Event", "Given", "Input", "LookupTable", "Wanted", "RayleighDamping"}
OTHERS |= {"Box", "Cylinder", "Sphere", "SurfaceMesh"}
NAME = "optional keys left out"
RTOL = 1e-7


def classes(found: set[type[BaseModel]], annotation: Any) -> None:
    """Classes of all tables that an annotation names, and inside of them."""
    is_table = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    if is_table and annotation not in found:
        found.add(annotation)
        for field in annotation.model_fields.values():
            classes(found, field.annotation)
    for inner in get_args(annotation):
        classes(found, inner)


def test_every_optional_key_of_a_scene_has_a_default_that_is_tried() -> None:
    found: set[type[BaseModel]] = set()
    classes(found, SceneFile)
    assert {kind.__name__ for kind in found} >= set(DEFAULTS)
    missing = {}
    for kind in found:
        name = kind.__name__
        optional = {
            field.alias or key
            for key, field in kind.model_fields.items()
            if not field.is_required() and key not in ("type", "format", "version")
        }
        known = DEFAULTS.get(name, {}).keys() | NOTHING.get(name, set())
        known |= ELSEWHERE.get(name, set())
        if name not in OTHERS and optional - known:
            missing[name] = optional - known
        assert name in OTHERS or known <= optional, name
    assert not missing


@pytest.mark.parametrize("seed", (1, 4, 27))
def test_a_tree_with_friction_without_optional_keys_moves_the_same(seed: int) -> None:
    """Without gravity a joint of 4 and of 27 rests unloaded: rounding let it neither
    stick nor slip."""
    found = compared(NAME, rubbing_scene(seed), {}, seed, RTOL)
    assert found is not None
    error, allowed, where = found
    assert error < allowed, where
