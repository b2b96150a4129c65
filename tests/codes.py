"""Diagnostics of results and analyses by code, and errors as one line."""

from __future__ import annotations

import re
from typing import Protocol

import pytest

from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.diagnostics.record import DiagnosticWarning


class HasDiagnostics(Protocol):
    """A result, an analysis or a compiled scene."""

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]: ...


def unwrapped(printed: str) -> str:
    """Printed errors with one line for each: lines that continue one are joined."""
    return re.sub(r"\n +(?!also )", " ", printed)


def codes(found: HasDiagnostics) -> list[str]:
    """The codes of the diagnostics of a result or an analysis, in their order."""
    return [each.code for each in found.diagnostics]


def with_code(found: HasDiagnostics, *wanted: str) -> list[Diagnostic]:
    """The diagnostics with one of some codes."""
    return [each for each in found.diagnostics if each.code in wanted]


def only(found: HasDiagnostics, *wanted: str) -> Diagnostic:
    """The one diagnostic with one of some codes."""
    (diagnostic,) = with_code(found, *wanted)
    return diagnostic


def only_warning(caught: pytest.WarningsRecorder) -> DiagnosticWarning:
    """The one warning that was emitted, of a diagnostic."""
    (warning,) = caught
    assert isinstance(warning.message, DiagnosticWarning)
    return warning.message
