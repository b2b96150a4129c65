"""Natural modes of rotors at their speed, seen in axes that turn with them.

On springs that are the same in all directions across the axis a rotor whirls at its
frequency at rest, w0; turning at W, it sees that as |w0 - W| and w0 + W.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver import compile_scene, linearise, simulate
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.codes import codes, only
from tests.steel_bars import steel_bar

from ..scenes import polynomial, scene


def table(spin: float, planar: bool, away: tuple[float, ...] = ()) -> dict[str, Any]:
    """Where a body that turns about the origin is; its frame lies `away` [m]."""
    place = np.zeros(3)
    place[: len(away)] = away
    velocity = np.cross([0.0, 0.0, spin], place)
    size = 2 if planar else 3
    return {
        "position": place[:size].tolist(),
        "velocity": velocity[:size].tolist(),
        "angular_velocity": spin if planar else [0.0, 0.0, spin],
    }


def disc_on_springs(
    spin: float,
    planar: bool,
    across: float | tuple[float, ...],
    turning: float,
    away: tuple[float, ...],
    drive: dict[str, Any] | None = None,
) -> System:
    """A disc of 2 kg and 0.3 kg m2 on a hub that is driven; its frame lies `away`."""
    centre = [-x for x in away]
    body = {
        "mass": 2.0,
        "inertia": 0.3 if planar else [0.2, 0.2, 0.3],
        "centre_of_mass": centre,
        "markers": {"middle": {"position": centre}},
        "initial": table(spin, planar, away),
    }
    hub = {"mass": 1.0, "inertia": 1.0 if planar else [1.0, 1.0, 1.0]}
    hub["initial"] = table(spin, planar)
    size = (2, 1) if planar else (3, 3)
    stiffness = [*np.broadcast_to(across, size[:1]).tolist(), *[turning] * size[1]]
    described = scene(
        {"hub": hub, "disc": body},
        {"axle": {"type": "revolute", "markers": ["ground", "hub"]}},
        {"spin": drive or {"joint": "axle", "function": polynomial(0.0, spin)}},
        dimension="planar" if planar else "spatial",
        forces={
            "mount": {
                "type": "bushing",
                "markers": ["hub", "disc.middle"],
                "stiffness": stiffness,
                "damping": [0.0] * len(stiffness),
            }
        },
    )
    return compile_scene(described, keep_joints=True)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_a_rotor_sees_its_whirl_beside_its_speed(seed: int, planar: bool) -> None:
    """Wherever the frame of the disc lies; tilting as Euler's equations say."""
    random = np.random.default_rng(seed)
    spin, across, turning = random.uniform([1.0, 50.0, 5.0], [9.0, 500.0, 50.0])
    away = tuple(seed * random.normal(size=2 if planar else 3))
    whirl = np.sqrt(across / 2.0)
    expected = [abs(whirl - spin), whirl + spin, np.sqrt(turning / 0.3)]
    if not planar:
        # A t'' - i C W t' + k t = 0 of the tilt t = t1 + i t2, and along the axis
        roots = np.roots([0.2, -0.3 * spin, -turning])
        expected += [whirl, *np.abs(roots - spin)]
    found = linearise(disc_on_springs(spin, planar, across, turning, away), "start")
    seen = 2.0 * np.pi * found.frequencies
    assert np.sort(seen) == pytest.approx(np.sort(expected), rel=1e-6, abs=1e-5)
    assert found.diagnostics == ()


def test_a_state_of_a_run_with_a_constant_rate_has_modes() -> None:
    """The value that its drive adds up was told to accelerate."""
    spin, across, turning = 3.0, 98.0, 30.0
    drive = {"joint": "axle", "of": "rate"}
    drive |= {"function": {"type": "constant", "value": spin}}
    system = disc_on_springs(spin, True, across, turning, (0.0, 0.0), drive)
    result = simulate(system, rtol=1e-10)
    state = result.positions[-1], result.velocities[-1]
    found = linearise(system, state=state, time=float(result.t[-1]))
    expected = [7.0 - spin, 7.0 + spin, np.sqrt(turning / 0.3)]
    seen = 2.0 * np.pi * found.frequencies
    assert np.sort(seen) == pytest.approx(np.sort(expected), rel=1e-6)
    assert found.diagnostics == ()


