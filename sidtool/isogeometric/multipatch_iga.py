"""Isogeometric analysis of one patch or several joined patches."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.model import IgaDiscretisation, ModelFile, NodeMarker
from sidtool.formats.model.geometry import (
    NurbsGeometry,
    PatchesGeometry,
    VolumeGeometry,
)

from ..elements.faces import Surface, concatenate_surfaces, patch_surface
from ..elements.finite_element_model import FiniteElementModel, MarkerRows
from ..elements.markers import (
    marker_parameters,
    markers_with_position,
    name_marker_in_errors,
    rows_at,
)
from ..elements.material_points import Continuum
from ..elements.solid_elements import ElementBatch
from ..geometry.multipatch import (
    CommonNumbering,
    Side,
    close_gaps,
    find_topology,
    number_control_points,
    sides_of,
)
from ..geometry.nurbs_patch import (
    NurbsPatch,
    evaluate_points,
    gauss_points,
    patch_from_model,
    scattered_basis,
    side_nodes,
)
from ..geometry.patch_contact import WeakTie, check_connected, check_overlaps, weak_ties
from ..geometry.patch_evaluation import nearest_parameters
from ..importers.nurbs_files import read_patches
from ..mesh.connections import NamedSets
from .iga import (
    expected_mass,
    patch_continuum,
    patch_matrices,
    refine_for_model,
    refinement_notes,
)

#: Stiffness of the springs beside that of an element at the tie.
_PENALTY_RATIO = 1e4
#: Size of a function on a tie, relative to the largest one, that is rounding.
_SMALL_FUNCTION = 1e-5

Indices = NDArray[np.int64]
#: The patch of a model that is one, in messages: geometry.left and so on.
_SINGLE_PATCH_NAME = "geometry"


def tie_stiffness(
    tie: WeakTie,
    patches: Mapping[str, NurbsPatch],
    numbering: CommonNumbering,
    modulus: float,
) -> sp.csr_matrix:
    """(d n, d n) stiffness that holds a side on another.

    The jump is projected on the functions of that side which has more knot spans on
    the tie: those of a coarser one would let the finer side move between them.

    Parameters
    ----------
    patches : refined
    modulus : Young's modulus [Pa], of a plane body times thickness [N/m]
    """
    slave, master = patches[tie.slave.patch], patches[tie.master.patch]
    end = (tie.master.direction, tie.master.end)
    degree = max(master.degrees)
    parameters, weights = _side_points(slave, tie.slave, degree)
    points = evaluate_points(slave, parameters)
    there, _ = nearest_parameters(master, points, end)
    spans = _spans_within(slave, tie.slave, parameters)
    others = _spans_within(master, tie.master, there)
    if max(others) > min(spans):
        pieces = math.ceil(max(others) / min(spans))
        parameters, weights = _side_points(slave, tie.slave, degree, pieces)
        points = evaluate_points(slave, parameters)
        there, _ = nearest_parameters(master, points, end)
    own = _common_functions(slave, parameters, numbering, tie.slave)
    other = _common_functions(master, there, numbering, tie.master)
    is_finer = math.prod(others) > math.prod(spans)
    test = _nonzero_columns(other if is_finer else own)
    weighted = test.T @ sp.diags_array(weights)
    square = (weighted @ test).toarray()
    projected = sp.csc_matrix(weighted @ (own - other))
    used = np.flatnonzero(np.diff(projected.indptr))
    projected = projected[:, used].toarray()
    d = slave.points.shape[1]
    height = (weights.sum() / math.prod(others if is_finer else spans)) ** (1 / (d - 1))
    local = projected.T @ np.linalg.solve(square, projected)
    local *= _PENALTY_RATIO * modulus / height
    index = np.repeat(used, len(used)), np.tile(used, len(used))
    shape = (numbering.count,) * 2
    scalar = sp.csr_matrix(((local + local.T).ravel() / 2, index), shape=shape)
    return sp.csr_matrix(sp.kron(scalar, sp.eye_array(d)))


def _side_points(
    patch: NurbsPatch, side: Side, degree: int, pieces: int = 1
) -> tuple[Array, Array]:
    """Gauss points (q, k) on a side, in parts of its knot spans, and their weights."""
    axes, rules = [], []
    for i, knots in enumerate(patch.knots):
        if i == side.direction:
            axes.append(np.array([float(side.end)]))
            rules.append(np.ones(1))
            continue
        corners = np.unique(knots)
        parts = np.linspace(corners[:-1], corners[1:], pieces + 1)
        x, w = gauss_points(np.unique(parts), max(degree, patch.degrees[i]) + 2)
        axes.append(x.ravel())
        rules.append(w.ravel())
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
    basis = scattered_basis(patch, grid)
    free = [i for i in range(len(axes)) if i != side.direction]
    slopes = basis.gradients[..., free]
    t = np.einsum("nmd,nmk->nkd", patch.points[basis.nodes], slopes)
    measure = np.sqrt(np.linalg.det(t @ np.swapaxes(t, 1, 2)))
    return grid, reduce(np.multiply.outer, rules).ravel() * measure


def _spans_within(patch: NurbsPatch, side: Side, parameters: Array) -> list[int]:
    """Number of knot spans along each direction of a side between some points."""
    numbers = [
        np.searchsorted(np.unique(knots), parameters[:, i].real)
        for i, knots in enumerate(patch.knots)
        if i != side.direction
    ]
    return [int(np.ptp(n)) + 1 for n in numbers]


def _nonzero_columns(functions: sp.csr_matrix) -> sp.csr_matrix:
    """Functions that are more than rounding at the points, of unit size."""
    size = np.sqrt(functions.multiply(functions).sum(axis=0).real).A1
    kept = np.flatnonzero(size > _SMALL_FUNCTION * size.max())
    return sp.csr_matrix(functions[:, kept] @ sp.diags_array(1 / size[kept]))


def _common_functions(
    patch: NurbsPatch, parameters: Array, numbering: CommonNumbering, side: Side
) -> sp.csr_matrix:
    """(q, n) common functions at points of one patch."""
    basis = scattered_basis(patch, parameters)
    columns = numbering.numbers[side.patch][basis.nodes]
    rows = np.repeat(np.arange(len(parameters)), columns.shape[1])
    shape = (len(parameters), numbering.count)
    entries = (basis.values.ravel(), (rows, columns.ravel()))
    return sp.csr_matrix(entries, shape=shape)


def iga_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file in its own refined NURBS basis.

    Sides of the patch that are the same are joined, as are collapsed ones.

    Raises
    ------
    InputError : the refined knots do not hold the geometry, the geometry folds or
        touches itself, or a marker lies outside.
    """
    geometry = model.geometry
    assert isinstance(geometry, NurbsGeometry | VolumeGeometry)
    parts = _join_patches(model, {_SINGLE_PATCH_NAME: patch_from_model(geometry)})
    names = geometry.edge_names
    sides = {name: (Side(_SINGLE_PATCH_NAME, *side),) for name, side in names.items()}
    return _joined_body(model, parts, sides)


