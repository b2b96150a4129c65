"""Functional mock-up unit of a compiled scene, from its tables to the file.

Functional mock-up unit of a linearised mechanism, for model exchange, too.
"""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, without
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.units import unit_of
from sidtool.formats.storage.atomic import atomic_path
from sidtool.solver.initial_state.integrator_start import run_settings
from sidtool.solver.system.system import System

from .c_source import scene_header
from .linking import (
    LINEAR_SOURCES,
    PLATFORMS,
    SCENE_SOURCES,
    c_sources,
    choose_linker,
    kernel_objects,
    link,
    parse_platforms,
)
from .model_description import (
    FIRST_VARIABLE,
    TIME,
    UnitDescription,
    Variable,
    model_description,
)
from .plant_table import ending_events, output_terms, plant_tables
from .supported import refuse_unsupported, unit_settings

if TYPE_CHECKING:
    from sidtool.solver.analyses.state_space import StateSpace


VERSIONS = ("2.0", "3.0")
#: Date of the files in the archive: two exports of one scene are the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)

#: Numbers in a line of a table.
_PER_LINE = 4
#: Span and communication step that the description proposes [s].
_END, _STEP = 1.0, 1e-3
#: Times in which inputs move states, and the least size of a state beside others.
_TIME_SPANS, _LEAST_SIZE = 20, 1e-9


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


def export_linear_unit(
    space: StateSpace,
    path: Path,
    *,
    tool: str,
    version: str = "2.0",
    platforms: Sequence[str] = (),
    linker: str | None = None,
) -> None:
    """Write a state space as a functional mock-up unit.

    Inputs and outputs are those of the scene, not changes of these; states are changes
    from the operating point.

    Parameters
    ----------
    tool : name and version of this program, for the description
    version : of FMI, "2.0" or "3.0"
    platforms : names in `PLATFORMS`, by default that of this machine
    linker : "cc", "zig" or None for what is there

    Raises
    ------
    InputError : there is no such version or platform, or it cannot be linked.
    """
    names = parse_platforms(tuple(platforms))
    check_version(version)
    for name in names:
        choose_linker(name, linker)
    sizes = state_sizes(space)
    header = _matrices_header(space, sizes)
    token = unit_token(header, *c_sources(LINEAR_SOURCES).values())
    headers = {"matrices.h": header, "token.h": f'#define TOKEN "{token}"\n'}
    libraries = {
        name: link(name, headers, {}, linker, LINEAR_SOURCES) for name in names
    }
    identifier = model_identifier(path)
    description = UnitDescription(
        title=space.title or identifier,
        identifier=identifier,
        token=token,
        tool=tool,
        variables=_linear_variables(space, sizes),
        start=0.0,
        end=_END,
        step=_STEP,
        tolerance=1e-6,
        is_linear=True,
    )
    write_archive(path, description, version, libraries)


def _linear_variables(space: StateSpace, sizes: Array) -> tuple[Variable, ...]:
    """Inputs, states, outputs and rates."""
    inputs = [
        Variable(name, unit, start=float(value))
        for name, unit, value in zip(
            space.input_names, space.input_units, space.inputs, strict=True
        )
    ]
    states = [
        Variable(f"states.{name}", unit, start=0.0, is_state=True, nominal=float(size))
        for name, unit, size in zip(
            space.state_names, space.state_units, sizes, strict=True
        )
    ]
    outputs = [
        Variable(name, unit)
        for name, unit in zip(space.output_names, space.output_units, strict=True)
    ]
    first = FIRST_VARIABLE + len(inputs)
    rates = [
        Variable(f"der({state.name})", _rate_unit(state.unit), rate_of=first + k)
        for k, state in enumerate(states)
    ]
    return (*inputs, *states, *outputs, *rates)


def state_sizes(space: StateSpace) -> Array:
    """Sizes (n,) of the states, for absolute tolerances of importing programs.

    A state has the size of what a step of an input does to it within a time T, which
    is about that of (I / T - A)^-1 B, at its largest for times between the fastest
    motion and a second. A step is that of 1, or of the value of the input if it is
    larger. States that no input moves have a small share of the largest size.
    """
    n, steps = len(space.A), np.maximum(np.abs(space.inputs), 1.0)
    driven = np.column_stack([space.B * steps, space.state_rates])
    fastest = max(np.abs(space.eigenvalues).max(initial=0.0), 2.0)
    sizes = np.zeros(n)
    for rate in np.geomspace(1.0, fastest, _TIME_SPANS):
        moved = np.linalg.solve(rate * np.eye(n) - space.A, driven)
        sizes = np.fmax(sizes, np.abs(moved).max(axis=1))
    largest = sizes.max(initial=0.0)
    return np.maximum(sizes, _LEAST_SIZE * largest) if largest > 0.0 else sizes + 1.0


def _rate_unit(unit: str) -> str:
    return f"{unit}/s" if unit else "1/s"


def _matrices_header(space: StateSpace, nominals: Array) -> str:
    """The matrices as constants of C."""
    tables = {
        "A": space.A,
        "B": space.B,
        "C": space.C,
        "D": space.D,
        "INPUTS": space.inputs,
        "OUTPUTS": space.outputs,
        "RATES": space.state_rates,
        "NOMINALS": nominals,
    }
    sizes = zip(
        ("N_STATES", "N_INPUTS", "N_OUTPUTS"),
        (len(space.A), len(space.inputs), len(space.outputs)),
        strict=True,
    )
    lines = (f"#define {name} {size}" for name, size in sizes)
    return "\n".join(chain(lines, *(_table(*item) for item in tables.items()))) + "\n"


def _table(name: str, values: Array) -> Iterable[str]:
    """A table of C, by rows; hexadecimal numbers are exact. One without entries has a
    zero, as C has no empty tables.
    """
    numbers = [float(x).hex() for x in np.ravel(values)] or ["0.0"]
    yield f"static const double {name}[{len(numbers)}] = {{"
    for first in range(0, len(numbers), _PER_LINE):
        yield f"    {', '.join(numbers[first : first + _PER_LINE])},"
    yield "};"
