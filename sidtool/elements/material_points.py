"""Strains and stresses at quadrature points; particles with rotary inertia."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..mesh.materials import AnisotropicMaterial, ElasticMaterial, laws_of_material
from ..mesh.quadratic_fields import LEVI_CIVITA
from .solid_elements import ElementBatch, elasticity

#: Rows of a stress: xx, yy, zz, xy, yz, xz.
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
_PLANE = (0, 1, 3)
_HALF_CURL = sp.csr_matrix(0.5 * np.swapaxes(LEVI_CIVITA, 1, 2).reshape(3, 9))


@dataclass(frozen=True, eq=False)
class Continuum:
    """Elements of one material.

    Attributes
    ----------
    batches : yields the elements at their quadrature points
    law : (3, 3) or (6, 6) elasticity matrix [Pa]
    thickness : of a plane body [m]; 1 in space
    transverse : stress zz of a plane body per unit of xx + yy: Poisson's ratio in
        plane strain, 0 in plane stress
    internal_modes : True if the elements have internal modes
    laws_at : function that returns laws (..., 6, 6) at positions (..., 3) of a material
        with varying axes
    """

    batches: Callable[[], Iterable[ElementBatch]]
    law: Array
    thickness: float = 1.0
    transverse: float = 0.0
    internal_modes: bool = False
    laws_at: Callable[[Array], Array] | None = None


def make_continuum(
    batches: Callable[[], Iterable[ElementBatch]],
    material: ElasticMaterial,
    state: str,
    thickness: float = 1.0,
    *,
    internal_modes: bool = False,
) -> Continuum:
    """Elements of a material; see `elasticity` for the state."""
    law, transverse = elasticity(material, state), 0.0
    if state == "plane_strain" and not isinstance(material, AnisotropicMaterial):
        transverse = material.poissons_ratio
    laws_at = laws_of_material(material)
    return Continuum(batches, law, thickness, transverse, internal_modes, laws_at)


def stress_from_gradient(gradient: Array, law: Array) -> Array:
    """Cauchy stress of linear elasticity as tensors.

    Parameters
    ----------
    gradient : (..., d, d), entry [a, b] is the derivative of u_a by x_b
    law : (3, 3) or (6, 6) [Pa], or (p, 6, 6) of gradients (p, ..., d, d)

    Returns
    -------
    (..., d, d) [Pa]
    """
    d = gradient.shape[-1]
    pairs = [VOIGT[i] for i in _PLANE] if d == 2 else list(VOIGT)
    strain = np.stack(
        [
            gradient[..., a, b] + (gradient[..., b, a] if a != b else 0.0)
            for a, b in pairs
        ],
        axis=-1,
    )
    each = law.ndim == 3
    stress = np.einsum("pij,p...j->p...i", law, strain) if each else strain @ law.T
    tensor = np.empty(gradient.shape, stress.dtype)
    for k, (a, b) in enumerate(pairs):
        tensor[..., a, b] = tensor[..., b, a] = stress[..., k]
    return tensor


def stress_components(stress: Array, transverse: float = 0.0) -> Array:
    """Stress tensors (..., d, d) as (..., 6): xx, yy, zz, xy, yz, xz."""
    d = stress.shape[-1]
    six = np.zeros((*stress.shape[:-2], 6), stress.dtype)
    for k, (a, b) in enumerate(VOIGT):
        if max(a, b) < d:
            six[..., k] = stress[..., a, b]
    if d == 2:
        six[..., 2] = transverse * (six[..., 0] + six[..., 1])
    return six


def half_curl(gradient: sp.csr_matrix) -> sp.csr_matrix:
    """(3, ndof) rows of the rotation, from those of the displacement gradient."""
    return sp.csr_matrix(_HALF_CURL @ gradient)


def stress_rows(
    gradient: sp.csr_matrix, continuum: Continuum, place: Array | None = None
) -> sp.csr_matrix:
    """Return the rows (6, ndof) of the stress xx, yy, zz, xy, yz, xz at a point.

    Parameters
    ----------
    gradient : (9, ndof) rows of the displacement gradient; row 3 a + b is the
        derivative of u_a by x_b
    place : (3,) position of the point, which determines cylindrical material axes [m]
    """
    law = continuum.law
    if continuum.laws_at is not None and place is not None:
        law = continuum.laws_at(place)
    d = 2 if len(law) == 3 else 3
    unit = np.zeros((9, 3, 3))
    unit.reshape(9, 9)[range(9), range(9)] = 1
    effect = stress_components(
        stress_from_gradient(unit[:, :d, :d], law), continuum.transverse
    )
    return sp.csr_matrix(sp.csr_matrix(effect.T) @ gradient)


@dataclass(frozen=True, eq=False)
class InertiaPoints:
    """Rigid particles that move with the degrees of freedom.

    Attributes
    ----------
    positions : (p, 3) in the axes of the model [m]
    masses : (p,) [kg]
    inertias : (p, 3, 3) about the particles themselves, axes of the model [kg m^2]
    displacement : (3 p, ndof) sparse; displacements of the particles = rows @ u
    rotation : (3 p, ndof) sparse; their small rotations = rows @ u
    arms : (p, 3) to the particles from points that they are fixed to and turn with,
        whose displacements are linear in the degrees of freedom [m]; None for zero
    tangents : (p, 3) of the beams whose cross-sections hold the arms, else zero
    """

    positions: Array
    masses: Array
    inertias: Array
    displacement: sp.csr_matrix
    rotation: sp.csr_matrix
    arms: Array | None = None
    tangents: Array | None = None

    def selected(self, mask: NDArray[np.bool_]) -> InertiaPoints:
        """Return the particles of a mask (p,)."""
        rows = np.repeat(mask, 3)
        return InertiaPoints(
            self.positions[mask],
            self.masses[mask],
            self.inertias[mask],
            self.displacement[rows],
            self.rotation[rows],
            None if self.arms is None else self.arms[mask],
            None if self.tangents is None else self.tangents[mask],
        )

    def mass_matrix(self) -> sp.csr_matrix:
        """(ndof, ndof) their share of the mass matrix."""
        weights = sp.diags_array(np.repeat(self.masses, 3))
        count = len(self.masses)
        tensors = sp.bsr_matrix(
            (self.inertias, np.arange(count), np.arange(count + 1)),
            shape=(3 * count, 3 * count),
        ).tocsr()
        moved = self.displacement.T @ weights @ self.displacement
        return sp.csr_matrix(moved + self.rotation.T @ tensors @ self.rotation)


@dataclass(frozen=True, eq=False)
class BarEnds:
    """Ends of bars at nodes where directions of bars may differ.

    Attributes
    ----------
    arms : (m, 3) rigid ones from the nodes [m]
    tangents : (m, 3) of the bars
    forces, moments : (3 m, ndof) sparse; on the ends of the bars = rows @ u [N], [N m]
    node_rotation, rotation : (3 m, ndof) sparse; small rotations of the nodes, and of
        the ends, which pins may release
    """

    arms: Array
    tangents: Array
    forces: sp.csr_matrix
    moments: sp.csr_matrix
    node_rotation: sp.csr_matrix
    rotation: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class BeamMaterial:
    """Points on the axes of beams, in the axes of the section there.

    Attributes
    ----------
    weights : (p,) length of each point [m]
    strains : (6 p, ndof) sparse; stretch, shears xy and xz, twist and curvatures about
        y and z of every point = rows @ u
    turns : (3 p, ndof) sparse; rotation of the cross-section
    resultants : (6 p, ndof) sparse; N, Qy, Qz [N], T, My, Mz [N m]
    stress_moments : (p, 3, 3) integrals of yy, yz, zz over the section times the axial
        stress of N = 1 [m^2], of My = 1 and of Mz = 1 [m]
    curvatures : (p, 3) of the beam at rest: twist, about y and z [rad/m]
    """

    weights: Array
    strains: sp.csr_matrix
    turns: sp.csr_matrix
    resultants: sp.csr_matrix
    stress_moments: Array
    curvatures: Array

    def strains_of(self, fields: Array) -> Array:
        """(p, 6, n) of displacements (ndof, n)."""
        return self._by_point(self.strains @ fields)

    def turns_of(self, fields: Array) -> Array:
        """(p, 3, n) of displacements (ndof, n)."""
        return self._by_point(self.turns @ fields)

    def resultants_of(self, fields: Array) -> Array:
        """(p, 6, n) of displacements (ndof, n)."""
        return self._by_point(self.resultants @ fields)

    def _by_point(self, rows: Array) -> Array:
        return rows.reshape(len(self.weights), -1, rows.shape[1])
