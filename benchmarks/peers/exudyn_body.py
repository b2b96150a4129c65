"""A SID as Exudyn's reduced-order flexible body, and the start-up of Exudyn."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.superelement.exudyn import exudyn_arrays

_INTEGRALS = (
    "mPsiTildePsi",
    "mPsiTildePsiTilde",
    "mPhitTPsi",
    "mPhitTPsiTilde",
    "mXRefTildePsi",
    "mXRefTildePsiTilde",
)


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
    arrays = exudyn_arrays(sid, nodes)
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
            inertia=arrays["inertia"],
            centerOfMass=arrays["centerOfMass"],
            **{name: arrays[name] for name in _INTEGRALS},
        )
    )
    return body, frame, modal


def _matrix(exu: Any, values: Array) -> Any:
    container = exu.MatrixContainer()
    container.SetWithDenseMatrix(np.ascontiguousarray(values), useDenseMatrix=True)
    return container
