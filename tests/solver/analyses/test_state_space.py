"""State spaces: closed forms, natural modes, statics, and runs of the full scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

import sidtool
from tests.codes import codes
from tests.places import EXAMPLES

from .state_space_scenes import (
    ARM_INERTIA,
    ARM_MASS,
    GRAVITY,
    HALF,
    controlled_arm,
    four_bar,
    pendulum,
    response_at,
    slider_crank,
    spatial_arm,
    taking,
)

#: About the pivot [kg m^2], and the torque of gravity per angle [N m/rad].
INERTIA = ARM_INERTIA + ARM_MASS * HALF**2
STIFFNESS = ARM_MASS * GRAVITY * HALF
ROTOR = EXAMPLES / "rotor"
SCENES = {"slider_crank": slider_crank, "arm": spatial_arm, "four_bar": four_bar}


@cache
def scene_of(name: str) -> sidtool.Scene:
    return SCENES[name]()


@cache
def space_of(name: str) -> sidtool.StateSpace:
    return scene_of(name).state_space(descriptor=True)


def test_a_pendulum_is_that_of_its_equation() -> None:
    """J a'' + m g h a = torque; the tip is 2 h below the pivot, the mass h."""
    space = pendulum().state_space()
    assert space.state_names == ("arm.rotation_z_body", "arm.wz_body")
    assert space.state_units == ("rad", "rad/s")
    assert space.input_names == ("torque",) and space.input_units == ("N m",)
    assert space.output_units == ("rad", "m/s\u00b2", "N", "N")
    w2, gain = STIFFNESS / INERTIA, 1.0 / INERTIA
    assert_allclose(space.A, [[0.0, 1.0], [-w2, 0.0]], atol=1e-9)
    assert_allclose(space.B, [[0.0], [gain]], atol=1e-9)
    tip, pull = 2 * HALF, ARM_MASS * HALF
    C = [[1.0, 0.0], [-w2 * tip, 0.0], [-w2 * pull, 0.0], [0.0, 0.0]]
    assert_allclose(space.C, C, atol=1e-8)
    D = [[0.0], [gain * tip], [gain * pull], [0.0]]
    assert_allclose(space.D, D, atol=1e-9)
    weight = ARM_MASS * GRAVITY
    assert_allclose(space.outputs, [-math.pi / 2, 0.0, 0.0, weight], atol=1e-9)
    second = space.second_order
    assert_allclose([second.M[0, 0], second.K[0, 0]], [INERTIA, STIFFNESS], rtol=1e-9)
    assert_allclose(second.B, [[1.0]], rtol=1e-9)
    assert space.is_steady and codes(space) == []


def test_a_closed_loop_has_the_states_of_its_controller() -> None:
    """PID with the derivative of the measured angle behind a lag of 10 ms."""
    p, i, d, lag = 30.0, 10.0, 2.0, 0.01
    gains = {"type": "pid", "p": p, "i": i, "d": d, "filter": lag}
    reference = {"type": "input", "name": "torque"}
    law = gains | {"measured": "pivot.angle", "reference": reference}
    motor = {"motor": {"type": "actuator", "joint": "pivot", "function": law}}
    record = {"record": ["pivot.angle", "motor.value"]}
    down = {"torque": {"initial": -math.pi / 2}}
    space = pendulum(forces=motor, inputs=down, outputs=record).state_space()
    s = 0.3 + 4.0j
    filtered = p + i / s + d * s / (lag * s + 1)
    lagged = d * s / (lag * s + 1)
    loop = INERTIA * s**2 + STIFFNESS + filtered
    angle = (filtered - lagged) / loop  # the reference is held: no derivative of it
    torque = angle * (INERTIA * s**2 + STIFFNESS)
    assert_allclose(response_at(space, s)[:, 0], [angle, torque], rtol=1e-8)
    assert "motor.state.integral" in space.state_names


@pytest.mark.parametrize(
    ("of", "interpolation", "name", "powers"),
    [
        ("acceleration", "hold", "torque", 0),
        ("rate", "linear", "torque.rate", 1),
        ("value", "smooth", "torque.acceleration", 2),
    ],
)
def test_an_input_that_prescribes_a_motion(
    of: str, interpolation: str, name: str, powers: int
) -> None:
    """The rate is 1/s of the acceleration, and the torque of the drive J of it."""
    space = pendulum(
        forces={},
        inputs={"torque": {"interpolation": interpolation}},
        drives={"servo": taking("torque", joint="pivot", of=of)},
        outputs={"record": ["pivot.angle_rate", "servo.mz"]},
        bodies={"arm": _arm_on_x()},
    ).state_space(about="start")
    assert space.input_names == (name,)
    assert ("N725" in codes(space)) is (powers > 0)
    s = 0.2 + 3.0j
    assert_allclose(response_at(space, s)[:, 0], [1 / s, INERTIA], rtol=1e-8)


def _arm_on_x() -> dict[str, Any]:
    """Horizontal, where gravity has no stiffness against the rotation."""
    marker = {"pivot": {"position": [-HALF, 0.0]}, "tip": {"position": [HALF, 0.0]}}
    inertia = {"mass": ARM_MASS, "inertia": ARM_INERTIA}
    return {**inertia, "initial": {"position": [HALF, 0.0]}, "markers": marker}


@pytest.mark.parametrize("name", SCENES)
def test_runs_answer_a_step_of_an_input_as_the_state_space_does(name: str) -> None:
    """Half the difference of two runs has no error of second order in the step."""
    scene = scene_of(name)
    step = {"slider_crank": 0.1, "arm": 0.1, "four_bar": 1e-3}[name]
    end = {"slider_crank": 0.05, "arm": 0.03, "four_bar": 0.05}[name]
    at_rest = scene.with_(
        {
            "initial": {"state": "static"},
            "time": {"end": end, "output_step": end / 5},
            "accuracy": {"rtol": 1e-10, "integrator": "radau9"},
        }
    )
    space = at_rest.state_space()
    k = {"slider_crank": "load", "arm": "push", "four_bar": "torque"}[name]
    column, before = space.input_names.index(k), space.inputs.copy()
    start = end / 5
    runs = [
        at_rest.simulate(inputs={k: ([start], [before[column] + sign * step])})
        for sign in (1.0, -1.0)
    ]
    found = (runs[0].values - runs[1].values)[2:] / (2 * step)
    n = len(space.A)
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n], augmented[:n, n] = space.A, space.B[:, column]
    expected = np.array(
        [
            space.C @ expm(augmented * (t - start))[:n, n] + space.D[:, column]
            for t in runs[0].t[2:]
        ]
    )
    sizes = np.abs(expected).max(axis=0)
    assert np.all(sizes > 1e-9)
    assert np.all(np.abs(found - expected).max(axis=0) < 1e-6 * sizes)


@pytest.mark.parametrize("name", SCENES)
def test_eigenvalues_are_those_of_the_natural_modes(name: str) -> None:
    space, modes = space_of(name), scene_of(name).linearise()
    values = space.eigenvalues[space.eigenvalues.imag >= 0.0]
    expected = modes.eigenvalues[np.argsort(np.abs(modes.eigenvalues))]
    assert np.all(np.abs(values - expected) < 1e-10 * np.abs(expected).max())
    assert np.abs(space.state_rates).max() < 1e-6 * np.abs(space.A).max()


@pytest.mark.parametrize("name", SCENES)
def test_the_static_gain_is_that_of_static_equilibria(name: str) -> None:
    """Differences of sixth order of equilibria, by changes of the inputs.

    Accelerations are zero, as sums of terms of 1e9, and are left out.
    """
    scene, space = scene_of(name), space_of(name)
    compared = [unit != "m/s\u00b2" for unit in space.output_units]
    gain = response_at(space, 0.0).real[compared]
    step = {"slider_crank": 0.2, "arm": 0.4, "four_bar": 4e-4}[name]
    weights = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    for k, name_of_input in [*enumerate(space.input_names)][::2]:
        found = 0.0
        for point, weight in weights.items():
            value = float(space.inputs[k] + point * step)
            changed = scene.with_({f"inputs.{name_of_input}.initial": value})
            values = changed.static_equilibrium().result().values[0, compared]
            found = found + weight * values / step
        errors = np.abs(found - gain[:, k]) / (np.abs(gain).max(axis=1) + 1e-300)
        # deformations are small beside the rotations that carry them
        assert np.all(errors <= np.where(np.abs(gain).max(axis=1) < 1e-4, 3e-7, 1e-8))


@pytest.mark.parametrize("name", SCENES)
def test_all_forms_have_the_same_response(name: str) -> None:
    space = space_of(name)
    second, descriptor = space.second_order, space.descriptor
    assert descriptor is not None and len(descriptor.names) == len(descriptor.A)
    for s in (40.0j, 0.5 + 200.0j):
        expected = response_at(space, s)
        size = np.abs(expected).max(axis=1, keepdims=True)
        p = np.linalg.solve(s**2 * second.M + s * second.C + second.K, second.B)
        found = second.F @ p + s * second.G @ p + second.D
        assert np.all(np.abs(found - expected) < 1e-9 * size)
        x = np.linalg.solve(s * descriptor.E - descriptor.A, descriptor.B)
        found = descriptor.C @ x + descriptor.D
        assert np.all(np.abs(found - expected) < 1e-6 * size)
    assert_allclose(second.M, second.M.T, atol=1e-12 * np.abs(second.M).max())
    assert np.linalg.eigvalsh(second.M)[0] > 0.0


def test_in_the_middle_of_a_motion_it_is_that_of_an_instant() -> None:
    """A pendulum at a known angle: the stiffness is that of the tangent."""
    arm = {"arm": _arm_on_x()}
    scene = pendulum(bodies=arm, outputs={"record": ["pivot.angle", "arm.wz"]})
    space = scene.state_space(about=0.2)
    angle, rate = space.outputs
    assert not space.is_steady and space.about == space.time == 0.2
    assert {"N710", "N715"} <= {*codes(space)}
    w2 = STIFFNESS / INERTIA
    assert -1.0 < angle < -0.1 and rate < 0.0
    assert_allclose(space.A[1, 0], w2 * math.sin(angle), rtol=1e-7)
    assert_allclose(space.state_rates[1], -w2 * math.cos(angle), rtol=1e-7)
    assert_allclose(space.B[1, 0], 1 / INERTIA, rtol=1e-9)


def test_friction_that_slides_and_sticks_is_in_the_outputs() -> None:
    """A block on a rough rail: held, its guide bears the input; sliding, it moves."""
    force = taking("torque", type="force", marker="block", force=[1.0, 0.0])
    block = {"mass": 2.0, "inertia": 0.1}
    scene = pendulum(
        bodies={"block": block | {"initial": {"velocity": [1.0, 0.0]}}},
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "axis": [1.0, 0.0],
                "friction": {"coefficient": 0.3},
            }
        },
        forces={"push": force},
        outputs={"record": ["block.ax", "rail.friction"]},
    )
    sliding = scene.state_space(about="start")
    assert_allclose(sliding.D[:, 0], [0.5, 0.0], atol=1e-8)
    held = scene.with_({"bodies.block.initial": {}}).state_space(about="start")
    assert len(held.A) == 0
    assert_allclose(held.D[:, 0], [0.0, -1.0], atol=1e-8)


def test_a_rotor_has_axes_in_which_its_forces_are_constant(
    two_planes: Callable[[], sidtool.Scene],
) -> None:
    """Jeffcott rotor, w^2 = k / m; a force that turns with it drives both whirls."""
    scene = two_planes()
    space = scene.state_space(about="start")
    assert space.is_steady
    s = 5.0j
    spring, mass = 4000.0, 2.0
    expected = np.eye(2) / (mass * s**2 + spring)
    assert_allclose(response_at(space, s), expected, rtol=1e-7, atol=1e-11)
    turning = scene.state_space(about="start", outputs=["disc.vy_body"])
    assert "N726" in codes(turning) and not turning.is_steady


@pytest.fixture
def two_planes() -> Callable[[], sidtool.Scene]:
    """A rigid disc that turns about x on springs across it."""

    def make() -> sidtool.Scene:
        across = {
            f"f{axis}": taking(f"f{axis}", type="force", marker="disc", force=vector)
            for axis, vector in (("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0]))
        }
        bushing = {
            "type": "bushing",
            "markers": ["ground", "disc"],
            "stiffness": [4000.0, 4000.0, 4000.0, 0.0, 50.0, 50.0],
            "shaft": "x",
        }
        turning = {"angular_velocity": [30.0, 0.0, 0.0]}
        disc = {"mass": 2.0, "inertia": [0.02, 0.01, 0.01], "initial": turning}
        return sidtool.Scene.model_validate(
            {
                "format": "sidtool scene",
                "version": 1,
                "dimension": "spatial",
                "time": {"end": 1.0, "output_step": 0.1},
                "bodies": {"disc": disc},
                "inputs": {"fy": {}, "fz": {}},
                "forces": {**across, "bearing": bushing},
                "outputs": {"record": ["disc.y", "disc.z"]},
            }
        )

    return make


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"inputs": ["torqe"]}, "inputs"),
        ({"outputs": ["arm.tip.q"]}, "outputs.record[0]"),
        ({"about": "middle"}, "about"),
        ({"about": -1.0}, "about"),
    ],
)
def test_wrong_requests_are_refused(settings: dict[str, Any], place: str) -> None:
    with pytest.raises(sidtool.InputError) as caught:
        pendulum().state_space(**settings)
    assert caught.value.place == place


def test_integrals_along_a_run_are_left_out() -> None:
    space = pendulum().state_space(outputs=["energy.supplied", "pivot.angle"])
    assert space.output_names == ("pivot.angle",) and "N728" in codes(space)


def test_an_arm_that_its_motor_holds_is_steady() -> None:
    """Gravity alone holds its angle: 4e-11 of the stiffness of the axial mode."""
    torque = 19.08634  # of 19.086336 N m at the straight arm
    motor = taking("torque", type="actuator", joint="shoulder")
    scene = controlled_arm().with_(
        {
            "inputs": {"torque": {"initial": torque}},
            "forces": {"motor": motor},
            "outputs.record": ["load.y"],
        }
    )
    space = scene.state_space()
    assert space.is_steady and codes(space) == []
    weights = {-1.0: -0.5, 1.0: 0.5}
    gain, step = 0.0, 1e-6
    for sign, weight in weights.items():
        near = scene.with_({"inputs.torque.initial": torque + sign * step})
        height = near.static_equilibrium().result()["load.y"][0]
        gain += weight * float(height) / step
    assert response_at(space, 0.0).real[0, 0] == pytest.approx(gain, rel=1e-4)


def test_a_running_rotor_bends_under_a_load_as_one_at_rest() -> None:
    """A load that keeps its direction: forces of gyroscopes need a tilt that turns.

    The disc turns about a tilted axis: wx is the speed times the tilt F L^2 / 2 EI.
    """
    speed, length = 100.0, 0.5
    bending = 2.1e11 * math.pi * 0.02**4 / 64
    shaft = sidtool.convert(sidtool.Model.load(ROTOR / "shaft.toml"))
    loads = {
        name: taking(name, type="force", marker="disc", force=force)
        for name, force in (("fx", [1.0, 0.0, 0.0]), ("fy", [0.0, 1.0, 0.0]))
    }
    rotor = sidtool.Scene.load(ROTOR / "scene.toml").with_(
        {
            "bodies.shaft.sid": shaft,
            "inputs": {name: {} for name in loads},
            "forces": loads,
            "outputs.record": ["disc.x", "bearing.my", "disc.wx"],
        }
    )
    space = rotor.state_space(about="start")
    modes = rotor.linearise(about="start").eigenvalues  # in axes of the shaft
    in_them = np.abs(np.add.outer(modes.imag, [speed, -speed, 0.0])).ravel()
    for value in space.eigenvalues:
        error = np.abs(in_them - abs(value.imag)).min()
        assert error < 1e-10 * np.abs(space.eigenvalues).max()
    held = {"joint": "bearing", "function": {"type": "constant", "value": 0.0}}
    at_rest = rotor.with_({"drives.motor": held, "bodies.shaft.initial": {}})
    ends = [
        at_rest.with_(
            {
                "inputs.fx.initial": load,
                "bodies.disc.initial.angular_velocity": [0.0, 0.0, 0.0],
            }
        )
        .static_equilibrium()
        .result()
        .values[0]
        for load in (10.0, -10.0)
    ]
    expected = (ends[0] - ends[1]) / 20.0
    expected[2] = speed * length**2 / (2.0 * bending)
    gain = response_at(space, 0.0).real
    assert_allclose(gain[:, 0], expected, rtol=1e-8)


def test_without_an_equilibrium_there_is_the_start() -> None:
    falling = pendulum(joints={}, forces={}, outputs={"record": ["arm.y"]})
    with pytest.raises(sidtool.SimulationError) as caught:
        falling.state_space()
    assert [each.code for each in caught.value.diagnostics][:2] == ["N727", "N701"]
    assert falling.state_space(about="start").A.shape == (6, 6)


def test_a_loop_in_python_around_the_plant_moves_as_predicted() -> None:
    """Sampled PD control of the spatial arm: x -> exp(A h) x + ... u, y = C x."""
    joints, h, count = ("yaw", "shoulder", "elbow"), 0.01, 8
    measured = [
        f"{joint}.{kind}" for joint in joints for kind in ("angle", "angle_rate")
    ]
    scene = scene_of("arm").with_(
        {
            "initial": {"state": "static"},
            "outputs.record": measured,
            "accuracy": {"rtol": 1e-9, "integrator": "radau9"},
        }
    )
    space = scene.state_space(inputs=[*joints, "push"])
    gains = np.kron(np.eye(3), [[200.0, 20.0]])
    compiled = scene.compile()

    def closed_loop(push: float) -> list[list[float]]:
        plant, found = compiled.plant(), []
        for step in range(count):
            y = np.array([plant[name] for name in measured])
            found.append(y.tolist())
            torques = -gains @ (y - space.outputs)
            plant.set(**dict(zip(joints, torques.tolist(), strict=True)))
            plant.set(push=push if step < 3 else 0.0)
            plant.advance(h)
        return found

    size = 0.05
    found = np.subtract(closed_loop(size), closed_loop(-size)) / (2.0 * size)
    n, n_u = space.B.shape
    block = np.zeros((n + n_u, n + n_u))
    block[:n, :n], block[:n, n:] = space.A, space.B
    whole = expm(h * block)
    x, expected = np.zeros(n), []
    for step in range(count):
        y = space.C @ x
        expected.append(y)
        u = np.append(-gains @ y, 1.0 if step < 3 else 0.0)
        x = whole[:n, :n] @ x + whole[:n, n:] @ u
    sizes = np.abs(expected).max(axis=0)
    assert np.all(np.abs(found - np.array(expected)).max(axis=0) < 1e-6 * sizes)


@pytest.mark.parametrize("mass", [10.0, 0.1, 0.01])
def test_a_contact_has_its_stiffness_at_the_load(mass: float) -> None:
    """Hertz: f = k x^1.5 under the weight, at depths of 21 um to 0.2 um of 1 m.

    x = (m g / k)^(2/3), the slope is 1.5 k x^0.5.
    """
    hertz = 1e9
    law = f"{hertz}*max(-rail.displacement, 0)**1.5"
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -GRAVITY],
        time={"end": 0.1, "output_step": 0.1},
        initial={"state": "static"},
        bodies={
            "box": {
                "mass": mass,
                "inertia": 0.1,
                "markers": {"far": {"position": [1.0, 0.0]}},
            }
        },
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "box"],
                "axis": [0.0, 1.0],
            }
        },
        forces={
            "contact": {
                "type": "actuator",
                "joint": "rail",
                "function": {"type": "expression", "value": law},
            }
        },
    )
    slope = 1.5 * hertz * (mass * GRAVITY / hertz) ** (1.0 / 3.0)
    space = scene.state_space(outputs=["contact.force"])
    assert np.abs(space.eigenvalues) == pytest.approx(math.sqrt(slope / mass), rel=1e-8)
    assert np.abs(space.C).max() == pytest.approx(slope, rel=1e-8)
    assert "N745" not in codes(space)


def test_von_mises_stress_changes_as_its_components() -> None:
    """v^2 = s V s: dv = s V ds / v, also where a high mode changes v by far more.

    The peak changes as the stress at its point.
    """
    beam = sidtool.Model(
        title="beam",
        material={"youngs_modulus": 7e10, "poissons_ratio": 0.3, "density": 2700.0},
        geometry={
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [1.0, 0.0, 0.0],
            "section": {"shape": "L", "height": 0.03, "width": 0.02, "thickness": 2e-3},
        },
        discretisation={"type": "beam", "elements": 4},
        frame={"type": "tangent", "marker": "root", "clamp": "start"},
        markers={
            "root": {"node": 1, "edge": "start"},
            "tip": {"node": 2, "edge": "end"},
        },
        reduction={"method": "attachment", "interfaces": ["tip"], "modes": 10},
        stress={"peak_points": 3, "first_node": 101},
    )
    scene = sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, -GRAVITY],
        time={"end": 0.1, "output_step": 0.1},
        initial={"state": "static"},
        inputs={"push": {}},
        bodies={"beam": {"model": beam, "markers": {"root": 1, "tip": 2}}},
        joints={"wall": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        forces={
            "push": {
                "type": "force",
                "marker": "beam.tip",
                "force": [0.0, 1.0, 0.5],
                "torque": [0.1, 0.0, 0.0],
                "function": {"type": "input", "name": "push"},
            }
        },
    )
    parts = ("xx", "yy", "zz", "xy", "yz", "xz")
    outputs, nodes = ["beam.peak_von_mises"], (101, 102, 103)
    for node in nodes:
        outputs += [f"beam.{node}.von_mises"]
        outputs += [f"beam.{node}.sigma_{part}" for part in parts]
    space = scene.state_space(outputs=outputs)
    values, rates = np.asarray(space.outputs), space.C
    normal = 1.5 * np.eye(3) - 0.5
    form = np.block([[normal, np.zeros((3, 3))], [np.zeros((3, 3)), 3.0 * np.eye(3)]])
    largest = np.abs(rates[1::7]).max()
    for k, _ in enumerate(nodes):
        own = slice(2 + 7 * k, 8 + 7 * k)
        value = values[1 + 7 * k]
        expected = values[own] @ form @ rates[own] / value
        assert_allclose(rates[1 + 7 * k], expected, rtol=0.0, atol=1e-6 * largest)
    peak = 1 + 7 * int(np.argmax(values[1::7]))
    assert values[0] == pytest.approx(values[peak])
    assert_allclose(rates[0], rates[peak], rtol=0.0, atol=1e-6 * largest)


@pytest.mark.parametrize("opening", [1.0, 0.01, 2e-4, 1e-6, 1e-8])
def test_an_input_has_its_effect_at_its_value(opening: float) -> None:
    """A force 100 sqrt(u) on a spring of 10 N/m moves by 5 / sqrt(u) per input."""
    scene = sidtool.Scene(
        dimension="planar",
        time={"end": 0.1, "output_step": 0.1},
        inputs={"u": {"initial": opening}},
        bodies={"cart": {"mass": 1.0, "inertia": 0.1}},
        joints={"rail": {"type": "prismatic", "markers": ["ground", "cart"]}},
        forces={
            "spring": {"type": "spring_damper", "joint": "rail", "stiffness": 10.0},
            "valve": {
                "type": "actuator",
                "joint": "rail",
                "function": {"type": "expression", "value": "100*sqrt(u)"},
            },
        },
    )
    space = scene.state_space(outputs=["rail.displacement", "valve.force"])
    gain = space.D - space.C @ np.linalg.solve(space.A, space.B)
    exact = np.array([5.0, 50.0]) / math.sqrt(opening)
    assert_allclose(gain[:, 0], exact, rtol=1e-7)
