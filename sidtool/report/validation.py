"""Validation report of a SID as text and data: checks and an optional comparison."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, diagnose, each_once
from sidtool.formats.plausibility import body_warnings
from sidtool.formats.text import counted_noun, wrapped

from ..comparison.block_differences import Comparison, ComparisonRow
from ..comparison.comparison import compare, comparison_report, to_json
from ..validate.checks import Check, check, report, verdict
from ..validate.unit_guess import UnitGuess, guess_units
from .diagnostics import diagnostic_line, diagnostic_lines
from .tables import text_table, title_line

#: Indent of the details of an identity.
_DETAIL = " " * 6


@dataclass(frozen=True)
class Judgement:
    """Checks of one SID, its most likely units, and an optional comparison."""

    checks: tuple[Check, ...]
    units: UnitGuess
    comparison: Comparison | None
    about_body: tuple[Diagnostic, ...] = ()
    written_by: str = ""
    title: str = ""

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return failed identities, doubts about units and the body, what the reader
        assumed, and what was not compared.
        """
        notes = () if self.comparison is None else self.comparison.notes
        return each_once(
            (
                *(check.diagnostic for check in self.checks if check.failed),
                *self.units.diagnostics,
                *self.about_body,
                *(diagnose("N940", reason=note) for note in notes),
            )
        )

    @property
    def doubts(self) -> tuple[Diagnostic, ...]:
        """Return warnings about the body that no identity shows."""
        return tuple(each for each in self.about_body if each.is_warning)

    def good(self, *, strict: bool) -> bool:
        """Return whether nothing failed; with `strict` warnings count as failures."""
        matched = self.comparison is None or self.comparison.passed
        sound = verdict(self.checks, strict=strict) and not (strict and self.doubts)
        return sound and matched


def judge_sid(
    sid: SID,
    reference: str | os.PathLike[str] | None,
    *,
    tolerance: float | None = None,
) -> Judgement:
    """Check a SID and compare it with the file `reference`, if one is given.

    Raises
    ------
    InputError : a file cannot be read or does not fit the SID.
    """
    checks, units = check(sid), guess_units(sid)
    about_body = *body_warnings(sid), *sid.diagnostics
    comparison = None
    if reference is not None:
        comparison = compare(sid, reference, tolerance=tolerance)
    return Judgement(checks, units, comparison, about_body, sid.written_by, sid.title)


def judgement_as_json(judgement: Judgement, *, strict: bool) -> str:
    """Return one JSON document."""
    return to_json(
        judgement.checks,
        judgement.comparison,
        judgement.units,
        judgement.diagnostics,
        judgement.written_by,
        strict=strict,
        has_doubts=bool(judgement.doubts),
    )


def judgement_as_text(
    judgement: Judgement, *, strict: bool, all_rows: bool = False
) -> str:
    """Return a summary, what failed with its meaning, and the verdict in the last line.

    With `all_rows` the tables hold every identity and every compared number.
    """
    checks = judgement.checks
    shown = [check for check in checks if all_rows or check.failed]
    head = [title_line(judgement.title, _verdict_word(judgement, strict=strict))]
    head += [f"written by {judgement.written_by}"] if judgement.written_by else []
    head += [_check_summary(checks), _unit_line(judgement.units)]
    parts = ["\n".join(head)]
    parts += [_check_table(shown)] if shown else []
    parts += _failure_meanings(checks)
    if judgement.comparison is not None:
        parts.append(_comparison_summary(judgement.comparison))
        parts += _comparison_tables(judgement.comparison, all_rows=all_rows)
    infos = [each for each in judgement.diagnostics if not each.is_warning]
    parts += [diagnostic_lines(infos)] if infos else []
    parts.append(_verdict_line(judgement, strict=strict))
    return "\n\n".join(parts)


def _check_summary(checks: tuple[Check, ...]) -> str:
    """Count the identities that hold, and name the one closest to its bound."""
    idle = [each.id for each in checks if each.verdict == "not applicable"]
    held = [each for each in checks if each.verdict == "passed"]
    text = f"identities: {len(held)} of {len(checks) - len(idle)} hold"
    text += f", {len(idle)} not applicable ({', '.join(idle)})" if idle else ""
    shares = [(c.measured / c.bound, c) for c in held if c.measured and c.bound]
    if shares:
        _, closest = max(shares, key=lambda pair: pair[0])
        text += f"; closest to its bound: {closest.id}, "
        text += f"{closest.measured:.1e} of {closest.bound:.0e}"
    return wrapped(text)


