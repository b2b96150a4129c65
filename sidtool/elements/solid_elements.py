"""Solid elements: map to space, strains, stiffness, mass, assembly.

Remedies for locking: reduced integration and incompatible modes.

Reduced integration keeps the work of uniform stress exact, so that distorted elements
and those with curved edges pass the patch test: the mean of the gradients over an
element is that of the full rule.

Incompatible modes: the functions b_i = xi_i (1 - xi_i) bend elements; b_i (1 - 2 xi_j)
with i != j twist warped ones and keep the volume of skew ones. Amplitudes of the latter
have no component along axis j, where b_j (1 - 2 xi_i) has the same strain.

Linear prisms always have the quadratic functions L_i L_j of their triangle and b = zeta
(1 - zeta) along their axis. Those of the triangle let a bent prism contract
transversely, and its cross-section warp. Transverse shear that is the gradient of a
quadratic deflection, which locks plates, then does no work; that of torsion, which is
no gradient, does. Fewer quadrature points instead would leave torsion without
stiffness.

Sources: T. J. R. Hughes, "Generalization of selective integration procedures to
anisotropic and nonlinear media", Int. J. Numer. Methods Eng. 15, 1980, for the means;
J.-S. Chen, M. Hillman, M. Rueter, "An arbitrary order variationally consistent
integration for Galerkin meshfree methods", Int. J. Numer. Methods Eng. 95, 2013, for
the correction; R. L. Taylor, P. J. Beresford, E. L. Wilson, "A non-conforming element
for stress analysis", Int. J. Numer. Methods Eng. 10, 1976, for the first functions;
U. Andelfinger, E. Ramm, "EAS-elements for two-dimensional, three-dimensional, plate and
shell structures and their equivalence to HR-elements", Int. J. Numer. Methods Eng. 36,
1993, for the strains of all (EAS-21); E. L. Wilson, A. Ibrahimbegovic, "Use of
incompatible displacement modes for the calculation of element stiffnesses or
stresses", Finite Elem. Anal. Des. 7, 1990, for the correction by the mean.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import (
    analytic_norm,
    product_with_step,
    weighted_squares,
)
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..mesh.jacobians import jacobian_adjugates, jacobian_columns, jacobian_determinants
from ..mesh.materials import AnisotropicMaterial, CylindricalMaterial, ElasticMaterial
from ..mesh.reference_elements import (
    ReferenceElement,
    prism_rule,
    quadrature_rule,
    reference_element,
)
from .matrix_sums import MatrixSum, pair_entries, pairs_of_functions

#: Fewer points, exact to degree 2 (in the triangle of a prism), as of Abaqus' and
#: CalculiX' C3D10 and C3D15: what strains of quadratic elements need.
_REDUCED_RULES = {"tet10": quadrature_rule("tet", 2), "wedge15": prism_rule(2, 4)}

#: Elements with optional incompatible modes.
KINDS_WITH_INCOMPATIBLE_MODES = ("quad4", "hex8")
#: Elements that always have incompatible modes.
KINDS_ALWAYS_INCOMPATIBLE = ("wedge6",)
Indices = NDArray[np.int64]


def extrapolation(kind: str, where: Array, *, relieved: bool) -> Array | None:
    """(g,) weights of the stiffness' points for the strain at a reference point.

    Strains at these points are more accurate than elsewhere in the element. The result
    is None for elements whose strains are equally accurate everywhere.

    Parameters
    ----------
    relieved : whether the element has internal modes: their slopes are right at its
        points, where uniform stress does no work on them
    """
    if not relieved and kind not in _REDUCED_RULES:
        return None
    points = (
        _REDUCED_RULES[kind][0]
        if kind in _REDUCED_RULES
        else reference_element(kind).points
    )
    fields = np.vstack(
        [_linear_fields(kind, points), _linear_fields(kind, where[None])]
    )
    return np.asarray(np.linalg.solve(fields[:-1].T, fields[-1]))


def _linear_fields(kind: str, points: Array) -> Array:
    """Return as many fields as points.

    Linear fields; those of a linear element with internal modes; along the axis of
    prisms as many powers as there are heights.
    """
    if kind in KINDS_WITH_INCOMPATIBLE_MODES:
        return reference_element(kind).at(points)[0]
    flat = np.column_stack([np.ones(len(points)), points])
    if kind == "tet10":
        return flat
    heights = points[:, 2:] ** np.arange(3 if kind == "wedge15" else 2)
    return (flat[:, :3, None] * heights[:, None, :]).reshape(len(points), -1)


def has_reduced_integration(kind: str) -> bool:
    """Return whether elements of this kind lock less with fewer points."""
    return kind in _REDUCED_RULES


def reduced_batch(
    nodes: Indices, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """Return a batch with reduced integration, of elements (ne, m)."""
    points, weights = _REDUCED_RULES[element.name]
    values, gradients = element.at(points)
    few = mapped_batch(nodes, positions, values[None], gradients[None], weights)
    volume, missing = _gradient_integrals(nodes, positions, element)
    measures = few.measures * (volume / few.measures.sum(axis=1))[:, None]
    missing -= np.einsum("eg,egmd->emd", measures, few.gradients)
    shift = missing / volume[:, None, None]
    return replace(few, gradients=few.gradients + shift[:, None], measures=measures)


def _gradient_integrals(
    nodes: Indices, positions: Array, element: ReferenceElement
) -> tuple[Array, Array]:
    """(ne,) volumes, and (ne, m, d) integrals of the gradients over each element.

    The measure times the inverse Jacobian matrix is the adjugate.
    """
    corners = positions[nodes]
    jacobians = jacobian_columns(corners, element.gradients[None])
    determinants = jacobian_determinants(jacobians)
    check_orientation(determinants, corners)
    adjugates = jacobian_adjugates(jacobians)
    d, _, ne, ng = adjugates.shape
    weighted = np.moveaxis(element.gradients * element.weights[:, None, None], 2, 0)
    parts = product_with_step(adjugates.reshape(d, d * ne, ng), weighted)
    integrals = parts.sum(axis=0).reshape(d, ne, -1)
    return determinants @ element.weights, np.moveaxis(integrals, 0, 2)


def with_incompatible_modes(
    batch: ElementBatch, positions: Array, element: ReferenceElement
) -> ElementBatch:
    """A batch at the element's quadrature points with its internal modes."""
    if element.name in KINDS_ALWAYS_INCOMPATIBLE:
        functions = 4
        free = np.eye(functions * element.dimension)
        directions = np.broadcast_to(free, (len(batch.nodes), *free.shape))
    else:
        _, centre = element.at(np.full((1, element.dimension), 0.5))
        directions = _allowed_amplitudes(
            np.swapaxes(positions[batch.nodes], 1, 2) @ centre[0]
        )
    return replace(
        batch,
        internal=internal_slopes(element, batch.gradients, batch.measures),
        directions=directions,
        inner=internal_values(element.name, element.points),
    )


