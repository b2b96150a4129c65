"""``sidtool stations``: check a table of stations of a beam, or make one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import (
    Target,
    check_targets,
    force_option,
    output_path,
    piped_path,
    print_result,
)

if TYPE_CHECKING:
    from ..importers.openfast import ImportedStations


@click.command()
@click.argument("source", metavar="FILE", type=piped_path)
@click.option(
    "-o", "--output", type=output_path, help="Table of stations to write (CSV)."
)
@click.option(
    "--length",
    type=click.FloatRange(min=0.0, min_open=True),
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