def test_a_blade_that_nothing_pulls_yet_is_told() -> None:
    """With shape functions along a blade its start in a straight shape is near steady
    rotation, but it is still to be stretched: 1.78 was told for 3.90, without a word.

    Published: 5.5850 out of the plane at a speed of 4, A. D. Wright, C. E. Smith, R. W.
    Thresher, J. L. C. Wang, J. Appl. Mech. 49 (1982), table 2, by sqrt(EI / rho A L^4).
    """
    blade = steel_bar(
        reduction={"method": "craig_bampton", "interfaces": ["tip"], "modes": 6},
        stiffening={},
    )
    unit = np.sqrt(2.1e11 / 7850.0 * 0.02**2 / 12)
    described = scene(
        {"blade": {"sid": "blade.SID_FEM", "markers": {"root": 1}}},
        {"hub": {"type": "revolute", "markers": ["ground", "blade.root"]}},
        {"spin": {"joint": "hub", "function": polynomial(0.0, 4.0 * unit)}},
    )
    found = []
    for state in ("stated", "static"):
        stated = described.with_({"initial.state": state})
        system = compile_scene(stated, ".", {"blade": blade}, keep_joints=True)
        modes = linearise(system, "start", frozen=state == "stated")
        found.append(2.0 * np.pi * modes.frequencies[0] / unit)
        if state == "stated":
            with pytest.raises(SimulationError, match="N711"):
                linearise(system, "start")
            data = only(modes, "N711").data
        else:
            assert modes.diagnostics == ()
    assert found[1] == pytest.approx(np.sqrt(5.5850**2 - 4.0**2), rel=2e-3)
    told = [unit / (2.0 * np.pi) * x for x in found]
    assert data["here"] == pytest.approx(told[0])
    assert f"{data['there']:.4g}" == f"{told[1]:.4g}"


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("swapped", [False, True])
def test_a_point_mass_on_a_hinged_arm_swings_in_the_field(
    planar: bool, swapped: bool
) -> None:
    """An arm hinged at e from the axis, with a mass at its end: W sqrt(e S / I) in the
    plane of rotation, S and I being its moments about the hinge."""
    spin, e, length, arm, mass = 7.0, 0.3, 0.8, 0.5, 2.0
    size = 2 if planar else 3

    def at_radius(r: float) -> list[float]:
        return [r, 0.0, 0.0][:size]

    half = length / 2
    inertia = arm * length**2 / 12
    body = {
        "mass": arm,
        "inertia": inertia if planar else [1e-3, inertia, inertia],
        "markers": {
            "in": {"position": at_radius(-half)},
            "out": {"position": at_radius(half)},
        },
        "initial": table(spin, planar, (e + half,)),
    }
    bob = {"mass": mass, "initial": table(spin, planar, (e + length,))}
    del bob["initial"]["angular_velocity"]
    hub = {"mass": 1.0, "inertia": 1.0 if planar else [1.0, 1.0, 1.0]} | {
        "markers": {"rim": {"position": at_radius(e)}},
        "initial": table(spin, planar),
    }
    ends = ["bob", "arm.out"] if swapped else ["arm.out", "bob"]
    described = scene(
        {"hub": hub, "arm": body, "bob": bob},
        {
            "axle": {"type": "revolute", "markers": ["ground", "hub"]},
            "lag": {"type": "revolute", "markers": ["hub.rim", "arm.in"]},
            "tip": {"type": "coincident", "markers": ends},
        },
        {"spin": {"joint": "axle", "function": polynomial(0.0, spin)}},
        dimension="planar" if planar else "spatial",
    )
    found = linearise(compile_scene(described, keep_joints=True), "start")
    first = arm * half + mass * length
    second = inertia + arm * half**2 + mass * length**2
    expected = spin * np.sqrt(e * first / second)
    assert 2.0 * np.pi * found.frequencies == pytest.approx([expected], rel=1e-6)
    assert found.damping_ratios == pytest.approx([0.0], abs=1e-6)
    assert found.diagnostics == ()


