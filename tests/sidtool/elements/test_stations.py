"""Beams by tables of stations: conventions, closed forms, a published turbine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

import sidtool
from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import ModelFile
from sidtool.formats.model.stations import read_stations
from sidtool.model_derivatives.sid_derivatives import DifferentiableBody
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.places import EXAMPLES
from tests.sidtool.model_derivatives.references import (
    arrays,
    central_difference,
    largest_difference,
)

from .station_tables import (
    LENGTH,
    UNIFORM,
    eccentric,
    frequencies,
    matrices,
    model,
    tip_compliance,
)

TURBINE = EXAMPLES / "wind_turbine"


def test_a_uniform_table_is_the_beam_of_its_section() -> None:
    """Steel of a general section, by its material and by stations."""
    e, g, rho = 2e11, 8e10, 8000.0
    section = {"shape": "general", "area": 0.01, "iy": 2e-5, "iz": 8e-6}
    section |= {"torsion": 1.5e-5, "shear_y": 0.7, "shear_z": 0.6}
    values = {
        "mass_per_length": rho * 0.01,
        "EA": e * 0.01,
        "EI_y": e * 2e-5,
        "EI_z": e * 8e-6,
        "GJ": g * 1.5e-5,
        "GA_y": g * 0.007,
        "GA_z": g * 0.006,
    }
    table: dict[str, Any] = {name: [value, value] for name, value in values.items()}
    data = model(table | {"fraction": [0.0, 1.0]}).file_data()
    by_stations = sid_from_model(model(table | {"fraction": [0.0, 1.0]}, stiffening={}))
    data["geometry"].pop("sections")
    data["geometry"]["section"] = section
    data["material"] = {"youngs_modulus": e, "poissons_ratio": 0.25, "density": rho}
    by_shape = sid_from_model(ModelFile.checked(data | {"stiffening": {}}, "model"))
    for name, block in by_shape.blocks.items():
        other = by_stations.blocks[name]
        scale = max(np.abs(block.m0).max(), 1e-12)
        assert_allclose(other.m0, block.m0, atol=1e-7 * scale, err_msg=name)
        if block.m1 is not None:
            scale = max(np.abs(block.m1).max(), 1e-12)
            assert_allclose(other.m1, block.m1, atol=1e-7 * scale, err_msg=name)


@pytest.mark.parametrize("theory", ["timoshenko", "euler_bernoulli"])
def test_forces_at_the_axis_bend_and_twist_about_the_centres(theory: str) -> None:
    """Closed forms of a cantilever whose centres lie beside its axis."""
    table = eccentric()
    compliance = tip_compliance(finite_element_model(model(table, theory=theory)))
    value = {name: column[0] for name, column in table.items()}
    y, z = value["tension_y"], value["tension_z"]
    ys, zs = value["shear_y"], value["shear_z"]
    by_y, by_z, twist = (
        LENGTH / value["EI_y"],
        LENGTH / value["EI_z"],
        LENGTH / value["GJ"],
    )
    assert compliance[0, 0] == pytest.approx(
        LENGTH / value["EA"] + z**2 * by_y + y**2 * by_z
    )
    assert compliance[4, 0] == pytest.approx(-z * by_y)
    assert compliance[5, 0] == pytest.approx(y * by_z)
    assert compliance[3, 1] == pytest.approx(zs * twist)
    assert compliance[3, 2] == pytest.approx(-ys * twist)
    shear = LENGTH / value["GA_y"] if theory == "timoshenko" else 0.0
    assert compliance[1, 1] == pytest.approx(
        LENGTH**3 / (3 * value["EI_z"]) + zs**2 * twist + shear
    )


def test_eccentric_mass_enters_the_integrals() -> None:
    """Mass, centre and inertia of a bar that is a slice at every place."""
    table = eccentric()
    sid = sid_from_model(model(table))
    m, y, z = 30.0 * LENGTH, 0.03, -0.05
    assert sid.mass == pytest.approx(m)
    assert_allclose(sid.blocks["mdCM"].m0[:, 0], [m * LENGTH / 2, m * y, m * z])
    xx = LENGTH * 1.3 + m * (y**2 + z**2)
    yy = LENGTH * 0.9 + m * (LENGTH**2 / 3 + z**2)
    zz = LENGTH * 0.4 + m * (LENGTH**2 / 3 + y**2)
    xy, xz = -m * LENGTH / 2 * y, -m * LENGTH / 2 * z
    yz = -LENGTH * 0.2 - m * y * z
    assert_allclose(sid.blocks["J"].m0[:, 0], [xx, yy, zz, xy, xz, yz])


@pytest.mark.parametrize("theory", ["timoshenko", "euler_bernoulli"])
def test_matrices_are_the_columns_in_other_words(theory: str) -> None:
    table = eccentric() | {"twist": [0.0, 0.6]}
    columns = finite_element_model(model(table, theory=theory))
    by_matrix = matrices(table) | {"twist": [0.0, 0.6]}
    same = finite_element_model(model(by_matrix, theory=theory))
    for name in ("stiffness", "mass"):
        one, other = (getattr(body, name).toarray() for body in (columns, same))
        assert_allclose(other, one, rtol=1e-9, atol=1e-10 * np.abs(one).max())


@pytest.mark.parametrize("by", ["matrices", "columns", "areas", "neither"])
def test_sections_that_state_shear_stiffness_shear(by: str) -> None:
    """Tip under a force along y: F L^3 / 3 EI_z + F L / GA_y where GA_y is stated; a
    short mast, whose shear is 40 % of it. `theory` chooses otherwise.
    """
    length = 1.0
    changes: dict[str, Any] = {}
    table = UNIFORM | {"position": [0.0, length]}
    sections: Any = matrices(table) if by == "matrices" else table
    if by == "areas":
        e, g, area = 2.1e11, 2.1e11 / 2.6, 1e-3
        sections = {"shape": "general", "area": area, "shear_y": 3e7 / (g * area)}
        sections |= {"iy": 4e6 / e, "iz": 1e6 / e}
        steel = {"youngs_modulus": e, "poissons_ratio": 0.3, "density": 7850.0}
        axis = {"start": [0.0, 0.0, 0.0], "end": [length, 0.0, 0.0]}
        geometry = axis | {"type": "beam", "section": sections}
        changes = {"material": steel, "geometry": geometry}
    elif by == "neither":
        sections = {k: v for k, v in table.items() if not k.startswith("GA")}
    for theory in (None, "euler_bernoulli", "timoshenko"):
        if by == "neither" and theory == "timoshenko":
            continue
        body = finite_element_model(model(sections, length, theory=theory, **changes))
        force = np.zeros(body.ndof)
        force[-5] = 1.0
        free = slice(6, None)
        tip = np.linalg.solve(body.stiffness.toarray()[free, free], force[free])[-5]
        shears = theory == "timoshenko" or (theory is None and by != "neither")
        exact = length**3 / 3e6 + shears * length / 3e7
        assert tip == pytest.approx(exact, rel=1e-9)


def test_orders_of_other_programs_permute_rows() -> None:
    """x, y, z with z along the beam, forces before moments."""
    own = matrices(eccentric())
    rows = [1, 2, 0, 4, 5, 3]  # their rows from ours
    permuted = {
        name: np.array(own[name])[:, rows][:, :, rows].tolist()
        for name in ("stiffness", "mass")
    }
    first = finite_element_model(model(own))
    second = finite_element_model(model(own | permuted | {"order": "beamdyn"}))
    for name in ("stiffness", "mass"):
        one, other = (getattr(body, name).toarray() for body in (first, second))
        assert_allclose(other, one, rtol=1e-12, atol=1e-12 * np.abs(one).max())


def test_linear_stiffness_bends_as_its_closed_form() -> None:
    """EI from 4 to 1: deflection of a tip force F, integral of (L - x)^2 / EI."""
    table = UNIFORM | {"EI_z": [4e6, 1e6]}
    found = tip_compliance(
        finite_element_model(model(table, elements=6, theory="euler_bernoulli"))
    )[1, 1]
    # s = L - x from the tip, EI = a + b s: (s / b) (s / 2 - a / b) + a^2 / b^3 ln(...)
    a, b = 1e6, 3e6 / LENGTH
    exact = LENGTH / b * (LENGTH / 2 - a / b) + a**2 / b**3 * np.log(4.0)
    assert found == pytest.approx(exact, rel=1e-9)


def test_two_stations_at_one_position_are_a_step() -> None:
    table = {
        "position": [0.0, 2.0, 2.0, LENGTH],
        **{
            name: [values[0]] * 2 + [values[0] / 2] * 2
            for name, values in UNIFORM.items()
            if name != "position"
        },
    }
    body = finite_element_model(model(table, elements=1))
    assert_allclose(body.positions[:, 0], [0.0, 2.0, LENGTH])
    assert sid_from_model(model(table)).mass == pytest.approx(30.0 * (2.0 + 3.0))
    stretch = 2.0 / 2e8 + 6.0 / 1e8
    assert tip_compliance(body)[0, 0] == pytest.approx(stretch)


def wedge_frequency(ratio: float) -> float:
    """First k^2 of a cantilever wedge, from height 1 to `ratio` at its tip.

    H. Mabie, C. Rogers, J. Acoust. Soc. Am. 51, 1972. With x from the apex of the
    wedge, clamped at x = 1, deflections are C_1(z) / z, Bessel functions of
    z = 2 k sqrt(x); slope, moment and shear force hold C_2, C_3 and C_2.
    """
    tip_at = np.sqrt(ratio)

    def determinant(k: float) -> float:
        root, tip = 2 * k, 2 * k * tip_at
        rows = [
            [jv(1, root), yv(1, root), iv(1, root), kv(1, root)],
            [jv(2, root), yv(2, root), -iv(2, root), kv(2, root)],
            [jv(3, tip), yv(3, tip), iv(3, tip), kv(3, tip)],
            [jv(2, tip), yv(2, tip), iv(2, tip), -kv(2, tip)],
        ]
        return float(np.linalg.det(np.array(rows)))

    grid = np.linspace(1.5, 5.0, 100)
    values = [determinant(k) for k in grid]
    first = next(k for k in range(99) if values[k] * values[k + 1] < 0)
    return float(brentq(determinant, grid[first], grid[first + 1], xtol=1e-12)) ** 2


def test_a_wedge_by_its_stations_converges_with_their_square() -> None:
    """EI is cubic in a wedge; chords between stations are too stiff by h^2."""
    ratio = 0.25
    exact = wedge_frequency(ratio)
    assert wedge_frequency(1e-5) == pytest.approx(5.315, abs=1e-3)  # Kirchhoff 1879
    errors = []
    for count in (9, 17):
        x = np.linspace(1.0, ratio, count)
        table = {
            "position": 1.0 - x,
            "mass_per_length": x,
            "EA": 1e4 * x,
            "EI_y": 50 * x**3,
            "EI_z": x**3,
            "GJ": 50 * x,
            "inertia_y": 1e-8 * x,
            "inertia_z": 1e-8 * x,
        }
        sections = {name: values.tolist() for name, values in table.items()}
        body = finite_element_model(
            model(sections, 1.0 - ratio, elements=16, theory="euler_bernoulli")
        )
        errors.append(2 * np.pi * frequencies(body, 1)[0] / exact - 1)
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.05)
    assert 0 < errors[1] < 2e-3


def published_rule(positions: Array, values: Array) -> tuple[float, float, float]:
    """Mass, first and second moment by the 17 blade elements of NREL/TP-500-38060.

    Table 3-1 there: radii of their middles from the axis of rotation, 1.5 m inside of
    the blade root.
    """
    middles = [
        2.8667,
        5.6,
        8.3333,
        *np.arange(11.75, 53.0, 4.1),
        56.1667,
        58.9,
        61.6333,
    ]
    lengths = [2.7333] * 3 + [4.1] * 11 + [2.7333] * 3
    r = np.array(middles) - 1.5
    parts = np.interp(r, positions, values) * lengths
    return parts.sum(), parts @ r, parts @ r**2


def test_the_blade_of_the_5_mw_turbine_has_its_published_mass_and_moments() -> None:
    """17 740 kg, 363 231 kg m, 11 776 047 kg m^2, table 2-2 of NREL/TP-500-38060.

    They belong to values at the middles of 17 elements; linear between the stations of
    the same table, the blade has 0.7 % less.
    """
    table = read_stations(TURBINE / "blade_stations.csv")
    at = 61.5 * np.array(table.fraction)
    published = published_rule(at, np.array(table.mass_per_length))
    assert_allclose(published, (17740.0, 363231.0, 11776047.0), rtol=5e-6)
    sid = sid_from_model(model(table.file_data(), 61.5, theory="euler_bernoulli"))
    exact = trapezoid(table.mass_per_length, at)
    assert sid.mass == pytest.approx(exact, rel=1e-12)
    assert sid.mass == pytest.approx(17740.0, rel=8e-3)
    assert sid.blocks["mdCM"].m0[0, 0] / sid.mass == pytest.approx(20.475, rel=3e-3)
    assert sid.blocks["J"].m0[2, 0] == pytest.approx(11776047.0, rel=8e-3)


def twisted_beam_frequencies(table: Any, length: float, count: int) -> Array:
    """An independent cantilever [Hz]: Ritz's method with polynomials as moments.

    Bending in two directions, no shear, no rotary inertia; EI, twist and mass linear
    between stations. Curvatures are moments over EI, deflections their integrals by
    the trapezoidal rule on a fine grid.
    """
    stations = length * np.array(table.fraction)
    x = np.union1d(np.linspace(0.0, length, 6001), stations)
    ei_y, ei_z, twist, mass = (
        np.interp(x, stations, column)
        for column in (table.EI_y, table.EI_z, table.twist, table.mass_per_length)
    )
    moments = np.polynomial.legendre.legvander(2 * x / length - 1, 9)
    axes = np.array([[np.cos(twist), np.sin(twist)], [-np.sin(twist), np.cos(twist)]])
    flexible = np.einsum("kap,kp,kbp->abp", axes, np.array([1 / ei_z, 1 / ei_y]), axes)
    curvature = np.einsum("abp,pj->pabj", flexible, moments)
    slope, deflection = curvature.copy(), curvature.copy()
    for source, target in ((curvature, slope), (slope, deflection)):
        steps = (source[1:] + source[:-1]) / 2 * np.diff(x)[:, None, None, None]
        target[0], target[1:] = 0.0, np.cumsum(steps, axis=0)
    weights = np.gradient(x)
    weights[[0, -1]] /= 2
    k = np.einsum("p,pj,pabl->ajbl", weights, moments, curvature)
    m = np.einsum("p,pcaj,pcbl->ajbl", weights * mass, deflection, deflection)
    size = 2 * moments.shape[1]
    values = scipy.linalg.eigh(
        k.reshape(size, size), m.reshape(size, size), eigvals_only=True
    )
    return np.sqrt(values[:count]) / (2 * np.pi)


def test_the_blade_of_the_5_mw_turbine_has_its_frequencies() -> None:
    """Against polynomials as moments, and pyBModes 1.19.1 for the same table.

    pyBModes takes constant values within its elements.
    """
    table = read_stations(TURBINE / "blade_stations.csv")
    light = {"inertia_y": [0.01] * 49, "inertia_z": [0.01] * 49}
    slender = model(table.file_data() | light, 61.5, theory="euler_bernoulli")
    found = frequencies(finite_element_model(slender), 5)
    assert_allclose(found, twisted_beam_frequencies(table, 61.5, 5), rtol=2e-5)
    assert_allclose(found, [0.67701, 1.08583, 1.95418, 4.00722, 4.55399], rtol=1.1e-3)


def test_the_tower_of_the_5_mw_turbine_has_its_mass_and_frequency() -> None:
    """347 460 kg; 0.891 Hz and 4.35 Hz without head (tube of linear diameter)."""
    table = read_stations(TURBINE / "tower_stations.csv")
    tower = model(table.file_data(), 87.6, elements=10, theory="euler_bernoulli")
    sid = sid_from_model(tower)
    assert sid.mass == pytest.approx(347460.0, rel=1e-5)
    x = np.linspace(0.0, 87.6, 11)
    outer, wall = 6.0 - 2.13 * x / 87.6, 0.0351 - 0.0104 * x / 87.6
    area = np.pi * (outer - wall) * wall
    bend = np.pi / 64 * (outer**4 - (outer - 2 * wall) ** 4)
    assert_allclose(table.mass_per_length, 8500.0 * area, rtol=2e-6)
    assert_allclose(table.EI_y, 2.1e11 * bend, rtol=5e-6)  # six digits
    found = frequencies(finite_element_model(tower), 4)
    assert_allclose(found, [0.8905, 0.8905, 4.3507, 4.3507], rtol=1e-4)


def test_bodies_have_derivatives_by_the_columns() -> None:
    """Complex steps through the table against differences of sixth order."""
    table = eccentric() | {"twist": [0.0, 0.6], "EI_z": [1e6, 6e5]}
    mast = model(table, reduction={"method": "modal", "modes": 3})
    for name in ("geometry.sections.EI_z[1]", "geometry.sections.mass_y[0]"):
        found = sidtool.sid_derivatives(mast, [name])
        expected = central_difference(
            mast, name, lambda m: arrays(DifferentiableBody(m).sid)
        )
        unit = found.variables[name]
        error = largest_difference(found[name], expected, found.sid, unit)
        assert error < (1e-6, "")
    with pytest.raises(InputError, match="positions of stations"):
        sidtool.sid_derivatives(mast, ["geometry.sections.position[1]"])
