"""Meshes of quadrilaterals, hexahedra and tetrahedra that sample a patch."""

from collections.abc import Iterator
from functools import partial
from itertools import permutations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import check_joined_points
from sidtool.formats.base.sid import Array
from sidtool.formats.model import Material, ModelFile, Q4Discretisation
from sidtool.formats.model.discretisation import SolidDiscretisation
from sidtool.formats.model.geometry import NurbsGeometry, VolumeGeometry

from ..elements.faces import named_surface
from ..elements.finite_element_model import FiniteElementModel, MarkerRows
from ..elements.markers import (
    MeshPoints,
    marker_parameters,
    markers_with_position,
    name_marker_in_errors,
)
from ..elements.mass_properties import patch_mass
from ..elements.material_points import make_continuum
from ..elements.solid_elements import ElementBatch, assemble_body, check_orientation
from ..elements.solid_mesh import (
    Amplitudes,
    SolidMesh,
    check_volumetric_locking,
    element_batches,
    mesh_continua,
    mesh_matrices,
)
from ..geometry.nurbs_patch import (
    NurbsPatch,
    evaluate_grid,
    patch_from_model,
    sampled_patch,
    side_nodes,
)
from ..geometry.patch_contact import grid_numbers
from ..mesh.mesh import ElementBlock, Mesh, check_mesh
from ..mesh.reference_elements import edge_nodes

Indices = NDArray[np.int64]


def q4_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a regular mesh of quadrilaterals.

    At collapsed sides two of their nodes are one: they are triangles there.

    Raises
    ------
    InputError : the geometry folds or touches itself, or a marker lies outside.
    """
    settings = model.discretisation
    geometry, material = model.geometry, model.material
    assert isinstance(settings, Q4Discretisation) and material is not None
    assert isinstance(geometry, NurbsGeometry)
    relieved = settings.formulation == "incompatible_modes"
    check_volumetric_locking("quad4", material, settings.state, relieved)
    exact = patch_from_model(geometry)
    grid = sampled_patch(exact, settings.elements)
    numbering = grid_numbers(exact.real, grid.real)
    numbers = numbering.numbers["geometry"]
    positions = np.zeros((numbering.count, 2), grid.points.dtype)
    positions[numbers] = grid.points
    check_joined_points(positions[numbers], grid.points)
    thickness, quads = geometry.thickness, numbers[grid_quadrilaterals(grid.shape)]
    continuum = make_continuum(
        partial(_q4_batches, positions, quads, relieved),
        material,
        settings.state,
        thickness,
        internal_modes=relieved,
    )
    elements = _q4_mesh(positions, quads)
    sets = {
        name: np.unique(numbers[side_nodes(grid, *side)])
        for name, side in geometry.edge_names.items()
    }
    solids = SolidMesh(elements, {None: material}, settings.state, thickness, relieved)
    points = MeshPoints(elements, (continuum,))
    amplitudes: list[Array] | None = [] if relieved else None
    mass, stiffness = q4_matrices(
        positions,
        quads,
        density=material.density * thickness,
        law=continuum.law * thickness,
        incompatible_modes=relieved,
        amplitudes=amplitudes,
    )
    return FiniteElementModel(
        positions=positions,
        scalar_mass=mass,
        stiffness=stiffness,
        node_sets=sets,
        markers=sampled_markers(model, exact, points),
        continua=(continuum,),
        internal_inertia=solids.internal_inertia(
            None if amplitudes is None else {0: amplitudes}
        ),
        solids=solids,
        surface=named_surface(elements, sets),
        geometry_mass=lambda: patch_mass(
            [exact], material.density * thickness, sampled=True
        ),
    )


def grid_quadrilaterals(shape: tuple[int, ...]) -> Indices:
    """(ne, 4) node numbers, counter-clockwise, of a grid of nodes."""
    n = np.arange(np.prod(shape)).reshape(shape)
    corners = (n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:])
    return np.stack(corners, axis=-1).reshape(-1, 4)


def q4_matrices(
    positions: Array,
    quads: Indices,
    *,
    density: float,
    law: Array,
    incompatible_modes: bool = False,
    amplitudes: list[Array] | None = None,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass (n, n) and stiffness (2 n, 2 n), full 2 x 2 integration.

    Parameters
    ----------
    positions : (n, 2) [m]
    quads : (ne, 4) counter-clockwise
    density : mass per area [kg/m^2]
    law : (3, 3) elasticity matrix times thickness [N/m]
    incompatible_modes : whether to add the internal modes
    amplitudes : list to which those of internal modes are added

    Raises
    ------
    InputError : an element is folded, mirrored or has no area.
    """
    check_orientation(_corner_determinants(positions[quads]), positions[quads], -1e-9)
    return assemble_body(
        _q4_batches(positions, quads, incompatible_modes),
        len(positions),
        density=density,
        law=law,
        amplitudes=amplitudes,
    )


