"""The rod as a mesh, written as other programs write it, and models of such files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sidtool.geometry.nurbs_patch import patch_from_model
from sidtool.isogeometric.sampled_patch import sampled_volume
from sidtool.mesh.mesh import Mesh

from ..bodies import volume, volume_data

ABAQUS = {"hex8": "C3D8I", "hex20": "C3D20R", "tet4": "C3D4", "tet10": "C3D10"}
GMSH = {"hex8": 5, "hex20": 17, "tet4": 4, "tet10": 11}
GMSH_ORDER = {
    "tet10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hex20": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14],
}


def rod_mesh(kind: str) -> Mesh:
    geometry = volume({"type": kind, "elements": [6, 1, 1]}).geometry
    return sampled_volume(patch_from_model(geometry), (6, 1, 1), kind)


def inp_text(mesh: Mesh) -> str:
    (block,) = mesh.blocks
    lines = ["*HEADING", "a rod", "** a comment", "*Node, nset=Nall"]
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 10}, " + ", ".join(repr(float(v)) for v in x))
    lines.append(f"*ELEMENT, TYPE={ABAQUS[block.kind]}, ELSET=Eall")
    for label, nodes in zip(block.labels, block.nodes, strict=True):
        words = [str(label), *(str(n + 10) for n in nodes)]
        for start in range(0, len(words), 8):
            more = "," if start + 8 < len(words) else ""
            lines.append(", ".join(words[start : start + 8]) + more)
    left = mesh.node_sets["0.0"] + 10
    lines += ["*NSET, NSET=LEFT", ", ".join(map(str, left))]
    lines += ["*NSET, NSET=All, GENERATE", f"10, {len(mesh.positions) + 9}"]
    lines += ["*MATERIAL, NAME=Steel", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7850."]
    lines += ["*SOLID SECTION, ELSET=eall, MATERIAL=STEEL", "*STEP", "*STATIC"]
    return "\n".join([*lines, "*END STEP", ""])


def msh_2(mesh: Mesh) -> str:
    (block,) = mesh.blocks
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "2"]
    lines += ['0 1 "left"', '3 2 "rod"', "$EndPhysicalNames", "$Nodes"]
    lines.append(str(len(mesh.positions)))
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 10} " + " ".join(repr(float(v)) for v in x))
    lines += ["$EndNodes", "$Elements"]
    left = mesh.node_sets["0.0"] + 10
    order = GMSH_ORDER.get(block.kind, list(range(block.nodes.shape[1])))
    lines.append(str(len(left) + len(block.nodes)))
    lines += [f"{1000 + n} 15 2 1 1 {n}" for n in left]
    for label, nodes in zip(block.labels, block.nodes[:, order] + 10, strict=True):
        listed = " ".join(map(str, nodes))
        lines.append(f"{label} {GMSH[block.kind]} 2 2 1 {listed}")
    return "\n".join([*lines, "$EndElements", ""])


def msh_4(mesh: Mesh) -> str:
    (block,) = mesh.blocks
    n, left = len(mesh.positions), mesh.node_sets["0.0"] + 10
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", "2"]
    lines += ['0 1 "left"', '3 2 "rod"', "$EndPhysicalNames", "$Entities", "1 0 0 1"]
    lines += ["1 0 0 0 1 1", "1 0 0 0 1 1 1 1 2 0", "$EndEntities", "$Nodes"]
    lines += [f"1 {n} 10 {n + 9}", f"3 1 0 {n}"]
    lines += [str(i + 10) for i in range(n)]
    lines += [" ".join(repr(float(v)) for v in x) for x in mesh.positions]
    lines += ["$EndNodes", "$Elements", f"2 {len(left) + len(block.nodes)} 1 2000"]
    lines += [f"0 1 15 {len(left)}", *(f"{1000 + k} {k}" for k in left)]
    order = GMSH_ORDER.get(block.kind, list(range(block.nodes.shape[1])))
    lines.append(f"3 1 {GMSH[block.kind]} {len(block.nodes)}")
    for label, nodes in zip(block.labels, block.nodes[:, order] + 10, strict=True):
        lines.append(f"{label} " + " ".join(map(str, nodes)))
    return "\n".join([*lines, "$EndElements", ""])


FORMATS: dict[str, tuple[str, Callable[[Mesh], str]]] = {
    "inp": ("rod.inp", inp_text),
    "msh 2.2": ("rod.msh", msh_2),
    "msh 4.1": ("rod.msh", msh_4),
}


NASTRAN = {
    "hex8": "CHEXA",
    "hex20": "CHEXA",
    "tet4": "CTETRA",
    "tet10": "CTETRA",
    "wedge6": "CPENTA",
    "wedge15": "CPENTA",
    "pyramid5": "CPYRAM",
}
#: Nastran has the upright edges before those of the top.
NASTRAN_ORDERS = {
    "hex20": [*range(12), *range(16, 20), *range(12, 16)],
    "wedge15": [*range(9), *range(12, 15), *range(9, 12)],
}
ANSYS = {"hex8": 185, "hex20": 186, "tet4": 285, "tet10": 187}


BDF = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
CTETRA,1,7,1,2,3,4
PSOLID,7,5
MAT1,5,2.1+11,,0.3,7850.
SPC1,9,123,1,2,3
ENDDATA
"""


