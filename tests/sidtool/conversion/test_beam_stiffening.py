"""Geometric stiffening of beams: published terms, buckling loads, solids."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.beams.section_shapes import named_properties
from sidtool.formats.base.sid import SID, Node
from sidtool.formats.geometric_stiffening import load_stiffness
from sidtool.formats.model import ModelFile
from sidtool.formats.model.beams import TSection
from sidtool.formats.sid_mass import skew
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.validate.checks import check

HEIGHT, WIDTH = 0.05, 0.035
SLENDER = {"shape": "general", "area": 1.0, "iy": 1e-10, "iz": 1e-14}
STRIP = {"shape": "general", "area": 1.0, "iy": 1e-6, "iz": 1e-2, "torsion": 4e-6}


def model(
    geometry: dict[str, Any], discretisation: dict[str, Any], **changes: Any
) -> ModelFile:
    ends: list[dict[str, Any]] = [{"parameters": [0]}, {"parameters": [1]}]
    clamp = "start"
    if geometry["type"] == "nurbs_volume":
        ends = [{"edge": edge, "at": [0.5, 0.5]} for edge in ("left", "right")]
        clamp = "left"
    data = {
        "format": "sidtool model",
        "version": 1,
        "title": "Beam",
        "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.0, "density": 7850.0},
        "geometry": geometry,
        "discretisation": discretisation,
        "frame": {"type": "tangent", "marker": "root", "clamp": clamp},
        "markers": {"root": {"node": 1, **ends[0]}, "tip": {"node": 2, **ends[1]}},
        "reduction": {"method": "modal", "modes": 9},
        "stiffening": {},
    }
    whole = {key: value for key, value in (data | changes).items() if value is not None}
    return validate_data(whole, ModelFile)


def line(section: dict[str, Any], end: tuple[float, ...] = (1.0, 0.0, 0.0)) -> Any:
    return {"type": "beam", "start": [0, 0, 0], "end": list(end), "section": section}


def slender(elements: int, modes: int) -> SID:
    """L = m = EI = 1 in the plane."""
    material = {"youngs_modulus": 1e14, "poissons_ratio": 0.0, "density": 1.0}
    settings = {"type": "beam", "elements": elements}
    reduction = {"method": "modal", "modes": modes}
    changes = {"material": material, "reduction": reduction}
    return sid_from_model(model(line(SLENDER), settings, **changes))


def strip(modes: int) -> SID:
    """Stiff in one plane: E Iy = 1, G It = 2."""
    material = {"youngs_modulus": 1e6, "poissons_ratio": 0.0, "density": 1e3}
    settings = {"type": "beam", "elements": 36}
    reduction = {"method": "modal", "modes": modes}
    changes = {"material": material, "reduction": reduction}
    return sid_from_model(model(line(STRIP), settings, **changes))


def lowest_load(sid: SID, loads: np.ndarray) -> float:
    """Smallest positive factor of loads[l, k] at which Ke - loads is singular."""
    factors = scipy.linalg.eigvals(sid.Ke.m0, loads)
    real = factors[
        np.isfinite(factors) & (abs(factors.imag) < 1e-6 * abs(factors))
    ].real
    return float(real[real > 0].min())


def test_the_published_terms_of_a_cantilever() -> None:
    """R4, to all digits: K0omega, K0t,x and phi1 of a force along the beam.

    Quadratic convergence, as the axial force is constant in an element.
    """
    terms = np.array([published(slender(n, 1)) for n in (16, 32, 64)])
    steps = np.diff(terms, axis=0)
    assert_allclose(np.log2(steps[0, :2] / steps[1, :2]), 2, atol=0.01)
    limit = terms[2] + steps[1] / 3
    assert_allclose(limit, [1.19334, -1.57088, -4.64778, 2.0], rtol=0, atol=6e-6)


def published(sid: SID) -> list[float]:
    tip = sid.node(2)
    centrifugal, acceleration = sid.Oe.m1[0, 0, 2] + 1, sid.Ct.m1[0, 0, 0]
    return [centrifugal, acceleration, tip.phi.m1[0, 0, 0], abs(tip.phi.m0[1, 0])]


def test_column() -> None:
    """Euler: pi^2 E I / (4 L^2), from above and the closer the more modes there are."""
    sids = [slender(40, modes) for modes in (2, 4, 8)]
    loads = np.array([lowest_load(s, -s.node(2).phi.m1[:, 0, :]) for s in sids])
    errors = loads / (np.pi**2 / 4) - 1
    assert 16 * errors[2] < 4 * errors[1] < errors[0] < 0.01
    assert errors[2] > 0


def test_lateral_buckling() -> None:
    """Prandtl: 4.0126 sqrt(E Iy G It) / L^2 under a force at the tip of a strip."""
    found = [lowest_load(s, s.node(2).phi.m1[:, 1, :]) for s in map(strip, (16, 32))]
    exact = 4.0126 * np.sqrt(2.0)
    assert exact < found[1] < found[0]
    assert found[1] == pytest.approx(exact, rel=1e-2)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_lateral_buckling_of_a_tee(up: float) -> None:
    """A force at the tip towards the flange, or away from it, by Ritz' method.

    E Iy ws'' ws'' + G J t' t' + 2 Mz w'' t - b Mz t' t' with twist t, deflection w of
    the centroid and ws = w + ys t of the shear centre; b is the integral of
    (y y y + y z z) / Iz (V. Z. Vlasov, Thin-Walled Elastic Beams, 1961).
    """
    h, w, web, flange, e = 0.2, 0.1, 0.006, 0.01, 2e11
    tee = {"shape": "T", "height": h, "width": w, "web": web, "flange": flange}
    # The modes of six elements are all of their motions.
    changes = {"reduction": {"method": "modal", "modes": 36}}
    settings = {"type": "beam", "elements": 6, "theory": "euler_bernoulli"}
    sid = sid_from_model(model(line(tee, (2.0, 0.0, 0.0)), settings, **changes))
    found = lowest_load(sid, up * sid.node(2).phi.m1[:, 1, :])

    properties = named_properties(TSection(**tee), 0.0)  # tested by themselves
    plates = [(web, 0.0, h - flange), (w, h - flange, h)]
    area = sum(b * (y1 - y0) for b, y0, y1 in plates)
    centre = sum(b * (y1**2 - y0**2) / 2 for b, y0, y1 in plates) / area
    plates = [(b, y0 - centre, y1 - centre) for b, y0, y1 in plates]
    iz = sum(b * (y1**3 - y0**3) / 3 for b, y0, y1 in plates)
    third = sum(b * (y1**4 - y0**4) / 4 for b, y0, y1 in plates)
    third += sum(b**3 / 12 * (y1**2 - y0**2) / 2 for b, y0, y1 in plates)
    iy, torsion = ((h - flange) * web**3 + flange * w**3) / 12, properties.torsion
    ys = properties.shear_centre[0]
    x, weights = np.polynomial.legendre.leggauss(20)
    x = x + 1  # from 0 to 2 m
    k, none = np.arange(1, 10)[:, None], np.zeros((9, 20))
    bend = np.vstack([(k + 1) * k * x ** (k - 1), none])
    twist, rate, change = (
        np.vstack([none, rows])
        for rows in (x**k, k * x ** (k - 1), k * (k - 1) * x ** (k - 2.0))
    )
    bending = up * (2 - x) * weights
    stiffness = e * iy * (bend * weights) @ bend.T
    stiffness += e / 2 * torsion * (rate * weights) @ rate.T
    load = -((bend - ys * change) * bending) @ twist.T
    load = load + load.T + third / iz * (rate * bending) @ rate.T
    factors = scipy.linalg.eigvalsh(load, stiffness)
    # 2.4 % with 6 elements, 0.6 % with 12, 0.15 % with 24 away from the flange.
    assert found == pytest.approx(1 / factors.max(), rel=0.03)


def test_a_beam_of_any_direction() -> None:
    """Turned in space, all terms turn with it."""
    turned = {**line(STRIP, (0.48, 0.6, 0.64)), "y_axis": (0.0, 0.64, -0.6)}
    settings = {"type": "beam", "elements": 12}
    straight, oblique = (
        sid_from_model(model(geometry, settings)) for geometry in (line(STRIP), turned)
    )
    assert [c.id for c in check(oblique) if c.failed] == []
    x, y = np.array([0.48, 0.6, 0.64]), np.array([0.0, 0.64, -0.6])
    y /= np.linalg.norm(y)
    axes = np.array([x, y, np.cross(x, y)])
    there, here = straight.node(2), oblique.node(2)
    sign = signs(turned_rows(here, axes), rows(there))
    pairs = sign[:, None] * sign
    for a, b in ((straight.Ct.m1, oblique.Ct.m1), (straight.Cr.m1, oblique.Cr.m1)):
        close(np.einsum("lka,ab->lkb", b, axes.T) * pairs[..., None], a, 1e-6)
    for name in ("phi", "psi"):
        b = getattr(here, name).m1
        found = np.einsum("lbk,ab->lak", b, axes) * pairs[:, None]
        close(found, getattr(there, name).m1, 1e-6)


def test_a_solid_has_the_same_terms() -> None:
    """Bending in both planes and torsion; solids warp, which makes the difference."""
    points = [
        [
            [[x, y, z] for z in (-WIDTH / 2, WIDTH / 2)]
            for y in (-HEIGHT / 2, HEIGHT / 2)
        ]
        for x in (0, 1)
    ]
    volume = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": points,
    }
    section = {"shape": "rectangle", "height": HEIGHT, "width": WIDTH}
    iga = {"type": "iga", "degrees": [3, 2, 2], "elements": [12, 1, 1]}
    beam = {"type": "beam", "elements": 60, "theory": "timoshenko"}
    a = sid_from_model(model(volume, iga))
    b = sid_from_model(model(line(section), beam))
    sign = signs(rows(b.node(2)), rows(a.node(2)))
    pairs = sign[:, None] * sign
    for name in ("Ct", "Cr", "Oe"):
        close(getattr(b, name).m1 * pairs[..., None], getattr(a, name).m1, 0.02)
    for name in ("phi", "psi"):
        m1 = getattr(b.node(2), name).m1 * pairs[:, None]
        close(m1, getattr(a.node(2), name).m1, 0.02)


def rows(node: Node) -> np.ndarray:
    return np.vstack([node.phi.m0, node.psi.m0])


def turned_rows(node: Node, axes: np.ndarray) -> np.ndarray:
    return np.vstack([axes @ node.phi.m0, axes @ node.psi.m0])


def signs(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Which shape functions have the other sign."""
    return np.sign((first * second).sum(axis=0))


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    assert_allclose(found, expected, rtol=0, atol=tolerance * abs(expected).max())


