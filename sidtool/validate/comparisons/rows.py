"""What a comparison is made of: numbers beside their references."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Outcome = Literal["passed", "failed", "shown"]


@dataclass(frozen=True)
class Row:
    """One number beside its reference.

    Attributes
    ----------
    group : what kind of quantity, e.g. "frequencies, frame held [Hz]"
    quantity : which one
    value, reference : the number of the SID and of the reference
    deviation : relative; what it is relative to depends on the group
    tolerance : accepted magnitude of the deviation; None: shown only
    source : where the reference comes from
    """

    group: str
    quantity: str
    value: float
    reference: float
    deviation: float
    tolerance: float | None = None
    source: str = ""

    @property
    def verdict(self) -> Outcome:
        """Passed or failed where a tolerance is given, else only shown."""
        if self.tolerance is None:
            return "shown"
        return "passed" if abs(self.deviation) <= self.tolerance else "failed"


@dataclass(frozen=True)
class Comparison:
    """All rows of a comparison, and notes on what could not be compared and why."""

    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True when no judged row failed."""
        return not any(row.verdict == "failed" for row in self.rows)

    def group(self, start: str) -> tuple[Row, ...]:
        """The rows of all groups whose name starts so."""
        return tuple(row for row in self.rows if row.group.startswith(start))
