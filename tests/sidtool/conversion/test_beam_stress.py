"""Stress of beams against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.base.stress import (
    node_stress,
    peak_stress,
    stress_nodes,
    stress_norm,
)
from tests.codes import codes, only

from .test_section_forces import L, bar, simulated

TIP = {"method": "attachment", "interfaces": ["tip"], "modes": 0}
pytestmark = pytest.mark.filterwarnings("ignore:N161")
STRAIGHT = {"type": "beam", "start": [0.0, 0.0, 0.0], "end": [L, 0.0, 0.0]}


def stressed(section: dict[str, Any], **geometry: Any) -> SID:
    return sidtool.convert(
        bar(
            geometry=STRAIGHT | {"section": section} | geometry,
            discretisation={"type": "beam", "elements": 4},
            reduction=TIP,
            stress={},
            section_forces=None,
        )
    )


def loaded(sid: SID, *loads: float) -> Array:
    """The elastic coordinates under forces and moments at the tip."""
    tip = sid.node(2)
    work = np.vstack([tip.phi.m0, tip.psi.m0])
    return np.linalg.solve(sid.Ke.m0, work.T @ loads)


def peak(section: dict[str, Any], *loads: float) -> float:
    sid = stressed(section)
    return float(peak_stress(sid, loaded(sid, *loads)))


def test_rectangle() -> None:
    """Corners under tension and bending; Timoshenko's table: T / (0.231 h w^2)."""
    h, w = 0.03, 0.02
    sid = stressed({"shape": "rectangle", "height": h, "width": w})
    axial, fy, fz, torque = 9e3, 40.0, 25.0, 70.0
    bent = 6 * L * (fy / (w * h**2) + fz / (h * w**2))
    found = peak_stress(sid, loaded(sid, axial, fy, fz, 0.0, 0.0, 0.0))
    assert found == pytest.approx(axial / (h * w) + bent, rel=1e-9)
    found = peak_stress(sid, loaded(sid, 0.0, 0.0, 0.0, torque, 0.0, 0.0))
    assert found == pytest.approx(np.sqrt(3) * torque / (0.231 * h * w**2), rel=3e-3)