def internal_values(kind: str, points: Array) -> Array:
    """(g, k) the functions that are displacements, at reference points (g, d).

    They are zero at all nodes. Modes that twist cubes contribute strains only. As
    displacements in mass and markers they would change frequencies of coarse parts by
    5e-4.
    """
    if kind not in KINDS_ALWAYS_INCOMPATIBLE:
        return points * (1 - points)
    x, y, z = points.T
    rest = 1 - x - y
    return np.stack([x * y, y * rest, rest * x, z * (1 - z)], axis=1)


def internal_gradients(kind: str, points: Array) -> Array:
    """(g, k, d) of `internal_values`, by the reference coordinates."""
    line = 1 - 2 * points
    if kind not in KINDS_ALWAYS_INCOMPATIBLE:
        return line[:, :, None] * np.eye(points.shape[1])
    x, y, _ = points.T
    rest, none = 1 - x - y, np.zeros(len(points))
    rows = [
        (y, x, none),
        (-y, rest - y, none),
        (rest - x, -x, none),
        (none, none, line[:, 2]),
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def internal_slopes(
    element: ReferenceElement, gradients: Array, measures: Array
) -> Array:
    """(ne, g, k, d) gradients of the internal modes in space [1/m].

    Their mean over the element is subtracted, so that uniform stress does no work on
    them and the patch test is passed.

    Parameters
    ----------
    gradients : (ne, g, m, d) of the nodal functions in space [1/m]
    measures : (ne, g) quadrature weights times Jacobian determinants [m^d]
    """
    natural = internal_gradients(element.name, element.points)
    if element.name not in KINDS_ALWAYS_INCOMPATIBLE:
        natural = np.concatenate([natural, _twisting_gradients(element.points)], axis=1)
    slopes = natural @ np.linalg.pinv(element.gradients) @ gradients
    shares = measures / measures.sum(axis=1, keepdims=True)
    means = np.einsum("eg,egkb->ekb", shares, slopes)
    return np.asarray(slopes - means[:, None])


def _twisting_gradients(points: Array) -> Array:
    """(g, d (d - 1), d) gradients of b_i (1 - 2 xi_j) by the reference coordinates."""
    d = points.shape[1]
    line, bubble = 1 - 2 * points, points * (1 - points)
    natural = np.zeros((len(line), d * (d - 1), d))
    for k, (i, j) in enumerate(permutations(range(d), 2)):
        natural[:, k, i] = line[:, i] * line[:, j]
        natural[:, k, j] = -2 * bubble[:, i]
    return natural


def _allowed_amplitudes(jacobians: Array) -> Array:
    """(ne, d^3, r) amplitudes that internal modes may have; Jacobians (ne, d, d)."""
    d = jacobians.shape[-1]
    dual = np.linalg.inv(jacobians)
    dual /= analytic_norm(dual, axis=2, keepdims=True)
    count = d * d + d * (d - 1) ** 2
    amplitudes = np.zeros((len(dual), d**3, count), dual.dtype)
    amplitudes[:, range(d * d), range(d * d)] = 1
    column = d * d
    for k, (_, j) in enumerate(permutations(range(d), 2), d):
        for across in set(range(d)) - {j}:
            amplitudes[:, k * d : (k + 1) * d, column] = dual[:, across]
            column += 1
    return amplitudes


@dataclass(frozen=True, eq=False)
class ElementBatch:
    """Elements of one kind at their quadrature points.

    Attributes
    ----------
    nodes : (ne, m) numbers of the nodes of every element
    values : (ne or 1, ng, m) shape functions
    gradients : (ne, ng, m, d) of the shape functions in space [1/m], (ne, 0, m, d) of a
        batch for the mass
    measures : (ne, ng) quadrature weight times Jacobian determinant [m^d]
    internal : (ne, ng, k, d) gradients of the internal modes
    directions : (ne, d k, r) their admissible amplitudes
    inner : (ng, d) values of the first internal modes; the others contribute strains
        only
    laws : (ne, ng, 6, 6) elasticity matrices [Pa] of a material with varying axes
    """

    nodes: Indices
    values: Array
    gradients: Array
    measures: Array
    internal: Array | None = None
    directions: Array | None = None
    inner: Array | None = None
    laws: Array | None = None


def mapped_batch(
    nodes: Indices,
    positions: Array,
    values: Array,
    gradients: Array,
    weights: Array,
    *,
    with_gradients: bool = True,
) -> ElementBatch:
    """An isoparametric batch: x = sum_i N_i X_i.

    Parameters
    ----------
    nodes : (ne, m)
    positions : (n, d) of all nodes [m]
    values : (ne or 1, ng, m)
    gradients : (ne or 1, ng, m, d) by the reference coordinates
    weights : (ne or 1, ng) of the quadrature
    with_gradients : whether the batch gets gradients, which the mass does not need

    Raises
    ------
    InputError : the map folds somewhere.
    """
    corners = positions[nodes]
    jacobians = jacobian_columns(corners, gradients)
    determinants = jacobian_determinants(jacobians)
    check_orientation(determinants, corners)
    slopes = np.zeros((len(nodes), 0, *gradients.shape[2:]))
    if with_gradients:
        inverses = jacobian_adjugates(jacobians) / determinants
        slopes = product_with_step(
            gradients, np.ascontiguousarray(np.moveaxis(inverses, (0, 1), (2, 3)))
        )
    return ElementBatch(
        nodes=nodes,
        values=values,
        gradients=slopes,
        measures=determinants * weights,
    )


def check_orientation(
    determinants: Array, corners: Array, floor: float = 1e-12
) -> None:
    """Check that all Jacobian determinants are positive.

    Parameters
    ----------
    determinants : (ne, points per element)
    corners : (ne, m, d) node positions, for the message
    floor : smallest determinant relative to the largest that counts as positive

    Raises
    ------
    InputError : one is not.
    """
    determinants, corners = np.real(determinants), np.real(corners)
    scale = np.abs(determinants).max()
    bad = np.flatnonzero((determinants <= floor * scale).any(axis=1))
    if bad.size:
        near = ", ".join(f"{x:.4g}" for x in corners[bad[0]].mean(axis=0))
        raise InputError(
            f"the map folds or is mirrored near ({near}): Jacobian determinant "
            f"{determinants[bad[0]].min():.3g} (in {bad.size} of {len(corners)} "
            "elements or knot spans)",
            place="geometry",
            expected="a right-handed map that covers every point once",
        )


def elasticity(material: ElasticMaterial, state: str) -> Array:
    """Elasticity matrix D [Pa].

    Parameters
    ----------
    state : "plane_stress" or "plane_strain", strains (xx, yy, 2 xy), D (3, 3); or
        "solid", strains (xx, yy, zz, 2 xy, 2 yz, 2 xz), D (6, 6)

    Raises
    ------
    InputError : the material of plane strain is not isotropic, or its axes turn in a
        plane.

    A solid with varying axes has no common matrix; it has `laws_at`.
    """
    if isinstance(material, AnisotropicMaterial):
        turning = isinstance(material, CylindricalMaterial)
        if state == "solid":
            return np.full((6, 6), np.nan) if turning else material.law
        if state == "plane_stress" and not turning:
            return material.in_plane
        raise InputError(
            f"the material of {state.replace('_', ' ')} is not isotropic",
            expected="solids, plane stress with fixed axes, or an isotropic material",
        )
    e, nu = material.youngs_modulus, material.poissons_ratio
    if state == "solid":
        shear = e / (2 * (1 + nu))
        law = np.diag([2 * shear] * 3 + [shear] * 3)
        law[:3, :3] += 2 * shear * nu / (1 - 2 * nu)
        return law
    if state == "plane_strain":
        e, nu = e / (1 - nu**2), nu / (1 - nu)
    shear = (1 - nu) / 2
    return e / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, shear]])


