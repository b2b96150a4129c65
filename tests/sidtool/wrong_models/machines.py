"""Mechanisms: spatial loops, arms, controllers, friction, imported bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from sidtool.formats.base.sid import Taylor
from sidtool.mesh.unit_systems import convert_units
from tests.solver.scenes import polynomial, scene, slender_rod

from .gallery import (
    FLEXIBLE,
    bar,
    clamped,
    hinge,
    mistake,
    pendulum,
    simulated,
    slider_crank,
)


def solid_rod(length: float, **initial: Any) -> dict[str, Any]:
    """A uniform rod in space, along its x axis."""
    rod = slender_rod(length, **initial)
    across = rod["inertia"]
    for marker in rod["markers"].values():
        marker["position"] = [*marker["position"], 0.0]
    return rod | {
        "inertia": [1e-3, across, across],
        "centre_of_mass": [length / 2, 0.0, 0.0],
    }


def turning(a: str, b: str, axis: list[float]) -> dict[str, Any]:
    return {"type": "revolute", "markers": [a, b], "axis": axis}


@mistake("over-constrained", "A, motor, B, C and D contradict each other")
def spatial_loop_has_a_tilted_axis() -> str:
    """A four-bar with a hinge that leans by 20 degrees: four axes must be parallel."""
    bodies = {
        "crank": solid_rod(0.3, position=[0.0, 0.0, 0.0], axis_angle=[0, 0, 1.57]),
        "coupler": solid_rod(1.0, position=[0.0, 0.3, 0.0]),
        "rocker": solid_rod(0.3, position=[1.0, 0.0, 0.0], axis_angle=[0, 0, 1.57]),
    }
    up = [0.0, 0.0, 1.0]
    joints = {
        "A": turning("ground", "crank.a", up),
        "B": turning("crank.b", "coupler.a", up),
        "C": turning("coupler.b", "rocker.b", [0.34, 0.0, 0.94]),
        "D": turning("ground.d", "rocker.a", up),
    }
    drives = {"motor": {"joint": "A", "function": polynomial(0.0, 1.0)}}
    ground = {"markers": {"d": {"position": [1.0, 0.0, 0.0]}}}
    return simulated(scene(bodies, joints, drives, ground=ground, dimension="spatial"))


@mistake("no velocities meet", "motor, mesh_1, mesh_2 and mesh_3 contradict each other")
def wheels_in_a_ring_block_each_other() -> str:
    """Three wheels of one size that mesh in a ring: none of them can turn."""
    names = ["one", "two", "three"]
    bodies = {
        n: slender_rod(0.1, position=[float(k), 0.0]) for k, n in enumerate(names)
    }
    joints: dict[str, Any] = {
        f"axle_{n}": hinge(f"ground.{n}", f"{n}.a") for n in names
    }
    for k in range(3):
        pair = [f"axle_{names[k]}", f"axle_{names[(k + 1) % 3]}"]
        joints[f"mesh_{k + 1}"] = {"type": "gear", "joints": pair, "ratio": -1.0}
    drives = {"motor": {"joint": "axle_one", "function": polynomial(0.0, 2.0)}}
    places = {n: {"position": [float(k), 0.0]} for k, n in enumerate(names)}
    return simulated(scene(bodies, joints, drives, ground={"markers": places}))


@mistake("shoulder and elbow contradict", r"upper.b and fore.b \(elbow\) .* 0.8 m")
def arm_is_joined_at_the_wrong_ends() -> str:
    """The markers of the forearm are swapped: it hangs on the hand's side."""
    bodies = {
        "upper": slender_rod(1.0),
        "fore": slender_rod(0.8, position=[1.0, 0.0], fixed=True),
    }
    joints = {
        "shoulder": hinge("ground", "upper.a"),
        "elbow": hinge("upper.b", "fore.b"),
    }
    return simulated(scene(bodies, joints))


@mistake("N223 .*rod by 9 rad/s")
def velocity_contradicts_the_drive() -> str:
    body = slender_rod(1.0, angular_velocity=-3.0)
    return pendulum(body, polynomial(0.0, 6.0))


@mistake(r"N103 bar: .*size of 1e\+03 m", r"geometry\.unit")
def sid_is_in_millimetres() -> str:
    """A bar that was exported in mm, t, s."""
    joints = {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}}
    gravity = [0.0, -9.81]
    sid = convert_units(bar(), "m-kg-s", "mm-t-s")
    return simulated(scene({"bar": FLEXIBLE}, joints, gravity=gravity), bar=sid)


@mistake("N206 brake: damping = -2", "sign")
def damper_of_a_joint_pushes() -> str:
    damper = {"type": "spring_damper", "joint": "pin", "damping": -2.0}
    return pendulum(forces={"brake": damper}, gravity=[0.0, -9.81])


@mistake("N216 motor: gain p = -9 .*pin.angle", "sign")
def controller_has_the_wrong_sign() -> str:
    """A PD law that drives away from its target."""
    law = {"type": "pid", "measured": "pin.angle", "reference": 0.5, "p": -9.0}
    motor = {"type": "actuator", "joint": "pin", "function": law}
    return pendulum(forces={"motor": motor}, end=0.02)


