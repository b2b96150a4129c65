"""Faces of elements: nearest points, surface integrals, common parts.

Faces of a mesh whose nodes belong to a set.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, reduce

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..geometry.nurbs_patch import (
    LocalBasis,
    NurbsPatch,
    gauss_points,
    local_basis,
    side_nodes,
)
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import (
    element_edges,
    element_faces,
    quadrature_rule,
    reference_element,
    shape_of,
)

Indices = NDArray[np.int64]

#: (dimension of the space, nodes of a face) -> kind of face.
FACE_KINDS = {
    (2, 2): "line2",
    (2, 3): "line3",
    (3, 3): "tri3",
    (3, 4): "quad4",
    (3, 6): "tri6",
    (3, 8): "quad8",
}
_NEWTON_STEPS = 12
#: Number of candidate faces for the face nearest to a point.
_CANDIDATE_FACES = 4

#: Gauss points per knot span beyond the degree: for curved and rational sides.
_EXTRA_GAUSS_POINTS = 4
Polygon = list[tuple[float, float]]
#: Degree to which integrals over a common part are exact where faces are flat.
_DEGREE = 5
#: Smaller common parts, relative to the face, are rounding.
_MIN_AREA_SHARE = 1e-9
#: Half-planes u a + v b + c >= 0 that bound a face.
_SQUARE_BOUNDS = ((1, 0, 0), (-1, 0, 1), (0, 1, 0), (0, -1, 1))
_TRIANGLE_BOUNDS = ((1, 0, 0), (0, 1, 0), (-1, -1, 1))
#: Degree to which the quadrature of N_i N_j is exact: quadratic, on curved faces.
_SURFACE_DEGREE = 7


@dataclass(frozen=True, eq=False)
class FaceGroup:
    """Faces of one kind.

    Attributes
    ----------
    kind : one of `FACE_KINDS`
    nodes : (k, m) rows of the positions
    points : (k, m, d) positions of the nodes
    """

    kind: str
    nodes: Indices
    points: Array

    @property
    def corners(self) -> int:
        """Number of the corners of a face."""
        return {"l": 2, "t": 3, "q": 4}[self.kind[0]]

    @property
    def radii(self) -> Array:
        """Return the radii (k,) of faces about their centres."""
        arms = self.points - self.points.mean(axis=1, keepdims=True)
        radii: Array = np.linalg.norm(arms, axis=2).max(axis=1)
        return radii

    def at(self, rows: Indices, parameters: Array) -> tuple[Array, Array, Array]:
        """Points (p, d), values (p, m) and tangents (p, d, d - 1) on some faces."""
        values, slopes = face_functions(self.kind, parameters)
        own = self.points[rows]
        points = np.einsum("pm,pmd->pd", values, own)
        return points, values, np.einsum("pmd,pmk->pdk", own, slopes)

    def nearest(self, rows: Indices, points: Array, *, inside: bool = True) -> Array:
        """Return the parameters (p, d - 1) of the points of some faces nearest to
        others.

        Parameters
        ----------
        inside : True if the points must be on the face; otherwise the face is extended
        """
        centre = face_centre(self.kind)
        parameters = np.tile(centre, (len(rows), 1))
        for _ in range(_NEWTON_STEPS):
            at, _, tangents = self.at(rows, parameters)
            gram = np.einsum("pda,pdb->pab", tangents, tangents)
            pull = np.einsum("pda,pd->pa", tangents, points - at)
            parameters = parameters + np.linalg.solve(gram, pull[..., None])[..., 0]
            parameters = (
                clamp_to_face(self.kind, parameters)
                if inside
                else np.clip(parameters, -9, 9)
            )
        return parameters


def face_functions(kind: str, parameters: Array) -> tuple[Array, Array]:
    """Values (p, m) and slopes (p, m, k) of the functions of a face."""
    if not kind.startswith("line"):
        return reference_element(kind).at(parameters)
    s = parameters[:, 0]
    if kind == "line2":
        values = np.stack([1 - s, s], 1)
        slopes = np.stack([-np.ones_like(s), np.ones_like(s)], 1)
    else:
        values = np.stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)], 1)
        slopes = np.stack([4 * s - 3, 4 * s - 1, 4 - 8 * s], 1)
    return values, slopes[:, :, None]


def face_centre(kind: str) -> Array:
    """The parameters of the middle of a face."""
    return np.array({"l": [0.5], "t": [1 / 3, 1 / 3], "q": [0.5, 0.5]}[kind[0]])


def clamp_to_face(kind: str, parameters: Array) -> Array:
    """Parameters of the face near those outside."""
    inside = np.clip(parameters, 0.0, 1.0)
    if kind.startswith("tri"):
        for _ in range(2):
            beyond = np.maximum(inside.sum(axis=1, keepdims=True) - 1, 0)
            inside = np.clip(inside - beyond / 2, 0.0, 1.0)
    return inside


def nearest_faces(
    groups: list[FaceGroup], points: Array
) -> tuple[Indices, Indices, Array]:
    """For points (p, d) the group, the row and the parameters of the nearest face."""
    from scipy.spatial import cKDTree

    samples, owners = [], []
    for number, group in enumerate(groups):
        for place in _face_samples(group.kind):
            rows = np.arange(len(group.nodes))
            samples.append(group.at(rows, np.tile(place, (len(rows), 1)))[0])
            owners.append(np.stack([np.full(len(rows), number), rows], 1))
    owner = np.concatenate(owners)
    count = min(_CANDIDATE_FACES, len(owner))
    _, near = cKDTree(np.concatenate(samples)).query(points, count)
    near = near.reshape(len(points), count)
    best = np.full(len(points), np.inf)
    where = np.zeros((len(points), 2), np.int64)
    parameters = np.zeros((len(points), points.shape[1] - 1))
    for column in near.T:
        for number, group in enumerate(groups):
            own = np.flatnonzero(owner[column, 0] == number)
            rows = owner[column[own], 1]
            candidates = group.nearest(rows, points[own])
            gap = np.linalg.norm(group.at(rows, candidates)[0] - points[own], axis=1)
            better = gap < best[own]
            chosen = own[better]
            best[chosen], parameters[chosen] = gap[better], candidates[better]
            where[chosen] = owner[column[chosen]]
    return where[:, 0], where[:, 1], parameters


def _face_samples(kind: str) -> Array:
    steps = np.linspace(0.05, 0.95, 5)
    if kind.startswith("line"):
        return steps[:, None]
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    return grid[grid.sum(axis=1) <= 1] if kind.startswith("tri") else grid


@dataclass(frozen=True, eq=False)
class Surface:
    """A curve or surface with the shape functions of some nodes.

    Attributes
    ----------
    mass : (n, n) sparse, integral of N_i N_j over it [m or m^2]
    points : (k, d) points on the surface itself [m]
    normals : (3, 3) integral of the products of its unit normal, which an axis is
        perpendicular to; zero where there is no normal
    """

    mass: sp.csr_matrix
    points: Array
    normals: Array


def concatenate_surfaces(surfaces: Iterable[Surface]) -> Surface:
    """Several surfaces as one."""
    return reduce(
        lambda a, b: Surface(
            sp.csr_matrix(a.mass + b.mass),
            np.vstack([a.points, b.points]),
            a.normals + b.normals,
        ),
        surfaces,
    )


def area_elements(tangents: Array) -> Array:
    """(...) length or area per parameter of tangents (..., d, k)."""
    gram = np.swapaxes(tangents, -1, -2) @ tangents
    size: Array = np.sqrt(np.maximum(np.linalg.det(gram), 0.0))
    return size


def products_of_normals(tangents: Array, weights: Array) -> Array:
    """(3, 3) sum of w |c| n n^T with c = n |c| the cross product of two tangents.

    Parameters
    ----------
    tangents : (p, d, k)
    weights : (p,) of the quadrature
    """
    if tangents.shape[1:] != (3, 2):
        return np.zeros((3, 3))
    c = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    size = np.linalg.norm(c, axis=1)
    scaled = weights * np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    products: Array = np.einsum("p,pa,pb->ab", scaled, c, c)
    return products


def patch_surface(patch: NurbsPatch, direction: int, end: int) -> Surface:
    """The side where a parameter is 0 or 1."""
    nodes = side_nodes(patch, direction, end)
    along = [i for i in range(len(patch.degrees)) if i != direction]
    values, slopes, weights = [], [], []
    for i in along:
        points, rule = gauss_points(
            patch.knots[i], patch.degrees[i] + _EXTRA_GAUSS_POINTS
        )
        basis = local_basis(patch.knots[i], patch.degrees[i], points.ravel())
        count = patch.shape[i]
        values.append(_basis_matrix(basis, basis.values, count))
        slopes.append(_basis_matrix(basis, basis.derivatives, count))
        weights.append(rule.ravel())
    rows = _tensor_products(values)
    w = patch.weights.ravel()[nodes]
    weighted = patch.points[nodes] * w[:, None]
    total = rows @ w
    position = (rows @ weighted) / total[:, None]
    tangents = []
    for k in range(len(along)):
        derived = _tensor_products(
            [slopes[j] if j == k else values[j] for j in range(len(along))]
        )
        drift = position * (derived @ w)[:, None]
        tangents.append((derived @ weighted - drift) / total[:, None])
    t, rule = np.stack(tangents, axis=2), _product_weights(weights)
    measure = rule * area_elements(t)
    scaled = sp.diags_array(np.sqrt(measure) / total) @ rows @ sp.diags_array(w)
    entries = sp.coo_matrix(scaled.T @ scaled)
    shape = (patch.weights.size,) * 2
    index = (nodes[entries.row], nodes[entries.col])
    mass = sp.csr_matrix((entries.data, index), shape=shape)
    return Surface(mass, position, products_of_normals(t.real, rule))


def _basis_matrix(basis: LocalBasis, entries: Array, count: int) -> sp.csr_matrix:
    points, width = entries.shape
    columns = (basis.first[:, None] + np.arange(width)).ravel()
    index = (np.repeat(np.arange(points), width), columns)
    return sp.csr_matrix((entries.ravel(), index), shape=(points, count))


def _tensor_products(factors: list[sp.csr_matrix]) -> sp.csr_matrix:
    return reduce(lambda a, b: sp.csr_matrix(sp.kron(a, b)), factors)


def _product_weights(weights: list[Array]) -> Array:
    """The weights of a product of rules; the last one runs fastest."""
    return reduce(lambda a, b: np.outer(a, b).ravel(), weights)


def common_simplices(
    slave: FaceGroup, master: FaceGroup
) -> Iterator[tuple[int, int, Array]]:
    """Faces that lie over each other, and the simplices (n, d, d - 1) they share.

    These are in the parameters of the slave; edges of the master are straight there.
    """
    from scipy.spatial import cKDTree

    centres = (slave.points.mean(axis=1), master.points.mean(axis=1))
    reach = slave.radii.max() + master.radii.max()
    near = cKDTree(centres[0]).query_ball_tree(cKDTree(centres[1]), reach)
    pairs = [(i, j) for i, neighbours in enumerate(near) for j in neighbours]
    if not pairs:
        return
    rows, others = np.array(pairs).T
    gap = np.linalg.norm(centres[0][rows] - centres[1][others], axis=1)
    close = gap <= slave.radii[rows] + master.radii[others]
    rows, others = rows[close], others[close]
    m = master.corners
    corners = master.points[others][:, :m].reshape(len(rows) * m, -1)
    placed = slave.nearest(np.repeat(rows, m), corners, inside=False)
    placed = placed.reshape(len(rows), m, -1)
    for i, j, outline in zip(rows, others, placed, strict=True):
        parts = _clip_outline(slave.kind, outline)
        if len(parts):
            yield int(i), int(j), parts


def _clip_outline(kind: str, outline: Array) -> Array:
    if outline.shape[1] == 1:
        a, b = np.clip(sorted(outline[:, 0]), 0.0, 1.0)
        return (
            np.array([[[a], [b]]]) if b - a > _MIN_AREA_SHARE else np.zeros((0, 2, 1))
        )
    polygon: Polygon = [(u, v) for u, v in outline.tolist()]
    for bound in _TRIANGLE_BOUNDS if kind.startswith("tri") else _SQUARE_BOUNDS:
        polygon = _clip_polygon(polygon, bound)
        if len(polygon) < 3:
            return np.zeros((0, 3, 2))
    first, *rest = polygon
    parts = np.array([[first, a, b] for a, b in zip(rest, rest[1:], strict=False)])
    sizes = np.abs(np.linalg.det(parts[:, 1:] - parts[:, :1]))
    return parts[sizes > _MIN_AREA_SHARE]


def _clip_polygon(polygon: Polygon, bound: tuple[int, int, int]) -> Polygon:
    """The part of a convex polygon on the positive side of a line."""
    a, b, c = bound
    clipped: Polygon = []
    sides = [a * u + b * v + c for u, v in polygon]
    for i, (point, side) in enumerate(zip(polygon, sides, strict=True)):
        before, other = polygon[i - 1], sides[i - 1]
        if (side >= 0) != (other >= 0):
            t = other / (other - side)
            clipped.append(
                (
                    before[0] + t * (point[0] - before[0]),
                    before[1] + t * (point[1] - before[1]),
                )
            )
        if side >= 0:
            clipped.append(point)
    return clipped


def simplex_quadrature(parts: Array) -> tuple[Array, Array]:
    """Points (n g, k) and weights (n g,) in parameters of simplices (n, k + 1, k)."""
    k = parts.shape[2]
    points, weights = _simplex_rule("line" if k == 1 else "tri")
    edges = parts[:, 1:] - parts[:, :1]
    placed = parts[:, :1] + np.einsum("gk,nkd->ngd", points, edges)
    sizes = np.abs(np.linalg.det(edges))
    return placed.reshape(-1, k), (sizes[:, None] * weights).ravel()


@cache
def _simplex_rule(shape: str) -> tuple[Array, Array]:
    return quadrature_rule(shape, _DEGREE)


@dataclass(frozen=True, eq=False)
class _FacePieces:
    """The same face, or edge, of several elements of one block.

    Attributes
    ----------
    local : nodes within the element, corners first
    corners : number of the corners among them
    rows : (k,) elements
    """

    block: ElementBlock
    local: tuple[int, ...]
    corners: int
    rows: Indices

    @property
    def nodes(self) -> Indices:
        """(k, m) rows of the mesh's positions."""
        return self.block.nodes[self.rows][:, self.local]


