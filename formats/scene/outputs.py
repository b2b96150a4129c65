"""The grammar of output names.

BODY.QUANTITY, BODY.MARKER.QUANTITY or JOINT.fK, where BODY may be followed by a marker
name or, for a SID, a node id. Quantities of a body: x y z, angle, vx vy vz, wx wy wz,
ax ay az, qN, vqN, and q*, vq* for all of them. Quantities of a marker: x y z,
vx vy vz, ax ay az. JOINT.fK is the K-th multiplier of a joint, JOINT.f* all of them.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from ..errors import InputError

MARKER_QUANTITIES = frozenset(["x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"])
BODY_QUANTITIES = MARKER_QUANTITIES | frozenset(["angle", "wx", "wy", "wz"])
ELASTIC = re.compile(r"(q|vq)([1-9]\d*|\*)")
MULTIPLIER = re.compile(r"f([1-9]\d*|\*)")
NAME = re.compile(r"[^\W\d][\w-]*")

_EXPECTED = "BODY.QUANTITY, BODY.MARKER.QUANTITY or JOINT.f1, such as piston.x"


class OutputName(NamedTuple):
    """The parts of an output name; `marker` is empty for a body or a joint."""

    owner: str
    marker: str
    quantity: str


def parse_output(name: str) -> OutputName:
    """Split an output name.

    Raises
    ------
    InputError : it has another form, or a quantity that does not exist.
    """
    parts = name.split(".")
    if len(parts) not in (2, 3) or not all(parts):
        raise InputError(f"found {name!r}", expected=_EXPECTED)
    owner, quantity = parts[0], parts[-1]
    marker = parts[1] if len(parts) == 3 else ""
    if not is_quantity(quantity, of_marker=bool(marker)):
        known = sorted(MARKER_QUANTITIES if marker else BODY_QUANTITIES)
        more = "" if marker else ", qN, vqN, q*, vq* or fN"
        raise InputError(
            f"found {name!r}", expected=f"a quantity out of {', '.join(known)}{more}"
        )
    return OutputName(owner, marker, quantity)


def is_quantity(text: str, *, of_marker: bool = False) -> bool:
    """True for the word of a quantity, which no marker may have as its name."""
    if of_marker:
        return text in MARKER_QUANTITIES
    pattern = ELASTIC.fullmatch(text) or MULTIPLIER.fullmatch(text)
    return text in BODY_QUANTITIES or pattern is not None


def marker_reference(text: str) -> tuple[str, str]:
    """("crank", "pin") of ``crank.pin``; the marker is empty for an origin alone.

    Raises
    ------
    InputError : more than one dot, or nothing beside it.
    """
    body, dot, marker = text.partition(".")
    if not body or "." in marker or (dot and not marker):
        raise InputError(f"found {text!r}", expected="BODY.MARKER or ground")
    return body, marker
