"""Words in pictures do not cover each other, and none is cut off."""

from __future__ import annotations

import io
import re
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.text import Text
from scipy.spatial import ConvexHull

from sidtool.formats.model import ModelFile
from sidtool.formats.scene import unit_of
from sidtool.formats.study import StudyFile, StudyPoint
from sidtool.formats.toml.reading import validate_data
from sidtool.plot import bodies, curves, figure, results, studies
from sidtool.plot.bodies import BodyPicture, draw_bodies
from sidtool.plot.figure import figure_style, wrap_label

from ..models import IGA, rod_data


def words(page: Any) -> list[Any]:
    """Those that are drawn: ticks beyond the ends of an axis are not."""
    found: list[Any] = []
    draw = Text.draw
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            Text, "draw", lambda self, to: (found.append(self), draw(self, to))[1]
        )
        page.draw_without_rendering()
    return [text for text in found if text.get_visible() and text.get_text().strip()]


def crossing(page: Any) -> list[tuple[str, ...]]:
    """Words that meet others or leave the page, by more than a pixel."""
    found = []
    every = [(text.get_text(), text.get_window_extent()) for text in words(page)]
    for (one, first), (other, second) in combinations(every, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        up = min(first.y1, second.y1) - max(first.y0, second.y0)
        if min(across, up) > 1:
            found.append((one, other))
    for name, box in every:
        whole = page.bbox.padded(1)
        if not (whole.contains(*box.min) and whole.contains(*box.max)):
            found.append((name,))
    return found


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    retained: list[Any] = []
    for module in (bodies, results, figure):
        monkeypatch.setattr(
            module, "save_figure", lambda page, path: retained.append(page)
        )
    return retained


NAMES = [
    *(f"connecting_rod.q{k}" for k in range(1, 12)),
    "wheel_bearing_of_the_left_side.angle_rate",
    "angular_momentum.x",
    "shoulder_motor.my",
    "upper.peak_von_mises",
    "a.x",
]


@pytest.mark.parametrize(("error", "width"), [(1.25e-5, 5.2), (0.0, 7.5)])
def test_legends_and_labels_of_many_outputs(error: float, width: float) -> None:
    t = np.linspace(0.0, 1.0, 50)
    columns = {name: np.sin(k * t) for k, name in enumerate(NAMES)}
    errors = dict.fromkeys(NAMES, error)
    groups = curves.group_outputs(NAMES)
    with figure_style():
        page, axes = curves.draw_curves(
            t, groups, columns, errors, unit_of, (width, 1.4)
        )
        assert not crossing(page)
        heights = [place.get_window_extent().height for place in axes]
        assert min(heights) > 70  # legends leave room for the curves
        for place, height in zip(axes, heights, strict=True):
            label = place.yaxis.label.get_window_extent().height
            assert label < 1.4 * height
    texts = [text.get_text() for text in words(page)]
    for name in NAMES[:11]:
        assert (f"{name} ± {error:.1e}" if error else name) in texts
    boxes = [
        (
            round(text.get_window_extent().y0),
            text.get_window_extent().x0,
            text.get_text(),
        )
        for text in axes[0].get_legend().get_texts()
    ]
    # from left to right, then down
    read = [name for _, _, name in sorted(boxes, key=lambda box: (-box[0], box[1]))]
    assert read == sorted(read)
    assert len(read) == 7 and len({y for y, _, _ in boxes}) < (8 if error else 5)


@pytest.mark.parametrize("label", [*NAMES, "rod.tip.vx [m/s]", "__a__.b [N m]", "x"])
def test_broken_labels_lose_no_letter(label: str) -> None:
    for room in (0.3, 1.2, 9.0):
        lines = wrap_label(label, room)
        assert lines.replace("\n", "").replace(" ", "") == label.replace(" ", "")
    assert wrap_label(label, 9.0) == label


@pytest.mark.parametrize(
    ("ends", "count"),
    [
        ((0.8, 0.05, 0.05), 2),
        ((0.3, 0.3, 0.3), 1),
        ((0.0, 0.0, 2.0), 1),
        ((1.0, 0.2, 0.0), 2),
    ],
    ids=str,
)
def test_names_numbers_and_labels_of_bodies(
    ends: tuple[float, float, float], count: int
) -> None:
    """22 markers in a body of any shape: names without room are reported."""
    rng = np.random.default_rng(3)
    low, high = -0.1 * np.array(ends), 0.9 * np.array(ends)
    marks = {f"marker_{k}": rng.uniform(low, high) for k in range(22)}
    corners = np.array([low, high, [low[0], high[1], (low[2] + high[2]) / 2]])
    picture = BodyPicture("a body", corners, np.array([[0, 1, 2]]), marks=marks)
    with figure_style():
        page, left = draw_bodies([picture] * count, "drawn from something")
        assert not crossing(page)
    texts = [text.get_text() for text in words(page)]
    assert sorted([*left, *(name for name in texts if "marker" in name)]) == sorted(
        [*marks] * count
    )
    assert len(left) < 16 * count


def test_names_of_many_markers_of_a_model(pages: list[Any]) -> None:
    data = rod_data(IGA)
    at = data["markers"]["piston_pin"]
    for k in range(30):
        data["markers"][f"gauge_{k}"] = {**at, "node": k + 10}
    notes = bodies.plot_model(Path("x.png"), validate_data(data, ModelFile))
    assert not crossing(pages[0])
    names = {text.get_text() for text in words(pages[0])}
    assert "crank_pin" in names  # those of one place have one name
    left = 32 - len(names & set(data["markers"]))
    assert left > 20
    assert f"{left} of 32 names of markers have no room in the picture" in notes


@pytest.mark.parametrize(
    ("over", "decades"), [("integrator", 0.4), ("integrator", 4.0), ("modes", 1.5)]
)
def test_studies_of_many_points(over: str, decades: float, pages: list[Any]) -> None:
    rng = np.random.default_rng(1)
    points = [
        StudyPoint(
            integrator=f"method_{k % 12}",
            rtol=1e-6,
            error=float(10 ** rng.uniform(-8, -2)),
            seconds=float(0.15 * 10 ** rng.uniform(0.0, decades)),
            steps=3,
            choices={"modes": str(k % 12)},
            size=int(rng.integers(1, 40)),
        )
        for k in range(120)
    ]
    content = StudyFile(
        title="a study with a long title of its own, "
        "of everything that was tried, and of what may be tried another time",
        outputs=("a.x",),
        uncertainty=1e-9,
        varied=("integrator",) if over == "integrator" else ("integrator", over),
        points=tuple(points),
    )
    studies.plot_study(Path("x.png"), content)
    (page,) = pages
    assert not crossing(page)
    boxes = [legend.get_window_extent() for legend in page.findobj(_is_legend)]
    assert boxes
    for axes in page.axes:  # no point lies behind a legend
        inside = axes.get_window_extent()
        assert not any(inside.padded(-2).overlaps(box) for box in boxes)


def test_legends_leave_the_power_of_ten_free() -> None:
    """Rows of a full legend began on top of it."""
    t = np.linspace(0.0, 1.0, 30)
    columns = {f"a.q{k}": 1e-5 * np.sin(k * t) for k in range(1, 8)}
    with figure_style():
        page, (axes,) = curves.draw_curves(
            t, [list(columns)], columns, {}, unit_of, (5.2, 1.4)
        )
        page.draw_without_rendering()
    offset = axes.yaxis.get_offset_text()
    assert "5" in offset.get_text()
    box = axes.get_legend().get_window_extent()
    assert not box.overlaps(offset.get_window_extent())


def test_tied_nodes_are_visible_through_the_body() -> None:
    """Those of a bore were hidden by its walls, their colour in the legend alone."""
    corners = np.vstack([np.eye(3), -np.eye(3)])
    faces = ConvexHull(corners).simplices
    inside = {"pin: rigid tie": 0.1 * np.eye(3)}
    with figure_style():
        page, _ = draw_bodies(
            [BodyPicture("octahedron", corners, faces, groups=inside)]
        )
        stream = io.BytesIO()
        page.savefig(stream, dpi=100, format="png")
    stream.seek(0)
    pixels = matplotlib.image.imread(stream)[..., :3]
    red = (pixels[..., 0] > pixels[..., 2] + 0.3).nonzero()[0]
    assert len(red) > 10 and red.min() < 0.7 * len(pixels)


def _is_legend(artist: Any) -> bool:
    return type(artist).__name__ == "Legend"


def test_errors_of_a_result_are_bands_in_its_page() -> None:
    t = np.linspace(0.0, 2.0, 40)
    columns = {"a.x": np.sin(t), "a.y": np.cos(t), "a.z": t}
    errors = {"a.x": 0.25, "a.z": 0.0, "b.x": 3.0}
    text, left, right = curves.draw_curves_svg(t, columns, errors, unit_of)
    assert 0 < left < right < 1
    assert text.count('id="FillBetweenPolyCollection') == 1
    assert "a.x ± 2.5e-01" in text and "a.z ±" not in text
    axes = text[text.index('id="axes_1"') : text.index('id="axes_2"')]
    band = _height(axes, "FillBetweenPolyCollection")
    line = _height(axes, "line2d")
    assert band / line == pytest.approx(1 + 0.5 / np.ptp(columns["a.x"]), rel=1e-3)


def _height(axes: str, kind: str) -> float:
    """Of the curve that is drawn as this kind of thing [pt]."""
    groups = [part for part in axes.split("<g id=") if kind in part[:60]]
    paths = [re.findall(r'<path[^>]* d="([^"]*)"[^>]*', part) for part in groups]
    wide = [
        np.array(re.findall(r"[ML] -?[\d.]+ (-?[\d.]+)", path), float)
        for found in paths
        for path in found
    ]
    return float(max(np.ptp(y) for y in wide if len(y) > 20))
