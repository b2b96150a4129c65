"""The same part said differently is the same body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.frontends.mesh import Mesh, check_mesh
from sidtool.frontends.reference_elements import all_edges
from sidtool.importers.meshes import read_mesh

from .parts import block, turned

#: Gmsh's number of a kind, and its order of the edges that have a node in the middle
#: (Gmsh reference manual, "Node ordering").
GMSH: dict[str, tuple[int, tuple[tuple[int, int], ...]]] = {
    "hex8": (5, ()),
    "tet4": (4, ()),
    "wedge6": (6, ()),
    "pyramid5": (7, ()),
    "tet10": (11, ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3))),
    "hex20": (
        17,
        (
            *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3)),
            *((2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
        ),
    ),
    "wedge15": (
        18,
        (
            *((0, 1), (0, 2), (0, 3), (1, 2), (1, 4)),
            *((2, 5), (3, 4), (3, 5), (4, 5)),
        ),
    ),
    "pyramid13": (
        19,
        ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)),
    ),
}
ABAQUS = {
    "hex8": "C3D8",
    "tet4": "C3D4",
    "wedge6": "C3D6",
    "pyramid5": "C3D5",
    "tet10": "C3D10",
    "hex20": "C3D20",
    "wedge15": "C3D15",
}


def gmsh_text(mesh: Mesh) -> str:
    (part,) = mesh.blocks
    number, edges = GMSH[part.kind]
    middle = {frozenset((a, b)): m for a, b, m in all_edges(part.kind)}
    corners = part.nodes.shape[1] - len(edges)
    order = [*range(corners), *(middle[frozenset(edge)] for edge in edges)]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes"]
    lines += [str(len(mesh.positions))]
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 1} " + " ".join(repr(float(v)) for v in x))
    lines += ["$EndNodes", "$Elements", str(len(part.nodes))]
    for label, row in zip(part.labels, part.nodes[:, order] + 1, strict=True):
        lines.append(f"{label} {number} 2 0 1 " + " ".join(map(str, row)))
    return "\n".join([*lines, "$EndElements", ""])


def abaqus_text(mesh: Mesh) -> str:
    (part,) = mesh.blocks
    lines = ["*NODE"]
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 1}, " + ", ".join(repr(float(v)) for v in x))
    lines.append(f"*ELEMENT, TYPE={ABAQUS[part.kind]}, ELSET=ALL")
    for label, row in zip(part.labels, part.nodes + 1, strict=True):
        words = [str(label), *map(str, row)]
        for start in range(0, len(words), 8):
            more = "," if start + 8 < len(words) else ""
            lines.append(", ".join(words[start : start + 8]) + more)
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "2.1e11, 0.3"]
    lines += ["*DENSITY", "7850.", "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL", ""]
    return "\n".join(lines)


FILES = [("part.msh", gmsh_text, kind) for kind in GMSH]
FILES += [("part.inp", abaqus_text, kind) for kind in ABAQUS]


@pytest.mark.parametrize(("file", "text", "kind"), FILES)
def test_formats_exchanged(tmp_path: Path, file: str, text, kind: str) -> None:  # type: ignore[no-untyped-def]
    mesh = turned(block(kind, (2, 1, 2), (1.0, 0.5, 0.7), seed=3), 1)
    (tmp_path / file).write_text(text(mesh))
    found = read_mesh(tmp_path / file).mesh
    check_mesh(found)
    assert found.blocks[0].kind == kind
    there = found.positions[found.blocks[0].nodes]
    assert_allclose(there, mesh.positions[mesh.blocks[0].nodes], atol=1e-12)
    for a, b, middle in all_edges(kind):
        if middle >= 0:
            off = there[:, middle] - (there[:, a] + there[:, b]) / 2
            assert np.abs(off).max() < 0.05
