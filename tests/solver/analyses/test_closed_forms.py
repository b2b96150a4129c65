"""Static equilibrium, natural modes and inverse dynamics against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.system.errors import SimulationError
from tests.places import SLIDER_CRANK

G = 9.81


def scene(dimension: str, record: list[str] | None = None, **tables: Any) -> SceneFile:
    head = {"format": "sidtool scene", "version": 1, "dimension": dimension}
    time = {"end": 1.0, "output_step": 0.05}
    outputs = {"record": record or []}
    return validate_data(
        {**head, "time": time, "outputs": outputs, **tables}, SceneFile
    )


def compiled(content: SceneFile, sids: dict[str, SID] | None = None) -> Any:
    return compile_scene(content, ".", sids, keep_joints=True)


def pendulum(dimension: str, record: list[str] | None = None, **more: Any) -> SceneFile:
    """A rod of 1 m and 2 kg on a hinge, starting level; gravity pulls down (-y)."""
    plane = dimension == "planar"
    inertia = 2.0 / 12.0
    at = [-0.5, 0.0] if plane else [-0.5, 0.0, 0.0]
    rod = {
        "mass": 2.0,
        "inertia": inertia if plane else [1e-3, inertia, inertia],
        "markers": {"hinge": {"position": at}},
        "initial": {"position": [0.5, 0.0] if plane else [0.5, 0.0, 0.0]},
    }
    gravity = [0.0, -G] if plane else [0.0, -G, 0.0]
    joints = {"hinge": {"type": "revolute", "markers": ["ground", "rod.hinge"]}}
    return scene(
        dimension, record, bodies={"rod": rod}, joints=joints, gravity=gravity, **more
    )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_pendulum_rests_hanging_and_swings_about_that(dimension: str) -> None:
    system = compiled(pendulum(dimension, ["rod.y", "hinge.fy"]))
    rest = static_equilibrium(system).result()
    assert rest["rod.y"][0] == pytest.approx(-0.5, abs=1e-9)
    assert rest["hinge.fy"][0] == pytest.approx(2.0 * G, rel=1e-9)
    modes = linearise(system)
    assert modes.frequencies == pytest.approx([np.sqrt(1.5 * G) / (2 * np.pi)])
    assert modes.damping_ratios == pytest.approx([0.0], abs=1e-7)


@pytest.mark.parametrize("light", [1.0, 1e-9])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_light_part_does_not_make_a_slow_pendulum_free(
    dimension: str, light: float
) -> None:
    """omega^2 = m g e / (J + m e^2), 1 mm below the pin; the mode was a rigid motion of
    0 Hz beside a part of 1 kg and 1e-6 kg m^2."""
    space = [0.0] if dimension == "spatial" else []
    turning = [1000.0] * 3 if space else 1000.0
    own = [1e-6 * light] * 3 if space else 1e-6 * light
    axis = {"axis": [0.0, 0.0, 1.0]} if space else {}
    arm: dict[str, Any] = {"mass": 1000.0, "inertia": turning}
    arm |= {"markers": {"pin": {"position": [0.0, 1e-3, *space]}}}
    arm |= {"initial": {"position": [0.0, -1e-3, *space]}}
    content = scene(
        dimension,
        gravity=[0.0, -G, *space],
        bodies={"arm": arm, "part": {"mass": light, "inertia": own}},
        joints={
            "pin": {"type": "revolute", "markers": ["ground", "arm.pin"]} | axis,
            "grip": {"type": "fixed", "markers": ["arm.pin", "part"]},
        },
    )
    found = linearise(compiled(content), "static").eigenvalues
    omega = math.sqrt(1000.0 * G * 1e-3 / (1000.0 + 1000.0 * 1e-6 + 1e-6 * light))
    assert found == pytest.approx([1j * omega], rel=1e-9)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_torsion_spring_holds_a_pendulum(dimension: str) -> None:
    k, d = 30.0, 0.4
    spring = {
        "type": "spring_damper",
        "joint": "hinge",
        "stiffness": k,
        "damping": d,
    }
    system = compiled(pendulum(dimension, ["rod.angle"], forces={"spring": spring}))
    angle = static_equilibrium(system).result()["rod.angle"][0]
    tilt = -abs(angle)
    assert k * tilt == pytest.approx(-2.0 * G * 0.5 * np.cos(tilt), rel=1e-9)
    modes = linearise(system)
    inertia, stiffness = 2.0 / 3.0, k - 2.0 * G * 0.5 * np.sin(tilt)
    frequency = np.sqrt(stiffness / inertia)
    assert modes.frequencies == pytest.approx([frequency / (2 * np.pi)], rel=1e-7)
    ratio = d / (2.0 * inertia * frequency)
    assert modes.damping_ratios == pytest.approx([ratio], rel=1e-6)


def test_masses_and_springs_have_their_textbook_frequencies() -> None:
    """Two masses between two springs in a line: m1 = m2 = m, k1 = k2 = k."""
    m, k = 2.0, 800.0
    content = scene(
        "planar",
        bodies={
            name: {"mass": m, "initial": {"position": [x, 0.0]}}
            for name, x in (("a", 1.0), ("b", 2.0))
        },
        joints={
            f"line_{name}": {"type": "point_on_line", "markers": ["ground", name]}
            for name in ("a", "b")
        },
        forces={
            "one": {
                "type": "spring_damper",
                "markers": ["ground", "a"],
                "rest": 1.0,
                "stiffness": k,
            },
            "two": {
                "type": "spring_damper",
                "markers": ["a", "b"],
                "rest": 1.0,
                "stiffness": k,
            },
        },
    )
    golden = np.array([3.0 - np.sqrt(5.0), 3.0 + np.sqrt(5.0)]) / 2.0
    expected = np.sqrt(golden * k / m) / (2.0 * np.pi)
    assert linearise(compiled(content)).frequencies == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("spin", [0.0, 2.0, 6.0])
def test_a_pendulum_on_a_turning_axle_stiffens(spin: float) -> None:
    """A point mass on an arm that can flap out of the plane of rotation.

    Without gravity the flapping frequency is the speed of rotation itself.
    """
    hub = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    hub["initial"] = {"angular_velocity": [0.0, 0.0, spin]}
    arm = {
        "mass": 1.0,
        "inertia": [1e-9, 1e-9, 1e-9],
        "markers": {"root": {"position": [-1.0, 0.0, 0.0]}},
        "initial": {
            "position": [1.0, 0.0, 0.0],
            "velocity": [0.0, spin, 0.0],
            "angular_velocity": [0.0, 0.0, spin],
        },
    }
    turn = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0, spin]}]}
    content = scene(
        "spatial",
        bodies={"hub": hub, "arm": arm},
        joints={
            "axle": {"type": "revolute", "markers": ["ground", "hub"]},
            "flap": {
                "type": "revolute",
                "markers": ["hub", "arm.root"],
                "axis": [0, 1, 0],
            },
        },
        drives={"turn": {"joint": "axle", "function": turn}},
    )
    modes = linearise(compiled(content), about="start")
    assert modes.frequencies[-1] == pytest.approx(spin / (2 * np.pi), abs=1e-6)


def clamped_rod(name: str, record: list[str], **more: Any) -> Any:
    sid = read_sid(SLIDER_CRANK / f"{name}.SID_FEM")
    sid = replace(sid, De=Taylor(np.zeros_like(sid.De.m0)))
    content = scene(
        "planar",
        record,
        bodies={"rod": {"sid": "rod", "markers": {"root": 1, "tip": 2}}},
        joints={"clamp": {"type": "fixed", "markers": ["ground", "rod.root"]}},
        **more,
    )
    return compiled(content, {"rod": sid}), sid


def test_the_clamped_rod_has_the_frequencies_of_its_labels() -> None:
    system, sid = clamped_rod("rod_q4", [])
    labels = [float(text.split(":")[1].split()[0]) for text in sid.labels]
    modes = linearise(system)
    assert modes.frequencies == pytest.approx(labels, abs=6e-4)
    exact = np.sqrt(np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)) / (2.0 * np.pi)
    assert modes.frequencies == pytest.approx(exact, rel=1e-6)


def test_a_tip_force_bends_the_clamped_rod_as_its_stiffness_says() -> None:
    force = np.array([150.0, -70.0])
    push = {"type": "force", "marker": "rod.tip", "force": force.tolist()}
    record = ["rod.tip.ux", "rod.tip.uy", "rod.q*", "clamp.fx", "clamp.fy", "clamp.mz"]
    system, sid = clamped_rod("rod_q4", record, forces={"push": push})
    found = static_equilibrium(system).result()
    phi = sid.node("2").phi.m0[:2]
    q = np.linalg.solve(sid.Ke.m0, phi.T @ force)
    values = [found[f"rod.q{k + 1}"][0] for k in range(sid.nq)]
    assert values == pytest.approx(q, rel=1e-8, abs=1e-14)
    assert [found["rod.tip.ux"][0], found["rod.tip.uy"][0]] == pytest.approx(phi @ q)
    tip = sid.node("2").position[:2] + phi @ q
    assert [found["clamp.fx"][0], found["clamp.fy"][0]] == pytest.approx(-force)
    moment = tip[0] * force[1] - tip[1] * force[0]
    assert found["clamp.mz"][0] == pytest.approx(-moment, rel=1e-9)


def test_a_spring_with_a_table_settles_where_the_table_says() -> None:
    curve = {"deflection": [0.0, 0.1, 0.3], "force": [0.0, 20.0, 30.0]}
    spring = {"type": "spring_damper", "markers": ["ground", "load"], "table": curve}
    load = {"mass": 20.0 / G, "initial": {"position": [0.0, -0.2]}}
    content = scene(
        "planar",
        ["load.y"],
        bodies={"load": load},
        forces={"spring": spring},
        gravity=[0.0, -G],
    )
    found = static_equilibrium(compiled(content)).result()
    assert found["load.y"][0] == pytest.approx(-0.1, abs=1e-10)


@pytest.mark.parametrize("height", [1.0, 100.0, 1000.0])
def test_rounded_friction_damps_with_its_slope_in_large_machines(height: float) -> None:
    """-F tanh(v / v0) at rest has the slope F / v0. Steps of differences grow with the
    machine, and both sides of the curve bend alike: m s^2 + F s / v0 + k = 0."""
    mass, stiffness, friction, slow = 3.0, 400.0, 5e-3, 1e-3
    law = {
        "type": "expression",
        "value": "-friction*tanh(load.vx/slow)",
        "parameters": {"friction": friction, "slow": slow},
    }
    content = scene(
        "planar",
        bodies={"load": {"mass": mass, "initial": {"position": [height, height]}}},
        joints={"guide": {"type": "point_on_line", "markers": ["ground.rail", "load"]}},
        forces={
            "spring": {
                "type": "spring_damper",
                "markers": ["ground.wall", "load"],
                "stiffness": stiffness,
                "rest": height / 2,
            },
            "rail": {
                "type": "force",
                "marker": "load",
                "force": [1.0, 0.0],
                "function": law,
            },
        },
        ground={
            "markers": {
                "rail": {"position": [0.0, height]},
                "wall": {"position": [height / 2, height]},
            }
        },
    )
    (found,) = linearise(compiled(content)).eigenvalues
    damping = friction / slow
    wanted = np.roots([mass, damping, stiffness])
    assert found == pytest.approx(wanted[wanted.imag > 0.0][0], rel=1e-6)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_load_rests_on_springs_alone(dimension: str) -> None:
    """Between two of 50 N/m and 1 m, pulled from aside: 2 k (l - 1) sin a = m g, and no
    joint tells how large forces are."""
    axes = 2 if dimension == "planar" else 3
    ends = {"left": [-1.0, 0.0, 0.0], "right": [1.0, 0.0, 0.0]}
    forces = {
        name: {
            "type": "spring_damper",
            "markers": [f"ground.{name}", "load"],
            "stiffness": 50.0,
            "rest": 1.0,
        }
        for name in ends
    }
    start = [0.1, -0.3, 0.2][:axes]
    content = scene(
        dimension,
        ["load.x", "load.y", "left.fx"],
        bodies={"load": {"mass": 2.0, "initial": {"position": start}}},
        forces=forces,
        gravity=[0.0, -G, 0.0][:axes],
        ground={"markers": {n: {"position": p[:axes]} for n, p in ends.items()}},
    )
    found = static_equilibrium(compiled(content)).result()
    depth = -float(found["load.y"][0])
    length = math.hypot(1.0, depth)
    assert found["load.x"][0] == pytest.approx(0.0, abs=1e-9)
    assert 100.0 * (length - 1.0) * depth / length == pytest.approx(2.0 * G, rel=1e-9)
    assert found["left.fx"][0] == pytest.approx(-50.0 * (length - 1.0) / length)


def test_links_on_ball_joints_do_not_turn_about_the_vertical() -> None:
    """From a start in a vertical plane they come to hang in it, though they rest at any
    angle about the vertical: rounding turned them by 1e-6 rad. Steps by differences
    turn them by up to 2e-7, found with ten kernels of OpenBLAS."""
    rng = np.random.default_rng(0)
    for first, second, mass in rng.uniform(
        [-2.5, -2.5, 0.1], [-0.5, -0.5, 9.0], (6, 3)
    ):
        bodies, joints, joint, last = {}, {}, np.zeros(2), "ground"
        for name, angle, m in (("a", first, 2.0), ("b", second, mass)):
            cos, sin = np.cos(angle), np.sin(angle)
            rotation = np.array([[cos, -sin], [sin, cos]])
            top, end = np.array([-0.5, 0.15]), np.array([0.5, 0.15])
            places = {"top": top, "end": end, "side": np.array([0.1, 0.2])}
            centre = joint - rotation @ top
            bodies[name] = {
                "mass": m,
                "inertia": [0.2, 0.2, 0.2],
                "markers": {
                    k: {"position": [*x, 0.3 * (k == "side")]}
                    for k, x in places.items()
                },
                "initial": {"position": [*centre, 0.0], "axis_angle": [0, 0, angle]},
            }
            markers = [last, f"{name}.top"]
            joints[f"ball_{name}"] = {"type": "spherical", "markers": markers}
            joint, last = centre + rotation @ end, f"{name}.end"
        record = ["a.side.z", "b.side.z"]
        gravity = [0.0, -G, 0.0]
        hanging = scene(
            "spatial", record, bodies=bodies, joints=joints, gravity=gravity
        )
        found = static_equilibrium(compiled(hanging)).result()
        assert [found[name][0] for name in record] == pytest.approx([0.3] * 2, abs=5e-7)


def test_a_falling_body_has_no_equilibrium() -> None:
    content = scene("planar", bodies={"stone": {"mass": 1.0}}, gravity=[0.0, -G])
    with pytest.raises(SimulationError, match="N701"):
        static_equilibrium(compiled(content))


def rigid_slider_crank(record: list[str]) -> SceneFile:
    content = read_scene(SLIDER_CRANK / "slider_crank.toml").model_dump(
        by_alias=True, exclude_none=True, mode="json"
    )
    content["bodies"]["rod"] = {
        "mass": 3.0,
        "inertia": 0.3,
        "centre_of_mass": [0.5, 0.0],
        "markers": {
            "crank_pin": {"position": [0.0, 0.0]},
            "piston_pin": {"position": [1.0, 0.0]},
        },
        "initial": {"position": [0.1, 0.0]},
    }
    content["time"] = {"end": 2.5, "output_step": 0.05}
    content["outputs"] = {"record": record}
    return validate_data(content, SceneFile)


def test_inverse_dynamics_finds_the_forces_of_the_transient() -> None:
    record = ["piston.x", "piston.ax", "crank_angle.f1", "bearing.fx", "crank_pin.fy"]
    record += ["crank_angle.mz", "slider.fy", "piston_pin.fx"]
    content = rigid_slider_crank(record)
    inverse = inverse_dynamics(compiled(content))
    transient = simulate(compiled(content), rtol=1e-11)
    for name in record:
        size = np.max(np.abs(transient[name]))
        error = np.max(np.abs(inverse[name] - transient[name]))
        assert error < 1e-7 * size, name
    assert inverse["crank_angle.mz"] == pytest.approx(inverse["crank_angle.f1"])


def test_inverse_dynamics_refuses_what_can_move_freely() -> None:
    with pytest.raises(InputError, match="1 of 3 coordinates can move freely"):
        inverse_dynamics(compiled(pendulum("planar")))


def flexible_slider_crank(factor: float, record: list[str]) -> Any:
    """The founding example without damping, its rod `factor` times as stiff."""
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    sid = replace(
        sid, Ke=Taylor(factor * sid.Ke.m0), De=Taylor(np.zeros_like(sid.De.m0))
    )
    content = read_scene(SLIDER_CRANK / "slider_crank.toml").model_dump(
        by_alias=True, exclude_none=True, mode="json"
    )
    content["time"] = {"end": 2.5, "output_step": 0.05}
    content["outputs"] = {"record": record}
    content["bodies"]["rod"]["quadratic_inertia"] = False
    return compiled(validate_data(content, SceneFile), {"rod": sid})


def test_a_stiff_rod_deforms_as_quasi_statics_say() -> None:
    """Without its vibrations a transient run has the quasi-static deformation."""
    record = ["rod.q1", "rod.q5", "piston.x", "crank_angle.f1", "slider.fy"]
    system = flexible_slider_crank(1e4, record)
    quasi_static = inverse_dynamics(system, quasi_static=True)
    transient = simulate(system, rtol=1e-9)
    for name in record:
        size = np.max(np.abs(transient[name]))
        error = np.max(np.abs(quasi_static[name] - transient[name]))
        assert error < 1e-5 * size, name
    assert "quasi-static" in quasi_static.settings["analysis"]


def test_a_rod_at_rest_hangs_through_as_in_static_equilibrium() -> None:
    system, sid = clamped_rod("rod_q4", ["rod.q*", "clamp.mz"], gravity=[0.0, -G])
    static = static_equilibrium(system).result()
    held = inverse_dynamics(system, quasi_static=True)
    for name in static.names:
        assert held[name] == pytest.approx(static[name][0], rel=1e-8, abs=1e-12), name


def test_inverse_dynamics_of_flexible_bodies_must_be_asked_for() -> None:
    system = flexible_slider_crank(1.0, ["rod.q1"])
    with pytest.raises(InputError, match="can move freely.*the option quasi-static"):
        inverse_dynamics(system)


def test_a_body_too_soft_for_quasi_statics_is_told() -> None:
    system = flexible_slider_crank(1e-5, ["rod.q1"])
    with pytest.raises(SimulationError, match="N721|N722") as failure:
        inverse_dynamics(system, quasi_static=True)
    assert failure.value.result is not None
    assert len(failure.value.result.t) > 0


def test_a_state_of_another_scene_is_refused() -> None:
    body = {"mass": 1.0, "inertia": 1.0}
    system = compile_scene(scene("planar", bodies={"a": body}))
    with pytest.raises(InputError, match="has 7 positions and 3 velocities"):
        linearise(system, state=(np.zeros(7), np.zeros(3)))
