"""Mesh of solid elements: mass and stiffness, inertia of incompatible modes.

The field of an element with incompatible modes is N u + b a with a = -Kaa^-1 Kau u, and
inertia is that of this field (R. J. Guyan, AIAA J. 3, 1965; the internal modes are
condensed). Uniform strains and rigid motions leave a at zero, so that mass, centre and
moments of inertia are those of the nodal functions.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..mesh.materials import AnisotropicMaterial, ElasticMaterial, laws_of_material
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import (
    LINEAR_KINDS,
    edge_nodes,
    quadratic_kind,
    reference_element,
)
from .material_points import Continuum, make_continuum
from .matrix_sums import MatrixSum
from .solid_elements import (
    KINDS_ALWAYS_INCOMPATIBLE,
    KINDS_WITH_INCOMPATIBLE_MODES,
    ElementBatch,
    add_elements,
    elasticity,
    element_mass,
    has_reduced_integration,
    internal_amplitudes,
    internal_values,
    mapped_batch,
    reduced_batch,
    with_incompatible_modes as with_modes,
)

#: Entries of the arrays of one batch of elements. Small batches spend their time in
#: Python, large ones in memory.
_BATCH_ENTRIES = 500_000
#: From this Poisson's ratio on, elements that lock in volume are refused.
_NEARLY_INCOMPRESSIBLE = 0.49
#: Number of a block -> amplitudes of its internal modes, by groups of elements.
Amplitudes = dict[int, list[Array]]
_FORMULATIONS = ("full_integration", "incompatible_modes")

Indices = NDArray[np.int64]
_Entries = tuple[Array, Indices, Indices]


def mesh_matrices(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
    same_points: bool = False,
    amplitudes: Amplitudes | None = None,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass (n, n) and stiffness (d n, d n), by Gauss quadrature.

    Parameters
    ----------
    materials : by the names in the blocks of the mesh
    state : "plane_stress", "plane_strain" or "solid"
    thickness : of plane elements whose block has no thickness [m]
    incompatible_modes : whether quad4 and hex8 get the internal modes of Taylor,
        Beresford & Wilson (1976), unless their block specifies it; their contribution
        to the mass is `internal_inertia`
    same_points : whether the mass is integrated at the points of stresses, which is
        cheaper, and exact where edges are straight and the Jacobian is constant
    amplitudes : to which those of internal modes are added, for `internal_inertia`

    Raises
    ------
    InputError : an element is folded, or would lock in volume.
    """
    n, d = mesh.positions.shape
    sums = MatrixSum(n, 1, d)
    for number, block in enumerate(mesh.blocks):
        material = materials[block.material]
        extra = has_internal_modes(block, incompatible_modes)
        depth = block.thickness or thickness
        found = None
        if extra and amplitudes is not None:
            found = amplitudes[number] = []
        check_volumetric_locking(block.kind, material, state, extra)
        laws = laws_of_material(material)
        batches = element_batches(mesh, block, relieved=extra, laws=laws)
        at_mass = element_batches(mesh, block, "stress" if same_points else "mass")
        add_elements(
            sums,
            zip(batches, at_mass, strict=True),
            density=material.density * depth,
            law=elasticity(material, state) * depth,
            amplitudes=found,
        )
    mass, stiffness = sums.total()
    return mass, stiffness


def mesh_continua(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
) -> tuple[Continuum, ...]:
    """The material of every block; the parameters are those of `mesh_matrices`."""
    continua = []
    for block in mesh.blocks:
        extra = has_internal_modes(block, incompatible_modes)
        material, depth = materials[block.material], block.thickness or thickness
        settings: Any = {"relieved": extra, "laws": laws_of_material(material)}
        batches = partial(element_batches, mesh, block, "stress", **settings)
        continua.append(
            make_continuum(batches, material, state, depth, internal_modes=extra)
        )
    return tuple(continua)


def has_internal_modes(block: ElementBlock, otherwise: bool) -> bool:
    """Return whether the elements of a block have internal modes."""
    if block.kind not in KINDS_WITH_INCOMPATIBLE_MODES:
        return block.kind in KINDS_ALWAYS_INCOMPATIBLE
    return (block.formulation or _FORMULATIONS[otherwise]) == _FORMULATIONS[True]