def strain_matrix(gradients: Array) -> Array:
    """(..., 3 or 6, d m) strains per displacement, from gradients (..., m, d).

    The order of the strains is that of `elasticity`.
    """
    *lead, m, d = gradients.shape
    pairs = _strain_axes(d)
    b = np.zeros((*lead, len(pairs), m, d), gradients.dtype)
    for row, (i, j) in enumerate(pairs):
        b[..., row, :, i] = gradients[..., j]
        b[..., row, :, j] = gradients[..., i]
    return b.reshape(*lead, len(pairs), d * m)


def _strain_axes(d: int) -> tuple[tuple[int, int], ...]:
    """The axes of each strain."""
    shears = ((0, 1),) if d == 2 else ((0, 1), (1, 2), (0, 2))
    return (*((i, i) for i in range(d)), *shears)


def element_stiffness(
    batch: ElementBatch, law: Array, amplitudes_found: list[Array] | None = None
) -> Array:
    """(ne, d m, d m) integral of B^T D B; internal modes are condensed.

    Parameters
    ----------
    law : elasticity matrix D [Pa], of a plane body times thickness [N/m]
    amplitudes_found : list to which the amplitudes of the internal modes that are
        displacements are added
    """
    if batch.internal is None:
        return _stiffness(batch, batch.gradients, law)
    full, amplitudes = _with_internal(batch, law)
    own = amplitudes.shape[2]
    if amplitudes_found is not None and batch.inner is not None:
        moving = batch.inner.shape[1] * batch.gradients.shape[3]
        amplitudes_found.append(amplitudes[:, :moving].copy())
    return full[:, :own, :own] + full[:, :own, own:] @ amplitudes


