"""Floquet multipliers against Mathieu's stability chart and rotating shafts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_b

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.report.analyses import describe_floquet, floquet_data
from sidtool.report.json_data import to_json_text
from tests.codes import codes

from .state_space_scenes import pendulum
from .test_campbell import overhung, whirl_frequencies


def shaken_pendulum(delta: float, epsilon: float, **more: Any) -> sidtool.Scene:
    """A pendulum of 1 m whose pivot moves by (epsilon / 2) sin 2t, with g = delta:
    x'' + (delta - 2 epsilon sin 2t) x = 0 for small angles x."""
    bob = {"mass": 1.0, "inertia": 1e-12, "initial": {"position": [0.0, -1.0]}}
    bob["markers"] = {"pin": {"position": [0.0, 1.0]}}
    motion = {"type": "harmonic", "amplitude": epsilon / 2, "angular_frequency": 2.0}
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "gravity": [0.0, -delta],
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"cart": {"mass": 1.0, "inertia": 1.0}, "bob": bob},
        "joints": {
            "guide": {
                "type": "prismatic",
                "markers": ["ground", "cart"],
                "axis": [0.0, 1.0],
            },
            "pin": {"type": "revolute", "markers": ["cart", "bob.pin"]},
        },
        "drives": {"shake": {"joint": "guide", "function": motion}},
    }
    return sidtool.Scene.model_validate(content | more)


@pytest.mark.parametrize(
    ("delta", "is_stable"),
    [
        (float(mathieu_b(1, 0.3)) - 1e-4, True),
        (float(mathieu_b(1, 0.3)) + 1e-4, False),
        (float(mathieu_a(1, 0.3)) - 1e-4, False),
        (float(mathieu_a(1, 0.3)) + 1e-4, True),
        (float(mathieu_a(2, 0.3)) - 1e-4, False),
        (float(mathieu_a(2, 0.3)) + 1e-4, True),
    ],
)
def test_the_stability_chart_of_mathieus_equation(
    delta: float, is_stable: bool
) -> None:
    """Transition curves a_n, b_n of the chart of Ince and Strutt, to 1e-4."""
    found = sidtool.floquet(shaken_pendulum(delta, 0.3), "pi")
    assert found.is_stable == is_stable
    product = np.prod(np.abs(found.multipliers))
    assert product == pytest.approx(1.0, abs=1e-9)  # no damping (Liouville)


UNEQUAL = np.array([100.0, 225.0])


def unequal_shaft(speed: float, bearings: Array | None = None) -> sidtool.Scene:
    """A disc of 1 kg on a shaft of two stiffnesses, and on springs to the ground."""
    spin = {"initial": {"angular_velocity": "speed"}}
    forces: dict[str, Any] = {
        "shaft": {
            "type": "bushing",
            "markers": ["hub", "disc"],
            "stiffness": [*UNEQUAL.tolist(), 10.0],
        }
    }
    if bearings is not None:
        stiffness = [*bearings.tolist(), 0.0]
        forces["bearings"] = {"type": "bushing", "markers": ["ground", "disc"]}
        forces["bearings"]["stiffness"] = stiffness
    return sidtool.Scene(
        dimension="planar",
        parameters={"speed": speed},
        time={"end": 1.0, "output_step": 0.1},
        bodies={
            "hub": {"mass": 1.0, "inertia": 1.0} | spin,
            "disc": {"mass": 1.0, "inertia": 0.1} | spin,
        },
        joints={"axle": {"type": "revolute", "markers": ["ground", "hub"]}},
        drives={
            "motor": {
                "joint": "axle",
                "of": "rate",
                "function": {"type": "constant", "value": "speed"},
            }
        },
        forces=forces,
    )


@pytest.mark.parametrize("speed", [6.0, 9.99, 10.01, 14.99, 15.01, 20.0])
def test_a_shaft_of_two_stiffnesses_is_unstable_between_its_critical_speeds(
    speed: float,
) -> None:
    """Constant equations in rotating axes:
    (s^2 + a) (s^2 + b) + 4 W^2 s^2 = 0, a and b less W^2 of the squared frequencies."""
    found = sidtool.floquet(unequal_shaft(speed), "2*pi/speed")
    assert found.is_stable == (not 10.0 < speed < 15.0)
    a, b = UNEQUAL - speed**2
    roots = np.roots([1.0, 0.0, a + b + 4 * speed**2, 0.0, a * b])
    for root in (*roots[roots.imag >= 0.0], 10.0j):
        near = np.abs(found.multipliers - np.exp(root * found.period))
        mirrored = np.abs(found.multipliers - np.exp(np.conj(root) * found.period))
        k = int(np.minimum(near, mirrored).argmin())
        assert min(near[k], mirrored[k]) < 1e-7
    bending = sorted({round(abs(root.imag) / (2 * np.pi), 6) for root in roots})
    for hertz in bending:
        assert np.abs(found.rotating_frequencies - hertz).min() < 1e-6
    assert (codes(found) == ["N714"]) == (not found.is_stable)


def test_a_shaft_of_two_stiffnesses_in_bearings_of_two_stiffnesses() -> None:
    """No axes have constant equations; those of the disc, integrated on their own."""
    speed, bearings = 7.0, np.array([30.0, 80.0])
    scene = unequal_shaft(speed, bearings)
    found = sidtool.floquet(scene, "2*pi/speed")

    def rates(t: float, x: Array) -> Array:
        c, s = np.cos(speed * t), np.sin(speed * t)
        R = np.array([[c, -s], [s, c]])
        K = R @ np.diag(UNEQUAL) @ R.T + np.diag(bearings)
        return np.concatenate([x[2:], -K @ x[:2]])

    span = (0.0, 2 * np.pi / speed)
    columns = [
        solve_ivp(rates, span, start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        for start in np.eye(4)
    ]
    for value in np.linalg.eigvals(np.array(columns).T):
        near = np.abs(found.multipliers - value)
        mirrored = np.abs(found.multipliers - value.conj())
        assert min(near.min(), mirrored.min()) < 1e-8
    with pytest.raises(sidtool.SimulationError):
        sidtool.linearise(scene, about="start")


def test_a_rotor_with_constant_equations_has_its_whirl_frequencies() -> None:
    """In space, gyroscopic: the frequencies in inertial axes of Stodola and Green."""
    speed = 100.0
    scene = overhung(speed)
    K = np.array(scene.forces["shaft"].stiffness)
    K[2, 2], K[5, 5] = 1e6, 1e4  # axial motion and torsion are slower
    scene = scene.with_({"forces.shaft.stiffness": K.tolist()})
    found = sidtool.floquet(scene, "2*pi/speed")
    for omega in whirl_frequencies(speed):
        hertz = abs(omega) / (2 * np.pi)
        assert np.abs(found.inertial_frequencies - hertz).min() < 1e-5 * hertz
        turning = abs(omega - speed) / (2 * np.pi)
        assert np.abs(found.rotating_frequencies - turning).min() < 1e-5 * hertz
    assert found.is_stable


def test_a_motion_that_does_not_return_and_one_that_is_not_smooth() -> None:
    free = pendulum(inputs={}, forces={})
    falling = free.with_({"bodies.arm.initial": {"position": [0.4, 0.0]}})
    with pytest.raises(sidtool.SimulationError) as caught:
        sidtool.floquet(falling, 0.3)
    assert codes(caught.value) == ["N741"]
    friction = {"joints.pivot.friction": {"coefficient": 0.1, "radius": 0.01}}
    with pytest.raises(sidtool.SimulationError) as caught:
        sidtool.floquet(free.with_(friction), 0.3)
    assert codes(caught.value) == ["N742"]
    for period in (-0.3, "2*pi/sped"):
        with pytest.raises(InputError, match="period: found"):
            sidtool.floquet(free, period)


def test_a_pendulum_at_rest_has_any_period(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Multipliers exp(i w T) of its constant equations; the command writes them."""
    scene = pendulum(inputs={}, forces={})
    path = tmp_path / "pendulum.toml"
    scene.save(path)
    omega = sidtool.linearise(scene).eigenvalues[0].imag
    target = tmp_path / "m.json"
    command = ["analyse", "floquet", str(path), "--period", "0.5", "-o", str(target)]
    assert run(command) == 0
    (mode,) = json.loads(target.read_text(encoding="utf-8"))["modes"]
    assert_allclose(complex(*mode["multiplier"]), np.exp(0.5j * omega), atol=1e-8)
    assert mode["inertial_frequency"] == pytest.approx(omega / (2 * np.pi), rel=1e-8)
    assert "stable: period 0.5 s" in capsys.readouterr().out


