"""What the results of an optimisation and of an identification share."""

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sidtool.formats.base.html import escape
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.file_names import kind_by_ending
from sidtool.formats.storage.hdf5_files import versions


class SearchResult(ABC):
    """The numbers that a search found.

    Attributes
    ----------
    changes : of the scene, by keys as in `Scene.with_`
    model_changes : of models by body, by keys as in `Model.with_`
    diagnostics : of the derivatives
    """

    changes: Mapping[str, float]
    model_changes: Mapping[str, Mapping[str, float]]
    diagnostics: tuple[Diagnostic, ...]

    @abstractmethod
    def data(self) -> dict[str, Any]:
        """Return the data that `--json` prints, and that `save` writes."""

    @abstractmethod
    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Return a matplotlib figure.

        path : file to which the figure is written as well (.png, .svg, .pdf)
        """

    @abstractmethod
    def _heading(self) -> str:
        """Title of the report."""

    @abstractmethod
    def _outcome(self) -> tuple[str, bool]:
        """How it ended and what it took, and whether all is well."""

    @abstractmethod
    def _sections(self) -> Iterator[tuple[str, str]]:
        """Heading and markup of each section of the report before the figure."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the data (.json), the picture (.png, .svg, .pdf) or a report (.html).

        Raises
        ------
        InputError, OSError : the file cannot be written.
        """
        kind = kind_by_ending(path, "optimisation", "picture", "page")
        if kind == "picture":
            self.plot(path)
        elif kind == "page":
            from ..view.html_page import write_page

            write_page(Path(path), self._heading(), self._page_parts())
        else:
            from ..report.json_data import write_json

            write_json(Path(path), self.data())

    def _page_parts(self) -> Iterator[str]:
        from ..report.tables import named_values, set_options
        from ..view.html_page import figure_markup

        outcome, is_well = self._outcome()
        state = "state" if is_well else "state bad"
        yield f"<h1>{escape(self._heading())}</h1><p class='{state}'>{escape(outcome)}"
        yield "</p>"
        for title, markup in self._sections():
            yield f"<h2>{escape(title)}</h2>{markup}"
        yield figure_markup(self.plot())
        if options := set_options(self.changes, self.model_changes):
            yield "<h2>Options that set these numbers</h2>"
            yield "".join(f"<pre>{escape(line)}</pre>" for line in options)
        if self.diagnostics:
            yield "<h2>Diagnostics</h2>"
            yield "".join(f"<p>{escape(each.line)}</p>" for each in self.diagnostics)
        yield "<h2>Versions</h2>" + named_values(versions().items()).html
