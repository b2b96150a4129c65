"""Beams against closed solutions; rotary inertia against clouds of particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.beams.cross_section import section_at
from sidtool.conversion.inertia_integrals import body_inertia
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.mass_properties import GeometryMass, geometry_mass_notes
from sidtool.elements.material_points import InertiaPoints
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import by_mode, symmetric_3x3
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_mass import skew
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.report.input_files import describe_model

from ..bodies import beam_data
from ..models import rod


def uniform(
    theory: str, elements: int, length: float = 1.0, **extra: object
) -> ModelFile:
    """A cantilever of 20 mm x 10 mm."""
    settings = {"type": "beam", "elements": elements, "theory": theory}
    data = beam_data(settings, 6)
    data["geometry"] |= {
        "end": [length, 0, 0],
        "section": {"shape": "rectangle", "height": 0.02, "width": 0.01},
    }
    data["geometry"] |= extra
    return validate_data(data, ModelFile)


def omegas(model: ModelFile) -> np.ndarray:
    return np.sqrt(np.diag(sid_from_model(model).Ke.m0))


def test_a_slender_cantilever() -> None:
    """Bending 1.8751^2 and 4.6941^2 about both axes, to the rotary inertia."""
    found = omegas(uniform("euler_bernoulli", 24, 5.0))
    speed = np.sqrt(2.1e11 / 7850 / 12) / 25
    exact = np.sort(
        [
            k**2 * speed * h
            for k in (1.875104, 4.694091, 7.854757, 10.995541)
            for h in (0.01, 0.02)
        ]
    )
    assert_allclose(found, exact[: len(found)], rtol=2e-4)


def test_an_end_of_a_beam_is_a_place_of_its_own() -> None:
    """A beam has no width along which a fraction could count."""
    model = uniform("timoshenko", 4, 2.0)
    ends = {
        "crank_pin": {"node": 1, "edge": "start"},
        "piston_pin": {"node": 2, "edge": "end"},
    }
    found = finite_element_model(model.with_({"markers": ends}))
    places = [found.marker(name).position for name in ends]
    assert_allclose(places, [[0, 0, 0], [2, 0, 0]], atol=1e-15)
    assert "end start" in describe_model(model.with_({"markers": ends}))
    plate = {"crank_pin": {"node": 1, "edge": "left"}}
    with pytest.raises(InputError, match="edge and at do not come together"):
        rod(markers=plate)


def test_torsion_and_stretch() -> None:
    """First torsion (pi/2) sqrt(G It / (rho Ip)) / L of the cantilever."""
    body = finite_element_model(uniform("euler_bernoulli", 40))
    g, it = 2.1e11 / 2.6, 0.01**3 * 0.02 * 0.228682
    ip = 0.01 * 0.02 * (0.01**2 + 0.02**2) / 12
    twist = np.arange(3, body.ndof, 6)[1:]
    k, m = (x[twist][:, twist].toarray() for x in (body.stiffness, body.mass))
    lowest = np.sqrt(np.linalg.eigvals(np.linalg.solve(m, k)).real.min())
    assert lowest == pytest.approx(np.pi / 2 * np.sqrt(g * it / (7850 * ip)), rel=1e-3)


@pytest.mark.parametrize(
    ("ratio", "table", "digits"),
    [(1.0, 0.1406, 4), (1.2, 0.166, 3), (1.5, 0.196, 3), (3.0, 0.263, 3)],
)
def test_torsion_constants_of_rectangles(
    ratio: float, table: float, digits: int
) -> None:
    """J / (a b^3) of a table of Timoshenko and Goodier, for either side along y."""
    for height, width in ((ratio, 1.0), (1.0, ratio)):
        sides = {"shape": "rectangle", "height": height, "width": width}
        model = uniform("euler_bernoulli", 1, section=sides)
        found = section_at(model.geometry, 0.0, 0.3).torsion / ratio
        assert round(found, digits) == table


def test_shear_lowers_a_stubby_beam() -> None:
    """Timoshenko's cantilever, L / h = 5: static tip stiffness 3EI/L^3 with shear."""
    body = finite_element_model(uniform("timoshenko", 7, 0.1))
    load = np.zeros(body.ndof)
    load[body.table[-1, 1]] = 1.0
    free = np.arange(6, body.ndof)
    u = np.zeros(body.ndof)
    u[free] = sp.linalg.spsolve(body.stiffness[free][:, free].tocsc(), load[free])
    e, g, a, i = 2.1e11, 2.1e11 / 2.6, 2e-4, 0.01 * 0.02**3 / 12
    exact = 0.1**3 / (3 * e * i) + 0.1 / (5 / 6 * g * a)
    assert u[body.table[-1, 1]] == pytest.approx(exact, rel=1e-10)


