"""Sections and twist of beams between their stations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg as spla
from numpy.testing import assert_allclose
from scipy.integrate import quad

from sidtool.beams.axis import beam_axis
from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model

E, NU, RHO, LENGTH, WIDTH = 2e11, 0.3, 7850.0, 10.0, 0.1
STEP = [0.5] * 6 + [0.25] * 5


def model(elements: int, **geometry: Any) -> ModelFile:
    """A straight beam along x of rectangular section, clamped at its start."""
    section = {"shape": "rectangle", "height": geometry.pop("height"), "width": WIDTH}
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": E, "poissons_ratio": NU, "density": RHO},
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [LENGTH, 0.0, 0.0],
            "section": section,
            **geometry,
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0]},
            "tip": {"node": 2, "parameters": [1]},
        },
        "reduction": {"method": "modal", "modes": 4},
    }
    return validate_data(data, ModelFile)


def integral(function: Any, stations: int) -> float:
    """Over the length, with corners at the stations."""
    edges = np.linspace(0.0, LENGTH, stations)
    parts = zip(edges[:-1], edges[1:], strict=True)
    return float(sum(quad(function, a, b, epsabs=0, epsrel=1e-12)[0] for a, b in parts))


@pytest.mark.parametrize("elements", [1, 7])
@pytest.mark.parametrize("heights", [STEP, [0.5, 0.2], [0.3, 0.5, 0.1, 0.4]])
def test_linear_stations_weigh_and_yield_as_their_lines(
    heights: list[float], elements: int
) -> None:
    """Mass, centre, and by unit load the stretch and the deflection of the end."""

    def height(x: float) -> float:
        return float(np.interp(x, np.linspace(0.0, LENGTH, len(heights)), heights))

    n = len(heights)
    body = finite_element_model(model(elements, height=heights))
    mass = RHO * WIDTH * integral(height, n)
    assert body.geometry_mass is not None
    found = body.geometry_mass()
    assert found.mass == pytest.approx(mass, rel=1e-12)
    first = RHO * WIDTH * integral(lambda x: x * height(x), n)
    assert_allclose(found.first, [first, 0.0, 0.0], rtol=1e-12, atol=1e-9 * first)
    sid = sid_from_model(model(elements, height=heights))
    assert sid.mass == pytest.approx(mass, rel=1e-12)
    free = np.arange(6, body.ndof)
    solve = spla.factorized(body.stiffness[free][:, free].tocsc())
    stretch, deflection = np.zeros((2, len(free)))
    stretch[-6] = deflection[-5] = 1.0
    expected = integral(lambda x: 1.0 / (E * WIDTH * height(x)), n)
    assert solve(stretch)[-6] == pytest.approx(expected, rel=2e-4)
    arm = integral(lambda x: 12 * (LENGTH - x) ** 2 / (E * WIDTH * height(x) ** 3), n)
    assert solve(deflection)[-5] == pytest.approx(
        arm, rel=5e-3 if elements == 1 else 2e-4
    )


def test_other_interpolations_are_on_request() -> None:
    """A parabola through three; a spline through more stays near its points."""
    heights, f = [0.06, 0.03, 0.06], np.linspace(0.0, 1.0, 11)
    parabola = 0.06 - 0.12 * f + 0.12 * f**2
    for interpolation in ("polynomial", "smooth"):
        sid = sid_from_model(model(8, height=heights, interpolation=interpolation))
        exact = RHO * WIDTH * LENGTH * 0.04
        assert sid.mass == pytest.approx(exact, rel=1e-12)
    twisted = model(8, height=0.1, twist=heights, interpolation="polynomial")
    assert_allclose(beam_axis(twisted.geometry).twist(f), parabola, rtol=1e-12)
    smooth = model(8, height=STEP, interpolation="smooth")
    lines = RHO * WIDTH * LENGTH * 0.3875
    assert sid_from_model(smooth).mass == pytest.approx(lines, rel=2e-3)


def test_twist_is_linear_between_its_stations() -> None:
    """Half a beam turns by 0.6 rad, half does not."""
    axis = beam_axis(model(4, height=0.1, twist=[0.0, 0.6, 0.6]).geometry)
    frames = axis.at(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    angles = np.arctan2(frames.axes[:, 1, 2], frames.axes[:, 1, 1])
    assert_allclose(angles, [0.0, 0.3, 0.6, 0.6, 0.6], atol=1e-12)
    assert_allclose(frames.curvatures[[1, 3], 0], [0.6 / 5.0, 0.0], atol=1e-12)


def test_elements_end_at_stations() -> None:
    """As many as requested where they fit, and at least one between two stations."""
    fitting = finite_element_model(model(60, height=STEP))
    assert_allclose(fitting.positions[:, 0], np.linspace(0.0, LENGTH, 61), atol=1e-12)
    few = finite_element_model(model(1, height=[0.3, 0.5, 0.1, 0.4]))
    assert_allclose(few.positions[:, 0], np.linspace(0.0, LENGTH, 4), atol=1e-12)


@pytest.mark.parametrize("geometry", [{"height": []}, {"height": 0.1, "twist": []}])
def test_no_station_at_all_is_refused(geometry: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="geometry"):
        model(4, **geometry)


def test_a_polynomial_that_swings_below_zero_is_named() -> None:
    heights = [0.5] * 6 + [0.02] * 6
    with pytest.raises(InputError, match="becomes -") as caught:
        sid_from_model(model(8, height=heights, interpolation="polynomial"))
    assert "linear" in str(caught.value)
    sid_from_model(model(8, height=heights))
