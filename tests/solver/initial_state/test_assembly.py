"""Initial conditions: what may move moves, what is fixed stays, the rest is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid
from sidtool.solver import compile_scene, simulate
from sidtool.solver.initial_state.assembly import assemble
from tests.places import SLIDER_CRANK
from tests.solver.scenes import (
    Probe,
    compiled,
    polynomial,
    scene,
    slender_rod,
    soft_body,
)
from tests.solver.transformed import Units, in_units, sid_in

ORIGIN = {"position": [0.0, 0.0, 0.0]}


def hinge(a: str, b: str) -> dict[str, Any]:
    return {"type": "revolute", "markers": [a, b]}


def two_rods(first: dict[str, Any], second: dict[str, Any]) -> SceneFile:
    bodies = {"one": slender_rod(1.0, **first), "two": slender_rod(1.0, **second)}
    joints = {"base": hinge("ground", "one.a"), "elbow": hinge("one.b", "two.a")}
    return scene(bodies, joints)


def four_bar(end: float = 0.5, **third: Any) -> SceneFile:
    """A parallelogram of three rods on the ground; marker b of the last one is free."""
    bodies = {
        "left": slender_rod(1.0, angle=1.0),
        "top": slender_rod(1.0, position=[0.5, 0.8], velocity=[-1.0, 0.6]),
        "right": slender_rod(1.0, position=[1.0, 0.0], angle=1.0),
    }
    joints = {
        "foot_left": hinge("ground", "left.a"),
        "head_left": hinge("left.b", "top.a"),
        "foot_right": hinge("ground.right", "right.a"),
        "head_right": hinge("right.b", "top.b"),
    }
    ground = {"markers": {"right": {"position": [1.0, 0.0]}}}
    return scene(
        bodies,
        joints,
        end=end,
        gravity=[0.0, -9.81],
        ground=ground,
        record=["top.x", "top.y", "left.angle"],
        **third,
    )


def test_bodies_move_onto_their_joints_and_velocities_follow() -> None:
    described = two_rods(
        {"angle": 0.2, "angular_velocity": 1.0}, {"position": [0.8, 0.4], "angle": 1.0}
    )
    system, start = assemble(compiled(described))
    probe = Probe(system, 0.0, start.z, start.v)
    assert abs(probe.work.row[:, :2]).max() < 1e-12


@pytest.mark.parametrize(
    "stated",
    [
        {"angular_velocity": 2.0},
        {"velocity": [0.0, -2.0]},
        {"velocity": [0.0, -2.0], "angular_velocity": 2.0},
    ],
)
def test_velocities_that_a_scene_leaves_open_follow_those_that_it_states(
    stated: dict[str, Any],
) -> None:
    """A rod turns about its far end with 2 rad/s, whatever of its motion is stated and
    whatever it takes along."""
    bodies = {
        "crank": slender_rod(1.0, position=[-1.0, 0.0], **stated),
        "rod": slender_rod(1.0, position=[-1.0, 0.0], angle=np.pi),
    }
    joints = {"pin": hinge("ground", "crank.b"), "end": hinge("crank.a", "rod.a")}
    record = ["crank.vx", "crank.vy", "crank.wz", "rod.vy"]
    result = simulate(compile_scene(scene(bodies, joints, end=0.01, record=record)))
    found = [result[name][0] for name in record]
    assert found == pytest.approx([0.0, -2.0, 2.0, -2.0], abs=1e-10)
    assert not result.diagnostics


def test_a_fixed_body_stays_where_it_is() -> None:
    described = two_rods(
        {"angle": 0.2, "fixed": True}, {"position": [0.8, 0.4], "angle": 1.0}
    )
    system, start = assemble(compiled(described))
    probe = Probe(system, 0.0, start.z, start.v)
    assert start.z[:3] == pytest.approx([0.0, 0.0, 0.2], abs=0)
    assert start.z[3:5] == pytest.approx([np.cos(0.2), np.sin(0.2)], abs=1e-12)
    assert abs(probe.work.row[:, 0]).max() < 1e-12


def test_a_consistent_start_is_not_changed() -> None:
    described = two_rods({"angle": 0.5}, {"position": [np.cos(0.5), np.sin(0.5)]})
    system = compiled(described)
    _, start = assemble(system)
    expected = [0.0, 0.0, 0.5, np.cos(0.5), np.sin(0.5), 0.0]
    assert start.z == pytest.approx(expected, abs=1e-14)
    assert not start.v.any()


def turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def clamped() -> dict[str, Any]:
    """The founding rod between a hinge and a wall that are too far apart, turning."""
    ends = {"markers": {"a": "1", "b": "2"}}
    start = {"position": [2e-4, -3e-4], "angle": 1e-3, "angular_velocity": 2.0}
    joints = {
        "hinge": hinge("ground", "rod.a"),
        "wall": {"type": "fixed", "markers": ["ground.wall", "rod.b"]},
    }
    ground = {"markers": {"wall": {"position": [1.0001, 0.001]}}}
    bodies = {"rod": {"sid": "rod", **ends, "initial": start}}
    described = scene(bodies, joints, ground=ground, end=0.01)
    return described.model_dump(mode="json", by_alias=True, exclude_none=True)


@pytest.mark.parametrize("planar", [True, False])
def test_a_deformed_start_that_fits_its_joint_stays(planar: bool) -> None:
    """Markers rotate by psi q + psi1 q q / 2."""
    sid, q = soft_body(2, 5, planar, stiffening=True), np.array([0.3, -0.4])
    node = sid.nodes[0]
    phi, psi = (b.m0 + 0.5 * np.tensordot(q, b.m1, 1) for b in (node.phi, node.psi))
    turned = Rotation.from_rotvec(-(psi @ q))
    place = -turned.apply(node.position + phi @ q)
    initial: dict[str, Any] = {"elastic": q.tolist()}
    if planar:
        initial |= {"position": place[:2].tolist(), "angle": -float(psi[2] @ q)}
    else:
        initial |= {"position": place.tolist(), "matrix": turned.as_matrix().tolist()}
    body = {"sid": "-", "markers": {"root": "1"}, "initial": initial}
    clamp = {"type": "fixed", "markers": ["ground", "body.root"]}
    record = ["body.x", "body.y", "body.q1", "body.q2"]
    content = scene(
        {"body": body},
        {"clamp": clamp},
        dimension="planar" if planar else "spatial",
        end=1e-6,
        record=record,
    )
    found = simulate(compiled(content, body=sid)).values[0]
    assert found == pytest.approx([*place[:2], *q], abs=1e-9)


def test_a_body_that_has_to_deform_does_so_with_the_least_energy() -> None:
    """K q = C_q^T lambda, and no resultant of lambda on the rigid motion, but for what
    is quadratic in a misfit of 1e-3."""
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    system, start = assemble(compiled(SceneFile.model_validate(clamped()), rod=sid))
    probe = Probe(system, 0.0, start.z, start.v)
    C, load = probe.jacobian, np.zeros(8)
    load[3:] = sid.Ke.m0 @ start.z[3:]
    held = np.linalg.lstsq(C.T, load, rcond=None)[0]
    assert abs(probe.work.row[:, :2]).max() < 1e-11
    assert C.T @ held == pytest.approx(load, abs=1e-3 * abs(load).max())


@pytest.mark.parametrize(("lean", "gap"), [(0.02, 1e-3), (0.05, 3e-3), (-0.01, 2e-4)])
def test_a_rod_that_no_turn_brings_to_its_line_is_stretched(
    lean: float, gap: float
) -> None:
    """The line leans: turning closes the gap to first order, and never for a rigid rod,
    as the line is farther off than its length."""
    normal = np.array([np.cos(lean), np.sin(lean)])
    line = {"position": [1.0 + gap, 0.0], "angle": lean + np.pi / 2.0}
    joints = {
        "hinge": {"type": "coincident", "markers": ["ground", "rod.a"]},
        "line": {
            "type": "point_on_line",
            "markers": ["ground.line", "rod.b"],
            "axis": [1.0, 0.0],
        },
    }
    bodies = {"rod": {"sid": "rod", "markers": {"a": "1", "b": "2"}}}
    described = scene(
        bodies,
        joints,
        ground={"markers": {"line": line}},
        record=["rod.b.x", "rod.b.y"],
    )
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    system, start = assemble(compiled(described, rod=sid))
    end = sid.node("2")
    tip = (end.position + end.phi.m0 @ start.z[3:])[:2]
    x, y = start.z[:2] + turn(start.z[2]) @ tip
    distance = (1.0 + gap) * normal[0]
    assert normal @ [x, y] == pytest.approx(distance, abs=1e-10)
    assert np.linalg.norm(tip) >= distance > 1.0


@pytest.mark.parametrize(
    "units",
    [Units(1e3, 1e-3), Units(1e3, 1e3, 1e3), Units(1.0, 1.0, 1e6)],
    ids=["mm t s", "mm g ms", "m kg us"],
)
def test_a_start_is_assembled_alike_in_all_units(units: Units) -> None:
    sid, table = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM"), clamped()
    _, expected = assemble(compiled(SceneFile.model_validate(table), rod=sid))
    other = SceneFile.model_validate(in_units(table, units))
    _, found = assemble(compiled(other, rod=sid_in(sid, units)))
    q, vq = found.z[3:], found.v[3:] * units.time
    assert q == pytest.approx(expected.z[3:], abs=1e-9 * abs(expected.z[3:]).max())
    assert vq == pytest.approx(expected.v[3:], abs=1e-12)


def test_a_position_out_of_reach_is_refused_with_the_joint_that_is_open() -> None:
    bodies = {"one": slender_rod(1.0), "two": slender_rod(1.0, position=[2.0, 0.0])}
    joints = {
        "base": hinge("ground", "one.a"),
        "elbow": hinge("one.b", "two.a"),
        "far": hinge("two.b", "ground.far"),
    }
    ground = {"markers": {"far": {"position": [3.0, 0.0]}}}
    with pytest.raises(InputError, match="cannot be assembled") as caught:
        assemble(compiled(scene(bodies, joints, ground=ground)))
    text = str(caught.value)
    assert any(name in text for name in joints)


def test_fixed_bodies_that_do_not_fit_are_refused() -> None:
    described = two_rods({"fixed": True}, {"position": [1.5, 0.0], "fixed": True})
    with pytest.raises(InputError, match=r"\(elbow\) come no nearer than 0.5 m"):
        assemble(compiled(described))


def test_contradicting_drives_are_refused() -> None:
    bodies = {"one": slender_rod(1.0)}
    joints = {"base": hinge("ground", "one.a"), "twin": hinge("ground", "one.a")}
    drives = {
        "slow": {"joint": "base", "function": polynomial(0.0, 1.0)},
        "fast": {"joint": "twin", "function": polynomial(0.0, 2.0)},
    }
    with pytest.raises(InputError):
        assemble(compiled(scene(bodies, joints, drives)))


@pytest.mark.parametrize("driven", ["angle_1", "angle_2"])
def test_one_driven_angle_of_a_universal_joint_turns_the_body_there(
    driven: str,
) -> None:
    """From far away, 2.5 rad, with the other angle as it was; a small step after the
    other closes the joint half a turn off."""
    arm = {"mass": 1.0, "inertia": [0.1, 0.2, 0.3], "markers": {"hub": ORIGIN}}
    angles = ["hook.angle_1", "hook.angle_2"]
    held = {"joint": "hook", "coordinate": driven, "function": polynomial(2.5)}
    result = simulate(
        compiled(
            scene(
                {"arm": arm},
                {"hook": {"type": "universal", "markers": ["ground", "arm.hub"]}},
                {"held": held},
                dimension="spatial",
                record=angles,
                end=0.01,
            )
        )
    )
    wanted = [2.5 * (name.endswith(driven)) for name in angles]
    assert result.values[0] == pytest.approx(wanted, abs=1e-12)


def test_driven_bodies_that_meet_at_the_start_alone_are_refused() -> None:
    """Turned by t^3 and t^3 / 2, their ends part by 2 sin(t^3 / 4), which nothing can
    close: all of the motion is prescribed, and consistent at the start."""
    bodies = {"one": slender_rod(1.0), "two": slender_rod(1.0)}
    joints = {f"under_{name}": hinge("ground", f"{name}.a") for name in bodies}
    joints["tip"] = {"type": "coincident", "markers": ["one.b", "two.b"]}
    drives = {
        "fast": {"joint": "under_one", "function": polynomial(0.0, 0.0, 0.0, 1.0)},
        "slow": {"joint": "under_two", "function": polynomial(0.0, 0.0, 0.0, 0.5)},
    }
    gap = 2.0 * np.sin(0.05**3 / 4.0)
    told = rf"at t = 0\.05 s tip is open by {gap:.3g}, and no coordinate can give way"
    with pytest.raises(InputError, match=told):
        assemble(compiled(scene(bodies, joints, drives=drives)))


def test_a_second_joint_on_the_same_axis_is_found_named_and_changes_nothing() -> None:
    """Two revolute joints at one pin: two rows depend on the others."""
    single = compiled(four_bar())
    described = four_bar()
    described.joints["twin"] = described.joints["head_left"].model_copy()
    double, _ = assemble(compiled(described))
    assert len(double.redundant) == 2
    owners = {
        row.name
        for row in double.rows
        for i in double.redundant
        if row.first <= i < row.first + row.count
    }
    assert owners <= {"twin", "head_left"}
    expected, found = simulate(single, rtol=1e-9), simulate(double, rtol=1e-9)
    assert found.values == pytest.approx(expected.values, abs=1e-8)


def test_a_third_parallel_rod_is_redundant_and_changes_the_motion_by_its_mass() -> None:
    """A parallelogram with three legs: one row depends on the others at every angle."""
    described = four_bar().model_dump(by_alias=True, exclude_none=True)
    described["bodies"]["top"]["markers"]["middle"] = {"position": [0.5, 0.0]}
    described["bodies"]["leg"] = slender_rod(1.0, 1e-9, position=[0.5, 0.0], angle=1.0)
    described["ground"]["markers"]["middle"] = {"position": [0.5, 0.0]}
    described["joints"]["foot"] = hinge("ground.middle", "leg.a")
    described["joints"]["head"] = hinge("leg.b", "top.middle")
    system, _ = assemble(compiled(SceneFile.model_validate(described)))
    assert len(system.redundant) == 1
    found = simulate(system, rtol=1e-9)
    expected = simulate(compiled(four_bar()), rtol=1e-9)
    assert found.values == pytest.approx(expected.values, abs=1e-7)
    assert found.drift["position"] < 1e-10


@pytest.mark.parametrize("integrator", ["radau5", "trapezoidal"])
def test_a_prescribed_frame_moves_as_with_its_constraints(integrator: str) -> None:
    """Its motion and the torque of its drive; the torque asks for no coordinates."""
    bodies = {
        "crank": slender_rod(0.3),
        "rod": slender_rod(1.0, position=[0.3, 0.0]),
        "piston": {"mass": 2.0, "initial": {"position": [1.3, 0.0]}},
    }
    joints = {
        "bearing": hinge("ground", "crank.a"),
        "pin": hinge("crank.b", "rod.a"),
        "wrist": hinge("rod.b", "piston"),
        "guide": {"type": "point_on_line", "markers": ["ground", "piston"]},
    }
    drive = {"turn": {"joint": "bearing", "function": polynomial(0.0, 1.0, 2.0, 1.0)}}
    record = ["crank.b.x", "crank.b.ay", "rod.angle", "piston.x", "piston.ax"]
    record += ["turn.f1", "bearing.fx"]
    runs = []
    for keep in (False, True):
        described = scene(bodies, joints, drive, record=record)
        system = compile_scene(described, keep_joints=keep)
        rtol = 1e-9 if integrator == "radau5" else 1e-7
        runs.append((system, simulate(system, integrator=integrator, rtol=rtol)))
    (without, moved), (kept, constrained) = runs
    assert without.n_velocities == kept.n_velocities - 3
    assert "bearing" in without.eliminated
    assert not kept.eliminated
    assert moved.values[:, :5] == pytest.approx(constrained.values[:, :5], abs=2e-6)
    assert moved.values[:, 5:] == pytest.approx(constrained.values[:, 5:], rel=1e-6)


def test_the_torque_of_a_drive_gives_the_power_that_moves_the_mechanism() -> None:
    """A rod turned about its end: torque = J alpha + m g l/2 cos(angle)."""
    rod = {"rod": slender_rod(1.0, mass=3.0)}
    joints = {"bearing": hinge("ground", "rod.a")}
    drives = {"turn": {"joint": "bearing", "function": polynomial(0.0, 0.0, 0.5)}}
    described = scene(
        rod, joints, drives, record=["turn.f1", "rod.angle"], gravity=[0.0, -10.0]
    )
    result = simulate(compiled(described), rtol=1e-9)
    torque = 1.0 + 15.0 * np.cos(0.5 * result.t**2)
    assert result["rod.angle"] == pytest.approx(0.5 * result.t**2, abs=1e-12)
    assert result["turn.f1"] == pytest.approx(torque, rel=1e-9)