def test_lumped_masses_converge_to_the_consistent_ones() -> None:
    data = [uniform("timoshenko", n) for n in (10, 20, 40)]
    fine = omegas(data[-1])[:4]
    errors = []
    for model in data[:2]:
        settings = model.discretisation.model_copy(update={"mass": "lumped"})
        lumped = model.model_copy(update={"discretisation": settings})
        errors.append(np.abs(omegas(lumped)[:4] / fine - 1))
    assert (errors[1] < 0.3 * errors[0]).all()


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize("elements", [1, 3])
def test_mass_and_centre_are_those_of_the_tapered_beam(
    elements: int, mass: str
) -> None:
    """Height from 40 to 80 mm, 0.5 m: by hand, with a lump at a quarter."""
    data = beam_data({"type": "beam", "elements": elements, "mass": mass}, 2)
    section = {"shape": "rectangle", "height": [0.04, 0.08], "width": 0.02}
    lump = {"at": 0.25, "mass": 0.8}
    ends = {"start": [0.1, 0.2, -0.3], "end": [0.1, 0.5, 0.1]}
    data["geometry"] |= {"section": section, "masses": [lump], **ends}
    model = validate_data(data, ModelFile)
    assert model.material is not None
    beam = model.material.density * 0.5 * 0.02 * 0.06
    share = (beam * (0.02 + 0.04 / 3) / 0.06 + 0.8 * 0.25) / (beam + 0.8)
    body = finite_element_model(model)
    assert body.geometry_mass is not None
    expected = body.geometry_mass()
    assert expected.mass == pytest.approx(beam + 0.8, rel=1e-12)
    centre = np.array(ends["start"]) + share * np.array([0.0, 0.3, 0.4])
    assert_allclose(expected.first / expected.mass, centre, rtol=1e-12)
    assert geometry_mass_notes(body) == ()
    assert sid_from_model(model).mass == pytest.approx(beam + 0.8, rel=1e-12)


@pytest.mark.parametrize("wrong", ["mass", "centre"])
def test_a_beam_without_its_mass_is_refused(wrong: str) -> None:
    """Half of it, or all of it moved by a hundredth of the length."""
    body = finite_element_model(uniform("timoshenko", 4))
    assert body.geometry_mass is not None
    right = body.geometry_mass()
    share, shift = (2.0, 0.0) if wrong == "mass" else (1.0, 0.01)
    first = share * right.first + shift * right.mass
    other = replace(body, geometry_mass=lambda: GeometryMass(share * right.mass, first))
    with pytest.raises(InputError, match="does not have the mass of its geometry"):
        geometry_mass_notes(other)


def test_mass_matrix_is_positive_and_moves_as_a_whole() -> None:
    body = finite_element_model(uniform("euler_bernoulli", 5))
    assert np.linalg.eigvalsh(body.mass.toarray()).min() > 0
    rigid = body.rigid_body_modes()
    gram = rigid.T @ body.mass @ rigid
    m = 7850 * 2e-4
    polar = m * (0.01**2 + 0.02**2) / 12
    assert_allclose(gram[:3, :3], m * np.eye(3), atol=1e-12)
    assert gram[3, 3] == pytest.approx(polar, rel=1e-12)
    assert gram[5, 5] == pytest.approx(m / 3 + m * 0.02**2 / 12, rel=1e-12)
    assert np.abs(body.stiffness @ rigid).max() < 1e-9 * body.stiffness.max()


def test_a_direction_of_the_beam_does_not_matter() -> None:
    along = omegas(uniform("timoshenko", 8))
    turned = uniform(
        "timoshenko",
        8,
        start=[1.0, 2.0, 3.0],
        end=[1.0, 2.6, 3.8],
        y_axis=[0.0, -0.8, 0.6],
    )
    assert_allclose(omegas(turned), along, rtol=1e-9)


def test_the_height_of_a_beam_along_y_is_in_the_plane() -> None:
    """As of a beam along x, when no y axis is stated."""
    upright = sid_from_model(uniform("euler_bernoulli", 8, end=[0.0, 1.0, 0.0]))
    flat = sid_from_model(uniform("euler_bernoulli", 8))
    along_y, along_x = (np.abs(sid.nodes[-1].phi.m0) for sid in (upright, flat))
    assert_allclose(along_y[[1, 0, 2]], along_x, atol=1e-9)


