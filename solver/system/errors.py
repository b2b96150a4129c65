"""Errors of a run."""

from collections.abc import Mapping, Sequence

from sidtool.formats.diagnostics import Diagnostic, stop_message
from sidtool.formats.diagnostics.entry import Value
from sidtool.formats.result import Result


class SimulationError(Exception):
    """A run or an analysis stopped before its end.

    Parameters
    ----------
    causes
        What happened, and then its causes.

    Attributes
    ----------
    diagnostics
        The same, see `sidtool explain`.
    result
        Everything that was computed until then.
    """

    def __init__(
        self, causes: Sequence[Diagnostic] | Diagnostic, result: Result | None = None
    ) -> None:
        self.diagnostics = (
            (causes,) if isinstance(causes, Diagnostic) else tuple(causes)
        )
        super().__init__(stop_message(self.diagnostics))
        self.result = result

    @property
    def code(self) -> str:
        """Code of what happened, such as "N302"."""
        return self.diagnostics[0].code

    @property
    def data(self) -> Mapping[str, Value]:
        """Numbers and names of what happened, by name."""
        return self.diagnostics[0].data
