"""Named cross-sections against tables of steel sections and closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg

from sidtool.beams.section_shapes import NamedProperties, named_properties
from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import beams

from ..beams import beam

CM, INCH = 0.01, 0.0254
#: In cm: area, moments about the axes across and along the web, torsion constant.
#: EN 10365 (IPE, UPE) and EN 10056 (L, in principal axes), ArcelorMittal's tables;
#: W10x49 from the AISC Manual, in inches. Angles of tables have round toes, ours not.
#: Tolerances of moments and of torsion: tables round, and compute torsion otherwise.
TABLES: dict[str, tuple[Any, float, tuple[float, ...], tuple[float, float]]] = {
    "IPE 200": (
        beams.ISection(height=0.2, width=0.1, web=0.0056, flange=0.0085, fillet=0.012),
        CM,
        (28.48, 1943.0, 142.4, 6.98),
        (5e-4, 0.01),
    ),
    "W10x49": (
        beams.ISection(
            height=9.98 * INCH,
            width=10.0 * INCH,
            web=0.34 * INCH,
            flange=0.56 * INCH,
            fillet=0.5 * INCH,
        ),
        INCH,
        (14.4, 272.0, 93.4, 1.39),
        (2e-3, 0.01),
    ),
    "UPE 200": (
        beams.CSection(height=0.2, width=0.08, web=0.006, flange=0.011, fillet=0.013),
        CM,
        (29.0, 1909.0, 187.3, 8.89),
        (2e-3, 0.04),
    ),
    "L 100x100x10": (
        beams.LSection(height=0.1, width=0.1, thickness=0.01, fillet=0.012),
        CM,
        (19.15, 280.7, 72.65, 6.97),
        (0.035, 0.04),
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_steel_sections(name: str) -> None:
    section, unit, expected, (of_moments, of_torsion) = TABLES[name]
    found = named_properties(section, 0.3)
    moments = sorted([found.iy, found.iz], reverse=True)
    values = [found.area / unit**2, *(m / unit**4 for m in moments)]
    assert values == pytest.approx(expected[:3], rel=of_moments)
    assert found.torsion / unit**4 == pytest.approx(expected[3], rel=of_torsion)


def test_centroid_and_shear_centre_of_a_channel() -> None:
    """UPE 200: centroid 2.56 cm from the back, shear centre 5.41 cm from it."""
    found = named_properties(TABLES["UPE 200"][0], 0.3)
    assert found.centroid == pytest.approx((0.0, 0.0256), abs=5e-5)
    assert found.shear_centre == pytest.approx((0.0, -0.0541), abs=5e-4)


def test_shear_centre_of_an_angle_is_where_its_legs_meet() -> None:
    found = named_properties(TABLES["L 100x100x10"][0], 0.3)
    assert found.turn == pytest.approx(-math.pi / 4)
    corner = math.dist(found.centroid, (0.005, 0.005))
    assert np.linalg.norm(found.shear_centre) == pytest.approx(corner, rel=1e-9)


def cowper(kind: str, m: float, n: float) -> float:
    """Shear coefficient of thin walls for Poisson's ratio zero (Cowper 1966)."""
    if kind == "T":
        top = 10 * (1 + 4 * m) ** 2
        return top / (12 + 96 * m + 276 * m**2 + 192 * m**3 + 30 * n**2 * (m + m**2))
    last = 30 * (m + m**2)
    top = 10 * (1 + 3 * m) ** 2
    return top / (12 + 72 * m + 150 * m**2 + 90 * m**3 + last * n**2)


def thin(kind: str, web: float) -> tuple[Any, float, float]:
    """A thin section of height 1 and width 0.6 between middle lines, m and n."""
    flange, width = 2 * web, 0.6
    if kind == "box":
        sizes = {"height": 1 + web, "width": width + web, "thickness": web}
        return beams.BoxSection(**sizes), width, width
    sizes = {"width": width, "web": web, "flange": flange}
    if kind == "I":
        return beams.ISection(height=1 + flange, **sizes), 2 * width * 2, width
    return beams.TSection(height=1 + web, **sizes), width * 2, width


@pytest.mark.parametrize("kind", ["I", "T", "box"])
def test_shear_of_thin_walls_is_that_of_cowper(kind: str) -> None:
    section, m, n = thin(kind, 1e-5)
    found = named_properties(section, 0.0).shear_y
    assert found == pytest.approx(cowper(kind, m, n), rel=1e-4)


def test_shear_of_circle_and_tube() -> None:
    circle = named_properties(beams.CircularSection(diameter=0.1), 0.3)
    assert circle.shear_y == pytest.approx(6 * 1.3 / (7 + 6 * 0.3))
    tube = named_properties(beams.TubeSection(diameter=0.1, thickness=1e-7), 0.3)
    assert tube.shear_z == pytest.approx(2 * 1.3 / (4 + 3 * 0.3), rel=1e-5)
    assert tube.torsion == pytest.approx(2 * math.pi * 0.05**3 * 1e-7, rel=1e-5)


def test_torsion_of_a_box_is_that_of_bredt() -> None:
    section, _, n = thin("box", 1e-5)
    expected = 4 * n**2 * 1e-5 / (2 * (1 + n))
    assert named_properties(section, 0.0).torsion == pytest.approx(expected, rel=1e-4)


E, NU, RHO, LENGTH = 2.1e11, 0.3, 7850.0, 2.0
G = E / (2 * (1 + NU))
FORCE = 1000.0


