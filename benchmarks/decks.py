"""Public decks of other programs: which become a body, which are refused, and why.

``python -m benchmarks.decks FOLDER`` converts every .inp, .bdf, .nas, .dat and .cdb
below a folder, each in a process of its own with a time limit, as a free body with one
marker and its first elastic modes. Where ``ccx`` is installed, mass and frequencies of
Abaqus and CalculiX decks are compared with those that it finds for the free body.

What the user has to add is added alike for all: the density of steel where a material
has none, and for decks without a complete material, a thickness or a state: steel, 1
and plane stress. The decks themselves do not belong to the project; the table of
results names them.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.importers.abaqus.input_file import read_deck
from sidtool.importers.mesh_files import read_mesh
from sidtool.importers.nastran.bars import bars_of
from sidtool.importers.nastran.bulk_data import bulk_data
from sidtool.mesh.imported_mesh import ONLY_NODES
from sidtool.pipeline.model_to_sid import sid_from_model

from .deck_twins import ELEMENT, beside_calculix, prepared
from .machine import describe_machine, results_folder, use_one_thread
from .report import Report, Table, load, save

ENDINGS = (".inp", ".bdf", ".nas", ".dat", ".cdb")
MODES = 6
STEEL = {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3, "density": 7850.0}
#: What a free structure of solids or plane elements is made of, in capitals.
_SOLID = re.compile(r"(C3D|CPS|CPE)\d+\w*$")
#: What takes more than elements: contact, other parts, supports as equations, steps.
_MORE = re.compile(
    r"^\*(CONTACT PAIR|CYCLIC|TIE|EQUATION|MPC|PRE-TENSION|USER MATERIAL|HYPER|SPRING|"
    r"DASHPOT|GAP|MODEL CHANGE|FLUID|SUBMODEL|DISTRIBUTING COUPLING|CFD)",
    re.IGNORECASE | re.MULTILINE,
)


REMARK = (
    "Mass and frequencies: relative difference from CalculiX, of frequencies the "
    "largest among the first six elastic ones of the free body. CalculiX takes the "
    "mass of tetrahedra and of C3D15 by the points of their stiffness: where *same "
    "points* stands, the frequencies with such a mass. It integrates C3D20R, CPS8R and "
    "CPE8R by two points along an edge, which convert says: 1e-3 to 1e-2 on coarse "
    "meshes, by *same points* 1e-7; of one or two elements it leaves modes without "
    "stiffness (inf; achtel2 with C3D20 differs by 4e-8). Ties of sides that "
    "do not match are mortar ties here and nodes on faces there: on cubef2f3 either "
    "side as the slave gives the same to 2e-4, CalculiX 7.6e-2 less. Plane "
    "elements are solids of their thickness in CalculiX, which moves: what differs "
    "goes with the thickness (CPS8, a plate of 80 x 40: 4e-3 at 20, 6e-5 at 1.25; "
    "planestress: 0.15). Of shells, beams "
    "and C3D8 what is left are printed digits; of single cells of C3D8I internal modes "
    "vibrate by themselves (Distributing_minimal). Where rigid bodies are in a deck, "
    "CalculiX adds up a mass that is off by 2e-4. Decks of packages (calculix-ccx-test "
    "and -cgx-examples, freecad, mapdl-archive, meshio) are as they come; others are "
    "retyped from their repositories, regular meshes by their rule, with shortened "
    "case control and steps; abaqus-manuals/barrel_vault_coarse and pressurized_pipe "
    "are coarser and of another material than theirs. Nastran decks have no twin in "
    "CalculiX; tests compare bars with textbook matrices and Nastran."
)


_HEADER = ["deck", "what became of it", "mass", "frequencies", "same points", "reason"]


@dataclass
class Verdict:
    """What became of one deck.

    Attributes
    ----------
    outcome : "body", "refused", "traceback" or "hang"
    reason : of a refusal
    solid : whether it is an elastic structure of solids or plane elements alone,
        without contact, ties and equations
    mass, frequency : relative difference from CalculiX, the largest of the first
        elastic frequencies
    same_points : that of frequencies with the mass integrated by CalculiX's points
    """

    name: str
    outcome: str
    reason: str = ""
    solid: bool = False
    engine: str = "own elements"
    mass: float | None = None
    frequency: float | None = None
    same_points: float | None = None
    seconds: float = 0.0


@click.command()
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
@click.option("--limit", default=60.0, help="Seconds for one deck.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), callback=results_folder
)
@click.option("--match", default="", help="Only decks whose path holds this text.")
def main(folder: Path, limit: float, output: Path | None, match: str) -> None:
    """Convert every deck of a folder and report the outcome."""
    use_one_thread()
    files = sorted(
        p for p in folder.rglob("*") if p.suffix.lower() in ENDINGS and p.is_file()
    )
    verdicts = []
    for path in (p for p in files if match in str(p)):
        verdict = _tried(path, str(path.relative_to(folder)), limit)
        verdicts.append(verdict)
        click.echo(_line(verdict))
    report = _report(verdicts)
    click.echo(report.tables[0].text())
    if output is not None:
        others = _others(output, {v.name for v in verdicts})
        save(output, "decks", replace(report, tables=[*report.tables, *others]))


def _others(output: Path, names: set[str]) -> list[Table]:
    """What the table before says of decks that were not run again."""
    last = load(output, ["decks"])
    tables = last["decks"].tables[1:] if last else []
    rows = [row for table in tables for row in table.rows if row[0] not in names]
    return [Table("Not run again, of the table before:", _HEADER, rows)] if rows else []


def _line(v: Verdict) -> str:
    numbers = f" {_size(v.mass)} {_size(v.frequency)} {_size(v.same_points)}"
    kind = "solid" if v.solid else "-"
    by = f"{v.outcome} {v.engine[0]} {kind}{numbers} {v.seconds:.1f} s"
    return f"{v.name}: {by} {v.reason[:150]}"


def _size(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _tried(path: Path, name: str, limit: float) -> Verdict:
    """One deck in a process of its own."""
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as place:
        result = Path(place) / "result.json"
        child = context.Process(target=_child, args=(path, name, Path(place)))
        child.start()
        child.join(limit)
        if child.is_alive():
            child.kill()
            child.join()
            return Verdict(name, "hang", f"after {limit:g} s", _is_solid(path))
        if not result.exists():
            return Verdict(name, "traceback", f"ended with {child.exitcode}")
        return Verdict(**json.loads(result.read_text(encoding="utf-8")))


def _child(path: Path, name: str, place: Path) -> None:
    warnings.simplefilter("ignore")
    start = time.perf_counter()
    verdict = Verdict(name, "body", solid=_is_solid(path))
    try:
        deck = prepared(path, place)
        sid, data = _converted(deck, place)
        verdict.engine = data["geometry"].get("engine", verdict.engine)
        verdict.seconds = time.perf_counter() - start
        if deck.suffix.lower() == ".inp" and shutil.which("ccx") is not None:
            found = beside_calculix(deck, sid, data)
            verdict.reason = verdict.reason or found.reason
            verdict.mass, verdict.frequency = found.mass, found.frequency
            verdict.same_points = found.same_points
    except InputError as error:
        verdict.outcome = "refused"
        verdict.reason = str(error).replace(str(place), "").replace("\n", " ")
    except BaseException:
        verdict.outcome = "traceback"
        verdict.reason = traceback.format_exc()[-600:]
    temporary = place / "half.json"
    temporary.write_text(json.dumps(asdict(verdict)), encoding="utf-8")
    os.replace(temporary, place / "result.json")


def _is_solid(path: Path) -> bool:
    if path.suffix.lower() != ".inp":
        return False
    text = path.read_text("latin-1")
    kinds = [k.upper() for k in ELEMENT.findall(text)]
    elastic = re.search(r"^\*ELASTIC", text, re.IGNORECASE | re.MULTILINE)
    whole = bool(kinds and elastic) and not _MORE.search(text)
    return whole and all(_SOLID.match(k) for k in kinds)


def _converted(deck: Path, place: Path) -> tuple[Any, dict[str, Any]]:
    """The SID, and the model file with what the messages ask for."""
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": str(deck)},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": _a_node(deck)}},
        "reduction": {"method": "modal", "modes": MODES},
    }
    for _ in range(6):
        model = place / "model.json"
        model.write_text(json.dumps(data), encoding="utf-8")
        try:
            return sid_from_model(model), data
        except InputError as error:
            if not _answered(data, error):
                raise
    raise AssertionError("every question is asked once")


def _answered(data: dict[str, Any], error: InputError) -> bool:
    """Return whether the model file could be completed as the message requires."""
    place, requested = error.place or "", f"{error.problem} {error.expected}"
    geometry = data["geometry"]
    if "geometry.engine" in requested and "engine" not in geometry:
        geometry["engine"] = "calculix"
        return True
    if place == "geometry.thickness" and "thickness" not in data["geometry"]:
        data["geometry"]["thickness"] = 1.0
    elif place == "discretisation.state" and "state" not in data["discretisation"]:
        data["discretisation"]["state"] = "plane_stress"
    elif "geometry.density adds" in requested and not {"density"} & geometry.keys():
        geometry["density"] = STEEL["density"]
    elif "table [material]" in requested and "material" not in data:
        if "material None" in requested or "*ELASTIC" in deck_text(data):
            return False
        data["material"] = STEEL
        geometry.pop("density", None)
    elif place == "reduction.modes" and (
        most := re.search(r"at most (\d+)", requested)
    ):
        data["reduction"]["modes"] = int(most.group(1))
    else:
        return False
    return True


def deck_text(data: dict[str, Any]) -> str:
    return Path(data["geometry"]["file"]).read_text("latin-1").upper()


def _a_node(deck: Path) -> int:
    if deck.suffix.lower() == ".inp":
        elements = read_deck(deck, frozenset((ONLY_NODES,))).assembly.elements
        return next(iter(elements.values())).nodes[0] if elements else 1
    if deck.suffix.lower() in (".bdf", ".nas", ".dat"):
        content = bulk_data(deck, frozenset((ONLY_NODES,)))
        bars = [bar.nodes[0] for bar in bars_of(content)]
        return [*(nodes[0] for _, _, _, nodes, _ in content.elements), *bars, 1][0]
    mesh = read_mesh(str(deck), (ONLY_NODES,)).mesh
    return int(mesh.labels[mesh.blocks[0].nodes[0, 0]])


def _median(values: Sequence[float | None]) -> float | None:
    return float(np.median(np.array(values, float))) if values else None


def _report(verdicts: Sequence[Verdict]) -> Report:
    groups = {
        "all": verdicts,
        "elastic solids without contact, ties and equations": [
            v for v in verdicts if v.solid
        ],
        "by CalculiX as an engine": [v for v in verdicts if v.engine == "calculix"],
    }
    rows = []
    for name, group in groups.items():
        count = Counter(v.outcome for v in group)
        compared = [v for v in group if v.frequency is not None]
        rows.append(
            [
                name,
                str(len(group)),
                *(str(count[k]) for k in ("body", "refused", "traceback", "hang")),
                str(len(compared)),
                _size(_median([v.frequency for v in compared])),
            ]
        )
    header = ["decks", "number", "body", "refused", "traceback", "hang"]
    header += ["beside ccx", "frequencies, median"]
    each = [
        [
            v.name,
            v.engine if v.outcome == "body" else v.outcome,
            _size(v.mass),
            _size(v.frequency),
            _size(v.same_points),
            v.reason.replace("|", "/")[:160],
        ]
        for v in verdicts
    ]
    tables = [
        Table("What became of them:", header, rows),
        Table(
            "Every deck:",
            _HEADER,
            each,
        ),
    ]
    title = "Public decks of other programs"
    return Report(title, tables, [__doc__ or "", REMARK], machine=describe_machine())


if __name__ == "__main__":
    main()
