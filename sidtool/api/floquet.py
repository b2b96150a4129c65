"""Floquet analysis for scripts and notebooks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.file_names import path_of, scene_given
from sidtool.formats.scene import SceneFile
from sidtool.solver.simulation.floquet import FloquetModes as SolverFloquetModes
from sidtool.solver.simulation.floquet import floquet_modes

from ..pipeline.files import expect_kind
from ..pipeline.scene_changes import compiled_scene
from ..report.tables import import_optional
from .analyses import Path_, Programs, Sids, to_user_class
from .result import emit_warnings

if TYPE_CHECKING:
    import pandas


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
        from ..report.floquet import FLOQUET_COLUMNS, floquet_rows

        notes = html_table([("note", text) for text in self.notes])
        return html_table(floquet_rows(self), FLOQUET_COLUMNS) + notes
