"""Input files of small blocks, models of them, and CalculiX's answer to them."""

from __future__ import annotations

import json
import re
import subprocess
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model

from .mesh_files import mesh_model

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
MATERIAL = "*MATERIAL, NAME=S\n*ELASTIC\n{e!r}, {nu!r}\n*DENSITY\n{rho!r}\n"
STEEL = {"e": 2.1e11, "nu": 0.3, "rho": 7850.0}


class Block:
    """A regular block of quadrilaterals or hexahedra and its numbers."""

    def __init__(self, counts: tuple[int, ...], size: tuple[float, ...]) -> None:
        steps = [range(n + 1) for n in counts]
        places = sorted(product(*steps), key=lambda p: p[::-1])
        self.number = {place: i for i, place in enumerate(places, 1)}
        self.points = [
            tuple(s * i / n for s, i, n in zip(size, p, counts, strict=True))
            for p in places
        ]
        self.elements = [
            self._corners(at) for at in product(*(range(n) for n in counts))
        ]
        self.left = [n for p, n in self.number.items() if p[0] == 0]
        self.right = [n for p, n in self.number.items() if p[0] == counts[0]]

    def _corners(self, at: tuple[int, ...]) -> list[int]:
        ups = [(0,), (1,)] if len(at) == 3 else [()]
        steps = [(*c, *up) for up in ups for c in CORNERS]
        return [
            self.number[tuple(a + s for a, s in zip(at, x, strict=True))] for x in steps
        ]

    def node_lines(self, scale: float = 1.0) -> str:
        rows = (
            f"{i}, " + ", ".join(repr(scale * x) for x in point)
            for i, point in enumerate(self.points, 1)
        )
        return "\n".join(rows) + "\n"

    def element_lines(self) -> str:
        rows = (
            f"{i}, " + ", ".join(map(str, e)) for i, e in enumerate(self.elements, 1)
        )
        return "\n".join(rows) + "\n"


def listed(name: str, nodes: list[int]) -> str:
    rows = [nodes[i : i + 12] for i in range(0, len(nodes), 12)]
    lines = [", ".join(map(str, row)) for row in rows]
    return "\n".join([f"*NSET, NSET={name}", *lines, ""])


def deck(
    block: Block,
    kind: str,
    *,
    scale: float = 1.0,
    material: dict[str, float] = STEEL,
    section: str = "",
) -> str:
    """A flat deck; the set LEFT holds the nodes at x = 0."""
    return (
        "*NODE\n"
        + block.node_lines(scale)
        + f"*ELEMENT, TYPE={kind}, ELSET=E\n"
        + block.element_lines()
        + listed("LEFT", block.left)
        + MATERIAL.format(**material)
        + f"*SOLID SECTION, ELSET=E, MATERIAL=S\n{section}\n"
    )


def body(folder: Path, text: str, *, held: str | None = None, **geometry: Any) -> SID:
    """The SID of a deck: free, or held at a node set and with its first modes."""
    return sid_from_model(deck_file(folder, text, held=held, **geometry))


def deck_file(
    folder: Path, text: str, *, held: str | None = None, **geometry: Any
) -> Path:
    (folder / "part.inp").write_text(text, encoding="utf-8")
    frame: dict[str, Any] = {"type": "buckens"}
    if held:
        frame = {"type": "tangent", "marker": "p", "clamp": held}
    path = mesh_model(
        folder,
        "part.inp",
        frame=frame,
        markers={"p": {"node": 1, "mesh_node": 1}},
        reduction={"method": "modal", "modes": 4},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    data["discretisation"].update(geometry.pop("discretisation", {}))
    data["geometry"].update(geometry)
    del data["material"]
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def frequencies(sid: SID) -> np.ndarray:
    return np.sqrt(np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)) / (2 * np.pi)


def calculix(folder: Path, text: str, held: str | None) -> np.ndarray:
    """The first elastic frequencies by CalculiX, a set held in all directions."""
    rigid = 0 if held else 6
    step = f"*STEP\n*FREQUENCY\n{4 + rigid}\n*NODE FILE\nU\n*END STEP\n"
    if held:
        step = f"*BOUNDARY\n{held}, 1, 3\n" + step
    (folder / "ccx.inp").write_text(text + step, encoding="utf-8")
    command = ["ccx", "ccx"]
    subprocess.run(command, cwd=folder, capture_output=True, check=True, timeout=120)
    lines = (folder / "ccx.dat").read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines if re.match(r"\s+\d+\s+-?0\.\d+E", line)]
    return np.array([float(row[3]) for row in rows[rigid : rigid + 4]])