def _q4_batches(
    positions: Array, quads: Indices, relieved: bool
) -> Iterator[ElementBatch]:
    mesh = _q4_mesh(positions, quads)
    return element_batches(mesh, mesh.blocks[0], relieved=relieved)


def _q4_mesh(positions: Array, quads: Indices) -> Mesh:
    labels = np.arange(1, len(quads) + 1)
    return Mesh(positions, (ElementBlock("quad4", quads, labels),))


def _corner_determinants(corners: Array) -> Array:
    """(ne, 4) Jacobian determinant at each corner, times 4."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    return ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]


def sampled_volume_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a regular mesh of solid elements.

    Raises
    ------
    InputError : the geometry folds, the elements would lock, or a marker lies outside.
    """
    settings, geometry, material = model.discretisation, model.geometry, model.material
    assert isinstance(settings, SolidDiscretisation)
    assert isinstance(geometry, VolumeGeometry) and material is not None
    exact = patch_from_model(geometry)
    mesh = sampled_volume(exact, settings.elements, settings.type)
    names = geometry.edge_names
    sets = {name: mesh.node_sets[_side_key(side)] for name, side in names.items()}
    check_mesh(mesh, collapsed=True)
    materials: dict[str | None, Material] = {None: material}
    relieved = settings.formulation == "incompatible_modes"
    amplitudes: Amplitudes = {}
    mass, stiffness = mesh_matrices(
        mesh, materials, "solid", incompatible_modes=relieved, amplitudes=amplitudes
    )
    continua = mesh_continua(mesh, materials, "solid", incompatible_modes=relieved)
    solids = SolidMesh(mesh, materials, "solid", incompatible_modes=relieved)
    return FiniteElementModel(
        positions=mesh.positions,
        scalar_mass=mass,
        stiffness=stiffness,
        node_sets=sets,
        markers=sampled_markers(model, exact, MeshPoints(mesh, continua)),
        continua=continua,
        internal_inertia=solids.internal_inertia(amplitudes),
        solids=solids,
        surface=named_surface(mesh, sets),
        geometry_mass=lambda: patch_mass([exact], material.density, sampled=True),
    )


def sampled_markers(
    model: ModelFile, exact: NurbsPatch, points: MeshPoints
) -> tuple[MarkerRows, ...]:
    """The markers where the geometry has them, on the mesh that samples it.

    Raises
    ------
    InputError : a marker lies outside the geometry, or where it degenerates.
    """
    markers = []
    for name, marker in markers_with_position(model.markers):
        with name_marker_in_errors(name):
            where = marker_parameters(marker, model.geometry.edge_names, exact)
            axes = tuple(np.array([x]) for x in where)
            position = evaluate_grid(exact, axes).ravel()
            markers.append(points.rows_of_nearest_point(name, marker.node, position))
    return tuple(markers)


