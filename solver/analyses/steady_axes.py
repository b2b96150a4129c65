"""In which axes a steady motion has a matrix that does not depend on time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.spatial.transform import Rotation

from sidtool.formats.sid import Array
from sidtool.formats.sid_mass import skew

from ..errors import SimulationError
from ..space import layout as at
from ..system.bodies.embedded import embedded, matrices
from .axes import common_axes, independent_rows, own_axes, spins_of_bodies
from .mechanics import Mechanics
from .state_matrix import state_matrix

#: The motion is followed by so large an angle [rad].
ANGLE = 0.4
#: Rotations during a run below this angle [rad] are rounding.
STILL = 1e-9
#: Changes of modes by this part, or by rounding of the matrix, are none.
UNCHANGED, ROUNDING = 1e-3, 1e-8
CHANGING = (
    "the equations of small motions change as the bodies turn, in their own axes and "
    "in those that they share: modes are those of this instant, and tell nothing of "
    "the motion (it takes Floquet's theory, or simulate)"
)


def steady_axes(
    mechanics: Mechanics, z: Array, v: Array
) -> tuple[Array, tuple[str, ...]]:
    """Spins (bodies, 3) of the axes in which modes are those of a constant matrix, and
    what is to be known of them; the bodies' own if there are none."""
    mechanics.evaluate(z, v)
    own = own_axes(mechanics, v / mechanics.scale, mechanics.accelerations()[0])
    time = mechanics.system.scene.time
    if np.abs(own).max(initial=0.0) * (time.end - time.start) < STILL:
        return np.zeros_like(own), ()
    if _change(mechanics, z, v, own) < UNCHANGED:
        return own, ()
    for spins, name in common_axes(mechanics, own):
        if _change(mechanics, z, v, spins) < UNCHANGED:
            of = "that do not turn" if name == "ground" else f"that turn with {name}"
            return spins, (f"rigid bodies are seen in axes {of}, others in their own",)
    return own, (CHANGING,)


def _change(mechanics: Mechanics, z: Array, v: Array, spins: Array) -> float:
    """How much the matrix changes along a motion that is steady in these axes, relative
    to each of its modes."""
    small = state_matrix(mechanics, z, v, spins)
    here, N = small.matrix, small.motion
    mechanics.evaluate(z, v)
    own = spins_of_bodies(mechanics)
    spin = float(np.linalg.norm(np.vstack([own, spins]), axis=1).max())
    try:
        there, N_there, turn = _followed(mechanics, z, v, spins, ANGLE / spin)
    except SimulationError:
        return np.inf
    if there.shape != here.shape:
        return np.inf
    places = len(here) - N.shape[1]
    own_rows = independent_rows(mechanics)
    back = [(turn @ N)[own_rows][:, :count] for count in (places, N.shape[1])]
    free = [N_there[own_rows][:, :count] for count in (places, N.shape[1])]
    X = block_diag(*(np.linalg.lstsq(a, b)[0] for a, b in zip(free, back, strict=True)))
    if not len(X) or np.linalg.svd(X, compute_uv=False)[-1] < 0.5:
        return 0.0 if not len(X) else np.inf
    change = np.linalg.solve(X, there @ X) - here
    values, vectors = np.linalg.eig(here)
    sizes = np.maximum(np.abs(values), spin) * (
        np.linalg.norm(vectors[places:], axis=0)
        + spin * np.linalg.norm(vectors[:places], axis=0)
    )
    noise = ROUNDING * np.linalg.norm(here, 2)
    return float(np.max((np.linalg.norm(change @ vectors, axis=0) - noise) / sizes))


def _followed(
    mechanics: Mechanics, z: Array, v: Array, spins: Array, dt: float
) -> tuple[Array, Array, Array]:
    """Matrix and free directions after a steady motion, and how tangents (n,), scaled,
    in the axes turn into those of the bodies there."""
    step, after, turn = np.zeros(len(v)), v.copy(), np.eye(len(v))
    for row, moving in _motions(mechanics, spins, dt):
        u, rd, size = int(row[at.VEL]), int(row[at.RD]), len(moving[0])
        way, rotation, velocity, rate, block = moving
        step[u : u + size], after[u : u + size] = way, velocity
        turn[u : u + size, u : u + size] = block[:size, :size]
        if rd == 6:
            turn[u + 3 : u + 6, u + 3 : u + 6] = block
        rest = slice(u + size, u + rd)
        step[rest], after[rest] = rotation[3 - rd + size :], rate[3 - rd + size :]
    scale, start = mechanics.scale, mechanics.t
    there = mechanics.moved(z, step / scale)
    try:
        mechanics.t = start + dt
        small = state_matrix(mechanics, there, after, spins)
    finally:
        mechanics.t = start
    return small.matrix, small.motion, turn * scale / scale[:, None]


def _motions(
    mechanics: Mechanics, spins: Array, dt: float
) -> Iterator[tuple[Array, tuple[Array, ...]]]:
    """Row of each body that moves, and in its axes the way of its frame and its
    rotation vector; velocity and angular velocity after it, in the axes there; what
    turns from the axes of the given spin into these."""
    system = mechanics.system
    size = 2 if system.planar else 3
    frames, own = system.frames(mechanics.work.frame), spins_of_bodies(mechanics)
    turns, velocities = matrices(frames["R"]), embedded(frames["v"])
    leads = independent_rows(mechanics)
    for k, row in enumerate(system.arrays.body):
        if row[at.RD] == 0:
            continue
        axes = spins[k] if leads[row[at.VEL]] else own[k]
        R = np.eye(3) if row[at.RD] == size else turns[k]
        moving = np.zeros((4, 4))
        moving[:3, :3], moving[:3, 3] = skew(axes), R @ velocities[k]
        carried = expm(dt * moving)
        beside = expm(dt * skew(own[k] - axes))
        A = carried[:3, :3]
        Q = np.eye(3) if row[at.RD] == size else A @ beside @ R
        way = R.T @ carried[:3, 3]
        rotation = Rotation.from_matrix(R.T @ Q).as_rotvec()
        velocity, rate = Q.T @ A @ moving[:3, 3], Q.T @ A @ own[k]
        block = R.T @ beside.T @ R
        yield row, (way[:size], rotation, velocity[:size], rate, block)
