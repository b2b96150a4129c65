"""What one process does of a study: converts a model, or runs a scene."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID
from sidtool.formats.storage.operating_system import busy_seconds

from .measuring import ENOUGH, REPEATS, Course, course, failed, timed
from .settings import Setting

if TYPE_CHECKING:
    from sidtool.solver.system.scene import System

Programs = Mapping[str, Mapping[str, Any] | None]
#: Integrators whose kernels this process has loaded, by the dimension of scenes.
_LOADED: set[tuple[str, str]] = set()


@dataclass(frozen=True, eq=False)
class Converted:
    """What a model becomes and costs; `message` says why there is no SID.

    dofs : degrees of freedom of its mesh
    seconds : of the processor, for the whole conversion
    """

    sid: SID | None
    dofs: int = 0
    seconds: float = 0.0
    message: str = ""


def convert(model: ModelFile) -> Converted:
    """The SID of a model; short conversions are timed twice, the second one loaded."""
    from ..convert import finite_element_model, sid_from_model

    try:
        dofs = finite_element_model(model).ndof
        seconds: list[float] = []
        while len(seconds) < 2 and sum(seconds) < ENOUGH:
            began = time.perf_counter(), time.process_time()
            sid = sid_from_model(model, _silent)
            passed = time.perf_counter() - began[0]
            seconds.append(busy_seconds(passed, time.process_time() - began[1]))
    except InputError as error:
        return Converted(None, message=str(error))
    return Converted(sid, dofs, min(seconds))


@dataclass(frozen=True, eq=False)
class Run:
    """A scene with its outputs that is run; not timed where once is enough.

    programs : see `compiled`
    """

    scene: SceneFile
    sids: Mapping[str, SID]
    setting: Setting
    once: bool = False
    programs: Programs = field(default_factory=dict)


def compiled(scene: SceneFile, sids: Mapping[str, SID], programs: Programs) -> System:
    """The scene with its callables for `drives` and `forces` of `compile_scene`."""
    from sidtool.solver import compile_scene

    drives, forces = (programs.get(key) for key in ("drives", "forces"))
    return compile_scene(scene, Path("."), sids, drives=drives, forces=forces)


def run(task: Run) -> Course:
    """The course of a run, or why there is none."""
    from sidtool.solver.errors import SimulationError

    try:
        system = compiled(task.scene, task.sids, task.programs)
        kernels = task.setting.integrator, task.scene.dimension
        if kernels not in _LOADED and not task.once:
            timed(system, task.setting, repeats=1)
            _LOADED.add(kernels)
        result, seconds = timed(system, task.setting, 1 if task.once else REPEATS)
    except (InputError, SimulationError) as error:
        return failed(str(error))
    reference = system if task.once else None
    return course(result, seconds, noted=task.once, system=reference)


def _silent(_: str) -> None:
    return None
