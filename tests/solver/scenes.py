"""Small scenes for tests of the solver."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.initial_state.assembly import dense_jacobian
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.coordinates import retract
from sidtool.solver.spatial.system_arrays import WorkArrays
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import evaluate, new_work_arrays
from tests.bodies import particle_body

GRAVITY = 9.81


def scene(
    bodies: dict[str, Any],
    joints: dict[str, Any] | None = None,
    drives: dict[str, Any] | None = None,
    end: float = 1.0,
    steps: int = 10,
    record: Sequence[str] = (),
    **more: Any,
) -> SceneFile:
    """A planar scene unless `more` says otherwise."""
    return SceneFile.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar",
            "time": {"end": end, "output_step": end / steps},
            "bodies": bodies,
            "joints": joints or {},
            "drives": drives or {},
            "outputs": {"record": list(record)},
            **more,
        }
    )


def slender_rod(length: float, mass: float = 1.0, **initial: Any) -> dict[str, Any]:
    """A uniform rod along its x axis, with markers a and b at its ends."""
    return {
        "mass": mass,
        "inertia": mass * length**2 / 12,
        "centre_of_mass": [length / 2, 0.0],
        "markers": {"a": {"position": [0.0, 0.0]}, "b": {"position": [length, 0.0]}},
        "initial": initial,
    }


def polynomial(*coefficients: float) -> dict[str, Any]:
    """A drive function in powers of t, lowest first."""
    pieces = [{"from": 0.0, "coefficients": list(coefficients)}]
    return {"type": "polynomial", "pieces": pieces}


def soft_body(
    nq: int,
    seed: int,
    planar: bool = True,
    stiffening: bool = False,
    damped: bool = True,
    nodes: int = 2,
) -> SID:
    """A consistent SID whose stiffness is of the size of its inertia."""
    sid = particle_body(nq, max(8, nq), planar, seed, nodes, stiffening)
    spread = np.diag(np.random.default_rng(seed).uniform(1.0, 20.0, nq))
    return replace(sid, Ke=Taylor(spread), De=Taylor(0.1 * damped * spread))


def with_cubic_energy(sid: SID, seed: int = 0, size: float = 1.0) -> SID:
    """A first-order term of Ke, the same under all exchanges of its indices."""
    nq = sid.nq
    plain = size * np.random.default_rng(seed).normal(size=(nq, nq, nq))
    orders = list(itertools.permutations(range(3)))
    term: Array = sum(plain.transpose(o) for o in orders) / len(orders)
    return replace(sid, Ke=Taylor(sid.Ke.m0, term))


class Probe:
    """Dense matrices of eq. (3) at one state; variations in the tangent space."""

    def __init__(self, system: System, t: float, z: Array, v: Array) -> None:
        self.system, self.t, self.z, self.v = system, t, z, v
        self.work: WorkArrays = new_work_arrays(system)
        self.work.interval_time[0] = t
        self.evaluate(z, v)
        self.frame = self.work.frame.copy()

    def evaluate(self, z: Array, v: Array) -> None:
        evaluate(self.system, self.work, self.t, z, v)

    def moved(self, dz: Array) -> Array:
        """z_I after a small tangent step from the state."""
        z = self.z.copy()
        retract(self.system.arrays, self.frame, z, dz)
        return z

    def blocks(self, entries: Array) -> Array:
        """Per-body blocks as one dense matrix."""
        n = self.system.n_velocities
        dense = np.zeros((n, n))
        for row in self.system.arrays.body:
            k, o, u = row[at.NV], row[at.BLOCK], row[at.VEL]
            dense[u : u + k, u : u + k] = entries[o : o + k * k].reshape(k, k)
        return dense

    def rows(self, entries: Array) -> Array:
        """Constraint segments as one dense matrix."""
        return dense_jacobian(self.system, entries)

    @property
    def mass(self) -> Array:
        return self.blocks(self.work.M)

    @property
    def jacobian(self) -> Array:
        return self.rows(self.work.C)

    @property
    def same_body(self) -> Array:
        """True where row and column of a velocity-sized matrix share a body."""
        return self.blocks(np.ones_like(self.work.M)) > 0.0

    def unbalance(self, acceleration: Array, multipliers: Array) -> tuple[Array, Array]:
        """M z_II' - f - C^T lambda and C z_II' - gamma at the evaluated state."""
        C, row = self.jacobian, self.work.row
        force = self.mass @ acceleration - self.work.f - C.T @ multipliers
        return force, C @ acceleration - row[:, at.C_GAMMA]


def compiled(scene_file: SceneFile, **sids: SID) -> System:
    """A compiled scene whose bodies have the given SIDs instead of files."""
    return compile_scene(scene_file, sids=sids)
