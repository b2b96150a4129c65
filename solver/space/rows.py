"""Rows of the tables of a system: what kernels see in place of columns."""

from __future__ import annotations

from numba import int64

from ..compiler.records import RecordType, RowsType


def _integers(name: str, *fields: str) -> RowsType:
    return RowsType(RecordType(name, **dict.fromkeys(fields, int64)))


# In the order of the columns in `layout`
BODY = _integers(
    "Body", "nq", "nv", "rd", "pos", "vel", "np", "block", "seg0", "seg1", "data",
    "flags", "motion", "base", "tip", "drive", "frame",
)  # fmt: skip
MARKER = _integers("Marker", "body", "data", "phi", "phi1", "psi1")
CONSTRAINT = _integers(
    "Constraint", "kind", "row", "a", "b", "seg_a", "seg_b", "data", "drive", "law",
)  # fmt: skip
SEGMENT = _integers("Segment", "row", "body", "offset")
FORCE = _integers(
    "Force", "kind", "a", "b", "seg_a", "seg_b", "data", "law", "time", "turn", "code",
    "owner", "sampled",
)  # fmt: skip
TURN = _integers("Turn", "kind", "a", "b", "data", "entry")
DROPPED = _integers("Dropped", "row", "offset", "size")
