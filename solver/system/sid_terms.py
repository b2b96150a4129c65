"""First-order terms of a SID as arrays, and checks of the terms beyond m0.

Geometric stiffening is the first-order term of Ct; K1 is the part of the first-order
term of Ke that has an energy. A body may keep the term q.Me.q of its moment of inertia
where the mass matrix of first order would not be positive.

Shape functions of a body in a planar scene that move it out of the plane.

A planar scene constrains and loads motions in the plane z = 0 only. Shape functions
that move the markers along z, or rotate them about x and y, are not excited if they are
uncoupled from those in the plane: they stay at rest, modes leave them out, and loads do
not change their stiffness. A body in which both are coupled, such as a twisted blade,
is refused: it needs a spatial scene.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array, Taylor
from sidtool.formats.result.accuracy_report import MAX_DEFLECTION
from sidtool.formats.scene import SidBody
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, body_size, coupled_mass_matrix
from sidtool.formats.storage.cache import cached_by_identity

#: Motions below this part of the largest are none: by Poisson's ratio, or on a mesh
#: that is not symmetric, a body leaves the plane so far.
NEGLIGIBLE = 0.03
#: Largest part of a compliance in the plane that holding the body in it may take away.
MAX_COUPLING = 5e-3
#: Squares of frequencies that differ less belong to modes in any combination.
SAME_FREQUENCY = 1e-6

#: A symmetric part of Cr m1 below this part of it, or of Me, which bounds it where
#: nothing stiffens (Cauchy and Schwarz), is rounding in a file.
SYMMETRIC_PART = 1e-9
#: Relative difference of the entries of K1 that rounding in a file makes.
SYMMETRY_ROUNDING = 1e-9
_CONSTANT_BLOCKS = {
    "Me": "a constant Me; inertia that changes is in Ct, Cr, J and Oe",
    "ksigma": "a constant ksigma; what is linear in q belongs to Ke",
    "De": "a constant De",
}


def out_of_plane_momenta(
    sid: SID, nodes: Iterable[str], is_held: bool, place: str
) -> Array:
    """(n, nq) momenta of the motions of a body that nothing in the plane excites: they
    vanish, each a product with the elastic velocities, where these stay in the
    plane.

    Parameters
    ----------
    nodes
        Ids of the nodes that the scene has markers at.
    is_held
        Whether the frame of the body does not move, whatever its momenta.

    Raises
    ------
    InputError
        What loads in the plane excite moves the body out of it.
    """
    in_plane, transverse = _node_motions(sid, nodes, is_held)
    if sid.nq == 0 or not transverse.any():
        return np.zeros((0, sid.nq))
    share = _coupling(sid, in_plane, transverse)
    if share > MAX_COUPLING:
        leaving = _largest_entries(transverse) > NEGLIGIBLE * _largest_entries(in_plane)
        numbers = ", ".join(str(k + 1) for k in np.flatnonzero(leaving)[:6])
        raise InputError(
            f"its shape functions {numbers} move it out of the plane z = 0 and are "
            f"coupled with motions in the plane ({share:.2g} of a compliance): joints "
            "of a planar scene do not hold them",
            place=place,
            expected='dimension = "spatial"',
        )
    momenta = []
    for modes in _modes(sid):
        planar_motion, transverse_motion = in_plane @ modes, transverse @ modes
        largest = max(
            float(np.abs(planar_motion).max()), float(np.abs(transverse_motion).max())
        )
        _, sizes, right = np.linalg.svd(planar_motion, full_matrices=True)
        excited = int(np.sum(sizes > NEGLIGIBLE * largest))
        unexcited = right[excited:].T
        if np.abs(transverse_motion @ unexcited).max(initial=0.0) > 0.0:
            momenta.append((sid.Me.m0 @ modes @ unexcited).T)
    return np.concatenate([np.zeros((0, sid.nq)), *momenta])


def unloaded_across(sid: SID, transverse: Array) -> SID:
    """The SID whose motions out of the plane have no geometric stiffness.

    Markers do not follow these motions, so that a compressed or pushed body would
    buckle in them where it does not in space. Nothing changes while they rest.

    Parameters
    ----------
    transverse : (n, nq)
        Their momenta, see `out_of_plane_momenta`.
    """
    if not len(transverse):
        return sid
    across = np.linalg.lstsq(sid.Me.m0, transverse.T, rcond=None)[0]
    P = np.eye(sid.nq) - across @ transverse

    def in_plane(term: Taylor, form: str) -> Taylor:
        if term.m1 is None:
            return term
        return replace(term, m1=np.einsum(form, term.m1, P, P))

    return replace(
        sid,
        Ct=in_plane(sid.Ct, "kla,ki,lj->ija"),
        Cr=in_plane(sid.Cr, "kla,ki,lj->ija"),
        Oe=in_plane(sid.Oe, "kla,ki,lj->ija"),
        nodes=tuple(
            replace(
                node,
                phi=in_plane(node.phi, "kal,ki,lj->iaj"),
                psi=in_plane(node.psi, "kal,ki,lj->iaj"),
            )
            for node in sid.nodes
        ),
    )


def _modes(sid: SID) -> Iterator[Array]:
    """(nq, n) the modes of the body with its frame held, those of one frequency
    together."""
    values, vectors = np.linalg.eigh(0.5 * (sid.Me.m0 + sid.Me.m0.T))
    known = values > 1e-12 * values.max()
    root = vectors[:, known] / np.sqrt(values[known])
    squares, modes = np.linalg.eigh(root.T @ (0.5 * (sid.Ke.m0 + sid.Ke.m0.T)) @ root)
    jumps = np.diff(squares) > SAME_FREQUENCY * np.abs(squares[1:])
    for part in np.split(np.arange(len(squares)), np.flatnonzero(jumps) + 1):
        yield root @ modes[:, part]


def _node_motions(sid: SID, nodes: Iterable[str], is_held: bool) -> tuple[Array, Array]:
    """(rows, nq) what each shape function does in the plane and across it: motions of
    nodes, and of the body as a whole by the momenta, both in metres."""
    known = set(nodes)
    size = max((float(np.linalg.norm(n.position)) for n in sid.nodes), default=0.0)
    size = size or 1.0
    in_plane, transverse = [np.zeros(sid.nq)], [np.zeros(sid.nq)]
    for node in sid.nodes:
        if node.id in known:
            displacement, rotation = node.phi.m0, size * node.psi.m0
            in_plane += [displacement[0], displacement[1], rotation[2]]
            transverse += [displacement[2], rotation[0], rotation[1]]
    Ct, Cr = sid.Ct.m0.T / sid.mass, sid.Cr.m0.T / (sid.mass * size)
    in_plane += [Ct[0], Ct[1], Cr[2]]
    transverse += [] if is_held else [Ct[2], Cr[0], Cr[1]]
    return np.array(in_plane), np.array(transverse)


def _coupling(sid: SID, in_plane: Array, transverse: Array) -> float:
    """The largest part of a static compliance in the plane that goes where one motion
    across it is held: the squared correlation of both by the compliance."""
    Ke = 0.5 * (sid.Ke.m0 + sid.Ke.m0.T)
    values, vectors = np.linalg.eigh(Ke)
    significant = values > 1e-12 * values.max()
    soft = vectors[:, significant] / np.sqrt(values[significant])
    one, other = in_plane @ soft, transverse @ soft
    inner, outer = (np.square(part).sum(axis=1) for part in (one, other))
    least = NEGLIGIBLE**2 * max(inner.max(), outer.max())
    inner, outer = (np.where(c > least, c, np.inf) for c in (inner, outer))
    return float((np.square(one @ other.T) / np.outer(inner, outer)).max())


def _largest_entries(rows: Array) -> Array:
    return np.asarray(np.abs(rows).max(axis=0))


def cr1(sid: SID) -> Array:
    """First-order term of Cr as (axis, k, l)."""
    return sid.Cr.first_order(sid.nq).transpose(2, 1, 0)


def ge(sid: SID) -> Array:
    """Ge as (axis, k, l), rebuilt as Cr1 - Cr1^T, the exact theory (I8)."""
    kinematic = cr1(sid)
    return kinematic - kinematic.transpose(0, 2, 1)


def oe1(sid: SID) -> Array:
    """First-order term of Oe as (column, k, l), symmetric in k and l (I11)."""
    term = sid.Oe.first_order(sid.nq).transpose(2, 1, 0)
    return 0.5 * (term + term.transpose(0, 2, 1))


def ct1(sid: SID) -> Array:
    """First-order term of Ct as (axis, k, l): geometric stiffening.

    Symmetric in k and l, as Ct(q) is the derivative of mdCM(q).
    """
    term = sid.Ct.first_order(sid.nq).transpose(2, 1, 0)
    return 0.5 * (term + term.transpose(0, 2, 1))


@cached_by_identity
def has_second_order(sid: SID) -> bool:
    """Do Ct and Cr have terms of a displacement field of second order?

    Those are Ct m1 and the part of Cr m1 that is symmetric in the coordinates.
    """
    if sid.nq == 0:
        return False
    cr1_term = cr1(sid)
    symmetric = np.abs(cr1_term + cr1_term.transpose(0, 2, 1)).max(initial=0.0)
    size = max(np.abs(cr1_term).max(initial=0.0), np.abs(sid.Me.m0).max())
    return bool(ct1(sid).any() or symmetric > SYMMETRIC_PART * size)


def without_rotation_blocks(sid: SID) -> SID:
    """A stiffened body without J, Cr and Oe, whose place the mean axes take."""
    if not has_second_order(sid):
        return sid
    J, Cr, Oe = (Taylor(np.zeros_like(b.m0)) for b in (sid.J, sid.Cr, sid.Oe))
    return replace(sid, J=J, Cr=Cr, Oe=Oe)


def cubic_stiffness(sid: SID) -> Array:
    """K1 as (nq, nq, nq): the part of m1 of Ke that has an energy [N m/[q]^3]."""
    force = _quadratic_force(sid)
    return (force + np.moveaxis(force, 0, 1) + np.moveaxis(force, 0, 2)) / 3


def cubic_energies(sid: SID, q: Array) -> Array:
    """What m1 of Ke adds to the energy of deformation at q, coordinate by coordinate.

    q, result : (nt, nq); the energy is the sum [J]. A coordinate has q_k times its part
    of the force, as it has of the quadratic energy.
    """
    if sid.Ke.m1 is None:
        return np.zeros_like(q)
    force: Array = np.einsum("kil,ti,tl->tk", cubic_stiffness(sid), q, q)
    return q * force / 3


@cached_by_identity
def non_potential_fraction(sid: SID) -> float:
    """The part of the force of m1 of Ke that has no energy, relative to the largest."""
    force = _quadratic_force(sid)
    gap = np.abs(force - cubic_stiffness(sid)).max(initial=0.0)
    return float(gap / (np.abs(force).max(initial=0.0) or 1.0))


def check_first_order(sid: SID, source: str, place: str) -> None:
    """True if the equations have all terms of a SID beyond its m0.

    Raises
    ------
    InputError
        A term would be left out, or makes elastic forces without an energy.
    """
    for name, expected in _CONSTANT_BLOCKS.items():
        if getattr(sid, name).first_order(sid.nq).any():
            problem = f"{name} in {source} has a first-order term (m1)"
            raise InputError(problem, place=place, expected=expected)
    terms = [(name, getattr(sid, name)) for name in BLOCK_SHAPES]
    terms += [
        (f"{name} of node {node.id}", getattr(node, name))
        for node in sid.nodes
        for name in NODE_SHAPES
    ]
    for name, term in terms:
        if term is not None and term.mn is not None and term.mn.any():
            raise InputError(
                f"{name} in {source} has terms above the first order (mn)",
                place=place,
                expected="m0 and m1, for the meaning of others is not defined",
            )
    if non_potential_fraction(sid) > SYMMETRY_ROUNDING:
        raise InputError(
            f"the elastic force Ke(q) q of {source} has no energy (m1 of Ke)",
            place=place,
            expected="a term K1_kil q_i q_l that is the same under all exchanges of "
            "k, i and l once it is symmetric in i and l",
        )


def _quadratic_force(sid: SID) -> Array:
    """(k, i, l) coefficient of q_i q_l in row k of the force, symmetric in i and l."""
    term = np.moveaxis(sid.Ke.first_order(sid.nq), 0, 2)
    return (term + np.swapaxes(term, 1, 2)) / 2


def has_quadratic_inertia(body: SidBody, sid: SID, planar: bool) -> bool:
    """True if a body of a scene keeps the term q.Me.q: as the scene says, else where it
    would lose its inertia without.
    """
    if body.quadratic_inertia is not None:
        return body.quadratic_inertia
    return body.frame != "held" and not body.rigid and loses_inertia(sid, planar)


@cached_by_identity
def loses_inertia(sid: SID, planar: bool) -> bool:
    """True if the mass matrix of first order is not positive at some deformation in one
    shape function that linear theory of deformation describes.
    """
    if has_second_order(sid) or not sid.Oe.first_order(sid.nq).any():
        return False
    axes = list(IN_PLANE[2] if planar else SPATIAL)
    scale = np.sqrt(np.abs(sid.Me.m0.diagonal()) / (sid.mass or 1.0))
    for node in sid.nodes:
        scale = np.maximum(scale, np.abs(node.phi.m0).max(axis=0))
    largest = MAX_DEFLECTION * body_size(sid) / np.where(scale > 0.0, scale, np.inf)
    return any(
        _least_remaining_inertia(coupled_mass_matrix(sid, q), axes) <= 0.0
        for way in (1.0, -1.0)
        for q in np.diag(way * largest)
    )


def _least_remaining_inertia(M: Array, axes: list[int]) -> float:
    """Smallest eigenvalue of what the shape functions leave of the inertia of the
    frame, in units of all of it."""
    frame, both, elastic = M[np.ix_(axes, axes)], M[6:, axes], M[6:, 6:]
    size = np.sqrt(np.abs(frame.diagonal()))
    size = np.where(size > 0.0, size, 1.0)
    remaining = (
        frame - both.T @ np.linalg.lstsq(elastic, both, rcond=None)[0]
    ) / np.outer(size, size)
    return float(np.linalg.eigvalsh(0.5 * (remaining + remaining.T))[0])