def block_on_a_spring(force: str, **law: Any) -> sidtool.Scene:
    """2 kg on 50 N/m at rest at x = 0.4 m, and a force along x."""
    function = {"type": "expression", "value": force} | law
    return sidtool.Scene(
        dimension="planar",
        gravity=[0.0, 0.0],
        time={"end": 1.0, "output_step": 0.1},
        bodies={"b": {"mass": 2.0, "initial": {"position": [0.4, 0.0]}}},
        joints={"guide": {"type": "point_on_line", "markers": ["ground", "b"]}},
        forces={
            "spring": {
                "type": "spring_damper",
                "markers": ["ground", "b"],
                "stiffness": 50.0,
                "rest": 0.4,
            },
            "law": {
                "type": "force",
                "marker": "b",
                "force": [1.0, 0.0],
                "function": function,
            },
        },
    )


def test_a_body_at_rest_whose_stiffness_has_another_period_is_refused() -> None:
    """Hill's equation x'' + (25 + 45 sin 2 pi t) x = 0 over one and two of its periods:
    the multipliers of two are the squares of those of one."""
    scene = block_on_a_spring("-90*sin(2*pi*t)*(b.x-0.4)")
    for period in (0.9, 1.001):
        with pytest.raises(sidtool.SimulationError) as caught:
            sidtool.floquet(scene, period)
        assert codes(caught.value) == ["N741"]
    one, two = (sidtool.floquet(scene, period).multipliers for period in (1.0, 2.0))
    near = np.minimum(np.abs(two - one**2), np.abs(two - one.conj() ** 2))
    assert near.max() < 1e-8


