"""Arrays of a body for Exudyn's `ObjectFFRFreducedOrder`.

Source: J. Gerstmayr, Exudyn user documentation, section ObjectFFRFreducedOrder;
A. Zwoelfer, J. Gerstmayr, "The nodal-based floating frame of reference formulation with
modal reduction", Acta Mechanica 232, 2021.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sidtool.formats.base.sid import SID, Array, symmetric_3x3
from sidtool.formats.sid_mass import body_size, skew

from .inertia_integrals import inertia_integrals

#: Distance of the points around a node, over the size of the body.
_ARM = 0.01
#: Points of a node: itself, and two along each axis.
_ARMS = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
#: Parameters of `ObjectFFRFreducedOrder` among the arrays.
MATRICES = ("massMatrixReduced", "stiffnessMatrixReduced", "dampingMatrixReduced")


def exudyn_arrays(sid: SID, nodes: Sequence[str]) -> dict[str, Array]:
    """Return the arrays of a body by the names of Exudyn's parameters.

    Each node of the SID becomes seven mesh nodes, one at its place and six at a small
    distance on the axes, fixed to it. `MarkerSuperElementRigid` with the six and equal
    weights has its displacement and rotation.

    Parameters
    ----------
    nodes : ids of the nodes of the SID

    Returns
    -------
    massMatrixReduced, stiffnessMatrixReduced, dampingMatrixReduced : (nq, nq)
    modeBasis : (21 n, nq); referencePositions : (21 n,)
    mass : (); inertia : (3, 3) about the origin of the frame; centerOfMass : (3,)
    mPsiTildePsi, mPsiTildePsiTilde, mPhitTPsi, mPhitTPsiTilde, mXRefTildePsi,
    mXRefTildePsiTilde : inertia integrals
    nodeNames : (n,) ids; markerNodes : (n, 7) mesh nodes of each, the first in place

    Raises
    ------
    InputError : there is no such node, or the body has geometric stiffening.
    """
    nq = sid.nq
    integrals = inertia_integrals(sid)
    arms = _ARM * body_size(sid) * _ARMS
    points = [sid.node(node) for node in nodes]
    basis = [
        point.phi.m0 - skew(arm) @ point.psi.m0 for point in points for arm in arms
    ]
    places = [point.position + arm for point in points for arm in arms]
    count = len(points) * len(arms)
    products = -integrals.shape_shape.transpose(0, 2, 1, 3)
    return {
        "massMatrixReduced": sid.Me.m0,
        "stiffnessMatrixReduced": sid.Ke.m0,
        "dampingMatrixReduced": sid.De.m0,
        "modeBasis": np.vstack(basis),
        "referencePositions": np.concatenate(places),
        "mass": np.array(sid.mass),
        "inertia": symmetric_3x3(sid.J.m0[:, 0]),
        "centerOfMass": sid.mdCM.m0[:, 0] / sid.mass,
        "mPsiTildePsi": -integrals.shape_cross.transpose(0, 2, 1).reshape(3 * nq, nq),
        "mPsiTildePsiTilde": products.reshape(3 * nq, 3 * nq),
        "mPhitTPsi": integrals.translation,
        "mPhitTPsiTilde": np.hstack(list(skew(integrals.translation.T))),
        "mXRefTildePsi": -integrals.rotation,
        "mXRefTildePsiTilde": np.hstack(list(-integrals.position_shape)),
        "nodeNames": np.array(list(map(str, nodes))),
        "markerNodes": np.arange(count).reshape(len(points), len(arms)),
    }
