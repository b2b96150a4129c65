"""Gears, racks, screws and differentials: ratios for ever, and the right inertia."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver import compile_scene, simulate
from sidtool.solver.initial_state.assembly import assemble, dense_jacobian
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.coordinates import retract
from sidtool.solver.system import work_arrays
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays

from .joint_scenes import scene


def wheels(dimension: str, coupling: dict[str, Any], end: float = 20.0) -> Any:
    """A pendulum on a wheel's shaft that turns over, geared to a second wheel."""
    plane = dimension == "planar"

    def vector(x: float, y: float) -> list[float]:
        return [x, y] if plane else [x, y, 0.0]

    def inertia(zz: float) -> Any:
        return zz if plane else [0.3 * zz, 0.8 * zz, zz]

    spin: Any = 9.0 if plane else [0.0, 0.0, 9.0]
    other: Any = -13.5 if plane else [0.0, 0.0, -13.5]
    return scene(
        dimension,
        end,
        gravity=vector(0.0, -9.81),
        ground={"markers": {"far": {"position": vector(0.5, 0.0)}}},
        bodies={
            "first": {
                "mass": 1.0,
                "inertia": inertia(0.2),
                "centre_of_mass": vector(0.3, 0.0),
                "initial": {"angular_velocity": spin},
            },
            "second": {
                "mass": 2.0,
                "inertia": inertia(0.3),
                "initial": {"angular_velocity": other, "position": vector(0.5, 0.0)},
            },
        },
        joints={
            "one": {"type": "revolute", "markers": ["ground", "first"]},
            "two": {"type": "revolute", "markers": ["ground.far", "second"]},
            "mesh": coupling,
        },
        outputs={"record": ["first.x", "first.wz", "second.wz", "second.vx"]},
    )


GEAR = {"type": "gear", "joints": ["one", "two"], "ratio": -1.5}


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_gear_keeps_its_ratio_over_many_turns(dimension: str) -> None:
    """The pendulum swings with the inertia of both wheels, I1 + ratio^2 I2."""
    geared = compile_scene(wheels(dimension, GEAR))
    assert geared.n_rows == (5 if dimension == "planar" else 11)
    result = simulate(geared, rtol=1e-9)
    first, second = result.values[:, 1], result.values[:, 2]
    assert np.abs(second + 1.5 * first).max() < 1e-9
    alone = wheels(dimension, GEAR)
    body = alone.bodies["first"]
    zz = 0.2 + 1.5**2 * 0.3
    heavier = zz if dimension == "planar" else (1.0, 1.0, zz)
    bodies = {**alone.bodies, "first": body.model_copy(update={"inertia": heavier})}
    joints = {"one": alone.joints["one"], "two": alone.joints["two"]}
    alone = alone.model_copy(update={"bodies": bodies, "joints": joints})
    same = simulate(compile_scene(alone), rtol=1e-9)
    assert np.abs(first - same.values[:, 1]).max() < 1e-5
    if dimension == "planar":
        turns = result.positions[-1, 2] / (2 * np.pi)
        assert turns > 10.0
        return
    z = result.positions[-1]
    angles = [2.0 * np.arctan2(z[6], z[3]), 2.0 * np.arctan2(z[13], z[10])]
    beyond = (2.0 * angles[1] + 3.0 * angles[0]) / (2.0 * np.pi)
    assert abs(beyond - round(beyond)) < 1e-10


def test_a_gear_in_space_needs_whole_numbers() -> None:
    content = wheels("spatial", {**GEAR, "ratio": -np.sqrt(2.0)})
    with pytest.raises(InputError, match=r"joints.mesh: .*ratio.*whole numbers"):
        compile_scene(content)
    compile_scene(wheels("planar", {**GEAR, "ratio": -np.sqrt(2.0)}))


def test_an_offset_sets_where_the_teeth_meet() -> None:
    content = wheels("planar", {**GEAR, "offset": 0.3}, 0.1)
    _, start = assemble(compile_scene(content))
    assert abs(start.z[5] - (-1.5 * start.z[2] + 0.3)) < 1e-12


def test_a_nut_falls_slowly_on_a_screw() -> None:
    """a = g / (1 + I / (m p^2)) for a pitch p per radian, over many turns."""
    pitch, mass, inertia = 0.02, 1.3, 0.001
    content = scene(
        "spatial",
        2.0,
        gravity=[0.0, 0.0, -9.81],
        bodies={"nut": {"mass": mass, "inertia": [0.002, 0.003, inertia]}},
        joints={
            "shaft": {"type": "cylindrical", "markers": ["ground", "nut"]},
            "thread": {
                "type": "coupling",
                "joints": ["shaft", "shaft"],
                "coordinate": ["displacement", "angle"],
                "weights": [1.0, -pitch],
            },
        },
        outputs={"record": ["nut.z", "nut.wz"]},
    )
    system = compile_scene(content)
    assert system.n_rows == 5
    result = simulate(system, rtol=1e-9)
    g = 9.81 / (1.0 + inertia / (mass * pitch**2))
    assert np.abs(result.values[:, 0] + 0.5 * g * result.t**2).max() < 1e-6
    assert np.abs(result.values[:, 1] * pitch + g * result.t).max() < 1e-6
    assert result.values[-1, 0] / (2.0 * np.pi * pitch) < -5.0


