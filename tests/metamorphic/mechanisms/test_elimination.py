"""A scene that is cut down is the same scene: with and without eliminated joints.

`keep_joints` keeps the constraints of joints that prescribe a frame; the motion must
not depend on it. What it has to be is told by the theory of beams.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from tests.metamorphic.mechanisms.carried import (
    AREA,
    CARRIED,
    DENSITY,
    LENGTH,
    MODULUS,
    SECOND_MOMENT,
    arm,
    robot,
)

DIMENSIONS = ["planar", "spatial"]


def both(content: SceneFile, sid: SID, rtol: float = 1e-9) -> tuple[Result, Result]:
    """The run of a scene as it is cut down, and with all of its joints."""
    systems = [
        compile_scene(content, sids={"arm": sid}, keep_joints=keep)
        for keep in (False, True)
    ]
    assert not systems[1].eliminated
    cut, whole = (simulate(system, rtol=rtol) for system in systems)
    return cut, whole


def differences(cut: Result, whole: Result) -> Any:
    """Of the recorded columns, relative to the largest motion of each kind."""
    sizes = np.abs(whole.values).max(axis=0)
    elastic = np.array([".q" in name for name in whole.names])
    for group in (elastic, ~elastic):
        sizes[group] = sizes[group].max(initial=0.0)
    return np.abs(cut.values - whole.values).max(axis=0) / sizes


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("wrist", CARRIED)
@pytest.mark.parametrize("shoulder", CARRIED)
def test_what_a_flexible_arm_carries(dimension: str, shoulder: str, wrist: str) -> None:
    cut, whole = both(robot(dimension, shoulder, wrist), arm(4))
    assert differences(cut, whole).max() < 1e-5
    assert np.abs(whole["arm.q1"]).max() > 1e-4


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("wrist", CARRIED)
def test_a_chain_on_a_flexible_arm(dimension: str, wrist: str) -> None:
    content = robot(dimension, "revolute", wrist, chain=3)
    cut, whole = both(content, arm(4))
    assert differences(cut, whole).max() < 1e-5


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("wrist", CARRIED)
def test_what_hangs_on_a_clamped_end_is_eliminated(dimension: str, wrist: str) -> None:
    """The clamped end feels no elastic coordinate: all frames are prescribed."""
    content = robot(dimension, "revolute", wrist, base="root", chain=2)
    system = compile_scene(content, sids={"arm": arm(4)})
    assert set(system.eliminated.values()) == {"arm", "tool0", "tool1"}
    assert system.n_velocities == arm(4).nq
    cut, whole = both(content, arm(4))
    assert differences(cut, whole).max() < 1e-5


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("mass", [10.0, 1000.0])
def test_a_cantilever_sags_under_its_tool(dimension: str, mass: float) -> None:
    """Let go under gravity with a heavy particle at its tip, a beam swings about its
    deflection m g L^3 / (3 E I) + w L^4 / (8 E I) with the first root of
    1 + cos k cosh k + (m / M) k (cos k sinh k - sin k cosh k)."""
    gravity, beam = 9.81, DENSITY * AREA * LENGTH
    bending = MODULUS * SECOND_MOMENT

    def characteristic(k: float) -> float:
        c, s, ch, sh = np.cos(k), np.sin(k), np.cosh(k), np.sinh(k)
        return float(1 + c * ch + mass / beam * k * (c * sh - s * ch))

    k = brentq(characteristic, 0.1, 1.87510406871)
    omega = k**2 * np.sqrt(bending / (beam * LENGTH**3))
    sag = mass * gravity * LENGTH**3 / (3 * bending)
    sag += beam * gravity * LENGTH**3 / (8 * bending)
    axes = 2 if dimension == "planar" else 3
    inertia = 1e-9 if dimension == "planar" else [1e-9] * 3
    content = robot(
        dimension,
        "fixed",
        "fixed",
        gravity=[0.0, -gravity, 0.0][:axes],
        end=2.0 * np.pi / omega,
        steps=200,
        record=["arm.tip.uy"],
    )
    table = content.model_dump(by_alias=True, exclude_none=True)
    table["bodies"]["tool0"] |= {"mass": mass, "inertia": inertia}
    table["bodies"]["tool0"]["centre_of_mass"] = [0.0] * axes
    content = SceneFile.model_validate(table)
    found = simulate(compile_scene(content, sids={"arm": arm(8)}), rtol=1e-7)
    expected = -sag * (1.0 - np.cos(omega * found.t))
    assert found["arm.tip.uy"] == pytest.approx(expected, abs=0.015 * 2.0 * sag)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("base", ["root", "tip"])
def test_what_is_recorded_does_not_change_the_motion(dimension: str, base: str) -> None:
    """To the last bit; and the forces are those of the scene with all joints."""
    plain = robot(dimension, "revolute", "revolute", base=base, chain=2)
    motion = list(plain.outputs.record)
    forces = ["shoulder.fx", "shoulder.f*", "shoulder_drive.f1", "wrist1.fy"]
    forces += ["wrist1_drive.mz", "energy.supplied", "energy.balance"]
    more = robot(
        dimension, "revolute", "revolute", base, chain=2, record=motion + forces
    )
    found = simulate(compile_scene(plain, sids={"arm": arm(4)}), rtol=1e-9)
    cut, whole = both(more, arm(4))
    assert np.array_equal(found.values, cut.values[:, : found.values.shape[1]])
    size = np.abs(whole.values).max()
    assert np.abs(cut.values - whole.values).max() < 1e-6 * size
    assert np.abs(cut["shoulder_drive.f1"]).min() > 1.0


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_a_point_mass_has_no_orientation_to_be_held(dimension: str) -> None:
    """Fixed to a turning arm it moves as a body with hardly any inertia."""
    runs = []
    for inertia in ({}, {"inertia": 1e-9 if dimension == "planar" else [1e-9] * 3}):
        content = robot(dimension, "revolute", "fixed", record=["arm.q1", "tool0.x"])
        table = content.model_dump(by_alias=True, exclude_none=True)
        table["bodies"]["tool0"] = {"mass": 3.0} | inertia
        table["joints"]["wrist0"]["markers"] = ["arm.tip", "tool0"]
        runs.append(both(SceneFile.model_validate(table), arm(4)))
    for run in (runs[0][1], *runs[1]):
        assert differences(runs[0][0], run).max() < 1e-5


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("angle", [0.2, 0.7])
def test_a_fixed_start_is_kept_or_refused(
    dimension: str, keep: bool, angle: float
) -> None:
    """The drive begins at 0.2 rad, and the first tool then lies there."""
    content = robot(dimension, "revolute", "fixed", base="root")
    table = content.model_dump(by_alias=True, exclude_none=True)
    way = {"angle": angle} if dimension == "planar" else {"axis_angle": [0, 0, angle]}
    table["bodies"]["tool0"]["initial"] = {"fixed": True, **way}
    system = compile_scene(
        SceneFile.model_validate(table), sids={"arm": arm(4)}, keep_joints=keep
    )
    if angle == 0.2:
        assert simulate(system, rtol=1e-6).completed
        return
    with pytest.raises(InputError, match="tool0 0 m and 0.5 rad away") as refused:
        simulate(system)
    assert refused.value.place == "bodies.tool0.initial"
