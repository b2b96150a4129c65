"""Checks of one SID: every registered identity and its verdict.

Printed precision of a file, detected from its numbers.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.diagnostics.identities import IDENTITY_TEXTS

from ..mesh.unit_systems import check_magnitudes
from . import inertia_identities, mass_identities
from .identity import IDENTITIES, Finding, Identity, Severity

#: More digits than this count as exact; see the registered bounds.
_EXACT_DIGITS = 12
_MOST_DECIMALS = 12
#: Largest number of examined numbers, and the least one that is sufficient.
_MAX_NUMBERS, _MIN_NUMBERS = 20_000, 30
#: Share of numbers printed in one way, and share that use the last digit, which is 0 in
#: a tenth of them.
_PRINTED_SHARE, _LAST_DIGIT_SHARE = 0.99, 0.6

Verdict = Literal["passed", "failed", "not applicable"]
#: Modules that register identities when they are imported.
IDENTITY_MODULES = (
    mass_identities,
    inertia_identities,
    mass_identities,
    inertia_identities,
)


@dataclass(frozen=True)
class Rounding:
    """Largest rounding of an entry: absolute, and relative to it. Both 0: exact."""

    absolute: float = 0.0
    relative: float = 0.0
    words: str = ""

    def share(self, size: float) -> float:
        """Return the rounding of an entry relative to the largest one, `size`, of its
        block.
        """
        return self.relative + (self.absolute / size if size > 0.0 else 0.0)


def rounding_of(sid: SID) -> Rounding:
    """Return the rounding that the numbers of a SID show."""
    numbers = _sampled_numbers(sid)
    if len(numbers) < _MIN_NUMBERS:
        return Rounding()
    decimals = _least_decimals(numbers, np.ones_like(numbers), range(1, _MOST_DECIMALS))
    tens = 10.0 ** -np.floor(np.log10(np.abs(numbers)))
    digits = _least_decimals(numbers, tens, range(1, _EXACT_DIGITS - 1))
    if digits is not None:
        words = f"printed with {digits + 1} digits"
        return Rounding(relative=0.5 * 10.0**-digits, words=words)
    if decimals is not None:
        words = f"printed with {decimals} decimals"
        return Rounding(absolute=0.5 * 10.0**-decimals, words=words)
    return Rounding()


def _least_decimals(numbers: Array, scale: Array, places: range) -> int | None:
    """Return the number of decimals that nearly all scaled numbers have, and most of
    them need.
    """
    for place in places:
        fits = _ends_at_decimal(numbers * scale, place)
        if fits.mean() >= _PRINTED_SHARE:
            short = _ends_at_decimal(numbers * scale, place - 1)
            return place if 1.0 - short.mean() >= _LAST_DIGIT_SHARE else None
    return None


def _ends_at_decimal(scaled: Array, place: int) -> Array:
    """Return which numbers have no digits after this decimal, except for binary
    rounding.
    """
    raised = scaled * 10.0**place
    gap = np.abs(raised - np.rint(raised))
    return np.asarray(gap <= 1e-14 * np.abs(raised) + 1e-300)


def _sampled_numbers(sid: SID) -> Array:
    """Return non-zero numbers of all blocks and nodes, sampled evenly."""
    entries = [sid.J, sid.mdCM, sid.Ct, sid.Cr, sid.Gr, sid.Ge, sid.Oe, sid.Me, sid.Ke]
    step = max(1, len(sid.nodes) // 200)
    entries += [t for node in sid.nodes[::step] for t in (node.origin, node.phi)]
    parts = [part for t in entries for part in (t.m0, t.m1) if part is not None]
    numbers = np.concatenate([part.ravel() for part in parts])
    numbers = numbers[numbers != 0.0]
    return numbers[:: max(1, len(numbers) // _MAX_NUMBERS)]


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
