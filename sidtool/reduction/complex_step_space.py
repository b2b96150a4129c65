"""Admissible displacements of a body that carries an imaginary step.

Reduction methods run on it as on any space. What they ask for is computed from the
factors and modes of the body without the step: static answers by

    (K + i dK)^-1 (f + i df) = u + i K^-1 (df - dK u),   u = K^-1 f,

to first order, modes by Nelson's method, see `eigensolvers.eigenpair_derivatives`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import Numbers
from sidtool.formats.base.taylor import Array

from ..eigensolvers.eigenpair_derivatives import EigenpairDerivatives, clusters
from ..elements.finite_element_model import FiniteElementModel
from .admissible_space import (
    AdmissibleSpace,
    PinnedFactors,
    coordinates_of,
    reduced_matrices,
    space_without_conditions,
    support_rows,
)
from .body_frames import Frame, clamped_dofs


class NominalSpace:
    """A space of the body without a step, with what serves for every variable."""

    def __init__(self, space: AdmissibleSpace) -> None:
        self.space = space
        self._with_constraints: dict[bytes, NominalSpace] = {}
        self._derivatives: dict[int, EigenpairDerivatives] = {}

    def with_constraints(self, rows: Array) -> NominalSpace:
        """Return the space with further conditions, the same one for the same rows."""
        key = rows.tobytes()
        if key not in self._with_constraints:
            found = NominalSpace(self.space.with_constraints(rows))
            self._with_constraints[key] = found
        return self._with_constraints[key]

    def derivatives(self, count: int, soon: int = 0) -> EigenpairDerivatives:
        """Return the derivatives of the lowest modes, whole clusters of them."""
        if count not in self._derivatives:
            values, shapes = self._whole_clusters(count, soon)
            vectors = coordinates_of(self.space.transform, shapes)
            self._derivatives[count] = EigenpairDerivatives(
                self.space.stiffness,
                self.space.mass,
                self.space.constraints,
                values,
                vectors,
                self.space.places,
            )
        return self._derivatives[count]

    def _whole_clusters(self, count: int, soon: int) -> tuple[Array, Array]:
        """Return modes until the next one has another frequency."""
        space = self.space
        values, shapes = space.modes(count, soon)
        rows, skipped = len(space.constraints), space.rigid.shape[1]
        available = space.stiffness.shape[0] - rows - skipped
        while count and count < available:
            more, wider = space.modes(count + 1, soon)
            if len(clusters(more[-2:])) > 1:
                break
            count, values, shapes = count + 1, more, wider
        return values, shapes


class NominalSpaces:
    """The spaces of a body without a step, by its supports."""

    def __init__(self, body: FiniteElementModel, frame: Frame) -> None:
        self.body, self.frame = body, frame
        self._spaces: dict[tuple[str, ...], NominalSpace] = {}

    def get(self, fixed: tuple[str, ...]) -> NominalSpace:
        """Return the space of the clamped body without further conditions."""
        if fixed not in self._spaces:
            held = clamped_dofs(self.body, self.frame, fixed)
            space = space_without_conditions(self.body, held, self.frame)
            self._spaces[fixed] = NominalSpace(space)
        return self._spaces[fixed]

    def constrained(self, fixed: tuple[str, ...]) -> AdmissibleSpace:
        """Return the space with all conditions, as `constrained_space` does."""
        rows = support_rows(self.body, self.frame, fixed)
        space = self.get(fixed)
        return space.space if rows is None else space.with_constraints(rows).space


@dataclass(frozen=True, eq=False)
class ComplexStepSpace(AdmissibleSpace):
    """A space with a step, and the one without it."""

    nominal: NominalSpace = field(kw_only=True)

    def effective_loads(self, loads: Numbers) -> NDArray[np.bool_]:
        return self.nominal.space.effective_loads(loads.real)

    def with_constraints(self, rows: Numbers) -> ComplexStepSpace:
        changed = super().with_constraints(rows)
        assert isinstance(changed, ComplexStepSpace)
        return replace(changed, nominal=self.nominal.with_constraints(rows.real))

    def modes(self, count: int, soon: int = 0) -> tuple[Numbers, Numbers]:
        if count == 0:
            return super().modes(count, soon)
        pairs = self.nominal.derivatives(count, soon)
        steps = (self.stiffness.imag, self.mass.imag, self.constraints.imag)
        slopes, changes = pairs.by(*steps)
        moved = (pairs.vectors + 1j * changes)[:, :count]
        return (pairs.values + 1j * slopes)[:count], self.displacements(moved)


class _FactorsWithStep(PinnedFactors):
    """Factors of K that solve for K + i dK to first order."""

    def __init__(self, nominal: PinnedFactors, change: sp.csr_matrix) -> None:
        self._nominal, self._change = nominal, change

    def solve(self, load: Numbers) -> Numbers:
        found = self._nominal.solve(load.real)
        return found + 1j * self._nominal.solve(load.imag - self._change @ found)


def complex_step_space(
    body: FiniteElementModel,
    frame: Frame,
    fixed: tuple[str, ...],
    nominal: NominalSpaces,
) -> ComplexStepSpace:
    """Return the space of a body that carries a step, as `constrained_space` does."""
    plain = nominal.get(fixed)
    held = clamped_dofs(body, frame, fixed)
    parts = reduced_matrices(body, held, frame)
    change = sp.csr_matrix(parts["stiffness"].imag)
    space = ComplexStepSpace(
        **parts,
        shift=plain.space.shift,
        places=plain.space.places,
        factors=_FactorsWithStep(plain.space.factors, change),
        nominal=plain,
    )
    rows = support_rows(body, frame, fixed)
    return space if rows is None else space.with_constraints(rows)
