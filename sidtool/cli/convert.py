"""``sidtool convert``: convert a model or a SID to a SID file.

``sidtool stations``: check a table of stations of a beam, or make one.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import (
    RealRange,
    Target,
    changes_option,
    check_targets,
    force_option,
    ignored_codes,
    input_files,
    name_with_size,
    output_path,
    piped_path,
    print_result,
    print_warnings,
)
from .progress import StageLines, StageTimes

if TYPE_CHECKING:
    from ..importers.openfast import ImportedStations


DIALECTS = ("fembs", "pysid", "matmorembs", "fembeam")
SIGMAS = ("stress", "section force")
ENGINES = ("cholmod", "pardiso", "superlu", "slepc", "multigrid")
#: Environment variables with the number of MPI processes (Open MPI, MPICH).
_MPI_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


@click.command()
@click.argument("source", metavar="MODEL_OR_SID", type=piped_path)
@click.option(
    "-o",
    "--output",
    required=True,
    type=output_path,
    help="SID to write; .h5 gives HDF5.",
)
@click.option(
    "--field",
    "field",
    type=output_path,
    help=(
        "Also write the full field of a model: mesh, surface, shape functions "
        "and stresses at all nodes, for animations and exports (HDF5)."
    ),
)
@click.option(
    "--dialect",
    type=click.Choice(DIALECTS),
    default="fembs",
    show_default=True,
    help=(
        "Dialect of an ASCII file, for readers that do not accept the canonical one."
    ),
)
@click.option(
    "--engine",
    type=click.Choice(ENGINES),
    help=(
        "Solver for the equations of a model; default the first of these that "
        "is installed. slepc distributes the work over the processes of mpirun; "
        'multigrid (pip install "sidtool[multigrid]") needs the least memory for '
        "large solids."
    ),
)
@click.option(
    "--repair",
    is_flag=True,
    help="Rebuild Gr and Ge, symmetrise Oe, and list every changed number.",
)
@click.option(
    "--units", metavar="FROM:TO", help="Rescale every block, for example mm-t-s:SI."
)
@click.option(
    "--sigma",
    type=click.Choice(SIGMAS),
    help=(
        "Meaning of the entry sigma of nodes; --units needs it for SIDs of "
        "other programs."
    ),
)
@click.option(
    "--frame",
    metavar="FRAME",
    help=(
        "Change the body frame: tangent:NODE, chord:NODE,NODE, buckens or "
        "buckens:NODE. Ke and De do not change: they belong to the elastic "
        "coordinates."
    ),
)
@click.option(
    "--damping",
    metavar="LAW",
    help=(
        "Compute De from Me and Ke: none, rayleigh:ALPHA,BETA, "
        "modal:RATIO[,...] or frequency."
    ),
)
@click.option(
    "-v", "--verbose", is_flag=True, help="Print all notes of the conversion."
)
@click.option(
    "--timing", is_flag=True, help="Print how long each stage of the conversion took."
)
@changes_option
@force_option
def convert(
    source: Path,
    output: Path,
    field: Path | None,
    dialect: str,
    engine: str | None,
    repair: bool,
    units: str | None,
    sigma: str | None,
    frame: str | None,
    damping: str | None,
    verbose: bool,
    timing: bool,
    changes: tuple[str, ...],
    force: bool,
) -> None:
    """Convert a model file to a SID, or a SID to another SID file.

    The content of the source determines its kind. The ending of the output determines
    its format: .h5 or .hdf5 is HDF5, any other name is ASCII.

    A SID holds the motion of a few nodes only. `--field FILE` writes the motion of the
    whole body to a second file. If this is named like the SID with the ending
    .field.h5, animations and plots find it by themselves.

    \b
    Examples:
      sidtool convert rod_q4.toml -o rod.SID_FEM
      sidtool convert rod_q4.toml -o rod.SID_FEM --field rod.field.h5
      sidtool convert rod_q4.toml -o thick.SID_FEM --set geometry.thickness=0.02
      sidtool convert housing.toml -o housing.h5 --timing
      sidtool convert rod.SID_FEM -o rod.h5
      sidtool convert beam.SID_FEM -o better.SID_FEM --repair
      sidtool convert beam.SID_FEM -o beam_si.SID_FEM --units mm-t-s:SI
      sidtool convert rod.h5 -o rod.SID_FEM --dialect pysid
      sidtool convert rod.SID_FEM -o mean.SID_FEM --frame buckens
      sidtool convert rod.SID_FEM -o damped.SID_FEM --damping modal:0.02
      mpirun -n 2 sidtool convert rod_q4.toml -o rod.h5 --engine slepc
    """
    begin = time.perf_counter()
    with _processes(engine) as processes:
        targets = [Target("-o", output, "sid"), Target("--field", field, "field")]
        named = [text.partition("=")[2] for text in changes]
        check_targets(targets, [*input_files(source), *named], force)
        _check_field(field, source, units, frame)
        times = StageTimes() if timing else None
        sid, model, converted = _read_or_convert(
            source, changes, engine, processes.rank == 0, field is not None, times
        )
        stages = times.seconds() if times else []
        processes.wait_for_all()
        if processes.rank > 0:
            return
        sid = _repair_sid(sid) if repair else sid
        sid = _rescale_sid(sid, units, sigma) if units else sid
        sid = _in_frame(sid, frame) if frame else sid
        sid = _with_damping(sid, damping) if damping else sid
        from sidtool.formats.sid_files import write_sid

        from ..report.sid import describe_conversion

        write_sid(output, sid, dialect)
        files = [name_with_size(output)]
        if field is not None:
            files.append(_write_field(field, converted.field))
        seconds = time.perf_counter() - begin
        lines = [describe_conversion(sid, seconds, files, model, converted)]
        lines += _more_lines(sid, verbose, stages)
        print_result("\n".join(lines), lambda: _sid_data(sid, stages))


def _check_field(
    field: Path | None, source: Path, units: str | None, frame: str | None
) -> None:
    """Check that --field is used with a model."""
    from sidtool.formats.base.errors import InputError

    from ..pipeline.files import expect_kind

    if field is None:
        return
    if expect_kind(source, "model", "sid") == "sid":
        raise InputError(
            "is a SID, which does not hold the whole body",
            source=source,
            place="--field",
            expected="the model that it came from",
        )
    for option, value in (("--units", units), ("--frame", frame)):
        if value is not None:
            raise InputError(
                f"does not go with {option}, which changes what the field is in",
                place="--field",
                expected="frame and units as the model says them",
            )


def _write_field(path: Path, field: Any) -> str:
    from sidtool.formats.field import write_field
    from sidtool.formats.text import counted_noun

    write_field(path, field)
    stress = "and stresses" if field.stress is not None else "without stresses"
    points = counted_noun(len(field.positions), "point")
    return f"{name_with_size(path)} with {points} {stress}"


def _more_lines(sid: Any, verbose: bool, stages: list[tuple[str, float]]) -> list[str]:
    """Return all notes of the conversion, and the durations of its stages."""
    from ..report.diagnostics import diagnostic_line
    from ..report.tables import text_table

    infos = [each for each in sid.diagnostics if not each.is_warning]
    lines = [diagnostic_line(each) for each in infos if verbose]
    if stages:
        rows = [[name, f"{duration:.1f} s"] for name, duration in stages]
        lines.append(text_table(["stage", "duration"], rows))
    return lines


def _sid_data(sid: Any, seconds: list[tuple[str, float]]) -> Any:
    from ..report.json_data import sid_data

    stages = [{"stage": name, "seconds": duration} for name, duration in seconds]
    return sid_data(sid) | ({"timing": stages} if stages else {})


class _SingleProcess:
    """Stand-in for `slepc.Processes` if there is only one process."""

    rank = 0

    def wait_for_all(self) -> None:
        """Do nothing: there are no other processes."""


@contextmanager
def _processes(engine: str | None) -> Iterator[Any]:
    """Yield the parallel processes of this run; only the first one prints and writes.

    Raises
    ------
    InputError : the engine is not installed, or mpirun was used with a serial engine.
    """
    requested = engine or os.environ.get("SIDTOOL_FACTORS")
    if requested != "slepc":
        _refuse_mpirun()
        yield _SingleProcess()
        return
    from ..eigensolvers.slepc import PartnerFailed, parallel_run

    try:
        with parallel_run() as processes:
            yield processes
    except PartnerFailed:
        click.get_current_context().exit(1)


def _refuse_mpirun() -> None:
    from sidtool.formats.base.errors import InputError

    count = next((os.environ[name] for name in _MPI_SIZES if name in os.environ), "1")
    if count != "1":
        raise InputError(
            f"mpirun started {count} processes that would all do the same",
            place="--engine",
            expected="slepc, the engine that shares the work",
        )


def _read_or_convert(
    source: Path,
    changes: tuple[str, ...],
    engine: str | None,
    leading: bool,
    with_field: bool,
    times: StageTimes | None,
) -> tuple[Any, Any, Any]:
    """Read or convert the source; return the SID, and of a model its content and the
    `ConvertedModel`.
    """
    from sidtool.formats.base.errors import InputError
    from sidtool.formats.model import read_model
    from sidtool.formats.toml.files import ignoring, parse_settings

    from ..pipeline.files import expect_kind

    if expect_kind(source, "model", "sid") == "sid":
        from ..api.scene import read

        for option, given in (("--set", changes), ("--timing", times)):
            if given:
                raise InputError(
                    "is a SID", source=source, place=option, expected="it with a model"
                )
        return read(source), None, None
    from ..eigensolvers.factorisation import engine_name
    from ..eigensolvers.slepc import use_engine
    from ..pipeline.model_to_sid import convert_model

    with use_engine(engine):
        engine_name()
    model = read_model(source, parse_settings(changes))
    model = ignoring(model, ignored_codes())
    lines = StageLines()

    def progress(text: str) -> None:
        if times:
            times(text)
        if leading:
            lines(text)

    converted = convert_model(model, progress, engine, with_field)
    if leading:
        print_warnings(converted.sid.diagnostics)
    return converted.sid, model, converted


def _in_frame(sid: Any, frame: str) -> Any:
    from ..conversion.frame_change import change_frame

    with _name_option("--frame"):
        return change_frame(sid, frame)


def _with_damping(sid: Any, law: str) -> Any:
    from ..conversion.damping import with_damping_law

    with _name_option("--damping"):
        return with_damping_law(sid, law)


@contextmanager
def _name_option(name: str) -> Iterator[None]:
    """Name this option in errors that are raised inside the context."""
    from sidtool.formats.base.errors import InputError

    try:
        yield
    except InputError as error:
        raise InputError(error.problem, place=name, expected=error.expected) from None


def _repair_sid(sid: Any) -> Any:
    from sidtool.formats.text import counted_noun

    from ..report.tables import text_table
    from ..validate import repair

    better, changes = repair(sid)
    if changes:
        rows = [
            [c.block, c.entry, f"{c.before:.11e}", f"{c.after:.11e}", c.reason]
            for c in changes
        ]
        click.echo(text_table(["block", "entry", "before", "after", "because"], rows))
    click.echo(f"repair: {counted_noun(len(changes), 'number')} changed")
    return better


def _rescale_sid(sid: Any, units: str, sigma: Any) -> Any:
    from sidtool.formats.base.errors import InputError

    from ..validate import convert_units

    old, colon, new = units.partition(":")
    if not (old and colon and new):
        raise InputError(
            f"found {units!r}", place="--units", expected="FROM:TO, as in mm-t-s:SI"
        )
    return convert_units(sid, old, new, sigma)


@click.command()
@click.argument("source", metavar="FILE", type=piped_path)
@click.option(
    "-o", "--output", type=output_path, help="Table of stations to write (CSV)."
)
@click.option(
    "--length",
    type=RealRange(min=0.0, min_open=True),
    help="Length of the beam in m, if the positions of the file are fractions.",
)
@click.option(
    "--order",
    type=click.Choice(["sidtool", "vabs", "beamdyn", "hawc2", "becas"]),
    default="sidtool",
    show_default=True,
    help="Order of the rows of 6 x 6 matrices in a CSV file.",
)
@force_option
def stations(
    source: Path, output: Path | None, length: float | None, order: str, force: bool
) -> None:
    """Check a table of stations of a beam, or make one from a file of OpenFAST.

    FILE is a CSV file of stations, an ElastoDyn blade or tower file, or a BeamDyn
    primary or blade file. The command prints mass, centre of mass and second moment,
    values that the file lacks, and the geometry for the model file.

    \b
    Columns of a CSV file, with their units in brackets:
      position [m] or [1], mass_per_length [kg/m], EA [N], EI_y [N m^2],
      EI_z [N m^2], GJ [N m^2]; GA_y [N], GA_z [N], twist [deg], mass_y [m],
      mass_z, tension_y, tension_z, shear_y, shear_z, inertia_y [kg m],
      inertia_z, inertia_yz; or K11 ... K66 and M11 ... M66 instead

    \b
    Examples:
      sidtool stations blade.csv --length 61.5
      sidtool stations NREL5MW_Blade.dat -o blade.csv --length 61.5
      sidtool stations NREL5MW_BeamDyn.dat -o blade.csv
    """
    from sidtool.formats.model.stations import write_stations
    from sidtool.formats.toml.tables import toml_text

    from ..importers.openfast import read_openfast
    from ..report.diagnostics import remark_line

    check_targets([Target("-o", output, "stations")], [source], force)
    own = source.suffix.lower() == ".csv"
    found = _own_table(source, order, length) if own else read_openfast(source, length)
    data = _summary(found)
    lines = [
        f"{source}: {len(found.table.position or found.table.fraction or ())} stations"
    ]
    lines += [f"{name}: {value:.8g}" for name, value in data.items()]
    lines += map(remark_line, found.notes)
    if output is not None:
        write_stations(output, found.table, [f"from {source.name}", *found.notes])
        lines.append(f"{output}: written")
    if found.geometry and (own or output is not None):
        sections: Any = (output or source).name
        if output is None and found.table.stiffness and order != "sidtool":
            sections = {"file": sections, "order": order}
        geometry = found.geometry | {"sections": sections}
        lines += ["", toml_text({"geometry": geometry}).rstrip()]
    print_result("\n".join(lines), lambda: data | {"notes": list(found.notes)})


def _own_table(source: Path, order: str, length: float | None) -> ImportedStations:
    """Read a CSV file, and note what it does not contain."""
    from sidtool.formats.model.stations import read_stations

    from ..importers.openfast import ImportedStations, straight_geometry

    table = read_stations(source, order)
    length = table.position[-1] if table.position else length
    notes = []
    if length is None:
        notes.append("the positions are fractions: the mass needs --length")
    if table.EA and not table.GA_y:
        notes.append('no GA_y and GA_z: theory = "timoshenko" needs them')
    if table.EA and not table.inertia_y:
        notes.append("no inertia_y and inertia_z: they are mass_per_length EI / EA")
    geometry = {} if length is None else straight_geometry(length)
    return ImportedStations(table, geometry, tuple(notes))


def _summary(found: ImportedStations) -> dict[str, float]:
    """Mass properties along the axis, if the length is known."""
    from sidtool.formats.model.beams import BeamGeometry

    from ..beams.axis import beam_axis
    from ..beams.station_section import mass_moments, station_sections

    if not found.geometry:
        return {}
    geometry = BeamGeometry(**found.geometry, sections=found.table)
    whole = beam_axis(geometry).length
    mass, first, second = mass_moments(station_sections(geometry, whole), whole)
    return {
        "length [m]": whole,
        "mass [kg]": mass,
        "centre of mass from the start [m]": first / mass,
        "second moment about the start [kg m^2]": second,
    }
