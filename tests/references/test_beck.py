"""Beck's column: a clamped bar under a force that follows its tip, in plane and space.

M. Beck, Z. angew. Math. Phys. 3 (1952): it vibrates about its straight shape up to
20.05 EI / L^2, and flutters beyond.
"""

from __future__ import annotations

import cmath
from functools import cache

import numpy as np
import pytest
from scipy.optimize import root

from sidtool.formats.base.sid import SID
from sidtool.solver import compile_scene, linearise, simulate, static_equilibrium
from sidtool.solver.system.system import System
from tests.codes import codes
from tests.solver.scenes import scene
from tests.steel_bars import steel_bar

THICKNESS = 0.01
#: EI [N m^2] and sqrt(EI / m) [m^2/s]; the length is 1 m.
EI = 2.1e11 * THICKNESS**4 / 12
UNIT = np.sqrt(EI / (7850.0 * THICKNESS**2))
CRITICAL = 20.0509


@cache
def column() -> SID:
    return steel_bar(
        width=THICKNESS,
        height=THICKNESS,
        elements=20,
        reduction={"method": "modal", "modes": 10},
        stiffening={"markers": ["tip"]},
    )


def pushed(
    force: float, planar: bool, end: float = 1.0, axes: str = "marker"
) -> System:
    """The column under `force` EI / L^2, at rest and hardly bent."""
    size = 2 if planar else 3
    body = {"sid": "-", "markers": {"root": 1, "tip": 2}}
    bent = np.zeros(column().nq)
    bent[np.argmax(np.abs(column().node("2").phi.m0[1]))] = 1e-9
    described = scene(
        {"bar": body | {"initial": {"elastic": bent.tolist()}}},
        {"root": {"type": "fixed", "markers": ["ground", "bar.root"]}},
        dimension="planar" if planar else "spatial",
        end=end,
        steps=400,
        forces={
            "push": {
                "type": "force",
                "marker": "bar.tip",
                "axes": axes,
                "force": [-force * EI, 0.0, 0.0][:size],
            }
        },
        record=["bar.q1"],
    )
    return compile_scene(described, sids={"bar": column()}, keep_joints=True)


def exact(force: float, near: complex) -> complex:
    """The eigenvalue [sqrt(EI / m L^4)] of the column near another one."""

    def equation(x: np.ndarray) -> list[float]:
        square = -((x[0] + 1j * x[1]) ** 2)
        size = cmath.sqrt(force**2 / 4.0 + square)
        a, b = cmath.sqrt(size - force / 2.0), cmath.sqrt(size + force / 2.0)
        value = force**2 + 2.0 * square * (1.0 + cmath.cosh(a) * cmath.cos(b))
        value += force * cmath.sqrt(square) * cmath.sinh(a) * cmath.sin(b)
        return [value.real, value.imag]

    found = root(equation, [near.real, near.imag], tol=1e-12)
    assert found.success
    return complex(*found.x)


def growing(force: float, planar: bool) -> complex:
    """The eigenvalue with the largest real part [sqrt(EI / m L^4)]."""
    values = linearise(pushed(force, planar)).eigenvalues / UNIT
    return complex(values[np.argmax(values.real)])


@pytest.mark.parametrize("planar", [True, False])
def test_it_flutters_beyond_the_published_load(planar: bool) -> None:
    assert growing(0.999 * CRITICAL, planar).real < 1e-6
    assert growing(1.001 * CRITICAL, planar).real > 0.1
    found = growing(25.0, planar)
    assert found == pytest.approx(exact(25.0, found), rel=2e-3)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("force", [5.0, 12.0, 19.0])
def test_its_equilibrium_is_stable_below(force: float, planar: bool) -> None:
    """The symmetric part of the stiffness is negative from half of this load on."""
    system = pushed(force, planar)
    assert "N704" not in codes(static_equilibrium(system))
    assert not {"N704", "N714"} & set(codes(linearise(system)))


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize(("force", "stable"), [(2.3, True), (2.6, False)])
def test_a_force_of_constant_direction_buckles_it(
    force: float, stable: bool, planar: bool
) -> None:
    """Euler's column, from pi^2 / 4 EI / L^2; in space in two directions at once."""
    system = pushed(force, planar, axes="inertial")
    assert ("N704" in codes(static_equilibrium(system))) != stable


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("force", [19.0, 25.0])
def test_a_run_vibrates_below_and_flutters_beyond(force: float, planar: bool) -> None:
    """Below, 20 and more vibrations do not grow; beyond, as the eigenvalue says."""
    span = 1.0 if force < CRITICAL else 0.16
    run = simulate(pushed(force, planar, end=span), rtol=1e-7)
    motion = np.abs(run["bar.q1"])
    first, last = (part.max() for part in np.array_split(motion, 2))
    if force < CRITICAL:
        assert last < 1.2 * first
    else:
        rate = np.real(exact(force, growing(force, planar))) * UNIT
        assert np.log(last / first) == pytest.approx(0.5 * span * rate, rel=0.05)
