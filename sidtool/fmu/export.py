"""Functional mock-up unit of a compiled scene, from its tables to the file."""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.diagnostics import Diagnostic, without
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.units import unit_of
from sidtool.formats.storage.atomic import atomic_path
from sidtool.solver.initial_state.integrator_start import run_settings
from sidtool.solver.system.system import System

from .c_source import scene_header
from .kernel_objects import kernel_objects
from .linking import SCENE_SOURCES, c_sources, choose_linker, link
from .model_description import TIME, UnitDescription, Variable, model_description
from .output_terms import output_terms
from .plant_table import ending_events, plant_tables
from .platforms import PLATFORMS, parse_platforms
from .supported import refuse_unsupported, unit_settings

VERSIONS = ("2.0", "3.0")
#: Date of the files in the archive: two exports of one scene are the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class ExportedUnit:
    """What was exported.

    Attributes
    ----------
    inputs, outputs : the variables, which are numbered in this order, from 1 on
    integrator, rtol, step : of the unit; a fixed step [s], or None
    libraries : size of the library [bytes], by platform
    size : of the file [bytes]
    diagnostics : of the scene
    """

    path: Path
    version: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    integrator: str
    rtol: float
    step: float | None
    libraries: dict[str, int]
    size: int
    diagnostics: tuple[Diagnostic, ...]


def export_unit(
    system: System,
    path: Path,
    *,
    tool: str,
    version: str = "2.0",
    platforms: Sequence[str] = (),
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    linker: str | None = None,
    diagnostics: Iterable[Diagnostic] = (),
) -> ExportedUnit:
    """Write the functional mock-up unit of a compiled scene.

    Parameters
    ----------
    tool : name and version of this program, for the description
    version : of FMI, "2.0" or "3.0"
    platforms : names in `PLATFORMS`, by default that of this machine
    integrator, rtol, step : replace those of the scene
    linker : "cc", "zig" or None for what is there
    diagnostics : of the scene so far

    Raises
    ------
    InputError : the scene cannot be a unit, or it cannot be linked.
    """
    names = parse_platforms(tuple(platforms))
    check_version(version)
    quantities = [event.quantity for event in ending_events(system.scene).values()]
    if system.full_system is not None:
        system = system.full_joint_system
    settings = unit_settings(run_settings(system, integrator, rtol, step, None))
    refuse_unsupported(system)
    tables = plant_tables(system, settings)
    scene = system.scene
    inputs, outputs = tuple(scene.inputs), scene.outputs.record
    if TIME in inputs:
        raise InputError("is a variable of every FMU", place=f"inputs.{TIME}")
    header = scene_header(
        tables,
        inputs,
        output_terms(tables, outputs),
        output_terms(tables, quantities),
    )
    for name in names:
        choose_linker(name, linker)
    identifier = model_identifier(path)
    token = unit_token(
        header, tables.start.settings.integrator, *c_sources(SCENE_SOURCES).values()
    )
    text = f'#define TOKEN "{token}"\n'
    libraries = {}
    for name in names:
        objects = kernel_objects(
            system.planar, settings.integrator, PLATFORMS[name].target
        )
        report_stage(f"linking for {PLATFORMS[name].title}")
        headers = {"scene.h": header, "token.h": text}
        libraries[name] = link(name, headers, objects, linker)
    variables = _variables(scene, inputs, outputs)
    description = UnitDescription(
        title=scene.title or identifier,
        identifier=identifier,
        token=token,
        tool=tool,
        variables=variables,
        start=scene.time.start,
        end=scene.time.end,
        step=settings.step or scene.time.output_step or 0.01,
        tolerance=settings.rtol,
    )
    write_archive(path, description, version, libraries)
    found = (*system.diagnostics, *diagnostics)
    return ExportedUnit(
        path=path,
        version=version,
        inputs=variables[: len(inputs)],
        outputs=variables[len(inputs) :],
        integrator=settings.integrator,
        rtol=settings.rtol,
        step=settings.step,
        libraries={name: len(library) for name, library in libraries.items()},
        size=path.stat().st_size,
        diagnostics=tuple(without(found, scene.diagnostics.ignore)),
    )


def check_version(version: str) -> None:
    """Check a version of FMI.

    Raises
    ------
    InputError : it is not one of `VERSIONS`.
    """
    if version not in VERSIONS:
        expected = " or ".join(VERSIONS)
        raise InputError(f"found {version!r}", place="version", expected=expected)


def model_identifier(path: Path) -> str:
    """A name of C, from the name of the file."""
    name = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    return name if name and not name[0].isdigit() else f"unit_{name}"


def _variables(
    scene: SceneFile, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> tuple[Variable, ...]:
    signals = [
        Variable(
            name,
            unit_of(f"inputs.{name}", scene),
            start=scene.inputs[name].initial,
        )
        for name in inputs
    ]
    return (*signals, *(Variable(name, unit_of(name, scene)) for name in outputs))


def unit_token(*content: str) -> str:
    """A text that identifies the content of one library."""
    digest = hashlib.sha256("".join(content).encode()).hexdigest()
    parts = (digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])
    return "{" + "-".join(parts) + "}"


def write_archive(
    path: Path, unit: UnitDescription, version: str, libraries: dict[str, bytes]
) -> None:
    """Write the file of a unit, with its description and its libraries by platform."""
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        files = {"modelDescription.xml": model_description(unit, version).encode()}
        for name, library in libraries.items():
            target = PLATFORMS[name]
            folder = target.folders[version]
            files[f"binaries/{folder}/{unit.identifier}{target.ending}"] = library
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o755 << 16
            archive.writestr(entry, content)
