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
    notes = simulated(described)
    assert "360 rad" not in notes
    return notes


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


def mass_on_spring(spring: dict[str, Any], **more: Any) -> str:
    """A body of 10 kg on a spring."""
    body = {"mass": 10.0, "inertia": 0.1, "initial": {"position": [0.0, -0.5]}}
    forces = {"spring": {"markers": ["ground", "body"], **spring}}
    return simulated(scene({"body": body}, {}, forces=forces, **more))


@mistake("spring holds next to nothing", "20 N/m in N/mm")
def spring_is_in_newton_per_millimetre() -> str:
    spring = {"type": "spring_damper", "stiffness": 20.0, "rest": 0.45}
    return mass_on_spring(spring, gravity=[0.0, -9.81], end=2.0)


@mistake("spring holds next to nothing", "30 N/m in N/mm")
def bushing_is_in_newton_per_millimetre() -> str:
    spring = {"type": "bushing", "stiffness": [30.0, 30.0, 0.5]}
    return mass_on_spring(spring, gravity=[0.0, -9.81], end=1.5)


@mistake("shaft holds next to nothing", "5 N m/rad in kN m/rad")
def shaft_is_in_kilonewton_metres() -> str:
    """500 N m would twist it by 0.1 rad, and not by 100."""
    load = {"type": "constant", "value": 500.0}
    forces = {
        "shaft": {"type": "spring_damper", "joint": "pin", "stiffness": 5.0},
        "load": {"type": "actuator", "joint": "pin", "function": load},
    }
    rotor = slender_rod(1.0) | {"inertia": 5.0}
    return pendulum(rotor, forces=forces, end=1.0)


@mistake("spring has a stiffness of 2e.13 N/m", "solid block of steel")
def spring_is_stiffer_than_steel() -> str:
    """GPa m in place of Pa m."""
    return mass_on_spring(
        {"type": "spring_damper", "stiffness": 2e13, "rest": 0.5}, end=1e-6
    )


@mistake("spring has a damping of 1e.10 N s/m", "faster than sound")
def damper_stops_everything_at_once() -> str:
    return mass_on_spring({"type": "spring_damper", "damping": 1e10}, end=1e-6)


@mistake("rod gained .* m/s", "motor", "a torque in N mm")
def torque_is_in_newton_millimetres() -> str:
    torque = {"type": "constant", "value": 5000.0}
    motor = {"type": "actuator", "joint": "pin", "function": torque}
    return pendulum(forces={"motor": motor}, end=0.2)