@pytest.mark.parametrize("carriers", [{}, {"markers": []}])
def test_the_load_of_a_prestressed_beam_stiffens_once(carriers: dict[str, Any]) -> None:
    force = (5e5, 3e4, 0.0)
    settings = {"type": "beam", "elements": 12}
    pull = {"stiffening": {"prestress": {"forces": {"tip": force}}, **carriers}}
    plain = sid_from_model(model(line(STRIP), settings))
    pulled = sid_from_model(model(line(STRIP), settings, **pull))
    stretched = plain.Ke.m0 + load_stiffness(plain, forces={"2": force})
    found = pulled.Ke.m0 + load_stiffness(pulled, forces={"2": force})
    expected = scipy.linalg.eigvalsh(stretched, plain.Me.m0)
    assert expected[0] > 1.1 * np.diag(plain.Ke.m0).min()
    assert_allclose(scipy.linalg.eigvalsh(found, pulled.Me.m0), expected, rtol=1e-9)
    load = force @ pulled.node(2).phi.m0
    assert_allclose(pulled.ksigma.m0[:, 0], load, atol=1e-9 * np.abs(load).max())


def stationed(y: float, z: float, *, matrices: bool) -> SID:
    """A beam whose centres of mass, tension and shear are (y, z) from its axis, and
    in the same place for all y and z.
    """
    values = {"EA": 8e8, "GA_y": 1e8, "GA_z": 1e8, "GJ": 2e5, "EI_y": 4e5, "EI_z": 2e7}
    sections: dict[str, Any] = {"position": [0.0, 3.0], "mass_per_length": [20.0] * 2}
    offsets = {
        f"{n}_{a}": v
        for n in ("tension", "mass", "shear")
        for a, v in zip("yz", (y, z), strict=True)
    }
    own = {"inertia_y": 0.01, "inertia_z": 0.5}
    sections |= {name: [v, v] for name, v in (values | offsets | own).items()}
    if matrices:
        moved = np.eye(6)
        moved[4, 0], moved[5, 0], moved[3, 1:3] = -z, y, (z, -y)
        stiffness = np.linalg.inv(
            moved.T @ np.diag([1 / v for v in values.values()]) @ moved
        )
        carried = np.eye(6)
        carried[:3, 3:] = -skew(np.array([0.0, y, z]))
        mass = carried.T @ np.diag([20.0, 20.0, 20.0, 0.51, 0.01, 0.5]) @ carried
        sections = {
            "position": [0.0, 3.0],
            "stiffness": [stiffness.tolist()] * 2,
            "mass": [mass.tolist()] * 2,
        }
    geometry = {
        "type": "beam",
        "start": [0, -y, -z],
        "end": [3, -y, -z],
        "sections": sections,
    }
    settings = {"type": "beam", "elements": 8}
    return sid_from_model(model(geometry, settings, material=None))


