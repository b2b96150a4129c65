"""Full field of a reduced body: points and their motion, outer faces, stresses."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.field import Field, field_of
from sidtool.formats.sid_mass import skew

from ..conversion.prestress import InitialStress
from ..conversion.quadrature import NodalAverages, quadrature_parts
from ..elements.finite_element_model import BeamOutline, FiniteElementModel
from ..elements.material_points import (
    Continuum,
    stress_components,
    stress_from_gradient,
)
from ..geometry.nurbs_patch import NurbsPatch, breakpoints
from ..isogeometric.iga import sampled_batch
from ..isogeometric.sampled_patch import box_corners, grid_quadrilaterals
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import element_edges, element_faces
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis

Indices = NDArray[np.int64]

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
#: Largest number of points of one patch.
_MAX_POINTS = 200_000


@dataclass(frozen=True, eq=False)
class SampledPoints:
    """Points of a body and their motion for given degrees of freedom.

    Attributes
    ----------
    positions : (n, 3) in the axes of the model [m]
    triangles : (m, 3) the outer surface
    displacement : from fields (ndof, k) to (n, 3, k)
    cells : kind of element -> (ne, nodes)
    thickness : of a plane body [m]
    stress : from fields (ndof, k) to (n, 6, k) [Pa]; None where it is not known
    transverse : (n,) stress zz per xx + yy of a uniform stress in the plane
    """

    positions: Array
    triangles: Indices
    displacement: Callable[[Array], Array]
    cells: Mapping[str, Indices] = field(default_factory=dict)
    thickness: float = 0.0
    stress: Callable[[Array], Array] | None = None
    transverse: Array = field(default_factory=lambda: np.zeros(0))


def concatenate_points(parts: Iterable[SampledPoints]) -> SampledPoints:
    """Several parts of one body as one; points are not shared."""
    parts = list(parts)
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(part.positions) for part in parts)])
    cells: dict[str, list[Indices]] = {}
    for part, start in zip(parts, starts, strict=False):
        for kind, nodes in part.cells.items():
            cells.setdefault(kind, []).append(nodes + start)
    stresses = [part.stress for part in parts]

    def stress(fields: Array) -> Array:
        return np.concatenate([one(fields) for one in stresses if one is not None])

    return SampledPoints(
        positions=np.concatenate([part.positions for part in parts]),
        triangles=np.concatenate(
            [part.triangles + s for part, s in zip(parts, starts, strict=False)]
        ),
        displacement=lambda fields: np.concatenate(
            [part.displacement(fields) for part in parts]
        ),
        cells={
            kind: np.concatenate(parts_of_kind) for kind, parts_of_kind in cells.items()
        },
        thickness=parts[0].thickness,
        stress=None if None in stresses else stress,
        transverse=np.concatenate([part.transverse for part in parts]),
    )


def beam_field(outline: BeamOutline) -> SampledPoints:
    """Four corners of every cross-section, which turn with it."""
    arms = (outline.halves[:, None] * CORNERS) @ outline.axes
    n = len(arms)
    turning = -skew(arms.reshape(-1, 3)).reshape(n, 4, 3, 3)

    def displacement(fields: Array) -> Array:
        motion = (outline.motion @ fields).reshape(n, 6, -1)
        own = np.einsum("ncab,nbk->ncak", turning, motion[:, 3:])
        return (motion[:, None, :3] + own).reshape(4 * n, 3, -1)

    return SampledPoints(
        positions=(outline.places[:, None] + arms).reshape(-1, 3),
        triangles=tube(n),
        displacement=displacement,
        transverse=np.zeros(4 * n),
    )


def tube(sections: int) -> NDArray[np.int64]:
    """Triangles of the sides and ends of a row of sections with four corners each."""
    triangles = [(0, 2, 1), (0, 3, 2)]
    for i in range(sections - 1):
        for c in range(4):
            a, b = 4 * i + c, 4 * i + (c + 1) % 4
            triangles += [(a, b, b + 4), (a, b + 4, a + 4)]
    last = 4 * (sections - 1)
    triangles += [(last, last + 1, last + 2), (last, last + 2, last + 3)]
    return np.array(triangles, np.int64)


def mesh_field(body: FiniteElementModel, mesh: Mesh) -> SampledPoints:
    """The nodes of a mesh; at the border of two materials, one for each.

    Stresses are those of `NodalAverages`.
    """
    names = list(dict.fromkeys(block.material for block in mesh.blocks))
    n = len(mesh.positions)
    keys = [block.nodes + n * names.index(block.material) for block in mesh.blocks]
    used, rows = np.unique(
        np.concatenate([k.ravel() for k in keys]), return_inverse=True
    )
    ends = np.cumsum([k.size for k in keys])[:-1]
    local = [
        part.reshape(key.shape)
        for part, key in zip(np.split(rows, ends), keys, strict=True)
    ]
    node, kinds = used % n, [block.kind for block in mesh.blocks]
    table = body.table[node, :3]

    def displacement(fields: Array) -> Array:
        padded = np.concatenate([fields, np.zeros((1, fields.shape[1]))])
        return padded[table]

    plane = mesh.dimension == 2
    return SampledPoints(
        positions=np.pad(mesh.positions, ((0, 0), (0, 3 - mesh.dimension)))[node],
        triangles=surface_triangles(list(zip(kinds, local, strict=True)), node, plane),
        displacement=displacement,
        cells=_output_cells(mesh.blocks, local),
        thickness=_thickness(body, mesh) if plane else 0.0,
        stress=(lambda fields: _stress_at_nodes(body, mesh, fields))
        if body.continua
        else None,
        transverse=_transverse_flags(body, used // n, names, mesh),
    )


def _thickness(body: FiniteElementModel, mesh: Mesh) -> float:
    known = [block.thickness for block in mesh.blocks if block.thickness]
    if known:
        return float(known[0])
    return body.continua[0].thickness if body.continua else 0.0


def _transverse_flags(
    body: FiniteElementModel, materials: Indices, names: list[str | None], mesh: Mesh
) -> Array:
    values = np.zeros(len(names))
    for block, continuum in zip(mesh.blocks, body.continua, strict=False):
        values[names.index(block.material)] = continuum.transverse
    return values[materials]


def _output_cells(
    blocks: tuple[ElementBlock, ...], local: list[Indices]
) -> dict[str, Indices]:
    cells: dict[str, list[Indices]] = {}
    for block, nodes in zip(blocks, local, strict=True):
        cells.setdefault(block.kind, []).append(nodes)
    return {kind: np.concatenate(parts) for kind, parts in cells.items()}


def surface_triangles(
    cells: list[tuple[str, Indices]], node: Indices, plane: bool
) -> Indices:
    """Triangles of the faces that belong to one element; in the plane of all.

    cells : kinds of elements, and their points
    node : node of each point; at borders of materials several points are one node
    """
    rings, keys = [], []
    for kind, points in cells:
        for ring, corners in _face_outlines(kind, plane):
            rings.append((points[:, ring], corners))
            key = np.full((len(points), 4), -1, np.int64)
            key[:, :corners] = np.sort(node[points[:, ring[:corners]]], axis=1)
            keys.append(key)
    _, inverse, counts = np.unique(
        np.concatenate(keys), axis=0, return_inverse=True, return_counts=True
    )
    outer = np.ones(len(inverse), bool) if plane else (counts == 1)[inverse.ravel()]
    ends = np.cumsum([len(key) for key in keys])[:-1]
    outlines = [
        _split_outline(ring[kept], corners)
        for (ring, corners), kept in zip(rings, np.split(outer, ends), strict=True)
    ]
    return np.concatenate(outlines)


def _face_outlines(kind: str, plane: bool) -> list[tuple[list[int], int]]:
    """Faces of an element: corners, then the middles of the edges between them."""
    middles = {frozenset((a, b)): m for a, b, m in element_edges(kind) if m >= 0}
    if plane:
        corners = [tuple(range(3 if kind.startswith("tri") else 4))]
    else:
        corners = [*element_faces(kind, 3), *element_faces(kind, 4)]
    outlines = []
    for face in corners:
        pairs = zip(face, (*face[1:], face[0]), strict=True)
        own = [middles[frozenset(pair)] for pair in pairs] if middles else []
        outlines.append(([*face, *own], len(face)))
    return outlines


def _split_outline(ring: Indices, corners: int) -> Indices:
    """(k, corners [+ middles]) as triangles."""
    if ring.shape[1] == corners:
        fans = [(0, i, i + 1) for i in range(1, corners - 1)]
    else:
        middle = range(corners, 2 * corners)
        fans = [
            (i, middle[i], middle[i - 1 if i else corners - 1]) for i in range(corners)
        ]
        fans += [(middle[0], middle[i], middle[i + 1]) for i in range(1, corners - 1)]
    return np.concatenate([ring[:, list(fan)] for fan in fans])


def _stress_at_nodes(body: FiniteElementModel, mesh: Mesh, fields: Array) -> Array:
    """(points, 6, k)."""
    k = fields.shape[1]
    means = NodalAverages(body, mesh, 6 * k)
    for part in quadrature_parts(body):
        tensor = stress_from_gradient(part.gradients(fields), part.law)
        six = stress_components(tensor, part.transverse)
        means.add(part, np.swapaxes(six, 1, 2).reshape(len(six), 6 * k))
    return means.values().reshape(-1, 6, k)


def patch_field(
    body: FiniteElementModel, patch: NurbsPatch, numbers: Indices, continuum: Continuum
) -> SampledPoints:
    """One patch of a body.

    numbers : (n,) nodes of the body that its control points are
    """
    axes = _parameter_grid(patch)
    shape = tuple(len(axis) for axis in axes)
    nodes, values, slopes = sampled_batch(patch, axes)
    table = body.table[numbers[nodes], : len(shape)]
    points = np.einsum("pm,pmd->pd", values, patch.points[nodes])

    def displacement(fields: Array) -> Array:
        moved = np.einsum("pm,pmdk->pdk", values, fields[table], optimize=True)
        return np.pad(moved, ((0, 0), (0, 3 - len(shape)), (0, 0)))

    def stress(fields: Array) -> Array:
        gradient = np.einsum("pmb,pmck->pkcb", slopes, fields[table], optimize=True)
        tensor = stress_from_gradient(gradient, continuum.law)
        return np.moveaxis(stress_components(tensor, continuum.transverse), 1, 2)

    plane = len(shape) == 2
    cells = grid_quadrilaterals(shape) if plane else _grid_boxes(*shape)
    kind = "quad4" if plane else "hex8"
    return SampledPoints(
        positions=np.pad(points, ((0, 0), (0, 3 - len(shape)))),
        triangles=surface_triangles([(kind, cells)], np.arange(len(points)), plane),
        displacement=displacement,
        cells={kind: cells},
        thickness=continuum.thickness if plane else 0.0,
        stress=stress,
        transverse=np.full(len(points), continuum.transverse),
    )


def _parameter_grid(patch: NurbsPatch) -> tuple[Array, ...]:
    """Parameters: as many to a knot span as its degree, fewer of large patches."""
    counts = list(patch.degrees)
    while True:
        axes = tuple(
            _equal_steps(breakpoints(knots), count)
            for knots, count in zip(patch.knots, counts, strict=True)
        )
        if np.prod([len(axis) for axis in axes]) <= _MAX_POINTS or max(counts) == 1:
            return axes
        counts = [max(1, count - 1) for count in counts]


def _equal_steps(ends: Array, count: int) -> Array:
    shares = np.arange(count) / count
    inner = (ends[:-1, None] + np.diff(ends)[:, None] * shares).ravel()
    return np.append(inner, ends[-1])


def _grid_boxes(i: int, j: int, k: int) -> Indices:
    return box_corners((i - 1, j - 1, k - 1))


def body_field(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    initial: InitialStress | None = None,
) -> Field:
    """Mesh, surface, shape functions and stresses of a body, in its body frame.

    sid : SID of the body
    initial : the stress of the undeformed body
    """
    sampled = sample_body(body)
    shapes = sampled.displacement(basis.shapes)
    stress, initial_stress = None, np.zeros((len(shapes), 6))
    if sampled.stress is not None:
        stress = sampled.stress(basis.shapes)
    if sampled.stress is not None and initial is not None:
        initial_stress = sampled.stress(initial.displacement)[..., 0]
        initial_stress = initial_stress + stress_components(initial.uniform)
        if body.dimension == 2:
            initial_stress[:, 2] += sampled.transverse * np.trace(initial.uniform)
    content = Field(
        title=sid.title,
        positions=sampled.positions - frame.origin,
        shapes=shapes,
        triangles=sampled.triangles,
        cells=sampled.cells,
        thickness=sampled.thickness,
        stress=stress,
        initial_stress=initial_stress,
    )
    return field_of(sid, content)


def sample_body(body: FiniteElementModel) -> SampledPoints:
    """Return the points of a body and the rows of their motion.

    A body from matrices has points and no surface.
    """
    if body.patches:
        parts = zip(body.patches, body.continua, strict=True)
        return concatenate_points(
            patch_field(body, *p, continuum) for p, continuum in parts
        )
    mesh = body.drawing_mesh if body.solids is None else body.solids.mesh
    if mesh is not None:
        return mesh_field(body, mesh)
    if outlines := body.outlines():
        return concatenate_points(map(beam_field, outlines))
    there = body.place_table[:, :3].max(axis=1) >= 0
    places = np.pad(body.positions, ((0, 0), (0, 3 - body.dimension)))[there]
    return SampledPoints(
        positions=places,
        triangles=np.zeros((0, 3), np.int64),
        displacement=lambda fields: body.by_node(fields)[there, :3],
        transverse=np.zeros(len(places)),
    )
