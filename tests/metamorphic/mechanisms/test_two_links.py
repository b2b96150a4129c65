"""The most ordinary robot: a flexible upper arm that carries a rigid forearm.

Shoulder and elbow are driven. The motion is that of particles whose places are
written down, see `two_links`; it does not depend on what is recorded, on the order of
a joint's markers or on which joints keep their constraints.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from tests.metamorphic.mechanisms.two_links import Beam, TwoLinks
from tests.sidtool.bodies import beam_data
from tests.solver.scenes import polynomial, scene

LENGTH, FOREARM, MASSES, END = 1.0, 0.6, (5.0, 40.0), 0.2
OUTPUTS = 50
BEAM = Beam(LENGTH, 1e-3, 2e-7, 4e-8, 1.2e-7, 2.1e11, 8e10, 7850.0)
SHOULDER, ELBOW = (0.3, 0.0, 9.0, -8.0), (0.9, 0.0, -12.0, 5.0)
#: Bending along y, along z, twist: the modes of lowest frequency of the beam.
SHAPES = {"planar": (3, 0, 0), "spatial": (3, 2, 1)}
GRAVITY = {"planar": [2.0, -9.81, 0.0], "spatial": [2.0, -6.0, -7.0]}


@cache
def arm() -> SID:
    """The beam as a SID: three modes bend along y, two along z, one twists."""
    data = beam_data({"type": "beam", "elements": 24}, sum(SHAPES["spatial"]))
    shear = BEAM.modulus / (2 * BEAM.shear_modulus) - 1
    data["material"] |= {"youngs_modulus": BEAM.modulus, "poissons_ratio": shear}
    data["material"]["density"] = BEAM.density
    section = {"shape": "general", "area": BEAM.area, "iy": BEAM.iy, "iz": BEAM.iz}
    section["torsion"] = BEAM.torsion
    data["geometry"] |= {"end": [LENGTH, 0.0, 0.0], "section": section}
    data["frame"] = {"type": "tangent", "marker": "root", "clamp": "start"}
    data["markers"] = {
        "root": {"node": 1, "parameters": [0.0]},
        "tip": {"node": 2, "parameters": [1.0]},
    }
    del data["damping"]
    return sid_from_model(validate_data(data, ModelFile))


def particles(mass: float) -> tuple[Array, Array]:
    """The forearm, and without mass its hand as the last one."""
    masses = np.array([0.3, 0.2, 0.3, 0.2, 0.0]) * mass
    ends = [[0.05, 0.04, 0.0], [0.5, -0.03, 0.1], [0.3, 0.0, -0.05], [0.2, -0.06, 0.0]]
    return masses, np.array([*ends, [FOREARM, 0.0, 0.0]])


def rigid(dimension: str, mass: float) -> dict[str, Any]:
    masses, places = particles(mass)
    centre = masses @ places / mass
    arms = places - centre
    tensor = np.einsum(
        "p,pab->ab",
        masses,
        np.einsum("pc,pc,ab->pab", arms, arms, np.eye(3))
        - np.einsum("pa,pb->pab", arms, arms),
    )
    axes = 2 if dimension == "planar" else 3
    inertia: Any = tensor[2, 2]
    if dimension == "spatial":
        inertia = tensor.tolist()
    return {
        "mass": mass,
        "inertia": inertia,
        "centre_of_mass": centre[:axes].tolist(),
        "markers": {
            "near": {"position": [0.0] * axes},
            "hand": {"position": [FOREARM, 0.0, 0.0][:axes]},
        },
    }


def turned(dimension: str, angle: float) -> dict[str, Any]:
    """A start at rest, turned about z."""
    if dimension == "planar":
        return {"angle": angle}
    return {"axis_angle": [0.0, 0.0, angle]}


def robot(
    dimension: str,
    mass: float = MASSES[0],
    exchanged: bool = False,
    forces: bool = False,
) -> SceneFile:
    joints: dict[str, Any] = {}
    drives: dict[str, Any] = {}
    for name, ends, motion in (
        ("shoulder", ["ground", "arm.root"], SHOULDER),
        ("elbow", ["arm.tip", "forearm.near"], ELBOW),
    ):
        sign = -1.0 if exchanged else 1.0
        joints[name] = {
            "type": "revolute",
            "markers": ends[::-1] if exchanged else ends,
        }
        turn = polynomial(*(sign * c for c in motion))
        drives[f"{name}_drive"] = {"joint": name, "function": turn}
    axes = "xy" if dimension == "planar" else "xyz"
    turn, fold = SHOULDER[0], SHOULDER[0] + ELBOW[0]
    elbow = [LENGTH * np.cos(turn), LENGTH * np.sin(turn), 0.0][: len(axes)]
    arm_data = {"sid": "-", "markers": {"root": 1, "tip": 2}, "quadratic_inertia": True}
    bodies = {
        "arm": arm_data | {"initial": turned(dimension, turn)},
        "forearm": rigid(dimension, mass)
        | {"initial": turned(dimension, fold) | {"position": elbow}},
    }
    record = [
        "arm.q1",
        *(f"arm.tip.u{a}" for a in axes),
        *(f"forearm.hand.{a}" for a in axes),
    ]
    if forces:
        record += ["elbow.f*", "shoulder_drive.mz", "energy.balance"]
    return scene(
        bodies,
        joints,
        drives,
        end=END,
        steps=OUTPUTS,
        dimension=dimension,
        gravity=GRAVITY[dimension][: len(axes)],
        record=record,
    )


def run(content: SceneFile, **settings: Any) -> Result:
    return simulate(compile_scene(content, sids={"arm": arm()}, **settings), rtol=1e-8)


@cache
def expected(dimension: str, mass: float) -> tuple[Array, Array, Array]:
    """q1, the tip's deflection and the hand by particles."""
    masses, places = particles(mass)
    shoulder, elbow = (np.polynomial.Polynomial(c) for c in (SHOULDER, ELBOW))
    flat = [1.0, 1.0, 0.0 if dimension == "planar" else 1.0]
    links = TwoLinks(
        BEAM,
        SHAPES[dimension],
        (masses, places * flat),
        shoulder,
        elbow,
        np.array(GRAVITY[dimension]),
    )
    q, hand = links.motion(np.linspace(0.0, END, OUTPUTS + 1), 1e-4)
    return q[:, 0], np.einsum("tl,la->ta", q, links.shape[:, -1]), hand


