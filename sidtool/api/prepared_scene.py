"""From a scene and the wishes of a caller to a compiled scene that can run.

`sidtool.simulate` and the command take the same steps: changes of the scene, the
cheapest model for a requested accuracy, compilation.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.result import Result, Sink
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.system.body_data import read_sids
from sidtool.solver.system.system import System

from ..accuracy.options import plan_for
from ..pipeline.scene_changes import apply_changes

if TYPE_CHECKING:  # its imports take as long as all others of a command
    from ..accuracy.plan import Plan


@dataclass(frozen=True, eq=False)
class PreparedScene:
    """A compiled scene, and the accuracy plan that its model follows.

    Attributes
    ----------
    system : the compiled scene
    diagnostics : of the changes of the scene, for its results
    plan : None if no accuracy is requested
    """

    system: System
    diagnostics: tuple[Diagnostic, ...]
    plan: Plan | None

    def known_result(self) -> Result | None:
        """Return the result that the search for the model has evaluated, if any."""
        if self.plan is None:
            return None
        return self.plan.known_result((*self.system.diagnostics, *self.diagnostics))

    def with_errors(self, result: Any) -> Any:
        """Return a result of the scene with the errors of its outputs, if requested."""
        return result if self.plan is None else self.plan.with_errors(result)

    def certified(self, sink: Sink) -> Sink:
        """Return a sink that writes the errors of the outputs with the result."""
        return sink if self.plan is None else self.plan.certified(sink)


def _content(scene: SceneFile) -> bytes | None:
    """The pickled scene; None for a class inside a function, which has no name."""
    try:
        return pickle.dumps(scene)
    except (AttributeError, pickle.PicklingError):
        return None


@lru_cache(maxsize=1)
def _compiled(
    content: bytes, sids: tuple[tuple[str, SID], ...], accept_defects: bool
) -> System:
    """Compile a scene, or return the last system if content and SIDs are the same.

    Runs do not change a system, and neither do changes of the scene: it has a copy.

    Parameters
    ----------
    content : the pickled scene
    sids : of all bodies that have one; they are immutable
    """
    return compile_scene(
        pickle.loads(content), sids=dict(sids), accept_defects=accept_defects
    )


def prepare_scene(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, Any],
    rigid: Iterable[str],
    accuracy: Any,
    settings: Mapping[str, Any],
    *,
    accept_defects: bool = False,
    drives: Mapping[str, Any] | None = None,
    forces: Mapping[str, Any] | None = None,
    searching: Callable[[str, float | None], None] | None = None,
) -> PreparedScene:
    """Change, choose and compile the model of a scene.

    Parameters
    ----------
    folder : folder of the relative paths of the scene
    sids : SIDs, or files with one, that replace those of bodies
    rigid : bodies with a SID that are simulated as rigid
    accuracy : see `sidtool.simulate`
    settings : explicit integrator, tolerance, step
    drives, forces : functions of a program, by name
    searching : called with the stage of the search for the model

    Raises
    ------
    InputError, SimulationError : see `sidtool.simulate`.
    """
    scene, replaced, notes = apply_changes(scene, folder, sids, rigid)
    plan = plan_for(
        scene,
        folder,
        replaced,
        accuracy,
        settings,
        accept_defects=accept_defects,
        drives=drives,
        forces=forces,
        progress=searching,
    )
    chosen: Mapping[str, SID] = replaced
    if plan is not None:
        scene, chosen, notes = plan.scene, dict(plan.sids), [*notes, *plan.diagnostics]
    known = read_sids(scene, folder, chosen)
    content = None if drives or forces else _content(scene)
    if content is None:
        system = compile_scene(
            scene, folder, known, accept_defects, drives, forces=forces
        )
    else:
        system = _compiled(content, tuple(known.items()), accept_defects)
    return PreparedScene(system, tuple(notes), plan)