@pytest.mark.parametrize("spin", [5.0, 9.0])
def test_a_point_mass_on_springs_of_a_rotor_is_seen_from_it(spin: float) -> None:
    """(s^2 + kx/m - W^2) (s^2 + ky/m - W^2) + 4 W^2 s^2 = 0 in axes that turn.

    Between the two critical speeds, sqrt(40 / m) and sqrt(90 / m), a pair of roots is
    real: the mass leaves along a line that turns with the rotor.
    """
    mass, stiffness = 0.7, np.array([90.0, 40.0])
    ends = {
        "plus": [0.4, 0.0],
        "minus": [-0.4, 0.0],
        "up": [0.0, 0.4],
        "down": [0, -0.4],
    }
    hub = {"mass": 1.0, "inertia": 1.0, "initial": table(spin, True)}
    hub["markers"] = {name: {"position": place} for name, place in ends.items()}
    springs = {
        name: {
            "type": "spring_damper",
            "markers": ["bob", f"hub.{name}"],
            "rest": 0.4,
            "stiffness": stiffness[k // 2] / 2.0,
        }
        for k, name in enumerate(ends)
    }
    described = scene(
        {"hub": hub, "bob": {"mass": mass}},
        {"axle": {"type": "revolute", "markers": ["ground", "hub"]}},
        {"spin": {"joint": "axle", "function": polynomial(0.0, spin)}},
        forces=springs,
    )
    found = linearise(compile_scene(described, keep_joints=True), "start")
    a, b = stiffness / mass - spin**2
    squares = np.roots([1.0, a + b + 4.0 * spin**2, a * b])
    oscillating = np.sort(np.sqrt(-squares[squares < 0.0]))
    real = found.eigenvalues.imag == 0.0
    frequencies = 2.0 * np.pi * found.frequencies
    assert frequencies[~real] == pytest.approx(oscillating, rel=1e-6)
    assert real.any() == (spin == 9.0)
    growths = np.sqrt(squares[squares > 0.0])
    expected = np.sort([*growths, *-growths])
    assert np.sort(found.eigenvalues[real].real) == pytest.approx(expected, rel=1e-6)
    assert not frequencies[real].any()
    seen = 2.0 * np.pi * found.inertial_frequencies[real]
    assert seen == pytest.approx(np.full(len(expected), spin), rel=1e-9)
    assert codes(found) == ["N714"] * len(growths)
    for each in found.diagnostics:
        assert each.data["rate"] == pytest.approx(growths.max(), rel=1e-6)


def test_a_disc_between_its_critical_speeds_leaves_with_its_rotor() -> None:
    """On springs that turn with it, kx < m W^2 < ky: s^2 > 0, at rest for its axes."""
    spin, across = 9.0, (80.0, 260.0)
    found = linearise(disc_on_springs(spin, True, across, 50.0, (0.0, 0.0)), "start")
    a, b = np.divide(across, 2.0) - spin**2
    squares = np.roots([1.0, a + b + 4.0 * spin**2, a * b])
    growth = np.sqrt(squares.max())
    real = found.eigenvalues.imag == 0.0
    values = np.sort(found.eigenvalues[real].real)
    assert values == pytest.approx([-growth, growth], rel=1e-6)
    assert not found.frequencies[real].any()
    assert found.rotating_frequencies[real] == pytest.approx(np.zeros(2), abs=1e-9)
    seen = 2.0 * np.pi * found.inertial_frequencies[real]
    assert seen == pytest.approx(np.full(2, spin), rel=1e-9)


def test_a_pendulum_that_stands_does_not_oscillate() -> None:
    """It leaves at sqrt(m g l / (J + m l^2)), that is no frequency."""
    rod = {"mass": 0.5, "inertia": 0.01, "centre_of_mass": [0.0, 0.4]}
    described = scene(
        {"rod": rod},
        {"hinge": {"type": "revolute", "markers": ["ground", "rod"]}},
        gravity=[0.0, -9.81],
    )
    found = linearise(compile_scene(described, keep_joints=True), "start")
    growth = np.sqrt(0.5 * 9.81 * 0.4 / (0.01 + 0.5 * 0.4**2))
    assert np.sort(found.eigenvalues) == pytest.approx([-growth, growth], rel=1e-9)
    for column in ("frequencies", "inertial_frequencies", "rotating_frequencies"):
        assert not getattr(found, column).any()
    assert only(found, "N714").data["rate"] == pytest.approx(growth, rel=1e-9)


def test_a_gyroscope_nutates_and_precesses_beside_its_ring() -> None:
    """A rotor of A, C at W in a housing that springs hold against tilting only: the
    linear equations are (A + B) t1'' + C W t2' + k1 t1 = 0 and, with t2, its like."""
    A, B, C, W, k1, k2 = 0.05, 0.02, 0.09, 60.0, 300.0, 500.0
    hold = [1e3, 1e3, 1e3, k1, k2, 200.0]
    described = scene(
        {
            "housing": {"mass": 1.0, "inertia": [B, B, 0.04]},
            "rotor": {"mass": 3.0, "inertia": [A, A, C], "initial": table(W, False)},
        },
        {"axle": {"type": "revolute", "markers": ["housing", "rotor"]}},
        dimension="spatial",
        forces={
            "mount": {
                "type": "bushing",
                "markers": ["ground", "housing"],
                "stiffness": hold,
            }
        },
    )
    M, G = np.diag([A + B] * 2), C * W * np.array([[0.0, 1.0], [-1.0, 0.0]])
    zero, one = np.zeros((2, 2)), np.eye(2)
    still = np.block([[zero, one], [-np.diag([k1, k2]) / (A + B), -G / M[0, 0]]])
    tilting = np.abs(np.linalg.eigvals(still))[[0, 2]]
    found = linearise(compile_scene(described, keep_joints=True), "start")
    turning = np.sqrt(200.0 / 0.04)
    expected = [0.0, *tilting, *[np.sqrt(1e3 / 4.0)] * 3, turning]
    seen = 2.0 * np.pi * found.frequencies
    assert np.sort(seen) == pytest.approx(np.sort(expected)[: len(seen)], rel=1e-6)
    assert found.diagnostics[0].code == "N712"
    assert found.diagnostics[0].data["axes"] == "that do not turn"


@pytest.mark.parametrize(
    ("spin", "wheel"), [(0.0, 100.0), (0.5, 300.0), (2.0, -50.0), (2.0, 118.0)]
)
def test_a_gyrostat_nutates_as_its_angular_momentum_asks(
    spin: float, wheel: float
) -> None:
    """A free body of three inertias and a fast round wheel about its axis z.

    A p' + (H - B w) q = 0, B q' - (H - A w) p = 0 for the rates p, q across the axis, H
    the angular momentum (J. Wittenburg, "Dynamics of Multibody Systems", section 4.6).
    """
    bodies = {
        "frame": {"mass": 100.0, "inertia": [10.0, 12.0, 8.0]},
        "wheel": {"mass": 5.0, "inertia": [0.03, 0.03, 0.05]},
    }
    for name, speed in (("frame", spin), ("wheel", spin + wheel)):
        bodies[name]["initial"] = {"angular_velocity": [0.0, 0.0, speed]}
    axle = {"type": "revolute", "markers": ["frame", "wheel"]}
    system = compile_scene(scene(bodies, {"axle": axle}, dimension="spatial"))
    modes = linearise(system, about="start")
    A, B, H = 10.03, 12.03, 8.05 * spin + 0.05 * wheel
    rate = np.sqrt(complex(-(H - A * spin) * (H - B * spin) / (A * B)))
    assert np.abs(modes.eigenvalues - rate).min() < 1e-6 * abs(rate)
    assert ("N714" in codes(modes)) == (rate.real > 0.0)
    others = modes.eigenvalues[~modes.rigid]
    assert np.all(np.abs(others**2 - rate**2) < 1e-6 * abs(rate) ** 2)


def rotor_on(stiffness: list[float], inertia: list[float]) -> System:
    return rotor_at(50.0, stiffness, inertia)


def rotor_at(spin: float, stiffness: list[float], inertia: list[float]) -> System:
    described = scene(
        {"rotor": {"mass": 2.0, "inertia": inertia, "initial": table(spin, False)}},
        {},
        dimension="spatial",
        forces={
            "bearing": {
                "type": "bushing",
                "markers": ["ground", "rotor"],
                "stiffness": [*stiffness, 0.0],
                "shaft": "z",
            }
        },
    )
    return compile_scene(described, keep_joints=True)


def test_a_rotor_on_springs_of_two_stiffnesses_whirls_as_at_rest() -> None:
    """Jeffcott's rotor: sqrt(k / m) along either spring, at any speed."""
    stiffness = [4000.0, 9000.0, 16000.0, 300.0, 300.0]
    found = linearise(rotor_on(stiffness, [0.2, 0.2, 0.3]), "start")
    seen = 2.0 * np.pi * found.frequencies
    for along in stiffness[:3]:
        assert np.abs(seen - np.sqrt(along / 2.0)).min() < 1e-5


def test_modes_that_no_constant_matrix_has_are_told() -> None:
    """A rotor of two inertias on springs of two stiffnesses: Mathieu's equation."""
    stiffness = [4000.0, 9000.0, 16000.0, 300.0, 800.0]
    system = rotor_on(stiffness, [0.1, 0.2, 0.3])
    with pytest.raises(SimulationError, match="N713"):
        linearise(system, "start")
    assert codes(linearise(system, "start", frozen=True)) == ["N715", "N713"]
    (found,) = linearise(rotor_on(stiffness, [0.2, 0.2, 0.3]), "start").diagnostics
    assert (found.code, found.data["axes"]) == ("N712", "that do not turn")


def test_flexible_blades_on_springs_of_two_stiffnesses_have_no_modes() -> None:
    """A blade is not round, and in its own axes the springs turn."""
    bodies, joints = {}, {}
    for k, quaternion in enumerate(([1.0, 0, 0, 0], [0, 0, 0, 1.0])):
        initial = table(20.0, False) | {"quaternion": quaternion}
        bodies[f"blade{k}"] = {"sid": "-", "markers": {"root": 1}, "initial": initial}
        joints[f"root{k}"] = {"type": "fixed", "markers": ["hub", f"blade{k}.root"]}
    hub = {"mass": 5.0, "inertia": [0.1, 0.1, 0.2]}
    hub["initial"] = table(20.0, False) | {"quaternion": [1.0, 0.0, 0.0, 0.0]}
    spring = {
        "type": "bushing",
        "markers": ["ground", "hub"],
        "stiffness": [4e4, 9e4, 4e4, 1e4, 1e4, 0.0],
        "shaft": "z",
    }
    described = scene(
        {"hub": hub, **bodies},
        joints,
        forces={"bearing": spring},
        dimension="spatial",
        initial={"state": "static"},
    )
    blade = steel_bar(modes=4)
    system = compile_scene(
        described, ".", {"blade0": blade, "blade1": blade}, keep_joints=True
    )
    with pytest.raises(SimulationError, match="N713"):
        linearise(system, "start")


def test_a_pendulum_that_hangs_from_a_cart_is_at_rest() -> None:
    """Its hinge is above it up to rounding; (M + m, m l; m l, J + m l^2) swings."""
    described = scene(
        {
            "cart": {"mass": 5.0, "inertia": 0.1, "markers": {"h": at_height(0.8)}},
            "bob": {
                "mass": 0.5,
                "inertia": 0.01,
                "markers": {"h": at_height(0.5)},
                "initial": at_height(0.3),
            },
        },
        {
            "rail": {"type": "prismatic", "markers": ["ground", "cart"]},
            "hinge": {"type": "revolute", "markers": ["cart.h", "bob.h"]},
        },
        gravity=[0.0, -9.81],
    )
    found = linearise(compile_scene(described, keep_joints=True), "start")
    turning = 0.01 + 0.5 * 0.25 - 0.25**2 / 5.5
    swing = np.sqrt(0.5 * 9.81 * 0.5 / turning) / (2.0 * np.pi)
    assert found.frequencies[1] == pytest.approx(swing, rel=1e-6)
    assert found.diagnostics == ()


def at_height(y: float) -> dict[str, Any]:
    return {"position": [0.0, y]}


@pytest.mark.parametrize("spin", [0.0, 1.0, 10.0, 31.4159, 77.7, 250.0])
def test_a_jeffcott_rotor_whirls_forward_and_backward(spin: float) -> None:
    """m x'' + k x = 0 in inertial axes; A t'' - i C W t' + k t = 0 of the tilt."""
    k, tilt = 4000.0, 300.0
    described = rotor_at(spin, [k, k, 16000.0, tilt, tilt], [0.2, 0.2, 0.3])
    found = linearise(described, "start")
    roots = np.roots([0.2, -0.3 * spin, -tilt])
    expected = [0.0, *[np.sqrt(k / 2.0)] * 2, np.sqrt(8000.0), *np.abs(roots)]
    seen = np.sort(2.0 * np.pi * found.inertial_frequencies)
    assert seen == pytest.approx(np.sort(expected), rel=1e-6)
    assert found.rigid.sum() == 1
    assert (found.damping_ratios > -1e-6).all()
    whirl = [found.whirl.count(way) for way in ("forward", "backward")]
    assert whirl == ([2, 2] if spin else [0, 0])
    lateral = [k for k, way in enumerate(found.whirl) if way]
    for k in lateral:
        rate = 2.0 * np.pi * found.inertial_frequencies[k]
        sign = 1.0 if found.whirl[k] == "forward" else -1.0
        rotating = 2.0 * np.pi * found.rotating_frequencies[k]
        assert rotating == pytest.approx(abs(sign * rate - spin), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("spin", [0.0, 0.7, 5.0, 33.3, 170.0])
def test_a_free_body_has_its_rigid_motions_and_nothing_grows(
    planar: bool, spin: float
) -> None:
    """Three or six at rest; of a spinning top all but its nutation are rigid."""
    body = {"mass": 2.0, "inertia": 0.3 if planar else [0.2, 0.2, 0.3]}
    described = scene(
        {"top": body | {"initial": table(spin, planar)}},
        dimension="planar" if planar else "spatial",
    )
    found = linearise(compile_scene(described, keep_joints=True), "start")
    assert (found.damping_ratios[~found.rigid] > -1e-6).all()
    if not spin:
        assert found.frequencies == pytest.approx(np.zeros(3 if planar else 6), abs=0)
    if spin and not planar:
        moving = 2.0 * np.pi * found.inertial_frequencies
        assert np.abs(moving - 1.5 * spin).min() < 1e-6 * spin


@pytest.mark.parametrize("slope", [0.0, 1e-3])
def test_what_formulas_couple_moves_freely_together(slope: float) -> None:
    """A belt by two laws: its pulleys turn together as nothing resists, exactly.

    They were unstable, by exp(6e-7 t/s) of rounding. A slope of the motor torque over
    the angle of 1e-3 N m/rad does grow, with the inertia of both at the motor.
    """
    inertia, radius = np.array([0.02, 0.3]), np.array([0.05, 0.15])
    terms = {"pull": "4e4*(0.05*one.angle - 0.15*two.angle)"}
    law = {"type": "expression", "terms": terms}
    far = [0.5, 0.0]
    found = linearise(
        compile_scene(
            scene(
                {
                    "a": {"mass": 1.0, "inertia": inertia[0]},
                    "b": {
                        "mass": 1.0,
                        "inertia": inertia[1],
                        "initial": {"position": far},
                    },
                },
                {
                    "one": {"type": "revolute", "markers": ["ground", "a"]},
                    "two": {"type": "revolute", "markers": ["ground.far", "b"]},
                },
                forces={
                    "motor": {
                        "type": "actuator",
                        "joint": "one",
                        "function": law | {"value": f"{slope}*one.angle - 0.05*pull"},
                    },
                    "driven": {
                        "type": "actuator",
                        "joint": "two",
                        "function": law | {"value": "0.15*pull"},
                    },
                },
                ground={"markers": {"far": {"position": far}}},
            ),
            ".",
        )
    )
    stiffness = 4e4 * np.outer(radius, radius) - [[slope, 0.0], [0.0, 0.0]]
    belt = np.linalg.eigvals(stiffness * [[1, -1], [-1, 1]] / inertia[:, None]).max()
    assert found.eigenvalues[-1] == pytest.approx(1j * np.sqrt(belt), rel=1e-7)
    together = inertia[0] + inertia[1] * (radius[0] / radius[1]) ** 2
    growth = np.sqrt(slope / together)
    assert found.eigenvalues[0].real == pytest.approx(growth, rel=1e-4)
    assert ("N714" in codes(found)) == (slope > 0.0)
    assert found.rigid.sum() == (slope == 0.0)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_rigid_bodies_fixed_to_each_other_turn_as_one(count: int) -> None:
    """A round rotor of several bodies has the modes of one of their inertia."""
    found = []
    for parts in (count, 0):
        spin, mass, radius = 40.0, 0.3, 0.2
        hub = 2.0, [0.2, 0.2, 0.3]
        bodies, joints, ends = {}, {}, {}
        for k in range(parts):
            angle = 2.0 * np.pi * k / count
            place = (radius * np.cos(angle), radius * np.sin(angle), 0.0)
            ends[f"m{k}"] = {"position": list(place)}
            tables = table(spin, False, place)
            bodies[f"p{k}"] = {"mass": mass, "inertia": [1e-3] * 3, "initial": tables}
            joints[f"j{k}"] = {"type": "fixed", "markers": [f"rotor.m{k}", f"p{k}"]}
        if not parts:
            more = count * mass * radius**2
            total = np.add(hub[1], [more / 2, more / 2, more]) + count * 1e-3
            hub = hub[0] + count * mass, total.tolist()
        rotor = {"mass": hub[0], "inertia": hub[1], "initial": table(spin, False)}
        rotor["markers"] = ends
        spring = {
            "type": "bushing",
            "markers": ["ground", "rotor"],
            "stiffness": [4000.0, 9000.0, 16000.0, 300.0, 300.0, 0.0],
            "shaft": "z",
        }
        described = scene(
            {"rotor": rotor, **bodies},
            joints,
            forces={"bearing": spring},
            dimension="spatial",
        )
        modes = linearise(compile_scene(described, keep_joints=True), "start")
        found.append(np.sort(modes.inertial_frequencies))
    assert found[0] == pytest.approx(found[1], rel=1e-6, abs=1e-6)
