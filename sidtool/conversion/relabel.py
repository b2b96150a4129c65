"""Labels of elastic coordinates whose frequencies may no longer be true."""

from __future__ import annotations

import re
from dataclasses import replace

from sidtool.formats.sid import SID

from ..validate import check

#: What takes the place of "Hz" in a label that tells a frequency of another frame.
_FORMER = "hertz in another frame"


def relabelled(sid: SID) -> SID:
    """The SID with "Hz" in its labels only if the frequencies are those of the body."""
    told = replace(sid, labels=tuple(s.replace(_FORMER, "Hz") for s in sid.labels))
    if not any(found.id == "I15" and found.failed for found in check(told)):
        return told
    labels = tuple(re.sub(r"\bHz\b", _FORMER, label) for label in told.labels)
    return replace(told, labels=labels)
