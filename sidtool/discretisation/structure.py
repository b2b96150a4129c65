"""Assembly of bodies whose nodes turn: bars, shells, springs, solids, masses.

Degrees of freedom that nothing resists: pins of bars, AUTOSPC.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.elements.finite_element_model import MarkerRows, moving_dofs
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.text import counted_noun

from ..beams.element import GAUSS_WEIGHTS, ParticleCollector, RowCollector, assemble
from ..eigensolvers.factorisation import symmetric_factors
from ..elements.finite_element_model import FiniteElementModel
from ..elements.material_points import BarEnds, InertiaPoints
from ..elements.mortar_ties import elimination_matrix
from ..mesh.imported_mesh import ImportedMesh
from ..mesh.materials import ElasticMaterial
from ..mesh.unit_systems import UnitSystem
from .bar_elements import Bar, BarElement
from .bar_nodes import BarNodes
from .structure_elements import (
    merge_particles,
    node_motion,
    shell_matrices,
    solid_matrices,
    spring_matrix,
)

#: Stiffness below this share of that without pins is none.
_FREE_STIFFNESS_TOLERANCE = 1e-12
#: Cosines of bars in one line differ from one by less.
_COLLINEAR_TOLERANCE = 1e-9

Indices = NDArray[np.int64]
#: Relative energy below which a deformation has none.
_MECHANISM_TOLERANCE = 1e-13
#: Arms below this share of the body are rounding.
_NO_ARM = 1e-12
#: Directions whose cosine differs from one by less are the same.
_SAME_DIRECTION = 1e-12
#: Relative stiffness to the ground that makes the matrix of the iteration regular.
_SHIFT = 1e-12
#: Further vectors of the iteration, and its steps at most.
_SPARE_VECTORS, _MOST_STEPS = 6, 20


def without_unsupported(
    structure: Structure, marked: Callable[[Structure], set[int]]
) -> tuple[Structure, list[Diagnostic]]:
    """Return the structure without rotations that have neither stiffness nor mass.

    Parameters
    ----------
    marked : returns the labels of nodes that markers fix
    """
    structure, found = _resolve_pins(structure, marked)
    structure, more = _without_idle(structure)
    return structure, found + more


def markers_without_rotation(
    markers: Iterable[MarkerRows], axes: str = "xyz"
) -> list[Diagnostic]:
    """Name the markers at nodes that do not turn about an axis of the model (N147).

    Parameters
    ----------
    axes : those about which markers of the body may turn
    """
    found: dict[tuple[str, ...], list[str]] = {}
    for marker in markers:
        rows = zip("xyz", marker.rotation, strict=True)
        still = [axis for axis, row in rows if not moving_dofs(row).size]
        missing = tuple(axis for axis in still if axis in axes)
        if missing and marker.displacement.nnz:  # the body holds the point
            found.setdefault(missing, []).append(marker.name)
    return [diagnose("N147", markers=m, axes=axes) for axes, m in found.items()]


def _resolve_pins(
    structure: Structure, marked: Callable[[Structure], set[int]]
) -> tuple[Structure, list[Diagnostic]]:
    """Return bars and nodes without rotations that have neither stiffness nor mass.

    The stiffness is that of all elements, such as springs and shells. Such a rotation
    about an axis of the model is removed, as by AUTOSPC of Nastran. About another axis
    it follows a bar that is pinned there, unless a marker fixes it.
    """
    bars, table = structure.bars, structure.nodes.table
    if not any(any(bar.pins) for bar in bars):
        return structure, []
    heavy = np.zeros(structure.ndof)
    if (points := structure.point_masses()) is not None:
        heavy = points.mass_matrix().diagonal()
    plain = [replace(bar, pins=((), ())) for bar in bars]
    others, _ = structure.other_elements()
    whole = (structure.bar_stiffness(plain) + others).diagonal().real
    stiff = (structure.bar_stiffness(bars) + others).diagonal().real
    unsupported = (stiff <= _FREE_STIFFNESS_TOLERANCE * whole) & (heavy.real <= 0)
    turning = table[:, 3:]
    unsupported &= np.isin(np.arange(structure.ndof), turning[turning >= 0])
    structure, found = _without(structure, unsupported)
    kept = np.flatnonzero(~unsupported)
    supported = others[kept][:, kept], whole[kept], heavy[kept]
    bars = _without_free_rotations(structure, marked(structure), *supported)
    return replace(structure, bars=bars), found


def _without_free_rotations(
    structure: Structure,
    marked: set[int],
    others: sp.csr_matrix,
    whole: Array,
    heavy: Array,
) -> tuple[Bar, ...]:
    """Remove one pin for every rotation of a node that has no stiffness.

    Parameters
    ----------
    others : (ndof, ndof) stiffness of all elements but bars
    whole : (ndof,) diagonal of the stiffness without pins
    heavy : (ndof,) diagonal of the mass of points
    """
    bars, nodes = structure.bars, structure.nodes
    stiffness = sp.csr_matrix(structure.bar_stiffness(bars) + others)
    ends: dict[int, list[tuple[int, int]]] = {}
    for k, bar in enumerate(bars):
        for end, label in enumerate(bar.nodes):
            if not bar.rod and label not in {*nodes.owner, *marked}:
                ends.setdefault(nodes.row[label], []).append((k, end))
    changed = list(bars)
    used: set[tuple[int, int]] = set()
    for row, own in ends.items():
        there = nodes.table[row, 3:] >= 0
        dofs = nodes.table[row, 3:][there]
        if not dofs.size:
            continue
        block = stiffness[dofs][:, dofs].toarray().real
        values, vectors = np.linalg.eigh(block)
        free = vectors[:, values <= _FREE_STIFFNESS_TOLERANCE * whole[dofs].max()]
        if not free.shape[1] or heavy[dofs].any():
            continue
        for k, end in own:
            element, _ = structure.bar_element(changed[k])
            axes = element.frames(np.array([end])).section_axes[0]
            for direction in changed[k].pins[end]:
                axis = axes[direction - 4] if direction > 3 else np.zeros(3)
                inside = np.linalg.norm(free.T @ axis[there])
                if inside < 1 - _COLLINEAR_TOLERANCE or (k, direction) in used:
                    continue
                used.add((k, direction))
                pins = [list(pin) for pin in changed[k].pins]
                pins[end].remove(direction)
                changed[k] = replace(changed[k], pins=(tuple(pins[0]), tuple(pins[1])))
                left = free - np.outer(axis[there], axis[there] @ free)
                u, sizes, _ = np.linalg.svd(left, full_matrices=False)
                free = u[:, sizes > 0.5]
    return tuple(changed)


def _without_idle(structure: Structure) -> tuple[Structure, list[Diagnostic]]:
    """Return nodes without rotations that have neither stiffness nor mass."""
    if not (structure.imported.springs or structure.imported.couplings):
        return structure, []
    ndof, table = structure.ndof, structure.nodes.table
    total, points = structure.other_elements()
    if (masses := structure.point_masses()) is not None:
        points = [*points, masses]
    stiff = (total + structure.bar_stiffness(structure.bars)).diagonal().real
    heavy = (
        merge_particles(points).mass_matrix().diagonal() if points else np.zeros(ndof)
    )
    turning = table[:, 3:]
    idle = (stiff <= 0) & (heavy.real <= 0)
    idle &= np.isin(np.arange(ndof), turning[turning >= 0])
    return _without(structure, idle)


def _without(
    structure: Structure, removed: NDArray[np.bool_]
) -> tuple[Structure, list[Diagnostic]]:
    """Return the structure without some degrees of freedom (ndof,), and N129."""
    if not removed.any():
        return structure, []
    table = structure.nodes.table
    number = np.where(removed, -1, np.cumsum(~removed) - 1)
    count = int(np.count_nonzero(removed))
    rotations = counted_noun(count, "rotation")
    limit = f"left out, as nothing resists them: {rotations} of nodes (AUTOSPC)"
    remedy = "Hold no moment about them by joints."
    reduced = structure.with_nodes(np.where(table >= 0, number[table], -1))
    return reduced, [diagnose("N129", limit=limit, remedy=remedy)]


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

    @cached_property
    def continued(self) -> dict[int, Array]:
        """Nodes whose bars all have one direction and no arms, and its (3,) vector."""
        found: dict[int, Array | None] = {}
        for bar, k in product(self.bars, (0, 1)):
            node, t = self.base(bar.nodes[k]), self._tangent(bar, k)
            known = found.setdefault(node, t)
            aligned = known is not None and abs(known @ t) > 1 - _SAME_DIRECTION
            if not aligned or self._arm(bar.nodes[k], bar.ends[k]).any():
                found[node] = None
        return {node: t for node, t in found.items() if t is not None}

    def bar_ends(self) -> BarEnds | None:
        """Return the ends of bars at nodes that are not `continued`."""
        arms, tangents = list[Array](), list[Array]()
        rows = [RowCollector(self.ndof) for _ in range(4)]
        for bar, k in product(self.bars, (0, 1)):
            node, place, first = bar.nodes[k], bar.ends[k], 6 * k
            if self.base(node) in self.continued:
                continue
            element, dofs = self.bar_element(bar)
            loads, (turns, own) = element.end_forces(), self.nodes.motion(node, place)
            arms.append(self._arm(node, place))
            tangents.append(self._tangent(bar, k))
            rows[0].add(loads[first : first + 3], dofs)
            rows[1].add(loads[first + 3 : first + 6], dofs)
            rows[2].add(turns[3:], own)
            rows[3].add(element.ends[first + 3 : first + 6], dofs)
        if not arms:
            return None
        found = (part.matrix() for part in rows)
        return BarEnds(np.array(arms), np.array(tangents), *found)

    def base(self, node: int) -> int:
        """Return the node that a node is fixed to, or itself."""
        return self.nodes.owner.get(node, node)

    @staticmethod
    def _tangent(bar: Bar, end: int) -> Array:
        fraction = bar.last if end else bar.first
        return np.asarray(bar.beam.axis.at(np.array([fraction])).axes[0, 0])

    def _arm(self, node: int, place: Array) -> Array:
        """(3,) from the base of a node to a place [m]."""
        arm = place - self.nodes.place(self.base(node))
        size = np.ptp(self.nodes.mesh.positions.real, axis=0).max()
        return arm if np.abs(arm).max() > _NO_ARM * size else np.zeros(3)

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
            heavy = [mass.mass * units.mass]
            arm = self._arm(mass.node, place)
            move, turn = motion.reshape(2, 1, 3, -1)
            piece = place[None], heavy, tensor[None], move, turn
            particles.add(*piece, dofs, arm[None])


def add_bar_mass(
    particles: ParticleCollector, bar: Bar, element: BarElement, dofs: Indices
) -> None:
    """Add the mass of a bar, with its non-structural mass."""
    particles.add_slices(element, dofs, bar.density)
    if bar.extra is None or not bar.extra.any():
        return
    masses = GAUSS_WEIGHTS * element.length * bar.extra
    places, rows = element.gauss_frames.places, element.gauss_rows
    tensors = np.zeros((len(masses), 3, 3))
    particles.add(places, masses, tensors, rows.displacement, rows.rotation, dofs)


def check_mechanism(
    body: FiniteElementModel,
    place: str = "mesh",
    expected: str = "elements that hold each other; rods alone need triangles in "
    "space, membranes neighbours in other planes",
) -> None:
    """Check that only rigid motions have no energy, and that all of them have
    inertia.
    """
    rigid = body.rigid_body_modes(body.positions.mean(axis=0))
    gram = rigid.T @ (body.mass @ rigid)
    inertia = gram.diagonal()
    if inertia.min() < 0:
        raise InputError(
            "a rigid motion of the body has negative inertia",
            place=place,
            expected="masses that no negative one (CONM2) exceeds",
        )
    size = np.sqrt(inertia)
    if (
        not size.all()
        or np.linalg.cond(gram / np.outer(size, size)) > 1 / _MECHANISM_TOLERANCE
    ):
        raise InputError(
            "a rigid motion of the body has no inertia",
            place=place,
            expected="a density above zero, or masses with inertia or off one line",
        )
    energies, motions = _least_energies(body, rigid.shape[1] + 1)
    if energies.max() < _MECHANISM_TOLERANCE:
        x, y, z = (f"{value:.4g}" for value in _most_moved(body, rigid, motions))
        raise InputError(
            f"the elements move without deforming, most at ({x}, {y}, {z}) m: the body "
            "is a mechanism, or lies on one line that nothing twists",
            place=place,
            expected=expected,
        )


def _most_moved(body: FiniteElementModel, rigid: Array, motions: Array) -> Array:
    """(3,) position of the node that moves most in what is not a rigid motion.

    Parameters
    ----------
    motions : (ndof, k) of `_least_energies`
    """
    scale = np.sqrt(np.maximum(body.stiffness.diagonal(), 0.0))
    basis, _ = np.linalg.qr(scale[:, None] * rigid)
    scaled = scale[:, None] * motions
    rest = scaled - basis @ (basis.T @ scaled)
    column = np.linalg.norm(rest, axis=0).argmax()
    moved = int(np.abs(rest[:, column]).argmax())
    row = np.flatnonzero((body.table == moved).any(axis=1))[0]
    return np.asarray(np.pad(body.positions[row], (0, 3 - body.dimension)))


def _least_energies(body: FiniteElementModel, count: int) -> tuple[Array, Array]:
    """(count,) smallest eigenvalues of the stiffness scaled to a unit diagonal, and
    (ndof, k) motions of these energies, which satisfy the equations of the body.

    Their scale is the stiffness at the degrees of freedom themselves: neither small
    masses nor small elements elsewhere change it. Many motions of nearly no energy,
    which do not converge, are found by simultaneous inverse iteration with the Ritz
    values of each step (G. H. Golub, C. F. Van Loan, "Matrix computations", 2013,
    8.2.5); it ends when their largest does not change.
    """
    held = body.equations
    free = (
        sp.csr_matrix(sp.eye_array(body.ndof))
        if held is None
        else elimination_matrix(held.matrix, held.dependent)
    )
    stiffness = sp.csr_matrix(free.T @ body.stiffness @ free)
    size, diagonal = stiffness.shape[0], stiffness.diagonal()
    # one that is a rigid motion by itself has the scale of what follows it
    parts = free.power(2).T @ body.stiffness.diagonal()
    diagonal = np.where(diagonal > 1e-12 * parts, diagonal, parts)
    count = min(count, size)
    if diagonal.min() <= 0:
        unit = np.eye(size, 1, -int(diagonal.argmin()))
        return np.zeros(count), np.asarray(free @ unit)
    scale = sp.diags_array(1 / np.sqrt(diagonal))
    scaled = sp.csr_matrix(scale @ stiffness @ scale)
    motion = sp.csr_matrix(free @ scale)
    if size <= 600:
        values, vectors = scipy.linalg.eigh(
            scaled.toarray(), subset_by_index=[0, count - 1]
        )
        return values, motion @ vectors
    raised = sp.csr_matrix(scaled + _SHIFT * sp.eye_array(size))
    try:
        factors = symmetric_factors(raised, body.coordinate_positions(free))
    except RuntimeError:  # of SuperLU: singular
        return np.zeros(count), motion @ np.ones((size, 1))
    vectors = np.random.default_rng(0).standard_normal((size, count + _SPARE_VECTORS))
    values = np.full(count, np.inf)
    for _ in range(_MOST_STEPS):
        before = values
        vectors, _ = np.linalg.qr(factors.solve(vectors))
        ritz, turn = np.linalg.eigh(vectors.T @ (scaled @ vectors))
        vectors, values = vectors @ turn, ritz[:count]
        if values[-1] < _MECHANISM_TOLERANCE or values[-1] > 0.9 * before[-1]:
            break
    return values, motion @ vectors[:, :count]
