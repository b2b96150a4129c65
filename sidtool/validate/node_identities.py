"""Identities of the exported nodes and of the counts in the file: I1 to I3."""

from __future__ import annotations

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.sid_mass import skew

from .identity import Finding, finding_of_difference, identity


@identity("I1", bound=0.0)
def count_contradictions(sid: SID) -> Finding:
    """Number of counts that contradict the contents, as the reader noted them."""
    wrong = [each.message for each in sid.diagnostics if each.code == "N842"]
    detail = "; ".join(wrong) or f"{len(sid.nodes)} nodes, {sid.nq} modes"
    return Finding(float(len(wrong)), detail)


@identity("I2", bound=1e-11)
def origin_deviation(sid: SID) -> Finding:
    """Derivative of the node's position against its shape functions."""
    if not sid.nodes or sid.nq == 0:
        return Finding(None, "no shape functions at any node")
    first = np.stack([node.origin.first_order(sid.nq)[:, :, 0] for node in sid.nodes])
    shapes = np.stack([node.phi.m0.T for node in sid.nodes])
    difference = np.abs(first - shapes)
    worst = sid.nodes[int(difference.max(axis=(1, 2)).argmax())].id
    return finding_of_difference(
        difference, first, shapes, detail=f"largest at node {worst}"
    )


@identity("I3", bound=1e-11)
def rotation_deviation(sid: SID) -> Finding:
    """Derivative of the node's orientation against its rotational shape functions."""
    if not sid.nodes or sid.nq == 0:
        return Finding(None, "no shape functions at any node")
    first = np.stack([node.AP.first_order(sid.nq) for node in sid.nodes])
    turned = np.stack([skew(node.psi.m0.T) @ node.AP.m0 for node in sid.nodes])
    difference = np.abs(first - turned)
    worst = sid.nodes[int(difference.max(axis=(1, 2, 3)).argmax())].id
    return finding_of_difference(
        difference, first, turned, detail=f"largest at node {worst}"
    )
