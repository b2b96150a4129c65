"""A SID as Exudyn's reduced-order flexible body, and the start-up of Exudyn.

The matrices are those of `ObjectFFRFreducedOrder`: J. Gerstmayr, Exudyn, section on the
floating frame of reference formulation with reduced order; a tilde is a cross product.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from sidtool.formats.base.sid import OE_INDICES, SID, Array, by_mode, symmetric_3x3


def exudyn() -> Any:
    """The module in its fastest build.

    Raises
    ------
    ImportError : it is not installed.
    """
    sys.exudynFast = True  # type: ignore[attr-defined]
    import exudyn

    return exudyn


def add_body(
    exu: Any, mbs: Any, sid: SID, nodes: Sequence[str], position: Sequence[float]
) -> tuple[int, int, int]:
    """Adds a flexible body in the plane z = 0; its object, frame and modal node.

    Parameters
    ----------
    nodes : ids of the nodes of the SID that carry markers, in the order of the mesh
        nodes of the object
    position : of the body frame [m], which starts without rotation
    """
    from exudyn import itemInterface as items

    frame = mbs.AddNode(
        items.NodeRigidBodyRxyz(
            referenceCoordinates=[*position, *[0.0] * (6 - len(position))]
        )
    )
    modal = mbs.AddNode(
        items.NodeGenericODE2(
            numberOfODE2Coordinates=sid.nq,
            referenceCoordinates=[0.0] * sid.nq,
            initialCoordinates=[0.0] * sid.nq,
            initialCoordinates_t=[0.0] * sid.nq,
        )
    )
    points = [next(n for n in sid.nodes if n.id == node) for node in nodes]
    body = mbs.AddObject(
        items.ObjectFFRFreducedOrder(
            nodeNumbers=[frame, modal],
            massMatrixReduced=_matrix(exu, sid.Me.m0),
            stiffnessMatrixReduced=_matrix(exu, sid.Ke.m0),
            dampingMatrixReduced=_matrix(exu, sid.De.m0),
            modeBasis=np.vstack([point.phi.m0 for point in points]),
            referencePositions=np.concatenate([p.origin.m0[:, 0] for p in points]),
            mass=sid.mass,
            inertia=symmetric_3x3(sid.J.m0[:, 0]),
            centerOfMass=sid.mdCM.m0[:, 0] / sid.mass,
            **_inertia_integrals(sid),
        )
    )
    return body, frame, modal


def _matrix(exu: Any, values: Array) -> Any:
    container = exu.MatrixContainer()
    container.SetWithDenseMatrix(np.ascontiguousarray(values), useDenseMatrix=True)
    return container


def _inertia_integrals(sid: SID) -> dict[str, Array]:
    nq = sid.nq
    translation = sid.Ct.m0.T
    spun = by_mode(sid.Gr.m0, nq) / 2
    crossed = -by_mode(sid.Ge.m0, nq) / 2  # [l, i]: phi_i x phi_l
    return {
        "mPhitTPsi": translation,
        "mPhitTPsiTilde": np.hstack([_skew(column) for column in translation.T]),
        "mXRefTildePsi": -sid.Cr.m0.T,
        "mXRefTildePsiTilde": np.hstack(list(spun)),
        "mPsiTildePsi": crossed.transpose(0, 2, 1).reshape(3 * nq, nq),
        "mPsiTildePsiTilde": _squares(sid),
    }


def _squares(sid: SID) -> Array:
    """(3 nq, 3 nq) blocks (phi_l . phi_i) 1 - phi_i phi_l^T, from Me, Oe and Ge."""
    nq = sid.nq
    assert sid.Oe.m1 is not None
    dyads = np.zeros((nq, nq, 3, 3))
    for k, (a, b) in enumerate(OE_INDICES):
        values = sid.Oe.m1[:, :, k]
        dyads[:, :, a, b] = values + sid.Me.m0 if a == b else values / 2
        dyads[:, :, b, a] = dyads[:, :, a, b]
    # Ge[l, i] = 2 phi_l x phi_i holds what is not symmetric in the axes
    quarter = by_mode(sid.Ge.m0, nq) / 4
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        dyads[:, :, b, a] += quarter[:, :, c]
        dyads[:, :, a, b] -= quarter[:, :, c]
    blocks = np.einsum("li,ab->liab", sid.Me.m0, np.eye(3)) - dyads
    return blocks.transpose(0, 2, 1, 3).reshape(3 * nq, 3 * nq)


def _skew(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
