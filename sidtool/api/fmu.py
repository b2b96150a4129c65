"""Export of scenes as functional mock-up units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.file_names import check_ending, path_of
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.laws import without_tables
from sidtool.formats.toml.files import locate_errors

from .. import __version__
from ..fmu.supported import ignored_parts
from .operations import Path_
from .prepared_scene import prepare_scene

if TYPE_CHECKING:
    from sidtool.formats.base.sid import SID

    from ..fmu.export import ExportedUnit


def fmu(
    scene: SceneFile,
    path: Path_,
    *,
    version: str = "2.0",
    platforms: Iterable[str] = (),
    outputs: Iterable[str] | None = None,
    sids: Mapping[str, SID | Path_] | None = None,
    rigid: Iterable[str] = (),
    accept_defects: bool = False,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    linker: str | None = None,
) -> ExportedUnit:
    """Write a scene as a functional mock-up unit, see `Scene.fmu`."""
    from ..fmu.export import export_unit

    target = path_of(path, "path")
    check_ending(target, "unit", "path")
    with locate_errors(scene):
        content = scene.with_(without_tables(scene.inputs))
        if outputs is not None:
            content = content.with_({"outputs.record": list(outputs)})
        settings: dict[str, Any] = {"integrator": integrator, "rtol": rtol}
        settings |= {"step": step, "spectral_radius": None}
        prepared = prepare_scene(
            content,
            Path(scene.folder),
            sids or {},
            rigid,
            None,
            settings,
            accept_defects=accept_defects,
        )
        return export_unit(
            prepared.system,
            target,
            tool=f"sidtool {__version__}",
            version=version,
            platforms=tuple(platforms),
            integrator=integrator,
            rtol=rtol,
            step=step,
            linker=linker,
            diagnostics=[*prepared.diagnostics, *ignored_parts(scene)],
        )
