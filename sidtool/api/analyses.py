"""Analyses for scripts and notebooks.

Equilibrium, natural modes, inverse dynamics, Campbell diagrams, Floquet modes.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.progress import report_stage
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.file_names import (
    check_ending,
    kind_by_ending,
    path_of,
    scene_given,
)
from sidtool.formats.scene import SceneFile
from sidtool.solver.analyses.campbell import (
    CampbellDiagram as SolverCampbellDiagram,
    campbell_diagram,
)
from sidtool.solver.analyses.linearisation import Linearisation as SolverLinearisation
from sidtool.solver.analyses.static_equilibrium import Equilibrium as SolverEquilibrium
from sidtool.solver.simulation.floquet import (
    FloquetModes as SolverFloquetModes,
    floquet_modes,
)
from sidtool.solver.system.errors import SimulationError

from ..pipeline.files import expect_kind
from ..pipeline.scene_changes import compiled_scene
from ..report.tables import import_optional
from ..sweep.design import check_parameter, parse_axes
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


def campbell(
    scene: SceneFile | Path_,
    over: str | Mapping[str, Iterable[float]],
    *,
    about: str = "start",
    orders: Sequence[float] = (1.0,),
    frozen: bool = False,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> CampbellDiagram:
    """Follow the natural modes of a scene over a parameter, such as its speed.

    Parameters
    ----------
    over : a key of the scene and its values: "parameters.speed=0:400:41", or
        {"parameters.speed": [0.0, 10.0, 20.0]}
    about, frozen : of the states, see `linearise`
    orders : times per revolution that an excitation acts; critical speeds are those at
        which one of them meets a frequency in inertial axes

    The other arguments are those of `simulate`, including callables.

    Raises
    ------
    InputError : the scene, one of its SIDs or the key cannot be used.
    sidtool.SimulationError : a value has no modes (N729).
    """
    if not isinstance(scene, SceneFile):
        expect_kind(path_of(scene, "scene", "a sidtool.Scene"), "scene")
    content = scene_given(scene)
    key, values = _one_axis(over)
    check_parameter(content, key, key)
    programs = drives, forces

    def modes_at(value: float) -> SolverLinearisation:
        from sidtool.solver.analyses.linearisation import linearise

        report_stage(f"modes at {key} = {value:.6g}")
        changed = content.with_({key: value})
        given = sids, base_folder, accept_defects, programs
        with compiled_scene(changed, *given) as system:
            try:
                return linearise(system, about, frozen=frozen)
            except SimulationError as error:
                first = diagnose("N729", key=key, value=value)
                raise SimulationError((first, *error.diagnostics)) from None

    diagram = campbell_diagram(key, values, modes_at, orders)
    return emit_warnings(to_user_class(diagram, CampbellDiagram))


def _one_axis(over: str | Mapping[str, Iterable[float]]) -> tuple[str, list[float]]:
    """Return the key and its rising numbers.

    Raises
    ------
    InputError : there are several keys, fewer than two values, or no numbers.
    """
    axes = parse_axes(over)
    if len(axes) != 1:
        raise InputError(
            f"{len(axes)} keys are varied", place="--over", expected="one key"
        )
    ((key, values),) = axes.items()
    if not all(isinstance(x, int | float) and np.isfinite(x) for x in values):
        raise InputError(
            f"{key} has values that are no numbers", place="--over", expected="numbers"
        )
    numbers = sorted({float(x) for x in values})
    if len(numbers) < 2:
        raise InputError(
            f"{key} has one value", place="--over", expected="two or more values"
        )
    return key, numbers


@dataclass(frozen=True, eq=False, repr=False)
class CampbellDiagram(SolverCampbellDiagram):
    __doc__ = SolverCampbellDiagram.__doc__

    def save(self, path: Path_) -> None:
        """Write it: ``.csv``, ``.json``, or a picture (``.png``, ``.svg``, ``.pdf``).

        Raises
        ------
        InputError : the file cannot be written, or has another ending.
        """
        path = path_of(path, "path")
        if kind_by_ending(path, "campbell", "picture") == "picture":
            self.plot(path=path)
            return
        from ..report.analyses import write_campbell

        check_ending(path, "campbell")
        write_campbell(path, self)

    def plot(self, *, path: Path_ | None = None) -> Any:
        """Return a matplotlib figure, and write it to a path."""
        from ..plot.frequency_responses import plot_campbell

        orders = tuple(sorted({1.0, *(each.order for each in self.critical_speeds)}))
        return plot_campbell(
            None if path is None else path_of(path, "path"), self, orders
        )

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: index the parameter, a column per mode with its
        frequency in inertial axes [Hz].

        Raises
        ------
        InputError : pandas is not installed.
        """
        pandas = import_optional("pandas")
        names = [f"mode {k + 1}" for k in range(self.inertial_frequencies.shape[1])]
        index = pandas.Index(self.values, name=self.key)
        return pandas.DataFrame(self.inertial_frequencies, index, names)

    def __repr__(self) -> str:
        count = self.inertial_frequencies.shape[1]
        return (
            f"<CampbellDiagram over {self.key}: {len(self.values)} values, {count} "
            f"modes, {len(self.critical_speeds)} critical speeds>"
        )

    def _repr_html_(self) -> str:
        from ..report.analyses import CRITICAL_COLUMNS, critical_rows

        notes = html_table([("note", text) for text in self.notes])
        return html_table(critical_rows(self), CRITICAL_COLUMNS) + notes


