"""Demonstration: one rod by two discretisations in a slider-crank mechanism."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.field import Field, write_field
from sidtool.formats.file_names import check_ending
from sidtool.formats.reference import ReferenceFile, read_reference
from sidtool.formats.result import Result, write_csv, write_result
from sidtool.formats.scene import read_scene
from sidtool.formats.sid_files import write_sid
from sidtool.formats.storage.unreadable import failure_reason
from sidtool.formats.text import wrapped

from ..pipeline.examples import example_folder
from ..pipeline.model_to_sid import field_from_model
from ..report.sid import natural_modes
from ..report.tables import text_table
from .common import print_warnings

Print = Callable[[str], None]

#: Short name of each rod by the name of its model file.
SOURCES = {"rod_q4": "Q4", "rod_iga": "IGA"}
#: Row of the published frequencies for each rod.
PUBLISHED = {"Q4": "paper, ANSYS", "IGA": "paper, IGA"}
#: Independent results for the Q4 rod, in minimal coordinates with DOP853 at 1e-10
#: relative.
PUBLISHED_MOTION = {
    ("piston.x", 1.0): 1.0916580040,
    ("piston.x", 1.5): 1.0847993728,
    ("rod.q1", 1.5): -4.67999958e-4,
}
#: Integrators and relative tolerances of the precision table.
SETTINGS = {
    "radau9": (1e-4, 1e-6, 1e-8),
    "trapezoidal": (1e-3, 1e-4, 1e-5),
}
REFERENCE_RTOL = 1e-11
#: Tolerance for the comparison of both rods; integration errors are negligible.
COMPARISON_RTOL = 1e-9


def run_demo(folder: Path, say: Print) -> None:
    """Convert, validate, simulate, compare and plot; write all files to `folder`.

    Raises
    ------
    InputError : the files of the example are missing, or `folder` cannot be written.
    """
    examples = example_folder("slider_crank")
    begin = time.perf_counter()
    check_ending(folder, "folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot be a folder ({failure_reason(error)})", source=folder
        ) from None
    # Compile the kernels now, so that measured times do not include it.
    from sidtool.solver.compiler.precompile import ensure_compiled
    from sidtool.solver.integrators.registry import INTEGRATORS

    ensure_compiled(
        True, [INTEGRATORS[name].step_loop for name in SETTINGS], False, say
    )
    say("1. The rod, from its geometry to Standard Input Data (SID)\n")
    sids, fields = _convert_rods(examples, folder)
    reference = read_reference(examples / "frequencies.toml")
    say(frequency_table(sids, reference) + "\n")
    say("2. The slider-crank with either rod\n")
    results = _simulate_rods(examples, sids, folder)
    say(agreement_table(results) + "\n")
    say(stiffness_remark(sids) + "\n")
    say(published_table(results["Q4"]) + "\n")
    say("3. Speed against error, rod from Q4\n")
    runs = precision_runs(examples, sids["Q4"])
    say(precision_table(runs) + "\n")
    _write_plots(folder, sids["Q4"], fields["Q4"], results, runs)
    say(_write_page(folder / "motion.html", results["Q4"], fields["Q4"]))
    seconds = time.perf_counter() - begin
    say(f"Plots, SIDs and results are in {folder} ({seconds:.1f} s in all).")


def _convert_rods(
    examples: Path, folder: Path
) -> tuple[dict[str, SID], dict[str, Field]]:
    """Return SIDs and full fields of the rod by the name of their discretisation."""
    sids, fields = {}, {}
    for file, name in SOURCES.items():
        sids[name], fields[name] = field_from_model(examples / f"{file}.toml")
        print_warnings(sids[name].diagnostics)
        write_sid(folder / f"{file}.SID_FEM", sids[name])
        write_field(folder / f"{file}.field.h5", fields[name])
    return sids, fields


def frequency_table(sids: Mapping[str, SID], reference: ReferenceFile) -> str:
    """Tabulate natural frequencies with the published and converged ones, and
    differences.
    """
    known = {row.name: row.hertz for row in reference.frequencies}
    ours = {
        name: [mode.frequency for mode in natural_modes(sid)]
        for name, sid in sids.items()
    }
    rows = []
    for name, published in PUBLISHED.items():
        rows.append([name, *(f"{value:.4f}" for value in ours[name])])
        rows.append([published, *map(str, known[published])])
        rows.append(
            _relative_differences("  difference, %", ours[name], known[published])
        )
    rows.append(["converged", *map(str, known["converged"])])
    for name in PUBLISHED:
        label = f"  {name} against it, %"
        rows.append(_relative_differences(label, ours[name], known["converged"]))
    return text_table(["Hz", "f1", "f2", "f3", "f4", "f5"], rows)


def _relative_differences(
    label: str, ours: Sequence[float], theirs: Sequence[float]
) -> list[str]:
    pairs = zip(ours, theirs, strict=True)
    return [label, *(f"{100 * (here / there - 1):+.3f}" for here, there in pairs)]


def _simulate_rods(
    examples: Path, sids: Mapping[str, SID], folder: Path
) -> dict[str, Result]:
    results = {}
    for file, name in SOURCES.items():
        results[name] = _run_demo_scene(examples, sids[name], rtol=COMPARISON_RTOL)
        write_result(folder / f"{file}.h5", results[name])
        write_csv(folder / f"{file}.csv", results[name])
    return results


def _run_demo_scene(
    examples: Path,
    sid: SID,
    integrator: str | None = None,
    rtol: float | None = None,
) -> Result:
    from sidtool.solver import compile_scene, simulate

    scene = read_scene(examples / "slider_crank.toml")
    system = compile_scene(scene, examples, sids={"rod": sid})
    return simulate(system, integrator=integrator, rtol=rtol)


def agreement_table(results: Mapping[str, Result]) -> str:
    """Tabulate the differences of the motions with the two rods by output."""
    first, second = results["Q4"], results["IGA"]
    rows = []
    for name in first.names:
        difference = np.abs(second[name] - first[name]).max()
        greatest = np.abs(first[name]).max()
        rows.append(
            [
                name,
                f"{greatest:.4e}",
                f"{difference:.2e}",
                f"{100 * difference / greatest:.2g}",
            ]
        )
    header = ["IGA against Q4", "greatest", "greatest difference", "%"]
    return text_table(header, rows)


def stiffness_remark(sids: Mapping[str, SID]) -> str:
    """Explain why the first elastic coordinates of both rods differ."""
    q4, iga = (natural_modes(sids[name])[0].frequency for name in ("Q4", "IGA"))
    share = 100 * ((q4 / iga) ** 2 - 1)
    return (
        f"Shear locking makes the Q4 rod {share:.1f} % stiffer in its first bending "
        "mode; its elastic\ncoordinates are smaller by about as much."
    )


def published_table(result: Result) -> str:
    """Tabulate the motion with the numbers of an independent computation."""
    rows = []
    for (name, at), value in PUBLISHED_MOTION.items():
        computed = float(result[name][np.searchsorted(result.t, at - 1e-9)])
        rows.append(
            [f"{name} at {at} s", f"{computed:.10g}", f"{value:.10g}"]
            + [f"{computed - value:+.1e}"]
        )
    header = ["rod from Q4", "here", "independent (DOP853)", "difference"]
    return text_table(header, rows)


def precision_runs(
    examples: Path, sid: SID
) -> dict[str, list[tuple[float, Result, float]]]:
    """Return (tolerance, run, error of q1 relative to the largest q1) by integrator."""
    tight = _run_demo_scene(examples, sid, "radau9", REFERENCE_RTOL)["rod.q1"]
    runs: dict[str, list[tuple[float, Result, float]]] = {}
    for integrator, tolerances in SETTINGS.items():
        runs[integrator] = []
        for rtol in tolerances:
            result = _run_demo_scene(examples, sid, integrator, rtol)
            error = np.abs(result["rod.q1"] - tight).max() / np.abs(tight).max()
            runs[integrator].append((rtol, result, float(error)))
    return runs


def precision_table(runs: Mapping[str, list[tuple[float, Result, float]]]) -> str:
    """Tabulate cost and error of each run."""
    rows = [
        [
            integrator,
            f"{rtol:.0e}",
            str(result.counters["steps"]),
            f"{result.counters['seconds']:.3f}",
            f"{error:.1e}",
            f"{result.drift['position']:.0e}",
        ]
        for integrator, entries in runs.items()
        for rtol, result, error in entries
    ]
    header = ["integrator", "tolerance", "steps", "seconds", "error q1", "drift m"]
    return text_table(header, rows)


def _write_page(path: Path, result: Result, field: Field) -> str:
    """Write the animation page if three.js is installed; return a line on what was
    done.
    """
    from ..view.animation import animate

    try:
        animate(result, path, fields={"rod": field}, colour="stress")
    except InputError as error:
        return wrapped(f"No page {path.name}: {error}.")
    return f"{path} plays the mechanism in a browser."


def _write_plots(
    folder: Path,
    sid: SID,
    field: Field,
    results: Mapping[str, Result],
    runs: Mapping[str, list[tuple[float, Result, float]]],
) -> None:
    from ..plot.bodies import plot_sid
    from ..plot.curves import plot_motions
    from ..plot.studies import plot_precision

    plot_sid(folder / "rod.png", sid, field)
    plot_motions(
        folder / "motion.png",
        results,
        {"piston.x": "piston x [m]", "rod.q1": "first elastic\ncoordinate q1"},
    )
    points = {
        integrator: [
            (error, float(result.counters["seconds"])) for _, result, error in entries
        ]
        for integrator, entries in runs.items()
    }
    plot_precision(folder / "precision.png", points, "relative error of q1")