def check_volumetric_locking(
    kind: str, material: ElasticMaterial, state: str, relieved: bool
) -> None:
    """Check that elements of this kind can deform at constant volume.

    Raises
    ------
    InputError : the material is nearly incompressible, and the elements cannot.
    """
    if isinstance(material, AnisotropicMaterial):
        return
    if state == "plane_stress" or (relieved and kind in KINDS_WITH_INCOMPATIBLE_MODES):
        return
    if kind in LINEAR_KINDS and material.poissons_ratio > _NEARLY_INCOMPRESSIBLE:
        raise InputError(
            f"{material.poissons_ratio} makes {kind} elements lock: they cannot bend "
            "at constant volume",
            place="material.poissons_ratio",
            expected='quadratic elements, IGA or formulation = "incompatible_modes" '
            f"above {_NEARLY_INCOMPRESSIBLE}",
        )


def element_batches(
    mesh: Mesh,
    block: ElementBlock,
    integral: str = "stiffness",
    *,
    relieved: bool = False,
    laws: Callable[[Array], Array] | None = None,
) -> Iterator[ElementBatch]:
    """The elements of a block at the quadrature points of an integral.

    Parameters
    ----------
    integral : "stiffness", "stress" or "mass"; stresses come at all points that exact
        integrals of the stiffness need
    relieved : True if the elements have internal modes
    laws : of a material with varying axes, see `laws_of_material`
    """
    element = reference_element(block.kind, integral)
    reduced = integral == "stiffness" and has_reduced_integration(block.kind)
    basis = element.values[None], element.gradients[None], element.weights
    for nodes in _split_elements(block):
        if reduced:
            batch = reduced_batch(nodes, mesh.positions, element)
        else:
            slopes = integral != "mass"
            batch = mapped_batch(nodes, mesh.positions, *basis, with_gradients=slopes)
        if relieved:
            batch = with_modes(batch, mesh.positions, element)
        if laws is not None and integral != "mass":
            places = batch.values @ mesh.positions[batch.nodes]
            batch = replace(batch, laws=laws(places))
        yield batch


