"""Initial stress of the undeformed body: ksigma, and its share in Ke."""

import re
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.reduction import FrameSettings, Prestress, Stiffening

from ..discretisation.marker_couplings import second_order_rows
from ..eigensolvers.eigenpair_derivatives import modal_stiffness, symmetric_eigenpairs
from ..elements.finite_element_model import FiniteElementModel, MarkerRows
from ..reduction.admissible_space import AdmissibleSpace, constrained_space
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis, orient_shapes, to_hertz
from .geometric_stiffness import (
    balanced_loads,
    contract_stress,
    piece_stiffness,
    projected_stiffness,
    quadrature_parts,
    stiffening_markers,
)

#: Loads are in balance if their resultant is below this share of them.
_BALANCE_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class InitialStress:
    """The stress of the undeformed body, by its generalised effects.

    Attributes
    ----------
    basis : shape functions of the prestressed body
    force : (nq,) generalised elastic force at q = 0 (ksigma)
    displacement : (ndof, 1) whose stress it is; None for a uniform stress
    uniform : (d, d) uniform stress [Pa]
    """

    basis: ReducedBasis
    force: Array
    displacement: Array
    uniform: Array


def check_prestress(
    body: FiniteElementModel, settings: Stiffening, frame: FrameSettings
) -> None:
    """Check before any solution that the loads of a prestress fit the body.

    Raises
    ------
    InputError : numbers do not fit the dimension, or the loads of a prestress are not
        supported.
    """
    if settings.prestress is not None:
        prestress = _with_reactions(body, settings.prestress, frame)
        _uniform_stress(prestress, body.dimension)


def add_prestress(
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    prestress: Prestress,
    settings: Stiffening,
    chosen: FrameSettings,
    loaded: AdmissibleSpace | None = None,
) -> InitialStress:
    """Add the geometric stiffness of an initial stress to Ke, in natural modes.

    A simulation applies the loads of the prestress as well. Their contribution by the
    first-order terms of their markers is not added to Ke, so that it counts once. A
    uniform stress needs loads, too, except for its self-equilibrated part.

    Raises
    ------
    InputError : numbers do not fit the dimension, nothing supports the loads, or the
        body buckles.
    """
    prestress = _with_reactions(body, prestress, chosen)
    uniform, shapes = _uniform_stress(prestress, body.dimension), basis.shapes
    equilibrating = _equilibrating_loads(body, uniform)
    marked = {marker.name for marker in stiffening_markers(body, settings)}
    loads, excess = _marker_loads(body, shapes, prestress)
    felt, excess_felt = _marker_loads(body, shapes, prestress, marked)
    if marked:
        felt = felt + equilibrating
    both = np.hstack([loads, felt])
    states, stiffness = _solve_loads(body, frame, shapes, both, loaded)
    extra = stiffness[0] + excess + _stiffness_of(body, uniform, shapes)
    _refuse_buckling(basis.stiffness + extra, "under its prestress")
    extra -= stiffness[1] + excess_felt
    _refuse_buckling(basis.stiffness + extra, "without the loads of its prestress")
    state = states[:, :1]
    generalised = shapes.T @ (body.stiffness @ state + equilibrating)[:, 0]
    values, mixing = symmetric_eigenpairs(basis.stiffness + extra)
    shapes = orient_shapes(basis.shapes @ mixing, body)
    labels = tuple(
        re.sub(r":\s*[\d.]+ Hz.*", f":{f:13.3f} Hz", label)
        for label, f in zip(basis.labels, to_hertz(values), strict=True)
    )
    shares = {
        kind: np.einsum("ij,i->j", mixing.real**2, share)
        for kind, share in basis.shares.items()
    }
    mixing = mixing * np.sign(
        np.sum(shapes.real * (basis.shapes @ mixing).real, axis=0)
    )
    stiffness = modal_stiffness(basis.stiffness + extra, values, mixing)
    new = ReducedBasis(shapes, stiffness, labels, shares, basis.diagnostics)
    return InitialStress(new, mixing.T @ generalised, state, uniform)


def _with_reactions(
    body: FiniteElementModel, prestress: Prestress, chosen: FrameSettings
) -> Prestress:
    """Add the reactions at its support to the forces and moments of a prestress.

    Reactions of a frame without a joint would depend on the frame: only those of a
    tangent frame are taken for those of a joint.
    """
    d = body.dimension
    force, moment, size = _load_resultant(body, prestress)
    balance = np.abs(np.append(force, moment / _largest_extent(body)))
    if prestress.support is None:
        if chosen.type != "tangent" and balance.max() > _BALANCE_TOLERANCE * size:
            raise InputError(
                "the forces and moments are not in balance",
                place="stiffening.prestress",
                expected="support, the marker that a joint holds against them, or the "
                "reactions among the loads, or a tangent frame",
            )
        return prestress
    at = body.marker(prestress.support)
    moment = moment - np.cross(at.position, force)
    forces, moments = dict(prestress.forces), dict(prestress.moments)
    own = np.array(forces.get(at.name, np.zeros(d)))
    forces[at.name] = tuple(own - force[:d])
    turning = moment if d == 3 else moment[2:]
    if np.abs(turning).max() > _BALANCE_TOLERANCE * size * _largest_extent(body):
        if not at.rotation.nnz:
            raise InputError(
                f"marker {at.name} has no rotation, which a moment could hold",
                place="stiffening.prestress.support",
                expected="a marker with a rotation, for example tied to an edge",
            )
        before = np.array(moments.get(at.name, np.zeros(len(turning))))
        moments[at.name] = tuple(before - turning)
    return prestress.model_copy(update={"forces": forces, "moments": moments})


