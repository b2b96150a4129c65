"""Examples of vibrations and imported meshes move as mechanics says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import brentq

import sidtool

from .commands import run_notebook
from .example_runs import IN_OTHER_FILE, check_files, result_of


@pytest.mark.parametrize("name", IN_OTHER_FILE)
def test_the_commands_run_and_leave_no_tracked_file_changed(ran, name: str) -> None:
    check_files(ran(name))


def test_the_helicopter_shakes_as_coleman_and_feingold_say(ran) -> None:
    """Roots of their quartic for a support without directions; rigid blades."""
    folder = ran("helicopter")
    blade, length, e, W = 2700 * 0.04 * 0.16 * 4.0, 4.0, 0.3, 20.0
    S, J = blade * length / 2, blade * (length**2 / 3 + 0.04**2 / 12)
    w = np.poly1d([1.0, 0.0])
    lag = 300.0 + e * S * W**2 - J * (w - W) ** 2
    roots = ((1e5 - (520.0 + 3 * blade) * w**2) * lag - 1.5 * S**2 * w**4).roots
    (growing,) = roots[roots.imag < -0.1]
    result = result_of(folder)
    late = result.t > 2.0
    whirl = np.abs(result["hub.x"] + 1j * result["hub.y"])[late]
    growth, _ = np.polyfit(result.t[late], np.log(whirl), 1)
    assert growth == pytest.approx(-growing.imag, rel=0.01)
    modes = sidtool.linearise(folder / "scene.toml", about="start")
    k = modes.eigenvalues.real.argmax()
    assert modes.eigenvalues[k].real == pytest.approx(-growing.imag, rel=0.005)
    hertz = modes.inertial_frequencies[k]
    assert hertz == pytest.approx(growing.real / (2 * np.pi), rel=0.002)


def test_the_bracket_gives_way_as_a_curved_beam_in_every_format(ran) -> None:
    """Winkler's beam with shear; rigid ends stiffen the solid by half a per cent."""
    folder = ran("imported_mesh")
    R, h, E, nu = 0.1, 0.02, 2.1e11, 0.3
    e = R - h / np.log((R + h / 2) / (R - h / 2))
    shear = 2 * (1 + nu) * (12 + 11 * nu) / (10 * (1 + nu))
    expected = np.pi / 4 * 1000.0 * R / (E * h**2) * (R / e - 1 + shear)
    for name in ("bracket", "msh", "cdb", "bdf"):
        sid = sidtool.read(folder / f"{name}.SID_FEM")
        shapes = sid.node("2").phi.m0[0]
        moved = 1000.0 * shapes @ np.linalg.solve(sid.Ke.m0, shapes)
        assert moved == pytest.approx(expected, rel=0.015)
        assert sid.mass == pytest.approx(7850 * h**2 * np.pi / 2 * R, rel=2e-3)
    ux = result_of(folder)["bracket.end.ux"]
    assert ux.mean() == pytest.approx(expected, rel=0.02)
    assert 1.8 < ux.max() / expected < 2.0  # each mode moves up to twice its share


def test_the_rotor_answers_its_unbalance_as_a_beam_on_two_springs(ran) -> None:
    """Exact dynamic stiffness of both halves of the shaft, films of the table."""
    folder = ran("unbalance")
    table = np.loadtxt(folder / "bearing_table.csv", delimiter=",", skiprows=2)
    EI, line, a = 2.1e11 * np.pi / 64 * 0.04**4, 7850 * np.pi / 4 * 0.04**2, 0.4
    found = np.loadtxt(folder / "unbalance.csv", delimiter=",", skiprows=1)
    expected = []
    for W in found[:, 0]:
        row = [np.interp(W, table[:, 0] * np.pi / 30, c) for c in table[:, 1:].T]
        K, C = np.reshape(row, (2, 2, 2)) * np.array([1e6, 1e3])[:, None, None]
        b = (line * W**2 / EI) ** 0.25
        cosh, sinh, cos, sin = (f(b * a) for f in (np.cosh, np.sinh, np.cos, np.sin))
        # A (cosh + cos) + B sinh + D sin: no moment at the film, level at the disc.
        motion = np.array([[2, 0, 0], [cosh + cos, sinh, sin], [sinh - sin, cosh, cos]])
        thirds = np.array([[0, 1, -1], [-sinh - sin, -cosh, cos]])
        shaft = 2 * EI * b**3 * thirds @ np.linalg.inv(motion)[:, :2]
        shaft[1, 1] -= 45.0 * W**2
        stiffness = np.kron(shaft, np.eye(2)).astype(complex)
        stiffness[:2, :2] += 2 * (K + 1j * W * C)
        turning = np.array([0, 0, 1, -1j]) * 1e-3 * W**2
        expected.append(np.abs(np.linalg.solve(stiffness, turning))[2:])
    assert np.abs(found[:, 1:] - expected).max() < 0.005 * np.max(expected)


def test_moves_leave_the_energy_of_the_first_mode(ran) -> None:
    """Of a beam with a point mass at its end, driven by the fifth-order polynomial."""
    folder = ran("parameter_study")
    rows = np.genfromtxt(
        folder / "study.csv", delimiter=",", skip_header=1, usecols=(0, 1, 2)
    )
    EI, line = 7e10 * 0.06 * 0.02**3 / 12, 2700 * 0.06 * 0.02
    x, u = np.linspace(0, 1, 2001), np.linspace(0, 1, 4001)
    for load in (0.5, 1.0):

        def ends(b: float, share: float = load / line) -> float:
            bent = np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b)
            return 1 + np.cos(b) * np.cosh(b) + share * b * bent

        b = brentq(ends, 0.5, 1.8)
        ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        phi = np.cosh(b * x) - np.cos(b * x)
        phi -= ratio * (np.sinh(b * x) - np.sin(b * x))
        norm = trapezoid(line * phi**2, x) + load * phi[-1] ** 2
        part = (trapezoid(line * x * phi, x) + load * phi[-1]) / np.sqrt(norm)
        w = b**2 * np.sqrt(EI / line)
        own = rows[rows[:, 1] == load]
        gain = 0.3 * (60 * u - 180 * u**2 + 120 * u**3)
        left = [trapezoid(gain * np.exp(1j * w * u * T), u) / T for T in own[:, 0]]
        energy = np.abs(part * np.array(left)) ** 2 / 2
        assert len(own) == 17
        assert np.abs(own[:, 2] - energy).max() < 0.01 * energy.max()


def test_the_bar_of_the_notebook_has_its_pitch(ran, monkeypatch) -> None:
    """The length for 440 Hz, of a bar without rotary inertia; its first overtone."""
    folder = ran("xylophone")
    monkeypatch.chdir(folder)
    names = run_notebook(folder / "xylophone.ipynb")
    root = 4.730041**2 * 0.012 / np.sqrt(12) * np.sqrt(1.9e10 / 950) / (2 * np.pi)
    assert names["length"] == pytest.approx(np.sqrt(root / 440), rel=3e-3)
    pitch, overtone = names["hertz"][names["peaks"]]
    assert pitch == pytest.approx(440, abs=2)  # Hz between two lines of the spectrum
    assert overtone == pytest.approx(440 * (7.853205 / 4.730041) ** 2, rel=5e-3)