def body_of(section: dict[str, Any], elements: int, theory: str) -> FiniteElementModel:
    model = beam(
        {"type": "beam", "elements": elements, "theory": theory},
        geometry={
            "type": "beam",
            "start": [0, 0, 0],
            "end": [LENGTH, 0, 0],
            "section": section,
        },
        material={"youngs_modulus": E, "poissons_ratio": NU, "density": RHO},
        markers={"root": {"node": 1, "edge": "start"}},
        frame={"type": "tangent", "marker": "root", "clamp": "start"},
    )
    return finite_element_model(model)


def cantilever(section: dict[str, Any], force: Array, theory: str) -> Array:
    """Displacement and rotation of the tip, in local axes, by a force at its axis."""
    body = body_of(section, 3, theory)
    loads = np.zeros(body.ndof)
    loads[-6:-3] = force
    free = slice(6, None)
    k = body.stiffness.tocsc()[free, free]
    return np.asarray(scipy.sparse.linalg.spsolve(k, loads[free])[-6:])


CHANNEL = {"shape": "C", "height": 0.2, "width": 0.08, "web": 0.006, "flange": 0.011}
ANGLE = {"shape": "L", "height": 0.12, "width": 0.08, "thickness": 0.008}


def properties(section: dict[str, Any]) -> NamedProperties:
    kinds = {"C": beams.CSection, "L": beams.LSection}
    return named_properties(kinds[section["shape"]](**section), NU)


@pytest.mark.parametrize("theory", ["euler_bernoulli", "timoshenko"])
def test_a_channel_twists_under_a_force_at_its_centroid(theory: str) -> None:
    p = properties(CHANNEL)
    tip = cantilever(CHANNEL, np.array([0, FORCE, 0]), theory)
    offset = p.shear_centre[1]
    twist = FORCE * offset * LENGTH / (G * p.torsion)
    bent = FORCE * LENGTH**3 / (3 * E * p.iz)
    if theory == "timoshenko":
        bent += FORCE * LENGTH / (p.shear_y * G * p.area)
    assert tip[3] == pytest.approx(twist, rel=1e-8)
    assert tip[1] == pytest.approx(bent + twist * offset, rel=1e-8)
    assert tip[[0, 2, 4]] == pytest.approx(0.0, abs=1e-12)


def test_an_angle_bends_about_its_principal_axes() -> None:
    p = properties(ANGLE)
    tip = cantilever(ANGLE, np.array([0, 0, FORCE]), "euler_bernoulli")
    axes = np.array(
        [[math.cos(p.turn), math.sin(p.turn)], [-math.sin(p.turn), math.cos(p.turn)]]
    )
    along = axes @ [0.0, FORCE]
    bent = along * LENGTH**3 / 3 / (E * np.array([p.iz, p.iy]))
    y, z = p.shear_centre
    torque = z * along[0] - y * along[1]
    twist = torque * LENGTH / (G * p.torsion)
    moved = bent + twist * np.array([z, -y])
    assert tip[3] == pytest.approx(twist, rel=1e-8)
    assert tip[1:3] == pytest.approx(axes.T @ moved, rel=1e-8)


def test_a_channel_on_forks_vibrates_in_bending_and_torsion() -> None:
    """Waves sin(pi x / L): the centroid moves by v + e theta, v of the shear centre.

    (E Iz k^4 - m w^2) (G J k^2 - p w^2) = (m e w^2)^2 with p about the shear centre.
    """
    section = {
        "shape": "C",
        "height": 0.02,
        "width": 0.012,
        "web": 0.001,
        "flange": 0.001,
    }
    p = properties(section)
    mass, k, e = RHO * p.area, math.pi / LENGTH, p.shear_centre[1]
    polar = RHO * (p.iy + p.iz) + mass * e**2
    stiffness = np.diag([E * p.iz * k**4, G * p.torsion * k**2])
    inertia = np.array([[mass, mass * e], [mass * e, polar]])
    expected = np.sqrt(scipy.linalg.eigh(stiffness, inertia, eigvals_only=True))
    body = body_of(section, 48, "euler_bernoulli")
    last = body.ndof - 6
    held = [1, 3, last + 1, last + 3, *range(0, last + 6, 6), *range(2, last + 6, 6)]
    free = np.setdiff1d(np.arange(body.ndof), [*held, *range(4, last + 6, 6)])
    matrices = (m.toarray()[np.ix_(free, free)] for m in (body.stiffness, body.mass))
    found = np.sqrt(scipy.linalg.eigh(*matrices, eigvals_only=True))
    for frequency in expected:
        assert np.abs(found / frequency - 1).min() < 3e-4


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ({"shape": "tube", "diameter": 0.1, "thickness": 0.06}, "thickness"),
        (
            {"shape": "box", "height": 0.1, "width": 0.05, "thickness": 0.03},
            "thickness",
        ),
        (CHANNEL | {"web": 0.09}, "web"),
        (CHANNEL | {"flange": 0.11}, "flange"),
        (CHANNEL | {"fillet": 0.09}, "fillet"),
        (ANGLE | {"thickness": 0.09}, "thickness"),
    ],
)
def test_sizes_that_contradict_each_other_are_refused(
    section: dict[str, Any], key: str
) -> None:
    with pytest.raises(InputError) as refused:
        cantilever(section, np.zeros(3), "timoshenko")
    assert refused.value.place == f"geometry.section.{key}"
