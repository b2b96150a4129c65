"""Section forces of beams against closed forms and against the joints at their ends."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import sidtool
from sidtool.cli.main import run
from sidtool.conversion.frame_change import change_frame
from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics.record import DiagnosticWarning
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.storage.cache import differing_entries
from sidtool.formats.toml.reading import validate_data
from sidtool.validate import convert_units
from tests.sidtool.conversion.sectioned_bars import (
    assert_ends_have_the_forces_of_joints,
    section,
    simulated,
)

L, WIDTH, HEIGHT, E, RHO = 2.0, 0.02, 0.03, 2.1e11, 7850.0
LINE = RHO * WIDTH * HEIGHT


def bar(**changes: Any) -> ModelFile:
    """A steel bar along x with five sections, s1 to s5."""
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": E, "poissons_ratio": 0.3, "density": RHO},
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [L, 0.0, 0.0],
            "section": {"shape": "rectangle", "height": HEIGHT, "width": WIDTH},
        },
        "discretisation": {"type": "beam", "elements": 12},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "edge": "start"},
            "tip": {"node": 2, "edge": "end"},
        },
        "reduction": {"method": "modal", "modes": 2},
        "section_forces": {"stations": 5},
    }
    return ModelFile.checked(data | changes, "bar")


def test_normal_force_of_a_rotating_bar() -> None:
    """N = rho A W^2 (L^2 - x^2) / 2, as the bar hardly stretches."""
    speed = 3.0
    turning = {"pieces": [{"from": 0.0, "coefficients": [0.0, speed]}]}
    result = simulated(
        sidtool.convert(bar()),
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
        outputs={"record": ["bar.*.N"]},
    )
    x = np.linspace(0.0, L, 5)
    expected = LINE * speed**2 * (L**2 - x**2) / 2
    found = np.array([result[f"bar.s{k}.N"] for k in range(1, 6)])
    assert_allclose(found, np.tile(expected[:, None], 11), atol=1e-6 * expected[0])


def test_forces_of_an_angle_section_are_along_its_legs() -> None:
    """Its weight, m g along -z: Vz = -m g and My = m g L / 2 at the root, Vy = Mz = 0.

    The principal axes of the section are turned by 45 degrees.
    """
    angle = {"shape": "L", "height": 0.02, "width": 0.02, "thickness": 0.002}
    geometry = {"type": "beam", "start": [0.0] * 3, "end": [L, 0.0, 0.0]}
    geometry |= {"y_axis": [0.0, 1.0, 0.0], "section": angle}
    sid = sidtool.convert(bar(geometry=geometry))
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "gravity": [0.0, 0.0, -0.01],
        "time": {"end": 1.0, "output_step": 1.0},
        "bodies": {"bar": {"sid": "bar.h5", "markers": {"root": 1}}},
        "joints": {"wall": {"type": "fixed", "markers": ["ground", "bar.root"]}},
    }
    scene = validate_data(data, SceneFile)
    found = sidtool.static_equilibrium(scene, sids={"bar": sid})
    weight = 0.01 * RHO * (0.02**2 - 0.018**2) * L
    for name, expected in (
        ("Vz", -weight),
        ("My", weight * L / 2),
        ("Vy", 0),
        ("Mz", 0),
    ):
        assert found[f"bar.s1.{name}"] == pytest.approx(expected, abs=1e-4 * weight)


def test_cantilever_in_free_vibration() -> None:
    """First bending mode: M = E I phi'' q, V = -E I phi''' q at every section.

    phi = cosh kx - cos kx - s (sinh kx - sin kx), exact for the rod without rotary
    inertia, which is 1e-4 here.
    """
    sid = sidtool.convert(bar(reduction={"method": "modal", "modes": 1}))
    result = simulated(
        sid,
        joints={"wall": {"type": "fixed", "markers": ["ground", "bar.root"]}},
        outputs={"record": ["bar.s*.*", "bar.tip.uz", "wall.*"]},
        bodies={
            "bar": {
                "sid": "bar.h5",
                "markers": {"root": 1, "tip": 2},
                "initial": {"elastic": [0.01]},
            }
        },
    )
    k = brentq(lambda v: np.cosh(v) * np.cos(v) + 1, 1.0, 3.0) / L
    s = (np.cosh(k * L) + np.cos(k * L)) / (np.sinh(k * L) + np.sin(k * L))

    def shape(x: Any, order: int) -> Any:
        cosine = [np.cos, lambda v: -np.sin(v), lambda v: -np.cos(v), np.sin][order % 4]
        sine = [np.sin, np.cos, lambda v: -np.sin(v), lambda v: -np.cos(v)][order % 4]
        even = np.cosh(k * x) if order % 2 == 0 else np.sinh(k * x)
        odd = np.sinh(k * x) if order % 2 == 0 else np.cosh(k * x)
        return k**order * (even - cosine(k * x) - s * (odd - sine(k * x)))

    stiffness = E * HEIGHT * WIDTH**3 / 12
    q = result["bar.tip.uz"] / shape(L, 0)
    largest = np.abs(stiffness * shape(0.0, 2) * q).max()
    for number, x in enumerate(np.linspace(0.0, L, 5), 1):
        found = section(result, f"s{number}", "My Vz")
        expected = np.stack(
            [-stiffness * shape(x, 2) * q, -stiffness * shape(x, 3) * q], axis=1
        )
        assert_allclose(found, expected, atol=1e-3 * largest)
    wall = np.stack([result["wall.my"], result["wall.fz"]], axis=1)
    found = section(result, "s1", "My Vz")
    assert_allclose(found, -wall, atol=1e-11 * largest)


def test_rod_of_a_crank() -> None:
    """A rod between two pins: its bending moment is that of its transverse inertia.

    The transverse acceleration is linear along the rod, a + b x / L:
    M = rho A (L x - x^2) / 2 (a + b (L + x) / (3 L)) about z, V = -dM/dx. The rod is
    stiff, and its vibration from the start is damped within a millisecond.
    """
    stiff = bar(
        material={"youngs_modulus": 1e16, "poissons_ratio": 0.3, "density": RHO},
        damping={"type": "rayleigh", "beta": 1e-4},
    )
    crank, speed = 0.4, 12.0
    turning = {"pieces": [{"from": 0.0, "coefficients": [0.5, speed]}]}
    angle = np.arcsin(crank * np.sin(0.5) / L)
    start = {"position": [crank * np.cos(0.5), crank * np.sin(0.5)], "angle": -angle}
    result = simulated(
        sidtool.convert(stiff),
        dimension="planar",
        time={"end": 0.5, "output_step": 0.025},
        accuracy={"rtol": 1e-8},
        bodies={
            "bar": {"sid": "x.h5", "markers": {"root": 1, "tip": 2}, "initial": start},
            "crank": {
                "mass": 1.0,
                "inertia": 0.1,
                "markers": {"pin": {"position": [crank, 0.0]}},
            },
            "piston": {
                "mass": 2.0,
                "inertia": 0.1,
                "initial": {"position": [2.3, 0.0]},
            },
        },
        joints={
            "shaft": {"type": "revolute", "markers": ["ground", "crank"]},
            "big": {"type": "revolute", "markers": ["crank.pin", "bar.root"]},
            "small": {"type": "revolute", "markers": ["bar.tip", "piston"]},
            "guide": {"type": "prismatic", "markers": ["ground", "piston"]},
        },
        drives={
            "motor": {"joint": "shaft", "function": {"type": "polynomial"} | turning}
        },
        outputs={
            "record": ["bar.s*.*", "bar.angle", "bar.root.a*", "bar.tip.a*", "small.f*"]
        },
    )
    normal = np.stack([-np.sin(result["bar.angle"]), np.cos(result["bar.angle"])])
    ends = [
        sum(
            n * result[f"bar.{m}.a{axis}"] for n, axis in zip(normal, "xy", strict=True)
        )
        for m in ("root", "tip")
    ]
    a, b = ends[0], ends[1] - ends[0]
    for number, x in enumerate(np.linspace(0.0, L, 5), 1):
        moment = LINE * (L * x - x**2) / 2 * (a + b * (L + x) / (3 * L))
        slope = LINE / 2 * (a * (L - 2 * x) + b * (L**2 - 3 * x**2) / (3 * L))
        found = section(result, f"s{number}", "Mz Vy")
        size = LINE * L**2 * np.abs(a).max() / 8
        assert_allclose(found[1:, 0], moment[1:], atol=1e-4 * size)
        assert_allclose(found[1:, 1], -slope[1:], atol=1e-4 * size)


#: A bar with offsets, twist and lumps: nothing is symmetric.
UNSYMMETRIC: dict[str, Any] = {
    "type": "beam",
    "start": [0.0, 0.0, 0.0],
    "end": [L, 0.3, 0.0],
    "through": [[1.0, 0.4, 0.1]],
    "twist": -0.3,
    "masses": [{"at": 0.6, "mass": 1.0, "inertia": [0.01, 0.02, 0.02]}],
    "sections": {
        "fraction": [0.0, 1.0],
        "mass_per_length": [5.0, 3.0],
        "EA": [1e8, 6e7],
        "EI_y": [9e3, 5e3],
        "EI_z": [2e4, 1e4],
        "GJ": [8e3, 4e3],
        "twist": [0.0, 0.5],
        "mass_y": [0.01, 0.02],
        "tension_z": [0.01, 0.0],
        "shear_y": [-0.02, 0.01],
    },
}


@pytest.mark.parametrize("stiffening", [None, {}], ids=["plain", "stiffened"])
def test_at_both_ends_they_are_the_forces_of_the_joints(
    stiffening: dict[str, Any] | None,
) -> None:
    """Of a bar in space that turns, is pushed and carries a mass at its tip."""
    model = bar(
        material=None,
        geometry=UNSYMMETRIC,
        stiffening=stiffening,
        reduction={"method": "craig_bampton", "interfaces": ["tip"], "modes": 2},
    )
    sid = sidtool.convert(model)
    assert_ends_have_the_forces_of_joints(sid, [L, 0.3, 0.0])


def test_sections_stay_with_their_body(tmp_path: Path) -> None:
    """Through files, units, a selection of shape functions; not through ASCII."""
    sid = sidtool.convert(bar(section_forces={"stations": {"root": 0.0, "mid": 0.5}}))
    write_sid(tmp_path / "bar.h5", sid)
    again = read_sid(tmp_path / "bar.h5")
    assert differing_entries(sid, again) == []
    assert [s.beyond for s in again.sections] == [("2",), ("2",)]
    assert again.section("mid").part.mass == pytest.approx(LINE * L / 2)
    assert_allclose(again.section("mid").node.position, [L / 2, 0.0, 0.0])
    small = convert_units(sid, "SI", "mm-t-s")
    assert small.section("mid").part.mass == pytest.approx(LINE * L / 2 / 1000)
    with pytest.warns(DiagnosticWarning) as caught:
        write_sid(tmp_path / "bar.SID_FEM", sid)
    assert [w.message.code for w in caught] == ["N173"]  # type: ignore[union-attr]


@pytest.mark.parametrize("frame", ["chord:1,2", "buckens"])
def test_sections_follow_a_change_of_the_frame(frame: str) -> None:
    """The part beyond the start is the whole body; a small motion is the same, for
    one elastic coordinate, of which closing the joint takes another start.
    """
    sid = sidtool.convert(bar(reduction={"method": "modal", "modes": 1}))
    changed = change_frame(sid, frame)
    for name in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe"):
        whole, part = (s.blocks[name] for s in (changed, changed.section("s1").part))
        for own, other in ((whole.m0, part.m0), (whole.m1, part.m1)):
            if own is not None:
                size = np.abs(own).max(initial=1e-300)
                assert_allclose(other, own, rtol=0, atol=1e-10 * size)
    start = {"elastic": [1e-4]}
    forces = []
    for each in (sid, changed):
        result = simulated(
            each,
            joints={"wall": {"type": "fixed", "markers": ["ground", "bar.root"]}},
            outputs={"record": ["bar.s*.*", "bar.q1"]},
            bodies={"bar": {"sid": "bar.h5", "markers": {"root": 1}, "initial": start}},
            accuracy={"rtol": 1e-9},
        )
        found = [section(result, f"s{k}", "Vz My") for k in range(1, 5)]
        forces.append(np.array(found) / result["bar.q1"][0])
    size = np.abs(forces[0]).max(axis=(0, 1))
    assert (np.abs(forces[1] - forces[0]) <= 1e-5 * size).all()


def test_sections_that_are_not_there() -> None:
    sid = sidtool.convert(bar(section_forces=None))
    with pytest.raises(InputError) as caught:
        simulated(sid, outputs={"record": ["bar.s1.My"]})
    assert "[section_forces]" in str(caught.value)
    with pytest.raises(InputError, match="there is no section 's9'"):
        simulated(sidtool.convert(bar()), outputs={"record": ["bar.s9.My"]})
    with pytest.raises(InputError, match="'2nd'"):
        bar(section_forces={"stations": {"2nd": 0.5}})


def test_envelopes_along_the_beam(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = simulated(
        sidtool.convert(bar()),
        gravity=[0.0, 0.0, -9.81],
        joints={"wall": {"type": "fixed", "markers": ["ground", "bar.root"]}},
        time={"end": 0.01, "output_step": 0.005},
    )
    sidtool.write(tmp_path / "r.h5", result)
    picture = tmp_path / "p.png"
    arguments = ["plot", str(tmp_path / "r.h5"), "-o", str(picture)]
    assert run([*arguments, "--kind", "sections"]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr()
    assert "Vz" in printed.out + printed.err
    assert run([*arguments, "--kind", "sections", "--outputs", "rod"]) == 2
