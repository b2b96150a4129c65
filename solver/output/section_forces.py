"""Section forces at recorded states, by equilibrium of the part beyond.

The part of a body beyond a cross-section is in equilibrium with the forces at its
markers, gravity, its inertia, and the force and moment at the section:

    F = sum F_i + m g - p',    M = sum ((d_i - d) x F_i + T_i) + M_g - L',

about the deformed position d of the section, resolved in its axes. p' and L' are the
force rows of eq. (10) and (11) with the mass integrals of the part. Of the whole body
they differ by terms of third order in the deformation from its equations of motion,
which follow from the forces at all markers; each part has its share of this difference
by its mass, so that section forces at both ends are the forces of the joints there.

A section in a ring of members leaves the body connected. Its forces are the work of all
loads, inertia included, on the displacements by unit jumps at the section (influence
functions). Of this work the part that the shape functions have is replaced by their
own section forces, elastic (sigma of the node times the elastic coordinates) and
viscous; the two differ by geometric stiffening (theory, section 7).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    OE_INDICES,
    SID,
    Array,
    Node,
    Section,
    by_mode,
    symmetric_3x3,
)
from sidtool.formats.scene import SECTION_FORCES, OutputName

from ..spatial import system_arrays as at
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.sid_terms import ct1, oe1
from ..system.stiffening import has_stiffening
from ..system.system import System
from .energies import elastic_coordinates
from .samples import EvaluatedForces


def section_force_column(evaluated: EvaluatedForces, name: OutputName) -> Array:
    """One of `SECTION_FORCES` of BODY.SECTION, (nt,)."""
    cache = evaluated.section_forces
    key = name.owner, name.marker
    if key not in cache:
        cache[key] = section_forces(evaluated, *key)
    return cache[key][:, SECTION_FORCES.index(name.quantity)]


def check_section_force(system: System, name: OutputName) -> None:
    """Refuse section forces of what is no section.

    Raises
    ------
    InputError
        The SID has no such section.
    """
    try:
        system.bodies[system.index(name.owner)].sid.section(name.marker)
    except InputError as error:
        place = f"outputs.record, {'.'.join(name)}"
        problem = f"{name.owner}: {error.problem}"
        raise InputError(problem, place=place, expected=error.expected) from None


def section_forces(evaluated: EvaluatedForces, owner: str, name: str) -> Array:
    """N, Vy, Vz, T, My, Mz at a section, (nt, 6) [N, N m].

    They act on the part before the section: a positive N pulls.
    """
    system = evaluated.system
    b = system.index(owner)
    sid = system.bodies[b].sid
    section = sid.section(name)
    motion = _frame_motion(evaluated, b)
    if section.node.sigma is not None:
        return _ring_forces(evaluated, b, section, motion)
    applied = _wrench_of_markers(evaluated, b, None)
    parts_beyond = [s.part for s in sid.sections if s.node.sigma is None]
    start = max(parts_beyond, key=lambda part: part.mass)
    if not has_stiffening(sid):
        start = sid
    residual = applied - _inertia_wrench(sid, motion, start)
    share = section.part.mass / sid.mass if sid.mass else 0.0
    total = _wrench_of_markers(evaluated, b, set(section.beyond))
    total = (
        total - _inertia_wrench(section.part, motion, section.part) - share * residual
    )
    position, axes = _place(section.node, motion.q)
    total[:, 3:] -= np.cross(position, total[:, :3])
    return _in_axes(total, axes)


def _in_axes(vectors: Array, axes: Array) -> Array:
    """Forces and moments (nt, 6) in axes (nt, 3, 3), which are columns."""
    parts = [np.einsum("taj,ta->tj", axes, vectors[:, k : k + 3]) for k in (0, 3)]
    return np.concatenate(parts, axis=1)


def _ring_forces(
    evaluated: EvaluatedForces, b: int, section: Section, motion: _Motion
) -> Array:
    """Section forces (nt, 6) where the section leaves the body connected.

    The last formula of the section forces (theory, section 7).
    """
    sid, part = evaluated.system.bodies[b].sid, section.part
    assert section.node.sigma is not None
    sigma = section.node.sigma.first_order(part.nq)[: sid.nq, :, 0]
    forces: Array = motion.q @ sigma
    if part.nq == sid.nq:  # a file that holds no displacements by jumps
        return forces
    work = _work_of_loads(evaluated, b, part, motion)
    own = np.linalg.solve(sid.Ke.m0, sigma)
    damping = motion.q_dot @ sid.De.m0.T
    forces += work[:, sid.nq :] + (damping - work[:, : sid.nq]) @ own
    _, axes = _place(section.node, np.pad(motion.q, ((0, 0), (0, section.jumps))))
    return _in_axes(forces, section.node.AP.m0.T @ axes)


def _work_of_loads(
    evaluated: EvaluatedForces, b: int, part: SID, motion: _Motion
) -> Array:
    """Forces at markers, gravity and inertia against each shape function (nt, n)."""
    n, (nt, nq) = part.nq, motion.q.shape
    omega, q = motion.omega, np.zeros((nt, n))
    q[:, :nq] = motion.q
    Cr = part.Cr.m0 + np.einsum("lka,tl->tka", part.Cr.first_order(n), q)
    Oe = part.Oe.m0 + np.einsum("lki,tl->tki", part.Oe.first_order(n), q)
    products = np.stack([omega[:, i] * omega[:, j] for i, j in OE_INDICES], axis=1)
    Ge = by_mode(part.Ge.m0, n)[:nq]
    work = -motion.a @ part.Ct.m0.T - np.einsum("tka,ta->tk", Cr, motion.alpha)
    work -= motion.q_ddot @ part.Me.m0[:nq] + np.einsum("tki,ti->tk", Oe, products)
    work -= np.einsum("lka,tl,ta->tk", Ge, motion.q_dot, omega)
    for _, node, force, moment in _loads_at_markers(evaluated, b):
        own = part.node(node)
        work += force @ own.phi.m0 + moment @ own.psi.m0
    return work


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of a body frame and of the elastic coordinates, in body axes.

    Attributes
    ----------
    a : (nt, 3)
        Acceleration of the origin less gravity.
    omega, alpha : (nt, 3)
        Angular velocity and acceleration.
    q, q_dot, q_ddot : (nt, nq)
        Elastic coordinates.
    """

    a: Array
    omega: Array
    alpha: Array
    q: Array
    q_dot: Array
    q_ddot: Array


