"""Identities of the exported nodes and of the counts in the file: I1 to I3."""

from __future__ import annotations

import re

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.sid_mass import skew

from .identity import Finding, finding_of_difference, identity

# How the readers note a count in the file that contradicts its contents.
_COUNT = re.compile(r"\bpromises\b|\bhave no label\b")


@identity(
    "I1",
    "announced counts = nodes, modes and labels",
    severity="error",
    bound=0.0,
    meaning="the file was cut or edited by hand: nodes or modes may be missing",
)
def count_contradictions(sid: SID) -> Finding:
    """Number of counts that contradict the contents, as the reader noted them."""
    wrong = [note for note in sid.dialect.notes if _COUNT.search(note)]
    detail = "; ".join(wrong) or f"{len(sid.nodes)} nodes, {sid.nq} modes"
    return Finding(float(len(wrong)), detail)


@identity(
    "I2",
    "origin m1 = phi m0 at every node",
    severity="error",
    bound=1e-11,
    meaning="positions and velocities of a marker contradict each other: joints on it "
    "create or lose energy",
)
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


@identity(
    "I3",
    "AP m1 = (psi)~ AP m0 at every node",
    severity="error",
    bound=1e-11,
    meaning="orientation and angular velocity of a marker contradict each other: "
    "joints on it create or lose energy",
)
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
