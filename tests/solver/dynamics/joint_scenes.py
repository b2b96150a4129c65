"""Two bodies and one joint, rigid or flexible, and what every such pair conserves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.system_arrays import WorkArrays
from sidtool.solver.system import work_arrays
from sidtool.solver.system.rotated_markers import to_3d, to_rotation_matrices
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays
from tests.bodies import particle_body

PITCH = 3.0
#: What joints need beside their type.
NUMBERS = {"screw": {"pitch": PITCH, "offset": 0.0}}


def turned(angle: float) -> Array:
    """The rotation by an angle about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def scene(dimension: str, end: float = 1.0, **tables: Any) -> SceneFile:
    """A scene from its tables, with no gravity unless told."""
    head = {"format": "sidtool scene", "version": 1, "dimension": dimension}
    time = {"end": end, "output_step": end / 20}
    return validate_data({**head, "time": time, **tables}, SceneFile)


def soft_body(planar_scene: bool, seed: int) -> SID:
    """An undamped cloud of particles with two slow modes and turning nodes."""
    sid = particle_body(2, 8, planar=planar_scene, seed=seed)
    small = [
        replace(n, psi=Taylor(0.2 * n.psi.m0), AP=Taylor(n.AP.m0)) for n in sid.nodes
    ]
    return replace(
        sid,
        nodes=tuple(small),
        Ke=Taylor(np.diag([400.0, 900.0])),
        De=Taylor(np.zeros((2, 2))),
    )


def pair(dimension: str, joint: dict[str, Any], flexible: bool) -> tuple[Any, Any]:
    """A scene of two moving bodies with one joint between them, and its SIDs."""
    plane = dimension == "planar"
    axes = 2 if plane else 3
    rng = np.random.default_rng(5)
    bodies: dict[str, Any] = {}
    sids = {}
    for k, name in enumerate(("left", "right")):
        spin = rng.normal(size=3)
        initial: dict[str, Any] = {
            "position": rng.normal(size=axes).tolist(),
            "velocity": rng.normal(size=axes).tolist(),
            "angular_velocity": spin[2] if plane else spin.tolist(),
        }
        if flexible:
            sids[name] = soft_body(plane, seed=k)
            bodies[name] = {"sid": name, "markers": {"end": "1"}, "initial": initial}
            bodies[name]["quadratic_inertia"] = True
            continue
        place = rng.normal(size=axes).tolist()
        turn = {"angle": 0.4} if plane else {"axis_angle": rng.normal(size=3).tolist()}
        bodies[name] = {
            "mass": 1.0 + k,
            "inertia": 0.5 if plane else [0.3, 0.4, 0.5],
            "centre_of_mass": rng.normal(size=axes).tolist(),
            "markers": {"end": {"position": place, **turn}},
            "initial": initial,
        }
    more = NUMBERS.get(joint["type"], {})
    joints = {"joint": {"markers": ["left.end", "right.end"], **more, **joint}}
    return scene(dimension, bodies=bodies, joints=joints), sids


def evaluated(system: System, t: float, z: Array, v: Array) -> WorkArrays:
    """Frames, markers, M and constraints at a state."""
    work = new_work_arrays(system)
    work.interval_time[0] = t
    work_arrays.evaluate(system, work, t, z.copy(), v.copy())
    return work


def conserved(system: System, work: WorkArrays, z: Array, v: Array) -> Array:
    """Energy without potentials, linear and angular momentum about the origin."""
    total = np.zeros(7)
    for b, row in enumerate(system.arrays.body):
        n, first = row[at.NV], row[at.VEL]
        if n == 0:
            continue
        M = work.M[row[at.BLOCK] : row[at.BLOCK] + n * n].reshape(n, n)
        speed = v[first : first + n]
        q = z[row[at.POS] + row[at.NP] - row[at.NQ] : row[at.POS] + row[at.NP]]
        elastic = q @ system.bodies[b].sid.Ke.m0 @ q if len(q) else 0.0
        total[0] += 0.5 * (speed @ M @ speed + elastic)
        total[1:] += momenta(system, work, b, v)
    return total


def momenta(system: System, work: WorkArrays, b: int, v: Array) -> Array:
    """Linear and angular momentum (6,) of a body about the origin."""
    row = system.arrays.body[b]
    n, first, rd = row[at.NV], row[at.VEL], row[at.RD]
    M = work.M[row[at.BLOCK] : row[at.BLOCK] + n * n].reshape(n, n)
    own = np.zeros(6)
    own[[0, 1, 5] if system.planar else slice(0, 6)] = (M @ v[first : first + n])[:rd]
    x, R = frame(system, work, b)
    linear = R @ own[:3]
    return np.concatenate([linear, R @ own[3:] + np.cross(x, linear)])


def frame(system: System, work: WorkArrays, b: int) -> tuple[Array, Array]:
    """Position and orientation of a body."""
    f = system.frames(work.frame[b])
    return to_3d(f["x"]), to_rotation_matrices(f["R"])


def marker(
    system: System, work: WorkArrays, name: tuple[str, str]
) -> tuple[Array, Array]:
    """Position and orientation of a marker."""
    p = system.points(work.point[system.markers[name]])
    R = turned(float(p["angle"])) if system.planar else to_rotation_matrices(p["R"])
    return to_3d(p["x"]), R
