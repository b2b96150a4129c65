"""Checks of one SID: every registered identity and its verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.diagnostics.identities import IDENTITY_TEXTS

from ..mesh.unit_systems import check_magnitudes
from . import content_identities, inertia_identities, mass_identities, node_identities
from .identity import IDENTITIES, Finding, Identity, Severity
from .printed_digits import Rounding, rounding_of

Verdict = Literal["passed", "failed", "not applicable"]


@dataclass(frozen=True)
class Check:
    """The outcome of one identity for one SID.

    Attributes
    ----------
    measured : relative deviation, or None if not applicable
    bound : largest deviation that passes
    meaning : what a failure means for a simulation, one sentence
    """

    id: str
    title: str
    severity: Severity
    verdict: Verdict
    measured: float | None
    bound: float
    detail: str
    meaning: str

    @property
    def failed(self) -> bool:
        """True for a failed check, whatever its severity."""
        return self.verdict == "failed"

    @property
    def diagnostic(self) -> Diagnostic:
        """The failure as a diagnostic, N914 for I14."""
        return diagnose(
            IDENTITY_TEXTS[self.id].code,
            deviation=self.measured or 0.0,
            bound=self.bound,
            detail=self.detail,
        )


def check(sid: SID) -> tuple[Check, ...]:
    """Every registered identity applied to one SID, in the order I1 ... I21.

    Raises
    ------
    InputError : an entry is not a finite number below 1e100.
    """
    check_magnitudes(sid)
    print_ = rounding_of(sid)
    ordered = sorted(IDENTITIES.values(), key=lambda entry: int(entry.id[1:]))
    with np.errstate(all="ignore"):
        return tuple(_judge(entry, entry.measure(sid), print_) for entry in ordered)


def verdict(checks: Sequence[Check], *, strict: bool = False) -> bool:
    """True when no error failed; with `strict`, when no warning failed either."""
    return not any(c.failed and (strict or c.severity == "error") for c in checks)


def report(checks: Sequence[Check]) -> list[dict[str, str]]:
    """The checks as rows of texts, for a table on the screen."""
    return [
        {
            "id": c.id,
            "identity": c.title,
            "deviation": "-" if c.measured is None else f"{c.measured:.1e}",
            "bound": f"{c.bound:.0e}",
            "severity": c.severity,
            "verdict": c.verdict,
            "detail": c.detail,
            "meaning": c.meaning if c.failed else "",
        }
        for c in checks
    ]


def checks_as_data(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """The checks as plain dictionaries; keys are the fields of `Check`."""
    return [asdict(c) for c in checks]


def _judge(entry: Identity, finding: Finding, print_: Rounding) -> Check:
    bound = entry.bound if finding.bound is None else finding.bound
    detail, rounded = finding.detail, finding.terms * print_.share(finding.size)
    if finding.terms and finding.measured is not None and finding.measured > bound:
        cost = f"{print_.words}: rounding may make {rounded:.1e} of it"
        if finding.measured <= rounded:
            cost = f"rounding only, the entries are known to {rounded:.0e}: "
            cost += print_.words
        detail = "; ".join(filter(None, [detail, cost])) if rounded > bound else detail
        bound = max(bound, rounded)
    outcome: Verdict = "not applicable"
    if finding.measured is not None:
        good = finding.measured <= bound and not finding.broken
        outcome = "passed" if good else "failed"
    return Check(
        id=entry.id,
        title=entry.title,
        severity=entry.severity,
        verdict=outcome,
        measured=finding.measured,
        bound=bound,
        detail=detail,
        meaning=entry.meaning,
    )


#: Modules that register identities when they are imported.
IDENTITY_MODULES = (
    content_identities,
    inertia_identities,
    mass_identities,
    node_identities,
)