def bdf_text(mesh: Mesh) -> str:
    """A mesh in the free format of Nastran, eight fields to a line."""
    (block,) = mesh.blocks
    lines = ["BEGIN BULK", "PSOLID,7,5", "MAT1,5,2.1+11,,0.3,7850."]
    for i, x in enumerate(mesh.positions):
        lines.append(f"GRID,{i + 10},," + ",".join(f"{v:.10f}" for v in x))
    order = NASTRAN_ORDERS.get(block.kind, range(block.nodes.shape[1]))
    for label, row in zip(block.labels, block.nodes, strict=True):
        words = [str(label), "7", *(str(row[k] + 10) for k in order)]
        groups = [words[k : k + 8] for k in range(0, len(words), 8)]
        first = f"{NASTRAN[block.kind]}," + ",".join(groups[0])
        rest = ["," + ",".join(group) for group in groups[1:]]
        lines += [f"{line}," for line in [first, *rest][:-1]] + [[first, *rest][-1]]
    left = [str(n + 10) for n in mesh.node_sets["0.0"]]
    lines += [f"SPC1,9,123,{n}" for n in left]
    return "\n".join([*lines, "ENDDATA", ""])


def cdb_text() -> str:
    """A unit cube as ANSYS writes it."""
    corners = [(x ^ (y & 1), y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    lines = ["/PREP7", "ET,        1,185", "NBLOCK,6,SOLID,         8,         8"]
    lines.append("(3i9,6e21.13e3)")
    for i, corner in enumerate(corners):
        numbers = "".join(f"{x:.13f}E+000".rjust(21) for x in corner)
        lines.append(f"{i + 1:9d}{0:9d}{0:9d}" + numbers)
    lines += ["N,R5.3,LOC,       -1,", "EBLOCK,19,SOLID,         1,         1"]
    row = [1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, *range(1, 9)]
    return "\n".join(
        [*lines, "(19i9)", "".join(f"{x:9d}" for x in row), "       -1", ""]
    )


def cdb_mesh(mesh: Mesh) -> str:
    """A mesh as ANSYS writes it, with a component of nodes."""
    (block,) = mesh.blocks
    n, kind = len(mesh.positions), ANSYS[block.kind]
    lines = ["/PREP7", f"ET,        1,{kind}"]
    if kind == 185:
        lines.append("KEYOPT,1,2,3")
    lines += [f"NBLOCK,6,SOLID,{n:10d},{n:10d}", "(3i9,6e21.13e3)"]
    for i, x in enumerate(mesh.positions):
        words = "".join(_fortran(v) for v in x)
        lines.append(f"{i + 10:9d}{0:9d}{0:9d}" + words)
    count = len(block.nodes)
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{count:10d},{count:10d}"]
    lines.append("(19i9)")
    for label, row in zip(block.labels, block.nodes + 10, strict=True):
        head = [1, 1, 1, 1, 0, 0, 0, 0, len(row), 0, int(label)]
        words = [*head, *(int(v) for v in row[:8])]
        lines.append("".join(f"{x:9d}" for x in words))
        if len(row) > 8:
            lines.append("".join(f"{int(x):9d}" for x in row[8:]))
    left = [int(v) + 10 for v in mesh.node_sets["0.0"]]
    lines += ["       -1", f"CMBLOCK,LEFT    ,NODE,{len(left):8d}", "(8i10)"]
    for k in range(0, len(left), 8):
        lines.append("".join(f"{x:10d}" for x in left[k : k + 8]))
    return "\n".join([*lines, ""])


def _fortran(value: float) -> str:
    mantissa, exponent = f"{value:.13e}".split("e")
    return f"{mantissa}E{int(exponent):+04d}".rjust(21)


def mesh_model(folder: Path, file: str, **changes: Any) -> Path:
    data = volume_data({"type": "mesh"}, 5)
    data["geometry"] = {"type": "mesh", "file": file}
    data["frame"] = {"type": "tangent", "marker": "crank_pin", "clamp": "left"}
    data["markers"] = {
        "crank_pin": {"node": 1, "position": [0.0, -0.03, -0.005]},
        "piston_pin": {"node": 2, "mesh_node": 33},
    }
    (folder / "model.json").write_text(json.dumps(data | changes), encoding="utf-8")
    return folder / "model.json"
