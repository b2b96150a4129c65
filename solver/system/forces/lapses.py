"""Laws that gave no number, in words."""

from __future__ import annotations

import numpy as np

from ...equations.forces import programs
from ...space import layout as at
from ..scene import System


def lapse(system: System, work: at.Work, since: float = -np.inf) -> str:
    """Which law gave no number, when, and of what; nothing if all did since a time."""
    if work.lapse[programs.LAPSED] == 0.0 or work.lapse[programs.LAPSED_AT] < since:
        return ""
    element = system.forces[int(work.lapse[programs.LAPSED]) - 1]
    law, t = element.programmed, float(work.lapse[programs.LAPSED_AT])
    assert law is not None
    values = {}
    for name, (index, output) in law.reads.items():
        first = programs.LAPSED_MEASURES + 2 * index
        values[name] = output(float(work.lapse[first]), float(work.lapse[first + 1]))
    said = "gives no finite number"
    if law.natives:
        native = law.natives[0]
        said = native.complaint(t, np.array(list(values.values())[: native.count]))
    known = {name: value for name, value in values.items() if value == value}
    where = ", ".join(f"{name} = {value:.6g}" for name, value in known.items())
    text = f"the law of {element.name} {said} at t = {t:.9g} s"
    return f"{text}, where {where}" if where else text
