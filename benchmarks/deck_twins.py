"""Mass and free frequencies of a converted deck beside those that CalculiX finds."""

from __future__ import annotations

import os
import re
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.convert import finite_element_model
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validated
from sidtool.frontends.finite_element_model import FiniteElementModel
from sidtool.reduction.frames import Frame
from sidtool.reduction.space import admissible
from tests.sidtool.importers.twins import FEW, mass_by_few_points

CCX_LIMIT = 40
ELEMENT = re.compile(r"^\*ELEMENT\s*,.*TYPE\s*=\s*(\w+)", re.IGNORECASE | re.MULTILINE)


@dataclass
class Difference:
    """Relative differences from CalculiX, of frequencies the largest.

    same_points : that of frequencies with the mass integrated by CalculiX's points
    """

    mass: float | None = None
    frequency: float | None = None
    same_points: float | None = None
    reason: str = ""


def beside_calculix(deck: Path, sid: Any, data: dict[str, Any]) -> Difference:
    """Mass and elastic frequencies of the free body.

    Parameters
    ----------
    deck : an .inp file
    data : the model file that made the SID of it
    """
    result, modes = Difference(), data["reduction"]["modes"]
    text = deck.read_text("latin-1")
    found = free_frequencies(text, deck.parent, modes)
    if found is None:
        result.reason = "ccx gives no frequencies of the free body"
        return result
    mass, values = found
    own = np.sqrt(np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)) / (2 * np.pi)
    count = min(len(own), len(values))
    if mass and not {"B31", "S4", "C3D8I", "S3", "M3D4"} & {
        *ELEMENT.findall(text.upper())
    }:
        result.mass = abs(sid.mass / mass - 1)
    if not count:
        return result
    result.frequency = float(np.abs(own[:count] / values[:count] - 1).max())
    few = _by_few_points(data, count)
    if few is not None:
        result.same_points = float(np.abs(few / values[:count] - 1).max())
    return result


def _by_few_points(data: dict[str, Any], modes: int) -> np.ndarray | None:
    """Frequencies [Hz] of meshes whose mass CalculiX integrates by few points, so."""
    body = finite_element_model(validated(data, ModelFile))
    if body.solids is None or body.equations is not None or body.couplings:
        return None
    mesh, materials = body.solids.mesh, body.solids.materials
    if body.point_masses or not {block.kind for block in mesh.blocks} <= set(FEW):
        return None
    mass = mass_by_few_points(mesh, materials)
    bare = FiniteElementModel(mesh.positions, mass, body.stiffness, {}, ())
    free = admissible(bare, Frame(np.zeros(3), np.zeros(bare.ndof, bool)))
    return np.sqrt(free.modes(modes)[0]) / (2 * np.pi)


def free_frequencies(
    text: str, folder: Path, modes: int
) -> tuple[float, np.ndarray] | None:
    """Mass and frequencies [Hz] of the deck without supports and steps, by ccx."""
    head = re.split(r"(?im)^\*STEP\b", text)[0]
    head = re.sub(r"(?im)^\*BOUNDARY.*\n(?:(?!\*).*\n)*", "", head)
    plane = all(k.upper().startswith("CP") for k in ELEMENT.findall(head))
    rigid = 3 if plane else 6
    step = f"\n*STEP\n*FREQUENCY\n{modes + rigid}\n*NODE FILE\nU\n*END STEP\n"
    (folder / "free.inp").write_text(head + step, "latin-1")
    with suppress(subprocess.TimeoutExpired), (folder / "log").open("w") as log:
        subprocess.run(
            ["ccx", "free"],
            cwd=folder,
            stdout=log,
            stderr=log,
            check=False,
            timeout=CCX_LIMIT,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
    output = folder / "free.dat"
    lines = output.read_text("latin-1").splitlines() if output.exists() else []
    rows = [w for w in map(str.split, lines) if len(w) in (4, 5) and w[0].isdigit()]
    values = np.array([float(w[3]) for w in rows if len(w) == 5])
    total = [w for w in map(str.split, lines) if w and w[0] == "TOTAL"]
    if len(values) <= rigid or not total or not values.any():
        return None
    return max(map(float, total[-1][1:4])), values[rigid : modes + rigid]
