"""A SID as Exudyn's reduced-order flexible body, and the start-up of Exudyn."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.superelement.body_files import MATRICES, exudyn_arrays


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
    exu: Any, mbs: Any, sid: SID, nodes: Sequence[str], frame: int
) -> tuple[int, int, list[list[int]]]:
    """Adds a flexible body; the object, its modal node, and mesh nodes of each node.

    Parameters
    ----------
    nodes : ids of the nodes of the SID that carry markers
    frame : Exudyn's node of the body frame

    Returns
    -------
    Of each node of the SID the mesh node in its place, and six on arms about it.
    """
    from exudyn import itemInterface as items

    zero = [0.0] * sid.nq
    modal = mbs.AddNode(
        items.NodeGenericODE2(
            numberOfODE2Coordinates=sid.nq,
            referenceCoordinates=zero,
            initialCoordinates=zero,
            initialCoordinates_t=zero,
        )
    )
    arrays = exudyn_arrays(sid, nodes)
    mesh_nodes = arrays.pop("markerNodes").tolist()
    del arrays["nodeNames"]
    given: dict[str, Any] = dict(arrays)
    for name in MATRICES:
        matrix = np.ascontiguousarray(arrays[name])
        given[name] = exu.MatrixContainer()
        given[name].SetWithDenseMatrix(matrix, useDenseMatrix=True)
    given["mass"] = float(arrays["mass"])
    body = mbs.AddObject(
        items.ObjectFFRFreducedOrder(nodeNumbers=[frame, modal], **given)
    )
    return body, modal, mesh_nodes
