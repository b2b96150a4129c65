"""A diagnostic: one statement on a model, a scene, a run or a result, with its code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from .entry import ERROR, INFO, SEVERITIES, WARNING, Entry, Value, fill


@dataclass(frozen=True)
class Diagnostic:
    """One statement of the program, as data.

    Attributes
    ----------
    code : "N411", see `sidtool explain`; empty for text that has none, such as the
        notes of results that sidtool 0.1 wrote
    severity : "error": a number does not exist or means nothing; "warning": a number
        may be wrong or misleading; "info": true, and nothing has to be done
    message : the fact with its numbers and units
    subject : body, joint, output or file of which it speaks
    remedy : what to do, if anything can be done
    data : the numbers and names in the message, by name; fractions, not per cent
    units : of the numbers that have one
    t : time to which it belongs [s]
    """

    code: str
    severity: str
    message: str
    subject: str = ""
    remedy: str = ""
    data: Mapping[str, Value] = field(default_factory=dict, compare=False)
    units: Mapping[str, str] = field(default_factory=dict, compare=False)
    t: float | None = None

    def __str__(self) -> str:
        """Message and remedy as one line, without the code."""
        fact = f"{self.subject}: {self.message}" if self.subject else self.message
        stop = "" if fact.endswith("?") else "."
        return f"{fact}{stop} {self.remedy}" if self.remedy else fact

    @property
    def message_line(self) -> str:
        """Code, subject and message without the remedy, to be part of an error."""
        return replace(self, remedy="").line

    @property
    def line(self) -> str:
        """The statement with its code, as it is printed."""
        return f"{self.code} {self}" if self.code else str(self)

    def located(self, subject: str) -> Self:
        """The same statement of a subject, unless it has one."""
        return self if self.subject else replace(self, subject=subject)

    def within(self, owner: str) -> Self:
        """The same statement of a part of an owner, such as a marker of a body."""
        subject = f"{owner}, {self.subject}" if self.subject else owner
        return replace(self, subject=subject)

    def as_data(self) -> dict[str, Any]:
        """Return the record for JSON."""
        data = {
            name: {"value": value, "unit": self.units.get(name)}
            for name, value in self.data.items()
        }
        return {
            "code": self.code or None,
            "severity": self.severity,
            "subject": self.subject,
            "message": self.message,
            "data": data,
            "t": self.t,
            "remedy": self.remedy,
        }


class WithDiagnostics:
    """An object with diagnostics, which also gives them as sentences.

    Attributes
    ----------
    diagnostics : what has to be known of its numbers, warnings of validity first
    """

    diagnostics: tuple[Diagnostic, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """All diagnostics as sentences."""
        return texts(self.diagnostics)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences that say that numbers may be wrong."""
        return warning_texts(self.diagnostics)


def from_data(record: Mapping[str, Any]) -> Diagnostic:
    """Return the diagnostic of a record of `Diagnostic.as_data`.

    Raises
    ------
    KeyError, ValueError : it is no such record.
    """
    if record["severity"] not in SEVERITIES:
        raise ValueError(f"a diagnostic has the severity {record['severity']!r}")
    entries = record["data"].items()
    return Diagnostic(
        record["code"] or "",
        record["severity"],
        record["message"],
        record["subject"],
        record["remedy"],
        {name: _plain(entry["value"]) for name, entry in entries},
        {name: entry["unit"] for name, entry in entries if entry["unit"]},
        record["t"],
    )


def diagnose(
    code: str, subject: str = "", *, t: float | None = None, **values: Value
) -> Diagnostic:
    """Return the diagnostic of a code.

    Parameters
    ----------
    subject : body, joint, output or file of which it speaks
    t : time to which it belongs [s]
    values : what the message and the remedy name; fractions for per cent

    Raises
    ------
    KeyError : there is no such code, or a value that it names is missing.
    """
    from .catalogue import CATALOGUE

    entry = CATALOGUE[code]
    known: dict[str, Value] = dict(values)
    if t is not None:
        known["t"] = t
    return Diagnostic(
        code,
        entry.severity,
        fill(entry.message, known, entry.units),
        subject,
        fill(entry.remedy, known, entry.units),
        {name: _plain(value) for name, value in values.items()},
        {name: entry.data_unit(name) for name in values if entry.units.get(name)},
        t,
    )


def example_of(entry: Entry) -> Diagnostic:
    """Return the diagnostic of an entry with the values of its example."""
    values = dict(entry.example)
    t = values.pop("t", None)
    subject = str(values.pop("subject", ""))
    return diagnose(
        entry.code, subject, t=None if t is None else float(str(t)), **values
    )


def plain_text(text: str, severity: str = INFO) -> Diagnostic:
    """Return a statement without a code."""
    return Diagnostic("", severity, text)


def each_once(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return diagnostics without repetitions."""
    return tuple(dict.fromkeys(diagnostics))


def without(
    diagnostics: Iterable[Diagnostic], ignored: Iterable[str]
) -> tuple[Diagnostic, ...]:
    """Return the diagnostics whose codes are not ignored; errors always stay."""
    codes = frozenset(ignored)
    return tuple(d for d in diagnostics if d.severity == ERROR or d.code not in codes)


def texts(diagnostics: Iterable[Diagnostic], *severities: str) -> tuple[str, ...]:
    """Return the statements of some severities, default all, as sentences."""
    chosen = severities or SEVERITIES
    return tuple(str(d) for d in diagnostics if d.severity in chosen)


def warning_texts(diagnostics: Iterable[Diagnostic]) -> tuple[str, ...]:
    """Return the sentences that say that numbers may be wrong."""
    return texts(diagnostics, ERROR, WARNING)


def count_by_severity(diagnostics: Iterable[Diagnostic]) -> dict[str, int]:
    """Return how many diagnostics there are of each severity."""
    counts = dict.fromkeys(SEVERITIES, 0)
    for diagnostic in diagnostics:
        counts[diagnostic.severity] += 1
    return counts


def count_by_code(diagnostics: Iterable[Diagnostic]) -> dict[str, int]:
    """Return how often each code occurs; text without a code counts as one code ""."""
    counts: dict[str, int] = {}
    for diagnostic in diagnostics:
        counts[diagnostic.code] = counts.get(diagnostic.code, 0) + 1
    return counts


def _plain(value: Value) -> Value:
    """A value without types of NumPy."""
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        names = tuple(v for v in value if isinstance(v, str))
        return names or tuple(_plain_number(v) for v in value if not isinstance(v, str))
    return _plain_number(value)


def _plain_number(value: float) -> float:
    return value if type(value) is int else float(value)
