"""A rotor on two bearings: example 5.9.1 of M. I. Friswell, J. E. T. Penny,
S. D. Garvey, A. W. Lees, Dynamics of Rotating Machines, Cambridge 2010.

The digits are those of 24 Timoshenko elements, by another program. The modes of the
spinning body are found in its own frame: a motion that circles there at the rate s
circles at s + speed in the frame of the bearings.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile

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


def on_bearings(speed: float) -> SceneFile:
    """The shaft turns about x; nothing holds it along and about its axis."""
    bearings = {
        end: {
            "type": "bushing",
            "markers": [f"ground.{end}", f"beam.{end}"],
            "stiffness": [0.0, BEARING, BEARING, 0.0, 0.0, 0.0],
            "shaft": "x",
        }
        for end in ("start", "end")
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
