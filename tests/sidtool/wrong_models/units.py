"""Slips of units."""

from __future__ import annotations

from typing import Any

from tests.solver.scenes import polynomial, scene, slender_rod
from tests.steel_bars import bar_data, steel_bar

from .gallery import (
    bar,
    clamped,
    converted,
    material,
    mistake,
    pendulum,
    simulated,
    slider_crank,
)


@mistake("N203 crank: 100 m .*rod of 1 m", "in mm")
def crank_is_in_millimetres() -> str:
    def change(d: Any) -> None:
        d["bodies"]["crank"] = slender_rod(100.0, 0.3)
        d["end"] = 1e-4

    return slider_crank(change)


@mistake("N201 gravity of 9810 m/s2", "m/s2")
def gravity_is_in_millimetres() -> str:
    return pendulum(gravity=[0.0, -9810.0], end=0.01)


@mistake("N202 bodies.rod.initial.angle: 90 rad", "90 deg = 1.571 rad")
def angle_is_in_degrees() -> str:
    return pendulum(slender_rod(1.0, angle=90.0))


@mistake("N202 drives.motor: 360 rad", "360 deg = 6.283 rad")
def drive_is_in_degrees() -> str:
    return pendulum(drive={"type": "smooth_step", "from": 0.0, "to": 1.0, "end": 360.0})


@mistake("N202 drives.motor: 90 rad", "90 deg = 1.571 rad")
def servo_starts_in_degrees() -> str:
    """Its speed of 360 rad/s is no angle."""
    joints = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    spin = {"type": "constant", "value": 360.0}
    motor = {"joint": "pin", "of": "rate", "start": 90.0, "function": spin}
    described = scene({"rod": slender_rod(1.0)}, joints, {"motor": motor}, end=0.01)
    notes = simulated(described)
    assert "360 rad" not in notes
    return notes


@mistake("N209 motor: 3000 rad/s", "1/min would be 314 rad/s")
def drive_is_in_revolutions_per_minute() -> str:
    return pendulum(drive=polynomial(0.0, 3000.0), end=0.01)


@mistake("N205 rod: .*28.9 m", "kg m2")
def inertia_is_in_kg_mm2() -> str:
    return pendulum(slender_rod(0.1, 0.3) | {"inertia": 250.0})


@mistake("N204 rod: .*1, 1, 3 kg m2", "about the centre of mass")
def inertia_is_of_no_body() -> str:
    rod = {"mass": 1.0, "inertia": [1.0, 1.0, 3.0]}
    return simulated(scene({"rod": rod}, dimension="spatial"))


@mistake(
    "N101 Young's modulus 210 Pa",
    r"in GPa it would be 2.1e\+11 Pa",
    r"N103 .*8.9e\+05 sizes",
)
def stiffness_is_in_gigapascal() -> str:
    return converted(bar_data(**material(youngs_modulus=210.0)))


@mistake(
    "N101 density 7.85e-09 kg/m3",
    r"t/mm3 it would be 7.85e\+03",
    r"N103 .*1.67e\+07 Hz .*faster than sound",
)
def density_is_in_tonnes_per_cubic_millimetre() -> str:
    return converted(bar_data(**material(density=7.85e-9)))


@mistake(r"N103 bar: .*8.9e\+05 sizes", "under gravity", "units")
def scene_has_a_bar_of_210_pascal() -> str:
    return clamped(
        steel_bar(**material(youngs_modulus=210.0)), gravity=[0.0, -9.81], end=0.1
    )


@mistake(r"N103 bar: .*1.67e\+07 Hz", "faster than sound")
def scene_has_a_bar_without_weight() -> str:
    return clamped(
        steel_bar(**material(density=7.85e-9)), gravity=[0.0, -9.81], end=1e-6
    )


@mistake(r"N103 .*size of 1e\+03 m", r"geometry\.unit")
def body_is_drawn_in_millimetres() -> str:
    data = bar_data(width=20.0, height=20.0)
    data["geometry"]["end"] = [1000, 0, 0]
    return converted(data)


@mistake("N107 bar: .*ratio 2", "2 % .* 0.02")
def damping_is_in_per_cent() -> str:
    return clamped(bar(), body={"damping": {"type": "modal", "ratio": 2.0}}, end=0.1)


@mistake("N208 bar: .*0.0001 s is 0.00167 periods", "in s")
def time_is_in_kiloseconds() -> str:
    return clamped(bar(), gravity=[0.0, -9.81], end=1e-4)


def mass_on_spring(spring: dict[str, Any], **more: Any) -> str:
    """A body of 10 kg on a spring."""
    body = {"mass": 10.0, "inertia": 0.1, "initial": {"position": [0.0, -0.5]}}
    forces = {"spring": {"markers": ["ground", "body"], **spring}}
    return simulated(scene({"body": body}, {}, forces=forces, **more))


@mistake("N217 spring: .*20 N/m", "N/mm")
def spring_is_in_newton_per_millimetre() -> str:
    spring = {"type": "spring_damper", "stiffness": 20.0, "rest": 0.45}
    return mass_on_spring(spring, gravity=[0.0, -9.81], end=2.0)


@mistake("N217 spring: .*30 N/m", "N/mm")
def bushing_is_in_newton_per_millimetre() -> str:
    spring = {"type": "bushing", "stiffness": [30.0, 30.0, 0.5]}
    return mass_on_spring(spring, gravity=[0.0, -9.81], end=1.5)


@mistake("N217 shaft: .*5 N m/rad")
def shaft_is_in_kilonewton_metres() -> str:
    """500 N m would twist it by 0.1 rad, and not by 100."""
    load = {"type": "constant", "value": 500.0}
    forces = {
        "shaft": {"type": "spring_damper", "joint": "pin", "stiffness": 5.0},
        "load": {"type": "actuator", "joint": "pin", "function": load},
    }
    rotor = slender_rod(1.0) | {"inertia": 5.0}
    return pendulum(rotor, forces=forces, end=1.0)


@mistake(r"N210 spring: .*2e\+13 N/m", "190 steel blocks")
def spring_is_stiffer_than_steel() -> str:
    """GPa m in place of Pa m."""
    return mass_on_spring(
        {"type": "spring_damper", "stiffness": 2e13, "rest": 0.5}, end=1e-6
    )


@mistake(r"N211 spring: .*1e\+10 N s/m", "10 kg within 1e-09 s")
def damper_stops_everything_at_once() -> str:
    return mass_on_spring({"type": "spring_damper", "damping": 1e10}, end=1e-6)


@mistake(r"N218 rod: .*3e\+03 m/s", "motor", "N m")
def torque_is_in_newton_millimetres() -> str:
    torque = {"type": "constant", "value": 5000.0}
    motor = {"type": "actuator", "joint": "pin", "function": torque}
    return pendulum(forces={"motor": motor}, end=0.2)
