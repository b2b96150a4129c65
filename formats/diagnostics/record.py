"""Diagnostics: statements on a model, a scene, a run or a result, with codes.

All codes with their entries, one diagnostic as data, and as warning of Python.
"""

import inspect
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from . import accuracy, analyses, conversion, files, identities, run, scene
from .entry import ERROR, INFO, SEVERITIES, Entry, Value, fill

#: Subject of the codes of each hundred.
GROUPS = {
    "N1": "Model and conversion",
    "N2": "Scene, units and start",
    "N3": "Run and integration",
    "N4": "Validity: small deformations and shape functions",
    "N5": "Friction, force laws and control laws",
    "N6": "Export to other programs, accuracy on request",
    "N7": "Static equilibrium, natural modes, inverse dynamics and studies",
    "N8": "Files and pictures",
    "N9": "Identities, units and comparison of SIDs",
}

#: Entry of each code.
CATALOGUE: dict[str, Entry] = {}
for _module in (
    conversion,
    run,
    scene,
    files,
    accuracy,
    analyses,
    identities,
):
    for _entry in _module.ENTRIES:
        assert _entry.code not in CATALOGUE, _entry.code
        CATALOGUE[_entry.code] = _entry


def find_code(text: str) -> str:
    """Return the code that a user means: "n411", "N411" and "411" are the same.

    Raises
    ------
    KeyError : there is no such code.
    """
    code = "N" + text.strip().upper().removeprefix("N")
    if code not in CATALOGUE:
        raise KeyError(code)
    return code


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
    def is_warning(self) -> bool:
        """Whether it says that a number may be wrong or is missing."""
        return self.severity != INFO

    @property
    def message_line(self) -> str:
        """Code, subject and message without the remedy, to be part of an error."""
        return replace(self, remedy="").line

    @property
    def line(self) -> str:
        """The statement with its code, as it is printed."""
        return f"{self.code} {self}" if self.code else str(self)

    def within(self, owner: str) -> Self:
        """The same statement of an owner, or of a part of it, such as a marker."""
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
        return tuple(map(str, self.diagnostics))

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences that say that numbers may be wrong."""
        return tuple(str(each) for each in self.diagnostics if each.is_warning)


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
    entry = CATALOGUE[code]
    known = values if t is None else {**values, "t": t}
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
    return diagnose(entry.code, **entry.example)


def plain_text(text: str, severity: str = INFO) -> Diagnostic:
    """Return a statement without a code."""
    return Diagnostic("", severity, text)


def each_once(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return diagnostics without repetitions."""
    return tuple(dict.fromkeys(diagnostics))


def without(
    diagnostics: Iterable[Diagnostic], ignored: Iterable[str]
) -> tuple[Diagnostic, ...]:
    """Return, once each, the diagnostics whose codes are not ignored; errors stay."""
    codes = frozenset(ignored)
    kept = (d for d in diagnostics if d.severity == ERROR or d.code not in codes)
    return each_once(kept)


def stop_message(causes: Sequence[Diagnostic]) -> str:
    """Return in one line when and why a run or an analysis stopped.

    Parameters
    ----------
    causes : what happened first, then its causes
    """
    reason = "; ".join(each.message_line for each in causes if each.is_warning)
    if causes and causes[0].t is not None:
        return f"stopped at t = {causes[0].t:.9g} s: {reason}"
    return reason


def count_by_severity(diagnostics: Iterable[Diagnostic]) -> dict[str, int]:
    """Return how many diagnostics there are of each severity."""
    counts = dict.fromkeys(SEVERITIES, 0)
    for diagnostic in diagnostics:
        counts[diagnostic.severity] += 1
    return counts


def _plain(value: Any) -> Any:
    """A value without types of NumPy."""
    if isinstance(value, str) or type(value) is int:
        return value
    if isinstance(value, Sequence):
        return tuple(v if isinstance(v, str) else _plain(v) for v in value)
    return float(value)


class DiagnosticWarning(UserWarning):
    """A diagnostic that says that numbers may be wrong, see `sidtool explain`.

    `warnings.filterwarnings("ignore", "N411")` switches one code off.

    Attributes
    ----------
    diagnostic : the whole record
    """

    def __init__(self, diagnostic: Diagnostic | str) -> None:
        if isinstance(diagnostic, str):
            diagnostic = plain_text(diagnostic)
        super().__init__(diagnostic.line)
        self.diagnostic = diagnostic

    @property
    def code(self) -> str:
        """Code of the diagnostic; empty for text without one."""
        return self.diagnostic.code

    @property
    def data(self) -> Mapping[str, Value]:
        """Numbers and names of the diagnostic, by name."""
        return self.diagnostic.data


def warn_of(diagnostic: Diagnostic) -> None:
    """Emit a `DiagnosticWarning` at the line outside of sidtool that called it."""
    warn_caller(DiagnosticWarning(diagnostic))


def warn_of_each(diagnostics: Iterable[Diagnostic]) -> None:
    """Emit a `DiagnosticWarning` for each diagnostic but information."""
    for diagnostic in diagnostics:
        if diagnostic.is_warning:
            warn_of(diagnostic)


def warn_caller(warning: Warning) -> None:
    """Emit a warning at the line outside of sidtool that called it."""
    frame, level = inspect.currentframe(), 1
    while frame is not None and _is_ours(frame.f_globals.get("__name__", "")):
        frame, level = frame.f_back, level + 1
    warnings.warn(warning, stacklevel=level)


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == "sidtool"