def patches_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file whose geometry is a patch file.

    Raises
    ------
    InputError : the model is not valid; the error names file, patch or key.
    """
    geometry = model.geometry
    assert isinstance(geometry, PatchesGeometry)
    exact = read_patches(geometry.file)
    if len({len(patch.degrees) for patch in exact.values()}) > 1:
        raise InputError(
            "holds plane patches and volumes",
            source=geometry.file,
            expected="patches of one kind",
        )
    try:
        parts = _join_patches(model, exact, geometry.tolerance)
    except InputError as error:
        raise error.located(geometry.file) from None
    return _joined_body(model, parts, _sides_by_name(geometry, exact))


@dataclass(frozen=True, eq=False)
class _JoinedPatches:
    """Original patches, refined patches, and their connectivity."""

    exact: Mapping[str, NurbsPatch]
    fine: Mapping[str, NurbsPatch]
    numbering: CommonNumbering
    ties: list[WeakTie]


def _join_patches(
    model: ModelFile, patches: Mapping[str, NurbsPatch], tolerance: float = 1e-9
) -> _JoinedPatches:
    real = {name: patch.real for name, patch in patches.items()}
    check_overlaps(real)
    topology = find_topology(real, tolerance)
    ties = weak_ties(real, topology, tolerance)
    exact = close_gaps(patches, topology, tolerance)
    fine = {name: refine_for_model(model, patch) for name, patch in exact.items()}
    real = {name: patch.real for name, patch in fine.items()}
    numbering = number_control_points(real, topology)
    check_connected(numbering, ties)
    return _JoinedPatches(exact, fine, numbering, ties)


def _joined_body(
    model: ModelFile, parts: _JoinedPatches, sides: Mapping[str, tuple[Side, ...]]
) -> FiniteElementModel:
    """Make the body of joined patches.

    Parameters
    ----------
    sides : sides by name
    """
    exact, fine, numbering = parts.exact, parts.fine, parts.numbering
    settings, material = model.discretisation, model.material
    assert isinstance(settings, IgaDiscretisation) and material is not None
    d = len(next(iter(fine.values())).degrees)
    n = numbering.count
    mass, stiffness = sp.csr_matrix((n, n)), sp.csr_matrix((d * n, d * n))
    positions = np.zeros((n, d), number_type(*(p.points for p in fine.values())))
    for name, patch in fine.items():
        m, k = patch_matrices(model, exact[name], patch)
        once, spread = _gather_matrix(numbering, name, d)
        mass, stiffness = mass + once.T @ m @ once, stiffness + spread.T @ k @ spread
        positions[numbering.numbers[name]] = patch.points
    thickness = getattr(model.geometry, "thickness", None) or 1.0
    modulus = material.youngs_modulus * thickness
    for tie in parts.ties:
        stiffness = stiffness + tie_stiffness(tie, fine, numbering, modulus)
    ties = [
        diagnose("N123", tie.slave.name, master=tie.master.name) for tie in parts.ties
    ]
    changed = [refinement_notes(settings, patch) for patch in fine.values()]
    return FiniteElementModel(
        positions=positions,
        scalar_mass=sp.csr_matrix(mass),
        stiffness=sp.csr_matrix(stiffness),
        node_sets=NamedSets(
            {
                name: _side_nodes(members, fine, numbering)
                for name, members in sides.items()
            }
        ),
        surface=lambda names: _side_surface(sides, fine, numbering, names),
        markers=_patch_markers(model, parts, sides),
        continua=tuple(
            _joined_continuum(
                patch_continuum(model, exact[name], patch), numbering.numbers[name]
            )
            for name, patch in fine.items()
        ),
        patches=tuple((fine[name], numbering.numbers[name]) for name in fine),
        geometry_mass=lambda: expected_mass(model, list(exact.values())),
        diagnostics=tuple(dict.fromkeys([*ties, *chain(*changed)])),
    )


def _joined_continuum(continuum: Continuum, numbers: Indices) -> Continuum:
    """The material of a patch on the common control points."""

    def batches() -> Iterator[ElementBatch]:
        for batch in continuum.batches():
            yield replace(batch, nodes=numbers[batch.nodes])

    return replace(continuum, batches=batches)


def _gather_matrix(
    numbering: CommonNumbering, name: str, d: int
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """From common control points, and degrees of freedom, to those of one patch."""
    numbers = numbering.numbers[name]
    local = np.arange(len(numbers))
    shape = (len(numbers), numbering.count)
    once = sp.csr_matrix((np.ones(len(numbers)), (local, numbers)), shape=shape)
    return once, sp.csr_matrix(sp.kron(once, sp.eye_array(d)))


def _sides_by_name(
    geometry: PatchesGeometry, patches: Mapping[str, NurbsPatch]
) -> dict[str, tuple[Side, ...]]:
    """Sides by their own names and by those that the model gives to several.

    Raises
    ------
    InputError : the model names a side that is not there.
    """
    sides: dict[str, tuple[Side, ...]] = {s.name: (s,) for s in sides_of(patches)}
    for name, members in geometry.edges.items():
        unknown = [member for member in members if member not in sides]
        if unknown:
            raise InputError(
                f"there is no side {unknown[0]!r}",
                place=f"geometry.edges.{name}",
                expected=f"one of {', '.join(sorted(sides))}",
            )
        sides[name] = tuple(side for member in members for side in sides[member])
    return sides


def _side_nodes(
    sides: tuple[Side, ...],
    patches: Mapping[str, NurbsPatch],
    numbering: CommonNumbering,
) -> Indices:
    """The common control points of some sides."""
    nodes = [
        numbering.numbers[s.patch][side_nodes(patches[s.patch], s.direction, s.end)]
        for s in sides
    ]
    return np.unique(np.concatenate(nodes))


def _side_surface(
    sides: Mapping[str, tuple[Side, ...]],
    patches: Mapping[str, NurbsPatch],
    numbering: CommonNumbering,
    names: tuple[str, ...],
) -> Surface:
    """Named sides as one, on the common control points."""
    surfaces = []
    for side in dict.fromkeys(side for name in names for side in sides[name]):
        own = patch_surface(patches[side.patch], side.direction, side.end)
        once, _ = _gather_matrix(numbering, side.patch, own.points.shape[1])
        surfaces.append(replace(own, mass=sp.csr_matrix(once.T @ own.mass @ once)))
    return concatenate_surfaces(surfaces)


def _patch_markers(
    model: ModelFile, parts: _JoinedPatches, sides: Mapping[str, tuple[Side, ...]]
) -> tuple[MarkerRows, ...]:
    rows = []
    for name, marker in markers_with_position(model.markers):
        with name_marker_in_errors(name):
            patch, where = _marker_location(marker, parts.exact, sides)
            fine = parts.fine[patch]
            local = rows_at(name, marker.node, fine, where)
            assert local.gradient is not None
            _, spread = _gather_matrix(parts.numbering, patch, fine.points.shape[1])
            rows.append(
                replace(
                    local,
                    displacement=sp.csr_matrix(local.displacement @ spread),
                    rotation=sp.csr_matrix(local.rotation @ spread),
                    gradient=sp.csr_matrix(local.gradient @ spread),
                )
            )
    return tuple(rows)


def _marker_location(
    marker: NodeMarker,
    exact: Mapping[str, NurbsPatch],
    sides: Mapping[str, tuple[Side, ...]],
) -> tuple[str, Array]:
    """The patch of a marker and its parameters there."""
    if marker.edge is not None:
        locations = sides.get(marker.edge, ())
        if len(locations) != 1:
            single = [name for name, members in sides.items() if len(members) == 1]
            raise InputError(
                f"there is no side {marker.edge!r}",
                place="edge",
                expected=f"one of {', '.join(single)}",
            )
        side = (locations[0].direction, locations[0].end)
        patch = exact[locations[0].patch]
        return locations[0].patch, marker_parameters(marker, {marker.edge: side}, patch)
    if marker.position is None and len(exact) > 1:
        raise InputError(
            "parameters do not say in which patch",
            expected="edge (with at) or position",
        )
    problem: InputError | None = None
    for name, candidate in exact.items():
        try:
            return name, marker_parameters(marker, {}, candidate)
        except InputError as error:
            problem = error
    assert problem is not None
    raise problem