def _frame_motion(evaluated: EvaluatedForces, b: int) -> _Motion:
    system, samples = evaluated.system, evaluated.samples
    frame = system.frames(samples.frames[:, b])
    R = to_rotation_matrices(frame["R"])
    gravity = to_3d(np.tile(system.arrays.gravity, (len(R), 1)))
    a = to_3d(frame["a"]) - np.einsum("tab,ta->tb", R, gravity)
    omega, alpha = to_3d(frame["w"]), to_3d(frame["al"])
    q, q_dot = elastic_coordinates(system, samples, b)
    row = system.arrays.body[b]
    last = int(row[at.VEL] + row[at.NV])
    q_ddot = samples.accelerations[:, last - int(row[at.NQ]) : last]
    return _Motion(a, omega, alpha, q, q_dot, q_ddot)


def _wrench_of_markers(
    evaluated: EvaluatedForces, b: int, nodes: set[str] | None
) -> Array:
    """Force and moment about the origin of the frame in body axes, (nt, 6).

    Parameters
    ----------
    nodes
        Ids of the nodes that count, all for None.
    """
    system, samples = evaluated.system, evaluated.samples
    total = np.zeros((len(samples.frames), 6))
    for m, node, force, moment in _loads_at_markers(evaluated, b):
        if nodes is not None and node not in nodes:
            continue
        arm = to_3d(system.points(samples.points[:, m])["d"])
        total[:, :3] += force
        total[:, 3:] += moment + np.cross(arm, force)
    return total


