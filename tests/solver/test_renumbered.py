"""Systems with other numbers of bodies and drives have the tables of systems made
anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.system.build import build_system
from sidtool.solver.system.system import System
from sidtool.solver.system.update import updated_system
from tests.solver.scenes import polynomial, scene, slender_rod, soft_body

EXAMPLES = Path(__file__).parents[2] / "examples"


def crank_slider() -> tuple[SceneFile, dict[str, SID]]:
    """In the plane: a driven crank, whose joint is asked for its force, a point mass
    and a flexible rod."""
    content = sidtool.Scene.load(EXAMPLES / "slider_crank" / "slider_crank.toml")
    content = content.with_({"outputs.record": ["bearing.f*", "rod.q1"]})
    return content, {"rod": soft_body(5, 3, nodes=2)}


def rubbing_chain() -> tuple[SceneFile, dict[str, SID]]:
    """In space: two links with friction, springs and a redundant joint."""
    link = {
        "mass": 1.3,
        "inertia": [0.02, 0.3, 0.3],
        "centre_of_mass": [0.4, 0.0, 0.1],
        "markers": {"a": {"position": [0, 0, 0]}, "b": {"position": [1.0, 0, 0]}},
    }
    second = {**link, "initial": {"position": [1.0, 0.0, 0.0]}}
    friction = {"coefficient": 0.1, "radius": 0.05}
    pin = {"type": "revolute", "axis": [0.0, 0.0, 1.0]}
    joints = {
        "first": {**pin, "markers": ["ground", "one.a"], "friction": friction},
        "second": {**pin, "markers": ["one.b", "two.a"], "friction": friction},
    }
    spring = {"type": "spring_damper", "markers": ["ground", "two.b"], "rest": 1.0}
    forces = {"spring": {**spring, "stiffness": 30.0, "damping": 0.1}}
    bodies = {"one": link, "two": second}
    return scene(bodies, joints, forces=forces, dimension="spatial"), {}


def turning_links() -> tuple[SceneFile, dict[str, SID]]:
    """In the plane: a link that is driven, one that it carries, one that is free."""
    bodies = {
        "base": slender_rod(1.0),
        "tip": slender_rod(0.5, position=[1.0, 0.0], angle=6.0),
        "free": slender_rod(0.3, angle=0.4),
    }
    joints = {
        "hinge": {"type": "revolute", "markers": ["ground", "base.a"]},
        "weld": {"type": "fixed", "markers": ["base.b", "tip.a"]},
        "pull": {"type": "revolute", "markers": ["tip.b", "free.a"]},
    }
    drives = {"turn": {"joint": "hinge", "function": polynomial(0.0, 2.0)}}
    return scene(bodies, joints, drives), {}


def driven_points() -> tuple[SceneFile, dict[str, SID]]:
    """In space: a driven link, a point mass on it, a flexible body that is pulled."""
    link = {"mass": 1.1, "inertia": [0.1, 0.2, 0.3], "centre_of_mass": [0.5, 0, 0.1]}
    places = {"a": {"position": [0, 0, 0]}, "b": {"position": [1, 0, 0]}}
    start = {"position": [0.0, 0.0, -0.5]}
    bodies = {
        "link": {**link, "markers": places},
        "point": {"mass": 0.3, "initial": {"position": [1.0, 0.0, 0.0]}},
        "soft": {"sid": "soft", "markers": {"end": "1"}, "initial": start},
    }
    pin = {"type": "revolute", "axis": [0.0, 1.0, 0.0]}
    joints = {
        "hinge": {**pin, "markers": ["ground", "link.a"]},
        "ball": {"type": "spherical", "markers": ["link.b", "point"]},
    }
    swing = {"type": "harmonic", "amplitude": 0.2, "frequency": 3.0}
    along = {"marker": "soft.end", "coordinate": "x", "function": swing}
    wave = {"type": "harmonic", "amplitude": 0.4, "angular_frequency": 9.0}
    drives = {"turn": {"joint": "hinge", "function": wave}, "pull": along}
    content = scene(bodies, joints, drives, dimension="spatial")
    return content, {"soft": soft_body(5, 8, planar=False)}


SCENES = crank_slider, rubbing_chain, turning_links, driven_points


def other_numbers(content: SceneFile, rng: np.random.Generator) -> dict[str, Any]:
    """Of about half of the bodies and drives, by keys of the scene."""
    axes = 2 if content.dimension == "planar" else 3
    found: dict[str, Any] = {}
    for name, drive in content.drives.items():
        if rng.random() < 0.4:
            continue
        if drive.function.type == "harmonic":
            found[f"{name}.function.amplitude"] = float(rng.choice([0.0, 0.1, 0.7]))
        elif drive.function.pieces[0].coefficients:
            found[f"{name}.function.pieces[0].coefficients[1]"] = float(rng.random())
        else:
            found[f"{name}.function.pieces[0].start[0]"] = float(rng.random())
    for name, body in content.bodies.items():
        if rng.random() < 0.4:
            continue
        found[f"{name}.initial.velocity"] = rng.uniform(-1.0, 1.0, axes).tolist()
        found[f"{name}.initial.position"] = rng.uniform(-1.0, 1.0, axes).tolist()
        if name in content.sid_bodies:
            found[f"{name}.initial.elastic"] = rng.uniform(-1e-3, 1e-3, 5).tolist()
            continue
        found[f"{name}.mass"] = float(rng.uniform(0.1, 3.0))
        if body.inertia is not None:  # type: ignore[union-attr]
            found[f"{name}.centre_of_mass"] = rng.uniform(0.1, 1.0, axes).tolist()
    return found


def assert_same_tables(
    found: at.SystemArrays | None, expected: at.SystemArrays | None
) -> None:
    """Also inside of Newton's and of frictions' tables."""
    assert (found is None) == (expected is None)
    if found is None:
        return
    for field in at.SystemArrays.kind.fields:
        one, other = getattr(found, field), getattr(expected, field)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other, err_msg=field)
    assert_same_tables(found.newton_subsystem, expected.newton_subsystem)  # type: ignore[union-attr]
    assert_same_tables(found.friction_subsystem, expected.friction_subsystem)  # type: ignore[union-attr]


def assert_same(found: System, expected: System) -> None:
    assert_same_tables(found.arrays, expected.arrays)
    assert found.length == expected.length and found.scene == expected.scene
    assert (
        found.breaks == expected.breaks and found.break_causes == expected.break_causes
    )
    assert list(found.features) == list(expected.features)
    for one, other in zip(
        found.features.values(), expected.features.values(), strict=True
    ):
        np.testing.assert_array_equal(one.starts, other.starts)
        np.testing.assert_array_equal(one.lengths, other.lengths)
    assert [d.rotates for d in found.bodies] == [d.rotates for d in expected.bodies]
    assert (found.full_system is None) == (expected.full_system is None)
    if found.full_system is not None:
        assert expected.full_system is not None
        assert_same(found.full_system, expected.full_system)
    elif found.make_full_system is not None:
        assert expected.make_full_system is not None
        assert_same_tables(
            found.make_full_system().arrays, expected.make_full_system().arrays
        )


@pytest.mark.parametrize("make", SCENES)
def test_tables_with_other_numbers(make: Any) -> None:
    content, sids = make()
    before, rng = build_system(content, sids), np.random.default_rng(7)
    different = 0
    for _ in range(6):
        changed = content.with_(other_numbers(content, rng))
        found, expected = (
            updated_system(before, changed, sids),
            build_system(changed, sids),
        )
        assert found is not None
        assert_same(found, expected)
        different += not np.array_equal(found.arrays.real_data, before.arrays.real_data)
    assert different > 2


def test_places_of_markers_and_orientations_without_point_masses() -> None:
    for make, angle in ((rubbing_chain, None), (turning_links, 0.3)):
        content, sids = make()
        name = list(content.bodies)[-1]
        axes = 2 if angle else 3
        changes: dict[str, Any] = {f"{name}.markers.b.position": [0.7, 0.1, 0.2][:axes]}
        if angle:
            changes |= {f"{name}.markers.a.angle": angle, f"{name}.initial.angle": 0.9}
        changed = content.with_(changes)
        found = updated_system(build_system(content, sids), changed, sids)
        assert found is not None
        assert_same(found, build_system(changed, sids))


def test_places_beside_point_masses() -> None:
    for make, changes in (
        (crank_slider, {"crank.markers.pin.position": [0.11, 0.02]}),
        (driven_points, {"link.markers.b.position": [0.8, 0.1, 0.2], "link.mass": 2.0}),
    ):
        content, sids = make()
        changed = content.with_(changes)
        found = updated_system(build_system(content, sids), changed, sids)
        assert found is not None
        assert_same(found, build_system(changed, sids))


def test_what_may_change_tables_is_made_anew() -> None:
    """A body that becomes a point mass, orientations beside one, other breaks, and all
    that is neither body nor drive."""
    content, sids = crank_slider()
    before = build_system(content, sids)
    start = "crank_angle.function.pieces[0]"
    for changes in (
        {"crank.markers.pin.angle": 0.2},
        {"piston.initial.angle": 0.1},
        {"piston.centre_of_mass": [0.1, 0.0]},
        {"rod.shape_functions": [1, 2]},
        {f"{start}.to": 1.5, "crank_angle.function.pieces[1].from": 1.5},
        {"gravity": [0.0, -1.0]},
        {"time.end": 0.1},
    ):
        assert updated_system(before, content.with_(changes), sids) is None
    assert updated_system(before, content, {"rod": soft_body(5, 4, nodes=2)}) is None


def test_orientations_that_rotate_a_marker_of_a_joint_make_other_tables() -> None:
    """A fixed joint keeps the relative orientation that the scene states."""
    content, sids = turning_links()
    content = content.with_({"base.initial.angle": 0.2})
    before = build_system(content, sids)
    assert updated_system(before, content.with_({"tip.initial.angle": 5.0}), sids) is (
        None
    )
    heavier = content.with_({"tip.mass": 2.0})
    found = updated_system(before, heavier, sids)
    assert found is not None
    assert_same(found, build_system(heavier, sids))


def test_compiling_with_another_mass_keeps_the_tables() -> None:
    for make in SCENES:
        content, sids = make()
        before = compile_scene(content, sids=sids)
        name = next(n for n in content.bodies if n not in content.sid_bodies)
        found = compile_scene(
            content.with_({f"{name}.mass": 3.0}), sids=sids, before=before
        )
        assert found.arrays.body is before.arrays.body
