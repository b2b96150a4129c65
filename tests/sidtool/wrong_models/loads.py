"""Loads that are hardly meant, and those that a body cannot bear."""

from __future__ import annotations

from tests.solver.scenes import polynomial, scene, slender_rod
from tests.steel_bars import steel_bar

from .gallery import (
    FLEXIBLE,
    bar,
    clamped,
    hinge,
    mistake,
    pendulum,
    simulated,
)


@mistake("forces.twist.torque", "mass, a point mass", "bodies.mass.inertia")
def point_mass_takes_a_torque() -> str:
    twist = {"type": "force", "marker": "mass", "torque": 3.0}
    return simulated(scene({"mass": {"mass": 1.0}}, forces={"twist": twist}))


@mistake("N206 spring: stiffness = -1000", "sign")
def spring_pushes_away() -> str:
    spring = {"type": "spring_damper", "joint": "pin", "stiffness": -1e3}
    return pendulum(forces={"spring": spring})


@mistake("N206 spring: damping = -5", "sign")
def damper_drives() -> str:
    spring = {
        "type": "spring_damper",
        "joint": "pin",
        "stiffness": 1e3,
        "damping": -5.0,
    }
    return pendulum(forces={"spring": spring})


@mistake("N207 spring: .* rigid body rod", "another body")
def spring_holds_on_to_itself() -> str:
    markers = ["rod.a", "rod.b"]
    spring = {"type": "spring_damper", "markers": markers, "stiffness": 1e3}
    return pendulum(forces={"spring": spring})


@mistake("N701 no equilibrium", "at rod", "a scene that can rest")
def static_start_of_what_falls() -> str:
    more = {"gravity": [0.0, -9.81], "initial": {"state": "static"}}
    return simulated(scene({"rod": slender_rod(1.0)}, **more))


@mistake(r"N408 bar: .*force of 1e\+03 N", "more than the body can bear")
def column_is_loaded_beyond_euler() -> str:
    sid = steel_bar(width=0.01, height=0.005, stiffening={})
    push = {"type": "force", "marker": "bar.b", "force": [-1000.0, 0.1]}
    return clamped(sid, forces={"push": push}, end=0.02)


@mistake("N405 bar: .*rotation of 200 rad/s", r"[Cc]onvert .* table \[stiffening\]")
def blade_spins_without_stiffening() -> str:
    joints = {"hub": hinge("ground", "bar.a")}
    drives = {"motor": {"joint": "hub", "function": polynomial(0.0, 200.0)}}
    described = scene({"bar": FLEXIBLE}, joints, drives, end=0.02)
    return simulated(described, bar=bar())
