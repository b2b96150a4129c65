"""Scenes and models for scripts and notebooks: what a file holds, and what to do."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID

if TYPE_CHECKING:
    from sidtool.formats import result as stored

    from .compiled import CompiledScene
    from .results import Result
    from .states import Equilibrium, Linearisation
    from .study import Study
    from .sweep import Sweep

Sids = Mapping[str, SID | str | os.PathLike[str]]
Programs = Mapping[str, Any]


class Model(ModelFile):
    """A flexible body from its geometry to its shape functions; a model file.

        model = sidtool.Model.load("rod_q4.toml")
        sid = model.with_({"geometry.thickness": 0.02}).convert()

    Raises
    ------
    InputError : names the argument, what was found and what was expected.
    """

    def convert(self) -> SID:
        """The SID of the body.

        Raises
        ------
        InputError : the body cannot be made or reduced.
        """
        from .api import convert

        return convert(self)

    def __repr__(self) -> str:
        parts = f"{self.geometry.type}, {self.discretisation.type}"
        return f"<Model {self.title!r}: {parts}, {self.reduction.method}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        from .report.model import model_parts

        return "".join(part.html for part in model_parts(self))


class Scene(SceneFile):
    """What moves, how it is joined and driven, and what is recorded; a scene file.

        scene = sidtool.Scene.load("slider_crank.toml")
        result = scene.with_({"time.end": 1.0}).simulate(rtol=1e-8)

    Lengths, masses and times in SI units, angles in radians. Relative paths begin in
    the folder of the file, or in the working folder.

    Raises
    ------
    InputError : names the argument, what was found and what was expected.
    """

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
        unfinished: stored.Result | None = None,
    ) -> Result:
        """The motion; arguments and errors as of `sidtool.simulate`."""
        from .api import simulate

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
        """The scene with its files read and its tables made, for many runs.

            compiled = scene.compile()
            results = [compiled.run({"crank.mass": m}) for m in (0.3, 0.4)]

        Arguments as of `sidtool.simulate`, errors as of `CompiledScene`.
        """
        from .compiled import CompiledScene

        return CompiledScene(
            self,
            sids=sids,
            rigid=rigid,
            accept_defects=accept_defects,
            drives=drives,
            forces=forces,
        )

    def study(self, over: Any = (), **settings: Any) -> Study:
        """Error against time and size of its variants, see `sidtool.study`."""
        from .study.asked import study

        return study(self, over, **settings)

    def sweep(self, over: Any, of: str | Iterable[str], **settings: Any) -> Sweep:
        """Measures of outputs for values of its keys, see `sidtool.sweep`."""
        from .sweep.asked import sweep

        return sweep(self, over, of, **settings)

    def static_equilibrium(self, **settings: Any) -> Equilibrium:
        """Where it comes to rest, see `sidtool.static_equilibrium`."""
        from .analysing import static_equilibrium

        return static_equilibrium(self, **settings)

    def linearise(self, **settings: Any) -> Linearisation:
        """Its natural modes, see `sidtool.linearise`."""
        from .analysing import linearise

        return linearise(self, **settings)

    def inverse_dynamics(self, **settings: Any) -> Result:
        """The forces of a prescribed motion, see `sidtool.inverse_dynamics`."""
        from .analysing import inverse_dynamics

        return inverse_dynamics(self, **settings)

    def __repr__(self) -> str:
        from .report.tables import plural

        flexible = f", {len(self.flexible)} flexible" if self.flexible else ""
        parts = plural(len(self.bodies), "body") + flexible
        parts += f", {plural(len(self.joints), 'joint')}"
        return f"<Scene {self.title!r}: {parts}, to {self.time.end:g} s>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        from .report.scene import scene_parts

        return "".join(part.html for part in scene_parts(self))
