"""Frequency responses: closed forms of a cantilever, a swept sine, ranges, peaks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.sid import Array
from sidtool.solver.analyses.frequency_response import (
    frequency_range,
    parse_excitation,
)
from tests.places import SLIDER_CRANK

from .state_space_scenes import controlled_arm, link, pendulum, slider_crank, taking

LENGTH, SIDE, YOUNG, DENSITY, BETA = 0.8, 0.02, 7e10, 2700.0, 2e-5


def cantilever() -> sidtool.Scene:
    """A bar that is clamped at its start, with a force across its end."""
    scene = sidtool.Scene.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "time": {"end": 1.0, "output_step": 0.1},
            "bodies": {"bar": {"sid": "-", "markers": {"start": 1, "end": 2}}},
            "joints": {"clamp": {"type": "fixed", "markers": ["ground", "bar.start"]}},
            "inputs": {"force": {"unit": "N"}},
            "forces": {
                "push": taking(
                    "force", type="force", marker="bar.end", force=[0.0, 0.0, 1.0]
                )
            },
            "outputs": {"record": ["bar.end.z", "bar.end.az"]},
        }
    )
    return scene.with_({"bodies.bar.sid": link(LENGTH)})


def test_a_cantilever_is_that_of_its_reduced_model() -> None:
    """H = phi^T (K + i w D - w^2 M)^-1 phi of the blocks of the SID."""
    space, sid = cantilever().state_space(), link(LENGTH)
    f = np.geomspace(1.0, 3000.0, 60)
    response = space.response(f)
    phi = next(node for node in sid.nodes if node.id == "2").phi.m0[2]
    expected = []
    for omega in 2.0 * np.pi * f:
        dynamic = sid.Ke.m0 + 1j * omega * sid.De.m0 - omega**2 * sid.Me.m0
        expected.append(phi @ np.linalg.solve(dynamic, phi))
    assert response.units == ("m/N", "m/s\u00b2/N")
    assert_allclose(response["bar.end.z"], expected, rtol=1e-6)
    second = -((2.0 * np.pi * f) ** 2) * np.array(expected)
    assert_allclose(response["bar.end.az"], second, rtol=1e-6)


def test_the_founding_rod_is_that_of_its_blocks() -> None:
    """(K + i w C - w^2 M) of the blocks of the SID, pinned at a held crank, with the
    piston on its line; a force along that line and a moment at the piston pin."""
    angle, piston = math.radians(60.0), 5.0
    tilt = -math.asin(0.1 * math.sin(angle))
    names = (
        "piston.x",
        "rod.piston_pin.rotation_z",
        *(f"rod.q{k}" for k in range(1, 6)),
    )
    loads = {"force": [1.0, 0.0]}, {"torque": 1.0}
    held = {"joint": "bearing", "function": {"type": "constant", "value": angle}}
    scene = slider_crank().with_(
        {
            "gravity": [0.0, 0.0],
            "drives": {"brake": held},
            "inputs": {"load": {}, "moment": {}},
            "forces": {
                name: taking(name, type="force", marker="rod.piston_pin", **load)
                for name, load in zip(("load", "moment"), loads, strict=True)
            },
            "outputs.record": names,
        }
    )
    sid = sidtool.read(SLIDER_CRANK / "rod_q4.SID_FEM")
    n = 3 + len(sid.Ke.m0)
    M, C, K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    c_x, c_y, _ = np.ravel(sid.mdCM.m0)
    M[:3, :3] = [[sid.mass, 0.0, -c_y], [0.0, sid.mass, c_x], [-c_y, c_x, 0.0]]
    M[2, 2] = np.ravel(sid.J.m0)[2]
    M[3:, :3] = np.column_stack([sid.Ct.m0[:, :2], sid.Cr.m0[:, 2]])
    M[:3, 3:], M[3:, 3:] = M[3:, :3].T, sid.Me.m0
    C[3:, 3:], K[3:, 3:] = sid.De.m0, sid.Ke.m0
    ends = []
    for node in sid.nodes:
        x, y, _ = np.ravel(node.origin.m0)
        ends.append(np.hstack([[[1.0, 0.0, -y], [0.0, 1.0, x]], node.phi.m0[:2]]))
    along = np.array([math.cos(tilt), -math.sin(tilt)]) @ ends[1]
    across = np.array([math.sin(tilt), math.cos(tilt)]) @ ends[1]
    turn = np.concatenate([[0.0, 0.0, 1.0], sid.nodes[1].psi.m0[2]])
    M += piston * np.outer(along, along)
    free = np.linalg.svd(np.vstack([ends[0], across]))[2][3:].T
    shown, loaded = np.vstack([along, turn, np.eye(n)[3:]]), np.array([along, turn])
    f = np.geomspace(1.0, 5000.0, 40)
    expected = []
    for omega in 2.0 * np.pi * f:
        dynamic = free.T @ (K + 1j * omega * C - omega**2 * M) @ free
        expected.append(shown @ free @ np.linalg.solve(dynamic, free.T @ loaded.T))
    space = scene.state_space()
    assert not space.D.any()
    for k, name in enumerate(scene.inputs):
        found, exact = space.response(f, name).values, np.array(expected)[:, :, k]
        # a moment bends the rod, which moves the piston in the second order alone
        errors, sizes = np.abs(found - exact)[:, k:], np.abs(exact)[:, k:]
        assert np.all(errors.max(axis=0) < 1e-10 * sizes.max(axis=0))
        assert np.all(errors[:, 0] < 1e-9 * sizes[:, 0])


def euler_bernoulli(f: Array) -> np.ndarray:
    """Receptance of the end of a cantilever with damping that is proportional to K."""
    omega = 2.0 * np.pi * f
    bending = YOUNG * SIDE**4 / 12 * (1 + 1j * BETA * omega)
    x = LENGTH * (DENSITY * SIDE**2 * omega**2 / bending) ** 0.25
    above = np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)
    below = bending * (x / LENGTH) ** 3 * (1 + np.cos(x) * np.cosh(x))
    return np.asarray(above / below)


def rayleigh(f: Array) -> np.ndarray:
    """The same with rotary inertia, which four exponentials along the bar solve."""
    found = []
    for omega in 2.0 * np.pi * f:
        bending = YOUNG * SIDE**4 / 12 * (1 + 1j * BETA * omega)
        mass, turning = DENSITY * np.array([SIDE**2, SIDE**4 / 12]) * omega**2
        r = np.roots([bending, 0.0, turning, 0.0, -mass])
        end = np.exp(r * LENGTH)
        moment, shear = r**2 * end, -(bending * r**3 + turning * r) * end
        conditions = np.array([np.ones(4), r, moment, shear])
        found.append(end @ np.linalg.solve(conditions, [0.0, 0.0, 0.0, 1.0]))
    return np.array(found)


def test_a_cantilever_is_that_of_the_closed_form() -> None:
    """Through its first resonance with damping; peaks without rotary inertia."""
    fine = link(LENGTH, 32, "attachment", 8)
    space = cantilever().with_({"bodies.bar.sid": fine}).state_space()
    f = np.linspace(1.0, 50.0, 30)
    assert_allclose(space.response(f)["bar.end.z"], rayleigh(f), rtol=1e-6)
    grid = np.linspace(20.0, 200.0, 180001)
    exact = np.abs(euler_bernoulli(grid))
    tops = grid[1:-1][(exact[1:-1] > exact[:-2]) & (exact[1:-1] > exact[2:])]
    peaks = space.response("10:200:log", outputs="bar.end.z").peaks
    assert_allclose([peak.frequency for peak in peaks], tops, rtol=1e-3)
    ratios = [math.pi * BETA * peak.mode_frequency for peak in peaks]
    assert_allclose([peak.damping_ratio for peak in peaks], ratios, rtol=1e-3)


def test_a_controlled_arm_answers_a_swept_sine_as_predicted() -> None:
    """Of a sweep after which all is at rest again, transforms have the ratio H."""
    scene = controlled_arm()
    space = scene.state_space()
    t = np.arange(0.0, 2.0, 0.005)
    window = np.sin(np.pi * t / 2.0) ** 4
    sweep = 0.1 * window * np.sin(2.0 * np.pi * (1.0 + 2.0 * t) * t)
    at_rest = scene.with_(
        {
            "initial": {"state": "static"},
            "time": {"end": 5.0, "output_step": 0.0025},
            "accuracy": {"rtol": 1e-7},
        }
    )
    times, values = np.append(t, [2.0, 5.0]), np.append(sweep, [0.0, 0.0])
    result = at_rest.simulate(inputs={"push": (times, values)})
    f = np.array([2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    kernel = np.exp(-2j * np.pi * np.outer(f, result.t))
    of_input = kernel @ result["inputs.push"]
    names = ["load.y", "motor.value"]
    response = space.response(f, "push", names)
    for name in names:
        found = kernel @ (result[name] - result[name][0]) / of_input
        assert_allclose(found, response[name], rtol=1e-3)


def oscillator(damping: float) -> sidtool.StateSpace:
    """2 kg on a spring of 800 N/m: 20 rad/s."""
    spring = {"type": "spring_damper", "joint": "rail", "stiffness": 800.0}
    return pendulum(
        gravity=[0.0, 0.0],
        bodies={"mass": {"mass": 2.0, "inertia": 1.0}},
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "mass"],
                "axis": [1.0, 0.0],
            }
        },
        forces={
            "spring": spring | {"damping": damping},
            "push": taking("torque", type="force", marker="mass", force=[1.0, 0.0]),
        },
        outputs={"record": ["mass.x", "mass.vx"]},
    ).state_space()


def test_peaks_have_the_mode_that_causes_them() -> None:
    """x'' + 2 d w x' + w^2 x = F / m: largest at w sqrt(1 - 2 d^2)."""
    ratio, omega = 0.1, 20.0
    space = oscillator(2.0 * ratio * omega * 2.0)
    (x, v) = space.response("0.1:100:log").peaks
    hertz = omega / (2.0 * math.pi)
    assert_allclose(x.frequency, hertz * math.sqrt(1 - 2 * ratio**2), rtol=1e-7)
    assert_allclose(x.magnitude, 1 / (2 * ratio * math.sqrt(1 - ratio**2)) / 800.0)
    assert_allclose([v.frequency, x.mode_frequency], hertz, rtol=1e-7)
    assert_allclose([x.damping_ratio, v.damping_ratio], ratio, rtol=1e-7)