def test_functions_have_to_be_known_over_two_periods() -> None:
    times = np.linspace(0.0, 2.0, 41)
    table = {"type": "table", "times": times.tolist()}
    table["values"] = (0.1 * np.sin(2 * np.pi * times) ** 3).tolist()
    scene = shaken_pendulum(2.0, 0.3).with_({"drives.shake.function": table})
    with pytest.raises(InputError, match="two periods"):
        sidtool.floquet(scene, 1.5)


def test_a_scene_in_which_drives_prescribe_all_has_no_modes() -> None:
    scene = sidtool.Scene(
        dimension="planar",
        time={"end": 1.0, "output_step": 0.1},
        bodies={"b": {"mass": 2.0, "inertia": 0.1}},
        joints={"axle": {"type": "revolute", "markers": ["ground", "b"]}},
        drives={
            "motor": {
                "joint": "axle",
                "of": "rate",
                "function": {"type": "constant", "value": 2.0},
            }
        },
    )
    found = sidtool.floquet(scene, "pi")
    assert found.multipliers.shape == (0,) and found.is_stable
    with pytest.raises(sidtool.SimulationError, match="b misses its start"):
        sidtool.floquet(scene, 1.0)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_multiplier_of_zero_has_no_frequency() -> None:
    """A filter of 1e-12 s forgets all within a period."""
    scene = block_on_a_spring("-w", states={"w": {"rate": "-w*1e12"}})
    found = sidtool.floquet(scene, 1.0)
    assert found.multipliers[-1] == 0.0
    assert np.isneginf(found.exponents[-1].real)
    data = json.loads(to_json_text(floquet_data(found)))
    first, *_, last = data["modes"]
    assert last["exponent"] == [None, 0.0]
    assert last["inertial_frequency"] is last["rotating_frequency"] is None
    assert "nan" not in describe_floquet(found)
    assert first["exponent"][0] == pytest.approx(0.0, abs=1e-8)


def test_modes_that_are_too_fast_for_the_steps_are_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sidtool.solver.simulation.floquet.MAX_STEPS", 64)
    with pytest.warns(sidtool.DiagnosticWarning):
        found = sidtool.floquet(unequal_shaft(1.0, np.array([1e4, 1e4])), "2*pi/speed")
    assert "N743" in codes(found) and found.error > 1e-6