def _split_elements(block: ElementBlock) -> Iterator[Indices]:
    """The nodes of groups of elements, the same ones for all integrals."""
    element = reference_element(block.kind, "mass")
    (m, d), ng = element.nodes.shape, len(element.points)
    functions = m + d**2 if block.kind in LINEAR_KINDS else m
    step = max(1, _BATCH_ENTRIES // ((d * functions) ** 2 + 2 * d**2 * ng))
    for start in range(0, len(block.nodes), step):
        yield block.nodes[start : start + step]


@dataclass(frozen=True, eq=False)
class InternalInertia:
    """Displacements b_j a_j inside the elements beside those of the n nodes.

    Attributes
    ----------
    amplitudes : (k d, d n) sparse; a by function and component = amplitudes @ u
    mixed : (n, k) sparse, integral of rho N_i b_j dV [kg]
    own : (k, k) sparse, integral of rho b_i b_j dV [kg]
    added : (d n, d n) sparse, their contribution to the mass matrix [kg]
    """

    amplitudes: sp.csr_matrix
    mixed: sp.csr_matrix
    own: sp.csr_matrix
    added: sp.csr_matrix

    def scalar_mass(self, nodal: sp.csr_matrix) -> sp.csr_matrix:
        """(n + k, n + k) integral of rho times all functions, by that of the nodes."""
        return sp.csr_matrix(
            sp.block_array([[nodal, self.mixed], [self.mixed.T, self.own]])
        )

    def fields(self, vectors: Array, dimension: int) -> Array:
        """(k, d, q) amplitudes of displacements (d n, q)."""
        return np.asarray(self.amplitudes @ vectors).reshape(
            -1, dimension, vectors.shape[1]
        )


def internal_inertia(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
    amplitudes: Amplitudes | None = None,
) -> InternalInertia | None:
    """Return the inertia of all elements with internal modes, or None.

    The parameters are those of `mesh_matrices`, which also finds the amplitudes.
    """
    n, d = mesh.positions.shape
    added, parts, count = MatrixSum(n, d), [], 0
    for number, block in enumerate(mesh.blocks):
        if not has_internal_modes(block, incompatible_modes):
            continue
        material, depth = materials[block.material], block.thickness or thickness
        density, law = material.density * depth, elasticity(material, state)
        known = (amplitudes or {}).get(number)
        for batch, moved in _with_amplitudes(
            mesh, block, law, laws_of_material(material), known
        ):
            whole, m = element_mass(batch, density), batch.nodes.shape[1]
            masses = whole[:, :m, m:], whole[:, m:, m:]
            parts.append(_ElementGroup(batch.nodes, moved, *masses, count))
            added.add(batch.nodes, parts[-1].added(d))
            count += int(np.prod(parts[-1].own.shape[:2]))
    if not parts:
        return None
    shapes = (d * count, d * n), (n, count), (count, count)
    entries = zip(*(part.entries(d) for part in parts), strict=True)
    follow, mixed, own = (_sparse_matrix(*x) for x in zip(entries, shapes, strict=True))
    return InternalInertia(follow, mixed, own, *added.total())


def _with_amplitudes(
    mesh: Mesh,
    block: ElementBlock,
    law: Array,
    laws: Callable[[Array], Array] | None,
    known: list[Array] | None,
) -> Iterator[tuple[ElementBatch, Array]]:
    """Elements at the points of the mass, all functions there, and the amplitudes."""
    points = reference_element(block.kind, "mass").points
    inner = internal_values(block.kind, points)[None]
    moving = inner.shape[2] * mesh.dimension
    if known is None:
        own = element_batches(mesh, block, relieved=True, laws=laws)
        known = [internal_amplitudes(b, law)[:, :moving] for b in own]
    every, start = np.concatenate(known), 0
    for batch in element_batches(mesh, block, "mass"):
        amplitudes = every[start : start + len(batch.nodes)]
        start += len(batch.nodes)
        values = np.concatenate([batch.values, inner], axis=2)
        yield replace(batch, values=values), amplitudes


@dataclass(frozen=True, eq=False)
class _ElementGroup:
    """Some elements: nodes (ne, m), amplitudes (ne, k d, m d), mixed (ne, m, k), own
    (ne, k, k) masses, and the number of their first function."""

    nodes: Indices
    amplitudes: Array
    mixed: Array
    own: Array
    start: int

    def added(self, d: int) -> Array:
        """(ne, m d, m d)"""
        ne, m, k = self.mixed.shape
        flat = self.amplitudes.reshape(ne, k, -1)
        coupled = (self.mixed @ flat).reshape(ne, m * d, m * d)
        moved = (self.own @ flat).reshape(self.amplitudes.shape)
        square = np.swapaxes(self.amplitudes, 1, 2) @ moved
        return np.asarray(coupled + np.swapaxes(coupled, 1, 2) + square)

    def entries(self, d: int) -> tuple[_Entries, _Entries, _Entries]:
        """Values, rows and columns of amplitudes, mixed and own."""
        ne, k = self.own.shape[:2]
        functions = (self.start + np.arange(ne * k)).reshape(ne, k).astype(np.int64)
        rows = (functions[..., None] * d + np.arange(d)).reshape(ne, -1)
        columns = (self.nodes[..., None] * d + np.arange(d)).reshape(ne, -1)
        return (
            _matrix_entries(self.amplitudes, rows, columns),
            _matrix_entries(self.mixed, self.nodes, functions),
            _matrix_entries(self.own, functions, functions),
        )


def _matrix_entries(values: Array, rows: Indices, columns: Indices) -> _Entries:
    """Entries of element matrices (ne, r, c) at their rows (ne, r), columns (ne, c)."""
    first = np.broadcast_to(rows[..., None], values.shape)
    second = np.broadcast_to(columns[:, None], values.shape)
    return values.ravel(), first.ravel(), second.ravel()


def _sparse_matrix(
    parts: tuple[_Entries, ...], shape: tuple[int, int]
) -> sp.csr_matrix:
    values, rows, columns = (np.concatenate(x) for x in zip(*parts, strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=shape)


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """Elements, their materials and their formulation; see `mesh_matrices`."""

    mesh: Mesh
    materials: Mapping[str | None, ElasticMaterial]
    state: str
    thickness: float = 1.0
    incompatible_modes: bool = False

    @property
    def kinds_with_locking(self) -> tuple[str, ...]:
        """Return the linear elements that bend too stiffly. These include prisms, whose
        internal modes help along their axis only.
        """
        plain = (
            block.kind
            for block in self.mesh.blocks
            if block.kind in LINEAR_KINDS
            and not (
                block.kind in KINDS_WITH_INCOMPATIBLE_MODES
                and has_internal_modes(block, self.incompatible_modes)
            )
        )
        return tuple(dict.fromkeys(plain))

    def matrices(self) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Mass and stiffness (d n, d n), the mass by the points of the stiffness."""
        amplitudes: Amplitudes = {}
        mass, stiffness = mesh_matrices(
            self.mesh,
            self.materials,
            self.state,
            thickness=self.thickness,
            incompatible_modes=self.incompatible_modes,
            same_points=True,
            amplitudes=amplitudes,
        )
        spread = sp.kron(mass, sp.eye_array(self.mesh.dimension))
        inner = self.internal_inertia(amplitudes)
        total = spread if inner is None else spread + inner.added
        return sp.csr_matrix(total), stiffness

    def internal_inertia(
        self, amplitudes: Amplitudes | None = None
    ) -> InternalInertia | None:
        """Return the inertia of the internal modes of its elements, or None."""
        return internal_inertia(
            self.mesh,
            self.materials,
            self.state,
            thickness=self.thickness,
            incompatible_modes=self.incompatible_modes,
            amplitudes=amplitudes,
        )


def with_internal_modes(solids: SolidMesh) -> SolidMesh:
    """Return the mesh with the internal modes of all elements that can have them."""
    blocks = tuple(
        replace(block, formulation="incompatible_modes") for block in solids.mesh.blocks
    )
    return replace(solids, mesh=replace(solids.mesh, blocks=blocks))


def to_quadratic(solids: SolidMesh) -> tuple[SolidMesh, sp.csr_matrix]:
    """Return the mesh with mid-side nodes on straight edges of linear elements.

    Returns
    -------
    the mesh, and the (n', n) matrix that interpolates a field linearly on it
    """
    mesh = solids.mesh
    n = len(mesh.positions)
    linear = [block for block in mesh.blocks if block.kind in LINEAR_KINDS]
    pairs = [_block_edges(block) for block in linear]
    edges, numbers = np.unique(np.concatenate(pairs), axis=0, return_inverse=True)
    counts = np.cumsum([len(ends) for ends in pairs])[:-1]
    middles = dict(zip(map(id, linear), np.split(numbers.ravel(), counts), strict=True))
    blocks = []
    for block in mesh.blocks:
        if block.kind in LINEAR_KINDS:
            own = n + middles[id(block)].reshape(len(block.nodes), -1)
            nodes = np.hstack([block.nodes, own])
            block = replace(block, kind=quadratic_kind(block.kind), nodes=nodes)
        blocks.append(block)
    rows = np.repeat(np.arange(len(edges)), 2)
    means = sp.csr_matrix(
        (np.full(len(rows), 0.5), (rows, edges.ravel())), shape=(len(edges), n)
    )
    between = sp.csr_matrix(sp.vstack([sp.eye_array(n), means]))
    finer = Mesh(between @ mesh.positions, tuple(blocks))
    return replace(solids, mesh=finer), between


def _block_edges(block: ElementBlock) -> NDArray[np.int64]:
    """(edges of all elements, 2) corners, the smaller number first."""
    corners = block.nodes[:, np.array(edge_nodes(quadratic_kind(block.kind)))]
    return np.sort(corners.reshape(-1, 2), axis=1)
