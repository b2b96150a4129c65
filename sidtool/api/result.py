"""Result of a simulation for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from sidtool.formats import result as stored
from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.diagnostics.record import warn_of, warn_of_each
from sidtool.formats.result import has_meaningless_numbers, units_in

from ..report.tables import import_optional

if TYPE_CHECKING:
    import pandas
    import xarray


Names = str | Iterable[str]


class HasDiagnostics(Protocol):
    """Protocol: an object with diagnostics."""

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]: ...


Found = TypeVar("Found", bound=HasDiagnostics)


@dataclass(frozen=True, eq=False, repr=False)
class Result(stored.Result):
    __doc__ = f"""{stored.Result.__doc__}
    `result["rod.tip.vx"]` is an output over the times `t`, recorded or not; `*` stands
    for any letters: `result["rod.q*"]`, (nt, n).
    """

    def __getitem__(self, name: str) -> Array:
        """Return an output over time (nt,), or all outputs of a name with `*`, (nt, n).

        The outputs need not be recorded.

        Raises
        ------
        InputError : no output has this name.
        """
        if name in self.names:
            return super().__getitem__(name)
        columns = self.outputs(name)
        return np.column_stack(list(columns.values())) if "*" in name else columns[name]

    def outputs(self, names: Names | None = None) -> dict[str, Array]:
        """Return outputs by name, see `sidtool.outputs`; default the recorded ones."""
        from ..pipeline.extra_outputs import outputs

        wanted = self.names if names is None else names
        return outputs(self, wanted)

    def unit(self, name: str) -> str:
        """Return the unit of an output, or "" if it has none; see `unit_of`."""
        return units_in(self)(name)

    @property
    def units(self) -> dict[str, str]:
        """The units of the outputs that were recorded."""
        return {name: self.unit(name) for name in self.names}

    def to_dataframe(self, names: Names | None = None) -> pandas.DataFrame:
        """Return a pandas table: index t [s], a column per output, units in `attrs`.

        Raises
        ------
        InputError : pandas is not installed, or there is no such output.
        """
        pandas = import_optional("pandas")
        columns = self.outputs(names)
        table = pandas.DataFrame(columns, index=pandas.Index(self.t, name="t"))
        table.attrs["units"] = {name: self.unit(name) for name in columns} | {"t": "s"}
        return table

    def to_xarray(self, names: Names | None = None) -> xarray.Dataset:
        """Return an xarray data set over t [s] with a variable and its unit per output.

        Raises
        ------
        InputError : xarray is not installed, or there is no such output.
        """
        xarray = import_optional("xarray")
        columns = self.outputs(names)
        variables = {n: ("t", v, {"units": self.unit(n)}) for n, v in columns.items()}
        times = {"t": ("t", self.t, {"units": "s"})}
        return xarray.Dataset(variables, times, {"title": self.title})

    def plot(
        self,
        names: Names | None = None,
        *,
        kind: str = "outputs",
        path: str | Path | None = None,
    ) -> Any:
        """Return a matplotlib figure of outputs over time, default the recorded ones.

        kind : "outputs", "spectrum", "energy", "drift" or "sections", as of `sidtool
            plot`
        path : file to which the figure is written as well (.png, .svg, .pdf)

        Raises
        ------
        InputError : there is no such output, or too few times.
        """
        from ..plot.figure import figure_style, save_figure
        from ..plot.results import draw_result

        with figure_style():
            page, notes = draw_result(self, kind, names)
            if path is not None:
                save_figure(page, Path(path))
        for each in notes:
            warn_of(each)
        return page

    def animate(self, path: str | Path, **settings: Any) -> list[str]:
        """Write a page (.html) or film (.gif, .mp4), see `sidtool.animate`."""
        from ..view.animation import animate

        return animate(self, path, **settings)

    def save(self, path: str | Path) -> None:
        """Write the result (.h5), or its outputs as a table (.csv).

        Raises
        ------
        InputError, OSError : the file cannot be written.
        """
        from ..pipeline.files import write

        write(path, self)

    def __repr__(self) -> str:
        span = f"{len(self.t)} times to {self.t[-1]:g} s" if len(self.t) else "no times"
        kind = "failed" if has_meaningless_numbers(self) else "unfinished"
        ended = "" if self.completed else f", {kind}: {self.message}"
        return f"<Result {self.title!r}: {len(self.names)} outputs, {span}{ended}>"

    def _repr_html_(self) -> str:
        from ..report.result import run_overview

        rows = [
            (name, f"{column.min():.6g}", f"{column.max():.6g}", self.unit(name))
            for name, column in zip(self.names, self.values.T, strict=True)
            if len(column)
        ]
        header = ("output", "least", "most", "unit")
        return run_overview(self).html + html_table(rows, header, self.title)


def emit_warnings(result: Found) -> Found:
    """Emit the warnings of a result to the caller of sidtool and return the result."""
    warn_of_each(result.diagnostics)
    return result


def to_user_result(
    result: stored.Result, *programs: Mapping[str, Any] | None
) -> Result:
    """Return the result as the public class, with the callables of its run."""
    user_result = Result.__new__(Result)
    laws = {name: law for each in programs for name, law in (each or {}).items()}
    user_result.__dict__.update(result.__dict__, laws=laws)
    return user_result
