"""Pages and films of mechanisms: what they show is what the result says."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.field.body_surfaces import surface_of_field, surface_of_sid
from sidtool.field.surface import border_edges, decimate, plate_surface
from sidtool.formats.base.errors import InputError
from sidtool.formats.field import Field, write_field
from sidtool.formats.result import Result, write_result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.pipeline.model_to_sid import field_from_model
from sidtool.view import animation, body_fields
from sidtool.view.animation import animate, animation_data
from sidtool.view.motion import sample_motion
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

from ..models import QM6, rod
from .browser import Page, opened


def page_of(result: Result, path: Path, **settings: object) -> list[str]:
    return animate(result, path, **settings)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def scene() -> SceneFile:
    content = read_scene(SLIDER_CRANK / "slider_crank.toml")
    time = content.time.model_copy(update={"end": 1.5})
    return content.model_copy(update={"time": time})


@pytest.fixture(scope="module")
def rod_with_field() -> tuple[sidtool.SID, Field]:
    return field_from_model(rod({**QM6, "elements": [60, 4]}))


@pytest.fixture(scope="module")
def result(scene: SceneFile, rod_with_field: tuple[sidtool.SID, Field]) -> Result:
    return sidtool.simulate(
        scene, base_folder=SLIDER_CRANK, sids={"rod": rod_with_field[0]}
    )


@pytest.fixture(scope="module")
def motion(
    result: Result,
    rod_with_field: tuple[sidtool.SID, Field],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    path = tmp_path_factory.mktemp("page") / "motion.html"
    page_of(result, path, fields={"rod": rod_with_field[1]}, colour="stress", scale=1.0)
    return path


def test_the_played_motion_is_that_of_the_outputs(result: Result) -> None:
    shown_at = sample_motion(result)
    rows = [int(np.abs(shown_at.t - t).argmin()) for t in result.t]
    assert np.allclose(shown_at.t[rows], result.t, atol=1e-12)
    node = next(b for b in shown_at.system.bodies if b.name == "rod").sid.node(2)
    q, R = shown_at.elastic["rod"][rows], shown_at.turns["rod"][rows]
    local = node.position + q @ node.phi.m0.T
    place = shown_at.places["rod"][rows] + np.einsum("tij,tj->ti", R, local)
    assert np.allclose(place[:, 0], result["rod.piston_pin.x"], atol=1e-9)
    assert np.allclose(place[:, 1], result["rod.piston_pin.y"], atol=1e-9)


@pytest.mark.needs("chromium", "playwright")
def test_the_page_plays_the_mechanism(motion: Path, result: Result) -> None:
    with opened(motion) as page:
        assert page.run("player.state.time") == 0.0
        for t in (0.6, 1.23, 1.5):
            page.run(f"player.seek({t})")
            row = int(np.abs(result.t - t).argmin())
            there = page.run("player.bodies()")
            assert there["piston"]["place"][0] == pytest.approx(
                result["piston.x"][row], abs=1e-5
            )
            assert there["rod"]["q"][0] == pytest.approx(
                result["rod.q1"][row], abs=1e-7
            )
        _slide(page, 0.9)
        moved = page.run("player.bodies().piston.place[0]")
        assert moved == pytest.approx(
            np.interp(0.9, result.t, result["piston.x"]), abs=1e-4
        )
        page.run("player.seek(0); document.getElementById('play').click()")
        page.page.wait_for_function("player.state.time > 0.02", timeout=60_000)
        page.run("player.play(false)")
        assert page.messages == []


def _slide(page: Page, t: float) -> None:
    """As a hand does."""
    page.run(
        "(() => { const slider = document.getElementById('slider');"
        f" slider.value = {t}; slider.dispatchEvent(new Event('input')); }})()"
    )


@pytest.mark.needs("chromium", "playwright")
def test_a_point_of_the_page_is_where_its_elastic_motion_puts_it(
    motion: Path, result: Result, rod_with_field: tuple[sidtool.SID, Field]
) -> None:
    """The end of the rod on the page and the piston pin of the result."""
    drawn = surface_of_field("rod", rod_with_field[1])
    ends = np.flatnonzero(
        np.abs(drawn.positions[:, :2] - [1.0, 0.0]).max(axis=1) < 1e-9
    )
    with opened(motion) as page:
        page.run("player.seek(1.2)")
        points = [page.run(f"player.bodies().rod.point({row})") for row in ends]
        assert page.run("player.stage.scale") == 1
    row = int(np.abs(result.t - 1.2).argmin())
    middle = np.mean(points, axis=0)
    expected = [result[f"rod.piston_pin.{axis}"][row] for axis in "xy"]
    assert np.allclose(middle, [*expected, 0.0], atol=1e-6)


@pytest.mark.needs("chromium", "playwright")
def test_the_page_is_not_blank_and_changes(motion: Path, tmp_path: Path) -> None:
    from PIL import Image

    with opened(motion) as page:
        pictures = []
        for t in (0.0, 0.8):
            page.run(f"player.seek({t})")
            shot = page.page.locator("#canvas").screenshot()
            pictures.append(
                np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), int)
            )
        page.run("player.colour('displacement'); player.look('iso'); player.scale(50)")
        for name in ("joints", "frames", "edges"):
            page.page.click(f"#{name}")
        shot = page.page.locator("#canvas").screenshot()
        pictures.append(np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), int))
        assert page.run("document.querySelectorAll('.plot svg').length") == 1
        assert page.messages == []
    for picture in pictures:
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
        background = np.abs(picture - picture[5, 5]).sum(axis=2) < 12
        assert 0.005 < 1 - background.mean() < 0.6
    for one, other in ((0, 1), (1, 2)):
        assert (np.abs(pictures[one] - pictures[other]).sum(axis=2) > 60).mean() > 0.004


def test_the_page_of_the_founding_example_is_small(tmp_path: Path) -> None:
    sid, field = field_from_model(SLIDER_CRANK / "rod_q4.toml")
    founding = sidtool.simulate(SLIDER_CRANK / "slider_crank.toml", sids={"rod": sid})
    page_of(founding, tmp_path / "motion.html", fields={"rod": field})
    assert (tmp_path / "motion.html").stat().st_size < 3e6


def test_decimated_surfaces_are_noted(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plate of 3 200 triangles for the rod; 60 s of its motion."""
    monkeypatch.setattr(animation, "MOST_TRIANGLES", 2_500)
    monkeypatch.setattr(animation, "FEW_TRIANGLES", 200)
    sid, small = field_from_model(rod({**QM6, "elements": [60, 4]}))
    n = 40
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(-0.03, 0.03, n + 1))
    grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (
        grid[i : i + n, j : j + n].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    )
    near = np.abs(small.positions[None, :, 0] - np.linspace(0, 1, n + 1)[:, None])
    shapes = small.shapes[near.argmin(axis=1)][np.tile(np.arange(n + 1), n + 1)]
    large = replace(
        small,
        positions=np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]),
        triangles=np.concatenate(
            [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
        ),
        shapes=shapes,
        thickness=0.0,
        stress=None,
        initial_stress=np.zeros((len(shapes), 6)),
    )
    long = replace(result, t=result.t * 40.0)
    path = tmp_path / "long.html"
    page_of(long, path, fields={"rod": large})
    text = path.read_text(encoding="utf-8")
    found = re.search(r"thinned to (\d+) of (\d+) surface triangles", text)
    assert found and int(found[2]) > 3_200 and int(found[1]) <= 2_510
    body = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])  # type: ignore[index]
    rod_data = next(b for b in body["bodies"] if b["name"] == "rod")
    assert len(rod_data["coarse"]) < 0.2 * len(rod_data["triangles"])
    del sid