def named_surface(
    mesh: Mesh, sets: Mapping[str, Indices]
) -> Callable[[tuple[str, ...]], Surface | None]:
    """Return a function that computes the surface of named node sets on demand."""

    def surface(names: tuple[str, ...]) -> Surface | None:
        return mesh_surface(mesh, np.concatenate([sets[name] for name in names]))

    return surface


def mesh_surface(mesh: Mesh, nodes: Indices) -> Surface | None:
    """The outer faces all of whose nodes are in a set; in the plane the outer edges.

    If there are none, inner faces and then edges are used: the first of these that
    contains more than half of the nodes. The result is None if there is no such
    surface.
    """
    nodes = np.unique(nodes)
    member = np.zeros(len(mesh.positions), bool)
    member[nodes] = True
    for solid_faces, outer in ((True, True), (True, False), (False, False)):
        pieces = list(
            _count_once(list(_pieces_in_set(mesh, member, solid_faces)), outer)
        )
        held = {node for piece in pieces for node in piece.nodes.ravel().tolist()}
        if 2 * len(held) > len(nodes):
            return _integrate_surface(mesh, pieces)
    return None


def _pieces_in_set(
    mesh: Mesh, member: NDArray[np.bool_], of_faces: bool
) -> Iterator[_FacePieces]:
    """Faces, or edges, whose corners are in the set, with its nodes in their middle.

    A face with mid-side nodes outside the set is determined by its corners.
    """
    for block in mesh.blocks:
        middles = {
            frozenset((a, b)): m for a, b, m in element_edges(block.kind) if m >= 0
        }
        pieces: list[tuple[int, ...]] = [edge[:2] for edge in element_edges(block.kind)]
        if of_faces and mesh.dimension == 3:
            pieces = [*element_faces(block.kind, 3), *element_faces(block.kind, 4)]
        inside = member[block.nodes]
        for corners in pieces:
            around = zip(corners, (*corners[1:], corners[0]), strict=True)
            pairs = dict.fromkeys(frozenset(pair) for pair in around)
            whole = (*corners, *(middles[pair] for pair in pairs if pair in middles))
            there = inside[:, corners].all(axis=1)
            full = inside[:, whole].all(axis=1)
            yield _FacePieces(block, whole, len(corners), np.flatnonzero(full))
            if whole != corners:
                rows = np.flatnonzero(there & ~full)
                yield _FacePieces(block, corners, len(corners), rows)


