"""The camera of a page sees all that moves, from every side, in windows of any shape.

What is seen is worked out from the surfaces of the bodies and the two matrices of the
camera; and no picture has anything at its edge.
"""

from __future__ import annotations

import base64
import io
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import sidtool
from sidtool.formats.field import Field
from sidtool.formats.scene import read_scene
from sidtool.pipeline.model_to_sid import field_from_model
from sidtool.view.animation import animate, animation_data
from tests.places import EXAMPLES, SLIDER_CRANK

from ..models import QM6, rod
from .browser import Page, opened

pytestmark = pytest.mark.needs("chromium", "playwright")
Array = np.ndarray
#: Widths and heights of the browser's window.
WINDOWS = ((1200, 800), (700, 900), (1500, 420))
VIEWS = ("iso", "front", "top", "side")
#: Pixels at the edge of a picture where nothing is drawn.
EDGE = 5


@pytest.fixture(scope="module")
def link(tmp_path_factory: pytest.TempPathFactory) -> tuple[sidtool.SID, Field]:
    """A link of the robot arm, from a coarse mesh."""
    folder = tmp_path_factory.mktemp("arm")
    source = EXAMPLES / "robot_arm"
    text = (
        (source / "mesh.py")
        .read_text(encoding="utf-8")
        .replace("CELLS = 12", "CELLS = 4")
    )
    (folder / "mesh.py").write_text(
        text.replace('"arm.inp"', f'"{folder}/arm.inp"'), encoding="utf-8"
    )
    runpy.run_path(str(folder / "mesh.py"))
    (folder / "arm.toml").write_text(
        (source / "arm.toml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    return field_from_model(folder / "arm.toml")


@cache
def arm(link: tuple[sidtool.SID, Field]) -> tuple[sidtool.Result, dict[str, Field]]:
    sids = {"upper": link[0], "forearm": link[0]}
    result = sidtool.simulate(EXAMPLES / "robot_arm" / "scene.toml", sids=sids)
    return result, {"upper": link[1], "forearm": link[1]}


def founding(_: Any) -> tuple[sidtool.Result, dict[str, Field]]:
    sid, field = field_from_model(rod({**QM6, "elements": [40, 4]}))
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml", {"time.end": 1.5})
    return sidtool.simulate(scene, sids={"rod": sid}), {"rod": field}


def cart(link: tuple[sidtool.SID, Field]) -> tuple[sidtool.Result, dict[str, Field]]:
    """A cart leaves by 30 m across the axes and carries a mast; a post stays."""
    away = {"velocity": [9.0, 3.0, -12.0]}
    scene = sidtool.Scene(
        dimension="spatial",
        time={"end": 2.0, "output_step": 0.02},
        bodies={
            "post": {
                "mass": 5.0,
                "inertia": [1.0, 1.0, 1.0],
                "markers": {"top": {"position": [0.0, 0.7, 0.0]}},
                "initial": {"position": [-1.0, 0.0, 2.0]},
            },
            "cart": {
                "mass": 20.0,
                "inertia": [1.0, 1.0, 1.0],
                "markers": {"front": {"position": [0.6, 0.0, -0.8]}},
                "initial": away,
            },
            "mast": {
                "sid": "arm.SID_FEM",
                "markers": {"base": 1, "tip": 2},
                "initial": away,
            },
        },
        joints={"step": {"type": "fixed", "markers": ["cart", "mast.base"]}},
        outputs={"record": ["cart.x"]},
    )
    return scene.simulate(sids={"mast": link[0]}), {"mast": link[1]}


def points(seen: Any, scale: float) -> Array:
    """(n, 3): surfaces and joints in space, at some times."""
    motion, found = seen.motion, []
    for row in np.linspace(0, len(motion.t) - 1, 23).astype(int):
        for body in seen.bodies:
            local = (
                body.positions + scale * body.shapes @ motion.elastic[body.name][row]
            )
            place, turn = motion.places[body.name][row], motion.turns[body.name][row]
            found.append(place + local @ turn.T)
            marks = [j.position for j in motion.joints if j.body == body.name]
            found += [place + turn @ mark for mark in marks]
    found += [j.position for j in motion.joints if not j.body]
    return np.concatenate([np.reshape(part, (-1, 3)) for part in found])


def across(page: Page, places: Array) -> Array:
    """(n, 2) where points are in the picture, from -1 to 1."""
    sight = page.run("player.sight()")
    view, projection = (
        np.reshape(sight[name], (4, 4)).T for name in ("view", "projection")
    )
    clip = np.column_stack([places, np.ones(len(places))]) @ (projection @ view).T
    assert (clip[:, 3] > 0).all()  # in front of the eye
    return clip[:, :2] / clip[:, 3:]


def resized(page: Page, size: tuple[int, int]) -> None:
    page.page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
    page.page.wait_for_function(
        "(() => { const at = document.getElementById('stage'),"
        " to = document.getElementById('canvas');"
        " return to.width === at.clientWidth && to.height === at.clientHeight; })()"
    )


def picture(page: Page) -> Array:
    url = page.run("document.getElementById('canvas').toDataURL()")
    data = base64.b64decode(url.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), int)


def free(picture: Array) -> bool:
    """Nothing is drawn at the edge, and something inside."""
    drawn = np.abs(picture - picture[1, 1]).sum(axis=2) > 20
    inside = drawn[EDGE:-EDGE, EDGE:-EDGE]
    return bool(inside.any() and inside.sum() == drawn.sum())


@pytest.mark.parametrize("make_motion", [arm, founding, cart])
def test_nothing_that_moves_leaves_the_window(
    make_motion: Any, link: tuple[sidtool.SID, Field], tmp_path: Path
) -> None:
    result, fields = make_motion(link)
    path = tmp_path / "motion.html"
    animate(result, path, fields=fields, scale=20.0)
    observed = animation_data(result, fields)
    places, t = points(observed, 20.0), observed.motion.t
    assert make_motion is not cart or np.ptp(places, axis=0).max() > 20.0
    with opened(path) as page:
        for size in WINDOWS:
            resized(page, size)  # the view of the start or of the last window is kept
            for view in ("", *VIEWS):
                if view:
                    page.run(f"player.look('{view}')")
                spread = np.abs(across(page, places)).max(axis=0)
                assert spread.max() < 1, (size, view)
                assert spread.max() > 0.75, (size, view)  # and not from far away
        for when in (t[0], t[len(t) // 2], t[-1]):
            page.run(f"player.seek({when})")
            assert free(picture(page))
        # deformations of any size, axes, marks of joints
        page.run("player.scale(300)")
        page.page.click("#joints")
        page.page.click("#frames")
        assert np.abs(across(page, points(observed, 300.0))).max() < 1
        for when in (t[-1], t[0]):
            page.run(f"player.seek({when})")
            assert free(picture(page))
        assert page.messages == []


def test_no_body_is_behind_the_legend_and_manual_views_are_kept(
    link: tuple[sidtool.SID, Field], tmp_path: Path
) -> None:
    result, fields = arm(link)
    animate(result, tmp_path / "m.html", fields=fields, colour="stress", scale=1.0)
    places = points(animation_data(result, fields), 1.0)
    with opened(tmp_path / "m.html") as page:
        for size in WINDOWS[:2]:
            resized(page, size)
            for view in VIEWS:
                page.run(f"player.look('{view}')")
                place = across(page, places)
                assert np.abs(place).max() < 1
                height = page.run("document.getElementById('stage').clientHeight")
                top = page.run("document.getElementById('legend').offsetTop")
                assert (1 - place[:, 1]).max() / 2 * height < top
        page.page.mouse.move(200, 200)
        page.page.mouse.down()
        page.page.mouse.move(260, 230)
        page.page.mouse.up()
        view = page.run("player.sight().view")
        resized(page, (800, 750))
        page.run("player.colour('displacement')")
        assert page.run("player.sight().view") == view
        page.page.click("[data-view=top]")
        assert page.run("player.sight().view") != view
