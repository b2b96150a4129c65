"""Scenes of scripts and notebooks, and reading of files."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile

from ..pipeline.files import Path_, kind_of

if TYPE_CHECKING:
    from sidtool.formats import result as stored

    from ..fmu.export import ExportedUnit
    from ..study import Study
    from ..sweep import Sweep
    from .analyses import Equilibrium, Linearisation
    from .compiled_scene import CompiledScene
    from .result import Result
    from .state_space import StateSpace

Sids = Mapping[str, SID | str | os.PathLike[str]]
Programs = Mapping[str, Any]


class Scene(SceneFile):
    """A mechanism: bodies, joints, drives, forces, outputs and integration; a scene
    file.

        scene = sidtool.Scene.load("slider_crank.toml")
        result = scene.with_({"time.end": 1.0}).simulate(rtol=1e-8)

    Lengths, masses and times in SI units, angles in radians. Relative paths begin in
    the folder of the file, or in the working folder.

    Raises
    ------
    InputError : names the argument, what was found and what was expected.
    """

    @classmethod
    def of_result(cls, result: Result) -> Self:
        """Return the scene of a result.

        Raises
        ------
        InputError : the result does not hold its scene.
        """
        if not result.scene:
            raise InputError("holds no scene", place="result")
        return cls.checked(json.loads(result.scene), "scene of the result")

    def simulate(
        self,
        *,
        sids: Sids | None = None,
        integrator: str | None = None,
        rtol: float | None = None,
        step: float | None = None,
        spectral_radius: float | None = None,
        rigid: Iterable[str] = (),
        accuracy: float | Mapping[str, float | str] | None = None,
        accept_defects: bool = False,
        progress: Callable[[float], None] | None = None,
        searching: Callable[[str, float | None], None] | None = None,
        drives: Programs | None = None,
        forces: Programs | None = None,
        inputs: Mapping[str, Any] | None = None,
        unfinished: stored.Result | None = None,
    ) -> Result:
        """Simulate the scene; arguments and errors as of `sidtool.simulate`."""
        from .operations import simulate

        return simulate(
            self,
            sids=sids,
            integrator=integrator,
            rtol=rtol,
            step=step,
            spectral_radius=spectral_radius,
            rigid=rigid,
            accuracy=accuracy,
            accept_defects=accept_defects,
            progress=progress,
            searching=searching,
            drives=drives,
            forces=forces,
            inputs=inputs,
            unfinished=unfinished,
        )

    def compile(
        self,
        *,
        sids: Sids | None = None,
        rigid: Iterable[str] = (),
        accept_defects: bool = False,
        drives: Programs | None = None,
        forces: Programs | None = None,
    ) -> CompiledScene:
        """Compile the scene once for many runs.

            compiled = scene.compile()
            results = [compiled.run({"crank.mass": m}) for m in (0.3, 0.4)]

        Arguments as of `sidtool.simulate`, errors as of `CompiledScene`.
        """
        from .compiled_scene import CompiledScene

        return CompiledScene(
            self,
            sids=sids,
            rigid=rigid,
            accept_defects=accept_defects,
            drives=drives,
            forces=forces,
        )

    def study(self, over: Any = (), **settings: Any) -> Study:
        """Measure error against time and size of variants, see `sidtool.study`."""
        from .study import study

        return study(self, over, **settings)

    def sweep(self, over: Any, of: str | Iterable[str], **settings: Any) -> Sweep:
        """Evaluate measures of outputs for values of keys, see `sidtool.sweep`."""
        from .study import sweep

        return sweep(self, over, of, **settings)

    def static_equilibrium(self, **settings: Any) -> Equilibrium:
        """Find the static equilibrium, see `sidtool.static_equilibrium`."""
        from .analyses import static_equilibrium

        return static_equilibrium(self, **settings)

    def linearise(self, **settings: Any) -> Linearisation:
        """Return the natural modes, see `sidtool.linearise`."""
        from .analyses import linearise

        return linearise(self, **settings)

    def state_space(self, **settings: Any) -> StateSpace:
        """Linearise between inputs and outputs, see `sidtool.state_space`."""
        from .state_space import state_space

        return state_space(self, **settings)

    def inverse_dynamics(self, **settings: Any) -> Result:
        """Return the forces of a prescribed motion, see `sidtool.inverse_dynamics`."""
        from .analyses import inverse_dynamics

        return inverse_dynamics(self, **settings)

    def fmu(
        self,
        path: Path_,
        *,
        version: str = "2.0",
        platforms: Iterable[str] = (),
        outputs: Iterable[str] | None = None,
        sids: Sids | None = None,
        rigid: Iterable[str] = (),
        accept_defects: bool = False,
        integrator: str | None = None,
        rtol: float | None = None,
        step: float | None = None,
        linker: str | None = None,
    ) -> ExportedUnit:
        """Write the scene as a functional mock-up unit (FMI, co-simulation).

            scene.fmu("machine.fmu", platforms=["linux64", "win64"])

        Its variables are the inputs and outputs of the scene. It needs a C compiler:
        `cc`, or the package ziglang.

        Parameters
        ----------
        path : file to write, NAME.fmu
        version : of FMI, "2.0" or "3.0"
        platforms : "linux64", "win64", "darwin64", "aarch64-linux",
            "aarch64-darwin"; by default that of this machine
        outputs : names of outputs in place of those of the scene
        sids, rigid, accept_defects : as of `sidtool.simulate`
        integrator, rtol : replace those of the scene: radau5, radau9 or radau13
        step : fixed step [s], for real time, in place of the error control
        linker : "cc" or "zig"; by default what is there

        Raises
        ------
        InputError : the scene has parts that a unit cannot have, which it names, or
            there is no compiler.
        """
        from .fmu import fmu

        return fmu(
            self,
            path,
            version=version,
            platforms=platforms,
            outputs=outputs,
            sids=sids,
            rigid=rigid,
            accept_defects=accept_defects,
            integrator=integrator,
            rtol=rtol,
            step=step,
            linker=linker,
        )

    def __repr__(self) -> str:
        from sidtool.formats.text import counted_noun

        flexible = f", {len(self.flexible)} flexible" if self.flexible else ""
        parts = counted_noun(len(self.bodies), "body") + flexible
        parts += f", {counted_noun(len(self.joints), 'joint')}"
        return f"<Scene {self.title!r}: {parts}, to {self.time.end:g} s>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        from ..report.input_files import scene_parts

        return "".join(part.html for part in scene_parts(self))


def read(path: Path_) -> Any:
    """Read a file and return a SID, Model, Scene, Result, Field, StudyFile or design.

    Raises
    ------
    InputError : the file cannot be read; names file and place.
    """
    kind = kind_of(path)
    if kind not in READERS:
        raise InputError(
            f"is a {kind}", source=path, expected="a SID, model, scene or result"
        )
    return READERS[kind](path)


def _read_sid(path: Path_) -> Any:
    from sidtool.formats.sid_files import read_sid

    return read_sid(path)


def _read_model(path: Path_) -> Any:
    from .model import Model

    return Model.load(path)


def _read_scene(path: Path_) -> Any:
    return Scene.load(path)


def _read_result(path: Path_) -> Any:
    from sidtool.formats.result import read_result

    from .result import to_user_result

    return to_user_result(read_result(Path(path)))


def _read_field(path: Path_) -> Any:
    from sidtool.formats.field import read_field

    return read_field(path)


def _read_design(path: Path_) -> Any:
    from sidtool.formats.design import read_design

    return read_design(path)


def _read_study(path: Path_) -> Any:
    from sidtool.formats.study import read_study

    return read_study(Path(path))


READERS: dict[str, Callable[[Path_], Any]] = {
    "sid": _read_sid,
    "model": _read_model,
    "scene": _read_scene,
    "result": _read_result,
    "field": _read_field,
    "study": _read_study,
    "design": _read_design,
}