def _count_once(pieces: list[_FacePieces], outer: bool) -> Iterator[_FacePieces]:
    """Return shared pieces once, or only the pieces of a single element."""
    keys = [np.full((len(p.rows), 4), -1) for p in pieces]
    for key, piece in zip(keys, pieces, strict=True):
        key[:, : piece.corners] = piece.nodes[:, : piece.corners]
    _, first, counts = np.unique(
        np.sort(np.concatenate(keys), axis=1),
        axis=0,
        return_index=True,
        return_counts=True,
    )
    is_selected = np.zeros(sum(map(len, keys)), bool)
    is_selected[first[counts == 1] if outer else first] = True
    ends = np.cumsum([len(key) for key in keys])[:-1]
    for piece, chosen in zip(pieces, np.split(is_selected, ends), strict=True):
        if chosen.any():
            yield _FacePieces(
                piece.block, piece.local, piece.corners, piece.rows[chosen]
            )


def _integrate_surface(mesh: Mesh, pieces: list[_FacePieces]) -> Surface:
    n = len(mesh.positions)
    mass, normals = sp.csr_matrix((n, n)), np.zeros((3, 3))
    for piece in pieces:
        values, tangents, weights = _piece_at_points(mesh, piece)
        depth = (piece.block.thickness or 1.0) if mesh.dimension == 2 else 1.0
        sizes = depth * weights * area_elements(tangents)
        entries = np.einsum("eg,gi,gj->eij", sizes, values, values).ravel()
        nodes, m = piece.nodes, len(piece.local)
        index = (np.repeat(nodes, m, axis=1).ravel(), np.tile(nodes, (1, m)).ravel())
        mass = mass + sp.csr_matrix((entries, index), shape=(n, n))
        flat = tangents.reshape(-1, *tangents.shape[2:])
        normals += products_of_normals(flat.real, np.tile(weights, len(nodes)))
    corners = [piece.nodes[:, : piece.corners].ravel() for piece in pieces]
    points = mesh.positions[np.unique(np.concatenate(corners))]
    return Surface(sp.csr_matrix(mass), points, normals)


def _piece_at_points(mesh: Mesh, piece: _FacePieces) -> tuple[Array, Array, Array]:
    """Values (g, m) at the points of a piece, tangents (k, g, d, t), weights (g,)."""
    kind = piece.block.kind
    if len(piece.local) == piece.corners:
        kind = shape_of(kind) + str(reference_element(kind).corners)
    element = reference_element(kind)
    ends = element.nodes[list(piece.local[: piece.corners])]
    directions = ends[[1] if piece.corners == 2 else [1, -1]] - ends[0]
    shape = {2: "line", 3: "tri", 4: "quad"}[piece.corners]
    points, weights = quadrature_rule(shape, _SURFACE_DEGREE)
    values, gradients = element.at(ends[0] + points @ directions)
    local = list(piece.local)
    slopes = gradients[:, local] @ directions.T
    tangents = np.einsum("kmd,gmt->kgdt", mesh.positions[piece.nodes], slopes)
    return values[:, local], tangents, weights
