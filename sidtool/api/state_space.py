"""State space and frequency response of a scene for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.file_names import (
    check_ending,
    kind_by_ending,
    path_of,
    scene_given,
)
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.files import locate_errors
from sidtool.solver.analyses.frequency_response import (
    FrequencyResponse as SolverFrequencyResponse,
    frequency_response,
)
from sidtool.solver.analyses.state_space import StateSpace as SolverStateSpace

from ..pipeline.files import expect_kind
from ..pipeline.scene_changes import compiled_scene, take_as_rigid
from ..report.tables import import_optional
from .analyses import Path_, Programs, Sids, to_user_class
from .result import emit_warnings

if TYPE_CHECKING:
    import pandas

    from sidtool.solver.system.system import System


def state_space(
    scene: SceneFile | Path_,
    *,
    about: str | float = "static",
    inputs: str | Iterable[str] | None = None,
    outputs: str | Iterable[str] | None = None,
    descriptor: bool = False,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    rigid: Iterable[str] = (),
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> StateSpace:
    """Linearise a scene between its inputs and outputs: x' = A x + B u, y = C x + D u.

    Parameters
    ----------
    about : "static" for the static equilibrium, "start" for the initial state with
        its velocities, or a time [s], up to which the scene is simulated
    inputs : names of inputs of the scene, default all
    outputs : any outputs that the tool knows, `*` for any letters, default the
        recorded ones; integrals along a run, such as energy.supplied, are left out
    descriptor : also return the form with all coordinates and multipliers

    The other arguments are those of `simulate`. States are independent coordinates,
    their velocities and the states of control laws. A state that is not steady gives
    the equations of one instant, with a warning (N715) and `is_steady` False.

    Raises
    ------
    InputError : the scene cannot be used, or has no such input or output.
    sidtool.SimulationError : there is no equilibrium, the run to the time stopped, or
        the state is a singular configuration.
    """
    from sidtool.solver.analyses.state_space import state_space as analyse

    if not isinstance(scene, SceneFile):
        expect_kind(path_of(scene, "scene", "a sidtool.Scene"), "scene")
    content = scene_given(scene)
    folder = Path(base_folder or content.folder)
    if outputs is not None:
        listed = [outputs] if isinstance(outputs, str) else list(outputs)
        with locate_errors(content):
            content = content.with_({"outputs.record": listed})
    is_instant = not isinstance(about, str)
    if is_instant:
        instant = float(about)
        with locate_errors(content):
            content = _until(content, instant)
    content = take_as_rigid(content, rigid)
    chosen = [inputs] if isinstance(inputs, str) else inputs
    chosen = None if chosen is None else tuple(chosen)
    programs = drives, forces
    with compiled_scene(content, sids, folder, accept_defects, programs) as system:
        state, time, point = None, None, str(about)
        if is_instant and instant > content.time.start:
            state, time = _state_of_run(system, instant)
        if is_instant:
            point = "start"
        found = analyse(
            system, point, state, time, inputs=chosen, descriptor=descriptor
        )
    return emit_warnings(to_user_class(found, StateSpace))


def _until(scene: SceneFile, time: float) -> SceneFile:
    """The scene that is simulated until a time, which is recorded alone."""
    start = scene.time.start
    if not np.isfinite(time) or time < start:
        raise InputError(
            f"found {time:g} s", place="about", expected=f"a time from {start:g} s on"
        )
    if time == start:
        return scene
    return scene.with_({"time.end": time, "time.output_step": time - start})


def _state_of_run(system: System, time: float) -> tuple[tuple[Array, Array], float]:
    """Simulate a system with continuous laws to its end; return the state there, and
    the time."""
    from sidtool.solver.analyses.frozen_inputs import with_continuous_laws
    from sidtool.solver.simulation.simulate import simulate

    result = simulate(with_continuous_laws(system)[0])
    end = float(result.t[-1])
    if end < time * (1.0 - 1e-9):
        raise InputError(
            f"the run ends at t = {end:.9g} s, before {time:.9g} s",
            place="about",
            expected="a time before its end",
        )
    return (result.positions[-1], result.velocities[-1]), end


@dataclass(frozen=True, eq=False, repr=False)
class StateSpace(SolverStateSpace):
    __doc__ = f"""{SolverStateSpace.__doc__}
    `save`, `to_control` and `to_scipy` hand it to other programs; `response` is its
    frequency response.
    """

    def response(
        self,
        frequencies: ArrayLike | str = "1:1000:log",
        of: str | Mapping[str, complex] | None = None,
        outputs: str | Sequence[str] | None = None,
        *,
        unbalance: bool = False,
    ) -> FrequencyResponse:
        """Return the response of outputs to harmonic inputs.

        Parameters
        ----------
        frequencies : [Hz], or a range such as "1:2000:log" or "0:100:lin:400", to which
            points about the resonances are added
        of : an input, a sum of inputs with complex factors such as "fx - 1j*fy", or
            amplitudes by name; default the only input
        outputs : names, default all
        unbalance : amplitudes are those of an unbalance [kg m], multiplied by omega^2

        Raises
        ------
        InputError : there is no such input or output, or no such range.
        """
        names = [outputs] if isinstance(outputs, str) else outputs
        found = frequency_response(self, frequencies, of, names, unbalance=unbalance)
        return to_user_class(found, FrequencyResponse)

    def to_scipy(self) -> Any:
        """Return a `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace as ScipyStateSpace

        return ScipyStateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return a `control.StateSpace` of python-control, with names.

        Dots of names become underscores, as python-control demands.

        Raises
        ------
        InputError : python-control is not installed.
        """
        control = import_optional("control")
        names = {
            f"{part}s": [_plain(name) for name in getattr(self, f"{part}_names")]
            for part in ("state", "input", "output")
        }
        return control.ss(self.A, self.B, self.C, self.D, **names)

    def save(self, path: Path_) -> None:
        """Write matrices, names, units and operating point: ``.npz`` for NumPy,
        ``.mat`` for MATLAB, ``.json``, or ``.fmu`` as of `fmu`.

        Raises
        ------
        InputError : the file cannot be written, or has another ending.
        """
        from ..report.state_space import write_state_space

        path = path_of(path, "path")
        if path.suffix.lower() == ".fmu":
            self.fmu(path)
        else:
            write_state_space(path, self)

    def fmu(
        self,
        path: Path_,
        *,
        version: str = "2.0",
        platforms: Iterable[str] = (),
        linker: str | None = None,
    ) -> None:
        """Write a functional mock-up unit (FMI) for model exchange and co-simulation.

        Inputs and outputs have the values of the scene, states are changes from the
        operating point. Co-simulation is exact for inputs that are held.

        Parameters
        ----------
        path : file to write, NAME.fmu
        version : of FMI, "2.0" or "3.0"
        platforms : as of `Scene.fmu`; by default that of this machine
        linker : "cc" or "zig"; by default what is there

        Raises
        ------
        InputError : there is no such version or platform, or no compiler.
        """
        from .. import __version__
        from ..fmu.export import export_linear_unit

        target = path_of(path, "path")
        check_ending(target, "unit", "path")
        export_linear_unit(
            self,
            target,
            tool=f"sidtool {__version__}",
            version=version,
            platforms=tuple(platforms),
            linker=linker,
        )

    def __repr__(self) -> str:
        from ..report.state_space import sizes_text

        frozen = "" if self.is_steady else ", frozen"
        return f"<StateSpace {self.title!r}: {sizes_text(self)}{frozen}>"

    def _repr_html_(self) -> str:
        parts = [
            html_table(
                zip(
                    getattr(self, f"{part}_names"),
                    getattr(self, f"{part}_units"),
                    strict=True,
                ),
                (part, "unit"),
            )
            for part in ("state", "input", "output")
        ]
        return "".join(parts) + html_table([("note", text) for text in self.notes])


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(SolverFrequencyResponse):
    __doc__ = f"""{SolverFrequencyResponse.__doc__}
    `response["hub.x"]` are the complex amplitudes (n,) of an output.
    """

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the complex amplitudes (n,) of an output.

        Raises
        ------
        InputError : there is no such output.
        """
        if name not in self.output_names:
            expected = f"one of {', '.join(self.output_names)}"
            raise InputError(f"the response has no {name!r}", expected=expected)
        return np.asarray(self.values[:, self.output_names.index(name)])

    def save(self, path: Path_) -> None:
        """Write it: ``.csv``, ``.json``, or a Bode plot (``.png``, ``.svg``, ``.pdf``).

        Raises
        ------
        InputError : the file cannot be written, or has another ending.
        """
        path = path_of(path, "path")
        if kind_by_ending(path, "response", "picture") == "picture":
            self.plot(path=path)
            return
        from ..report.state_space import write_response

        write_response(path, self)

    def plot(self, *, path: Path_ | None = None) -> Any:
        """Return a Bode plot as a matplotlib figure, and write it to a path."""
        from ..plot.frequency_responses import plot_response

        return plot_response(None if path is None else path_of(path, "path"), self)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: index frequency [Hz], a complex column per output,
        units in `attrs`.

        Raises
        ------
        InputError : pandas is not installed.
        """
        pandas = import_optional("pandas")
        index = pandas.Index(self.frequencies, name="frequency")
        table = pandas.DataFrame(self.values, index=index, columns=self.output_names)
        table.attrs["units"] = dict(zip(self.output_names, self.units, strict=True))
        table.attrs["units"]["frequency"] = "Hz"
        return table

    def __repr__(self) -> str:
        first, last = self.frequencies.min(), self.frequencies.max()
        return (
            f"<FrequencyResponse of {self.excitation}: {', '.join(self.output_names)}, "
            f"{first:.4g} to {last:.4g} Hz, {len(self.peaks)} peaks>"
        )

    def _repr_html_(self) -> str:
        from ..report.state_space import PEAK_COLUMNS, peak_rows

        return html_table(peak_rows(self), PEAK_COLUMNS)


def _plain(name: str) -> str:
    return name.replace(".", "_")
