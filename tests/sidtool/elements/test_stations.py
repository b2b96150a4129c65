"""Beams by tables of stations: conventions, closed forms, a published turbine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

import sidtool
from sidtool.beams.station_section import station_sections
from sidtool.cli.main import run
from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.model import ModelFile, beams
from sidtool.formats.model.stations import read_stations, write_stations
from sidtool.importers.openfast import read_openfast
from sidtool.model_derivatives.sid_derivatives import DifferentiableBody
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.places import EXAMPLES
from tests.sidtool.model_derivatives.references import (
    arrays,
    central_difference,
    largest_difference,
)

LENGTH = 8.0
#: A uniform mast; inertia of its own, and centres beside the axis.
UNIFORM = {
    "position": [0.0, LENGTH],
    "mass_per_length": [30.0, 30.0],
    "EA": [2e8, 2e8],
    "EI_y": [4e6, 4e6],
    "EI_z": [1e6, 1e6],
    "GJ": [8e5, 8e5],
    "GA_y": [3e7, 3e7],
    "GA_z": [2e7, 2e7],
    "inertia_y": [0.9, 0.9],
    "inertia_z": [0.4, 0.4],
}
TURBINE = EXAMPLES / "wind_turbine"


def model(
    sections: Any,
    length: float = LENGTH,
    elements: int = 4,
    theory: str | None = "timoshenko",
    **changes: Any,
) -> ModelFile:
    """A beam along x, clamped at its start."""
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [length, 0.0, 0.0],
            "sections": sections,
        },
        "discretisation": {"type": "beam", "elements": elements, "theory": theory},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "edge": "start"},
            "tip": {"node": 2, "edge": "end"},
        },
        "reduction": {"method": "modal", "modes": 6},
    }
    if theory is None:
        del data["discretisation"]["theory"]
    return ModelFile.checked(data | changes, "model")


def tip_compliance(body: FiniteElementModel) -> Array:
    """(6, 6) motion of the tip by forces and moments there, clamped at the root."""
    return np.linalg.inv(body.stiffness.toarray()[6:, 6:])[-6:, -6:]


def frequencies(body: FiniteElementModel, count: int) -> Array:
    """Of the cantilever [Hz]."""
    k, m = body.stiffness.toarray()[6:, 6:], body.mass.toarray()[6:, 6:]
    values = scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=[0, count - 1])
    return np.sqrt(values) / (2 * np.pi)


def matrices(table: dict[str, list[float]]) -> dict[str, Any]:
    """The same stations by matrices about the axis, built from strain energy."""
    stiffness, mass = [], []
    for k in range(len(table["EA"])):
        value = {name: column[k] for name, column in table.items()}
        y, z = value.get("tension_y", 0.0), value.get("tension_z", 0.0)
        ys, zs = value.get("shear_y", 0.0), value.get("shear_z", 0.0)
        stretch = np.array([1, 0, 0, 0, z, -y])
        shear = np.array([[0, 1, 0, -zs, 0, 0], [0, 0, 1, ys, 0, 0]])
        own = value["EA"] * np.outer(stretch, stretch)
        own += value["GA_y"] * np.outer(shear[0], shear[0])
        own += value["GA_z"] * np.outer(shear[1], shear[1])
        stiffness.append(
            own + np.diag([0, 0, 0, value["GJ"], value["EI_y"], value["EI_z"]])
        )
        ym, zm = value.get("mass_y", 0.0), value.get("mass_z", 0.0)
        moved = np.eye(6)[:3].copy()
        moved[:, 3:] = [[0, zm, -ym], [-zm, 0, 0], [ym, 0, 0]]
        tensor = np.zeros((6, 6))
        iy, iz, iyz = (
            value["inertia_y"],
            value["inertia_z"],
            value.get("inertia_yz", 0.0),
        )
        tensor[3:, 3:] = [[iy + iz, 0, 0], [0, iy, -iyz], [0, -iyz, iz]]
        mass.append(value["mass_per_length"] * moved.T @ moved + tensor)
    return {
        "position": table["position"],
        "stiffness": np.array(stiffness).tolist(),
        "mass": np.array(mass).tolist(),
    }


def eccentric() -> dict[str, list[float]]:
    offsets = {
        "mass_y": 0.03,
        "mass_z": -0.05,
        "tension_y": -0.02,
        "tension_z": 0.04,
        "shear_y": 0.06,
        "shear_z": 0.01,
        "inertia_yz": 0.2,
    }
    return UNIFORM | {name: [value, value] for name, value in offsets.items()}


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
    exact = np.trapezoid(table.mass_per_length, at)
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


ELASTODYN = """ELASTODYN blade
Title
      3   NBlInpSt    - Number of stations (-)
    1.1   AdjBlMs     - Factor (-)
    2.0   AdjFlSt     - Factor (-)
    1.0   AdjEdSt     - Factor (-)
    BlFract  PitchAxis  StrcTwst  BMassDen  FlpStff  EdgStff
      (-)       (-)      (deg)     (kg/m)    (Nm^2)   (Nm^2)
 0.0  0.25  10.0  100.0  1.0E+08  2.0E+08
 0.5  0.25   5.0   80.0  0.5E+08  1.0E+08
 1.0  0.25   0.0   50.0  0.2E+08  0.5E+08
