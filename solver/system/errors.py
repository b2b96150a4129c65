"""Errors of a run."""

from __future__ import annotations

from sidtool.formats.result import Result


class SimulationError(Exception):
    """A run stopped before its end.

    Attributes
    ----------
    result
        Everything that was computed until then.
    """

    def __init__(self, message: str, result: Result | None = None) -> None:
        super().__init__(message)
        self.result = result
