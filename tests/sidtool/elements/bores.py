"""Plates and blocks with a bore, graded around it, as Abaqus decks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.model import ModelFile, read_model
from sidtool.mesh.mesh import ElementBlock, Mesh
from tests.metamorphic.parts.meshes import block, dimension

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

RADIUS, DEPTH = 0.015, 0.02
PLANE = {"tri3": "CPS3", "tri6": "CPS6", "quad4": "CPS4", "quad8": "CPS8"}
SOLID = {
    "tet4": "C3D4",
    "tet10": "C3D10",
    "hex8": "C3D8I",
    "hex20": "C3D20",
    "wedge6": "C3D6",
    "wedge15": "C3D15",
}
TYPES = PLANE | SOLID
#: Number of a node of the decks that no element uses.
REFERENCE = 900_000


def bored(kind: str, around: int, grading: float = 0.75) -> tuple[Mesh, Indices]:
    """A block with a bore about the z axis, and the nodes on the bore.

    The cells around it differ in width by (1 + grading) / (1 - grading), and more on
    the upper face than on the lower one; middle nodes lie on the bore.
    """
    d = dimension(kind)

    def bend(points: Array) -> Array:
        x, turn = points[:, 0], points[:, 1]
        height = points[:, 2] if d == 3 else np.ones(len(points))
        own = grading * (0.8 + 0.2 * height)
        angle = 2 * np.pi * turn + own * np.sin(2 * np.pi * turn)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        outer = 2.6 * RADIUS / np.abs(way).max(axis=1) ** 0.5
        plane = way * (RADIUS + x * (outer - RADIUS))[:, None]
        return np.column_stack([plane, *(DEPTH * points[:, 2:].T)])

    counts = (2, around, 2)[:d]
    mesh = block(kind, counts, (1.0,) * d, bend=bend)
    mesh = _closed(mesh)
    bore = np.linalg.norm(mesh.positions[:, :2], axis=1) < RADIUS * (1 + 1e-9)
    return mesh, np.flatnonzero(bore)


def _closed(mesh: Mesh) -> Mesh:
    """The mesh with the nodes of its seam merged."""
    keys = np.round(mesh.positions / (1e-7 * RADIUS)).astype(np.int64)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    (part,) = mesh.blocks
    nodes = number.ravel()[part.nodes]
    merged = ElementBlock(part.kind, nodes, part.labels)
    return Mesh(mesh.positions[first], (merged,))


def deck_text(
    mesh: Mesh, sets: dict[str, Indices], reference: Array | None = None
) -> str:
    """A mesh with node sets and a node that no element uses; nodes count from 1."""
    (part,) = mesh.blocks
    lines = ["*NODE"]
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 1}, " + ", ".join(repr(float(v)) for v in x))
    if reference is not None:
        words = ", ".join(repr(float(v)) for v in reference)
        lines.append(f"{REFERENCE}, {words}")
    lines.append(f"*ELEMENT, TYPE={TYPES[part.kind]}, ELSET=ALL")
    for label, nodes in zip(part.labels, part.nodes, strict=True):
        lines += _rows([str(label), *(str(n + 1) for n in nodes)])
    for name, nodes in sets.items():
        lines.append(f"*NSET, NSET={name}")
        for start in range(0, len(nodes), 8):
            lines.append(", ".join(str(n + 1) for n in nodes[start : start + 8]))
    return "\n".join([*lines, ""])


def _rows(words: list[str]) -> list[str]:
    rows = [", ".join(words[k : k + 8]) for k in range(0, len(words), 8)]
    return [row + "," for row in rows[:-1]] + rows[-1:]


def pinned(
    folder: Path,
    mesh: Mesh,
    sets: dict[str, Indices],
    markers: dict[str, Any],
    *,
    reference: Array | None = None,
    **geometry: Any,
) -> ModelFile:
    """A model of a mesh with markers; the first of them holds a mean-axis frame."""
    (folder / "part.inp").write_text(deck_text(mesh, sets, reference), encoding="utf-8")
    if mesh.dimension == 2:
        geometry["thickness"] = DEPTH
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3, "density": 7850},
        "geometry": {"type": "mesh", "file": "part.inp", **geometry},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": markers,
        "reduction": {"method": "modal", "modes": 2},
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return read_model(folder / "model.json")
