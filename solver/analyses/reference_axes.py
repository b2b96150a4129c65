"""Axes in which the small motions of the bodies are resolved.

The coordinates of a body are resolved in its own axes, in which a steady rotation is at
rest. A point mass has no axes; on a rotor it is resolved in the axes of the body that
carries it. A body that rotates in bearings that do not rotate, such as a gyroscope in
its ring or a rotor on anisotropic springs, has a constant matrix in the axes of what
supports it, not in its own. The deformation of a round shaft is resolved in these, too.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_mass import skew

from ..spatial import system_arrays as at
from ..system.rotations import to_3d, to_rotation_matrices
from .dense_equations import DenseEquations
from .rotated_shapes import rotate_shapes

#: Angular velocities that differ by less than this part of the largest are the same.
EQUAL_ANGULAR_VELOCITY = 1e-9


def axis_angular_velocities(mechanics: DenseEquations) -> Array:
    """Angular velocities (bodies, 3) in inertial axes, at the state evaluated last."""
    frames = mechanics.system.frames(mechanics.work.frame)
    return (to_rotation_matrices(frames["R"]) @ to_3d(frames["w"])[..., None])[..., 0]


def body_axes(mechanics: DenseEquations, v: Array, a: Array) -> Array:
    """Angular velocities (bodies, 3) of the axes of each body, inertial components.

    Parameters
    ----------
    v, a
        Scaled velocities and accelerations (n,) at the state evaluated last. Of several
        bodies that are next to a point mass that one carries it in whose axes its
        velocity changes least.
    """
    system = mechanics.system
    size = 2 if system.planar else 3
    omegas = axis_angular_velocities(mechanics)
    rows = [*zip(system.arrays.body, system.bodies, strict=True)]
    points = {
        b.name: k for k, (row, b) in enumerate(rows) if _is_point_mass(row, b, size)
    }
    known = {b.name: omegas[k] for k, (_, b) in enumerate(rows) if b.name not in points}
    for name, k in points.items():
        u = int(system.arrays.body[k, at.VEL])
        own = slice(u, u + size)
        connected = _connected_bodies(system.scene, name, set(points))
        candidates = [known[c] for c in sorted(connected) if c in known]
        candidates.sort(key=lambda spin: not spin.any())
        if candidates:
            rotations = [skew(spin)[:size, :size] for spin in candidates]
            residuals = [np.linalg.norm(a[own] - R @ v[own]) for R in rotations]
            omegas[k] = candidates[int(np.argmin(residuals))]
    return omegas


def shared_axes(mechanics: DenseEquations, own: Array) -> Iterator[tuple[Array, str]]:
    """Axes that bodies share: those of one of them, with its name, slow ones first.

    First rigid bodies and point masses share them, and flexible bodies are seen in
    their own, then all bodies do. Flexible ones have to be round, see `rotated_shapes`.
    """
    body, bodies = mechanics.system.arrays.body, mechanics.system.bodies
    rigid = body[:, at.NV] == body[:, at.RD]
    yielded: list[Array] = []
    sizes = np.linalg.norm(own, axis=1)
    for k in np.argsort(sizes, kind="stable"):
        distances = [np.linalg.norm(own[k] - spin) for spin in yielded]
        if min(distances, default=np.inf) > EQUAL_ANGULAR_VELOCITY * sizes.max():
            yielded.append(own[k])
            yield np.where(rigid[:, None], own[k], own), bodies[k].name
            if not rigid.all():
                yield np.broadcast_to(own[k], own.shape).copy(), bodies[k].name


def independent_rows(mechanics: DenseEquations) -> Array:
    """True (n,) for velocity coordinates that no rigid connection gives.

    Rigid bodies that are fixed to each other move as one, whose motion is that of the
    first: seen in axes in which the others go round, theirs depends on time.
    """
    system = mechanics.system
    rows = dict(zip((b.name for b in system.bodies), system.arrays.body, strict=True))
    rigid = {name for name, row in rows.items() if row[at.NV] == row[at.RD] > 0}
    leader = {name: name for name in rigid}
    for joint in system.scene.joints.values():
        ends = marker_owners(joint) & rigid
        if joint.type == "fixed" and len(ends) == 2:
            first, second = sorted(
                (leader[name] for name in ends), key=list(rows).index
            )
            leader = {n: first if x == second else x for n, x in leader.items()}
    independent = np.ones(system.n_velocities, bool)
    for name, first in leader.items():
        if name != first:
            row = rows[name]
            independent[row[at.VEL] : row[at.VEL] + row[at.NV]] = False
    return independent


def frame_rotation_matrix(mechanics: DenseEquations, omegas: Array) -> Array:
    """W (n, n), scaled: velocities u in axes of these spins have u' = a - W v."""
    system, n = mechanics.system, mechanics.system.n_velocities
    W = np.zeros((n, n))
    size = 2 if system.planar else 3
    rotations = to_rotation_matrices(system.frames(mechanics.work.frame)["R"])
    rates = omegas - axis_angular_velocities(mechanics)
    bodies = zip(system.arrays.body, system.bodies, rotations, rates, strict=True)
    for row, data, R, rate in bodies:
        u, rd, end = (
            int(x) for x in (row[at.VEL], row[at.RD], row[at.VEL] + row[at.NV])
        )
        local = (np.eye(3) if rd == size else R).T @ rate
        block = skew(local)
        for part in range(u, u + rd, 3) if not system.planar else (u,) if rd else ():
            W[part : part + size, part : part + size] = block[:size, :size]
        if end > u + rd and data.is_scene_body and local.any():
            speed = float(np.linalg.norm(local))
            W[u + rd : end, u + rd : end] = (
                speed * rotate_shapes(data.sid, local / speed).generator
            )
    return W * mechanics.scale / mechanics.scale[:, None]


def unpaired_frequency(mechanics: DenseEquations, omegas: Array) -> float:
    """Lowest angular frequency of a flexible body, seen in axes of these spins, that
    has no partner across the axis; inf if all have, 0 if a body is not round."""
    system = mechanics.system
    rotations = to_rotation_matrices(system.frames(mechanics.work.frame)["R"])
    rates = omegas - axis_angular_velocities(mechanics)
    lowest = np.inf
    for data, R, rate in zip(system.bodies, rotations, rates, strict=True):
        if data.is_scene_body and data.sid.nq and rate.any():
            axis = R.T @ rate / np.linalg.norm(rate)
            lowest = min(lowest, rotate_shapes(data.sid, axis).unpaired)
    return lowest


def _is_point_mass(row: Array, body: object, size: int) -> bool:
    return (
        bool(getattr(body, "is_scene_body", False)) and row[at.NV] == row[at.RD] == size
    )


def _connected_bodies(scene: SceneFile, name: str, points: set[str]) -> set[str]:
    """The bodies nearest to a point mass along joints and drives, else along forces,
    over other point masses."""
    for tables in ((scene.joints, scene.drives), (scene.joints, scene.forces)):
        links = [marker_owners(part) for table in tables for part in table.values()]
        reached, new = set[str](), {name}
        while new:
            reached |= new
            near = set().union(*(link for link in links if link & new)) - reached
            if near - points:
                return near - points
            new = near
    return set()


def marker_owners(part: object) -> set[str]:
    """The bodies whose markers a joint, drive or force names."""
    named: Iterable[str | None] = (
        *(getattr(part, "markers", None) or ()),
        getattr(part, "marker", None),
        getattr(part, "reference", None),
    )
    return {text.partition(".")[0] for text in named if text}