def internal_amplitudes(batch: ElementBatch, law: Array) -> Array:
    """(ne, d k, d m) amplitudes of the internal modes by the displacements."""
    return _with_internal(batch, law)[1]


def _with_internal(batch: ElementBatch, law: Array) -> tuple[Array, Array]:
    """The stiffness with internal modes behind the nodes, and their amplitudes."""
    assert batch.internal is not None and batch.directions is not None
    gradients = np.concatenate([batch.gradients, batch.internal], axis=2)
    own = batch.gradients.shape[2] * batch.gradients.shape[3]
    full = _stiffness(batch, gradients, law)
    rows = np.swapaxes(batch.directions, 1, 2) @ full[:, own:]
    inside = rows[:, :, own:] @ batch.directions
    return full, -batch.directions @ np.linalg.solve(inside, rows[:, :, :own])


def _stiffness(batch: ElementBatch, gradients: Array, law: Array) -> Array:
    """(ne, d m, d m) integral of B^T D B with these gradients (ne, ng, m, d)."""
    if batch.laws is not None:
        strains = strain_matrix(gradients)
        stresses = (batch.laws * batch.measures[..., None, None]) @ strains
        return np.asarray((np.swapaxes(strains, 2, 3) @ stresses).sum(axis=1))
    blocks = _stiffness_by_pair(batch.measures, gradients, law)
    m, d = gradients.shape[2:]
    _, places = pair_entries(m, d)
    full = blocks.reshape(len(blocks), -1)[:, places]
    return np.asarray(full.reshape(-1, m * d, m * d))


