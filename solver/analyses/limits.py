"""Forces whose laws have reached their limits, and give no more."""

from __future__ import annotations

from collections.abc import Iterator

from sidtool.formats.scene.laws import Expression, Pid

from ..space import layout as at
from ..system.scene import System

#: A value is at a limit within this part of it, which differences do not blur.
NEAR = 1e-9


def at_limits(system: System, work: at.Work) -> Iterator[str]:
    """What is said of forces that are at a limit in the state evaluated last."""
    for k, element in enumerate(system.forces):
        force = system.scene.forces.get(element.name) if element.acts else None
        law = getattr(force, "function", None)
        limits = law.limits if isinstance(law, Expression | Pid) else None
        if not element.code or limits is None:
            continue
        value = float(work.factor[k])
        for limit in limits:
            if abs(value - limit) <= NEAR * abs(limit):
                yield f"{element.name} is at its limit of {limit:g}"
