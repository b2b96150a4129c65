"""The registry of identities: each a small function, registered by one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from sidtool.formats.sid import SID

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes
    ----------
    measured : the deviation, relative to the largest entry; None if not applicable
    detail : what the number refers to, or why there is none
    broken : failed whatever the deviation says
    bound : replaces the registered bound when it depends on the data
    size : of the largest entry, and
    terms : how many printed entries meet in the difference: what their rounding may
        make of it, see `rounding`
    """

    measured: float | None
    detail: str = ""
    broken: bool = False
    bound: float | None = None
    size: float = 0.0
    terms: int = 0


@dataclass(frozen=True)
class Identity:
    """One registered check; `meaning` says what a failure means for a simulation."""

    id: str
    title: str
    severity: Severity
    bound: float
    meaning: str
    measure: Callable[[SID], Finding]


IDENTITIES: dict[str, Identity] = {}


def identity(
    name: str, title: str, *, severity: Severity, bound: float, meaning: str
) -> Callable[[Callable[[SID], Finding]], Callable[[SID], Finding]]:
    """Register the decorated function as a check; one line adds one."""

    def register(measure: Callable[[SID], Finding]) -> Callable[[SID], Finding]:
        IDENTITIES[name] = Identity(name, title, severity, bound, meaning, measure)
        return measure

    return register
