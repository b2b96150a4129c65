"""``sidtool stations``: check a table of stations of a beam, or make one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .common import (
    Target,
    check_targets,
    force_option,
    output_path,
    piped_path,
    print_result,
)


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
    from sidtool.formats.model.stations import read_stations, write_stations
    from sidtool.formats.toml.tables import toml_text

    from ..importers.openfast import ImportedStations, read_openfast

    check_targets([Target("-o", output, "stations")], [source], force)
    if source.suffix.lower() == ".csv":
        found = ImportedStations(read_stations(source, order))
    else:
        found = read_openfast(source, length)
    data = _summary(found, length)
    lines = [
        f"{source}: {len(found.table.position or found.table.fraction or ())} stations"
    ]
    lines += [f"{name}: {value:.8g}" for name, value in data.items()]
    lines += [f"note: {note}" for note in found.notes]
    if output is not None:
        write_stations(output, found.table, [f"from {source.name}", *found.notes])
        lines.append(f"{output}: written")
    if found.geometry and output is not None:
        geometry = found.geometry | {"sections": output.name}
        lines += ["", toml_text({"geometry": geometry}).rstrip()]
    print_result("\n".join(lines), lambda: data | {"notes": list(found.notes)})


def _summary(found: Any, length: float | None) -> dict[str, float]:
    """Mass properties along the axis, if the length is known."""
    from sidtool.formats.model.beams import BeamGeometry

    from ..beams.axis import beam_axis
    from ..beams.station_section import mass_moments, station_sections

    given = found.geometry
    if not given:
        length = found.table.position[-1] if found.table.position else length
        if length is None:
            return {}
        given = {"start": [0, 0, 0], "end": [length, 0, 0]}
    geometry = BeamGeometry(**given, sections=found.table)
    whole = beam_axis(geometry).length
    mass, first, second = mass_moments(station_sections(geometry, whole), whole)
    return {
        "length [m]": whole,
        "mass [kg]": mass,
        "centre of mass from the start [m]": first / mass,
        "second moment about the start [kg m^2]": second,
    }
