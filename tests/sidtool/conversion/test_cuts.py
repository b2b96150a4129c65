"""Section forces at plane cuts of solids against closed forms, joints and beams."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from tests.sidtool.conversion.sectioned_bars import (
    TURN_ABOUT_Z,
    assert_ends_have_the_forces_of_joints,
    section,
    simulated,
)

L, WIDTH, HEIGHT, E, RHO = 1.0, 0.05, 0.08, 2.1e11, 7850.0
LINE = RHO * WIDTH * HEIGHT
STEEL = {"youngs_modulus": E, "poissons_ratio": 0.3, "density": RHO}
#: Places of the cuts s1 to s5; 0.43 L passes through elements.
PLACES = (0.0, 0.25, 0.43, 0.75, 1.0)
SOLIDS: dict[str, dict[str, Any]] = {
    "hex8": {"type": "hex8", "elements": [8, 2, 2]},
    "hex20": {"type": "hex20", "elements": [4, 1, 1]},
    "tet10": {"type": "tet10", "elements": [6, 1, 1]},
    "iga": {"type": "iga", "degrees": [3, 2, 2], "elements": [4, 1, 1]},
}
WALL = {"wall": {"type": "fixed", "markers": ["ground", "bar.root"]}}


def cuts(dimension: int = 3) -> dict[str, Any]:
    """Cuts across the bar, s1 to s5."""
    return {
        f"s{k}": {
            "point": [x * L, 0.0, 0.0][:dimension],
            "normal": [1.0, 0.0, 0.0][:dimension],
        }
        for k, x in enumerate(PLACES, 1)
    }


def solid(elements: dict[str, Any], **changes: Any) -> ModelFile:
    """A bar of steel along x, both ends rigid."""
    points = [
        [
            [[x, y, z] for z in (-HEIGHT / 2, HEIGHT / 2)]
            for y in (-WIDTH / 2, WIDTH / 2)
        ]
        for x in (0.0, L)
    ]
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "material": STEEL,
        "geometry": {
            "type": "nurbs_volume",
            "degrees": [1, 1, 1],
            "knots": [[0, 0, 1, 1]] * 3,
            "control_points": points,
        },
        "discretisation": elements,
        "frame": {"type": "tangent", "marker": "root", "clamp": "left"},
        "markers": {
            "root": {"node": 1, "tie": {"type": "rigid", "to": "left"}},
            "tip": {"node": 2, "tie": {"type": "rigid", "to": "right"}},
        },
        "reduction": {"method": "craig_bampton", "interfaces": ["tip"], "modes": 3},
        "section_forces": {"cuts": cuts()},
    }
    return ModelFile.checked(data | changes, "bar")


def plate(**changes: Any) -> ModelFile:
    """The bar in the plane, bending in its width."""
    points = [[[x, y] for y in (-WIDTH / 2, WIDTH / 2)] for x in (0.0, L)]
    geometry = {
        "type": "nurbs",
        "degrees": [1, 1],
        "knots": [[0, 0, 1, 1]] * 2,
        "control_points": points,
        "thickness": HEIGHT,
    }
    data = {"geometry": geometry, "section_forces": {"cuts": cuts(2)}}
    return solid({"type": "q4", "elements": [8, 2]}, **(data | changes))


@pytest.mark.parametrize("kind", SOLIDS)
def test_normal_force_of_a_rotating_bar(kind: str) -> None:
    """N = rho A W^2 (L^2 - x^2) / 2, as the bar hardly stretches."""
    speed = 3.0
    turning = {"pieces": [{"from": 0.0, "coefficients": [0.0, speed]}]}
    result = simulated(
        sidtool.convert(solid(SOLIDS[kind])),
        joints=TURN_ABOUT_Z,
        drives={
            "motor": {"joint": "hub", "function": {"type": "polynomial"} | turning}
        },
        initial={"state": "static"},
        time={"end": 0.01, "output_step": 0.001},
        outputs={"record": ["bar.s*.N"]},
    )
    found = np.array([result[f"bar.s{k}.N"] for k in range(1, 6)])
    expected = LINE * speed**2 * (L**2 - (L * np.array(PLACES)) ** 2) / 2
    assert_allclose(found, np.tile(expected[:, None], 11), atol=1e-6 * expected[0])


def test_cantilever_under_its_weight_in_the_plane() -> None:
    """V = -rho A g (L - x), M = -rho A g (L - x)^2 / 2; it hardly bends."""
    g = 0.01
    result = simulated(
        sidtool.convert(plate()),
        dimension="planar",
        gravity=[0.0, -g],
        joints=WALL,
        initial={"state": "static"},
        time={"end": 0.01, "output_step": 0.005},
        outputs={"record": ["bar.s*.*"]},
    )
    rest = L * (1 - np.array(PLACES))
    for k, length in enumerate(rest, 1):
        expected = [0.0, -LINE * g * length, -LINE * g * length**2 / 2]
        found = section(result, f"s{k}", "N Vy Mz")
        assert_allclose(found, np.tile(expected, (3, 1)), atol=2e-5 * LINE * g)


@pytest.mark.parametrize(("kind", "stiffening"), [("hex8", None), ("iga", {})])
def test_at_both_ends_they_are_the_forces_of_the_joints(
    kind: str, stiffening: dict[str, Any] | None
) -> None:
    """Of a bar in space that turns and carries a mass at its tip."""
    sid = sidtool.convert(solid(SOLIDS[kind], stiffening=stiffening))
    assert_ends_have_the_forces_of_joints(sid, [L, 0.0, 0.0])


def test_a_solid_swings_with_the_section_forces_of_a_beam() -> None:
    """A cantilever falls under its weight; a beam of the same bar, 3 modes of each."""
    beam = ModelFile.checked(
        {
            "format": "sidtool model",
            "version": 1,
            "material": STEEL | {"poissons_ratio": 0.0},
            "geometry": {
                "type": "beam",
                "start": [0.0, 0.0, 0.0],
                "end": [L, 0.0, 0.0],
                "section": {"shape": "rectangle", "height": WIDTH, "width": HEIGHT},
            },
            "discretisation": {"type": "beam", "elements": 12, "theory": "timoshenko"},
            "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
            "markers": {
                "root": {"node": 1, "edge": "start"},
                "tip": {"node": 2, "edge": "end"},
            },
            "reduction": {"method": "modal", "modes": 3},
            "section_forces": {"stations": PLACES},
        },
        "bar",
    )
    fine = solid(
        {"type": "hex20", "elements": [10, 2, 2]},
        material=STEEL | {"poissons_ratio": 0.0},
        reduction={"method": "modal", "modes": 3},
    )
    found = []
    for model in (beam, fine):
        result = simulated(
            sidtool.convert(model),
            gravity=[0.0, 0.0, -9.81],
            joints=WALL,
            time={"end": 0.03, "output_step": 0.0005},
            outputs={"record": ["bar.s*.*"]},
        )
        found.append([section(result, f"s{k}", "Vz My") for k in range(1, 6)])
    beam_forces, solid_forces = np.array(found)
    size = np.abs(beam_forces).max(axis=(0, 1))
    assert (np.abs(solid_forces - beam_forces) <= 5e-3 * size).all()


def test_a_solid_in_free_vibration() -> None:
    """Of a cantilever: N = E A u' of its first mode along the axis, which is exact, and
    of its first bending mode M = E I w'', V = -E I w''', which neglect shear."""
    height = 0.02
    model = plate(
        discretisation={"type": "iga", "degrees": [4, 2], "elements": [5, 1]},
        material=STEEL | {"poissons_ratio": 0.0},
        reduction={"method": "modal", "modes": 7},
    ).file_data()
    points = np.array(model["geometry"]["control_points"])
    model["geometry"]["control_points"] = (points * [1.0, height / WIDTH]).tolist()
    sid = sidtool.convert(ModelFile.checked(model, "bar"))
    x, area = L * np.array(PLACES), HEIGHT * height
    bend = E * area * height**2 / 12
    omega = np.pi / (2 * L) * np.sqrt(E / RHO)
    (axial,) = np.flatnonzero(np.abs(np.sqrt(np.diag(sid.Ke.m0)) / omega - 1) < 1e-6)

    def vibrating(mode: int) -> tuple[np.ndarray, dict[str, float]]:
        elastic = [1e-6 * (k == mode) for k in range(7)]
        body = {"sid": "bar.h5", "markers": {"root": 1, "tip": 2}}
        result = simulated(
            sid,
            dimension="planar",
            joints=WALL,
            bodies={"bar": body | {"initial": {"elastic": elastic}}},
            time={"end": 1e-6, "output_step": 1e-6},
            outputs={"record": ["bar.s*.*", "bar.tip.ux", "bar.tip.uy"]},
        )
        forces = [section(result, f"s{k}", "N Vy Mz")[0] for k in range(1, 6)]
        return np.array(forces), {d: result[f"bar.tip.u{d}"][0] for d in "xy"}

    found, tip = vibrating(int(axial))
    expected = E * area * np.pi / (2 * L) * np.cos(np.pi * x / (2 * L)) * tip["x"]
    assert_allclose(found[:, 0], expected, atol=1e-6 * abs(expected[0]))

    k = brentq(lambda v: np.cosh(v) * np.cos(v) + 1, 1.0, 3.0) / L
    s = (np.cosh(k * L) + np.cos(k * L)) / (np.sinh(k * L) + np.sin(k * L))
    cosh, sinh, cos, sin = (f(k * x) for f in (np.cosh, np.sinh, np.cos, np.sin))
    found, tip = vibrating(0)
    scale = tip["y"] / (cosh - cos - s * (sinh - sin))[-1]
    moment = bend * k**2 * (cosh + cos - s * (sinh + sin)) * scale
    shear = -bend * k**3 * (sinh - sin - s * (cosh + cos)) * scale
    assert_allclose(found[:, 2], moment, atol=1e-3 * abs(moment[0]))
    assert_allclose(found[:, 1], shear, atol=1e-3 * abs(shear[0]))


def test_planes_through_curved_elements() -> None:
    """A half ring, cut along a radius: mass and centre of the sector beyond. Cut across
    its elements: the mass of the segment beyond, with the error of the mesh.
    """
    inner, outer, angle = 0.4, 0.6, 2.0
    root = np.sqrt(0.5)
    corners = [(1, 0, 1.0), (1, 1, root), (0, 1, 1.0), (-1, 1, root), (-1, 0, 1.0)]
    columns = [[[r * x, r * y] for r in (outer, inner)] for x, y, _ in corners]
    model = plate(
        geometry={
            "type": "nurbs",
            "degrees": [2, 1],
            "knots": [[0, 0, 0, 0.5, 0.5, 1, 1, 1], [0, 0, 1, 1]],
            "control_points": [column[::-1] for column in columns][::-1],
            "weights": [[w, w] for *_, w in corners],
            "thickness": HEIGHT,
        },
        discretisation={"type": "iga", "degrees": [3, 2], "elements": [6, 1]},
        section_forces={
            "cuts": {
                "s": {
                    "point": [np.cos(angle) * 0.5, np.sin(angle) * 0.5],
                    "normal": [np.sin(angle), -np.cos(angle)],
                },
                "across": {"point": [0.25, 0.5], "normal": [1.0, 0.0]},
            }
        },
    )
    sid = sidtool.convert(model)
    part = sid.section("s").part
    mass = RHO * HEIGHT * angle / 2 * (outer**2 - inner**2)
    moments = (
        RHO
        * HEIGHT
        / 3
        * (outer**3 - inner**3)
        * np.array([np.sin(angle), 1 - np.cos(angle)])
    )
    assert part.mass == pytest.approx(mass, rel=1e-6)
    origin = np.array([-0.5, 0.0])
    assert_allclose(part.mdCM.m0[:2, 0], moments - mass * origin, rtol=1e-6)
    x, radii = 0.25, np.array([inner, outer])
    areas = radii**2 / 2 * np.arccos(x / radii) - x / 2 * np.sqrt(radii**2 - x**2)
    segment = RHO * HEIGHT * (areas[1] - areas[0])
    assert sid.section("across").part.mass == pytest.approx(segment, rel=3e-5)


@pytest.mark.parametrize("kind", SOLIDS)
def test_both_sides_of_a_plane_are_the_whole_body(kind: str) -> None:
    """All mass integrals, of a tapered bar and a plane at an angle to its elements.

    Internal modes of the tapered hex8 are integrated over whole elements with an error
    of 5e-8, as the mass matrix has it.
    """
    points = [
        [[[x, r * y, r * z] for z in (-HEIGHT, HEIGHT)] for y in (-WIDTH, WIDTH)]
        for x, r in ((0.0, 0.7), (L, 0.4))
    ]
    geometry = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": points,
    }
    normal = np.array([1.0, 0.3, -0.2])
    elements = SOLIDS[kind]
    if kind == "iga":  # of lower degrees, which take a tenth of the time
        elements = elements | {"degrees": [2, 1, 1], "elements": [2, 1, 1]}
    sides = {
        name: {"point": [0.4, 0.01, 0.0], "normal": (sign * normal).tolist()}
        for name, sign in (("ahead", 1), ("behind", -1))
    }
    sid = sidtool.convert(
        solid(elements, geometry=geometry, section_forces={"cuts": sides})
    )
    ahead, behind = (sid.section(name).part for name in sides)
    assert ahead.mass + behind.mass == pytest.approx(sid.mass, rel=1e-12)
    share = 1e-7 if kind == "hex8" else 1e-10
    for name in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe"):
        whole, one, two = (s.blocks[name] for s in (sid, ahead, behind))
        size = np.abs(whole.m0).max()
        assert_allclose(one.m0 + two.m0, whole.m0, rtol=0, atol=share * size)
        if whole.m1 is not None:
            assert one.m1 is not None and two.m1 is not None
            size = np.abs(whole.m1).max()
            assert_allclose(one.m1 + two.m1, whole.m1, rtol=0, atol=share * size)
    places = [sid.section(name).node.position for name in sides]
    assert_allclose(places[0], places[1], atol=1e-9)


def deck(path: Path, cells: list[tuple[int, int, int]], h: float) -> Path:
    """An Abaqus deck of cubes of side h."""
    corners = [
        (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
        (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1),
    ]  # fmt: skip
    places: dict[tuple[int, ...], int] = {}
    rows = []
    for cell in cells:
        nodes = [tuple(np.add(cell, c).tolist()) for c in corners]
        rows.append([places.setdefault(node, len(places) + 1) for node in nodes])
    left = [k for place, k in places.items() if place[0] == 0]
    text = ["*NODE"]
    text += [f"{k}, {', '.join(str(x * h) for x in p)}" for p, k in places.items()]
    text.append("*ELEMENT, TYPE=C3D8I, ELSET=ALL")
    text += [", ".join(map(str, [k, *row])) for k, row in enumerate(rows, 1)]
    text.append("*NSET, NSET=LEFT")
    text += [str(k) for k in left]
    text += ["*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL", "*MATERIAL, NAME=STEEL"]
    text += ["*ELASTIC", f"{E}, 0.3", "*DENSITY", f"{RHO}", ""]
    path.write_text("\n".join(text), encoding="utf-8")
    return path


def fork(path: Path, **cut: Any) -> ModelFile:
    """A mesh of a fork: a stem along x, prongs from y = 0 to h and from 2 h to 3 h."""
    h = 0.02
    stem = list(product(range(2), range(3), range(1)))
    prongs = list(product(range(2, 6), (0, 2), range(1)))
    cut = {"point": [3.5 * h, 0.5 * h, 0.5 * h], "normal": [1.0, 0.0, 0.0]} | cut
    return ModelFile.checked(
        {
            "format": "sidtool model",
            "version": 1,
            "geometry": {
                "type": "mesh",
                "file": str(deck(path / "fork.inp", [*stem, *prongs], h)),
                "unit": "SI",
            },
            "discretisation": {"type": "mesh"},
            "frame": {"type": "tangent", "marker": "root", "clamp": "LEFT"},
            "markers": {
                "root": {"node": 1, "tie": {"type": "rigid", "to": "LEFT"}},
                "low": {"node": 2, "position": [6 * h, 0.5 * h, 0.5 * h]},
                "high": {"node": 3, "position": [6 * h, 2.5 * h, 0.5 * h]},
            },
            "reduction": {"method": "modal", "modes": 4},
            "section_forces": {"cuts": {"s": cut}},
        },
        "fork",
    )


def test_a_cut_of_a_mesh_through_both_prongs_or_one(tmp_path: Path) -> None:
    """The weight beyond, and a force at the tip of a prong: in the section of that
    prong only, and about its centre.
    """
    h, g, push = 0.02, 0.01, 0.007
    weight = RHO * h**3 * 2.5 * g
    for nearest, count, markers in ((False, 2, ("2", "3")), (True, 1, ("2",))):
        sid = sidtool.convert(fork(tmp_path, nearest=nearest))
        found = sid.section("s")
        assert found.beyond == markers
        assert found.part.mass == pytest.approx(RHO * h**3 * 2.5 * count)
        centre = [3.5 * h, (1.5 if count == 2 else 0.5) * h, 0.5 * h]
        assert_allclose(
            found.node.position - sid.node(1).position + [0, 1.5 * h, 0.5 * h],
            centre,
            atol=1e-12,
        )
        result = simulated(
            sid,
            gravity=[0.0, 0.0, -g],
            joints=WALL,
            bodies={
                "bar": {"sid": "f.h5", "markers": {"root": 1, "low": 2, "high": 3}}
            },
            forces={
                "push": {
                    "type": "force",
                    "marker": "bar.high",
                    "force": [0.0, 0.0, push],
                }
            },
            initial={"state": "static"},
            time={"end": 0.001, "output_step": 0.001},
            outputs={"record": ["bar.s.*"]},
        )
        forces = section(result, "s", "N Vy Vz T My Mz")[0]
        there = push if count == 2 else 0.0
        expected = [0.0, 0.0, there - weight * count, there * h, 0.0, 0.0]
        expected[4] = weight * count * 1.25 * h - there * 2.5 * h
        assert_allclose(forces[:4], expected[:4], atol=2e-5 * weight)
        assert_allclose(forces[4:], expected[4:], atol=2e-5 * weight * h)


def test_cuts_that_are_refused() -> None:
    across = {"point": [0.5, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}

    def place(message: str, **cut: Any) -> str | None:
        model = solid(SOLIDS["hex8"], section_forces={"cuts": {"s": across | cut}})
        with pytest.raises(InputError, match=message) as caught:
            sidtool.convert(model)
        return caught.value.place

    assert (
        place("does not meet", point=[2.0, 0.0, 0.0]) == "section_forces.cuts.s.point"
    )
    assert place("is zero", normal=[0.0, 0.0, 0.0]) == "section_forces.cuts.s.normal"
    assert place("coordinates", point=[0.5, 0.0]) == "section_forces.cuts.s.point"
    assert place("parallel", y_axis=[1.0, 0.0, 0.0]) == "section_forces.cuts.s.y_axis"
    assert (
        place("root", point=[0.0, 0.0, 0.0], normal=[0.0, 0.0, 1.0])
        == "section_forces.cuts.s.markers"
    )
    for given in ({"stations": 5}, {}, {"cuts": {"s": across}, "stations": 5}):
        with pytest.raises(InputError, match="section_forces"):
            solid(SOLIDS["hex8"], section_forces=given)
    with pytest.raises(InputError, match="heel"):
        named = {"s": across | {"markers": ["heel"]}}
        solid(SOLIDS["hex8"], section_forces={"cuts": named})
