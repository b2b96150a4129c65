"""Results as the tables of pandas and xarray, and as what notebooks show."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.image import imread

import sidtool

G, SPEED = 9.81, 3.0


@pytest.fixture(scope="module")
def result() -> sidtool.Result:
    """A stone thrown upwards."""
    start = sidtool.Initial(position=[0.0, 1.0], velocity=[2.0, SPEED])
    return sidtool.Scene(
        title="thrown",
        dimension="planar",
        gravity=[0.0, -G],
        time=sidtool.Time(end=0.6, output_step=0.05),
        bodies={"stone": sidtool.RigidBody(mass=0.4, initial=start)},
        outputs=sidtool.Outputs(record=["stone.y", "stone.x"]),
    ).simulate()


def test_a_table_of_pandas(result: sidtool.Result) -> None:
    table = result.to_dataframe()
    assert list(table.columns) == ["stone.y", "stone.x"] and table.index.name == "t"
    t = table.index.to_numpy()
    np.testing.assert_array_equal(t, result.t)
    expected = 1.0 + SPEED * t - G * t**2 / 2
    np.testing.assert_allclose(table["stone.y"], expected, atol=1e-8)
    more = result.to_dataframe("stone.v*,stone.x")
    assert list(more.columns) == ["stone.vx", "stone.vy", "stone.x"]
    np.testing.assert_allclose(more["stone.vy"], SPEED - G * t, atol=1e-8)
    assert more.attrs["units"] == {
        "stone.vx": "m/s",
        "stone.vy": "m/s",
        "stone.x": "m",
        "t": "s",
    }
    top = table["stone.y"].idxmax()  # the output time that is nearest to v = 0
    assert abs(top - SPEED / G) <= 0.025
    with pytest.raises(sidtool.InputError, match="brick"):
        result.to_dataframe("brick.x")


def test_a_data_set_of_xarray(result: sidtool.Result) -> None:
    data = result.to_xarray(["stone.y", "stone.ay"])
    assert dict(data.sizes) == {"t": len(result.t)} and data.attrs["title"] == "thrown"
    assert data.t.attrs["units"] == "s"
    assert data["stone.ay"].attrs["units"] == "m/s\N{SUPERSCRIPT TWO}"
    np.testing.assert_allclose(data["stone.ay"], -G, rtol=1e-9)
    # xarray interpolates: the error of a parabola between rows is at most g h^2 / 8
    middle = float(data["stone.y"].interp(t=0.325))
    expected = 1.0 + SPEED * 0.325 - G * 0.325**2 / 2
    assert abs(middle - expected) < G * 0.05**2 / 8 * 1.001
    assert set(result.to_xarray().data_vars) == {"stone.y", "stone.x"}


def test_a_notebook_shows_the_plot(result: sidtool.Result) -> None:
    """IPython asks what a cell ends with for `_repr_png_`."""
    page = result.plot("stone.y")
    picture = imread(io.BytesIO(page._repr_png_()))
    height, width = picture.shape[:2]
    assert (width, height) == tuple(round(x * 100) for x in page.get_size_inches())
    blue = (picture[..., 2] > 0.6) & (picture[..., 0] < 0.2)
    columns = np.flatnonzero(blue.any(axis=0))
    assert len(columns) > 0.8 * width  # the curve crosses the page
    tops = [int(np.flatnonzero(blue[:, c])[0]) for c in columns]
    highest = columns[int(np.argmin(tops))]
    share = (highest - columns[0]) / (columns[-1] - columns[0])
    assert abs(share - SPEED / G / 0.6) < 0.05
