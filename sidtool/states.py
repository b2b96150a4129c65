"""What analyses of a state find, for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.html import html_table
from sidtool.solver.analyses import linear, static

from .results import Result, answering, installed

if TYPE_CHECKING:
    import pandas

Found = TypeVar("Found")


class _Named:
    """Numbers by name: `keys()`, `in`, `len` and iteration as of a dictionary."""

    def keys(self) -> tuple[str, ...]:
        """Names of what was found."""
        raise NotImplementedError

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __bool__(self) -> bool:
        return True


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(_Named, static.Equilibrium):
    __doc__ = f"""{static.Equilibrium.__doc__}
    `equilibrium["pin.fy"]` is an output, recorded or not; `keys()`, `in`, `len` and
    iteration tell recorded outputs and all multipliers.
    """

    def result(self) -> Result:
        """The scene's outputs in equilibrium, as a result of one time."""
        return answering(super().result())

    def keys(self) -> tuple[str, ...]:
        """Names of recorded outputs and of all multipliers."""
        return tuple(name for name, _, _ in self.rows())

    def __getitem__(self, name: str) -> float:
        """The value of an output of the scene, recorded or not.

        Raises
        ------
        InputError : no output has this name.
        """
        return float(self.result()[name][0])

    def to_dataframe(self) -> pandas.DataFrame:
        """A pandas table: a row per recorded output and multiplier, with its value and
        its unit.

        Raises
        ------
        InputError : pandas is not installed.
        """
        table = installed("pandas").DataFrame(
            self.rows(), columns=["output", "value", "unit"]
        )
        return table.set_index("output")

    def rows(self) -> list[tuple[str, float, str]]:
        """Recorded outputs and all multipliers, with their values and units."""
        result = self.result()
        names = (*result.names, *result.multiplier_names)
        values = [*result.values[0], *result.multipliers[0]]
        found = dict(zip(names, map(float, values), strict=True))
        return [(name, value, result.unit(name)) for name, value in found.items()]

    def __repr__(self) -> str:
        title = self.system.scene.title
        return f"<Equilibrium {title!r}: unbalanced {self.residual:.1e} of the forces>"

    def _repr_html_(self) -> str:
        rows = [(name, f"{value:.6g}", unit) for name, value, unit in self.rows()]
        notes = html_table([("note", text) for text in self.notes])
        title = self.system.scene.title
        return html_table(rows, ("output", "value", "unit"), title) + notes


@dataclass(frozen=True, eq=False, repr=False)
class Linearisation(_Named, linear.Linearisation):
    __doc__ = f"""{linear.Linearisation.__doc__}
    `modes["frequency"]` is a column of `to_dataframe`; `keys()`, `in`, `len` and
    iteration tell the names of the columns.
    """

    def keys(self) -> tuple[str, ...]:
        """Names of what is known of each mode."""
        return tuple(self._columns())

    def __getitem__(self, name: str) -> np.ndarray:
        """A number of each mode, (n,).

        Raises
        ------
        InputError : there is no such column.
        """
        columns = self._columns()
        if name not in columns:
            expected = f"one of {', '.join(columns)}"
            raise InputError(f"modes have no {name!r}", expected=expected)
        return np.asarray(columns[name])

    def _columns(self) -> dict[str, Any]:
        return {
            "frequency": self.frequencies,
            "inertial_frequency": self.inertial_frequencies,
            "rotating_frequency": self.rotating_frequencies,
            "whirl": list(self.whirl),
            "rigid": self.rigid,
            "damping_ratio": self.damping_ratios,
            "eigenvalue": self.eigenvalues,
        }

    def to_dataframe(self) -> pandas.DataFrame:
        """A pandas table: a row per mode with its frequency [Hz], damping ratio and
        eigenvalue [1/s]; shapes are in `shapes`.

        Raises
        ------
        InputError : pandas is not installed.
        """
        pandas = installed("pandas")
        columns = self._columns()
        numbers = pandas.RangeIndex(1, len(self.frequencies) + 1, name="mode")
        table = pandas.DataFrame(columns, index=numbers)
        units = dict.fromkeys(columns, "") | {"eigenvalue": "1/s"}
        units |= {name: "Hz" for name in columns if name.endswith("frequency")}
        table.attrs["units"] = units
        return table

    def __repr__(self) -> str:
        from .report.tables import plural

        if not len(self.frequencies):
            return "<Linearisation: no natural modes>"
        first = ", ".join(f"{hertz:.4g}" for hertz in self.frequencies[:3])
        more = ", ..." if len(self.frequencies) > 3 else ""
        count = plural(len(self.frequencies), "mode")
        return f"<Linearisation: {count}, {first}{more} Hz>"

    def _repr_html_(self) -> str:
        from .report.analysis import frame_of, mode_header, mode_rows

        header = mode_header(self)
        notes = html_table([("note", text) for text in self.notes])
        frame = html_table([tuple(frame_of(self).split(": ", 1))])
        return html_table(mode_rows(self), header) + frame + notes


def for_users(found: Any, kind: type[Found]) -> Found:
    """The same as users have it."""
    return kind(**{f.name: getattr(found, f.name) for f in fields(found)})
