"""The same clamped rod by CalculiX itself, from its matrices and from its mesh.

CalculiX (``ccx``, Debian package calculix-ccx) solves the rod of the slider-crank as
hexahedra and tetrahedra, and writes the matrices of the free rod. sidtool clamps these,
and discretises the same input file by its own elements.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.model import ModelFile
from sidtool.formats.model.geometry import VolumeGeometry
from sidtool.formats.toml.reading import read_data, validate_data
from sidtool.geometry.nurbs_patch import patch_from_model
from sidtool.isogeometric.sampled_patch import sampled_volume
from sidtool.mesh.mesh import Mesh
from sidtool.pipeline.model_to_sid import sid_from_model

from .machine import describe_machine
from .report import Report, Table

ROD = Path(__file__).parents[1] / "examples" / "slider_crank" / "rod_q4.toml"
HALF_WIDTH = 0.005
#: Our element -> CalculiX's, elements along, across and through the rod.
CASES = {
    "hex8": ("C3D8", (60, 4, 2)),
    "hex20": ("C3D20", (30, 2, 1)),
    "tet4": ("C3D4", (60, 4, 2)),
    "tet10": ("C3D10", (30, 2, 1)),
}
MODES = 5
REMARKS = (
    "CalculiX prints seven digits of a frequency and 14 of an entry of a matrix. "
    "Entries are up to 1e9 times the lowest eigenvalue; the lost digits would shift it "
    "by 1e-6 to 1e-5 if the import did not restore the balance of forces of a free "
    "body. From the mesh hex8 and hex20 are CalculiX's elements. C3D4 and C3D10 "
    "integrate their mass with one and four points, which makes it singular; tet4 and "
    "tet10 here integrate it exactly, so that their frequencies differ and approach "
    "each other on finer meshes.",
)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure every element; an empty report where CalculiX is not installed."""
    title = "CalculiX: its frequencies from its matrices and from its mesh"
    if shutil.which("ccx") is None:
        return Report(title, [], ["ccx is not installed (Debian: calculix-ccx)."])
    rows = []
    for kind in CASES:
        say(f"  {kind}")
        with tempfile.TemporaryDirectory() as place:
            rows.append(_row(kind, Path(place)))
    header = [
        "element",
        "f1 of CalculiX, Hz",
        f"from its matrices, largest difference of f1 to f{MODES}",
        "from its mesh, f1",
        f"f2 to f{MODES}",
    ]
    table = Table("The rod clamped at the crank:", header, rows)
    return Report(title, [table], REMARKS, machine=describe_machine())


def _row(kind: str, place: Path) -> list[str]:
    own = _calculix(kind, place)
    matrices = {
        "type": "matrices",
        "stiffness": "free.sti",
        "mass": "free.mas",
        "dofs": "free.dof",
        "nodes": "free.inp",
    }
    exported = _frequencies(place, matrices) / own - 1
    meshed = _frequencies(place, {"type": "mesh", "file": "free.inp"}) / own - 1
    return [
        f"{CASES[kind][0]} ({kind})",
        f"{own[0]:.6f}",
        f"{np.abs(exported).max():.1e}",
        f"{meshed[0]:+.1e}",
        f"{meshed[1:][np.abs(meshed[1:]).argmax()]:+.1e}",
    ]


def _calculix(kind: str, place: Path) -> Any:
    """Write and solve the clamped and the free rod; (MODES,) frequencies [Hz]."""
    mesh = _mesh(kind)
    text = _input(mesh, CASES[kind][0])
    steps = {
        "clamped": f"*BOUNDARY\nLEFT,1,3\n*STEP\n*FREQUENCY\n{MODES + 1}\n*END STEP\n",
        "free": "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n6\n*END STEP\n",
    }
    for name, step in steps.items():
        (place / f"{name}.inp").write_text(text + step, encoding="utf-8")
        command = ["ccx", name]
        subprocess.run(command, cwd=place, capture_output=True, check=False)
    lines = (place / "clamped.dat").read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines]
    found = [float(r[3]) for r in rows if len(r) == 5 and r[0].isdigit()]
    return np.array(found[:MODES])


def _mesh(kind: str) -> Mesh:
    outline = read_data(ROD)["geometry"]["control_points"]
    points = [
        [[[*p, z] for z in (-HALF_WIDTH, HALF_WIDTH)] for p in c] for c in outline
    ]
    geometry = {
        "type": "nurbs_volume",
        "degrees": [2, 1, 1],
        "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]],
        "control_points": points,
    }
    data = read_data(ROD) | {"geometry": geometry}
    elements = CASES[kind][1]
    data["discretisation"] = {"type": kind, "elements": list(elements)}
    corner = {"edge": "left", "at": [0.5, 0.5]}
    data["markers"] = {"crank_pin": {"node": 1, **corner}}
    solid = validate_data(data, ModelFile).geometry
    assert isinstance(solid, VolumeGeometry)
    return sampled_volume(patch_from_model(solid), elements, kind)


def _input(mesh: Mesh, element: str) -> str:
    (block,) = mesh.blocks
    lines = ["*NODE, NSET=ALL"]
    for i, x in enumerate(mesh.positions, 1):
        lines.append(f"{i}, " + ", ".join(repr(float(v)) for v in x))
    lines.append(f"*ELEMENT, TYPE={element}, ELSET=ROD")
    for label, nodes in zip(block.labels, block.nodes + 1, strict=True):
        words = [str(label), *map(str, nodes)]
        pieces = [", ".join(words[i : i + 8]) for i in range(0, len(words), 8)]
        lines.append(",\n".join(pieces))
    left = np.flatnonzero(mesh.positions[:, 0] == 0) + 1
    lines += ["*NSET, NSET=LEFT", *(f"{n}," for n in left)]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7850."]
    return "\n".join([*lines, "*SOLID SECTION, ELSET=ROD, MATERIAL=STEEL", ""])


def _frequencies(place: Path, geometry: dict[str, Any]) -> Any:
    """(MODES,) of the rod clamped at its left end [Hz]."""
    data = read_data(ROD)
    del data["damping"], data["title"]
    if geometry["type"] == "matrices":
        del data["material"]
    data["geometry"] = geometry
    data["discretisation"] = {"type": geometry["type"]}
    data["frame"] = {"type": "tangent", "marker": "pin", "clamp": "LEFT"}
    data["markers"] = {"pin": {"node": 1, "mesh_node": 1}}
    data["reduction"] = {"method": "modal", "modes": MODES}
    path = place / "model.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return np.sqrt(np.diag(sid_from_model(path).Ke.m0)) / (2 * np.pi)