@pytest.mark.parametrize("matrices", [False, True])
def test_stiffening_does_not_depend_on_the_axis_of_a_table(*, matrices: bool) -> None:
    """Stations about the line of centroids, and about one beside it.

    By accelerations across the beam up to the square of the length of the elements.
    """
    one, other = (
        stationed(0.0, 0.0, matrices=False),
        stationed(0.1, 0.15, matrices=matrices),
    )
    moved = [sid.node(2).psi for sid in (one, other)]
    sign = np.sign((moved[0].m0 * moved[1].m0).sum(axis=0))
    pair = sign[:, None] * sign
    turned = moved[1].m1 * pair[:, None]
    assert_allclose(turned, moved[0].m1, atol=1e-9 * np.abs(turned).max())
    found, expected = other.Ct.m1 * pair[:, :, None], one.Ct.m1
    scale = np.abs(expected).max()
    assert_allclose(found[..., 0], expected[..., 0], atol=1e-9 * scale)
    assert_allclose(found, expected, atol=0.03 * scale)


@pytest.mark.parametrize("below", [0.0, 0.5])
def test_a_mass_below_a_shaft_is_a_pendulum(below: float) -> None:
    """w^2 = (G J / L + m g d) / (m d^2 + I), on a shaft that only twists."""
    mass, own, torsion = 10.0, 0.2, 1e-9
    section = {"shape": "general", "area": 0.01, "iy": 1e-4, "iz": 1e-4}
    geometry = {
        "type": "frame",
        "points": {"root": [0, 0, 0], "tip": [1, 0, 0]},
        "members": {
            "shaft": {
                "start": "root",
                "end": "tip",
                "section": section | {"torsion": torsion},
            }
        },
        "masses": [
            {
                "point": "tip",
                "mass": mass,
                "inertia": [own, 0, 0],
                "offset": [0, 0, -below],
            }
        ],
    }
    names = {n: {"node": k, "point": n} for k, n in enumerate(("root", "tip"), 1)}
    frame = {"type": "tangent", "marker": "root", "clamp": "root"}
    material = {"youngs_modulus": 2e11, "poissons_ratio": 0.0, "density": 1e-3}
    line_model = model(
        geometry,
        {"type": "beam", "elements": 2},
        markers=names,
        frame=frame,
        material=material,
    )
    sid = sid_from_model(line_model)
    stiffness = sid.Ke.m0 + 9.81 * sid.Ct.m1[..., 2]
    found = scipy.linalg.eigvalsh((stiffness + stiffness.T) / 2, sid.Me.m0)[0]
    held = 1e11 * torsion + mass * 9.81 * below
    assert found == pytest.approx(held / (mass * below**2 + own), rel=1e-4)