def carrier(dimension: str) -> Any:
    """A moving carrier with a sun, a planet and a rack, coupled three ways."""
    plane = dimension == "planar"
    rng = np.random.default_rng(3)
    spin = rng.normal(size=3)
    body: dict[str, Any] = {"mass": 1.0, "inertia": 0.2 if plane else [0.2, 0.3, 0.4]}

    def place() -> list[float]:
        return rng.normal(size=2 if plane else 3).tolist()

    def turned() -> dict[str, Any]:
        return {"angle": 0.3} if plane else {"axis_angle": spin.tolist()}

    start = {"velocity": place(), "angular_velocity": spin[0] if plane else place()}
    return scene(
        dimension,
        0.5,
        bodies={
            "carrier": {
                **body,
                "markers": {
                    k: {"position": place(), **turned()} for k in ("a", "b", "c")
                },
                "initial": start,
            },
            **{k: {**body, "initial": start} for k in ("sun", "planet", "rack")},
        },
        joints={
            "one": {"type": "revolute", "markers": ["carrier.a", "sun"]},
            "two": {"type": "revolute", "markers": ["carrier.b", "planet"]},
            "rail": {"type": "prismatic", "markers": ["carrier.c", "rack"]},
            "sum": {
                "type": "coupling",
                "joints": ["one", "two", "rail"],
                "weights": [1.0, -1.5, 0.7],
            },
        },
    )


def assembled(content: Any) -> tuple[System, Array, Array, Array, Array]:
    """A consistent state with some accelerations and multipliers."""
    system, start = assemble(compile_scene(content))
    rng = np.random.default_rng(8)
    acc, lam = rng.normal(size=system.n_velocities), rng.normal(size=system.n_rows)
    return system, start.z, start.v, acc, lam


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_coupling_is_linearised_exactly(dimension: str) -> None:
    """C, Gp and Gv against central differences, on the row of the coupling."""
    system, z, v, acc, lam = assembled(carrier(dimension))
    row = next(r.first for r in system.rows if r.name == "sum")
    work = new_work_arrays(system)

    def state(x: Array, u: Array) -> tuple[float, float]:
        work_arrays.evaluate(system, work, 0.0, x, u)
        C = dense_jacobian(system, work.C)[row]
        values = work.row[row]
        return float(values[at.C_VALUE]), float(C @ acc - values[at.C_GAMMA])

    work_arrays.evaluate(system, work, 0.0, z, v)
    frames = work.frame.copy()
    work_arrays.linearise(system, work, 0.0, z, v, acc, lam)
    C = dense_jacobian(system, work.C)[row]
    Gp = dense_jacobian(system, work.Gp)[row]
    Gv = dense_jacobian(system, work.Gv)[row]
    assert work.row[row, at.C_RATE] == pytest.approx(C @ v, abs=1e-12)
    step = 1e-5
    for k in range(system.n_velocities):
        unit = step * np.eye(system.n_velocities)[k]
        ends = []
        for sign in (1.0, -1.0):
            moved = z.copy()
            retract(system.arrays, frames, moved, sign * unit)
            ends.append((*state(moved, v), state(z, v + sign * unit)[1]))
        slope = (np.array(ends[0]) - np.array(ends[1])) / (2.0 * step)
        assert np.abs(slope - [C[k], Gp[k], Gv[k]]).max() < 2e-8


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_coupled_carrier_conserves_energy(dimension: str) -> None:
    content = carrier(dimension)
    system = compile_scene(content)
    result = simulate(system, rtol=1e-9)
    work = new_work_arrays(system)
    energy = []
    for k in (0, -1):
        z, v = result.positions[k].copy(), result.velocities[k].copy()
        work_arrays.evaluate(system, work, 0.0, z, v)
        total = 0.0
        for body in system.arrays.body:
            n, o, u = body[at.NV], body[at.BLOCK], body[at.VEL]
            M = work.M[o : o + n * n].reshape(n, n)
            total += 0.5 * v[u : u + n] @ M @ v[u : u + n]
        energy.append(total)
    assert energy[1] == pytest.approx(energy[0], rel=1e-7)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_the_force_of_a_coupling_is_linearised_exactly(dimension: str) -> None:
    """Rp of each body against central differences of its own -C^T lambda."""
    system, z, v, acc, lam = assembled(carrier(dimension))
    row = next(r.first for r in system.rows if r.name == "sum")
    force = np.where(np.arange(system.n_rows) == row, lam, 0.0)
    work = new_work_arrays(system)
    work_arrays.evaluate(system, work, 0.0, z, v)
    frames = work.frame.copy()
    work_arrays.linearise(system, work, 0.0, z, v, acc, force)
    with_force = work.Rp.copy()
    work_arrays.linearise(system, work, 0.0, z, v, acc, 0.0 * force)
    stiffness = with_force - work.Rp
    step = 1e-5
    for body in system.arrays.body:
        n, o, u = int(body[at.NV]), int(body[at.BLOCK]), int(body[at.VEL])
        for k in range(n):
            ends = []
            for sign in (step, -step):
                moved = z.copy()
                unit = np.eye(system.n_velocities)[u + k]
                retract(system.arrays, frames, moved, sign * unit)
                work_arrays.evaluate(system, work, 0.0, moved, v)
                ends.append(-(dense_jacobian(system, work.C).T @ force)[u : u + n])
            slope = (ends[0] - ends[1]) / (2.0 * step)
            exact = stiffness[o : o + n * n].reshape(n, n)[:, k]
            assert np.abs(slope - exact).max() < 1e-9
