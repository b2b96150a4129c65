"""Reduced basis: independent shape functions, orthonormal in the mass matrix.

Markers at a single point of a plane body or a solid, where compliance has no limit.

The displacement under a force at a point of an elastic continuum is infinite: on a mesh
it grows with the logarithm of the element size in plane bodies, and with its reciprocal
in solids (Flamant's and Boussinesq's solutions). A tie spreads the force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.extremes import EQUAL, first_largest
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..eigensolvers.eigenpair_derivatives import modal_stiffness, symmetric_eigenpairs
from ..eigensolvers.eigenpairs import equal_frequencies, rotation_to_axes
from ..elements.finite_element_model import FiniteElementModel
from .body_frames import Frame

if TYPE_CHECKING:
    from .admissible_space import AdmissibleSpace


#: A candidate is dependent if a smaller fraction of it is independent of the others.
DEPENDENCE_TOLERANCE = 1e-8

_GROWTH = {
    2: ("plane body", "with the logarithm of the element size"),
    3: ("solid", "with the reciprocal of the element size"),
}


@dataclass(frozen=True, eq=False)
class ShapeFamily:
    """Candidates of one kind.

    Attributes
    ----------
    kind : "normal", "constraint", "attachment", "inertia relief", ...
    shapes : (ndof, n)
    names : n texts, for the report on omitted candidates
    """

    kind: str
    shapes: Array
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """Shape functions of a body.

    Attributes
    ----------
    shapes : (ndof, nq)
    stiffness : (nq, nq) shapes^T K shapes
    labels : nq texts for the SID
    shares : kind of candidate -> (nq,) its share of the kinetic energy of each shape
        function; the shares of one shape function add up to 1
    diagnostics : of omitted candidates
    space : admissible space of the reduction, with its factors, or None
    """

    shapes: Array
    stiffness: Array
    labels: tuple[str, ...]
    shares: Mapping[str, Array] = field(default_factory=dict)
    diagnostics: tuple[Diagnostic, ...] = ()
    space: AdmissibleSpace | None = None

    def reconstruct(self, q: ArrayLike) -> Array:
        """Return the displacement of every degree of freedom, (ndof,), for q (nq,)."""
        return self.shapes @ np.asarray(q, float)

    @property
    def frequencies(self) -> Array:
        """(nq,) of the shape functions one by one [Hz]; they are mass-normalised."""
        return to_hertz(np.diag(self.stiffness))


def orthonormal_basis(
    model: FiniteElementModel,
    frame: Frame,
    families: Sequence[ShapeFamily],
    title: str,
) -> ReducedBasis:
    """Return the natural modes of the space of all candidates in the frame. The rigid
    motion of the frame is removed first, then linearly dependent candidates. The Ritz
    vectors of stiffness and mass in the remaining space make Me the identity and Ke
    diagonal, however close to each other the candidates were.

    Raises
    ------
    InputError : no deformation is left.
    """
    candidates = np.hstack([family.shapes for family in families])
    kinds = [family.kind for family in families for _ in family.shapes.T]
    names = [name for family in families for name in _family_names(family)]
    sizes = _shape_norms(model, candidates)
    inside = frame.without_rigid_motion(model, candidates)
    basis, selected = _orthonormalise(model, inside, sizes)
    if not selected:
        raise InputError(
            "no deformation is left in this frame",
            place="reduction",
            expected="shape functions other than rigid motions",
        )
    small = basis.T @ (model.stiffness @ basis)
    values, mixing = symmetric_eigenpairs((small + small.T) / 2)
    shapes = basis @ mixing
    groups = equal_frequencies(values.real, shapes.real, model.stiffness)
    turns = rotation_to_axes(groups, shapes.real, model.directions)
    mixing, shapes = mixing @ turns, orient_shapes(shapes @ turns, model)
    origin = np.array([kinds[i] for i in selected])
    amounts = mixing.real**2
    shares = {kind: amounts[origin == kind].sum(axis=0) for kind in set(kinds)}
    return ReducedBasis(
        shapes=shapes,
        stiffness=modal_stiffness(model.stiffness, values, shapes),
        labels=tuple(
            f"{title}{i:5d} :{f:13.3f} Hz{_share_text(shares, i - 1)}"
            for i, f in enumerate(to_hertz(values), 1)
        ),
        shares=shares,
        diagnostics=_omitted_candidates(names, selected),
    )


def to_hertz(eigenvalues: Array) -> Array:
    """Squared circular frequencies as frequencies [Hz]."""
    return np.sqrt(np.maximum(eigenvalues.real, 0.0)) / (2 * np.pi)


def orient_shapes(shapes: Array, model: FiniteElementModel) -> Array:
    """Return the shape functions with signs that do not depend on the solver.

    A shape function is positive in the largest component of its displacement at the
    last marker of the model file at which it moves; if it moves at none, and nodes
    have rotations, of that at the first one that it turns; else in the largest
    component of all. Of components that are as large but for rounding the first one
    counts, which is the same place on finer meshes.
    """
    signs = [_shape_sign(shape, model) for shape in shapes.real.T]
    return shapes * signs


def _shape_sign(shape: Array, model: FiniteElementModel) -> float:
    visible = EQUAL * np.abs(shape).max()
    rows = [marker.displacement for marker in reversed(model.markers)]
    if (model.table[:, 3:] >= 0).any():  # otherwise rotations are gradients of a mesh
        rows += [marker.rotation for marker in model.markers]
    components = ((row @ shape).real for row in rows)
    motion = next((m for m in components if np.abs(m).max() > visible), shape)
    return np.sign(motion[first_largest(np.abs(motion))])


def _family_names(family: ShapeFamily) -> tuple[str, ...]:
    count = family.shapes.shape[1]
    return family.names or tuple(f"{family.kind} {i + 1}" for i in range(count))


def _shape_norms(model: FiniteElementModel, shapes: Array) -> Array:
    return np.sqrt(np.einsum("ij,ij->j", shapes, model.mass @ shapes))


def _orthonormalise(
    model: FiniteElementModel, shapes: Array, sizes: Array
) -> tuple[Array, list[int]]:
    """Gram-Schmidt in the metric of the mass, twice for every column.

    Parameters
    ----------
    sizes : (n,) reference size for the independent part of each column
    """
    count = shapes.shape[1]
    basis = np.zeros((len(shapes), count), number_type(shapes, model.mass), order="F")
    momenta = np.zeros_like(basis)
    selected: list[int] = []
    for i in range(count):
        rest = shapes[:, i]
        k = len(selected)
        for _ in range(2):
            rest = rest - basis[:, :k] @ (momenta[:, :k].T @ rest)
        momentum = model.mass @ rest
        square = rest @ momentum
        size = np.sqrt(square if square.real > 0.0 else 0.0)
        if size.real > DEPENDENCE_TOLERANCE * sizes[i].real:
            basis[:, k], momenta[:, k] = rest / size, momentum / size
            selected.append(i)
    return basis[:, : len(selected)], selected


def _share_text(shares: Mapping[str, Array], i: int) -> str:
    if len(shares) == 1:
        return ""
    kind = max(shares, key=lambda name: shares[name][i])
    return f", {100 * shares[kind][i]:.0f} % {kind}"


def _omitted_candidates(
    names: list[str], selected: list[int]
) -> tuple[Diagnostic, ...]:
    left_out = [name for i, name in enumerate(names) if i not in set(selected)]
    if not left_out:
        return ()
    return (diagnose("N164", omitted=len(left_out), count=len(names), names=left_out),)


def point_markers(body: FiniteElementModel, held: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the markers at single points of a plane body or a solid that can move.

    held : (ndof,) degrees of freedom that are clamped in the frame
    """
    if body.dof_table is not None:
        return ()
    return tuple(
        marker.name
        for marker in body.markers
        if marker.gradient is not None and not held[marker.displacement.indices].all()
    )


def point_marker_note(
    body: FiniteElementModel, held: NDArray[np.bool_]
) -> tuple[Diagnostic, ...]:
    """Return N163 on markers whose compliance does not converge."""
    names = point_markers(body, held)
    if not names:
        return ()
    kind, growth = _GROWTH[body.dimension]
    return (diagnose("N163", ", ".join(names), kind=kind, growth=growth),)
