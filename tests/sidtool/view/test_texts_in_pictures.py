"""Texts in pictures appear exactly as written."""

from __future__ import annotations

import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

import sidtool
from sidtool.plot.figure import saved_figure, use_log_scale
from sidtool.plot.studies import plot_precision
from sidtool.view.html_report import write_report

#: Mathematics for matplotlib, wrong and right; letters that no font of it has; control
#: characters; the byte of a name that is not UTF-8.
ODD = {
    "wrong": "a $x^$ b",
    "right": "$x_1$ and $y$",
    "one": "5 $",
    "escaped": r"\$5 and \frac",
    "han": "曲柄滑块 \U0001f600",
    "control": "bell \x07, escape \x1b[31m, \x85",
    "byte": "name \udcff",
}


def texts(path: Path) -> list[str]:
    root = ElementTree.fromstring(path.read_bytes())
    return ["".join(part.itertext()) for part in root.iter() if "text" in part.tag]


def flying(title: str) -> sidtool.Result:
    scene = sidtool.Scene(
        title="stone",
        dimension="planar",
        time=sidtool.Time(end=0.1, output_step=0.05),
        bodies={"stone": sidtool.RigidBody(mass=1.0)},
        outputs=sidtool.Outputs(record=["stone.x", "stone.y"]),
    )
    result = scene.simulate()
    object.__setattr__(result, "title", title)
    return result


def test_titles_are_no_mathematics(tmp_path: Path) -> None:
    title = " ".join(ODD.values())
    result = flying(title)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        for kind in ("png", "svg"):
            result.plot("stone.x", path=tmp_path / f"p.{kind}")
        write_report(tmp_path / "r.html", result, {}, tmp_path)
    for character in "\x07\x1b\x85\udcff":
        title = title.replace(character, "?")
    found = [text.split() for text in texts(tmp_path / "p.svg")]
    assert any(set(title.split()) >= set(words) for words in found if len(words) > 5)
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert not set(page) & set("\x07\x1b\x85\udcff")


def test_labels_are_no_mathematics(tmp_path: Path) -> None:
    points = {text: [(1e-3, 1.0), (1e-9, 30.0)] for text in ODD.values()}
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        plot_precision(tmp_path / "p.svg", points, ODD["wrong"])
    found = texts(tmp_path / "p.svg")
    for odd in ODD.values():
        times = 2 if odd == ODD["wrong"] else 1
        assert sum(odd[:4] in text for text in found) >= times


def test_powers_of_ten_are_characters(tmp_path: Path) -> None:
    with saved_figure(tmp_path / "p.svg", size=(4.0, 3.0)) as axes:
        axes.plot([1.0, 2.0], [3e-7, 2e4])
        use_log_scale(axes.yaxis)
    found = texts(tmp_path / "p.svg")
    powers = [text for text in found if text.startswith("10")]
    assert {"10⁻⁶", "10⁰", "10³"} & set(powers) and len(powers) > 3
    assert not [text for text in found if set(text) & set("${}\\^")]
    with saved_figure(tmp_path / "q.svg", size=(4.0, 3.0)) as axes:
        axes.plot([1.0, 2.0], np.array([2e-4, 7e-4]))
        use_log_scale(axes.yaxis)
    assert "2×10⁻⁴" in "".join(texts(tmp_path / "q.svg")).replace(" ", "")
