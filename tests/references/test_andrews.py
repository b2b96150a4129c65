"""Andrews' squeezing mechanism: seven rigid bodies, a spring and a motor.

Source: Test Set for IVP Solvers, problem II-9 (F. Mazzia, C. Magherini 2008), after
G. C. Andrews and M. K. Ormrod (1986), R. Giles (1978); the reference solution is
printed to 16 digits; it is the true one 1e-12 s later, off by up to 1.4e-9 in angles.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate

A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
RR, D, SS, E, ZT, ZF, U = 7e-3, 28e-3, 35e-3, 2e-2, 4e-2, 2e-2, 4e-2

#: mass, inertia and centre of mass of each body in the frame at its first pivot
BODIES = {
    "k1": (0.04325, 2.194e-6, (92e-5, 0.0)),
    "k2": (0.00365, 4.410e-7, (-115e-4, 0.0)),
    "k3": (0.02373, 5.255e-6, (1874e-5, -1043e-5)),
    "k4": (0.00706, 5.667e-7, (0.0, -(E - 1421e-5))),
    "k5": (0.07050, 1.169e-5, (2308e-5, 916e-5)),
    "k6": (0.00706, 5.667e-7, (ZF - 1421e-5, 0.0)),
    "k7": (0.05498, 1.912e-5, (1228e-5, -449e-5)),
}
#: where the next body or the common point P hangs
TIPS = {
    "k1": (RR, 0.0),
    "k2": (-D, 0.0),
    "k3": (0.0, -SS),
    "k4": (0.0, -E),
    "k5": (ZT, 0.0),
    "k6": (ZF, 0.0),
    "k7": (0.0, -U),
}
#: beta, Theta, gamma, Phi, delta, Omega, epsilon at t = 0 and 0.03 s
START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)
END = (
    15.81077119629904,
    -15.75637105984298,
    0.04082224013073101,
    -0.5347301163226948,
    0.5244099658805304,
    0.5347301163226948,
    1.048080741042263,
)
#: The same by an independent integration of the published equations in these seven
#: angles (DOP853, relative tolerance 3e-14), good to 1e-11.
COMPUTED = (
    15.81077119515314,
    -15.75637105841115,
    0.04082224011963,
    -0.53473011634211,
    0.52440996587995,
    0.53473011634210,
    1.04808074104194,
)


def squeezer() -> SceneFile:
    """The mechanism; each body turns by its own angle in the inertial frame."""
    beta, theta, gamma, phi, delta, omega, epsilon = START
    angles = {"k1": beta, "k2": beta + theta, "k3": gamma, "k4": phi + delta}
    angles |= {"k5": delta, "k6": omega + epsilon, "k7": epsilon}
    roots = {"k1": (0.0, 0.0), "k3": B, "k5": A, "k7": A}
    for child, parent in (("k2", "k1"), ("k4", "k5"), ("k6", "k7")):
        roots[child] = _end(roots[parent], angles[parent], TIPS[parent])
    bodies: dict[str, Any] = {}
    for name, (mass, inertia, centre) in BODIES.items():
        bodies[name] = {
            "mass": mass,
            "inertia": inertia,
            "centre_of_mass": centre,
            "markers": {"root": {}, "tip": {"position": TIPS[name]}},
            "initial": {"position": roots[name], "angle": angles[name]},
        }
    bodies["k3"]["markers"]["spring"] = {"position": (2e-2, -18e-3)}
    pairs = {
        "O": ("ground", "k1.root"),
        "crank": ("k1.tip", "k2.root"),
        "B": ("ground.B", "k3.root"),
        "A5": ("ground.A", "k5.root"),
        "A7": ("ground.A", "k7.root"),
        "E": ("k5.tip", "k4.root"),
        "H": ("k7.tip", "k6.root"),
        "P3": ("k2.tip", "k3.tip"),
        "P4": ("k2.tip", "k4.tip"),
        "P6": ("k2.tip", "k6.tip"),
    }
    spring = {"markers": ("ground.C", "k3.spring"), "rest": 0.07785, "stiffness": 4530}
    points = {"A": A, "B": B, "C": C}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 0.03, "output_times": [0.03]},
        "ground": {"markers": {n: {"position": p} for n, p in points.items()}},
        "bodies": bodies,
        "joints": {n: {"type": "revolute", "markers": p} for n, p in pairs.items()},
        "forces": {
            "motor": {"type": "force", "marker": "k1.root", "torque": 0.033},
            "spring": {"type": "spring_damper", **spring},
        },
        "outputs": {"record": [f"{name}.angle" for name in BODIES]},
    }
    return validate_data(data, SceneFile)


def _end(
    root: tuple[float, float], angle: float, tip: tuple[float, float]
) -> tuple[float, float]:
    c, s = math.cos(angle), math.sin(angle)
    return root[0] + c * tip[0] - s * tip[1], root[1] + s * tip[0] + c * tip[1]


def test_the_squeezer_ends_at_the_published_angles() -> None:
    result = simulate(compile_scene(squeezer()), integrator="radau9", rtol=1e-11)
    k1, k2, k3, k4, k5, k6, k7 = (result[f"{name}.angle"][-1] for name in BODIES)
    angles = (k1, k2 - k1, k3, k4 - k5, k5, k6 - k7, k7)
    assert angles == pytest.approx(END, rel=1e-9)
    assert angles == pytest.approx(COMPUTED, abs=2e-11, rel=0.0)