def test_forces_at_a_marker_between_equal_elements() -> None:
    """Stretch F x / EA and twist T x / GJ: elements end at the marker, though the beam
    is cut into equal ones else."""
    data = beam_data({"type": "beam", "elements": 8}, 1)
    section = {"area": 1e-4, "iy": 1e-9, "iz": 2e-9, "torsion": 3e-9}
    data["geometry"]["section"] = section | {"shape": "general"}
    data["markers"]["nut"] = {"node": 9, "parameters": [0.6]}
    data["reduction"] = {"method": "craig_bampton", "interfaces": ["nut"], "modes": 0}
    sid = sid_from_model(validate_data(data, ModelFile))
    nut = next(node for node in sid.nodes if node.id == "9")
    stretch, twist = (
        (rows @ np.linalg.solve(sid.Ke.m0, rows.T))[0, 0]
        for rows in (nut.phi.m0, nut.psi.m0)
    )
    x = 0.6 * np.linalg.norm(data["geometry"]["end"])
    E, nu = (data["material"][key] for key in ("youngs_modulus", "poissons_ratio"))
    assert stretch == pytest.approx(x / (E * 1e-4), rel=1e-9)
    assert twist == pytest.approx(x / (E / (2 * (1 + nu)) * 3e-9), rel=1e-9)


def test_a_lumped_mass_at_the_tip() -> None:
    """3 EI / L^3 over the tip mass and 33/140 of the beam."""
    heavy = uniform("euler_bernoulli", 10, masses=[{"at": 1.0, "mass": 100.0}])
    ei = 2.1e11 * 0.02 * 0.01**3 / 12
    expected = np.sqrt(3 * ei / (100 + 33 / 140 * 7850 * 2e-4))
    assert omegas(heavy)[0] == pytest.approx(expected, rel=1e-4)


