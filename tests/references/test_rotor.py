"""A rotor on two bearings: example 5.9.1 of M. I. Friswell, J. E. T. Penny,
S. D. Garvey, A. W. Lees, Dynamics of Rotating Machines, Cambridge 2010.

The digits are those of 24 Timoshenko elements, by another program. The modes of the
spinning body are found in its own frame: a motion that circles there at the rate s
circles at s + speed in the frame of the bearings. On bearings of two stiffnesses the
reference is the exact transfer matrix of the shaft.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, expm
from scipy.optimize import brentq

import sidtool
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile
from tests.codes import codes

from .slender import AT_START, beam, scene

LENGTH, DIAMETER, THICKNESS = 1.5, 0.05, 0.07  # m
E, G, DENSITY = 211e9, 81.2e9, 7810.0  # Pa, Pa, kg/m^3
#: Of the discs: fraction of the length, outer diameter [m].
DISCS = ((1 / 3, 0.28), (2 / 3, 0.35))
BEARING = 1e6  # N/m, in both directions
SPEED = 4000 * np.pi / 30  # rad/s
AT_REST = (86.65801517, 274.30722817, 716.56860796)  # rad/s, each twice
AT_SPEED = (
    85.38937332,
    87.79575956,
    251.78061275,
    294.7059979,
    600.08352225,
    826.66644581,
)


@cache
def rotor() -> SID:
    """The shaft with its discs; 48 modes leave 2e-6 in the third frequencies."""
    poisson = E / (2 * G) - 1
    cowper = 6 * (1 + poisson) / (7 + 6 * poisson)
    second = np.pi * DIAMETER**4 / 64
    section = {"area": np.pi * DIAMETER**2 / 4, "iy": second, "iz": second}
    ends = {"method": "craig_bampton", "interfaces": ["start", "end"], "modes": 48}
    return beam(
        LENGTH,
        section | {"shear_y": cowper, "shear_z": cowper},
        (E, poisson, DENSITY),
        24,
        {"frame": AT_START, "reduction": ends},
        tuple(_disc(*disc) for disc in DISCS),
        theory="timoshenko",
    )


def _disc(at: float, outer: float) -> dict[str, object]:
    mass = DENSITY * np.pi / 4 * (outer**2 - DIAMETER**2) * THICKNESS
    polar = mass * (outer**2 + DIAMETER**2) / 8
    across = polar / 2 + mass * THICKNESS**2 / 12
    return {"at": at, "mass": mass, "inertia": [polar, across, across]}


def on_bearings(
    speed: float,
    start: tuple[float, float] = (BEARING, BEARING),
    end: tuple[float, float] = (BEARING, BEARING),
) -> SceneFile:
    """The shaft turns about x; nothing holds it along and about its axis."""
    bearings = {
        name: {
            "type": "bushing",
            "markers": [f"ground.{name}", f"beam.{name}"],
            "stiffness": [0.0, *stiffness, 0.0, 0.0, 0.0],
            "shaft": "x",
        }
        for name, stiffness in (("start", start), ("end", end))
    }
    turning = {"initial": {"angular_velocity": [speed, 0.0, 0.0]}}
    return scene(LENGTH, body=turning, forces=bearings)


def whirl(speed: float) -> Array:
    """The six lowest bending frequencies as seen from the bearings [rad/s]."""
    modes = sidtool.linearise(on_bearings(speed), about="start", sids={"beam": rotor()})
    across = [modes.names.index(f"beam.v{axis}_body") for axis in "yz"]
    y, z = modes.shapes[:, across].T
    rates = modes.eigenvalues.imag
    bends = (rates > 1.0) & (np.abs(y) + np.abs(z) > 1e-6)
    forwards = np.where((np.conj(y) * z).imag < 0, 1.0, -1.0)
    return np.sort(np.abs(forwards * rates + speed)[bends])[:6]


def test_frequencies_at_rest_and_at_speed() -> None:
    assert_allclose(whirl(0.0), np.repeat(AT_REST, 2), rtol=3e-6)
    assert_allclose(whirl(SPEED), AT_SPEED, rtol=3e-6)


def transfer_matrix(omega: float, speed: float) -> Array:
    """Of (u, slope, M, V) in the y plane and, divided by i, in the z plane (8, 8)."""
    poisson = E / (2 * G) - 1
    shear = G * 6 * (1 + poisson) / (7 + 6 * poisson) * np.pi * DIAMETER**2 / 4
    second = np.pi * DIAMETER**4 / 64

    def inertia(mass: float, across: float, polar: float) -> Array:
        loads = np.zeros((8, 8))
        for k in (0, 4):
            loads[k + 3, k], loads[k + 2, k + 1] = -mass * omega**2, -across * omega**2
            loads[k + 2, 5 - k] = -polar * speed * omega
        return loads

    bend = np.zeros((4, 4))
    bend[0, 1], bend[0, 3], bend[1, 2], bend[2, 3] = 1, 1 / shear, 1 / (E * second), -1
    mass = DENSITY * np.pi * DIAMETER**2 / 4
    rates = block_diag(bend, bend)
    rates += inertia(mass, DENSITY * second, 2 * DENSITY * second)
    shaft = expm(rates * LENGTH / 3)
    total = shaft
    for disc in DISCS:
        found = _disc(*disc)
        polar, across, _ = found["inertia"]
        total = shaft @ (np.eye(8) + inertia(found["mass"], across, polar)) @ total
    return total


def transfer_frequencies(
    speed: float, start: tuple[float, float], end: tuple[float, float]
) -> Array:
    """The six lowest natural frequencies between two springs at both ends [rad/s]."""

    def determinant(omega: float) -> float:
        free = np.zeros((8, 4))
        free[[0, 1, 4, 5], range(4)] = 1.0
        free[[3, 7], [0, 2]] = start
        last = transfer_matrix(omega, speed) @ free
        shears = last[[3, 7]] + np.array(end)[:, None] * last[[0, 4]]
        return float(np.linalg.det(np.vstack([last[[2, 6]], shears / BEARING])))

    grid = np.arange(5.0, 1000.0, 1.0)
    values = np.array([determinant(omega) for omega in grid])
    changes = np.flatnonzero(values[1:] * values[:-1] < 0.0)[:6]
    roots = [brentq(determinant, grid[k], grid[k + 1], xtol=1e-9) for k in changes]
    return np.array(roots)


SOFT, STIFF = (1e6, 4e5), (3e6, 8e5)


def test_the_transfer_matrix_has_the_published_frequencies() -> None:
    """To the error of 24 elements, 1.2e-5 in the sixth."""
    alike = BEARING, BEARING
    assert_allclose(transfer_frequencies(SPEED, alike, alike), AT_SPEED, rtol=2e-5)


@pytest.mark.parametrize("speed", [SPEED, -0.3 * SPEED])
def test_frequencies_on_bearings_of_two_stiffnesses(speed: float) -> None:
    """A round shaft is seen in axes that do not turn.

    Its 48 modes hold one of the last pair: modes from there on are left out.
    """
    modes = sidtool.linearise(
        on_bearings(speed, SOFT, STIFF), about="start", sids={"beam": rotor()}
    )
    rates = 2.0 * np.pi * modes.inertial_frequencies
    bends = np.array([bool(way) for way in modes.whirl]) & (rates > 1.0)
    expected = transfer_frequencies(speed, SOFT, STIFF)
    assert_allclose(rates[bends][:6], expected, rtol=2e-5)
    named = np.array(modes.whirl)[bends][:6]
    assert named.tolist() == ["backward", "forward"] * 3
    assert 3e4 < rates.max() < 6.2e4
    assert codes(modes)[:2] == ["N712", "N717"]
