"""Section forces of frames with rings against statics and open frames."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.conversion.frame_change import change_frame
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.sid_subset import select_shape_functions
from sidtool.formats.storage.cache import differing_entries
from sidtool.mesh.unit_systems import convert_units
from sidtool.validate.basis_change import change_basis
from tests.sidtool.frames import (
    NU,
    RHO,
    STIFF,
    TUBE,
    E,
    frame,
    hinged_crane,
    section_forces,
)

#: Shape functions that know the load, that do not, and hardly any.
REDUCTIONS: list[dict[str, Any]] = [
    {"method": "attachment", "interfaces": ["tip"], "modes": 0},
    {"method": "craig_bampton", "interfaces": ["tip"], "modes": 4},
    {"method": "modal", "modes": 1},
]


@pytest.mark.parametrize("reduction", REDUCTIONS, ids=lambda r: r["method"])
def test_section_forces_of_a_ring_and_of_what_it_carries(
    reduction: dict[str, Any],
) -> None:
    """Moments about the pins: the strut carries 2 sqrt(2) F; beside the ring the part
    beyond a section is in equilibrium."""
    force = 0.1
    found = section_forces(sidtool.convert(hinged_crane(reduction=reduction)), force)
    expected = {
        "c.strut.s2.N": -2 * math.sqrt(2) * force,
        "c.strut.s2.My": 0.0,
        "c.outer.s1.N": 0.0,
        "c.outer.s1.My": 1.5 * force,
        "c.outer.s2.My": 0.75 * force,
        "c.inner.s1.My": 0.0,
        "c.inner.s2.My": 0.75 * force,
        "c.inner.s3.My": 1.5 * force,
        "c.inner.s2.N": 2 * force,
        "c.upper.s2.N": force,
        "c.lower.s1.N": -force,
        "c.lower.s1.My": 3.0 * force,
        "c.lower.s3.My": 3.0 * force,
    }
    for name, value in expected.items():
        assert abs(found[name]) == pytest.approx(abs(value), abs=2e-4 * force), name
    assert found["c.strut.s2.N"] < 0 < found["c.inner.s2.N"]
    assert found["c.strut.s2.N"] == pytest.approx(-2 * math.sqrt(2) * force, rel=1e-9)


def test_sections_of_rings_in_other_units_and_from_a_file(tmp_path: Path) -> None:
    force = 0.1
    sid = sidtool.convert(hinged_crane(reduction=REDUCTIONS[0]))
    write_sid(tmp_path / "c.h5", sid)
    assert not differing_entries(sid, read_sid(tmp_path / "c.h5"))
    back = convert_units(convert_units(sid, "SI", "mm-t-s"), "mm-t-s", "SI")
    found = section_forces(back, force)["c.strut.s2.N"]
    assert found == pytest.approx(-2 * math.sqrt(2) * force, rel=1e-9)


@pytest.mark.parametrize("reduction", REDUCTIONS, ids=lambda r: r["method"])
def test_the_weight_in_a_ring(reduction: dict[str, Any]) -> None:
    """Moments about pins, with w the weight per length: the boom of 3 m rests on the
    strut with 3 w, and N in the middle of the strut is -sqrt(2) (3 w + W / 2), of which
    W is its own weight; half of that is a load across it, M = W l / 8 in the middle.
    """
    density, g = 7850.0, 1e-3
    steel = {"youngs_modulus": E, "poissons_ratio": NU, "density": density}
    model = hinged_crane(geometry={"materials": {"light": steel}}, reduction=reduction)
    found = section_forces(sidtool.convert(model), 0.0, weight=g)
    area = math.pi * (0.03**2 - 0.026**2)
    w, length = density * area * g, 1.5 * math.sqrt(2)
    normal = -math.sqrt(2) * (3 * w + w * length / 2)
    assert found["c.strut.s2.N"] == pytest.approx(normal, rel=1e-6)
    across = w / math.sqrt(2) * length**2 / 8
    assert abs(found["c.strut.s2.My"]) == pytest.approx(across, rel=1e-6)
    assert abs(found["c.strut.s1.My"]) == pytest.approx(0.0, abs=1e-6 * across)
    middle = w * 1.5**2 / 2
    assert abs(found["c.inner.s3.My"]) == pytest.approx(middle, rel=1e-6)


def portal(**changes: Any) -> ModelFile:
    """A ring of light legs and base and a heavy girder."""
    points = {"a": [0, 0, 0], "b": [0, 0, 2.0], "c": [3.0, 0, 2.0], "d": [3.0, 0, 0]}
    light = {"section": STIFF, "material": "light", "y_axis": [0.0, 1.0, 0.0]}
    members = {
        "left": ("a", "b", light),
        "girder": ("b", "c", {"section": STIFF}),
        "right": ("d", "c", light),
        "base": ("d", "a", light),
    }
    light_steel = {"youngs_modulus": E, "poissons_ratio": NU, "density": 1e-3}
    return frame(
        points,
        members,
        **{
            "geometry": {"materials": {"light": light_steel}},
            "markers": {"p": {"node": 1, "point": "a"}, "q": {"node": 2, "point": "d"}},
            "reduction": {"method": "craig_bampton", "interfaces": ["q"], "modes": 2},
            "section_forces": {"stations": 3},
        }
        | changes,
    )


PORTAL_SCENE: dict[str, Any] = {
    "dimension": "spatial",
    "gravity": [0.0, 0.0, -1e-4],
    "time": {"end": 0.5, "output_step": 0.05},
    "bodies": {"c": {"sid": "c.h5", "markers": {"p": 1, "q": 2}}},
    "joints": {
        "left": {"type": "fixed", "markers": ["ground", "c.p"]},
        "right": {"type": "fixed", "markers": ["ground.foot", "c.q"]},
    },
    "ground": {"markers": {"foot": {"position": [3.0, 0.0, 0.0]}}},
    "outputs": {"record": ["c.*.*.*", "right.*"]},
}


def test_a_portal_under_the_weight_of_its_girder() -> None:
    """Kleinlogel: M = w L^2 / (12 (k + 2)) at the feet and twice that at the corners,
    k = h / L for one section; w L^2 / 8 less in the middle.
    """
    scene = sidtool.Scene(**PORTAL_SCENE)
    found = sidtool.static_equilibrium(scene, sids={"c": sidtool.convert(portal())})
    span, height = 3.0, 2.0
    load = RHO * STIFF["area"] * 1e-4 * span**2
    foot = load / (12 * (height / span + 2))
    for name, expected in {
        "c.left.s1.My": foot,
        "c.left.s3.My": 2 * foot,
        "c.girder.s1.My": 2 * foot,
        "c.girder.s2.My": load / 8 - 2 * foot,
        "c.right.s1.My": foot,
    }.items():
        assert abs(found[name]) == pytest.approx(expected, rel=1e-4), name
    assert abs(found["c.girder.s2.N"]) == pytest.approx(3 * foot / height, rel=1e-4)
    assert abs(found["c.left.s2.N"]) == pytest.approx(load / span / 2, rel=1e-4)


def test_a_ring_that_a_soft_spring_closes_has_the_forces_of_the_open_frame() -> None:
    """An angle with a mass at its tip spins up under gravity, with damping: the part
    beyond a section of the open frame is in equilibrium.
    """
    soft = {"points": ["tip", "foot"], "stiffness": [1e-6] * 6}
    found = []
    for springs in ({}, {"s": soft}):
        model = frame(
            {"foot": [0, 0, 0], "knee": [1.0, 0, 0], "tip": [1.0, 0.5, 0.2]},
            {
                "inner": ("foot", "knee", {"section": TUBE}),
                "outer": ("knee", "tip", {"section": TUBE}),
            },
            geometry={"springs": springs, "masses": [{"point": "tip", "mass": 2.0}]},
            markers={"p": {"node": 1, "point": "foot"}},
            damping={"type": "rayleigh", "beta": 2e-3},
            reduction={"method": "modal", "modes": 3},
            section_forces={"stations": 3},
        )
        sid = sidtool.convert(model)
        assert (sid.section("inner.s1").node.sigma is None) == (not springs)
        result = sidtool.simulate(
            sidtool.Scene(
                dimension="spatial",
                gravity=[0.0, 0.0, -0.01],
                time={"end": 0.1, "output_step": 0.01},
                bodies={"c": {"sid": "c.h5", "markers": {"p": 1}}},
                joints={
                    "hub": {
                        "type": "revolute",
                        "markers": ["ground", "c.p"],
                        "axis": [0.0, 0.0, 1.0],
                    }
                },
                drives={
                    "motor": {
                        "joint": "hub",
                        "function": {
                            "type": "polynomial",
                            "pieces": [{"from": 0.0, "coefficients": [0.0, 0.2, 0.3]}],
                        },
                    }
                },
                accuracy={"rtol": 1e-9},
                outputs={"record": ["c.*.*.*"]},
            ),
            sids={"c": sid},
        )
        names = [f"c.inner.s{k}.{q}" for k in (1, 2, 3) for q in ("N", "Vy", "Vz")]
        names += [f"c.outer.s{k}.{q}" for k in (1, 2) for q in ("T", "My", "Mz")]
        found.append(np.stack([result[name] for name in names]))
    opened, closed = found
    forces, moments = slice(0, 9), slice(9, None)
    size = np.abs(opened[forces]).max()
    assert_allclose(closed[forces], opened[forces], atol=1e-9 * size)
    # Moments of rings have the arms of the undeformed frame, 0.5 m long.
    assert_allclose(closed[moments], opened[moments], atol=1e-4 * size * 0.5)


@pytest.mark.parametrize("frame_settings", ["tangent", "buckens"])
def test_forces_at_a_node_of_a_ring_are_in_equilibrium(frame_settings: str) -> None:
    """The girder falls: leg, base and joint at a foot, at all times."""
    settings: dict[str, Any] = {"type": "tangent", "marker": "p", "clamp": "a"}
    if frame_settings == "buckens":
        settings = {"type": "buckens"}
    sid = sidtool.convert(portal(frame=settings))
    result = sidtool.simulate(sidtool.Scene(**PORTAL_SCENE), sids={"c": sid})
    for kind, quantities in (("f", "N Vy Vz"), ("m", "T My Mz")):
        joint = np.stack([result[f"right.{kind}{axis}"] for axis in "xyz"], axis=1)
        total = np.zeros_like(joint)
        for member in ("right", "base"):
            names = [f"c.{member}.s1.{q}" for q in quantities.split()]
            own = np.stack([result[name] for name in names], axis=1)
            total += own @ sid.section(f"{member}.s1").node.AP.m0.T
        size = np.abs(joint).max()
        assert size > 0
        assert_allclose(total + joint, 0.0, atol=1e-6 * size)


def test_sections_of_rings_with_fewer_shape_functions_and_in_other_units() -> None:
    """The section forces of any of them are those of all loads."""
    scene = sidtool.Scene(**PORTAL_SCENE)
    sid = sidtool.convert(portal())
    whole = sidtool.static_equilibrium(scene, sids={"c": sid})
    kept = [*range(6), 7]
    mixed = np.eye(sid.nq) + 0.1 * np.tri(sid.nq, k=-1)
    others = {
        "fewer": select_shape_functions(sid, kept),
        "mixed": change_basis(sid, mixed),
        "units": convert_units(convert_units(sid, "SI", "mm-t-s"), "mm-t-s", "SI"),
        "frame": change_frame(sid, "buckens"),
    }
    for changed in others.values():
        found = sidtool.static_equilibrium(scene, sids={"c": changed})
        for name in ("c.girder.s2.My", "c.girder.s2.N", "c.left.s1.Vz"):
            assert found[name] == pytest.approx(whole[name], rel=1e-4)


def test_sections_do_not_hinder_derivatives_of_the_frame() -> None:
    """The mass by the height of a corner: that of the light leg to it, per length."""
    found = sidtool.sid_derivatives(portal(), ["geometry.points.b[2]"])
    slope = 1e-3 * STIFF["area"]
    assert found.derivative("mass", "geometry.points.b[2]") == pytest.approx(slope)


def test_a_stiffened_frame_on_two_feet_bears_its_weight() -> None:
    """The foot hardly moves in some shape functions: a search along them for redundant
    constraints would deform the frame far beyond what has an inertia.
    """
    sid = sidtool.convert(portal(stiffening={}))
    body = PORTAL_SCENE["bodies"]["c"] | {"shape_functions": [1, 2, 3, 4, 5, 6]}
    scene = PORTAL_SCENE | {"bodies": {"c": body}}
    scene["outputs"] = {"record": ["left.fz", "right.fz"]}
    found = sidtool.static_equilibrium(sidtool.Scene(**scene), sids={"c": sid})
    assert abs(found["left.fz"] + found["right.fz"]) == pytest.approx(1e-4 * sid.mass)