def floquet(
    scene: SceneFile | Path_,
    period: float | str,
    *,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> FloquetModes:
    """Find how small motions about the periodic motion of a scene grow in a period.

    The motion begins at the start of the scene and has to return to it, but for whole
    revolutions. Functions of time have to be known over two periods, to see that they
    repeat.

    Parameters
    ----------
    period : of the motion [s], or a formula of parameters, such as "2*pi/speed"

    The other arguments are those of `simulate`, including callables.

    Raises
    ------
    InputError : the scene or one of its SIDs cannot be used, or the period is not
        positive.
    sidtool.SimulationError : the motion or its equations do not return (N741), or it
        has no variational equations (N742).
    """
    if not isinstance(scene, SceneFile):
        expect_kind(path_of(scene, "scene", "a sidtool.Scene"), "scene")
    content = scene_given(scene)
    start = content.time.start
    end = f"({period}) + {start!r}" if start else period
    span = {"start": start, "end": end, "output_times": [start]}
    try:
        content = content.with_({"time": span})
    except InputError as error:
        raise InputError(
            error.problem,
            place="period",
            expected="a time above zero [s], or a formula",
        ) from None
    span["end"] = 2.0 * content.time.end - start
    try:
        longer = content.with_({"time": span})
    except InputError as error:
        raise InputError(
            f"{error.problem}; the analysis compares two periods",
            place=error.place,
            expected=error.expected,
        ) from None
    options = sids, base_folder, accept_defects, (drives, forces)
    with (
        compiled_scene(content, *options) as system,
        compiled_scene(longer, *options) as twice,
    ):
        return emit_warnings(to_user_class(floquet_modes(system, twice), FloquetModes))


@dataclass(frozen=True, eq=False, repr=False)
class FloquetModes(SolverFloquetModes):
    __doc__ = SolverFloquetModes.__doc__

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: a row per mode with multiplier, exponent [1/s] and
        frequencies [Hz].

        Raises
        ------
        InputError : pandas is not installed.
        """
        pandas = import_optional("pandas")
        columns = {
            "multiplier": self.multipliers,
            "exponent": self.exponents,
            "inertial_frequency": self.inertial_frequencies,
            "rotating_frequency": self.rotating_frequencies,
        }
        numbers = pandas.RangeIndex(1, len(self.multipliers) + 1, name="mode")
        return pandas.DataFrame(columns, index=numbers)

    def __repr__(self) -> str:
        found = "stable" if self.is_stable else "unstable"
        return f"<FloquetModes of period {self.period:.6g} s: {found}>"

    def _repr_html_(self) -> str:
        from ..report.analyses import FLOQUET_COLUMNS, floquet_rows

        notes = html_table([("note", text) for text in self.notes])
        return html_table(floquet_rows(self), FLOQUET_COLUMNS) + notes
