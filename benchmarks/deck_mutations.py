"""Small decks with mistakes in them: each ends with a message or with a body.

``python -m benchmarks.deck_mutations COUNT [SEED]`` mutates bytes, numbers and lines of
decks of every importer. Those that end wrongly are kept.
"""

from __future__ import annotations

import random
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from sidtool.pipeline.model_to_sid import finite_element_model
from tests.sidtool.bodies import volume
from tests.sidtool.elements.test_frontend_patches import GISMO
from tests.sidtool.importers.decks import Block, deck
from tests.sidtool.importers.mesh_files import (
    BDF,
    bdf_text,
    cdb_mesh,
    cdb_text,
    inp_text,
    msh_2,
    msh_4,
    rod_mesh,
)
from tests.sidtool.importers.test_import_matrices import FORMATS

from . import mutations

MODEL = """format = "sidtool model"
version = 1
geometry = {{{geometry}}}
discretisation = {{{discretisation}}}
frame = {{type = "buckens"}}
reduction = {{method = "modal", modes = 2}}
markers.a = {{node = 1, {marker}}}
"""
STEEL = "material = {youngs_modulus = 2.1e11, poissons_ratio = 0.3, density = 7850.0}\n"
PLANE = 'type = "mesh", state = "plane_stress"'
IGA = 'type = "iga", state = "plane_stress", degrees = [2, 2], elements = [1, 1]'
BARS = """SOL 103
CEND
BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,1.,1.,0.
GRID,4,,0.,1.,1.
CORD2R,3,,0.,0.,0.,0.,0.,1.
,1.,0.,0.
PBAR,1,5,1.-3,1.-6,2.-6,3.-6
PBARL,2,5,,TUBE
,0.1,0.08
CBAR,1,1,1,2,0.,0.,1.
CBAR,2,2,2,3,0.,0.,1.
CBAR,3,1,3,4,0.,0.,1.
CONM2,7,4,,2.5,0.1,0.,0.
,1.,0.,1.,0.,0.,1.
RBE2,8,1,123456,4
MAT1,5,2.1+11,,0.3,7850.
SPC1,9,123456,1
ENDDATA
"""
SHELLS = """*NODE
1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,1,0,1\n6,1,1,1
*ELEMENT, TYPE=S4, ELSET=E
1,1,2,3,4\n2,2,5,6,3
*MATERIAL, NAME=S
*ELASTIC
2.1e11, 0.3
*DENSITY
7850.
*SHELL SECTION, ELSET=E, MATERIAL=S
0.01
*RIGID BODY, NSET=N, REF NODE=4
*NSET, NSET=N
1,4
"""


def write_decks(root: Path) -> list[tuple[Path, Path]]:
    """Folders with a model in each, and the file of it that is mutated."""
    found = list[tuple[Path, Path]]()

    def put(
        name: str,
        text: str,
        discretisation: str = 'type = "mesh"',
        marker: str = "mesh_node = 1",
    ) -> None:
        folder = root / f"{len(found)}"
        folder.mkdir()
        (folder / name).write_text(text, encoding="utf-8")
        kind = "patches" if name.endswith(".xml") else "mesh"
        model = MODEL.format(
            geometry=f'type = "{kind}", file = "{name}"'
            + (", thickness = 0.01" if kind == "patches" else ""),
            discretisation=discretisation,
            marker=marker,
        )
        has_own = "MAT1" in text or "*ELASTIC" in text.upper()
        (folder / "model.toml").write_text(
            ("" if has_own else STEEL) + model, encoding="utf-8"
        )
        found.append((folder, folder / name))

    for kind in ("hex8", "tet10"):
        mesh = rod_mesh(kind)
        put("a.inp", inp_text(mesh), marker="mesh_node = 12")
        put("a.bdf", bdf_text(mesh), marker="mesh_node = 12")
        put("a.cdb", cdb_mesh(mesh), marker="mesh_node = 12")
        put("a.msh", msh_2(mesh), marker="mesh_node = 12")
        put("a.msh", msh_4(mesh), marker="mesh_node = 12")
    plate = Block((4, 2), (0.4, 0.2))
    put("a.inp", deck(plate, "CPS4", section="0.01"), PLANE)
    put("a.inp", deck(Block((2, 1, 1), (0.2, 0.1, 0.1)), "C3D8"))
    for name, text in (("a.bdf", BDF), ("a.cdb", cdb_text()), ("a.bdf", BARS)):
        put(name, text)
    put("a.inp", SHELLS)
    put("a.xml", GISMO, IGA, "position = [1.0, 0.0]")
    body = finite_element_model(volume({"type": "hex8", "elements": [1, 1, 1]}))
    for write in FORMATS.values():
        folder = root / f"{len(found)}"
        folder.mkdir()
        files = write(folder, body)
        geometry = ", ".join(f'{key} = "{file}"' for key, file in files.items())
        model = MODEL.format(
            geometry=f'type = "matrices", {geometry}',
            discretisation='type = "matrices"',
            marker="mesh_node = 1",
        )
        (folder / "model.toml").write_text(model, encoding="utf-8")
        found += [(folder, folder / file) for file in set(files.values())]
    return found


def outcomes(count: int, seed: str) -> Iterator[list[str]]:
    """What is wrong with the end of each conversion."""
    chance = random.Random(seed)
    root = Path(tempfile.mkdtemp(prefix="decks_"))
    decks = write_decks(root)
    mutations.import_all()
    command = ("convert", "model.toml", "-o", "made.h5")
    for k in range(count):
        folder, file = chance.choice(decks)
        copy = root / f"run_{k}"
        shutil.copytree(folder, copy)
        content = file.read_bytes()
        (copy / file.name).write_bytes(mutations.mutated(content, chance))
        wrong = mutations.run_command(command, copy)
        if not wrong:
            shutil.rmtree(copy)
        yield [f"{copy / file.name}: {text}" for text in wrong]


def main(count: int, seed: str) -> int:
    """The number of conversions that ended wrongly."""
    bad = 0
    for wrong in outcomes(count, seed):
        bad += bool(wrong)
        for text in wrong:
            print(text, flush=True)
    print(f"{count} decks, {bad} wrong", flush=True)
    return bad


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), *(sys.argv[2:] or ["1"])) != 0)