---------------------- BLADE MODE SHAPES -----------------
"""


def test_elastodyn_files_become_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Factors, the sign of the twist, flapwise about z, what the file lacks."""
    source, target = tmp_path / "blade.dat", tmp_path / "blade.csv"
    source.write_text(ELASTODYN, encoding="utf-8")
    with pytest.raises(InputError, match="--length"):
        read_openfast(source)
    assert run(["stations", str(source), "-o", str(target), "--length", "20"]) == 0
    printed = capsys.readouterr().out
    assert "PitchAxis" in printed and 'sections = "blade.csv"' in printed
    assert run(["stations", str(target), "--length", "20"]) == 0
    assert 'sections = "blade.csv"' in capsys.readouterr().out
    table = read_stations(target)
    assert_allclose(table.mass_per_length, [110.0, 88.0, 55.0])
    assert_allclose(table.EI_z, [2e8, 1e8, 4e7])
    assert_allclose(table.EI_y, [2e8, 1e8, 5e7])
    assert_allclose(table.twist, -np.radians([10.0, 5.0, 0.0]))
    body = finite_element_model(model(str(target), 20.0, theory="euler_bernoulli"))
    same = finite_element_model(
        model(
            read_openfast(source, 20.0).table.file_data(),
            20.0,
            theory="euler_bernoulli",
        )
    )
    assert_allclose(body.stiffness.toarray(), same.stiffness.toarray())


def test_beamdyn_files_become_tables(tmp_path: Path) -> None:
    """6 x 6 matrices along the key points of a bent axis."""
    own = matrices(eccentric())
    rows = [1, 2, 0, 4, 5, 3]
    blocks = []
    for k, place in enumerate((0.0, 1.0)):
        parts = [
            np.array(own[name][k])[rows][:, rows] for name in ("stiffness", "mass")
        ]
        text = "\n\n".join(
            "\n".join(" ".join(map(repr, r)) for r in p.tolist()) for p in parts
        )
        blocks.append(f"{place}\n{text}")
    (tmp_path / "props.dat").write_text(
        " 2  station_total - stations\n--- Distributed Properties ---\n"
        + "\n\n".join(blocks),
        encoding="utf-8",
    )
    (tmp_path / "primary.dat").write_text(
        "1 member_total - members\n"
        "kp_xr kp_yr kp_zr initial_twist\n (m) (m) (m) (deg)\n"
        "0 0 0 4.0\n0.1 0 4 2.0\n0.4 0 8 0.0\n--- MESH\n"
        '"props.dat"    BldFile - Name of file\n',
        encoding="utf-8",
    )
    found = read_openfast(tmp_path / "primary.dat")
    assert_allclose(found.table.stiffness[::2], own["stiffness"])
    assert_allclose(found.table.mass[::2], own["mass"])
    assert_allclose(found.table.twist, -np.radians([4.0, 2.0, 0.0]))
    assert found.geometry["through"] == [[0.1, 0.0, 4.0]]
    write_stations(tmp_path / "x.csv", found.table, [])
    again = read_stations(tmp_path / "x.csv")
    assert_allclose(again.stiffness[::2], own["stiffness"])
    assert_allclose(again.mass[::2], own["mass"])