def test_without_damping_a_peak_has_no_bound() -> None:
    (peak,) = oscillator(0.0).response("1:10:log", outputs="mass.x").peaks
    assert math.isinf(peak.magnitude) and abs(peak.damping_ratio) < 1e-9
    assert_allclose(peak.frequency, 20.0 / (2.0 * math.pi), rtol=1e-9)


def test_an_unbalance_grows_with_the_square_of_the_speed() -> None:
    space = oscillator(1.0)
    f = np.array([1.0, 5.0, 50.0])
    plain, turning = space.response(f), space.response(f, unbalance=True)
    factor = (2.0 * np.pi * f[:, None]) ** 2
    assert_allclose(turning.values, factor * plain.values, rtol=1e-12)
    assert turning.units[0] == "m/(kg m)"


def test_the_response_to_a_position_is_that_to_its_acceleration_times_s_squared() -> (
    None
):
    base = {"base": taking("torque", joint="pivot", of="value")}
    inputs = {"torque": {"interpolation": "smooth", "initial": -math.pi / 2}}
    space = pendulum(forces={}, drives=base, inputs=inputs).state_space(about="start")
    f = np.array([0.5, 2.0])
    moved = space.response(f, "torque", "pivot.angle")
    assert_allclose(moved["pivot.angle"], 1.0, rtol=1e-8)
    by_acceleration = space.response(f, "torque.acceleration", "pivot.angle")
    squares = -1.0 / (2.0 * np.pi * f) ** 2
    assert_allclose(by_acceleration["pivot.angle"], squares, rtol=1e-8)
    assert moved.units == ("rad/rad",)
    assert by_acceleration.units == ("rad/(rad/s\u00b2)",)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fx", {"fx": 1.0}),
        ("fx - 1j*fy", {"fx": 1.0, "fy": -1j}),
        ("-(2*fx) + fy*0.5", {"fx": -2.0, "fy": 0.5}),
        ("inputs.fx + fx", {"fx": 2.0}),
    ],
)
def test_sums_of_inputs(text: str, expected: dict[str, complex]) -> None:
    assert parse_excitation(text, ("fx", "fy")) == expected


@pytest.mark.parametrize("text", ["", "fx*fy", "fx +", "f(x)", "fw", "3"])
def test_what_is_no_sum_of_inputs_is_refused(text: str) -> None:
    with pytest.raises(sidtool.InputError) as caught:
        parse_excitation(text, ("fx", "fy"))
    assert caught.value.place == "input"


def test_ranges_of_frequencies() -> None:
    assert_allclose(frequency_range("1:100:log:3"), [1.0, 10.0, 100.0])
    assert_allclose(frequency_range("0:10:lin:3"), [0.0, 5.0, 10.0])
    assert len(frequency_range("1:10")) == 500


@pytest.mark.parametrize("text", ["", "1", "2:1", "0:1:log", "1:2:cubic", "1:2:lin:1"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(sidtool.InputError) as caught:
        frequency_range(text)
    assert caught.value.place == "frequencies"


@pytest.mark.parametrize(
    "settings", [{"of": "fx"}, {"outputs": "mass.y"}, {"frequencies": [-1.0]}]
)
def test_wrong_requests_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(sidtool.InputError):
        oscillator(1.0).response(**settings)
