"""Small models with one physical mistake each, and what has to be said of it.

`MISTAKES` holds, by what went wrong, a function that makes the attempt and the words
(patterns, in any order) that name what is wrong, where, and what would do.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import sidtool
from sidtool.convert import NOTE, sid_from_model
from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.sid import SID
from sidtool.formats.toml.reading import validated
from tests.solver.scenes import polynomial, scene, slender_rod
from tests.steel_bars import bar_data, steel_bar

Attempt = Callable[[], str]
MISTAKES: dict[str, tuple[Attempt, tuple[str, ...]]] = {}


def mistake(*words: str) -> Callable[[Attempt], Attempt]:
    """Enters an attempt under its name."""

    def entered(attempt: Attempt) -> Attempt:
        MISTAKES[attempt.__name__] = attempt, words
        return attempt

    return entered


# What was said -------------------------------------------------------------------


def simulated(described: Any, **sids: SID) -> str:
    """Why a run was refused or stopped, and its notes and verdicts."""
    try:
        result = sidtool.simulate(described, sids=sids)
    except InputError as error:
        return str(error)
    except sidtool.SimulationError as error:
        notes = error.result.notes if error.result is not None else ()
        return "\n".join([str(error), *notes])
    verdicts = [body.after for body in result.bodies.values()]
    return "\n".join([*result.notes, *verdicts])


def converted(data: Any) -> str:
    told: list[str] = []
    try:
        sid_from_model(validated(data, ModelFile), told.append)
    except InputError as error:
        return str(error)
    return "\n".join(text for text in told if text.startswith(NOTE))


# Parts ---------------------------------------------------------------------------


def plate_data(**changes: Any) -> Any:
    """A clamped strip of 1 m x 0.1 m, 10 mm thick."""
    data = bar_data()
    data["geometry"] = {
        "type": "nurbs",
        "degrees": [1, 1],
        "knots": [[0, 0, 1, 1], [0, 0, 1, 1]],
        "control_points": [[[0, 0], [0, 0.1]], [[1, 0], [1, 0.1]]],
        "thickness": 0.01,
    }
    data["discretisation"] = {"type": "q4", "elements": [20, 2]}
    data["frame"] = {"type": "tangent", "marker": "root", "clamp": "left"}
    data["markers"] = {
        "root": {"node": 1, "edge": "left", "at": 0.5},
        "tip": {"node": 2, "edge": "right", "at": 0.5},
    }
    return data | changes


@functools.cache
def bar() -> SID:
    return steel_bar()


def material(**changes: float) -> Any:
    return {"material": bar_data()["material"] | changes}


FLEXIBLE = {"sid": "bar", "markers": {"a": 1, "b": 2}}


def hinge(a: str, b: str) -> dict[str, Any]:
    return {"type": "revolute", "markers": [a, b]}


def clamped(sid: SID, **more: Any) -> str:
    """The flexible bar, clamped to the ground."""
    joints = {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}}
    body = FLEXIBLE | more.pop("body", {})
    return simulated(scene({"bar": body}, joints, **more), bar=sid)


def pendulum(body: Any = None, drive: Any = None, **more: Any) -> str:
    """A rigid rod on a hinge."""
    drives = {"motor": {"joint": "pin", "function": drive}} if drive else {}
    joints = {"pin": hinge("ground", "rod.a")}
    return simulated(scene({"rod": body or slender_rod(1.0)}, joints, drives, **more))


def slider_crank(change: Callable[[Any], None], sid: SID | None = None) -> str:
    """A crank of 0.1 m, a rod of 1 m (rigid, or with a SID) and a piston, after a
    change."""
    rod = slender_rod(1.0, position=[0.1, 0.0])
    if sid is not None:
        rod = FLEXIBLE | {"initial": {"position": [0.1, 0.0]}}
    described = {
        "bodies": {
            "crank": slender_rod(0.1, 0.3),
            "rod": rod,
            "piston": {"mass": 5.0, "initial": {"position": [1.1, 0.0]}},
        },
        "joints": {
            "bearing": hinge("ground", "crank.a"),
            "crank_pin": hinge("crank.b", "rod.a"),
            "piston_pin": hinge("rod.b", "piston"),
            "slider": {"type": "point_on_line", "markers": ["ground", "piston"]},
        },
        "drives": {"motor": {"joint": "bearing", "function": polynomial(0.0, 6.0)}},
        "ground": {"markers": {}},
        "end": 0.3,
    }
    change(described)
    sids = {"rod": sid} if sid is not None else {}
    return simulated(scene(**described), **sids)


# Joints and drives that cannot be met ----------------------------------------------


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


@mistake("motor", "piston_pin", "contradict each other", "only deforming rod can help")
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


@mistake(
    "joints and drives deform rod", "motor", "second", "contradict each other", "rtol"
)
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


@mistake("crank_pin", "contradict each other", "bearing, motor", "only deforming rod")
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


@mistake("nothing moves", "joints and drives leave no motion")
def gear_locks_one_axle() -> str:
    joints = {
        "one": hinge("ground", "rod.a"),
        "two": hinge("ground", "rod.a"),
        "gears": {"type": "gear", "joints": ["one", "two"], "ratio": 2.0},
    }
    described = scene({"rod": slender_rod(0.1)}, joints, gravity=[0.0, -9.81])
    return simulated(described)


@mistake("nothing moves", "no force acts along the 1 coordinates")
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


@mistake("moved bodies", "piston by 2 m, rod by 1 m")
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


# Loads ------------------------------------------------------------------------------


@mistake("forces.twist.torque", "mass, a point mass", "bodies.mass.inertia")
def point_mass_takes_a_torque() -> str:
    twist = {"type": "force", "marker": "mass", "torque": 3.0}
    return simulated(scene({"mass": {"mass": 1.0}}, forces={"twist": twist}))


@mistake("spring has a negative stiffness, -1000", "sign")
def spring_pushes_away() -> str:
    spring = {"type": "spring_damper", "joint": "pin", "stiffness": -1e3}
    return pendulum(forces={"spring": spring})


@mistake("spring has a negative damping, -5", "sign")
def damper_drives() -> str:
    spring = {
        "type": "spring_damper",
        "joint": "pin",
        "stiffness": 1e3,
        "damping": -5.0,
    }
    return pendulum(forces={"spring": spring})


@mistake("spring acts between two markers of rod, which is rigid", "another body")
def spring_holds_on_to_itself() -> str:
    markers = ["rod.a", "rod.b"]
    spring = {"type": "spring_damper", "markers": markers, "stiffness": 1e3}
    return pendulum(forces={"spring": spring})


@mistake("no static equilibrium", "largest at rod", "a scene that can rest")
def static_start_of_what_falls() -> str:
    more = {"gravity": [0.0, -9.81], "initial": {"state": "static"}}
    return simulated(scene({"rod": slender_rod(1.0)}, **more))


@mistake("buckles", "force of 1e\\+03 N", "more than the body can bear")
def column_is_loaded_beyond_euler() -> str:
    sid = steel_bar(width=0.01, height=0.005, stiffening={})
    push = {"type": "force", "marker": "bar.b", "force": [-1000.0, 0.1]}
    return clamped(sid, forces={"push": push}, end=0.02)


@mistake("diverges", "rotation of 200 rad/s", r"convert .* table \[stiffening\]")
def blade_spins_without_stiffening() -> str:
    joints = {"hub": hinge("ground", "bar.a")}
    drives = {"motor": {"joint": "hub", "function": polynomial(0.0, 200.0)}}
    described = scene({"bar": FLEXIBLE}, joints, drives, end=0.02)
    return simulated(described, bar=bar())


# Units --------------------------------------------------------------------------------


@mistake("crank is 100 m long and rod, .*, 1 m", "in mm")
def crank_is_in_millimetres() -> str:
    def change(d: Any) -> None:
        d["bodies"]["crank"] = slender_rod(100.0, 0.3)
        d["end"] = 1e-4

    return slider_crank(change)


@mistake("gravity is 9810 m/s2", "mm/s2")
def gravity_is_in_millimetres() -> str:
    return pendulum(gravity=[0.0, -9810.0], end=0.01)


@mistake("bodies.rod.initial.angle is 90 rad", "90 degrees are 1.571 rad")
def angle_is_in_degrees() -> str:
    return pendulum(slender_rod(1.0, angle=90.0))


@mistake("drive motor is 360 rad", "360 degrees are 6.283 rad")
def drive_is_in_degrees() -> str:
    return pendulum(drive={"type": "smooth_step", "from": 0.0, "to": 1.0, "end": 360.0})


@mistake("drive motor is 90 rad, 14.3 turns: is it in degrees")
def servo_starts_in_degrees() -> str:
    """Its speed of 360 rad/s is no angle."""
    joints = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    spin = {"type": "constant", "value": 360.0}
    motor = {"joint": "pin", "of": "rate", "start": 90.0, "function": spin}
    described = scene({"rod": slender_rod(1.0)}, joints, {"motor": motor}, end=0.01)
    told = simulated(described)
    assert "360 rad" not in told
    return told


@mistake("motor turns at 3e\\+03 rad/s", "are 314 rad/s")
def drive_is_in_revolutions_per_minute() -> str:
    return pendulum(drive=polynomial(0.0, 3000.0), end=0.01)


@mistake("inertia of rod", "28.9 m away", "kg mm2")
def inertia_is_in_kg_mm2() -> str:
    return pendulum(slender_rod(0.1, 0.3) | {"inertia": 250.0})


@mistake("1, 1, 3 kg m2, are those of no body", "sum of the others")
def inertia_is_of_no_body() -> str:
    rod = {"mass": 1.0, "inertia": [1.0, 1.0, 3.0]}
    return simulated(scene({"rod": rod}, dimension="spatial"))


@mistake("Young's modulus is 210 Pa", "GPa", "0.000528 Hz", "times its size")
def stiffness_is_in_gigapascal() -> str:
    return converted(bar_data(**material(youngs_modulus=210.0)))


@mistake("density is 7.85e-09 kg/m3", "t/mm3", "faster than sound in any solid")
def density_is_in_tonnes_per_cubic_millimetre() -> str:
    return converted(bar_data(**material(density=7.85e-9)))


@mistake("bar: with a first frequency of 0.000528 Hz", "under gravity", "other units")
def scene_has_a_bar_of_210_pascal() -> str:
    return clamped(
        steel_bar(**material(youngs_modulus=210.0)), gravity=[0.0, -9.81], end=0.1
    )


@mistake("bar: the first frequency of 1.67e\\+07 Hz", "faster than sound")
def scene_has_a_bar_without_weight() -> str:
    return clamped(
        steel_bar(**material(density=7.85e-9)), gravity=[0.0, -9.81], end=1e-6
    )


@mistake("1e\\+03 m long", "in mm")
def body_is_drawn_in_millimetres() -> str:
    data = bar_data(width=20.0, height=20.0)
    data["geometry"]["end"] = [1000, 0, 0]
    return converted(data)


@mistake("bar: .*2 times the critical damping", "2 % .* 0.02")
def damping_is_in_per_cent() -> str:
    return clamped(bar(), body={"damping": {"type": "modal", "ratio": 2.0}}, end=0.1)


@mistake("run of 0.0001 s lasts 0.002 of the first period of bar", "seconds")
def time_is_in_kiloseconds() -> str:
    return clamped(bar(), gravity=[0.0, -9.81], end=1e-4)


# Bodies -------------------------------------------------------------------------------


@mistake("geometry: the map folds or is mirrored", "right-handed map")
def outline_is_mirrored() -> str:
    data = plate_data()
    data["geometry"]["control_points"].reverse()
    return converted(data)


@mistake("markers.tip", "outside the geometry", r"near by is \(1, 0\)")
def marker_lies_beside_the_part() -> str:
    data = plate_data()
    data["markers"]["tip"] = {"node": 2, "position": [1.5, 0.0]}
    return converted(data)


@mistake("frame.markers", "at the same place", "two markers at a distance")
def chord_has_no_length() -> str:
    return converted(plate_data(frame={"type": "chord", "markers": ["tip", "tip"]}))


@mistake("stiffening.prestress: the body buckles", "below the buckling load")
def prestress_is_beyond_buckling() -> str:
    forces = {"tip": [-1e6, 0.0, 0.0]}
    return converted(bar_data(stiffening={"prestress": {"forces": forces}}))


@mistake("quad4 elements bend too stiffly", "incompatible modes")
def mesh_locks() -> str:
    mesh = {"type": "q4", "elements": [10, 1], "formulation": "full_integration"}
    return converted(plate_data(discretisation=mesh))


@mistake(
    "modes are those of the free body",
    "held at root",
    "26 %",
    "clamp",
    "Craig-Bampton",
)
def frame_at_a_marker_is_no_clamp() -> str:
    data = plate_data(frame={"type": "tangent", "marker": "root"})
    tie = {"type": "distributing", "to": "left"}
    data["markers"]["root"] = {"node": 1, "tie": tie}
    return converted(data)
