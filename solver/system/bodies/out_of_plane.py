"""Shape functions of a body in a planar scene that move it out of the plane.

Joints, springs and forces of a planar scene hold and load motions in the plane z = 0
alone: displacements along x and y and rotations about z. Shape functions that move the
markers along z, or turn them about x and y, would be free of all of them. Where they
are apart from those in the plane, nothing of a planar scene excites them: they rest,
modes leave them out, and loads do not change their stiffness, or they would buckle from
rounding. Where both are coupled, as in a twisted blade, a planar joint
would have to hold what it does not know: such a body moves in space.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import SID, Array, Taylor

#: Motions below this part of the largest are none: by Poisson's ratio, or on a mesh
#: that is not symmetric, a body leaves the plane so far.
NEGLIGIBLE = 0.03
#: Largest part of a compliance in the plane that holding the body in it may take away.
COUPLED = 5e-3
#: Squares of frequencies that differ less belong to modes in any combination.
SAME_FREQUENCY = 1e-6


def out_of_plane(sid: SID, nodes: Iterable[str], is_held: bool, place: str) -> Array:
    """(n, nq) momenta of the motions of a body that nothing in the plane excites: they
    vanish, each a product with the elastic velocities, where these stay in the plane.

    Parameters
    ----------
    nodes : ids of the nodes that the scene has markers at
    is_held : whether the frame of the body does not move, whatever its momenta

    Raises
    ------
    InputError : what loads in the plane excite moves the body out of it.
    """
    inside, across = _motions(sid, nodes, is_held)
    if sid.nq == 0 or not across.any():
        return np.zeros((0, sid.nq))
    share = _coupling(sid, inside, across)
    if share > COUPLED:
        leaving = _largest(across) > NEGLIGIBLE * _largest(inside)
        numbers = ", ".join(str(k + 1) for k in np.flatnonzero(leaving)[:6])
        raise InputError(
            f"its shape functions {numbers} move it out of the plane z = 0 and are "
            f"coupled with motions in the plane ({share:.2g} of a compliance): joints "
            "of a planar scene do not hold them",
            place=place,
            expected='dimension = "spatial"',
        )
    found = []
    for modes in _modes(sid):
        moved, left = inside @ modes, across @ modes
        largest = max(float(np.abs(moved).max()), float(np.abs(left).max()))
        _, sizes, right = np.linalg.svd(moved, full_matrices=True)
        excited = int(np.sum(sizes > NEGLIGIBLE * largest))
        alone = right[excited:].T
        if np.abs(left @ alone).max(initial=0.0) > 0.0:
            found.append((sid.Me.m0 @ modes @ alone).T)
    return np.concatenate([np.zeros((0, sid.nq)), *found])


def unloaded_across(sid: SID, across: Array) -> SID:
    """The SID whose motions out of the plane have no geometric stiffness.

    Markers do not follow these motions, so that a compressed or pushed body would
    buckle in them where it does not in space. Nothing changes while they rest.

    Parameters
    ----------
    across : (n, nq) their momenta, see `out_of_plane`
    """
    if not len(across):
        return sid
    P = np.eye(sid.nq) - np.linalg.lstsq(sid.Me.m0, across.T)[0] @ across

    def inside(term: Taylor, form: str) -> Taylor:
        if term.m1 is None:
            return term
        return replace(term, m1=np.einsum(form, term.m1, P, P))

    return replace(
        sid,
        Ct=inside(sid.Ct, "kla,ki,lj->ija"),
        Cr=inside(sid.Cr, "kla,ki,lj->ija"),
        Oe=inside(sid.Oe, "kla,ki,lj->ija"),
        nodes=tuple(
            replace(
                node,
                phi=inside(node.phi, "kal,ki,lj->iaj"),
                psi=inside(node.psi, "kal,ki,lj->iaj"),
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


def _motions(sid: SID, nodes: Iterable[str], is_held: bool) -> tuple[Array, Array]:
    """(rows, nq) what each shape function does in the plane and across it: motions of
    nodes, and of the body as a whole by the momenta, both in metres."""
    known = set(nodes)
    size = max((float(np.linalg.norm(n.position)) for n in sid.nodes), default=0.0)
    size = size or 1.0
    inside, across = [np.zeros(sid.nq)], [np.zeros(sid.nq)]
    for node in sid.nodes:
        if node.id in known:
            move, turn = node.phi.m0, size * node.psi.m0
            inside += [move[0], move[1], turn[2]]
            across += [move[2], turn[0], turn[1]]
    Ct, Cr = sid.Ct.m0.T / sid.mass, sid.Cr.m0.T / (sid.mass * size)
    inside += [Ct[0], Ct[1], Cr[2]]
    across += [] if is_held else [Ct[2], Cr[0], Cr[1]]
    return np.array(inside), np.array(across)


def _coupling(sid: SID, inside: Array, across: Array) -> float:
    """The largest part of a static compliance in the plane that goes where one motion
    across it is held: the squared correlation of both by the compliance."""
    Ke = 0.5 * (sid.Ke.m0 + sid.Ke.m0.T)
    values, vectors = np.linalg.eigh(Ke)
    firm = values > 1e-12 * values.max()
    soft = vectors[:, firm] / np.sqrt(values[firm])
    one, other = inside @ soft, across @ soft
    inner, outer = (np.square(part).sum(axis=1) for part in (one, other))
    least = NEGLIGIBLE**2 * max(inner.max(), outer.max())
    inner, outer = (np.where(c > least, c, np.inf) for c in (inner, outer))
    return float((np.square(one @ other.T) / np.outer(inner, outer)).max())


def _largest(rows: Array) -> Array:
    return np.asarray(np.abs(rows).max(axis=0))