@pytest.mark.needs("chromium", "playwright")
def test_a_slow_browser_shows_fewer_triangles_with_a_note(
    result: Result,
    rod_with_field: tuple[sidtool.SID, Field],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Any browser is slower than a thousandth of a millisecond."""
    monkeypatch.setattr(animation, "SLOW_FRAME_TIME", 1e-3)
    monkeypatch.setattr(animation, "FEW_TRIANGLES", 300)
    path = tmp_path / "slow.html"
    page_of(result, path, fields={"rod": rod_with_field[1]}, colour="displacement")
    with opened(path) as page:
        every = page.run("player.triangles()")
        page.run("player.play(true)")
        page.page.wait_for_function("player.state.thin", timeout=60_000)
        few = page.run("player.triangles()")
        notice = page.page.inner_text("#notice")
        page.run("player.play(false)")
        assert page.run("player.triangles()") == every
        assert page.page.inner_text("#notice") == ""
        assert page.messages == []
    assert few < 0.5 * every
    assert notice.startswith(f"{few} of {every} triangles")


#: Plays pictures at intervals [ms] by a clock of the test's own.
PICTURES = """(() => {
  const { requestAnimationFrame } = window;
  let now = 1000, picture;
  window.requestAnimationFrame = (next) => { picture = next; };
  player.play(true);
  picture(now);
  for (const passed of %s) picture(now += passed);
  const { thin } = player.state;
  player.play(false);
  window.requestAnimationFrame = requestAnimationFrame;
  return thin;
})()"""


@pytest.mark.needs("chromium", "playwright")
def test_a_browser_is_slow_by_what_follows_its_first_picture(
    result: Result,
    rod_with_field: tuple[sidtool.SID, Field],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(animation, "FEW_TRIANGLES", 300)
    path = tmp_path / "page.html"
    page_of(result, path, fields={"rod": rod_with_field[1]}, colour="displacement")
    cases = [
        ((3500, 3500), True),  # two pictures of one second each are sufficient
        ((600, 300), False),
        ((600, 300, 300), True),
        ((100,) * 8, False),
        ((100,) * 9, True),
        ((500, *(16,) * 12), False),
        ((1500, *(16,) * 12), False),
        ((16,) * 40, False),
    ]
    with opened(path) as page:
        found = [page.run(PICTURES % list(times)) for times, _ in cases]
        assert page.messages == []
    assert found == [slow for _, slow in cases]


def test_fields_next_to_the_sids_are_found(
    rod_with_field: tuple[sidtool.SID, Field], scene: SceneFile, tmp_path: Path
) -> None:
    sid, field = rod_with_field
    sidtool.write(tmp_path / "rod.SID_FEM", sid)
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    text = text.replace("rod_q4.SID_FEM", "rod.SID_FEM").replace(
        "end = 3.0", "end = 0.1"
    )
    (tmp_path / "s.toml").write_text(text, encoding="utf-8")
    result = sidtool.simulate(tmp_path / "s.toml")
    assert len(result.t) == 11
    bodies = {
        body.name: body for body in animation_data(result, folder=tmp_path).bodies
    }
    assert "nodes of its SID" in bodies["rod"].source
    write_field(tmp_path / "rod.field.h5", field)
    bodies = {
        body.name: body for body in animation_data(result, folder=tmp_path).bodies
    }
    assert bodies["rod"].source == "its full field"
    wrong = replace(field, stiffness=2 * field.stiffness)
    write_field(tmp_path / "rod.field.h5", wrong)
    with pytest.warns(sidtool.DiagnosticWarning, match="N822 rod"):
        animation_data(result, folder=tmp_path)
    with pytest.raises(InputError, match="has other Ke than the SID"):
        animation_data(result, {"rod": wrong})
    with pytest.raises(InputError, match="no flexible body 'crank'"):
        animation_data(result, {"crank": field})


def test_lines_of_a_sid_pass_through_its_nodes_and_bend_like_a_beam(
    rod_with_field: tuple[sidtool.SID, Field],
) -> None:
    """The middle of the first mode lies within a few per cent of the full field: two
    nodes with rotations define a cubic."""
    sid, field = rod_with_field
    drawn = surface_of_sid("rod", sid, 0.01)
    axis = drawn.positions.reshape(-1, 4, 3).mean(axis=1)
    moved = drawn.shapes.reshape(-1, 4, 3, sid.nq).mean(axis=1)
    for node in sid.nodes:
        row = int(np.linalg.norm(axis - node.position, axis=1).argmin())
        assert np.allclose(axis[row], node.position, atol=1e-12)
        assert np.allclose(moved[row], node.phi.m0, atol=1e-12)
    row = int(np.abs(axis[:, 0] - 0.5).argmin())
    near = int(np.linalg.norm(field.positions - [0.5, 0, 0], axis=1).argmin())
    first = field.shapes[near, 1, 0]
    assert moved[row, 1, 0] == pytest.approx(first, rel=0.25)


def test_plates_are_closed_and_thinning_keeps_their_extent() -> None:
    n = 60
    x, y = (
        axis.ravel() for axis in np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0))
    )
    grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (
        grid[i : i + n, j : j + n].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    )
    flat = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    points = np.column_stack([x, y, 0 * x])
    created = plate_surface(points, flat, 12.0)
    assert not len(border_edges(created.triangles))
    p, q, r = np.moveaxis(created.positions[created.triangles], 1, 0)
    inside = np.einsum("pa,pa->p", p, np.cross(q, r)).sum() / 6
    assert inside == pytest.approx(12.0 * n * n)
    few = decimate(created.positions, created.triangles, 3000)
    assert 1000 < len(few) <= 3000
    extent = np.ptp(created.positions[np.unique(few)], axis=0)
    assert np.all(extent > [0.9 * n, 0.9 * n, 10.0])


def test_ranges_of_colours_end_at_the_largest_values(
    result: Result, rod_with_field: tuple[sidtool.SID, Field]
) -> None:
    data = animation_data(result, {"rod": rod_with_field[1]})
    ranges = body_fields.colour_ranges(data.motion, data.bodies, "stress")
    (rod,) = (body for body in data.bodies if body.name == "rod")
    q = data.motion.elastic["rod"]
    moved = np.linalg.norm(np.einsum("pak,tk->tpa", rod.shapes, q), axis=2)
    assert ranges["displacement"].most == pytest.approx(moved.max(), rel=1e-12)
    assert rod.stress is not None
    xx, yy, zz, xy, yz, zx = np.einsum("pak,tk->atp", rod.stress, q)
    square = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    square += 6.0 * (xy**2 + yz**2 + zx**2)
    largest = np.sqrt(square.max() / 2.0)
    assert ranges["stress"].most == pytest.approx(largest, rel=1e-12)


def test_films(result: Result, tmp_path: Path) -> None:
    from PIL import Image

    short = replace(
        result,
        t=result.t[:12],
        values=result.values[:12],
        positions=result.positions[::12][:12],
        velocities=result.velocities[::12][:12],
        multipliers=result.multipliers[:12],
    )
    notes = animate(short, tmp_path / "motion.gif", colour="displacement")
    assert any("nodes of its SID" in text for text in notes)
    with Image.open(tmp_path / "motion.gif") as film:
        assert film.n_frames > 5
        first = np.asarray(film.convert("RGB"), int)
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB"), int)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 20
    assert (np.abs(first - last).sum(axis=2) > 60).mean() > 0.002


def test_the_command_reports_wrong_input(
    result: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.h5"
    write_result(path, result)
    cases = {
        ("motion.png",): "which the ending .png does not say",
        ("motion.avi",): "an ending out of .html",
        ("m.html", "--outputs", "rod.tip.x"): "rod has no marker 'tip'",
        ("m.html", "--field", "rod"): "BODY=FILE",
        ("m.html", "--field", "rod=none.h5"): "no such file",
        ("m.html", "--scale", "-1"): "--scale",
        ("m.html", "--colour", "stress"): "there is no stress to colour by",
    }
    for arguments, message in cases.items():
        target = str(tmp_path / arguments[0])
        assert run(["animate", str(path), "-o", target, *arguments[1:]]) == 2, arguments
        assert message in unwrapped(capsys.readouterr().err)
        assert not Path(target).exists()
    assert (
        run(["animate", str(SLIDER_CRANK / "slider_crank.toml"), "-o", "m.html"]) == 2
    )


def test_without_three_js_the_message_names_the_package(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation, "PACKAGE", "no_such_package_of_three_js")
    with pytest.raises(InputError, match=r"sidtool\[view\]"):
        animate(result, tmp_path / "m.html")
    assert not (tmp_path / "m.html").exists()


@pytest.mark.parametrize(("largest", "scale"), [(1e-16, 1.0), (1e-5, 2000.0)])
def test_rounding_is_not_magnified(
    largest: float, scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(body_fields, "_largest_values", lambda *_: largest)
    mechanism = SimpleNamespace(size=1.0)
    assert body_fields.fitting_scale(mechanism, [None]) == scale
