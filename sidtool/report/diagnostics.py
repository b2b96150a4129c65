"""Diagnostics as printed lines, and the explanation of their codes."""

import textwrap
from collections.abc import Iterable, Sequence

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import (
    ERROR,
    INFO,
    SEVERITIES,
    Diagnostic,
    count_by_severity,
)
from sidtool.formats.diagnostics.record import (
    CATALOGUE,
    GROUPS,
    example_of,
    find_code,
    plain_text,
)
from sidtool.formats.text import WIDTH, counted_noun, wrapped

from .tables import text_table

#: Columns of a run in a table of many runs.
_FIRST_RUN = 30
#: Runs under their names, with their diagnostics.
Runs = Sequence[tuple[str, Sequence[Diagnostic]]]


def diagnostic_line(diagnostic: Diagnostic) -> str:
    """Return severity, code, subject, fact and remedy in lines of at most 100 columns.

    The remedy has lines of its own where it does not fit behind the fact.
    """
    whole = f"{diagnostic.severity} {diagnostic.line}"
    if len(whole) <= WIDTH:
        return whole
    lines = [wrapped(f"{diagnostic.severity} {diagnostic.message_line}", "    ")]
    if diagnostic.remedy:
        lines.append(wrapped(diagnostic.remedy, "    ", "    "))
    return "\n".join(lines)


def remark_line(sentence: str) -> str:
    """Return a note, which may begin with its code, as the line of a diagnostic."""
    return diagnostic_line(plain_text(sentence))


def diagnostic_lines(diagnostics: Iterable[Diagnostic], most: int | None = None) -> str:
    """Return the lines of diagnostics, errors and warnings first.

    most : largest number of diagnostics, if it is limited
    """
    ordered = sorted(diagnostics, key=lambda each: SEVERITIES.index(each.severity))
    lines = [diagnostic_line(each) for each in ordered[:most]]
    if len(ordered) > len(lines):
        lines.append(f"... and {len(ordered) - len(lines)} more (-v prints all)")
    return "\n".join(lines)


def severity_counts(diagnostics: Iterable[Diagnostic]) -> str:
    """Return "0 errors, 1 warning, 2 notes"."""
    counts = count_by_severity(diagnostics)
    return ", ".join(
        counted_noun(count, "note" if severity == INFO else severity)
        for severity, count in counts.items()
    )


def first_of_each_code(runs: Runs) -> list[Diagnostic]:
    """Return one diagnostic for each code of many runs, that of the first run."""
    first = {each.code: each for _, found in reversed(runs) for each in reversed(found)}
    return sorted(first.values(), key=lambda each: SEVERITIES.index(each.severity))


def runs_by_code(runs: Runs) -> dict[str, list[str]]:
    """Return the names of the runs that have each code."""
    names: dict[str, list[str]] = {}
    for name, found in runs:
        for code in dict.fromkeys(each.code for each in found):
            names.setdefault(code, []).append(name)
    return names


def table_of_codes(runs: Runs) -> str:
    """Tabulate the codes of many runs: how many runs have them, and the first one.

    Each has one line; the warnings are printed in full before, and `explain` has more.
    """
    names = runs_by_code(runs)
    rows = [
        [
            each.code,
            each.severity,
            f"{len(names[each.code])} of {len(runs)}",
            textwrap.shorten(names[each.code][0], _FIRST_RUN, placeholder="..."),
            each.message_line.partition(" ")[2],
        ]
        for each in first_of_each_code(runs)
    ]
    header = ("code", "severity", "runs", "first run", "what the first run says")
    return text_table(header, rows, brief=True) if rows else ""


def explain(code: str) -> str:
    """Return what a diagnostic means, how its numbers are computed, and what to do.

    Raises
    ------
    InputError : there is no such code.
    """
    entry = CATALOGUE[parse_code(code)]
    example = example_of(entry)
    parts = [
        f"{entry.code} ({entry.severity}): {GROUPS[entry.code[:2]]}",
        diagnostic_line(example),
        wrapped(entry.explanation),
    ]
    if example.remedy:
        parts.append(wrapped(f"What to do: {example.remedy}"))
    if entry.severity != ERROR:
        ignore = f'[diagnostics] ignore = ["{entry.code}"]'
        text = f"Not reported with {ignore} in the scene, or --ignore {entry.code}."
        parts.append(text)
    return "\n\n".join(parts)


def parse_code(text: str) -> str:
    """Return the code that a user names.

    Raises
    ------
    InputError : there is no such code.
    """
    try:
        return find_code(text)
    except KeyError:
        raise InputError(
            f"there is no diagnostic {text!r}",
            expected="a code that `sidtool explain` lists, such as N411",
        ) from None


def list_codes() -> str:
    """Return code, severity and example of all diagnostics, by subject."""
    parts = []
    for group, title in GROUPS.items():
        lines = [
            textwrap.shorten(f"{code}  {example_of(entry).message}", WIDTH)
            for code, entry in CATALOGUE.items()
            if code.startswith(group)
        ]
        parts.append("\n".join([title, *(f"  {line}" for line in lines)]))
    return "\n\n".join(parts)
