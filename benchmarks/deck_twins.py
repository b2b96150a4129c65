"""Decks with densities, and their masses and frequencies beside those of CalculiX."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, eigh

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.matrix_sums import MatrixSum
from sidtool.elements.solid_elements import (
    elasticity,
    element_mass,
    element_stiffness,
    mapped_batch,
)
from sidtool.elements.solid_mesh import SolidMesh
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.importers.calculix_engine import free_deck, run_calculix
from sidtool.mesh.reference_elements import reference_element
from sidtool.pipeline.model_to_sid import finite_element_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import Frame
from tests.sidtool.importers.twins import FEW, mass_by_few_points

CCX_LIMIT, SMALL = 40, 600
#: Elements that CalculiX integrates by two points along an edge, and the unknowns up
#: to which that is done here.
_REDUCED, _DENSE = ("hex20", "quad8"), 4_000
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


def prepared(path: Path, place: Path) -> Path:
    """The deck with a density for every material that has none, beside its includes."""
    folder = place / "deck"
    shutil.copytree(path.parent, folder, ignore=_only_near(path))
    deck = folder / path.name
    if path.suffix.lower() == ".inp":
        text = path.read_text("latin-1")
        deck.write_text(_with_densities(text), "latin-1")
    return deck


def _only_near(path: Path) -> Any:
    """What a deck may include, without the other decks of a large folder."""
    names = set(re.findall(r"[\w.\-]+", path.read_text("latin-1")[:200_000]))

    def ignored(_: str, files: Sequence[str]) -> set[str]:
        return {f for f in files if f != path.name and f not in names}

    return ignored


def _with_densities(text: str) -> str:
    parts = re.split(r"(?im)^(?=\*MATERIAL\b)", text)
    for i, part in enumerate(parts[1:], 1):
        own, *rest = re.split(
            r"(?im)^(?=\*(?!ELASTIC|DENSITY|EXPANSION|PLASTIC|CONDUCTIVITY|SPECIFIC|"
            r"MATERIAL|CREEP|DEPVAR|USER|CYCLIC|DAMPING|\*))",
            part,
        )
        if re.search(r"(?im)^\*ELASTIC", own) and not re.search(
            r"(?im)^\*DENSITY", own
        ):
            own = own.rstrip("\n") + f"\n*DENSITY\n{_density(own)}\n"
        parts[i] = own + "".join(rest)
    return "".join(parts)


def _density(material: str) -> str:
    """Return the density of steel in the units of the modulus of elasticity."""
    found = re.search(r"(?im)^\*ELASTIC.*\n\s*([^,\s]+)", material)
    return "7.85e-9" if found and float(found.group(1)) < 1e8 else "7850."


def beside_calculix(deck: Path, sid: Any, data: dict[str, Any]) -> Difference:
    """Mass and elastic frequencies of the free body.

    Parameters
    ----------
    deck : an .inp file
    data : the model file that made the SID of it
    """
    result, modes = Difference(), data["reduction"]["modes"]
    text = deck.read_text("latin-1")
    if re.search(r"(?im)^\*(NGEN|ELGEN)", text):
        text = "\n".join(free_deck(deck))
    frequencies = free_frequencies(text, deck.parent, modes) or _by_matrices(
        deck, modes
    )
    if frequencies is None:
        result.reason = "ccx gives no frequencies of the free body"
        return result
    mass, values = frequencies
    own = np.sqrt(np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)) / (2 * np.pi)
    count = min(len(own), len(values))
    if mass and not {"B31", "S4", "C3D8I", "S3", "M3D4"} & {
        *ELEMENT.findall(text.upper())
    }:
        result.mass = abs(sid.mass / mass - 1)
    if not count:
        return result
    result.frequency = float(np.abs(own[:count] / values[:count] - 1).max())
    few = _by_few_points(text, data, count)
    if few is not None and len(few) == count:
        result.same_points = float(np.abs(few / values[:count] - 1).max())
    return result


def _by_few_points(text: str, data: dict[str, Any], modes: int) -> np.ndarray | None:
    """Frequencies [Hz] of meshes that CalculiX integrates by few points, so.

    Of tetrahedra and C3D15 the mass, of C3D20R, CPS8R and CPE8R all. Modes of reduced
    integration that have neither stiffness nor mass make a pencil singular: None.
    """
    body = finite_element_model(validate_data(data, ModelFile))
    if body.solids is None or body.equations is not None or body.couplings:
        return None
    if body.point_masses:
        return None
    kinds = {block.kind for block in body.solids.mesh.blocks}
    types = set(ELEMENT.findall(text.upper()))
    if kinds <= set(FEW):
        mass = mass_by_few_points(body.solids.mesh, body.solids.materials)
        plain = FiniteElementModel(body.positions, mass, body.stiffness, {}, ())
        free = constrained_space(plain, Frame(np.zeros(3), np.zeros(plain.ndof, bool)))
        return np.sqrt(free.modes(modes)[0]) / (2 * np.pi)
    if kinds <= set(_REDUCED) and all(kind.endswith("R") for kind in types):
        return _reduced(body.solids, modes)
    return None


def _reduced(solids: SolidMesh, modes: int) -> np.ndarray | None:
    """Of quadratic squares and cubes by two points along each edge."""
    mesh, ends = solids.mesh, np.array([0.5 - 12**-0.5, 0.5 + 12**-0.5])
    n, d = mesh.positions.shape
    points = np.array(list(product(ends, repeat=d)))
    sums = MatrixSum(n, d, 1)
    for block in mesh.blocks:
        values, slopes = reference_element(block.kind).at(points)
        weights, material = np.full(len(points), 2.0**-d), solids.materials
        batch = mapped_batch(
            block.nodes, mesh.positions, values[None], slopes[None], weights
        )
        own, depth = material[block.material], block.thickness or solids.thickness
        law = elasticity(own, solids.state) * depth
        density = own.density * depth
        matrices = element_stiffness(batch, law), element_mass(batch, density)
        sums.add(block.nodes, *matrices)
    k, m = sums.total()
    if k.shape[0] > _DENSE:
        return None
    whole = np.kron(m.toarray(), np.eye(d))
    return _frequencies(k.toarray(), whole, 3 if d == 2 else 6, modes)


def _frequencies(k: np.ndarray, m: np.ndarray, rigid: int, modes: int) -> Any:
    """Of a free body [Hz]; None of a pencil that is singular but for these."""
    shift = 1e-3 * np.trace(k) / np.trace(m)
    try:
        inverse = eigh(m, k + shift * m, eigvals_only=True)[::-1]
    except LinAlgError:
        return None
    squares = 1 / inverse[: rigid + modes] - shift
    if (np.abs(squares[:rigid]) > 1e-6 * squares[rigid]).any():
        return None
    return np.sqrt(squares[rigid:]) / (2 * np.pi)


def _by_matrices(deck: Path, modes: int) -> tuple[float, np.ndarray] | None:
    """The same from CalculiX's matrices: its eigenvalues fail for few unknowns."""
    try:
        found = run_calculix(free_deck(deck), deck)
    except InputError:
        return None
    k, m = found.stiffness.toarray(), found.mass.toarray()
    if len(k) > SMALL:
        return None
    dofs, along = found.dofs[:, 1], np.zeros((len(k), 3))
    along[range(len(k)), dofs - 1] = found.dofs[:, 0] <= found.nodes.max()
    values = _frequencies(k, m, 6, modes)
    total = np.einsum("ia,ij,ja->a", along, m, along).max()
    return None if values is None else (float(total), values)


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
    with (
        suppress(subprocess.TimeoutExpired),
        (folder / "log").open("w", encoding="utf-8") as log,
    ):
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