def held_at(reference: float, **force: Any) -> str:
    """A pendulum with a controller of its angle and a spring."""
    law = {"type": "pid", "measured": "pin.angle", "reference": reference, "p": 9.0}
    motor = {"type": "actuator", "joint": "pin", "function": law}
    spring = {"type": "spring_damper", "markers": ["ground.peg", "rod.b"]}
    spring |= {"stiffness": 1e-3} | force
    peg = {"markers": {"peg": {"position": [0.3, 0.4]}}}
    return pendulum(forces={"motor": motor, "spring": spring}, ground=peg, end=0.02)


@mistake("N202 reference of motor: 60 rad", "60 deg = 1.047 rad")
def target_is_in_degrees() -> str:
    return held_at(60.0)


@mistake("N214 spring: rest length of 400 m", "of 1 m")
def spring_is_in_millimetres() -> str:
    return held_at(0.6, rest=400.0)


@mistake(
    "bodies.ball",
    "no moment of inertia about x",
    "positive moments of inertia, or none",
)
def ball_cannot_turn() -> str:
    ball = {"mass": 0.4, "inertia": [0.0, 0.0, 0.0]}
    return simulated(scene({"ball": ball}, {}, dimension="spatial"))


@mistake(r"stopped at t = 0\.2 s", "bearing, crank_pin, piston_pin and push contradict")
def piston_drives_over_the_dead_point() -> str:
    """A stroke of 0.22 m, where the crank of 0.1 m allows 0.2 m."""

    def change(d: Any) -> None:
        turn = 0.5
        d["bodies"]["crank"]["initial"] = {"angle": turn}
        function = polynomial(1.0, 0.5)
        d["drives"] = {
            "push": {"marker": "piston", "coordinate": "x", "function": function}
        }

    return slider_crank(change)


@mistake("bodies.rod", "no moment of inertia about x")
def inertia_is_a_point_in_space() -> str:
    """A rod in space that turns about its own axis without inertia."""
    rod = solid_rod(1.0) | {"inertia": [0.0, 0.1, 0.1]}
    joints = {"pin": {"type": "spherical", "markers": ["ground", "rod.a"]}}
    return simulated(
        scene({"rod": rod}, joints, dimension="spatial", gravity=[0.0, 0.0, -9.81])
    )


@mistake("left, motor and right contradict each other")
def axle_leans_against_its_second_bearing() -> str:
    """Two bearings of one axle whose axes differ by a degree."""
    joints = {
        "left": turning("ground", "axle.a", [1.0, 0.0, 0.0]),
        "right": turning("ground.right", "axle.b", [1.0, 0.0175, 0.0]),
    }
    ground = {"markers": {"right": {"position": [1.0, 0.0, 0.0]}}}
    drives = {"motor": {"joint": "left", "function": polynomial(0.0, 5.0)}}
    return simulated(
        scene(
            {"axle": solid_rod(1.0)}, joints, drives, ground=ground, dimension="spatial"
        )
    )


def friction_joint_scene(
    change: Callable[[Any], None] = lambda d: None, **friction: float
) -> str:
    """The slider-crank without its drive, whose slider rubs."""

    def changed(d: Any) -> None:
        d["drives"], d["end"] = {}, 1e-3
        d["gravity"] = [0.0, -9.81]
        d["joints"]["slider"]["friction"] = {"coefficient": 0.2} | friction
        change(d)

    return slider_crank(changed)


@mistake(
    "stopped at t = 0 s",
    "N504 dead point of slider",
    "friction holds piston",
)
def friction_at_rest_in_the_dead_point() -> str:
    """Crank and rod lie in line: the slider can be moved neither way."""

    def change(d: Any) -> None:
        d["end"] = 0.3
        d["joints"]["bearing"]["friction"] = {"coefficient": 0.2, "radius": 0.02}
        d["joints"]["crank_pin"]["friction"] = {"coefficient": 0.2, "radius": 0.02}
        d["joints"]["piston_pin"]["friction"] = {"coefficient": 0.2, "radius": 0.02}

    return friction_joint_scene(change)


def _with_initial_positions(d: Any) -> None:
    d["bodies"]["crank"]["initial"] = {"angle": 1.0}
    d["bodies"]["rod"]["initial"] = {"position": [0.054, 0.084], "angle": -0.0842}
    d["bodies"]["piston"]["initial"] = {"position": [1.0505, 0.0]}


@mistake("N213 slider: .* 15 ", "0.1 for 10 %")
def friction_is_in_per_cent() -> str:
    return friction_joint_scene(_with_initial_positions, coefficient=15.0)


@mistake("N214 bearing: pin radius of 12 m", "1.05 m")
def pin_is_in_millimetres() -> str:
    def change(d: Any) -> None:
        _with_initial_positions(d)
        d["joints"]["slider"].pop("friction")
        rubs = {"coefficient": 0.1, "radius": 12.0}
        d["joints"]["bearing"]["friction"] = rubs

    return friction_joint_scene(change)


@mistake("N414 bar: .*500 % of its size")
def deformation_at_the_start_is_in_millimetres() -> str:
    """The tip of the bar starts 5 m off, for 5 mm."""
    shapes = bar().nodes[1].phi.m0[1]
    elastic = (5.0 * shapes / (shapes @ shapes)).tolist()
    return clamped(bar(), body={"initial": {"elastic": elastic}}, end=1e-3)


@mistake("N104 bar: .*-100 %", "sign")
def sid_feeds_its_vibration() -> str:
    """A SID whose damping has the wrong sign."""
    sid = replace(bar(), De=Taylor(-1e-3 * bar().Ke.m0))
    return clamped(sid, end=1e-3)
