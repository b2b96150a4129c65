"""Shape functions of a body in a planar scene that move it out of the plane.

Joints, springs and forces of a planar scene hold and load motions in the plane z = 0
alone: displacements along x and y and rotations about z. Shape functions that move the
markers along z, or turn them about x and y, would be free of all of them. Where they
are apart from those in the plane, nothing of a planar scene excites them, and they are
left out. Where both are coupled, as in a twisted blade, a planar joint would have to
hold what it does not know: such a body moves in space.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.sid import SID, Array

#: Motions and couplings below this part of the largest are none: by Poisson's ratio a
#: marker beside the middle surface of a solid moves so far across.
NEGLIGIBLE = 1e-3
#: Squares of frequencies that differ less belong to modes in any combination.
SAME_FREQUENCY = 1e-6


def out_of_plane(
    sid: SID, nodes: Iterable[str], is_held: bool, place: str
) -> tuple[int, ...]:
    """Indices of shape functions that move a body out of the plane alone.

    Parameters
    ----------
    nodes : ids of the nodes that the scene has markers at
    is_held : whether the frame of the body does not move, whatever its momenta

    Raises
    ------
    InputError : what loads in the plane excite moves the body out of it.
    """
    if sid.nq == 0:
        return ()
    inside, across = _motions(sid, nodes, is_held)
    moves_inside, moves_across = _largest(inside), _largest(across)
    leaving = moves_across > NEGLIGIBLE * moves_inside
    if not leaving.any():
        return ()
    for modes in _modes(sid):
        if _are_coupled(inside @ modes, across @ modes):
            numbers = ", ".join(str(k + 1) for k in np.flatnonzero(leaving)[:6])
            raise InputError(
                f"its shape functions {numbers} move it out of the plane z = 0 and are "
                "coupled with motions in the plane: joints of a planar scene do not "
                "hold them",
                place=place,
                expected='dimension = "spatial"',
            )
    alone = leaving & (moves_inside <= NEGLIGIBLE * moves_across)
    if not _are_apart(sid, alone):
        return ()  # modes of one frequency in any combination: none across is excited
    return tuple(int(k) for k in np.flatnonzero(alone))


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


def _modes(sid: SID) -> Iterator[Array]:
    """(nq, n) the modes of the body with its frame held, those of one frequency
    together."""
    Me = 0.5 * (sid.Me.m0 + sid.Me.m0.T)
    values, vectors = np.linalg.eigh(Me)
    known = values > 1e-12 * values.max()
    root = vectors[:, known] / np.sqrt(values[known])
    squares, modes = np.linalg.eigh(root.T @ (0.5 * (sid.Ke.m0 + sid.Ke.m0.T)) @ root)
    jumps = np.diff(squares) > SAME_FREQUENCY * np.abs(squares[1:])
    for part in np.split(np.arange(len(squares)), np.flatnonzero(jumps) + 1):
        yield root @ modes[:, part]


def _are_coupled(inside: Array, across: Array) -> bool:
    """Whether combinations of modes of one frequency that loads in the plane excite
    move out of it."""
    largest = max(float(np.abs(inside).max()), float(np.abs(across).max()))
    _, sizes, right = np.linalg.svd(inside, full_matrices=False)
    excited = right[sizes > NEGLIGIBLE * largest].T
    return bool(np.abs(across @ excited).max(initial=0.0) > NEGLIGIBLE * largest)


def _largest(rows: Array) -> Array:
    return np.asarray(np.abs(rows).max(axis=0))


def _are_apart(sid: SID, alone: NDArray[np.bool_]) -> bool:
    """Whether neither stiffness nor mass couples some shape functions with the others,
    nor rotation in the plane loads them."""
    for matrix in (sid.Ke.m0, sid.Me.m0):
        own = np.sqrt(np.abs(np.diag(matrix)))
        allowed = NEGLIGIBLE * np.outer(own[alone], own[~alone])
        if (np.abs(matrix[np.ix_(alone, ~alone)]) > allowed).any():
            return False
    spun = np.abs(sid.Oe.m0[alone, 2])
    return bool((spun <= NEGLIGIBLE * np.abs(sid.Oe.m0).max(initial=0.0)).all())
