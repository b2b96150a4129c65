"""Beams with curved axes and pre-twist against exact solutions and solids."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from sidtool.beams.axis import beam_axis
from sidtool.conversion.inertia_integrals import body_inertia
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.mass_properties import geometry_mass_notes
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.model.beams import BeamGeometry
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model

from ..bodies import beam_data

Array = NDArray[np.float64]


def blade(elements: int, **geometry: Any) -> ModelFile:
    settings = {"type": "beam", "elements": elements, "theory": "timoshenko"}
    data = beam_data(settings, 6)
    material = geometry.pop("material", None)
    data["geometry"] |= geometry
    if material:
        data["material"] = dict(
            zip(("youngs_modulus", "poissons_ratio", "density"), material, strict=True)
        )
    return validate_data(data, ModelFile)


def arc(radius: float, angle: float, points: int) -> dict[str, Any]:
    """A circle in the xy plane that leaves the origin along x and bends to y."""
    t = np.linspace(0, angle, points)
    places = radius * np.stack([np.sin(t), 1 - np.cos(t), 0 * t], axis=1)
    start, *through, end = places.tolist()
    return {"start": start, "through": through, "end": end}


def tip_motion(body: FiniteElementModel, force: Any) -> Array:
    """Displacement and rotation of the tip under forces and moments there."""
    load = np.zeros(body.ndof)
    load[-6:] = force
    u = np.zeros(body.ndof)
    k = sp.csc_matrix(body.stiffness)[6:, 6:]
    u[6:] = sp.linalg.spsolve(k, load[6:])
    return u[-6:]


def frequencies(body: FiniteElementModel, held: str, count: int) -> Array:
    """[rad/s] with the start held, or both ends."""
    free = slice(6, None) if held == "start" else slice(6, -6)
    k, m = (x.toarray()[free, free] for x in (body.stiffness, body.mass))
    squares = scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=(0, count - 1))
    return np.sqrt(squares)


SECTION = {"area": 2e-4, "iy": 4e-10, "iz": 1.2e-10, "torsion": 5.2e-10}


def residual(omega: float, curvature: Array, length: float, held: str) -> float:
    """Determinant of the boundary conditions of a beam of constant curvature.

    Along the axes that turn with the section the equations of motion have constant
    coefficients, v' = A v for displacement, rotation, force and moment, so that their
    solution is expm(A s). Steel of E = 210 GPa, nu = 0.3 and SECTION.
    """
    e, g, rho = 2.1e11, 2.1e11 / 2.6, 7850.0
    a, iy, iz, it = (SECTION[k] for k in ("area", "iy", "iz", "torsion"))
    turn = np.cross(curvature, np.eye(3)).T
    along = np.cross([1.0, 0.0, 0.0], np.eye(3)).T  # e_x times
    matrix = -np.kron(np.eye(4), turn)
    u, t, n, m = (slice(3 * i, 3 * i + 3) for i in range(4))
    matrix[u, t] -= along
    matrix[u, n] = np.diag([1 / (e * a), *[1.2 / (g * a)] * 2])
    matrix[t, m] = np.diag([1 / (g * it), 1 / (e * iy), 1 / (e * iz)])
    matrix[n, u] = -(omega**2) * rho * a * np.eye(3)
    matrix[m, t] = -(omega**2) * rho * np.diag([iy + iz, iy, iz])
    matrix[m, n] -= along
    size = np.repeat([1.0, 1.0, e * iz, e * iz], 3)
    solution = scipy.linalg.expm(matrix * length * size / size[:, None])
    rows = slice(6, None) if held == "start" else slice(0, 6)
    return float(np.linalg.det(solution[rows, 6:]))


def assert_exact(found: Array, curvature: Any, length: float, held: str) -> None:
    for omega in found:
        below, above = (
            residual(omega * (1 + d), np.array(curvature), length, held)
            for d in (-4e-5, 4e-5)
        )
        assert below * above < 0, f"no frequency of the beam at {omega} rad/s"


@pytest.mark.parametrize("twist", [0.3, -2.0])
def test_frequencies_of_a_twisted_blade_are_exact(twist: float) -> None:
    section = {"shape": "general", **SECTION}
    model = blade(40, end=[0.6, 0, 0], twist=[0.4, 0.4 + twist], section=section)
    found = frequencies(finite_element_model(model), "start", 6)
    assert_exact(found, [twist / 0.6, 0, 0], 0.6, "start")


@pytest.mark.parametrize("held", ["start", "both"])
@pytest.mark.parametrize(("y_axis", "bent"), [([0, 1, 0], "z"), ([0, 0, -1], "y")])
def test_frequencies_of_an_arch_are_exact(
    held: str, y_axis: list[float], bent: str
) -> None:
    """In its plane and out of it, where bending and torsion are one."""
    curve, section = arc(1.0, 2.0, 25), {"shape": "general", **SECTION}
    model = blade(32, **curve, y_axis=y_axis, section=section)
    found = frequencies(finite_element_model(model), held, 5)
    assert_exact(found, [0, 0, 1] if bent == "z" else [0, 1, 0], 2.0, held)


def test_frequencies_of_a_helix_are_exact() -> None:
    """One and a half turns; the carried axes turn back by the torsion of the curve."""
    radius, rise, turns = 0.8, 0.2, 1.5 * 2 * np.pi
    t = np.linspace(0, turns, 49)
    places = np.stack([radius * np.cos(t), radius * np.sin(t), rise * t], axis=1)
    start, *through, end = places.tolist()
    c = np.hypot(radius, rise)
    section = {"shape": "general", **SECTION}
    torsion = rise / c**2
    model = blade(
        30,
        start=start,
        through=through,
        end=end,
        y_axis=[-1, 0, 0],
        twist=[0.0, torsion * turns * c],
        section=section,
    )
    found = frequencies(finite_element_model(model), "start", 3)
    assert_exact(found, [torsion, 0, radius / c**2], turns * c, "start")


def solid_blade(length: float, height: float, width: float, twist: float) -> ModelFile:
    """Steel without lateral contraction; the twist as a polynomial of degree 5."""
    s = np.linspace(0, 1, 6)
    c, d = np.cos(twist * s), np.sin(twist * s)
    places = [
        [
            np.stack([length * s, y * c - z * d, y * d + z * c], axis=1)
            for z in (-width / 2, width / 2)
        ]
        for y in (-height / 2, height / 2)
    ]
    spline = make_interp_spline(s, np.moveaxis(places, 2, 0), k=5)
    ends = [[0, 0, 1, 1]] * 2
    data = beam_data({"type": "iga", "degrees": [6, 4, 3], "elements": [5, 2, 1]}, 6)
    data["material"]["poissons_ratio"] = 0.0
    data["geometry"] = {
        "type": "nurbs_volume",
        "degrees": [5, 1, 1],
        "knots": [spline.t.tolist(), *ends],
        "control_points": spline.c.tolist(),
    }
    data["frame"]["clamp"] = "left"
    data["markers"] = {
        name: {"node": node, "edge": edge, "at": [0.5, 0.5]}
        for name, node, edge in (
            ("crank_pin", 1, "left"),
            ("piston_pin", 2, "right"),
        )
    }
    return validate_data(data, ModelFile)


def test_a_twisted_blade_vibrates_as_a_solid_one() -> None:
    """A strip of 25.4 mm x 1.727 mm twisted by 45 degrees: modes of bending to 2e-3.

    Torsion to 5e-2, since a beam does not hold the warping of its root; without
    what pre-twist adds to its stiffness it would be 9e-2 below.
    """
    length, height, width, twist = 0.1524, 0.0254, 0.001727, np.pi / 4
    solid = finite_element_model(solid_blade(length, height, width, twist))
    free = np.setdiff1d(np.arange(solid.ndof), solid.dofs(solid.node_sets["left"]))
    k, m = (x[free][:, free].toarray() for x in (solid.stiffness, solid.mass))
    squares = scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=(0, 4))
    section = {"shape": "rectangle", "height": height, "width": width}
    model = blade(
        16,
        end=[length, 0, 0],
        twist=[0, twist],
        section=section,
        material=(2.1e11, 0.0, 7850.0),
    )
    found = frequencies(finite_element_model(model), "start", 5)
    errors = np.abs(found / np.sqrt(squares) - 1)
    assert_allclose(errors[[0, 1, 3, 4]], 0, atol=2e-3)
    assert errors[2] < 5e-2


@pytest.mark.parametrize(("load", "published"), [(2, 0.005424), (1, 0.001754)])
def test_macneals_twisted_beam(load: int, published: float) -> None:
    """Length 12, 1.1 x 0.32, twist of 90 degrees, E = 29e6, nu = 0.22, unit forces.

    R. H. MacNeal and R. L. Harder, A proposed standard set of problems to test finite
    element accuracy, Finite Elements in Analysis and Design 1 (1985).
    """
    body = finite_element_model(
        blade(
            2,
            end=[12, 0, 0],
            twist=[0.0, np.pi / 2],
            section={"shape": "rectangle", "height": 1.1, "width": 0.32},
            material=(29e6, 0.22, 1000.0),
        )
    )
    found = tip_motion(body, np.eye(6)[load])[load]
    assert found == pytest.approx(published, rel=5e-3)


@pytest.mark.parametrize(("load", "published"), [(0, 0.08734), (2, 0.5022)])
def test_macneals_curved_beam(load: int, published: float) -> None:
    """A quarter of a circle of radii 4.12 and 4.32, 0.1 thick; the same article."""
    body = finite_element_model(
        blade(
            2,
            **arc(4.22, np.pi / 2, 15),
            section={"shape": "rectangle", "height": 0.2, "width": 0.1},
            material=(1e7, 0.25, 1000.0),
        )
    )
    found = tip_motion(body, np.eye(6)[load])[load]
    assert found == pytest.approx(published, rel=1.5e-2)


def test_a_quarter_of_a_circle_bends_by_castiglianos_theorem() -> None:
    """Across the tip, along it, and out of the plane."""
    r, (e, g) = 1.5, (2.1e11, 2.1e11 / 2.6)
    a, iz, iy, it = (SECTION[k] for k in ("area", "iz", "iy", "torsion"))
    section = {"shape": "general", **SECTION}
    body = finite_element_model(blade(3, **arc(r, np.pi / 2, 33), section=section))
    force, shear = np.pi * r / 4 / (e * a), 1.2 * np.pi * r / 4 / (g * a)
    exact = [
        np.pi * r**3 / 4 / (e * iz) + force + shear,
        r**3 * (3 * np.pi / 4 - 2) / (e * iz) + force + shear,
        np.pi * r**3 / 4 / (e * iy)
        + (3 * np.pi / 4 - 2) * r**3 / (g * it)
        + 1.2 * np.pi * r / 2 / (g * a),
    ]
    found = [tip_motion(body, np.eye(6)[k])[k] for k in range(3)]
    assert_allclose(found, exact, rtol=2e-5)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_inertia_of_a_thick_arch_is_that_of_its_volume(mass: str) -> None:
    """Mass, centre and moments of inertia of a half ring, by integrals over it."""
    r, h, w, rho = 0.5, 0.2, 0.1, 7850.0
    section = {"shape": "rectangle", "height": h, "width": w}
    model = blade(8, **arc(r, np.pi, 65), section=section)
    settings = model.discretisation.model_copy(update={"mass": mass})
    body = finite_element_model(model.model_copy(update={"discretisation": settings}))
    found, blocks = body_inertia(body, np.array([0, r, 0.0]), np.zeros((body.ndof, 1)))
    out, inner = r + h / 2, r - h / 2
    assert found == pytest.approx(rho * w * np.pi / 2 * (out**2 - inner**2), rel=1e-6)
    first = rho * w * 2 / 3 * (out**3 - inner**3)
    assert_allclose(blocks["mdCM"].m0[:, 0], [first, 0, 0], atol=1e-5 * first)
    polar = rho * w * np.pi / 4 * (out**4 - inner**4)
    assert blocks["J"].m0[2, 0] == pytest.approx(polar, rel=2e-4)
    assert geometry_mass_notes(body) == ()


def test_equivalent_descriptions_give_the_same_part() -> None:
    """Twist by y_axis, points on a line, and other numbers of points."""
    plain: dict[str, Any] = {"end": [0.4, 0.3, 0], "y_axis": [0, 0, 1]}
    section = {"shape": "rectangle", "height": [0.02, 0.01], "width": 0.01}
    turned: dict[str, Any] = {
        "y_axis": [-0.6 * np.sin(0.7), 0.8 * np.sin(0.7), np.cos(0.7)]
    }
    known = sid_from_model(blade(6, **plain, section=section))
    others: list[dict[str, Any]] = [
        {"through": [[0.1, 0.075, 0], [0.3, 0.225, 0]]},
        turned | {"twist": 0.7},
    ]
    for other in others:
        sid = sid_from_model(blade(6, **(plain | other), section=section))
        assert_allclose(np.diag(sid.Ke.m0), np.diag(known.Ke.m0), rtol=1e-8)
        assert_allclose(sid.J.m0, known.J.m0, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_cross_sections_do_not_turn_about_a_curve_in_space(seed: int) -> None:
    """Reference: double reflections of fourth order from point to point. W. Wang,
    B. Juettler, D. Zheng, Y. Liu: Computation of rotation minimizing frames. ACM Trans.
    Graph. 27 (2008).
    """
    rng = np.random.default_rng(seed)
    points = np.cumsum([0.6, 0.0, 0.0] + rng.normal(size=(6, 3)), axis=0)
    start, *through, end = points.tolist()
    geometry = blade(8, start=start, through=through, end=end).geometry
    assert isinstance(geometry, BeamGeometry)
    axis = beam_axis(geometry)
    count = 4000
    parameters = np.linspace(0.0, 1.0, count + 1) * axis.parameters(np.ones(1))
    places, tangents = axis.place(parameters), axis.tangents(parameters)[0]
    found = axis.transported_y(parameters)
    y = found[0]
    for k in range(count):
        chord = places[k + 1] - places[k]
        chord = chord / np.linalg.norm(chord)
        y, tangent = (v - 2.0 * (chord @ v) * chord for v in (y, tangents[k]))
        second = tangents[k + 1] - tangent
        if size := second @ second:
            y = y - 2.0 * (second @ y) / size * second
    assert_allclose(found[-1], y, rtol=0, atol=1e-8)
    assert_allclose((found * tangents).sum(axis=1), 0.0, rtol=0, atol=1e-14)
    assert_allclose((found**2).sum(axis=1), 1.0, rtol=0, atol=5e-14)


def test_markers_are_found_on_a_curved_axis() -> None:
    data = blade(6, **arc(1.0, 1.5, 41)).model_dump(mode="json", exclude_none=True)
    place = [np.sin(0.5), 1 - np.cos(0.5), 0.0]
    data["markers"]["at"] = {"node": 8, "position": place}
    body = finite_element_model(validate_data(data, ModelFile))
    marker = body.marker("at")
    assert_allclose(marker.position, place, atol=1e-6)
    assert marker.tangent is not None
    assert_allclose(marker.tangent, [np.cos(0.5), np.sin(0.5), 0], atol=1e-5)
    rigid = body.rigid_body_modes()
    assert_allclose(marker.rotation @ rigid, np.eye(6)[3:], atol=1e-12)
    data["markers"]["at"]["position"] = [0.5, 0.3, 0.0]
    with pytest.raises(InputError, match="lies off the axis"):
        finite_element_model(validate_data(data, ModelFile))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"through": [[1, 0, 0]], "end": [1, 0, 0]}, "two points in a row are equal"),
        (
            {
                **arc(0.05, 1.0, 5),
                "section": {"shape": "rectangle", "height": 0.11, "width": 0.01},
            },
            "larger than the radius of the axis, 0.04",
        ),
    ],
)
def test_impossible_curves(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        finite_element_model(blade(4, **change))