def framed(
    points: dict[str, list[float]],
    members: dict[str, Any],
    tip: str,
    modes: int,
    **more: Any,
) -> SID:
    """A frame that is clamped at the point a, with a marker of node 2."""
    geometry = {"type": "frame", "points": points, "members": members} | more
    marked = {n: {"node": k, "point": n} for k, n in enumerate(("a", tip), 1)}
    return sid_from_model(
        model(
            geometry,
            {"type": "beam", "elements": 4, "theory": "euler_bernoulli"},
            markers=marked,
            frame={"type": "tangent", "marker": "a", "clamp": "a"},
            reduction={"method": "modal", "modes": modes},
            material={
                "youngs_modulus": 71240.0,
                "poissons_ratio": 0.31,
                "density": 1.0,
            },
        )
    )


def test_lateral_buckling_of_a_right_angled_frame() -> None:
    """J. H. Argyris et al., Comput. Methods Appl. Mech. Eng. 20, 1979: 1.088.

    Two legs of 240, sections 30 by 0.6, E = 71240, nu = 0.31; a force in the plane at
    the free end, along the leg that is clamped. Moments turn at the corner.
    """
    blade = {"shape": "rectangle", "height": 30.0, "width": 0.6}
    members = {
        "ab": {"start": "a", "end": "b", "section": blade, "y_axis": [0, 1, 0]},
        "bc": {"start": "b", "end": "c", "section": blade, "y_axis": [1, 0, 0]},
    }
    points = {"a": [0, 0, 0], "b": [240, 0, 0], "c": [240, -240, 0]}
    sid = framed(points, members, "c", 48)
    force = lowest_load(sid, sid.node(2).phi.m1[:, 0, :])
    assert force == pytest.approx(1.088, rel=3e-3)


