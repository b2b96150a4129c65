"""Laws that gave no number, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...equations.forces import programs
from ...functions.native import Native
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
    # What a sampled law holds is a row of its own, as are its states.
    natives = law.natives or tuple(_natives(system, element.name))
    at_time = (n for n in natives if n.failure and n.failure[0] == t)
    native = next(at_time, natives[0] if law.natives else None)
    if native is not None:
        said = native.complaint(t, np.array(list(values.values())[: native.count]))
    known = {name: value for name, value in values.items() if value == value}
    where = ", ".join(f"{name} = {value:.6g}" for name, value in known.items())
    text = f"the law of {element.name} {said} at t = {t:.9g} s"
    return f"{text}, where {where}" if where else text


def _natives(system: System, name: str) -> Iterator[Native]:
    """Callables of all rows of a force."""
    for element in system.forces:
        if element.name == name and element.programmed is not None:
            yield from element.programmed.natives


def rejected_trials(system: System, work: at.Work) -> list[str]:
    """Which laws gave no number where a run could do without it.

    An exception of a callable is a defect of a program, whether the run needed the
    number or not.
    """
    said = lapse(system, work)
    last, found = float(work.lapse[programs.LAPSED_AT]), [said] if said else []
    for name in dict.fromkeys(element.name for element in system.forces):
        for native in _natives(system, name):
            if native.failure is not None and not (said and native.failure[0] == last):
                t, why = native.failure
                found.append(f"the law of {name} {why} at t = {t:.9g} s")
    end = "; steps that ask for it are repeated, outputs that need it are no numbers"
    return [f"{text}{end}" for text in dict.fromkeys(found)]
