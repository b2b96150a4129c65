"""Diagnostics as warnings of Python."""

import inspect
import warnings
from collections.abc import Iterable, Mapping

from .entry import Value
from .record import Diagnostic, plain_text


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