def _loads_at_markers(
    evaluated: EvaluatedForces, b: int
) -> Iterator[tuple[int, str, Array, Array]]:
    """Number and node of every marker of a body, force and moment there in body axes,
    (nt, 3) each.
    """
    system, samples = evaluated.system, evaluated.samples
    data = system.bodies[b]
    R = to_rotation_matrices(system.frames(samples.frames[:, b])["R"])
    for (body, name), m in system.markers.items():
        if body == data.name:
            wrench = evaluated.wrench(m)
            force, moment = (
                np.einsum("tab,ta->tb", R, wrench[:, k : k + 3]) for k in (0, 3)
            )
            yield m, data.node(name).id, force, moment


def _inertia_wrench(sid: SID, motion: _Motion, kinematic: SID) -> Array:
    """Rate of momentum less gravity, and its moment about the origin, (nt, 6).

    The first two rows of eq. (10) and (11), with all terms of second order.

    Parameters
    ----------
    kinematic
        Of this mass, without geometric stiffening in Oe.
    """
    q, q_dot, q_ddot = motion.q, motion.q_dot, motion.q_ddot
    omega, alpha, a = motion.omega, motion.alpha, motion.a
    Ct1 = ct1(sid)
    Ct = sid.Ct.m0.T + np.einsum("akl,tl->tak", Ct1, q)
    md = sid.mdCM.m0[:, 0] + np.einsum(
        "tak,tk->ta", sid.Ct.m0.T + 0.5 * np.einsum("akl,tl->tak", Ct1, q), q
    )
    momentum = np.einsum("tak,tk->ta", Ct, q_dot)
    force = sid.mass * a + np.cross(alpha, md) + np.einsum("tak,tk->ta", Ct, q_ddot)
    force += np.cross(omega, np.cross(omega, md)) + 2.0 * np.cross(omega, momentum)
    force += np.einsum("akl,tk,tl->ta", Ct1, q_dot, q_dot)
    J, J_dot = _inertia(sid, kinematic, q, q_dot)
    Cr1 = sid.Cr.first_order(sid.nq)  # [l, k, a]
    Cr = sid.Cr.m0.T + np.einsum("lka,tl->tak", Cr1, q)
    moment = np.cross(md, a) + np.einsum("tab,tb->ta", J, alpha)
    moment += np.cross(omega, np.einsum("tab,tb->ta", J, omega))
    moment += np.einsum("tab,tb->ta", J_dot, omega)
    moment += np.cross(omega, np.einsum("tak,tk->ta", Cr, q_dot))
    moment += np.einsum("tak,tk->ta", Cr, q_ddot)
    moment += np.einsum("lka,tl,tk->ta", Cr1, q_dot, q_dot)
    return np.concatenate([force, moment], axis=1)


def _inertia(sid: SID, kinematic: SID, q: Array, q_dot: Array) -> tuple[Array, Array]:
    """J and its rate, (nt, 3, 3) each; terms of second order follow from Oe m1."""
    J1 = symmetric_3x3(sid.J.first_order(sid.nq)[:, :, 0])
    J2 = np.zeros((sid.nq, sid.nq, 3, 3))
    for (i, j), column in zip(OE_INDICES, oe1(kinematic), strict=True):
        J2[:, :, i, j] = J2[:, :, j, i] = -column * (1.0 if i == j else 0.5)
    J2_q = np.einsum("klab,tl->tkab", J2, q)
    J = symmetric_3x3(sid.J.m0[:, 0]) + np.einsum("tkab,tk->tab", J1 + J2_q, q)
    J_dot = np.einsum("tkab,tk->tab", J1 + 2.0 * J2_q, q_dot)
    return J, J_dot


def _place(node: Node, q: Array) -> tuple[Array, Array]:
    """Deformed position (nt, 3) and axes (nt, 3, 3) of a section, axes in columns."""
    nq = q.shape[1]
    phi1, psi1 = (block.first_order(nq) for block in (node.phi, node.psi))
    phi = node.phi.m0 + 0.5 * np.einsum("lak,tl->tak", phi1, q)
    psi = node.psi.m0 + 0.5 * np.einsum("lak,tl->tak", psi1, q)
    position = node.position + np.einsum("tak,tk->ta", phi, q)
    turn = np.einsum("tak,tk->ta", psi, q)
    from scipy.spatial.transform import Rotation  # a quarter of a second

    return position, Rotation.from_rotvec(turn).as_matrix() @ node.AP.m0
