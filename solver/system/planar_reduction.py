"""Shape functions of a body in a planar scene that move it out of the plane.

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
from sidtool.formats.base.sid import SID, Array, Taylor

#: Motions below this part of the largest are none: by Poisson's ratio, or on a mesh
#: that is not symmetric, a body leaves the plane so far.
NEGLIGIBLE = 0.03
#: Largest part of a compliance in the plane that holding the body in it may take away.
MAX_COUPLING = 5e-3
#: Squares of frequencies that differ less belong to modes in any combination.
SAME_FREQUENCY = 1e-6


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
