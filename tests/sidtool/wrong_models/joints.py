"""Joints and drives that cannot be met."""

from __future__ import annotations

from typing import Any

from tests.solver.scenes import polynomial, scene, slender_rod

from .gallery import (
    FLEXIBLE,
    bar,
    hinge,
    mistake,
    pendulum,
    simulated,
    slider_crank,
)


@mistake("bearing, motor, crank_pin, piston_pin and slider contradict each other")
def slider_is_fixed() -> str:
    def change(d: Any) -> None:
        d["ground"]["markers"]["stop"] = {"position": [1.1, 0.0]}
        d["joints"]["slider"] = {
            "type": "coincident",
            "markers": ["ground.stop", "piston"],
        }

    return slider_crank(change)


@mistake(
    "cannot be assembled",
    "bearing, crank_pin, piston_pin and slider contradict each other",
    r"rod.b and piston \(piston_pin\) come no nearer than 1 m",
    "lengths, drives and joints that fit",
)
def slider_line_is_too_far_away() -> str:
    def change(d: Any) -> None:
        d["ground"]["markers"]["line"] = {"position": [0.0, 2.0]}
        d["joints"]["slider"]["markers"][0] = "ground.line"

    return slider_crank(change)


@mistake("N414 rod", "N330 rod", "motor", "piston_pin", "contradict each other")
def drive_sits_on_the_wrong_joint() -> str:
    def change(d: Any) -> None:
        d["drives"]["motor"]["joint"] = "piston_pin"

    return slider_crank(change, bar())


@mistake("motor", "second", "contradict each other")
def two_drives_move_one_mechanism() -> str:
    def change(d: Any) -> None:
        second = {"joint": "crank_pin", "function": polynomial(0.0, -3.0)}
        d["drives"]["second"] = second

    return slider_crank(change)


@mistake("N330 rod", "motor", "second", "contradict each other")
def two_drives_bend_the_rod() -> str:
    def change(d: Any) -> None:
        second = {"joint": "crank_pin", "function": polynomial(0.0, -3.0)}
        d["drives"]["second"] = second

    return slider_crank(change, bar())


@mistake("no velocities meet", "push contradict")
def piston_is_pushed_at_the_dead_centre() -> str:
    def change(d: Any) -> None:
        function = polynomial(1.1, 1.0)
        d["drives"] = {
            "push": {"marker": "piston", "coordinate": "x", "function": function}
        }

    return slider_crank(change)


@mistake("not found", r"rod.initial.position = \[0.1, 0\] and angle = 1.671")
def slider_stands_across_the_start() -> str:
    def change(d: Any) -> None:
        d["joints"]["slider"] = {
            "type": "prismatic",
            "markers": ["ground", "piston"],
            "axis": [0.0, 1.0],
        }

    return slider_crank(change)


@mistake(
    "N313",
    "bearing, motor, crank_pin, piston_pin and slider contradict each other",
)
def crank_is_welded_to_the_rod() -> str:
    def change(d: Any) -> None:
        d["joints"]["crank_pin"]["type"] = "fixed"

    return slider_crank(change, bar())


@mistake(
    "m, .*contradict each other",
    "stopped at t = 0.19",
    "A",
    "D",
)
def crank_cannot_turn_round() -> str:
    """Grashof: 0.5 + 1.2 > 0.9 + 0.5."""
    bodies = {
        "crank": slender_rod(0.5),
        "coupler": slender_rod(0.9, position=[0.5, 0.0]),
        "rocker": slender_rod(0.5, position=[1.2, 0.0], angle=1.0),
    }
    joints = {
        "A": hinge("ground", "crank.a"),
        "B": hinge("crank.b", "coupler.a"),
        "C": hinge("coupler.b", "rocker.b"),
        "D": hinge("ground.d", "rocker.a"),
    }
    drives = {"m": {"joint": "A", "function": polynomial(0.6, 6.28)}}
    ground = {"markers": {"d": {"position": [1.2, 0.0]}}}
    return simulated(scene(bodies, joints, drives, ground=ground))


@mistake("pin and rope contradict", "ground and rod.a", "no nearer than 2 m")
def rope_is_longer_than_any_way() -> str:
    rope = {"type": "distance", "markers": ["ground.hook", "rod.b"], "length": 5.0}
    joints = {"pin": hinge("ground", "rod.a"), "rope": rope}
    ground = {"markers": {"hook": {"position": [0.0, 2.0]}}}
    return simulated(scene({"rod": slender_rod(1.0)}, joints, ground=ground))


