"""Assembly of bodies whose nodes turn: bars, shells, springs, solids, masses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError

from ..beams.element import GAUSS_WEIGHTS, ParticleCollector, assemble
from ..eigensolvers.factorisation import symmetric_factors
from ..elements.finite_element_model import FiniteElementModel
from ..elements.material_points import InertiaPoints
from ..mesh.imported_mesh import ImportedMesh
from ..mesh.materials import ElasticMaterial
from ..mesh.unit_systems import UnitSystem
from .bar_elements import Bar, BarElement
from .bar_nodes import BarNodes
from .structure_elements import (
    node_motion,
    shell_matrices,
    solid_matrices,
    spring_matrix,
)

Indices = NDArray[np.int64]

#: Relative eigenvalue below which a deformation has no energy.
_MECHANISM_TOLERANCE = 1e-13
#: Shift of the eigenvalue search, relative to the largest eigenvalue.
_EIGENVALUE_SHIFT = 1e-9


@dataclass(frozen=True, eq=False)
class Structure:
    """Elements between nodes, and the degrees of freedom of these.

    Attributes
    ----------
    imported : couplings, masses, springs, shells and solids, in the units of a file
    bars : in SI units
    units : of `imported`
    materials : of solid elements, in SI units
    """

    imported: ImportedMesh
    bars: tuple[Bar, ...]
    nodes: BarNodes
    units: UnitSystem
    materials: Mapping[str | None, ElasticMaterial]

    @property
    def ndof(self) -> int:
        """Number of degrees of freedom."""
        return int(self.nodes.table.max()) + 1

    def with_nodes(self, table: Indices) -> Structure:
        """Return the structure with other degrees of freedom (n, 6) of its nodes."""
        return replace(self, nodes=replace(self.nodes, table=table))

    def bar_element(self, bar: Bar) -> tuple[BarElement, Indices]:
        """Return the element of a bar and the degrees of freedom of its nodes."""
        moved = [
            self.nodes.motion(n, x) for n, x in zip(bar.nodes, bar.ends, strict=True)
        ]
        ends = scipy.linalg.block_diag(*(motion for motion, _ in moved))
        dofs = np.concatenate([dofs for _, dofs in moved])
        return bar.element(ends), dofs

    def bar_stiffness(self, bars: Iterable[Bar]) -> sp.csr_matrix:
        """(ndof, ndof) of bars."""
        parts = []
        for bar in bars:
            element, dofs = self.bar_element(bar)
            parts.append((element.stiffness(), dofs))
        return assemble(parts, self.ndof)

    def point_masses(self) -> InertiaPoints | None:
        """Return the masses at nodes, None if there are none."""
        if not self.imported.masses:
            return None
        particles = ParticleCollector(self.ndof)
        self.add_masses(particles)
        return particles.points()

    def other_elements(self) -> tuple[sp.csr_matrix, list[InertiaPoints]]:
        """Stiffness and particles of all elements but bars."""
        imported, nodes, units = self.imported, self.nodes, self.units
        stiffness = spring_matrix(imported.springs, nodes, units, self.ndof)
        if not (imported.shells or imported.mesh.blocks):
            return stiffness, []
        motion = node_motion(nodes)
        total, points = shell_matrices(imported.shells, nodes, motion, units)
        if imported.mesh.blocks:
            solid, more = solid_matrices(nodes.mesh, self.materials, motion)
            total, points = total + solid, points + more
        return sp.csr_matrix(stiffness + total), points

    def add_masses(self, particles: ParticleCollector) -> None:
        """Add the masses at nodes."""
        nodes, units = self.nodes, self.units
        for mass in self.imported.masses:
            if mass.node not in nodes.row:
                raise InputError(
                    f"the mass at node {mass.node} has no node",
                    place=mass.place,
                    expected="a node of this file",
                )
            place = nodes.place(mass.node) + units.length * np.array(mass.offset)
            motion, dofs = nodes.motion(mass.node, place)
            fixed = not motion[3:].any()
            incomplete = fixed and (any(mass.offset) or any(mass.inertia))
            if not len(dofs) or incomplete:
                raise InputError(
                    f"the mass at node {mass.node} is held by no bar"
                    + (" that turns it" if incomplete else ""),
                    place=mass.place,
                    expected="a node of bars or of a rigid coupling to one",
                )
            xx, yy, zz, xy, yz, zx = mass.inertia
            tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
            tensor = tensor * (units.mass * units.length**2)
            heavy = mass.mass * units.mass
            particles.add(place, heavy, tensor, motion[:3], motion[3:], dofs)


def add_bar_mass(
    particles: ParticleCollector, bar: Bar, element: BarElement, dofs: Indices
) -> None:
    """Add the mass of a bar, with its non-structural mass."""
    particles.add_slices(element, dofs, bar.density)
    if bar.extra is None or not bar.extra.any():
        return
    masses = GAUSS_WEIGHTS * element.length * bar.extra
    places = element.gauss_frames.places
    for rows, place, mass in zip(element.gauss_rows, places, masses, strict=True):
        move = (rows.displacement, rows.rotation, dofs)
        particles.add(place, mass, np.zeros((3, 3)), *move)


def check_mechanism(
    body: FiniteElementModel,
    place: str = "mesh",
    expected: str = "elements that hold each other; rods alone need triangles in "
    "space, membranes neighbours in other planes",
) -> None:
    """Check that only rigid motions have no energy, and that all of them have
    inertia.
    """
    count = min(7, body.ndof)
    k, m = body.stiffness, body.mass
    heavy = m.diagonal() > 0
    gram = body.rigid_body_modes(body.positions.mean(axis=0))
    gram = gram.T @ (m @ gram)
    size = np.sqrt(gram.diagonal())
    if (
        not size.all()
        or np.linalg.cond(gram / np.outer(size, size)) > 1 / _MECHANISM_TOLERANCE
    ):
        raise InputError(
            "a rigid motion of the body has no inertia",
            place=place,
            expected="a density above zero, or masses with inertia or off one line",
        )
    largest = float((k.diagonal()[heavy] / m.diagonal()[heavy]).max())
    shift = _EIGENVALUE_SHIFT * largest
    try:
        if (
            body.ndof <= 600
        ):  # with exchanged matrices, because massless motions have m = 0
            raised = (k + shift * m).toarray()
            first = body.ndof - count
            inverse = scipy.linalg.eigh(
                m.toarray(),
                raised,
                eigvals_only=True,
                subset_by_index=[first, body.ndof - 1],
            )
            values = 1 / inverse - shift
        else:
            factors = symmetric_factors(
                sp.csr_matrix(k + shift * m), body.dof_positions
            )
            values = sp.linalg.eigsh(
                k,
                count,
                m,
                sigma=-shift,
                OPinv=sp.linalg.LinearOperator(k.shape, factors.solve),
                return_eigenvectors=False,
                v0=np.ones(body.ndof),
            )
    except (np.linalg.LinAlgError, RuntimeError):  # of SuperLU: singular
        values = np.zeros(count)
    if max(values) < _MECHANISM_TOLERANCE * largest:
        raise InputError(
            "the elements move without deforming: the body is a mechanism, or lies on "
            "one line that nothing twists",
            place=place,
            expected=expected,
        )
