"""Random rotors about x: their modes against what small motions of a run contain.

Rigid and flexible shafts, round and not, with one or two rigid discs, on bearings of
one or two stiffnesses, with or without damping. At most one of rotor and bearings has
two different directions: the equations are constant in axes that turn, or that do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, linearise, simulate
from sidtool.solver.analyses.linearisation import INERTIAL
from sidtool.solver.system.system import System
from tests.steel_bars import steel_bar

#: Speeds of the push [m/s], [rad/s], and the tolerance of the run. The rotors move by
#: some 1e-6 of their size, which is the unit of the tolerance: a run at 1e-10 has an
#: error of up to 2e-4 of the motion. Products of small quantities are below 1e-7 of it.
SMALL, RTOL = 1e-3, 1e-12
ROWS = 400


@dataclass(frozen=True, eq=False)
class Rotor:
    """A rotor as the table of a scene, at rest relative to axes that turn at `speed`.

    round : whether it is the same in all directions across its axis
    level : whether its bearings are
    """

    table: dict[str, Any]
    speed: float
    round: bool
    level: bool
    sids: dict[str, SID]


@cache
def shaft(width: float, height: float) -> SID:
    return steel_bar(
        width=width,
        height=height,
        elements=8,
        frame={"type": "buckens"},
        reduction={"method": "modal", "modes": 4},
        markers={
            "root": {"node": 1, "parameters": [0]},
            "middle": {"node": 3, "parameters": [0.375]},
            "tip": {"node": 2, "parameters": [1]},
        },
    )


def random_rotor(seed: int) -> Rotor:
    """Odd seeds are flexible; of three one is round on bearings of one stiffness, one
    has bearings of two, and one is not round."""
    rng = np.random.default_rng([21, seed])
    flexible, kind = seed % 2 == 1, (seed // 2) % 3
    speed = float(rng.uniform(20.0, 120.0) * rng.choice([-1.0, 1.0]))
    across = rng.uniform(3e4, 3e5, 2)
    across = across if kind == 1 else across[[0, 0]]
    damping = float(rng.choice([0.0, 30.0]))
    sids = {}
    turning: dict[str, Any] = {"angular_velocity": [speed, 0.0, 0.0]}
    if flexible:
        sids["shaft"] = shaft(0.02, 0.014 if kind == 2 else 0.02)
        bodies: dict[str, Any] = {
            "shaft": {
                "sid": "-",
                "markers": {"a": 1, "middle": 3, "b": 2},
                "initial": turning
                | {"position": (-sids["shaft"].node("1").position).tolist()},
            }
        }
    else:
        transverse = rng.uniform(0.2, 0.6, 2)
        transverse = transverse if kind == 2 else transverse[[0, 0]]
        bodies = {
            "shaft": {
                "mass": float(rng.uniform(4.0, 8.0)),
                "inertia": [float(rng.uniform(0.05, 0.3)), *map(float, transverse)],
                "centre_of_mass": [float(rng.uniform(0.3, 0.7)), 0.0, 0.0],
                "markers": {
                    "a": {},
                    "middle": {"position": [0.375, 0.0, 0.0]},
                    "b": {"position": [1.0, 0.0, 0.0]},
                },
                "initial": turning,
            }
        }
    joints = {}
    for end, x in (("middle", 0.375), ("b", 1.0))[: int(rng.integers(1, 3))]:
        polar = float(rng.uniform(0.01, 0.05))
        bodies[f"disc_{end}"] = {
            "mass": float(rng.uniform(1.0, 5.0)),
            "inertia": [polar, 0.6 * polar, 0.6 * polar],
            "initial": turning | {"position": [x, 0.0, 0.0]},
        }
        joints[f"hub_{end}"] = {
            "type": "fixed",
            "markers": [f"shaft.{end}", f"disc_{end}"],
        }
    forces = {
        f"bearing_{end}": {
            "type": "bushing",
            "markers": [f"ground.{end}", f"shaft.{end}"],
            "stiffness": [2e5, *map(float, across), 0.0, 0.0, 0.0],
            "damping": [damping, damping, damping, 0.0, 0.0, 0.0],
            "shaft": "x",
        }
        for end in "ab"
    }
    table = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"end": 0.25, "output_step": 0.25 / ROWS},
        "ground": {"markers": {"a": {}, "b": {"position": [1.0, 0.0, 0.0]}}},
        "bodies": bodies,
        "joints": joints,
        "forces": forces,
    }
    return Rotor(table, speed, kind != 2, kind != 1, sids)


def compiled(rotor: Rotor, table: dict[str, Any]) -> System:
    described = validate_data(table, SceneFile)
    return compile_scene(described, sids=rotor.sids, keep_joints=True)


def small_motion(rotor: Rotor, seed: int) -> tuple[Array, Array]:
    """Times, and the motion (nt, markers) of the shaft across its axis as y + i z."""
    rng = np.random.default_rng([22, seed])
    bodies = {}
    for name, body in rotor.table["bodies"].items():
        initial = dict(body["initial"])
        push = SMALL * rng.normal(size=3)
        initial["velocity"] = (push * [0.0, 1.0, 1.0]).tolist()
        tilt = np.array([rotor.speed, *(SMALL * rng.normal(size=2))])
        initial["angular_velocity"] = tilt.tolist()
        if name in rotor.sids:
            pushes = SMALL * rng.normal(size=rotor.sids[name].nq)
            initial["elastic_velocity"] = pushes.tolist()
        bodies[name] = body | {"initial": initial}
    names = [f"shaft.{m}" for m in ("a", "middle", "b")]
    record = [f"{name}.{axis}" for name in names for axis in "yz"]
    table = rotor.table | {"bodies": bodies, "outputs": {"record": record}}
    found = simulate(compiled(rotor, table), rtol=RTOL)
    motion = [found[f"{n}.y"] + 1j * found[f"{n}.z"] for n in names]
    return found.t, np.stack(motion, axis=1)


def missing(rotor: Rotor, seed: int) -> dict[str, float]:
    """What of a small motion is no mode, in each of the axes that the modes describe.

    In axes that turn the motion of what is round or not is a sum of `eigenvalues` or
    of `rotating_frequencies`, in those that do not turn of `inertial_frequencies` where
    the rotor is round.

    Raises
    ------
    SimulationError
        No axes make the equations constant.
    """
    found = linearise(compiled(rotor, rotor.table), "start")
    t, inertial = small_motion(rotor, seed)
    turning = inertial * np.exp(-1j * rotor.speed * t)[:, None]
    own = inertial if found.frame == INERTIAL else turning
    motions = {"eigenvalues": (own, found.eigenvalues.imag)}
    if rotor.level:
        motions["rotating"] = (turning, 2.0 * np.pi * found.rotating_frequencies)
    if rotor.round:
        motions["inertial"] = (inertial, 2.0 * np.pi * found.inertial_frequencies)
    values = found.eigenvalues
    return {
        name: _left(t, motion, values.real + 1j * rates)
        for name, (motion, rates) in motions.items()
    }


def _left(t: Array, motion: Array, rates: Array) -> float:
    """What of a motion is not a sum of exponentials of these rates, relative to it."""
    waves = np.exp(np.outer(t, [*rates, *rates.conj()]))
    basis = np.column_stack([np.ones_like(t), t, waves])
    basis = basis / np.linalg.norm(basis, axis=0)
    fit = basis @ np.linalg.lstsq(basis, motion, rcond=1e-12)[0]
    return float(np.abs(motion - fit).max() / np.abs(motion).max())
