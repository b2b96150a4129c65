"""The same part said differently is the same body."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.model import ModelFile
from sidtool.geometry.nurbs_patch import (
    open_uniform_knots,
    patch_from_model,
    refine_patch,
)
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.mesh import Mesh, check_mesh
from sidtool.mesh.reference_elements import element_edges
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.metamorphic.parts.meshes import block, quarter_ring, renumbered, turned
from tests.sidtool.models import rod_data

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
    middle = {frozenset((a, b)): m for a, b, m in element_edges(part.kind)}
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
    (tmp_path / file).write_text(text(mesh), encoding="utf-8")
    found = read_mesh(tmp_path / file).mesh
    check_mesh(found)
    assert found.blocks[0].kind == kind
    there = found.positions[found.blocks[0].nodes]
    assert_allclose(there, mesh.positions[mesh.blocks[0].nodes], atol=1e-12)
    for a, b, middle in element_edges(kind):
        if middle >= 0:
            off = there[:, middle] - (there[:, a] + there[:, b]) / 2
            assert np.abs(off).max() < 0.05


def frequencies(model: ModelFile) -> np.ndarray:
    sid = sid_from_model(model)
    return np.append(np.sqrt(np.diag(sid.Ke.m0)), [sid.mass, *sid.J.m0.ravel()])


MESHED = {
    kind: block(kind, (2, 1, 2), (1.0, 0.3, 0.2), seed=7)
    for kind in ("hex8", "hex20", "wedge6", "wedge15", "tet10", "pyramid13")
}


def meshed_model(folder: Path, mesh: Mesh, unit: float = 1.0) -> Path:
    (folder / "part.msh").write_text(gmsh_text(mesh), encoding="utf-8")
    data = rod_data({"type": "mesh"})
    data["geometry"] = {"type": "mesh", "file": "part.msh", "unit": unit}
    centre = (mesh.positions.mean(axis=0) * unit).tolist()
    data["frame"] = {"type": "buckens"}
    data["markers"] = {"middle": {"node": 1, "position": centre}}
    data["reduction"] = {"method": "modal", "modes": 4}
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return folder / "model.json"


@pytest.mark.parametrize("kind", MESHED)
def test_renumbered_turned_and_in_other_units(tmp_path: Path, kind: str) -> None:
    mesh = MESHED[kind]
    sids = {
        "as it is": sid_from_model(meshed_model(tmp_path, mesh)),
        "renumbered and turned": sid_from_model(
            meshed_model(tmp_path, turned(renumbered(mesh, 5), 3))
        ),
        "in mm": sid_from_model(
            meshed_model(tmp_path, replace(mesh, positions=mesh.positions * 1e3), 1e-3)
        ),
    }
    first = sids["as it is"]
    assert first.mass == pytest.approx(7850.0 * 0.06, rel=1e-12)
    for name, sid in sids.items():
        assert sid.mass == pytest.approx(first.mass, rel=1e-11), name
        assert_allclose(np.diag(sid.Ke.m0), np.diag(first.Ke.m0), rtol=1e-7)
        values = [np.linalg.eigvalsh(_tensor(s.J.m0.ravel())) for s in (sid, first)]
        assert_allclose(*values, rtol=1e-9, err_msg=name)


def _tensor(six: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_knots_inserted_into_the_geometry() -> None:
    """The drawing with more knots and a higher degree: the same refined body."""
    settings = {"type": "iga", "degrees": [3, 3], "elements": [4, 4]}
    model = quarter_ring(settings, 1.0, 1.6)
    patch = patch_from_model(model.geometry)
    knots = (open_uniform_knots(3, 2), np.array([0, 0, 0, 0, 0.25, 0.5, 1, 1, 1, 1]))
    more = refine_patch(patch, (3, 3), knots)
    geometry = model.geometry.model_copy(
        update={
            "degrees": more.degrees,
            "knots": tuple(tuple(k.tolist()) for k in more.knots),
            "control_points": more.control_points.tolist(),
            "weights": more.weights.tolist(),
        }
    )
    other = model.model_copy(update={"geometry": geometry})
    assert_allclose(frequencies(other), frequencies(model), rtol=1e-8, atol=1e-9)


def test_plane_against_volume() -> None:
    """A thin ring bends in its plane like plane stress, and has the same mass."""
    plane = quarter_ring(
        {"type": "iga", "degrees": [3, 3], "elements": [2, 6]}, 1.0, 1.2
    )
    settings = {"type": "iga", "degrees": [3, 3, 2], "elements": [2, 6, 1]}
    modes = {"method": "modal", "modes": 8}
    solid = quarter_ring(settings, 1.0, 1.2, 0.1, reduction=modes)
    first, second = sid_from_model(plane), sid_from_model(solid)
    assert first.mass == pytest.approx(second.mass, rel=1e-9)
    found = np.sqrt(np.diag(second.Ke.m0))
    for frequency in np.sqrt(np.diag(first.Ke.m0))[:2]:
        assert np.abs(found / frequency - 1).min() < 0.01
