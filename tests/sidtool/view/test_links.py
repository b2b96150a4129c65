"""Springs, dampers, actuators and rods are drawn between their markers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.result import Result
from sidtool.formats.scene import read_scene
from sidtool.solver.system.rotated_markers import shortest_rotation
from sidtool.view import film
from sidtool.view.animation import animate, animation_data
from sidtool.view.links import X
from tests.places import SLIDER_CRANK

from .browser import opened

#: Far enough to have a length at all times.
WALL = [0.2, 0.8]
ENDS = ["ground.wall", "rod.piston_pin"]
FORCES: dict[str, Any] = {
    "spring": {"type": "spring_damper", "markers": ENDS, "stiffness": 1.0},
    "damper": {"type": "spring_damper", "markers": ENDS, "damping": 1.0},
    "ram": {
        "type": "actuator",
        "markers": ["crank.pin", "piston"],
        "function": {"type": "constant", "value": 1.0},
    },
}
RECORD = [
    *("spring.length", "ram.length", "rope.length"),
    *("rod.piston_pin.x", "rod.piston_pin.y", "crank.pin.x", "crank.pin.y"),
]


@pytest.fixture(scope="module")
def result() -> Result:
    """A slider-crank with a flexible rod and, beside it, a bob on a string."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    bob = {"mass": 0.1, "initial": {"position": [0.2, 0.5]}}
    string = {"type": "distance", "markers": ["ground.wall", "bob"]}
    changed = scene.with_(
        {
            "time.end": 0.02,
            "ground.markers.wall": {"position": WALL},
            "bodies.bob": bob,
            "joints.rope": string,
            "forces": FORCES,
            "outputs.record": RECORD,
        }
    )
    return sidtool.simulate(changed, base_folder=SLIDER_CRANK)


def test_links_join_their_markers(result: Result) -> None:
    """Their ends are the places of the markers, deformation of the rod included."""
    motion = animation_data(result).motion
    found = {link.name: link for link in motion.links}
    assert {name: link.kind for name, link in found.items()} == {
        "rope": "rod",
        "spring": "spring",
        "damper": "damper",
        "ram": "actuator",
    }
    row = len(motion.t) - 1
    tip = [result[f"rod.piston_pin.{axis}"][-1] for axis in "xy"]
    pin = [result[f"crank.pin.{axis}"][-1] for axis in "xy"]
    for name, place, which in (
        ("spring", WALL, 0),
        ("spring", tip, -1),
        ("damper", tip, -1),
        ("ram", pin, 0),
        ("rope", WALL, 0),
    ):
        link = found[name]
        end = link.positions[:, 0] == (0.0 if which == 0 else 1.0)
        corners = link.corners(motion, row, 1.0)[end[link.triangles].all(axis=1)]
        drawn = corners.reshape(-1, 3)
        middle = (drawn.min(axis=0) + drawn.max(axis=0)) / 2.0
        assert middle == pytest.approx([*place, 0.0], abs=1e-9), (name, which)
    for name in ("spring", "ram", "rope"):
        a, b = (end.path(motion, 1.0)[row] for end in found[name].ends)
        length = result[f"{name}.length"][-1]
        assert np.linalg.norm(b - a) == pytest.approx(length, abs=1e-9)


def test_ends_follow_the_magnified_deformation(result: Result) -> None:
    motion = animation_data(result).motion
    end = next(link for link in motion.links if link.name == "spring").ends[1]
    paths = [end.path(motion, scale) for scale in (0.0, 1.0, 50.0)]
    assert paths[2] - paths[0] == pytest.approx(50.0 * (paths[1] - paths[0]), abs=1e-12)
    assert np.abs(paths[1] - paths[0]).max() > 1e-9


def test_a_turn_from_x_is_a_rotation() -> None:
    directions = np.concatenate([np.eye(3), -np.eye(3), [[0.6, 0.0, -0.8]]])
    for along in directions:
        R = shortest_rotation(X, along)
        assert R[:, 0] == pytest.approx(along, abs=1e-15)
        assert pytest.approx(np.eye(3), abs=1e-14) == R @ R.T
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_films_show_links(result: Result) -> None:
    observed = animation_data(result)
    links = [link.triangles for link in observed.motion.links]
    parts = [body.triangles for body in observed.bodies]
    stage = film.Stage(observed.motion, observed.bodies, parts, None, "", 1.0)
    stage.show(0)
    drawn = sum(map(len, stage._faces(0)))
    assert drawn == sum(map(len, parts)) + sum(map(len, links))


@pytest.mark.needs("chromium", "playwright")
def test_the_page_draws_links(result: Result, tmp_path: Path) -> None:
    animate(result, tmp_path / "motion.html", scale=1.0)
    with opened(tmp_path / "motion.html") as page:
        page.run(f"player.seek({result.t[-1]})")
        links = page.run("player.links()")
        assert not page.messages
    tip = [result[f"rod.piston_pin.{axis}"][-1] for axis in "xy"]
    assert links["spring"]["ends"][1] == pytest.approx([*tip, 0.0], abs=1e-6)
    assert links["rope"]["ends"][0] == pytest.approx([*WALL, 0.0], abs=1e-6)
