"""Shell elements with six degrees of freedom at each node.

The shell is the continuum x = sum_i N_i (X_i + z n_i) with the unit normals n_i of the
element's surface at its nodes, which move by u = sum_i N_i (u_i + z theta_i x n_i): any
rigid motion is free of strain, of warped elements too. Transverse shear strains of
quad4 are those of MITC4 (K.-J. Bathe, E. N. Dvorkin, Int. J. Numer. Methods Eng. 21,
1985), of tri3 those of MITC3 (P.-S. Lee, K.-J. Bathe, Comput. Struct. 82, 2004), whose
shear flexibility has a part h^2 of that in bending added (after M. Lyly, R. Stenberg,
T. Vihinen, Comput. Methods Appl. Mech. Eng. 110, 1993, there of isotropic plates), by
sum_c F_acbc of the flexibility tensor F, so that neither stiff fibres lock nor soft
cores soften. The membrane of quad4 has the incompatible modes of Taylor, Beresford and
Wilson (1976). Rotations about the normal follow the rotation of the surface by a
penalty (T. J. R. Hughes, F. Brezzi, Comput. Methods Appl. Mech. Eng. 72, 1989).

Shear panels carry shear flows along their edges alone. The stresses of a panel are
those whose resultants act along its straight edges: Airy's function is u v / w, where
(u : v : w) are the linear functions of the position that map the quadrilateral to the
unit square. It is bilinear along straight lines between opposite edges, so that no edge
has a normal stress. On a parallelogram these are uniform; on other quadrilaterals they
are the shear flows of S. J. Garvey, "The quadrilateral shear panel", Aircraft
Engineering 23 (5), 1951, as in Nastran. Each edge hands half of its resultant to either
node. By statics the four forces act along the diagonals, so that they balance on warped
panels, too.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import analytic_abs, analytic_norm, number_type
from sidtool.formats.base.sid import Array

#: Points and weights of the quadrature along an edge of the unit square.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_POINTS, _WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2


def shear_panel_stiffness(corners: Array, law: Array, axis: Array) -> Array:
    """Return the stiffness (ne, 24, 24) of panels by displacements and rotations.

    Parameters
    ----------
    corners : (ne, 4, 3) positions of the nodes around convex panels [m]
    law : (ne, 3, 3) membrane forces by strains xx, yy, xy in the material axes [N/m]
    axis : (ne, 3) directions whose projections are the material axis x
    """
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    normal = _unit(np.cross(first, second))
    x = _unit(axis - np.einsum("ea,ea->e", axis, normal)[:, None] * normal)
    axes = np.stack([x, np.cross(normal, x)], axis=1)
    size = analytic_norm(first, axis=1)[:, None, None]
    arms = (corners - corners.mean(axis=1, keepdims=True)) / size
    flat = np.einsum("eia,eka->eik", arms, axes)
    forms = _projective_forms(flat)
    slopes, _ = _airy_function(forms, flat)
    jump = (np.roll(slopes, -1, axis=1) - np.roll(slopes, 1, axis=1)) / 2
    forces = np.stack([jump[..., 1], -jump[..., 0]], axis=2)
    flexibility = _flexibility(forms, flat, np.asarray(np.linalg.inv(law)))
    rows = np.zeros((len(corners), 4, 6), number_type(corners))
    rows[..., :3] = np.einsum("eik,eka->eia", forces, axes)
    by_dofs = rows.reshape(-1, 24)
    products = by_dofs[:, :, None] * by_dofs[:, None, :]
    return np.asarray(products / flexibility[:, None, None])


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / analytic_norm(vectors, axis=1, keepdims=True))


def _projective_forms(flat: Array) -> Array:
    """(ne, 3, 3) coefficients of u, v and w by x, y and 1."""
    p = np.concatenate([flat, np.ones((*flat.shape[:2], 1))], axis=2)
    sides = np.stack([p[:, 1], p[:, 3], -p[:, 0]], axis=2)
    weights = np.linalg.solve(sides, p[:, 2][..., None])
    b, d, a = (weights[:, k] * p[:, i] for k, i in ((0, 1), (1, 3), (2, 0)))
    return np.asarray(np.linalg.inv(np.stack([b - a, d - a, a], axis=2)))


def _airy_function(forms: Array, points: Array) -> tuple[Array, Array]:
    """Slopes (ne, k, 2) and second derivatives (ne, k, 2, 2) of u v / w."""
    values = np.einsum("efa,eka->fek", forms[:, :, :2], points)
    u, v, w = values + forms[:, :, 2].T[:, :, None]
    du, dv, dw = (forms[:, None, k, :2] for k in range(3))
    u, v, w = u[..., None], v[..., None], w[..., None]
    slopes = (v * du + u * dv) / w - u * v / w**2 * dw
    u, v, w = u[..., None], v[..., None], w[..., None]
    curved = (
        _symmetric(du, dv) / w + 2 * u * v / w**3 * dw[..., None] * dw[..., None, :]
    )
    curved = curved - (v * _symmetric(du, dw) + u * _symmetric(dv, dw)) / w**2
    return slopes, curved


def _symmetric(a: Array, b: Array) -> Any:
    return a[..., None] * b[..., None, :] + b[..., None] * a[..., None, :]


def _flexibility(forms: Array, flat: Array, compliance: Array) -> NDArray[np.float64]:
    """(ne,) twice the energy of the stresses."""
    r, s = (x.ravel() for x in np.meshgrid(_POINTS, _POINTS))
    shares = np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], axis=1)
    along = np.stack([s - 1, 1 - s, s, -s], axis=1)
    across = np.stack([r - 1, -r, r, 1 - r], axis=1)
    a, b = (np.einsum("ki,eic->ekc", by, flat) for by in (along, across))
    area = np.outer(_WEIGHTS, _WEIGHTS).ravel() * analytic_abs(
        a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    )
    _, curved = _airy_function(forms, np.einsum("ki,eic->ekc", shares, flat))
    stress = np.stack([curved[..., 1, 1], curved[..., 0, 0], -curved[..., 0, 1]], 2)
    return np.asarray(np.einsum("ek,eka,eab,ekb->e", area, stress, compliance, stress))


_A = 1 / np.sqrt(3)
#: Kind -> points and weights of the quadrature.
_RULES = {
    "quad4": (np.array([[-_A, -_A], [_A, -_A], [_A, _A], [-_A, _A]]), np.ones(4)),
    "tri3": (
        np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]]),
        np.full(3, 1 / 6),
    ),
}
_CENTRES = {"quad4": np.zeros(2), "tri3": np.full(2, 1 / 3)}
_NODES = {
    "quad4": np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]),
    "tri3": np.array([[0.0, 0], [1, 0], [0, 1]]),
}
#: The part of the longest side squared: of triangles as a stabilisation, else against
#: loss of digits.
_SHARES = {"quad4": 1e-7, "tri3": 0.0158}
#: Penalty of the mean rotation about the normal, and of its differences, as shares of
#: the shear stiffness of the membrane.
_MEAN, _DIFFERENCES = 1.0, 1e-3


@dataclass(frozen=True, eq=False)
class ShellBatch:
    """Shell elements of one kind with their matrices.

    Degree of freedom ``6 i + a`` of an element is the displacement (a < 3) or rotation
    of its node i in the axes of the model.

    Attributes
    ----------
    stiffness : (ne, 6 m, 6 m)
    positions : (ne, ng, 3) of the particles that carry the mass [m]
    masses : (ne, ng) [kg]
    inertias : (ne, ng, 3, 3) about the particles [kg m^2]
    displacement, rotation : (ne, ng, 3, 6 m) motion of the particles
    """

    stiffness: Array
    positions: Array
    masses: Array
    inertias: Array
    displacement: Array
    rotation: Array


@dataclass(frozen=True, eq=False)
class ShellLaws:
    """Sections of the elements of a batch in axes of each element.

    Attributes
    ----------
    membrane, coupling, bending : (ne, 3, 3)
    shear : (ne, 2, 2)
    masses : (ne, 3)
    thickness : (ne,) [m]
    axis : (ne, 3) a direction whose projection is the axis x
    flexural : (ne,) whether they resist bending
    """

    membrane: Array
    coupling: Array
    bending: Array
    shear: Array
    masses: Array
    thickness: Array
    axis: Array
    flexural: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Point:
    """The surface at one reference point of all elements.

    slopes : (ne, m, 2) derivatives of the shape functions along the axes
    axes : (ne, 3, 3) rows: x and y in the surface, and its normal
    inverse : (ne, 2, 2) reference coordinates by the axes
    area : (ne,) of the surface per reference area
    director : (ne, 3) sum of N_i n_i
    bent : (ne, 2, 3) derivatives of the director along the axes
    """

    values: Array
    slopes: Array
    axes: Array
    inverse: Array
    area: Array
    director: Array
    bent: Array


def shell_batch(kind: str, corners: Array, laws: ShellLaws) -> ShellBatch:
    """The matrices of shell elements.

    Parameters
    ----------
    kind : tri3, quad4 or panel
    corners : (ne, m, 3) places of their nodes [m]
    """
    if kind == "panel":
        panels = shear_panel_stiffness(corners, laws.membrane, laws.axis)
        return replace(shell_batch("quad4", corners, laws), stiffness=panels)
    ne, m, _ = corners.shape
    normals = _node_normals(kind, corners)
    centre = _point(kind, _CENTRES[kind], corners, normals, laws.axis)
    size = 6 * m
    inner = 4 if kind == "quad4" else 0
    total = np.zeros((ne, size + inner, size + inner), number_type(corners))
    sampled = _sampled_shear(kind, corners, normals)
    shear_law = _shear_law(kind, corners, laws) * laws.flexural[:, None, None]
    places, masses, tensors, moves, turns = [], [], [], [], []
    points, weights = _RULES[kind]
    for reference, weight in zip(points, weights, strict=True):
        at = _point(kind, reference, corners, normals, laws.axis)
        area = weight * at.area
        stretch, bend = _strains(at, normals)
        if inner:
            stretch = np.concatenate([stretch, _inner(reference, at, centre)], axis=2)
            bend = np.concatenate([bend, np.zeros((ne, 3, inner))], axis=2)
        force = laws.membrane @ stretch + laws.coupling @ bend
        moment = laws.coupling @ stretch + laws.bending @ bend
        total += _weighed(area, stretch, force) + _weighed(area, bend, moment)
        shear = at.inverse @ _interpolated(kind, reference, sampled)
        spin = _drilling(at)
        twist = _DIFFERENCES * laws.membrane[:, 2, 2] * laws.flexural
        total[:, :size, :size] += _weighed(area, shear, shear_law @ shear)
        total[:, :size, :size] += _weighed(area, spin, twist[:, None, None] * spin)
        heavy = laws.masses[:, 0]
        arm = np.divide(
            laws.masses[:, 1], heavy, out=np.zeros_like(heavy), where=heavy > 0
        )
        rest = laws.masses[:, 2] - arm * laws.masses[:, 1]
        move, turn = _motion(at, normals, arm)
        places.append(
            np.einsum("i,eia->ea", at.values, corners) + arm[:, None] * at.director
        )
        masses.append(area * heavy)
        n = at.axes[:, 2]
        across = np.eye(3) - n[:, :, None] * n[:, None, :]
        tensors.append((area * rest * laws.flexural)[:, None, None] * across)
        moves.append(move)
        turns.append(turn)
    spin = _drilling(centre)
    twist = _MEAN * laws.membrane[:, 2, 2] * laws.flexural
    whole = weights.sum() * centre.area
    total[:, :size, :size] += _weighed(whole, spin, twist[:, None, None] * spin)
    stiffness = total[:, :size, :size]
    if inner:
        own, mixed = total[:, size:, size:], total[:, size:, :size]
        stiffness = stiffness - np.swapaxes(mixed, 1, 2) @ np.linalg.solve(own, mixed)
    return ShellBatch(
        (stiffness + np.swapaxes(stiffness, 1, 2)) / 2,
        *(np.stack(x, axis=1) for x in (places, masses, tensors, moves, turns)),
    )


def _shapes(kind: str, at: Array) -> tuple[Array, Array]:
    """Shape functions (m,) and derivatives (m, 2) by the reference coordinates."""
    x, y = at
    if kind == "tri3":
        return np.array([1 - x - y, x, y]), np.array([[-1.0, -1], [1, 0], [0, 1]])
    a, b = _NODES[kind].T
    values = (1 + a * x) * (1 + b * y) / 4
    return values, np.stack([a * (1 + b * y), b * (1 + a * x)], axis=1) / 4


def _node_normals(kind: str, corners: Array) -> Array:
    """(ne, m, 3) unit normals of the surface at its nodes.

    Where an element has no plane at a node, the normal is that of its centre.
    """
    node_normals = []
    for at in (*_NODES[kind], _CENTRES[kind]):
        first, second = np.einsum("ik,eia->kea", _shapes(kind, at)[1], corners)
        node_normals.append(np.cross(first, second))
    size = analytic_norm(np.stack(node_normals), axis=2)
    centre = node_normals[-1]
    normals = [
        np.where((s.real > 1e-9 * size[-1].real)[:, None], n, centre)
        for n, s in zip(node_normals[:-1], size, strict=False)
    ]
    stacked = np.stack(normals, axis=1)
    return stacked / analytic_norm(stacked, axis=2, keepdims=True)


def _point(
    kind: str, reference: Array, corners: Array, normals: Array, axis: Array
) -> _Point:
    values, by = _shapes(kind, reference)
    tangents = np.einsum("ik,eia->eka", by, corners)
    n = np.cross(tangents[:, 0], tangents[:, 1])
    area = analytic_norm(n, axis=1)
    n = n / area[:, None]
    x = axis - np.einsum("ea,ea->e", axis, n)[:, None] * n
    x = x / analytic_norm(x, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(n, x), n], axis=1)
    jacobian = np.einsum("eka,eba->ekb", tangents, axes[:, :2])
    inverse = np.linalg.inv(jacobian)
    slopes = np.einsum("ebk,ik->eib", inverse, by)
    return _Point(
        values,
        slopes,
        axes,
        inverse,
        area,
        np.einsum("i,eia->ea", values, normals),
        np.einsum("eib,eia->eba", slopes, normals),
    )


def _weighed(area: Array, strain: Array, force: Array) -> Array:
    return np.swapaxes(strain, 1, 2) @ (area[:, None, None] * force)


def _rows(along: Array, about: Array) -> Array:
    """(ne, r, 6 m) from rows (ne, r, m, 3) by displacements and by rotations."""
    both = np.concatenate([along, about], axis=3)
    return both.reshape(*both.shape[:2], -1)


def _strains(at: _Point, normals: Array) -> tuple[Array, Array]:
    """(ne, 3, 6 m) strains of the surface and its changes of curvature."""
    x, y = at.axes[:, 0], at.axes[:, 1]
    s, t = at.slopes[:, :, 0, None], at.slopes[:, :, 1, None]
    ex, ey = x[:, None], y[:, None]
    stretch = np.stack([s * ex, t * ey, t * ex + s * ey], axis=1)
    nx, ny = np.cross(normals, ex), np.cross(normals, ey)
    about = np.stack([s * nx, t * ny, t * nx + s * ny], axis=1)
    bx, by = at.bent[:, 0, None], at.bent[:, 1, None]
    along = np.stack([s * bx, t * by, t * bx + s * by], axis=1)
    return _rows(stretch, np.zeros_like(stretch)), _rows(along, about)


def _covariant_shear(
    kind: str, reference: Array, corners: Array, normals: Array
) -> Array:
    """(ne, 2, 6 m) transverse shear by the reference coordinates."""
    values, by = _shapes(kind, reference)
    tangents = np.einsum("ik,eia->eka", by, corners)
    director = np.einsum("i,eia->ea", values, normals)
    along = by.T[None, :, :, None] * director[:, None, None]
    about = values[None, None, :, None] * np.cross(
        normals[:, None], tangents[:, :, None]
    )
    return _rows(along, about)


def _sampled_shear(kind: str, corners: Array, normals: Array) -> list[Array]:
    """Rows of the shear at the points that it is interpolated from."""
    if kind == "quad4":
        chosen = ((0, (0.0, -1.0)), (0, (0.0, 1.0)), (1, (-1.0, 0.0)), (1, (1.0, 0.0)))
    else:
        chosen = ((0, (0.5, 0.0)), (1, (0.0, 0.5)), (0, (0.5, 0.5)), (1, (0.5, 0.5)))
    return [
        _covariant_shear(kind, np.array(at), corners, normals)[:, k] for k, at in chosen
    ]


def _interpolated(kind: str, reference: Array, sampled: list[Array]) -> Array:
    x, y = reference
    a, b, c, d = sampled
    if kind == "quad4":
        first = ((1 - y) * a + (1 + y) * b) / 2
        second = ((1 - x) * c + (1 + x) * d) / 2
    else:
        slope = b - a - d + c
        first, second = a + slope * y, b - slope * x
    return np.stack([first, second], axis=1)


def _shear_law(kind: str, corners: Array, laws: ShellLaws) -> Array:
    """(ne, 2, 2) the law of transverse shear, in series with bending of the element."""
    bending, trace = laws.bending, np.trace(laws.bending, axis1=1, axis2=2)
    if laws.coupling.any():
        shift = np.linalg.pinv(laws.membrane) @ laws.coupling
        bending = bending - np.swapaxes(laws.coupling, 1, 2) @ shift
    bends = (laws.flexural & (trace > 0))[:, None, None]
    least = 1e-12 * trace[:, None, None]
    soft = np.linalg.inv(np.where(bends, bending + least * np.eye(3), np.eye(3)))
    twist, mixed = soft[:, 2, 2] / 4, (soft[:, 0, 2] + soft[:, 1, 2]) / 2
    part = np.array([[soft[:, 0, 0] + twist, mixed], [mixed, soft[:, 1, 1] + twist]])
    sides = analytic_norm(corners - np.roll(corners, 1, axis=1), axis=2)
    part = np.moveaxis(_SHARES[kind] * sides.max(axis=1) ** 2 * part, 2, 0)
    return np.linalg.solve(np.eye(2) + laws.shear @ part, laws.shear)


def _inner(reference: Array, at: _Point, centre: _Point) -> Array:
    """(ne, 3, 4) strains of the displacements 1 - x^2 and 1 - y^2 in both axes."""
    share = centre.area / at.area
    turn = np.einsum("eka,eba->ekb", at.axes[:, :2], centre.axes[:, :2])
    inverse = turn @ centre.inverse
    rows = []
    for k in (0, 1):
        slope = -2 * reference[k] * share[:, None] * inverse[:, :, k]
        s, t, zero = slope[:, 0], slope[:, 1], np.zeros(len(slope))
        rows += [np.stack([s, zero, t], axis=1), np.stack([zero, t, s], axis=1)]
    return np.stack(rows, axis=2)


def _drilling(at: _Point) -> Array:
    """(ne, 1, 6 m) rotation about the normal beyond that of the surface."""
    x, y, n = at.axes[:, None, 0], at.axes[:, None, 1], at.axes[:, None, 2]
    s, t = at.slopes[:, :, 0, None], at.slopes[:, :, 1, None]
    along = -(s * y - t * x) / 2
    about = at.values[None, :, None] * n
    return _rows(along[:, None], about[:, None])


def _motion(at: _Point, normals: Array, arm: Array) -> tuple[Array, Array]:
    """(ne, 3, 6 m) displacement of a point off the surface, and its rotation."""
    ne, m, _ = normals.shape
    eye = np.eye(3)
    n = arm[:, None, None] * normals
    spin = np.zeros((ne, m, 3, 3), number_type(n))  # theta x n
    spin[..., 0, 1], spin[..., 0, 2] = n[..., 2], -n[..., 1]
    spin[..., 1, 0], spin[..., 1, 2] = -n[..., 2], n[..., 0]
    spin[..., 2, 0], spin[..., 2, 1] = n[..., 1], -n[..., 0]
    share = at.values[None, :, None, None]
    plain = np.broadcast_to(share * eye, spin.shape)
    move = np.concatenate([plain, share * spin], axis=3)
    turn = np.concatenate([np.zeros_like(spin), plain], axis=3)
    return tuple(  # type: ignore[return-value]
        np.swapaxes(rows, 1, 2).reshape(ne, 3, 6 * m) for rows in (move, turn)
    )
