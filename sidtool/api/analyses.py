"""Analyses for scripts and notebooks: equilibrium, natural modes, inverse dynamics."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.solver.analyses.linearisation import Linearisation as SolverLinearisation
from sidtool.solver.analyses.static_equilibrium import Equilibrium as SolverEquilibrium

from ..pipeline.scene_changes import compiled_scene
from ..report.tables import import_optional
from .result import Result, emit_warnings, to_user_result

if TYPE_CHECKING:
    import pandas

Path_ = str | os.PathLike[str]
Sids = Mapping[str, SID | Path_]
Programs = Mapping[str, Any]


def static_equilibrium(
    scene: SceneFile | Path_,
    *,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Equilibrium:
    """Find the static equilibrium of a scene, starting at its initial state.

    `result()` of the returned object holds the outputs of the scene and the forces of
    all joints. The other arguments are those of `simulate`, including callables.

    Raises
    ------
    InputError : the scene or one of its SIDs cannot be used.
    sidtool.SimulationError : no equilibrium was found.
    """
    from sidtool.solver.analyses.static_equilibrium import static_equilibrium as analyse

    programs = drives, forces
    with compiled_scene(scene, sids, base_folder, accept_defects, programs) as system:
        return emit_warnings(to_user_class(analyse(system), Equilibrium))


def linearise(
    scene: SceneFile | Path_,
    *,
    about: str = "static",
    frozen: bool = False,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Linearisation:
    """Return frequencies, damping ratios and shapes of the natural modes of a scene.

    about : "static" for the static equilibrium, or "start" for the initial state with
        its velocities
    frozen : return the values at one instant also if the equations of small motions
        change in time, or if the state is no steady motion; they do not describe a
        motion then

    `inertial_frequencies` are measured by fixed sensors, `rotating_frequencies` by
    sensors on the rotating body; `whirl` is "forward", "backward" or "".

    Raises
    ------
    InputError : the scene or one of its SIDs cannot be used.
    sidtool.SimulationError : no equilibrium was found, or the state has no modes.
    """
    from sidtool.solver.analyses.linearisation import linearise as analyse

    programs = drives, forces
    with compiled_scene(scene, sids, base_folder, accept_defects, programs) as system:
        return emit_warnings(
            to_user_class(analyse(system, about, frozen=frozen), Linearisation)
        )


def inverse_dynamics(
    scene: SceneFile | Path_,
    *,
    quasi_static: bool = False,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Result:
    """Return motion and joint forces of a scene whose drives prescribe all coordinates.

    Parameters
    ----------
    quasi_static : flexible bodies deform without vibrating; velocities and
        accelerations of their elastic coordinates are neglected

    Raises
    ------
    InputError : some coordinate is free, or the scene cannot be used.
    sidtool.SimulationError : the drives are infeasible for the mechanism; the
        `result` of the error holds the motion before.
    """
    from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics as analyse

    programs = drives, forces
    with compiled_scene(scene, sids, base_folder, accept_defects, programs) as system:
        result = analyse(system, quasi_static=quasi_static)
        return emit_warnings(to_user_result(result, drives, forces))


Found = TypeVar("Found")


class _NamedNumbers(ABC):
    """Mapping from names to numbers: `keys()`, `in`, `len` and iteration."""

    @abstractmethod
    def keys(self) -> tuple[str, ...]:
        """Return the names of the numbers."""

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __bool__(self) -> bool:
        return True


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(_NamedNumbers, SolverEquilibrium):
    __doc__ = f"""{SolverEquilibrium.__doc__}
    `equilibrium["pin.fy"]` is an output, recorded or not; `keys()`, `in`, `len` and
    iteration give recorded outputs and all multipliers.
    """

    def result(self) -> Result:
        """Return the outputs of the scene in equilibrium as a result with one time."""
        return to_user_result(super().result())

    def keys(self) -> tuple[str, ...]:
        """Return the names of recorded outputs and of all multipliers."""
        return tuple(name for name, _, _ in self.rows())

    def __getitem__(self, name: str) -> float:
        """Return the value of an output of the scene, recorded or not.

        Raises
        ------
        InputError : no output has this name.
        """
        return float(self._result[name][0])

    @cached_property
    def _result(self) -> Result:
        """The result whose outputs are looked up, evaluated once."""
        return self.result()

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: a row per recorded output and multiplier with value
        and unit.

        Raises
        ------
        InputError : pandas is not installed.
        """
        table = import_optional("pandas").DataFrame(
            self.rows(), columns=["output", "value", "unit"]
        )
        return table.set_index("output")

    def rows(self) -> list[tuple[str, float, str]]:
        """Return recorded outputs and all multipliers with their values and units."""
        from ..report.analyses import state_rows

        return state_rows(self.result())

    def __repr__(self) -> str:
        title = self.system.scene.title
        return f"<Equilibrium {title!r}: unbalanced {self.residual:.1e} of the forces>"

    def _repr_html_(self) -> str:
        rows = [(name, f"{value:.6g}", unit) for name, value, unit in self.rows()]
        notes = html_table([("note", text) for text in self.notes])
        title = self.system.scene.title
        return html_table(rows, ("output", "value", "unit"), title) + notes


@dataclass(frozen=True, eq=False, repr=False)
class Linearisation(_NamedNumbers, SolverLinearisation):
    __doc__ = f"""{SolverLinearisation.__doc__}
    `modes["frequency"]` is a column of `to_dataframe`; `keys()`, `in`, `len` and
    iteration give the names of the columns.
    """

    def keys(self) -> tuple[str, ...]:
        """Return the names of the columns."""
        return tuple(self._columns())

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column (n,), a number for each mode.

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
        """Return a pandas table: a row per mode with frequency [Hz], damping ratio and
        eigenvalue [1/s]. Mode shapes are in `shapes`.

        Raises
        ------
        InputError : pandas is not installed.
        """
        pandas = import_optional("pandas")
        columns = self._columns()
        numbers = pandas.RangeIndex(1, len(self.frequencies) + 1, name="mode")
        table = pandas.DataFrame(columns, index=numbers)
        units = dict.fromkeys(columns, "") | {"eigenvalue": "1/s"}
        units |= {name: "Hz" for name in columns if name.endswith("frequency")}
        table.attrs["units"] = units
        return table

    def __repr__(self) -> str:
        from sidtool.formats.text import counted_noun

        if not len(self.frequencies):
            return "<Linearisation: no natural modes>"
        first = ", ".join(f"{hertz:.4g}" for hertz in self.frequencies[:3])
        more = ", ..." if len(self.frequencies) > 3 else ""
        count = counted_noun(len(self.frequencies), "mode")
        return f"<Linearisation: {count}, {first}{more} Hz>"

    def _repr_html_(self) -> str:
        from ..report.analyses import axes_of_frequencies, mode_header, mode_rows

        header = mode_header(self)
        notes = html_table([("note", text) for text in self.notes])
        frame = html_table([tuple(axes_of_frequencies(self).split(": ", 1))])
        return html_table(mode_rows(self), header) + frame + notes


def to_user_class(analysis: Any, kind: type[Found]) -> Found:
    """Return an analysis of the solver as the public class."""
    return kind(**{f.name: getattr(analysis, f.name) for f in fields(analysis)})