def _load_resultant(
    body: FiniteElementModel, prestress: Prestress
) -> tuple[Array, Array, float]:
    """Sum of the loads, their moment about the origin (3,) each, and their size [N]."""
    force, moment, size = np.zeros(3), np.zeros(3), 0.0
    for kind, given in (("forces", prestress.forces), ("moments", prestress.moments)):
        for name, values in given.items():
            marker = body.marker(name)
            load = _load_vector(marker, values, body.dimension, kind)
            if kind == "forces":
                force, size = force + load, size + float(np.abs(load).sum())
                moment = moment + np.cross(marker.position, load)
            else:
                moment = moment + load
                size += float(np.abs(load).sum()) / _largest_extent(body)
    return force, moment, size


def _largest_extent(body: FiniteElementModel) -> float:
    """The largest extent of the body [m]."""
    return float(np.ptp(body.positions.real, axis=0).max())


def _refuse_buckling(stiffness: Array, when: str) -> None:
    if np.linalg.eigvalsh(stiffness.real)[0] <= 0:
        raise InputError(
            f"the body buckles {when}",
            place="stiffening.prestress",
            expected="a prestress below the buckling load",
        )


def _solve_loads(
    body: FiniteElementModel,
    frame: Frame,
    shapes: Array,
    loads: Array,
    loaded: AdmissibleSpace | None,
) -> tuple[Array, Array]:
    """Displacements (ndof, n) under loads, and the stiffness (n, nq, nq) they bring."""
    if not loads.any():
        return np.zeros_like(loads), np.zeros((loads.shape[1], *(shapes.shape[1],) * 2))
    loads = balanced_loads(body, frame, loads)
    states = (loaded or constrained_space(body, frame)).static(loads)
    stiffness = projected_stiffness(body, states, shapes)
    return states, stiffness + piece_stiffness(body, loads, states, shapes)


def _equilibrating_loads(body: FiniteElementModel, uniform: Array) -> Array:
    """Loads (ndof, 1) under which a stress is in equilibrium."""
    loads = np.zeros((body.ndof, 1), number_type(uniform, body.positions))
    if uniform.any():
        for part in quadrature_parts(body):
            forces = np.einsum("p,pmb,cb->pmc", part.weights, part.slopes, uniform)
            np.add.at(loads[:, 0], part.table[part.nodes], forces)
    return loads


def _marker_loads(
    body: FiniteElementModel,
    shapes: Array,
    settings: Prestress,
    names: set[str] | None = None,
) -> tuple[Array, Array]:
    """Return loads (ndof, 1) on all or some markers, and the stiffness that their rows
    lack.
    """
    numbers = number_type(shapes, body.positions)
    loads = np.zeros((body.ndof, 1), numbers)
    excess = np.zeros((shapes.shape[1],) * 2, numbers)
    for kind, given in (("forces", settings.forces), ("moments", settings.moments)):
        for name, values in given.items():
            if names is not None and name not in names:
                continue
            marker = body.marker(name)
            load = _load_vector(marker, values, body.dimension, kind)
            of_forces, of_moments = second_order_rows(body, marker, shapes)
            if kind == "forces":
                loads[:, 0] += marker.displacement.T @ load
                excess += np.tensordot(load, of_forces, 1)
            else:
                loads[:, 0] += marker.rotation.T @ load
                excess += np.tensordot(load, of_moments, 1)
    return loads, excess


def _stiffness_of(body: FiniteElementModel, uniform: Array, shapes: Array) -> Array:
    """Geometric stiffness (nq, nq) of a uniform stress."""
    stiffness = np.zeros((1, *(shapes.shape[1],) * 2), number_type(uniform, shapes))
    if uniform.any():
        for part in quadrature_parts(body):
            stress = uniform * part.weights[:, None, None, None]
            stiffness += contract_stress(stress, part.gradients(shapes))
    return np.asarray((stiffness[0] + stiffness[0].T) / 2)


def _uniform_stress(settings: Prestress, d: int) -> Array:
    if settings.stress is None:
        return np.zeros((d, d))
    place, count = "stiffening.prestress.stress", 3 if d == 2 else 6
    _check_count(settings.stress, count, place)
    pairs = [(0, 0), (1, 1), (0, 1)]
    if d == 3:
        pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]
    tensor = np.zeros((d, d), number_type(settings.stress))
    for value, (a, b) in zip(settings.stress, pairs, strict=True):
        tensor[a, b] = tensor[b, a] = value
    return tensor


def _load_vector(
    marker: MarkerRows, values: tuple[float, ...], d: int, kind: str
) -> Array:
    """(3,) force or moment on a marker."""
    place = f"stiffening.prestress.{kind}.{marker.name}"
    count = 1 if (d, kind) == (2, "moments") else d
    _check_count(values, count, place)
    full = np.zeros(3, number_type(values))
    if count == 1:
        full[2] = values[0]
    else:
        full[:d] = values
    return full


def _check_count(values: tuple[float, ...], count: int, place: str) -> None:
    if len(values) != count:
        raise InputError(
            f"has {len(values)} numbers", place=place, expected=f"{count} of them"
        )
