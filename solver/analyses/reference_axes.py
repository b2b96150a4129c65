"""Axes in which the small motions of the bodies are resolved.

The coordinates of a body are resolved in its own axes, in which a steady rotation is at
rest. A point mass has no axes; on a rotor it is resolved in the axes of the body that
carries it. A body that rotates in bearings that do not rotate, such as a gyroscope in
its ring or a rotor on anisotropic springs, has a constant matrix in the axes of what
supports it, not in its own. The deformation of a round shaft is resolved in these, too.

Rotation of the deformation of a body about an axis of symmetry.

A round shaft rotates under a deformation that stands still in space. In axes that turn
relative to the body by an angle `theta` about the axis e, its deformation has the
elastic coordinates `expm(theta G) q`. The generator G exists if the shape functions
span a space that such rotations map to itself. They keep the kinetic and the strain
energy, so G only mixes eigenvectors of Ke and Me of equal eigenvalue, and is
skew-symmetric there. Displacements and rotations at points of the axis turn as vectors,

    phi G = e x phi,    psi G = e x psi,    Ct^T G = e x Ct^T,    Cr^T G = e x Cr^T,

which gives one G for each group of equal eigenvalues. A group that moves no point of
the axis keeps to the axes of the body. Whether the equations are constant in such axes
is tried by `steady_axes`; here nothing is refused.

References
----------
G. Genta: Dynamics of Rotating Systems, 2005, section 6.3.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, eigh

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_mass import skew

from ..spatial import system_arrays as at
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.sid_packing import symmetrise
from .dense_equations import DenseEquations

#: Squares of natural frequencies that differ by less than this part are the same: of
#: round bodies, which a mesh may make a little less so.
EQUAL_EIGENVALUE = 1e-2
#: Nodes are on the axis, of bodies that may tilt a little, below this part of the size
#: of the body, and displacements are rounding below this part of a motion of the whole
#: body of the same energy.
ON_AXIS, NO_DISPLACEMENT = 1e-2, 1e-7
#: A group of eigenvectors is not closed if more than this part of it does not turn.
UNPAIRED = 0.1

#: Angular velocities that differ by less than this part of the largest are the same.
EQUAL_ANGULAR_VELOCITY = 1e-9


@dataclass(frozen=True, eq=False)
class RotatedShapes:
    """How the deformation of a body turns about an axis.

    Attributes
    ----------
    generator : (nq, nq)
        G, zero for shape functions that do not turn into each other.
    unpaired
        Lowest natural angular frequency [rad/s] of the body, in its frame, whose motion
        across the axis has no partner; inf if all have one, and 0 if the lower half has
        none, as the body is not round.
    """

    generator: Array
    unpaired: float


def rotate_shapes(sid: SID, axis: Array) -> RotatedShapes:
    """Return how the deformation turns about an axis through the origin of the body.

    Parameters
    ----------
    axis : (3,)
        Unit vector in the body frame.
    """
    try:
        squares, V = eigh(symmetrise(sid.Ke.m0), symmetrise(sid.Me.m0))
    except LinAlgError:
        return RotatedShapes(np.zeros((sid.nq, sid.nq)), 0.0)
    vectors = _axial_vectors(sid, axis, V)
    turned = np.vstack([skew(axis) @ part for part in vectors])
    generator, unpaired = np.zeros((sid.nq, sid.nq)), np.inf
    apart = np.diff(squares) > EQUAL_EIGENVALUE * np.abs(squares[1:])
    for group in np.split(np.arange(sid.nq), np.flatnonzero(apart) + 1):
        here, there = np.vstack(vectors)[:, group], turned[:, group]
        first, second = np.triu_indices(len(group), 1)
        pairs, columns = np.arange(len(first)), np.zeros((len(first), *here.shape))
        columns[pairs, :, second] = here[:, first].T
        columns[pairs, :, first] = -here[:, second].T
        equations = columns.reshape(len(first), here.size).T
        x = np.linalg.lstsq(equations, there.ravel(), rcond=1e-9)[0]
        generator[group[first], group[second]] = x
        generator[group[second], group[first]] = -x
        left = np.linalg.norm(equations @ x - there.ravel())
        if left > UNPAIRED * np.linalg.norm(there):
            is_round = 2 * group[0] >= sid.nq
            lowest = np.sqrt(max(squares[group[0]], 0.0)) if is_round else 0.0
            unpaired = min(unpaired, float(lowest))
    return RotatedShapes(np.asarray(V @ np.linalg.solve(V.T, generator.T).T), unpaired)


def _axial_vectors(sid: SID, axis: Array, V: Array) -> list[Array]:
    """Matrices (3, nq) of vectors that turn with the deformation, of eigenvectors V of
    unit mass, in units of a motion of the whole body of the same energy."""
    positions = np.array([node.position for node in sid.nodes]).reshape(-1, 3)
    offsets = np.linalg.norm(np.cross(positions, axis), axis=1)
    mass, inertia = np.sqrt(sid.mass), np.sqrt(np.abs(sid.J.m0[:3]).sum())
    found = [sid.Ct.m0.T / mass, sid.Cr.m0.T / inertia]
    for node, offset in zip(sid.nodes, offsets, strict=True):
        if offset <= ON_AXIS * np.abs(positions).max():
            found += [node.phi.m0 * mass, node.psi.m0 * inertia]
    vectors = (part @ V for part in found)
    return [np.where(np.abs(x) > NO_DISPLACEMENT, x, 0.0) for x in vectors]


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
