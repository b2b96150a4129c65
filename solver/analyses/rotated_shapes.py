"""Rotation of the deformation of a body about an axis of symmetry.

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

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, eigh

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.sid_mass import skew

from ..system.sid_packing import symmetrise

#: Squares of natural frequencies that differ by less than this part are the same: of
#: round bodies, which a mesh may make a little less so.
EQUAL_EIGENVALUE = 1e-2
#: Nodes are on the axis, of bodies that may tilt a little, below this part of the size
#: of the body, and displacements are rounding below this part of a motion of the whole
#: body of the same energy.
ON_AXIS, NO_DISPLACEMENT = 1e-2, 1e-7
#: A group of eigenvectors is not closed if more than this part of it does not turn.
UNPAIRED = 0.1


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
