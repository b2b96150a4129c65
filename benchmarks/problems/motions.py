"""Motions of mechanisms, rigid and flexible."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import sidtool
from sidtool.cli.demo_run import PUBLISHED_MOTION
from sidtool.formats.scene import read_scene
from sidtool.pipeline.examples import example_folder
from sidtool.solver import compile_scene, simulate
from tests.references import (
    spin_up,
    test_andrews as andrews,
    test_bricard as bricard,
    test_four_bars as four_bars,
    test_rigid_benchmarks as rigid,
    test_simeon as simeon,
    test_spin_up as spinning,
)

from . import Problem, Row


def _founding_motion() -> Iterator[Row]:
    """Motion of the founding slider-crank.

    Against minimal coordinates and DOP853 at 1e-10.
    """
    scene = example_folder("slider_crank") / "slider_crank.toml"
    result = sidtool.simulate(scene, rtol=1e-10)
    for (name, at), value in PUBLISHED_MOTION.items():
        found = result[name][np.searchsorted(result.t, at - 1e-9)]
        yield Row(f"{name} at {at} s", "computed", value, float(found))


def _simeon() -> Iterator[Row]:
    """Slider-crank of the IVP test set (flexible rod, index 2).

    B. Simeon, at 0.1 s. The position of the piston has a constant offset of 2e-10 by
    the rounded start of the source. Lagrange multipliers are compared by magnitude.
    """
    result = simeon.run(quadratic_inertia=True)
    for name, value in simeon.END.items():
        yield Row(name, "published", value, simeon.end(result, name))
    for name, value in zip(
        ("guide.f1", "tip.f1", "turn.f1"), simeon.LAMBDA, strict=True
    ):
        found = abs(simeon.end(result, name))
        yield Row(f"size of {name}", "published", abs(value), found)
    result = simeon.run(quadratic_inertia=False)
    found = simeon.end(result, "rod.q1")
    name = "rod.q1, inertia of first order"
    yield Row(name, "computed", 1.8931927069550e-4, found)


def _andrews() -> Iterator[Row]:
    """Andrews' squeezing mechanism (seven rigid bodies).

    Angles at 0.03 s; the published digits are accurate to 1e-10.
    """
    result = simulate(
        compile_scene(andrews.squeezer()), integrator="radau9", rtol=1e-11
    )
    k1, k2, k3, k4, k5, k6, k7 = (
        float(result[f"{name}.angle"][-1]) for name in andrews.BODIES
    )
    names = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")
    angles = (k1, k2 - k1, k3, k4 - k5, k5, k6 - k7, k7)
    for name, value, found in zip(names, andrews.END, angles, strict=True):
        yield Row(name, "published", value, found)


def _rigid() -> Iterator[Row]:
    """Rigid benchmarks of the IFToMM library.

    A01: simple pendulum; A02: linked four-bars through singular configurations; A04:
    Bricard's mechanism with a redundant hinge, whose energy is constant.
    """
    pendulum = simulate(rigid.massless_rod_pendulum(), rtol=1e-11)
    yield Row("A01 x(10 s)", "exact", -0.2750874625761169, float(pendulum["bob.x"][-1]))
    yield Row("A01 y(10 s)", "exact", -0.9614192050991251, float(pendulum["bob.y"][-1]))
    loops = simulate(four_bars.four_bars(2, 10.0), integrator="radau9", rtol=1e-9)
    for axis, value, found in zip(
        "xy", four_bars.PUBLISHED, loops.values[-1], strict=True
    ):
        yield Row(f"A02 {axis}(10 s), N = 2", "published", value, float(found))
    result = simulate(bricard.bricard(), integrator="radau9", rtol=1e-10)
    energy = result["energy.kinetic"] + result["energy.potential"]
    share = float(np.ptp(energy) / result["energy.kinetic"].max())
    yield Row("A04 variation of energy in 10 s, of its largest", "exact", 0.0, share)


def _spin_up() -> Iterator[Row]:
    """A beam that spins up (geometric stiffening).

    Kane, Ryan and Banerjee's beam: tip deflection [m] against a geometrically exact
    beam, and the least one against floating frames with the centrifugal term and as
    many bending modes. A SID with few shape functions has an error of 0.1 to 0.2 %.
    Without the term the deflection diverges.
    """
    exact = {5.0: -0.4684420, 7.5: -0.5590392, 10.0: -0.3627654}
    for modes, published in (
        (1, -0.57826),
        (2, -0.573549),
        (3, -0.574443),
        (5, -0.574380),
    ):
        sid = sidtool.convert(spin_up.slender_blade(modes, 160))
        result, _, across = spinning.tip(sid, 10.0)
        least = float(across.min())
        yield Row(
            f"least v, modes: {modes}", "computed: floating frame", published, least
        )
    yield Row("least v, modes: 5", "computed: exact beam", -0.5737868, least)
    for time, value in exact.items():
        found = float(np.interp(time, result.t, across))
        yield Row(f"v({time:g} s), modes: 5", "computed: exact beam", value, found)
    plain = spin_up.blade(spinning.Q4, spinning.MODES, stiffened=False)
    _, _, across = spinning.tip(sidtool.convert(plain), 15.0)
    found = float(across[-1])
    yield Row("v(15 s) without stiffening", "computed", -8.08e10, found)


def _steady_blade() -> Iterator[Row]:
    """A blade in steady rotation.

    Frequencies of the example `spinning_blade` with three bending shapes in either
    direction, times sqrt(rho A L^4 / EI), at speeds made dimensionless in the same way;
    against a spectral method. The faster it turns the more shapes it needs.
    """
    folder = example_folder("spinning_blade")
    unit = np.sqrt(1.4e4 / (1.2 * 10.0**4))
    with tempfile.TemporaryDirectory() as temporary:
        file = Path(temporary) / "blade.SID_FEM"
        sidtool.write(file, sidtool.convert(folder / "blade.toml"))
        scene = read_scene(folder / "steady.toml").with_({"dimension": "spatial"})
        for speed, flap, lag in _STEADY:
            pieces = [{"from": 0.0, "coefficients": [0.0, speed * unit]}]
            function = {"type": "polynomial", "pieces": pieces}
            turning = scene.with_({"drives.motor.function": function})
            modes = sidtool.linearise(turning, about="start", base_folder=temporary)
            found = np.sort(modes.frequencies)[:2] * 2 * np.pi / unit
            name = f"flapping at {speed:g}"
            yield Row(name, "computed: spectral", flap, float(found[1]))
            name = f"lead-lag at {speed:g}"
            yield Row(name, "computed: spectral", lag, float(found[0]))


#: Speed, flapping, lead-lag: the square of the last is less by that of the first.
_STEADY = tuple(
    (speed, flap, float(np.sqrt(flap**2 - speed**2)))
    for speed, flap in (
        (0.0, 3.516015),
        (2.0, 4.137320),
        (4.0, 5.585001),
        (8.0, 9.256838),
        (12.0, 13.170150),
    )
)


PROBLEMS: tuple[Problem, ...] = (
    _founding_motion,
    _simeon,
    _andrews,
    _rigid,
    _spin_up,
    _steady_blade,
)