def test_the_norm_of_the_stress_over_a_bar() -> None:
    """F / A everywhere under tension; F (L - x) y / I at each node bent by a tip force,
    and (sum s^8 / n)^(1/8) of that."""
    h, w, force = 0.03, 0.02, 400.0
    sid = stressed({"shape": "rectangle", "height": h, "width": w})
    pulled = loaded(sid, force, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert stress_norm(sid, pulled) == pytest.approx(force / (h * w), rel=1e-9)
    bent = loaded(sid, 0.0, force, 0.0, 0.0, 0.0, 0.0)
    nodes = [node.position for node in sid.nodes if node.sigma is not None]
    x, y, _ = np.array(nodes).T
    stress = np.abs(force * (L - x) * y / (w * h**3 / 12))
    expected = np.mean(stress**8) ** 0.125
    assert stress_norm(sid, np.array([bent, -2.0 * bent])) == pytest.approx(
        [expected, 2.0 * expected], rel=1e-6
    )
    assert expected < peak_stress(sid, bent) <= expected * len(x) ** 0.125


@pytest.mark.parametrize("thickness", [None, 0.004])
def test_round_sections(thickness: float | None) -> None:
    """Bending towards 45 degrees, and torsion T r / J, in one point."""
    d = 0.05
    hole = 0.0 if thickness is None else d - 2 * thickness
    tube: dict[str, Any] = {"shape": "tube", "thickness": thickness}
    shape = {"shape": "circle"} if thickness is None else tube
    polar = np.pi / 32 * (d**4 - hole**4)
    bent = np.sqrt(2) * 30.0 * L * d / polar
    sheared = 100.0 * d / 2 / polar
    found = peak(shape | {"diameter": d}, 0.0, 30.0, 30.0, 100.0, 0.0, 0.0)
    assert found == pytest.approx(np.hypot(bent, np.sqrt(3) * sheared), rel=1e-9)


def test_box() -> None:
    """Bending stress of the flange, and Bredt's T / (2 A t), at its middle."""
    h, w, t = 0.06, 0.04, 0.003
    section = {"shape": "box", "height": h, "width": w, "thickness": t}
    second = (w * h**3 - (w - 2 * t) * (h - 2 * t) ** 3) / 12
    bent = 100.0 * L * h / 2 / second
    sheared = 300.0 / (2 * (h - t) * (w - t) * t)
    found = peak(section, 0.0, 100.0, 0.0, 300.0, 0.0, 0.0)
    assert found == pytest.approx(np.hypot(bent, np.sqrt(3) * sheared), rel=1e-9)


def test_walls_in_torsion() -> None:
    """T t / J on the faces of the thickest wall; J = sum of b t^3 / 3 within 8 %."""
    h, w, web, flange = 0.2, 0.1, 0.0056, 0.0085
    section = {"shape": "I", "height": h, "width": w, "web": web, "flange": flange}
    torsion = (2 * w * flange**3 + (h - flange) * web**3) / 3
    found = peak(section, 0.0, 0.0, 0.0, 50.0, 0.0, 0.0)
    assert found == pytest.approx(np.sqrt(3) * 50.0 * flange / torsion, rel=0.08)


@pytest.mark.parametrize("shape", ["T", "L"])
def test_unsymmetric_bending(shape: str) -> None:
    """The largest of Navier's stresses at the corners, with the product of inertia."""
    h, w, t, f = 0.06, 0.05, 0.006, 0.009
    sizes: dict[str, float] = {"web": t, "flange": f}
    plates = [(0.0, h - f, -t / 2, t / 2), (h - f, h, -w / 2, w / 2)]
    if shape == "L":
        sizes, plates = {"thickness": t}, [(0.0, t, 0.0, w), (t, h, 0.0, t)]
    area, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
    for bottom, top, left, right in plates:
        a = (top - bottom) * (right - left)
        middle = np.array([top + bottom, right + left]) / 2
        own = np.diag([(top - bottom) ** 2, (right - left) ** 2]) / 12
        area, first = area + a, first + a * middle
        second = second + a * (own + np.outer(middle, middle))
    centroid = first / area
    second = second - area * np.outer(centroid, centroid)
    corners = [
        np.array([y, z]) - centroid
        for bottom, top, left, right in plates
        for y in (bottom, top)
        for z in (left, right)
    ]
    moments = np.array([120.0, 70.0])  # of sigma dA times y, z
    slope = np.linalg.solve(second, moments)
    expected = max(abs(corner @ slope) for corner in corners)
    section = {"shape": shape, "height": h, "width": w} | sizes
    found = peak(section, 0.0, 0.0, 0.0, 0.0, moments[1], -moments[0])
    assert found == pytest.approx(expected, rel=1e-9)


def test_curved_bar() -> None:
    """Winkler: M (r_n - r_i) / (A (R - r_n) r_i), with r_n = h / log(r_o / r_i)."""
    radius, h, w = 0.2, 0.1, 0.02
    turn = np.linspace(0.0, np.pi / 2, 33)
    points = radius * np.stack([np.sin(turn), 1 - np.cos(turn), 0 * turn], axis=1)
    section = {"shape": "rectangle", "height": h, "width": w}
    sid = stressed(
        section,
        through=points[1:-1].tolist(),
        end=points[-1].tolist(),
        y_axis=[0.0, 1.0, 0.0],
    )
    inner, outer, moment = radius - h / 2, radius + h / 2, 800.0
    neutral = h / np.log(outer / inner)
    expected = moment * (neutral - inner) / (h * w * (radius - neutral) * inner)
    found = peak_stress(sid, loaded(sid, 0.0, 0.0, 0.0, 0.0, 0.0, moment))
    assert found == pytest.approx(expected, rel=2e-3)


def test_components_are_in_the_axes_of_the_body() -> None:
    """Along z: sigma_zz by bending, and shear zx, zy by torsion."""
    section = {"shape": "circle", "diameter": 0.05}
    sid = stressed(section, end=[0.0, 0.0, L], y_axis=[1.0, 0.0, 0.0])
    q = loaded(sid, 0.0, 0.0, 500.0, 0.0, 0.0, 0.0)
    area = np.pi * 0.05**2 / 4
    twist = loaded(sid, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0)
    for node in stress_nodes(sid):
        expected = [0.0, 0.0, 500.0 / area, 0.0, 0.0, 0.0]
        assert_allclose(node_stress(sid, node, q), expected, atol=1e-6 * 500.0 / area)
        x, y = sid.node(node).origin.m0[:2, 0]
        shear = 10.0 / (np.pi * 0.05**4 / 32)
        expected = [0.0, 0.0, 0.0, 0.0, shear * x, -shear * y]
        assert_allclose(node_stress(sid, node, twist), expected, atol=1e-6 * shear)


def test_peak_as_an_output() -> None:
    """A bar that turns: its stress is that of the section forces at the hub."""
    turning = {"pieces": [{"from": 0.0, "coefficients": [0.0, 30.0]}]}
    section = {"shape": "box", "height": 0.04, "width": 0.03, "thickness": 0.002}
    model = bar(
        geometry=STRAIGHT | {"section": section},
        reduction={"method": "attachment", "interfaces": ["tip"], "modes": 1}
        | {"centrifugal": True},
        damping={"type": "rayleigh", "beta": 1e-3},
        stress={},
    )
    result = simulated(
        sidtool.convert(model),
        joints={
            "hub": {
                "type": "revolute",
                "markers": ["ground", "bar.root"],
                "axis": [0.0, 0.0, 1.0],
            }
        },
        drives={
            "motor": {"joint": "hub", "function": {"type": "polynomial"} | turning}
        },
        outputs={"record": ["bar.s1.*", "bar.peak_von_mises"]},
    )
    area = 0.04 * 0.03 - 0.036 * 0.026
    second = (0.03 * 0.04**3 - 0.026 * 0.036**3) / 12
    normal, moment = result["bar.s1.N"], result["bar.s1.Mz"]
    expected = np.abs(normal) / area + np.abs(moment) * 0.02 / second
    assert_allclose(result["bar.peak_von_mises"][1:], expected[1:], rtol=1e-3)
    hub = 7850.0 * 30.0**2 * L**2 / 2
    assert normal[-1] / area == pytest.approx(hub, rel=1e-3)


def test_derivative_of_the_stress() -> None:
    """Against differences of two conversions, at the same points."""
    section = {"shape": "box", "height": 0.04, "width": 0.03, "thickness": 0.002}
    model = bar(
        geometry=STRAIGHT | {"section": section},
        discretisation={"type": "beam", "elements": 4},
        reduction=TIP,
        stress={"peak_points": 2},
        section_forces=None,
    )
    derivatives = sidtool.sid_derivatives(model, ["geometry.section.height"])
    sid = derivatives.sid
    step = 1e-6
    near = sidtool.convert(model.with_({"geometry.section.height": 0.04 + step}))
    change = derivatives["geometry.section.height"]
    for node in stress_nodes(sid):
        expected = (near.node(node).sigma.m1 - sid.node(node).sigma.m1) / step
        found = change.node(node).sigma.m1
        assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


GENERAL = {
    "shape": "general",
    "area": 6e-4,
    "iy": 2e-8,
    "iz": 4.5e-8,
    "torsion": 4e-8,
}


def test_what_has_no_stress_is_refused() -> None:
    with pytest.raises(InputError, match="no stress in sections without a shape"):
        stressed(GENERAL)
    with pytest.raises(InputError, match=r"no stress at marker tip.*peak points"):
        sidtool.convert(bar(stress={"markers": ["tip"]}))


@pytest.mark.parametrize("centrifugal", [False, True])
def test_missing_centrifugal_stress_is_named(centrifugal: bool) -> None:
    """A bar that turns about its end: its linear shape has 1/9 of the energy of 2/15.

    The largest stress was 2/3 of rho w^2 L^2 / 2 at the axis, without a word.
    """
    given = {
        "geometry": STRAIGHT | {"section": {"shape": "circle", "diameter": 0.02}},
        "discretisation": {"type": "beam", "elements": 24},
        "reduction": TIP | {"centrifugal": centrifugal, "inertia_relief": False},
        "section_forces": None,
        "stiffening": {},
    }
    sid = sidtool.convert(bar(stress={}, **given))
    assert "N166" not in codes(sidtool.convert(bar(**given)))
    if centrifugal:
        assert "N166" not in codes(sid)
    else:
        found = only(sid, "N166").data
        assert found["axes"] == ("y", "z")
        assert found["missing"] == pytest.approx(1.0 - (1 / 9) / (2 / 15), rel=2e-3)


def test_peak_points_of_what_is_pulled_and_bent() -> None:
    """N / A + M / W of a rod on pins under a pull and transverse accelerations.

    The points of random states of all shape functions missed 18 % of it.
    """
    d = 0.05
    sid = sidtool.convert(
        bar(
            geometry=STRAIGHT
            | {"end": [1.0, 0.0, 0.0], "y_axis": [0.0, 1.0, 0.0]}
            | {"section": {"shape": "rectangle", "height": d, "width": d}},
            discretisation={"type": "beam", "elements": 8},
            frame={"type": "chord", "markers": ["root", "tip"]},
            markers={
                "root": {"node": 1, "edge": "start"},
                "tip": {"node": 2, "edge": "end"},
                "middle": {"node": 3, "parameters": [0.5]},
            },
            reduction=TIP | {"interfaces": ["root", "tip"]},
            stress={},
            section_forces=None,
        )
    )
    line, x = 7850.0 * d**2, np.linspace(0.0, 1.0, 1001)
    for pull in (1.0, -1.0, 0.3, -0.3):
        for uniform, linear in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 0.5), (-1, 1)):
            a, alpha = np.array([8.0 * uniform, 15.6 * linear]) * d**3 / 6 / line
            moment = line * (a * x * (1.0 - x) / 2 + alpha * x * (1.0 - x**2) / 6)
            felt = sid.node(2).phi.m0[0] * pull * d**2
            felt = felt - sid.Ct.m0[:, 1] * a - sid.Cr.m0[:, 2] * alpha
            expected = abs(pull) + np.abs(moment).max() * 6 / d**3
            found = peak_stress(sid, np.linalg.solve(sid.Ke.m0, felt))
            assert 0.98 * expected < found < 1.02 * expected
