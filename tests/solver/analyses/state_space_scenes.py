"""Scenes with inputs for tests of state spaces."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

import sidtool
from sidtool.formats.base.sid import SID, Array
from tests.places import SLIDER_CRANK
from tests.references.slender import CLAMPED, beam

GRAVITY = 9.81
ARM_MASS, ARM_INERTIA, HALF = 2.0, 0.05, 0.4


def taking(name: str, **force: Any) -> dict[str, Any]:
    """A force, an actuator or a drive that an input defines."""
    return {**force, "function": {"type": "input", "name": name}}


def pendulum(**parts: Any) -> sidtool.Scene:
    """A rod that hangs from a joint; its motor takes the input `torque`."""
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "gravity": [0.0, -GRAVITY],
        "time": {"end": 1.0, "output_step": 0.05},
        "bodies": {
            "arm": {
                "mass": ARM_MASS,
                "inertia": ARM_INERTIA,
                "initial": {"position": [0.0, -HALF], "angle": -math.pi / 2},
                "markers": {
                    "pivot": {"position": [-HALF, 0.0]},
                    "tip": {"position": [HALF, 0.0]},
                },
            }
        },
        "joints": {"pivot": {"type": "revolute", "markers": ["ground", "arm.pivot"]}},
        "inputs": {"torque": {}},
        "forces": {"motor": taking("torque", type="actuator", joint="pivot")},
        "outputs": {"record": ["pivot.angle", "arm.tip.ax", "pivot.fx", "pivot.fy"]},
    }
    return sidtool.Scene.model_validate(content | parts)


def slider_crank() -> sidtool.Scene:
    """The founding slider-crank with a motor, a load and a spring at the piston."""
    scene = sidtool.Scene.load(SLIDER_CRANK / "slider_crank.toml")
    angle = math.radians(60.0)
    crank, rod = 0.1, 1.0
    pin = [crank * math.cos(angle), crank * math.sin(angle)]
    tilt = -math.asin(pin[1] / rod)
    spring = {"type": "spring_damper", "markers": ["ground", "piston"], "rest": 1.0}
    return scene.with_(
        {
            "gravity": [0.0, -GRAVITY],
            "drives": {},
            "inputs": {"torque": {}, "load": {}},
            "forces": {
                "motor": taking("torque", type="actuator", joint="bearing"),
                "load": taking("load", type="force", marker="piston", force=[1.0, 0.0]),
                "spring": spring | {"stiffness": 2000.0, "damping": 5.0},
            },
            "bodies.crank.initial": {"angle": angle},
            "bodies.rod.initial": {"position": pin, "angle": tilt},
            "bodies.piston.initial": {"position": [pin[0] + math.cos(tilt), 0.0]},
            "outputs.record": [
                *("piston.x", "piston.ax", "bearing.angle", "rod.q1", "rod.q5"),
                *("crank_pin.fx", "slider.fy"),
            ],
        }
    )


@cache
def link(
    length: float, elements: int = 8, method: str = "craig_bampton", modes: int = 4
) -> SID:
    """An aluminium bar of 20 mm with damping."""
    second = 0.02**4 / 12
    section = {"area": 0.02**2, "iy": second, "iz": 1.3 * second}
    return beam(
        length,
        section,
        (7e10, 0.3, 2700.0),
        elements,
        {
            "frame": CLAMPED,
            "reduction": {
                "method": method,
                "interfaces": ["end"],
                "modes": modes,
            },
            "damping": {"type": "rayleigh", "beta": 2e-5},
        },
    )


def _link_body(*position: float, **initial: Any) -> dict[str, Any]:
    markers = {"start": 1, "end": 2}
    start = {"position": list(position), **initial}
    return {"sid": "link.SID_FEM", "markers": markers, "initial": start}


#: Stiff enough: static answers lose digits by the square of the ratio of the highest
#: frequency to the lowest one, here 2e4.
SPRINGS = {"yaw": 1500.0, "shoulder": 4500.0, "elbow": 1500.0}


def spatial_arm() -> sidtool.Scene:
    """Two flexible links on a turntable with motors, springs and a load."""
    flexible = {"upper": _link_body(0.0, 0.0, 0.3), "fore": _link_body(0.8, 0.0, 0.3)}
    motors = {
        f"motor_{joint}": taking(joint, type="actuator", joint=joint)
        for joint in SPRINGS
    }
    springs = {
        f"spring_{joint}": {
            "type": "spring_damper",
            "joint": joint,
            "stiffness": stiffness,
            "damping": 0.02 * stiffness,
        }
        for joint, stiffness in SPRINGS.items()
    }
    push = taking("push", type="force", marker="load", force=[0.0, 1.0, 0.5])
    scene = sidtool.Scene.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": [0.0, 0.0, -GRAVITY],
            "time": {"end": 1.0, "output_step": 0.05},
            "bodies": {
                "turntable": {
                    "mass": 10.0,
                    "inertia": [0.4, 0.4, 0.6],
                    "markers": {"shoulder": {"position": [0.0, 0.0, 0.3]}},
                },
                **flexible,
                "load": {
                    "mass": 2.0,
                    "inertia": [0.01, 0.02, 0.02],
                    "centre_of_mass": [0.1, 0.0, 0.0],
                    "initial": {"position": [1.6, 0.0, 0.3]},
                },
            },
            "joints": {
                "yaw": _revolute("ground", "turntable", [0.0, 0.0, 1.0]),
                "shoulder": _revolute("turntable.shoulder", "upper.start"),
                "elbow": _revolute("upper.end", "fore.start"),
                "flange": {"type": "fixed", "markers": ["fore.end", "load"]},
            },
            "inputs": {name: {} for name in (*SPRINGS, "push")},
            "forces": {**motors, **springs, "push": push},
            "outputs": {
                "record": [
                    *("load.x", "load.y", "load.z", "load.az", "yaw.angle"),
                    *("elbow.angle", "elbow.fz", "elbow.mx", "fore.q1", "upper.q3"),
                    *("load.rotation_x", "load.wx", "momentum.y"),
                ]
            },
        }
    )
    sids = {name: link(0.8) for name in flexible}
    return scene.with_({f"bodies.{name}.sid": sid for name, sid in sids.items()})


def _revolute(first: str, second: str, axis: Any = (0.0, 1.0, 0.0)) -> dict[str, Any]:
    return {"type": "revolute", "markers": [first, second], "axis": list(axis)}


def four_bar() -> sidtool.Scene:
    """A crank, a flexible coupler and a rocker on a torsion spring, from 40 degrees."""
    crank, coupler, rocker, base = 0.1, 0.35, 0.25, 0.4
    angle = math.radians(40.0)
    pin = crank * np.array([math.cos(angle), math.sin(angle)])
    along = np.array([base, 0.0]) - pin
    distance = float(np.linalg.norm(along))
    inner = math.acos((coupler**2 + distance**2 - rocker**2) / (2 * coupler * distance))
    tilt = math.atan2(along[1], along[0]) + inner
    end = pin + coupler * np.array([math.cos(tilt), math.sin(tilt)])
    rocker_angle = math.atan2(end[1], end[0] - base)

    def bar(length: float, mass: float, **initial: Any) -> dict[str, Any]:
        return {
            "mass": mass,
            "inertia": mass * length**2 / 12,
            "centre_of_mass": [length / 2, 0.0],
            "markers": {"pin": {"position": [length, 0.0]}},
            "initial": initial,
        }

    scene = sidtool.Scene.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar",
            "gravity": [0.0, -GRAVITY],
            "time": {"end": 1.0, "output_step": 0.05},
            "ground": {"markers": {"rocker": {"position": [base, 0.0]}}},
            "bodies": {
                "crank": bar(crank, 0.4, angle=angle),
                "coupler": _link_body(*pin.tolist(), angle=tilt),
                "rocker": bar(rocker, 0.8, position=[base, 0.0], angle=rocker_angle),
            },
            "joints": {
                "crank_bearing": _planar("ground", "crank"),
                "crank_pin": _planar("crank.pin", "coupler.start"),
                "rocker_pin": _planar("coupler.end", "rocker.pin"),
                "rocker_bearing": _planar("ground.rocker", "rocker"),
            },
            "inputs": {"torque": {"initial": 0.3}},
            "forces": {
                "motor": taking("torque", type="actuator", joint="crank_bearing"),
                "spring": {
                    "type": "spring_damper",
                    "joint": "rocker_bearing",
                    "stiffness": 40.0,
                    "damping": 0.1,
                    "rest": rocker_angle,
                },
            },
            "outputs": {
                "record": [
                    *("rocker_bearing.angle", "coupler.end.uy", "rocker_pin.fx"),
                    *("coupler.end.ay", "energy.potential"),
                ]
            },
        }
    )
    return scene.with_({"bodies.coupler.sid": link(coupler)})


def controlled_arm() -> sidtool.Scene:
    """A flexible arm with a load that a PID controller holds level."""
    law = {
        "type": "pid",
        "measured": "shoulder.angle",
        "p": 300.0,
        "i": 1500.0,
        "d": 30.0,
        "filter": 0.005,
    }
    scene = sidtool.Scene.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar",
            "gravity": [0.0, -9.81],
            "time": {"end": 1.0, "output_step": 0.1},
            "bodies": {
                "arm": {"sid": "-", "markers": {"start": 1, "end": 2}},
                "load": {"mass": 2.0, "initial": {"position": [0.8, 0.0]}},
            },
            "joints": {
                "shoulder": {"type": "revolute", "markers": ["ground", "arm.start"]},
                "grip": {"type": "coincident", "markers": ["arm.end", "load"]},
            },
            "inputs": {"push": {"interpolation": "smooth"}},
            "forces": {
                "motor": {"type": "actuator", "joint": "shoulder", "function": law},
                "push": taking("push", type="force", marker="load", force=[0.0, 1.0]),
            },
            "outputs": {"record": ["load.y", "motor.value", "inputs.push"]},
        }
    )
    return scene.with_({"bodies.arm.sid": link(0.8)})


def _planar(first: str, second: str) -> dict[str, Any]:
    return {"type": "revolute", "markers": [first, second]}


def response_at(space: sidtool.StateSpace, s: complex) -> Array:
    """C (s I - A)^-1 B + D."""
    shifted = s * np.eye(len(space.A)) - space.A
    return np.asarray(space.C @ np.linalg.solve(shifted, space.B) + space.D)
