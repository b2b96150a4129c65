"""A part by sidtool and by CalculiX on the same mesh with the same nodal loads."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.elements.faces import named_surface
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.markers import MeshPoints
from sidtool.elements.material_points import stress_rows
from sidtool.elements.matrix_sums import MatrixSum
from sidtool.elements.solid_elements import element_mass, mapped_batch
from sidtool.elements.solid_mesh import SolidMesh, mesh_continua, mesh_matrices
from sidtool.formats.sid_mass import skew
from sidtool.importers.calculix_engine import free_deck, run_calculix
from sidtool.mesh.materials import ElasticMaterial
from sidtool.mesh.mesh import Mesh
from sidtool.mesh.reference_elements import (
    prism_rule,
    quadrature_rule,
    reference_element,
)
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import Frame
from tests.metamorphic.parts.meshes import STEEL

from ..elements.drawn_parts import Part

Array = NDArray[np.float64]

#: Our name of an element, with its formulation -> our kind and CalculiX's element.
ELEMENTS = {
    "tet4": ("tet4", "C3D4"),
    "tet10": ("tet10", "C3D10"),
    "wedge6": ("wedge6", "C3D6"),
    "wedge15": ("wedge15", "C3D15"),
    "hex8 full": ("hex8", "C3D8"),
    "hex8": ("hex8", "C3D8I"),
    "hex20": ("hex20", "C3D20"),
}
#: Elements whose mass CalculiX integrates by fewer points than are exact.
FEW = {
    "tet4": quadrature_rule("tet", 1),
    "tet10": quadrature_rule("tet", 2),
    "wedge15": prism_rule(2, 4),
}
MODES, FORCE = 6, 100.0


@dataclass(frozen=True, eq=False)
class Found:
    """Frequencies [Hz], deflection under the load [m], von Mises at the probe [Pa],
    mass [kg] and the moments of inertia about the axes through the origin [kg m^2].
    """

    frequencies: Array
    deflection: float
    von_mises: float
    mass: float
    inertia: Array


def by_sidtool(part: Part, element: str, *, few: bool = False) -> Found:
    """With `few` the mass is integrated as CalculiX does, see `mass_by_few_points`."""
    mesh, materials = part.mesh, {None: STEEL}
    relieved = element == "hex8"
    mass, k = mesh_matrices(mesh, materials, "solid", incompatible_modes=relieved)
    if few:
        mass = mass_by_few_points(mesh, materials)
    solids = SolidMesh(mesh, materials, "solid", incompatible_modes=relieved)
    inner = solids.internal_inertia()
    body = FiniteElementModel(mesh.positions, mass, k, {}, (), internal_inertia=inner)
    held = np.zeros(body.ndof, bool)
    held[body.dofs(part.fixed)] = True
    space = constrained_space(body, Frame(np.zeros(3), held))
    load = np.zeros((len(mesh.positions), 3))
    load[:, part.direction] = FORCE * weights(part)
    u = space.static(load.reshape(-1, 1))[:, 0]
    squares, _ = space.modes(MODES)
    continua = mesh_continua(mesh, materials, "solid", incompatible_modes=relieved)
    rows = MeshPoints(mesh, continua).rows("probe", 1, part.probe)
    stress = stress_rows(rows.gradient, continua[0]) @ u
    rigid = body.rigid_body_modes()
    gram = rigid.T @ (body.mass @ rigid)
    return Found(
        np.sqrt(squares) / (2 * np.pi),
        float(load.ravel() @ u / FORCE),
        von_mises(stress),
        float(gram[0, 0]),
        np.diag(gram)[3:],
    )


def mass_by_few_points(
    mesh: Mesh, materials: Mapping[str | None, ElasticMaterial]
) -> sp.csr_matrix:
    """(n, n) by the points of the stiffness, as CalculiX integrates the mass of FEW."""
    total = MatrixSum(len(mesh.positions), 1)
    for block in mesh.blocks:
        points, weights = FEW[block.kind]
        values, gradients = reference_element(block.kind).at(points)
        batch = mapped_batch(
            block.nodes, mesh.positions, values[None], gradients[None], weights
        )
        total.add(block.nodes, element_mass(batch, materials[block.material].density))
    return total.total()[0]


def calculix_matrices(part: Part, element: str, folder: Path) -> tuple[Array, Array]:
    """Stiffness and mass by node and component, behind them the internal modes."""
    (folder / "free.inp").write_text(
        _deck(part, ELEMENTS[element][1]), encoding="utf-8"
    )
    free = run_calculix(free_deck(folder / "free.inp"), folder / "free.inp")
    order = np.lexsort(free.dofs.T[::-1])
    return tuple(a.toarray()[np.ix_(order, order)] for a in (free.stiffness, free.mass))


def by_calculix(part: Part, element: str, folder: Path) -> Found:
    text = _deck(part, ELEMENTS[element][1])
    (folder / "free.inp").write_text(text, encoding="utf-8")
    free = run_calculix(free_deck(folder / "free.inp"), folder / "free.inp")
    here = free.dofs[:, 0] <= len(part.mesh.positions)
    where = np.zeros((len(free.dofs), 3))
    where[here] = part.mesh.positions[free.dofs[here, 0] - 1]
    axes = np.eye(3)[free.dofs[:, 1] - 1] * here[:, None]
    motion = np.hstack([axes, np.einsum("ij,ijk->ik", axes, -skew(where))])
    gram = motion.T @ (free.mass @ motion)
    shares = weights(part)
    lines = ["*BOUNDARY", "FIXED,1,3", "*STEP", "*STATIC", "*CLOAD"]
    for node in part.loaded:
        force = FORCE * shares[node]
        lines.append(f"{node + 1}, {part.direction + 1}, {force:.12e}")
    lines += ["*NODE PRINT, NSET=LOADED", "U", "*EL FILE", "S", "*END STEP"]
    lines += ["*STEP", "*FREQUENCY", str(MODES), "*END STEP", ""]
    (folder / "held.inp").write_text(text + "\n".join(lines), encoding="utf-8")
    subprocess.run(["ccx", "held"], cwd=folder, capture_output=True, check=False)
    text = (folder / "held.dat").read_text(encoding="utf-8")
    fixed, _, vibrating = text.partition("E I G E N V A L U E")
    moved = {int(r[0]): float(r[1 + part.direction]) for r in _rows(fixed, 4)}
    modes = [float(r[3]) for r in _rows(vibrating, 5)] or [np.nan] * MODES
    return Found(
        np.array(modes[:MODES]),
        float(sum(shares[n] * moved[n + 1] for n in part.loaded)),
        von_mises(_stress_at(part, folder / "held.frd")),
        float(gram[0, 0]),
        np.diag(gram)[3:],
    )


def _rows(text: str, columns: int) -> list[list[str]]:
    rows = [line.split() for line in text.splitlines()]
    return [r for r in rows if len(r) == columns and r[0].isdigit()]


def von_mises(stress: Array) -> float:
    """Of xx, yy, zz, xy, yz, xz."""
    normal, shear = stress[:3], stress[3:]
    apart = normal - np.roll(normal, 1)
    return float(np.sqrt((apart @ apart) / 2 + 3 * shear @ shear))


def weights(part: Part) -> Array:
    """The share of every node in a uniform load on the loaded set."""
    surface = named_surface(part.mesh, {"LOADED": part.loaded})(("LOADED",))
    assert surface is not None and surface.mass.nnz
    share = np.asarray(surface.mass.sum(axis=0)).ravel()
    return share / share.sum()


def _deck(part: Part, element: str) -> str:
    lines = ["*NODE, NSET=ALL"]
    for i, x in enumerate(part.mesh.positions, 1):
        lines.append(f"{i}, " + ", ".join(f"{v:.12e}" for v in x))
    (block,) = part.mesh.blocks
    lines.append(f"*ELEMENT, TYPE={element}, ELSET=PART")
    for label, nodes in zip(block.labels, block.nodes + 1, strict=True):
        words = [str(label), *map(str, nodes)]
        lines.append(
            ",\n".join(", ".join(words[i : i + 8]) for i in range(0, len(words), 8))
        )
    for name, nodes in (("FIXED", part.fixed), ("LOADED", part.loaded)):
        lines += [f"*NSET, NSET={name}", *(f"{n + 1}," for n in nodes)]
    e, nu, rho = STEEL.youngs_modulus, STEEL.poissons_ratio, STEEL.density
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{e!r}, {nu!r}", "*DENSITY"]
    lines += [f"{rho!r},", "*SOLID SECTION, ELSET=PART, MATERIAL=STEEL", ""]
    return "\n".join(lines)


def _stress_at(part: Part, path: Path) -> Array:
    """xx, yy, zz, xy, yz, xz at the probe's node."""
    distance = np.linalg.norm(part.mesh.positions - part.probe, axis=1)
    node = int(distance.argmin()) + 1
    inside = False
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith(" -4"):
            inside = line.split()[1] == "STRESS"
        elif inside and line.startswith(" -1") and int(line[3:13]) == node:
            return np.array([float(line[13 + 12 * i : 25 + 12 * i]) for i in range(6)])
    raise AssertionError("no stress in the result")