def _stiffness_by_pair(measures: Array, gradients: Array, law: Array) -> Array:
    """(ne, pairs, d d) sum over points of C_iajb dN_m/dx_a dN_n/dx_b, by (i, j), for
    the pairs of functions m <= n.

    The products of gradients are summed before the law acts on them, which is a sixth
    of the work of B^T D B in space.
    """
    ne, ng, m, d = gradients.shape
    flat = gradients.reshape(ne, ng, m * d)
    sums = pairs_of_functions(weighted_squares(flat, measures), d)
    products = product_with_step(sums.reshape(-1, d * d), _elasticity_tensor(law, d))
    return products.reshape(ne, -1, d * d)


def _elasticity_tensor(law: Array, d: int) -> Array:
    """(d d, d d) elasticity C_iajb by (a, b) and (i, j)."""
    numbers = np.zeros((d, d), np.int64)
    for row, (i, j) in enumerate(_strain_axes(d)):
        numbers[i, j] = numbers[j, i] = row
    tensor = law[numbers[:, :, None, None], numbers]
    return np.asarray(tensor.transpose(1, 3, 0, 2).reshape(d * d, d * d))


def element_mass(batch: ElementBatch, density: float) -> Array:
    """(ne, m, m) integral of density N_i N_j."""
    m = batch.values.shape[2]
    _, places = pair_entries(m, 1)
    by_pair = _mass_by_pair(batch, density)[..., 0]
    return np.asarray(by_pair[:, places].reshape(-1, m, m))


def _mass_by_pair(batch: ElementBatch, density: float) -> Array:
    """(ne, pairs, 1) integral of density N_i N_j for i <= j."""
    measures = batch.measures * density
    if len(batch.values) != 1:
        values = np.ascontiguousarray(batch.values)  # BLAS needs contiguous arrays
        return pairs_of_functions(weighted_squares(values, measures), 1)
    first, second = np.triu_indices(batch.values.shape[2])
    products = batch.values[0][:, first] * batch.values[0][:, second]
    return product_with_step(measures, products)[..., None]


def assemble_body(
    batches: Iterable[ElementBatch],
    count: int,
    *,
    density: float,
    law: Array,
    dimension: int = 2,
    amplitudes: list[Array] | None = None,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass (n, n) and stiffness (d n, d n) of a body.

    Parameters
    ----------
    count : number of nodes n
    density : mass per volume [kg/m^3], of a plane body per area [kg/m^2]
    law : elasticity matrix [Pa], of a plane body times thickness [N/m]
    dimension : d
    amplitudes : list to which those of internal modes are added
    """
    sums = MatrixSum(count, 1, dimension)
    pairs = ((batch, batch) for batch in batches)
    add_elements(sums, pairs, density=density, law=law, amplitudes=amplitudes)
    mass, stiffness = sums.total()
    return mass, stiffness


def add_elements(
    sums: MatrixSum,
    batches: Iterable[tuple[ElementBatch, ElementBatch]],
    *,
    density: float,
    law: Array,
    amplitudes: list[Array] | None = None,
) -> None:
    """Add elements to the sums of mass and stiffness; see `assemble_body`.

    Parameters
    ----------
    batches : the same elements at the points of the stiffness and of the mass
    """
    for batch, at_mass in batches:
        mass = _mass_by_pair(at_mass, density)
        if batch.internal is None and batch.laws is None:
            stiffness = _stiffness_by_pair(batch.measures, batch.gradients, law)
        else:
            full, d = element_stiffness(batch, law, amplitudes), sums.sizes[1]
            stiffness = pairs_of_functions(full, d)
        sums.add_pairs(batch.nodes, mass, stiffness)