@pytest.mark.parametrize(("dimension", "mass"), zip(SHAPES, MASSES, strict=True))
def test_the_forearm_is_carried(dimension: str, mass: float) -> None:
    """The functions of the beam at rest know no rotary inertia: three digits."""
    found = run(robot(dimension, mass))
    q1, deflection, hand = expected(dimension, mass)
    size = np.abs(deflection).max()
    assert size > 0.01
    assert np.abs(found["arm.q1"]) == pytest.approx(
        np.abs(q1), abs=1e-3 * np.abs(q1).max()
    )
    for k, axis in enumerate("xy" if dimension == "planar" else "xyz"):
        tip, end = found[f"arm.tip.u{axis}"], found[f"forearm.hand.{axis}"]
        assert tip == pytest.approx(deflection[:, k], abs=1e-3 * size)
        assert end == pytest.approx(hand[:, k], abs=1.5e-3 * size)


@pytest.mark.parametrize("dimension", SHAPES)
def test_the_robot_said_differently_moves_the_same(dimension: str) -> None:
    """Recorded forces, exchanged markers of its joints, all joints kept."""
    plain = run(robot(dimension))
    others = [
        run(robot(dimension, forces=True)),
        run(robot(dimension, exchanged=True)),
        run(robot(dimension), keep_joints=True),
    ]
    size = np.abs(plain["arm.q1"]).max()
    for other in others:
        found = other.values[:, : plain.values.shape[1]]
        assert np.abs(found - plain.values).max() < 1e-6 * size