def _check_table(checks: Sequence[Check]) -> str:
    """Tabulate identities, with details of each in lines of their own."""
    columns = ("id", "identity", "deviation", "bound", "verdict")
    reported = list(report(checks))
    table = text_table(
        columns, [[row[column] for column in columns] for row in reported]
    )
    head, lines = table.splitlines()[:2], table.splitlines()[2:]
    for row, line in zip(reported, lines, strict=True):
        head.append(line)
        if row["detail"]:
            head.append(wrapped(row["detail"], _DETAIL, _DETAIL))
    return "\n".join(head)


def _failure_meanings(checks: tuple[Check, ...]) -> Iterator[str]:
    for failed in (c for c in checks if c.failed):
        yield f"{diagnostic_line(failed.diagnostic)}\n{wrapped(failed.meaning)}"


def _unit_line(guess: UnitGuess) -> str:
    """Return the most plausible unit system; a SID has no unit field."""
    others = " or ".join(guess.nearly)
    alternatives = f" (a guess; nearly as plausible: {others})" if others else ""
    return wrapped(f"units: {guess.system or 'unknown'}{alternatives}")


def _comparison_summary(comparison: Comparison) -> str:
    """Tabulate, for each group of numbers, the largest deviation and how many miss."""
    columns = ("quantities", "numbers", "largest deviation", "at", "missed")
    rows = []
    for _, members in groupby(comparison.rows, key=lambda row: row.group):
        numbers = list(members)
        name = f"{numbers[0].group}{_row_source(numbers[0])}"
        worst = max(numbers, key=lambda row: abs(row.deviation))
        judged = [row for row in numbers if row.tolerance is not None]
        missed = sum(row.verdict == "failed" for row in judged)
        outcome = f"{missed} of {len(judged)}" if judged else "not judged"
        deviation = f"{worst.deviation:+.2e}"
        rows.append([name, str(len(numbers)), deviation, worst.quantity, outcome])
    return text_table(columns, rows)


def _comparison_tables(comparison: Comparison, *, all_rows: bool) -> Iterator[str]:
    columns = ("quantity", "value", "reference", "deviation", "tolerance", "verdict")
    texts = zip(comparison.rows, comparison_report(comparison), strict=True)
    shown = [pair for pair in texts if all_rows or pair[0].verdict == "failed"]
    for group, members in groupby(shown, key=lambda pair: pair[0].group):
        pairs = list(members)
        rows = [[text[column] for column in columns] for _, text in pairs]
        title = wrapped(f"{group}{_row_source(pairs[0][0])}", "    ")
        yield f"{title}\n{text_table(columns, rows)}"


def _row_source(row: ComparisonRow) -> str:
    return f" ({row.source})" if row.source else ""


def _verdict_word(judgement: Judgement, *, strict: bool) -> str:
    if not judgement.good(strict=strict):
        return "bad"
    return "doubtful" if judgement.doubts + judgement.units.diagnostics else "good"


def _verdict_line(judgement: Judgement, *, strict: bool) -> str:
    failed = [c.severity for c in judgement.checks if c.failed]
    counts = [
        counted_noun(failed.count("error"), "error"),
        counted_noun(failed.count("warning"), "warning"),
    ]
    if judgement.comparison is not None:
        judged = [r for r in judgement.comparison.rows if r.verdict != "shown"]
        missed = sum(r.verdict == "failed" for r in judged)
        text = f"{missed} of {len(judged)} judged reference values missed"
        counts.append(text if judged else "reference not judged: no --tolerance given")
    if doubts := judgement.doubts + judgement.units.diagnostics:
        counts.append(counted_noun(len(doubts), "doubt"))
    word = _verdict_word(judgement, strict=strict)
    return f"{word}: {', '.join(counts)}{' (warnings count)' if strict else ''}"
