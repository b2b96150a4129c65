"""Stability of periodic motions, and rotors with blades."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

import sidtool
from tests.solver.analyses import (
    test_floquet as floquet,
    test_multi_blade as multi_blade,
)

from . import Problem, Row


def _mathieu() -> Iterator[Row]:
    """The stability chart of Mathieu's equation.

    x'' + (delta + 2 epsilon cos 2t) x = 0 as a pendulum on a shaken pivot, epsilon =
    0.3: values of delta between stable and unstable motions, where Floquet's
    multipliers are 1 or -1, and characteristic values a_n, b_n of Mathieu's functions.
    """
    q = 0.3
    for name, function, order in (
        ("b1", mathieu_b, 1),
        ("a1", mathieu_a, 1),
        ("b2", mathieu_b, 2),
        ("a2", mathieu_a, 2),
    ):
        exact = float(function(order, q))

        def excess(delta: float, sign: float = (-1.0) ** order) -> float:
            found = sidtool.floquet(floquet.shaken_pendulum(delta, q), "pi")
            values = found.multipliers
            trace = values.sum() if len(values) == 2 else 2.0 * values[0].real
            return float(np.real(trace)) - 2.0 * sign

        yield Row(name, "scipy.special", exact, _root(excess, exact))


def _root(function: Callable[[float], float], near: float) -> float:
    return float(brentq(function, near - 4e-3, near + 4e-3, xtol=1e-12))


def _shaft() -> Iterator[Row]:
    """A shaft of two stiffnesses.

    A disc of 1 kg on a shaft of 100 and 225 N/m: unstable between its critical speeds
    of 10 and 15 rad/s. Growth rates [1/s] are the roots of (s^2 + a) (s^2 + b) + 4 W^2
    s^2 = 0, a and b less W^2 of 100 and 225, the exact equations in rotating axes;
    Floquet's multipliers are those of the motion in inertial axes.
    """
    for speed in (10.5, 12.0, 13.5, 14.9):
        a, b = floquet.UNEQUAL - speed**2
        roots = np.roots([1.0, 0.0, a + b + 4 * speed**2, 0.0, a * b])
        found = sidtool.floquet(floquet.unequal_shaft(speed), "2*pi/speed")
        name, grows = f"W = {speed:g} rad/s", found.exponents.real.max()
        yield Row(name, "exact", float(roots.real.max()), float(grows))


def _ground_resonance() -> Iterator[Row]:
    """Ground resonance of a rotor with five blades.

    R. P. Coleman, A. M. Feingold, NACA report 1351: blades with hinges for lead and lag
    on a support of two stiffnesses, with damping. Real and imaginary parts [1/s] of the
    eigenvalues of their equations, and of the scene in multi-blade coordinates.
    """
    speed, count, damping = 18.0, 5, 30.0
    scene = multi_blade.lagging_rotor(speed, count, damping)
    modes = sidtool.linearise(scene, about="start")
    exact = multi_blade.textbook(speed, count, damping)
    for k, value in enumerate(sorted(exact[exact.imag > 0.0], key=abs), 1):
        found = modes.eigenvalues[np.abs(modes.eigenvalues - value).argmin()]
        source = "equations of Coleman and Feingold"
        yield Row(f"mode {k}, real part", source, value.real, float(found.real))
        yield Row(f"mode {k}, imaginary part", source, value.imag, float(found.imag))


PROBLEMS: tuple[Problem, ...] = (_mathieu, _shaft, _ground_resonance)