def beamdyn_files(folder: Path, twist: list[float]) -> Path:
    """A straight, uniform blade of two stations, with key points of other twists."""
    own = matrices(UNIFORM)
    rows = [1, 2, 0, 4, 5, 3]
    parts = [np.array(own[k][0])[rows][:, rows] for k in ("stiffness", "mass")]
    text = "\n".join(" ".join(map(repr, r)) for part in parts for r in part.tolist())
    (folder / "props.dat").write_text(
        " 2  station_total - stations\n 1  damp_type - Damping type: 0, 1\n"
        "--- DAMPING COEFFICIENT ---\n   mu1 mu2 mu3 mu4 mu5 mu6\n"
        "   (-) (-) (-) (-) (-) (-)\n 0.001 0.001 0.001 0.001 0.001 0.001\n"
        f"--- Distributed Properties ---\n0.0\n{text}\n1.0\n{text}\n",
        encoding="utf-8",
    )
    points = np.linspace(0.0, LENGTH, len(twist))
    lines = [
        f"0 0 {z!r} {phi!r}" for z, phi in zip(points.tolist(), twist, strict=True)
    ]
    path = folder / "primary.dat"
    path.write_text(
        "1 member_total - members\nkp_xr kp_yr kp_zr initial_twist\n"
        " (m) (m) (m) (deg)\n" + "\n".join(lines) + "\n--- MESH\n"
        '"props.dat"    BldFile - Name of file\n',
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize(
    "twist", [[0.0, 30.0, 0.0], [10.0, 10.0, 40.0, 0.0], [0.0, 30.0, 0.0, 0.0, 0.0]]
)
def test_twist_of_key_points_between_stations(
    twist: list[float], tmp_path: Path
) -> None:
    """Two stations, the twist is that of the key points: the same blade by columns."""
    found = read_openfast(beamdyn_files(tmp_path, twist))
    at = np.linspace(0.0, 1.0, len(twist))
    assert_allclose(
        np.interp(at, found.table.fraction, found.table.twist),
        -np.radians(twist),
        atol=1e-12,
    )
    data = {k: [v[0]] * len(at) for k, v in UNIFORM.items() if k != "position"}
    data |= {"fraction": at.tolist(), "twist": (-np.radians(twist)).tolist()}
    bodies = [
        finite_element_model(model(sections, elements=12))
        for sections in (found.table.file_data(), data)
    ]
    assert_allclose(frequencies(bodies[0], 4), frequencies(bodies[1], 4), rtol=1e-9)
    straight = read_openfast(beamdyn_files(tmp_path, [0.0, 5.0, 10.0]))
    assert straight.table.fraction == (0.0, 1.0)


def test_damping_of_openfast_is_named(tmp_path: Path) -> None:
    """A table of stations holds none: the notes name a law that is the same."""
    notes = read_openfast(beamdyn_files(tmp_path, [0.0, 0.0])).notes
    assert any("mu = 0.001" in note and "beta = 0.001" in note for note in notes)
    file = tmp_path / "blade.dat"
    damped = "  0.477   BldFlDmp(1) - Damping (%)\n    BlFract"
    file.write_text(ELASTODYN.replace("    BlFract", damped), encoding="utf-8")
    assert any("ratio = 0.00477" in note for note in read_openfast(file, 20.0).notes)
    file.write_text(ELASTODYN, encoding="utf-8")
    assert not any("damping" in note for note in read_openfast(file, 20.0).notes)


def test_matrices_in_other_units_and_orders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """kN and t are converted; what the command writes has the order it says."""
    own = matrices(eccentric())
    rows = [1, 2, 0, 4, 5, 3]
    units = {"K": ("kN", "kN m", "kN m^2"), "M": ("t/m", "t", "t m")}
    heads, columns = ["position [mm]"], [[0.0, 1e3 * LENGTH]]
    for letter, name in (("K", "stiffness"), ("M", "mass")):
        given = np.array(own[name])[:, rows][:, :, rows]
        for i in range(6):
            for j in range(i, 6):
                unit = units[letter][(i > 2) + (j > 2)]
                heads.append(f"{letter}{i + 1}{j + 1} [{unit}]")
                columns.append((given[:, i, j] / 1e3).tolist())
    lines = [
        ",".join(heads),
        *(",".join(map(repr, row)) for row in zip(*columns, strict=True)),
    ]
    file, target = tmp_path / "bd.csv", tmp_path / "own.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    words = ["stations", str(file), "--order", "beamdyn", "-o", str(target)]
    assert run(words) == 0
    assert 'sections = "own.csv"' in capsys.readouterr().out
    table = read_stations(target)
    assert_allclose(table.stiffness, own["stiffness"], rtol=1e-12)
    assert_allclose(table.mass, own["mass"], rtol=1e-12)
    file.write_text(
        "\n".join(lines).replace("K11 [kN]", "K11 [kN m]"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="K11"):
        read_stations(file)


HEADER = (
    "position [m],mass_per_length [t/m],EA [MN],EI_y [kN m^2],EI_z [Nm^2],"
    "GJ [N*m\u00b2]"
)


def test_units_of_a_header(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text(f"# mast\n{HEADER}\n0,1,2,3,4,5\n2,1,2,3,4,5\n", encoding="utf-8")
    table = read_stations(file)
    values = (table.mass_per_length, table.EA, table.EI_y, table.EI_z, table.GJ)
    assert_allclose(np.array(values)[:, 0], [1e3, 2e6, 3e3, 4.0, 5.0])
    file.write_text(
        "position [%];mass_per_length;EA;EI_y;EI_z;GJ;twist [deg]\n"
        "0;1;2;3;4;5;90\n100;1;2;3;4;5;0\n",
        encoding="utf-8",
    )
    table = read_stations(file)
    assert table.fraction == (0.0, 1.0)
    assert table.twist[0] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("position [m],EA [kg]\n0,1\n1,1", "EA [kg]: has the unit 'kg'"),
        ("position,EAA\n0,1\n1,1", "EAA: is no column of stations; expected EA"),
        ("position,EA\n0,1\n1,x", "row 1,x: found 'x'"),
        ("position,EA\n0,1\n1", "row 1: has 1 cells; expected 2"),
        ("position,EA\n0,1\n1,1", "has no mass_per_length, EI_y, EI_z, GJ"),
        ("position,EA,EA\n0,1,1\n1,1,1", "EA: appears twice"),
        ("position,EA\n0,1", "has 1 stations"),
        (f"{HEADER}\n0,1,2,3,4,5\n2,1,2,3,4,0", "GJ: is 0 at a station"),
        (f"{HEADER}\n1,1,2,3,4,5\n2,1,2,3,4,5", "position: runs from 1 to 2"),
        (f"{HEADER}\n0,1,2,3,4,5\n2,1,2,3,4,5\n1,1,2,3,4,5", "position: decreases"),
    ],
)
def test_tables_that_are_not_sound(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_stations(file)
    assert str(caught.value).startswith(f"{file}: {expected}")


def test_models_that_contradict_their_tables() -> None:
    with pytest.raises(InputError, match="needs"):
        table = {k: v for k, v in UNIFORM.items() if not k.startswith("GA")}
        finite_element_model(model(table))
    with pytest.raises(InputError, match="8 m, but the axis of the beam is 9 m"):
        finite_element_model(model(UNIFORM, 9.0))
    with pytest.raises(InputError, match="material"):
        steel = {"youngs_modulus": 1.0, "poissons_ratio": 0.3, "density": 1.0}
        model(UNIFORM, material=steel)
    with pytest.raises(InputError, match="section"):
        beams.BeamGeometry(start=[0, 0, 0], end=[1, 0, 0])
    with pytest.raises(InputError, match="mass matrix of a thin slice"):
        wrong = matrices(UNIFORM)
        wrong["mass"][0][1][1] = 31.0
        finite_element_model(model(wrong))
    geometry = model(UNIFORM | {"twist": [0.0, 0.5]}).geometry
    assert isinstance(geometry, beams.BeamGeometry)
    turned = geometry.model_copy(update={"twist": 0.25})
    assert_allclose(
        station_sections(turned, LENGTH).twist(np.array([0.0, 1.0])), [0.25, 0.75]
    )


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
