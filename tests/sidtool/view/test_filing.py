"""`sidtool report`: all that a run is filed with, on a page that stands alone."""

from __future__ import annotations

import base64
import io
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import sidtool
from sidtool.cli.main import run
from tests.optional import program
from tests.pages import Page
from tests.places import SLIDER_CRANK


@pytest.fixture(scope="module")
def filed(tmp_path_factory: pytest.TempPathFactory) -> tuple[sidtool.Result, Path]:
    """A short founding run with a damped and a stopped end, and its page."""
    folder = tmp_path_factory.mktemp("filed")
    scene = sidtool.Scene.load(SLIDER_CRANK / "slider_crank.toml")
    stop = sidtool.Event(quantity="piston.x", value=1.09, action="stop")
    short = scene.with_(
        {
            "title": "Crank <1> & rod",
            "time.end": 0.9,
            "events": {"near": stop},
            "outputs.record": ["piston.x", "rod.q1", "crank_pin.fx"],
        }
    )
    result = short.simulate()
    result.save(folder / "r.h5")
    assert run(["report", str(folder / "r.h5"), "-o", str(folder / "r.html")]) == 0
    return result, folder / "r.html"


def test_the_page_holds_scene_model_accuracy_outputs_and_versions(
    filed: tuple[sidtool.Result, Path],
) -> None:
    result, path = filed
    text = path.read_text(encoding="utf-8")
    reader = Page(text)
    assert reader.headings == [
        "Crank <1> & rod",
        "Mechanism",
        "Scene",
        "What was modelled, and what was left out",
        "Method, accuracy and cost",
        "Events",
        "Outputs",
        "Versions",
    ]
    assert "event near ended the run" in text
    for name in ("crank", "rod", "piston", "crank_pin", "crank_angle"):
        assert name in reader.cells
    row = reader.cells.index("crank_pin.fx")
    history = result["crank_pin.fx"]
    numbers = [float(cell) for cell in reader.cells[row + 2 : row + 7]]
    found = [history[0], history.min(), history.max(), history[-1]]
    found.append(result.t[np.abs(history).argmax()])
    np.testing.assert_allclose(numbers, found, rtol=1e-5, atol=1e-12)
    assert reader.cells[row + 1] == "N"
    left_out = reader.cells[reader.cells.index("flexible", 40) + 2]
    assert "geometric stiffening" in left_out and "stresses" in left_out
    assert {"numpy", result.versions["numpy"]} <= set(reader.cells)


def test_the_page_needs_no_other_files(filed: tuple[sidtool.Result, Path]) -> None:
    text = filed[1].read_text(encoding="utf-8")
    sources = re.findall(r"(?:src|href)=['\"]([^'\"]*)", text)
    assert all(source.startswith(("data:", "#")) for source in sources)
    assert "@import" not in text and "<script" not in text
    assert len(text) < 500_000


def test_pictures_are_as_large_as_the_mechanism(
    filed: tuple[sidtool.Result, Path],
) -> None:
    """Something is drawn near each of the four edges of one of the three pictures."""
    text = filed[1].read_text(encoding="utf-8")
    found = re.findall(r"data:image/png;base64,([^']+)", text)
    pictures = [imread(io.BytesIO(base64.b64decode(data))) for data in found]
    assert len(pictures) == 3
    ink = np.any([(p[..., :3] < 0.97).any(axis=2) for p in pictures], axis=0)
    for edge in (ink, ink[::-1], ink.T, ink.T[::-1]):
        assert edge[:14].any() and not edge[:10].any()
    assert re.search(r"<p>rod is drawn from [^<]*\(its surface is not known\)", text)


def test_tables_of_outputs_have_units(
    filed: tuple[sidtool.Result, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(filed[1].with_suffix(".h5"))
    assert run(["info", path]) == 0
    assert run(["outputs", path, "--add", "piston.vx,crank_pin.fy"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line]
    units = {row[0]: row[-1] for row in rows if len(row) == 6}
    expected = {"piston.x": "m", "piston.vx": "m/s", "crank_pin.fx": "N"}
    assert expected.items() <= units.items()
    assert (units["output"], units["crank_pin.fy"]) == ("unit", "N")


@pytest.mark.needs("chromium")
def test_a_browser_prints_it(filed: tuple[sidtool.Result, Path]) -> None:
    browser = program("chromium")
    assert browser is not None
    page = filed[1]
    target = page.with_suffix(".pdf")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu"]
    command += [f"--print-to-pdf={target}", str(page)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    data = target.read_bytes()
    pages = re.findall(rb"/Type ?/Page\b", data)
    assert data.startswith(b"%PDF") and 2 <= len(pages) <= 4


@pytest.mark.parametrize("name", ["r.pdf", "r.png", "r.toml"])
def test_other_endings_are_refused(
    name: str, filed: tuple[sidtool.Result, Path], tmp_path: Path
) -> None:
    result = filed[1].with_suffix(".h5")
    assert run(["report", str(result), "-o", str(tmp_path / name)]) == 2
    assert not (tmp_path / name).exists()