def sampled_volume(
    patch: NurbsPatch, elements: tuple[int, int, int], kind: str
) -> Mesh:
    """Points of a volume at equal parameter steps, joined by elements of one kind.

    Middle nodes lie on the exact geometry. Sides that are the same share their nodes;
    at collapsed sides hexahedra use nodes several times. The node sets are called "i.e"
    with direction i and end e.

    Raises
    ------
    InputError : sides touch, but their nodes do not match.
    """
    corners = box_corners(elements)
    simplices = kind.startswith("tet")
    cells = _kuhn_tetrahedra(corners) if simplices else corners
    quadratic = kind in ("hex20", "tet10")
    fine = tuple(2 * n for n in elements) if quadratic else elements
    index = _grid_index(elements, 2 if quadratic else 1)[cells]
    grid = sampled_patch(patch, fine)
    numbering = grid_numbers(patch.real, grid.real, same_sense=simplices)
    numbers = numbering.numbers["geometry"]
    if quadratic:
        pairs = np.array(edge_nodes(kind))
        ends = index[:, pairs[:, 0]], index[:, pairs[:, 1]]
        a, b = _nearest_grid_nodes(*ends, numbers.reshape(grid.shape))
        index = np.concatenate([index, (a + b) // 2], axis=1)
    flat = numbers.reshape(grid.shape)[tuple(np.moveaxis(index, -1, 0))]
    if simplices:  # At collapsed sides some have no volume.
        corner = np.sort(flat[:, :4], axis=1)
        flat = flat[(np.diff(corner, axis=1) > 0).all(axis=1)]
    used, nodes = np.unique(flat, return_inverse=True)
    positions = np.zeros((numbering.count, 3), grid.points.dtype)
    positions[numbers] = grid.points
    check_joined_points(positions[numbers], grid.points)
    block = ElementBlock(kind, nodes.reshape(flat.shape), np.arange(1, len(flat) + 1))
    sets = {
        _side_key((i, e)): np.flatnonzero(
            np.isin(used, numbers[side_nodes(grid, i, e)])
        )
        for i in range(3)
        for e in (0, 1)
    }
    return Mesh(positions[used], (block,), sets)


def box_corners(elements: tuple[int, int, int]) -> Indices:
    """(ne, 8) corners of the boxes, as numbers in the grid of corners."""
    n = np.arange(np.prod([k + 1 for k in elements])).reshape([k + 1 for k in elements])
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    ends = (slice(None, -1), slice(1, None))
    corners = [n[ends[i], ends[j], ends[k]] for k in (0, 1) for i, j in square]
    return np.stack(corners, axis=-1).reshape(-1, 8)


def _nearest_grid_nodes(
    a: Indices, b: Indices, numbers: Indices
) -> tuple[Indices, Indices]:
    """Two ends (..., 3) of edges, in the grid, as near to each other as they can be.

    An end on a collapsed side has several indices. With these the middle of an edge is
    the same in all elements.
    """
    a, b = a.copy(), b.copy()
    for one, other in ((a, b), (b, a)):
        for axis in range(3):
            moved = one.copy()
            moved[..., axis] = other[..., axis]
            same = numbers[tuple(np.moveaxis(moved, -1, 0))]
            there = same == numbers[tuple(np.moveaxis(one, -1, 0))]
            one[there] = moved[there]
    return a, b


def _kuhn_tetrahedra(boxes: Indices) -> Indices:
    """Six tetrahedra to a box along its diagonal (Kuhn), which match across boxes."""
    number = {(0, 0, 0): 0, (1, 0, 0): 1, (1, 1, 0): 2, (0, 1, 0): 3}
    number |= {(i, j, 1): v + 4 for (i, j, _), v in number.items()}
    paths = []
    for order in permutations(range(3)):
        corner = [0, 0, 0]
        path = [0]
        for axis in order:
            corner[axis] = 1
            path.append(number[corner[0], corner[1], corner[2]])
        even = np.linalg.det(np.eye(3)[list(order)]) > 0
        paths.append(path if even else [path[0], path[2], path[1], path[3]])
    return boxes[:, np.array(paths)].reshape(-1, 4)


def _grid_index(elements: tuple[int, int, int], step: int) -> Indices:
    """(ncorners, 3) indices of the corners in the grid of all nodes."""
    axes = [np.arange(n + 1) * step for n in elements]
    grid = np.meshgrid(*axes, indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 3)


def _side_key(side: tuple[int, int]) -> str:
    return f"{side[0]}.{side[1]}"
