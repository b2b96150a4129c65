"""Estimated errors are drawn as bands around the curves that they belong to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

import sidtool
from sidtool.formats.result import AccuracyReport, OutputError, Result
from sidtool.plot.results import draw_result

NAMES = ("bob.x", "bob.y", "pin.angle", "energy.kinetic")
#: Tables of a pendulum whose error is that of a loose tolerance.
PENDULUM: dict[str, Any] = {
    "dimension": "planar",
    "gravity": [0.0, -9.81],
    "time": {"end": 3.0, "output_step": 0.1},
    "bodies": {
        "bob": {
            "mass": 2.0,
            "inertia": 0.3,
            "markers": {"pin": {"position": [0.0, 0.7]}},
            "initial": {"position": [0.7, 0.0], "angle": np.pi / 2},
        }
    },
    "joints": {"pin": {"type": "revolute", "markers": ["ground", "bob.pin"]}},
    "outputs": {"record": list(NAMES)},
}


def pendulum(**more: Any) -> sidtool.Result:
    return sidtool.Scene(**PENDULUM).simulate(**more)


@pytest.fixture(scope="module")
def certified() -> sidtool.Result:
    return pendulum(accuracy=1e-2)


def bands(result: Result, kind: str = "outputs") -> dict[str, tuple[Any, Any, Any]]:
    """By the name in the legend before the error: times, lower and upper edge."""
    page, _ = draw_result(result, kind)
    found = {}
    for axes in page.axes:
        filled = [c for c in axes.collections if isinstance(c, PolyCollection)]
        lines = [x for x in axes.get_lines() if "±" in str(x.get_label())]
        assert len(filled) == len(lines)
        for line, band in zip(lines, filled, strict=True):
            corners = band.get_paths()[0].vertices
            t = np.asarray(line.get_xdata())
            edges = [
                np.array([f(corners[corners[:, 0] == x, 1]) for x in t])
                for f in (np.min, np.max)
            ]
            name = str(line.get_label()).partition(" ± ")[0]
            found[name] = (t, *edges)
            assert np.allclose(sum(edges) / 2, line.get_ydata(), atol=1e-12)
    return found


def test_the_true_motion_runs_inside_the_bands(certified: sidtool.Result) -> None:
    truth = pendulum(integrator="dop853", rtol=1e-12)
    found = bands(certified)
    assert set(found) == set(NAMES)
    for name, (t, low, high) in found.items():
        rows = [int(np.argmin(np.abs(t - x))) for x in truth.t]
        assert np.allclose(t[rows], truth.t, atol=1e-12)
        assert (low[rows] <= truth[name]).all() and (truth[name] <= high[rows]).all()
        relative = (high - low) / 2 / np.ptp(truth[name])
        assert np.allclose(relative, certified.error[name], rtol=1e-2)


def test_the_page_contains_the_errors_of_its_curves(
    certified: sidtool.Result, tmp_path: Path
) -> None:
    for result in (certified, pendulum()):
        result.animate(tmp_path / "m.html")
        text = (tmp_path / "m.html").read_text(encoding="utf-8")
        report = result.accuracy
        errors = {} if report is None else report.absolute()
        assert text.count('id="FillBetweenPolyCollection') == len(errors)
        for name, error in errors.items():
            assert f"{name} ± {error:.1e}" in text


@pytest.mark.parametrize("errors", [(0.25, 0.0), (3e-4, 0.5)])
def test_a_band_is_as_wide_as_the_error_that_the_result_holds(
    certified: sidtool.Result, errors: tuple[float, float]
) -> None:
    report = certified.accuracy
    assert report is not None
    outputs = tuple(
        OutputError(name=name, error=error, variation=1.0, allowed=1.0)
        for name, error in zip(("bob.y", "energy.kinetic"), errors, strict=True)
    )
    other = AccuracyReport(**dict(report) | {"outputs": outputs})
    result = replace(certified, accuracy=other)
    told = {o.name: o.error for o in outputs if o.error}
    found = bands(result)
    assert set(found) == set(told)  # nothing is drawn where no error is known
    for name, (_, low, high) in found.items():
        assert np.allclose(high - low, 2 * told[name], rtol=1e-12)
    kinetic = bands(result, "energy")
    assert set(kinetic) == ({"kinetic"} if errors[1] else set())


def test_results_without_an_estimate_have_no_bands(tmp_path: Path) -> None:
    result = pendulum()
    assert not bands(result)
    page = result.plot("bob.x", path=tmp_path / "x.svg")
    assert page.axes[0].get_legend() is None
    assert "±" not in (tmp_path / "x.svg").read_text(encoding="utf-8")