@pytest.fixture(scope="module")
def discs() -> tuple[InertiaPoints, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rigid bodies of six particles each, and the particles by themselves."""
    random = np.random.default_rng(3)
    p, nq = 4, 3
    where, shapes = random.normal(size=(p, 3)), random.normal(size=(6 * p, nq))
    arms = random.normal(size=(p, 6, 3))
    weights = random.uniform(0.5, 2, (p, 6))
    arms -= (
        np.einsum("pk,pkc->pc", weights, arms)[:, None] / weights.sum(1)[:, None, None]
    )
    turn = -np.einsum("pkab,pkbc,pk->pac", skew(arms), skew(arms), weights)
    rows = sp.eye_array(6 * p, format="csr")
    index = np.arange(6 * p).reshape(p, 6)
    points = InertiaPoints(
        where,
        weights.sum(axis=1),
        turn,
        sp.csr_matrix(rows[index[:, :3].ravel()]),
        sp.csr_matrix(rows[index[:, 3:].ravel()]),
    )
    psi = np.swapaxes(shapes.reshape(p, 6, nq)[:, 3:], 1, 2)
    phi = np.swapaxes(shapes.reshape(p, 6, nq)[:, :3], 1, 2)
    return points, shapes, arms, weights, np.stack([phi, psi])


def body_of(points: InertiaPoints, full: bool) -> FiniteElementModel:
    n = len(points.masses)
    mass = points.mass_matrix()
    return FiniteElementModel(
        positions=points.positions,
        scalar_mass=None,
        stiffness=mass,
        node_sets={},
        markers=(),
        full_mass=mass if full else None,
        inertia_points=None if full else points,
        dof_table=np.arange(6 * n).reshape(n, 6),
    )


@pytest.mark.parametrize("full", [False, True])
def test_rotary_inertia_is_that_of_the_particles(discs: tuple, full: bool) -> None:
    points, shapes, arms, weights, (phi, psi) = discs
    origin = np.array([0.1, -0.2, 0.3])
    mass, blocks = body_inertia(body_of(points, full), origin, shapes)
    c = (points.positions[:, None] + arms - origin).reshape(-1, 3)
    w = weights.ravel()
    field = phi[:, None] + np.cross(psi[:, None], arms[:, :, None])
    field = field.reshape(len(c), -1, 3)
    assert mass == pytest.approx(w.sum())
    assert_allclose(blocks["mdCM"].m0[:, 0], w @ c, atol=1e-12)
    j = -np.einsum("p,pab,pbc->ac", w, skew(c), skew(c))
    assert_allclose(symmetric_3x3(blocks["J"].m0[:, 0]), j, atol=1e-11)
    j1 = -np.einsum("p,pab,plbc->lac", w, skew(c), skew(field))
    j1 = j1 + np.swapaxes(j1, 1, 2)
    assert_allclose(symmetric_3x3(blocks["J"].m1[..., 0]), j1, atol=1e-11)
    cr = np.einsum("p,pla->la", w, np.cross(c[:, None], field))
    assert_allclose(blocks["Cr"].m0, cr, atol=1e-11)
    assert_allclose(blocks["Me"].m0, np.einsum("p,pia,pla->il", w, field, field))
    gr = -2 * np.einsum("p,pab,plbc->lac", w, skew(c), skew(field))
    assert_allclose(by_mode(blocks["Gr"].m0, 3), gr, atol=1e-10)


def test_inertia_of_second_order_is_that_of_finite_rotations(discs: tuple) -> None:
    """Oe1 = -1/2 d2J/dq2, by differences of truly turned discs."""
    points, shapes, *_, (_, psi) = discs
    far = InertiaPoints(
        points.positions,
        np.full(len(points.masses), 1e-300),
        points.inertias,
        points.displacement,
        points.rotation,
    )
    _, blocks = body_inertia(body_of(far, False), np.zeros(3), shapes)

    def inertia(q: np.ndarray) -> np.ndarray:
        turns = Rotation.from_rotvec(np.einsum("pla,l->pa", psi, q)).as_matrix()
        return np.einsum("pab,pbc,pdc->ad", turns, points.inertias, turns)

    h = 1e-3
    for i in range(3):
        for l in range(3):  # noqa: E741
            a, b = h * np.eye(3)[i], h * np.eye(3)[l]
            second = inertia(a + b) - inertia(a - b) - inertia(b - a) + inertia(-a - b)
            tensor = -second / (4 * h**2) / 2
            expected = [*np.diag(tensor), *(2 * tensor[[0, 1, 0], [1, 2, 2]])]
            found = blocks["Oe"].m1[l, i]
            assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"end": [0, 0, 0]}, "start and end are the same"),
        ({"y_axis": [1, 0, 0]}, "parallel to the beam"),
        (
            {"section": {"shape": "rectangle", "height": 3e49, "width": 1}},
            "geometry.section: is 3e\\+49 m at",
        ),
        (
            {"section": {"shape": "rectangle", "height": [1, 0.01, 1], "width": 1}},
            None,
        ),
    ],
)
def test_degenerate_beams(change: dict, message: str | None) -> None:
    if message is None:
        change["section"]["height"] = [0.06, 0.001, 0.001, 0.06]
        message = "becomes -"
    with pytest.raises(InputError, match=message):
        finite_element_model(uniform("euler_bernoulli", 9, **change))


def test_more_elements_than_a_computer_counts_are_refused() -> None:
    with pytest.raises(InputError, match="discretisation.elements"):
        uniform("euler_bernoulli", 2**63 - 1)


@pytest.mark.parametrize("elements", [1, 2, 4, 7])
def test_lumped_masses_keep_the_inertia(elements: int) -> None:
    """Mass, centre and J of a uniform and of a tapered beam, by their integrals."""
    m = 7850 * 2e-4
    for heights in ([0.02], [0.03, 0.01]):
        section = {"shape": "rectangle", "height": heights, "width": 0.01}
        if len(heights) == 1:
            section["height"] = heights[0]
        beam = uniform("timoshenko", elements, section=section)
        settings = beam.discretisation.model_copy(update={"mass": "lumped"})
        lumped = beam.model_copy(update={"discretisation": settings})
        inertias = []
        for model in (beam, lumped):
            body = finite_element_model(model)
            inertias.append(body_inertia(body, np.zeros(3), np.zeros((body.ndof, 1))))
        (mass, blocks), (mass_l, blocks_l) = inertias
        assert mass_l == pytest.approx(mass, rel=1e-12)
        for name in ("mdCM", "J"):
            exact, found = blocks[name].m0, blocks_l[name].m0
            assert_allclose(found, exact, atol=1e-12 * np.abs(exact).max())
        x, w = np.polynomial.legendre.leggauss(8)
        x, w = (x + 1) / 2, w / 2
        h = np.interp(x, [0, 1], [heights[0], heights[-1]])
        line = 7850 * 0.01 * h
        assert mass_l == pytest.approx(w @ line, rel=1e-12) == pytest.approx(m)
        about_z = w @ (line * (x**2 + h**2 / 12))
        assert blocks_l["J"].m0[2, 0] == pytest.approx(about_z, rel=1e-12)


@pytest.mark.parametrize("elements", [6, 12])
def test_lumped_masses_leave_the_frequencies(elements: int) -> None:
    """Of the free beam: bending 4.7300^2 sqrt(EI / rho A) / L^2 about both axes."""
    beam = uniform("euler_bernoulli", elements, 3.0, masses=[])
    settings = beam.discretisation.model_copy(update={"mass": "lumped"})
    body = finite_element_model(beam.model_copy(update={"discretisation": settings}))
    k, m = body.stiffness.toarray(), body.mass.toarray()
    found = np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)[6:8])
    exact = 4.730041**2 * np.sqrt(2.1e11 / 7850 / 12) / 9 * np.array([0.01, 0.02])
    assert_allclose(found, exact, rtol=0.6 / elements**2)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_numbers_that_no_matrix_can_hold_are_refused() -> None:
    """There was a traceback, "Singular matrix"."""
    section = {"shape": "general", "area": 4e-4, "iy": 2e-7, "iz": 1e50}
    model = uniform("euler_bernoulli", 30, 10.0, start=[1e20, 0, 0], section=section)
    with pytest.raises(InputError):
        sid_from_model(model)