def test_an_offset_stiffens_as_a_rigid_member() -> None:
    arm, shape = (
        [0.05, 0.1, -0.3],
        {"shape": "rectangle", "height": 0.03, "width": 0.02},
    )
    stiff = {"shape": "general", "area": 5.0, "iy": 1e-2, "iz": 1e-2, "torsion": 1e-2}
    points = {"a": [0, 0, 0], "b": [1, 0, 0], "c": [1.6, 0.3, -0.6]}
    first = {"start": "a", "end": "b", "section": shape}
    last = {"start": "b", "end": "c", "section": shape}
    one = framed(
        points, {"ab": first, "bc": last | {"offsets": {"start": arm}}}, "c", 3
    )
    members = {"ab": first, "be": {"start": "b", "end": "e", "section": stiff}}
    members["ec"] = last | {"start": "e"}
    material = {"youngs_modulus": 71240.0, "poissons_ratio": 0.31, "density": 1e-10}
    members["be"] |= {"material": "light"}
    points |= {"e": [1 + arm[0], arm[1], arm[2]]}
    geometry = {"materials": {"light": material}}
    other = framed(points, members, "c", 3, **geometry)
    phi = [sid.node(2).phi for sid in (one, other)]
    sign = np.sign((phi[0].m0 * phi[1].m0).sum(axis=0))
    found = phi[0].m1 * sign[:, None, None] * sign
    assert_allclose(found, phi[1].m1, atol=1e-3 * np.abs(found).max())


@pytest.mark.parametrize("turned", [False, True])
def test_two_members_in_line_stiffen_as_one_beam(*, turned: bool) -> None:
    shape = {"shape": "rectangle", "height": 0.03, "width": 0.02}
    points = {"a": [0.0, 0, 0], "b": [0.9, 0.5, 0.3], "m": [0.45, 0.25, 0.15]}
    up = {"section": shape, "y_axis": [0, 0, 1], "elements": 2}
    ends = ("b", "m") if turned else ("m", "b")
    whole = {"ab": {"start": "a", "end": "b", **up, "elements": 4}}
    halves = {
        "am": {"start": "a", "end": "m", **up},
        "mb": {"start": ends[0], "end": ends[1], **up},
    }
    alone = {name: place for name, place in points.items() if name != "m"}
    one, two = framed(alone, whole, "b", 5), framed(points, halves, "b", 5)
    geometry = line(shape, (0.9, 0.5, 0.3)) | {"y_axis": [0, 0, 1]}
    settings = {"type": "beam", "elements": 4, "theory": "euler_bernoulli"}
    material = {"youngs_modulus": 71240.0, "poissons_ratio": 0.31, "density": 1.0}
    reduction = {"method": "modal", "modes": 5}
    beam = sid_from_model(
        model(geometry, settings, material=material, reduction=reduction)
    )
    expected = beam.node(2)
    for sid in (one, two):
        tip = sid.node(2)
        sign = np.sign((tip.phi.m0 * expected.phi.m0).sum(axis=0))
        for name in ("phi", "psi"):
            found = getattr(tip, name).m1 * sign[:, None, None] * sign
            wanted = getattr(expected, name).m1
            assert_allclose(found, wanted, atol=1e-8 * np.abs(wanted).max())