@mistake("left and right contradict", r"ground.far and bar.b .* 0.05 m")
def walls_are_too_far_apart() -> str:
    joints = {
        "left": {"type": "fixed", "markers": ["ground", "bar.a"]},
        "right": {"type": "fixed", "markers": ["ground.far", "bar.b"]},
    }
    ground = {"markers": {"far": {"position": [1.05, 0.0]}}}
    return simulated(scene({"bar": FLEXIBLE}, joints, ground=ground), bar=bar())


@mistake(
    "no velocities meet",
    "slow, fast and gears contradict each other",
    "drives and joints that can move",
)
def gears_turn_against_their_drives() -> str:
    bodies = {"a": slender_rod(0.1), "b": slender_rod(0.1, position=[1.0, 0.0])}
    joints = {
        "one": hinge("ground", "a.a"),
        "two": hinge("ground.b", "b.a"),
        "gears": {"type": "gear", "joints": ["one", "two"], "ratio": -2.0},
    }
    drives = {
        "slow": {"joint": "one", "function": polynomial(0.0, 1.0)},
        "fast": {"joint": "two", "function": polynomial(0.0, 2.0)},
    }
    ground = {"markers": {"b": {"position": [1.0, 0.0]}}}
    return simulated(scene(bodies, joints, drives, ground=ground))


@mistake("N324", "joints and drives leave no motion")
def gear_locks_one_axle() -> str:
    joints = {
        "one": hinge("ground", "rod.a"),
        "two": hinge("ground", "rod.a"),
        "gears": {"type": "gear", "joints": ["one", "two"], "ratio": 2.0},
    }
    described = scene({"rod": slender_rod(0.1)}, joints, gravity=[0.0, -9.81])
    return simulated(described)


@mistake("N324", "no force acts along the 1 free coordinate")
def pendulum_hangs_on_its_long_axis() -> str:
    rod = {
        "mass": 1.0,
        "inertia": [0.01, 0.1, 0.1],
        "centre_of_mass": [0.5, 0.0, 0.0],
        "markers": {"a": {"position": [0.0, 0.0, 0.0]}},
    }
    joints = {"pin": hinge("ground", "rod.a") | {"axis": [1.0, 0.0, 0.0]}}
    more = {"dimension": "spatial", "gravity": [0.0, 0.0, -9.81]}
    return simulated(scene({"rod": rod}, joints, **more))


@mistake("elbow", "one.b and two.a", "no nearer than 0.5 m")
def fixed_bodies_lie_apart() -> str:
    bodies = {
        "one": slender_rod(1.0, fixed=True),
        "two": slender_rod(1.0, position=[1.5, 0.0], fixed=True),
    }
    return simulated(scene(bodies, {"elbow": hinge("one.b", "two.a")}))


@mistake("motor", "mass is a point mass, which does not rotate")
def point_mass_is_turned() -> str:
    joints = {"pin": hinge("ground", "mass")}
    drives = {"motor": {"joint": "pin", "function": polynomial(0.0, 3.0)}}
    return simulated(scene({"mass": {"mass": 1.0}}, joints, drives))


@mistake("N221 .*piston by 2 m, rod by 1 m")
def rod_is_put_in_the_wrong_way_round() -> str:
    def change(d: Any) -> None:
        d["bodies"]["rod"]["markers"] = {"a": 2, "b": 1}

    return slider_crank(change, bar())


@mistake("drives.motor.function: jumps by 1 at t = 0.5 s", "value and rate")
def drive_jumps() -> str:
    pieces = [
        {"from": 0.0, "to": 0.5, "coefficients": [0.0]},
        {"from": 0.5, "coefficients": [1.0]},
    ]
    return pendulum(drive={"type": "polynomial", "pieces": pieces})


@mistake(
    "drives.motor.function: what is prescribed needs the second derivative of pin",
    "follows from all forces",
    "a gear, a coupling",
)
def drive_follows_its_own_joint() -> str:
    return pendulum(drive={"type": "expression", "value": "0.5*pin.angle + 0.1*t"})


@mistake("a sampled law gives the value, which would jump", 'of = "acceleration"')
def drive_holds_places_between_samples() -> str:
    sampled = {"type": "expression", "value": "sin(t)", "sample_time": 0.01}
    return pendulum(drive=sampled)
