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
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

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
                self.space.stiffness.tocsr(),
                self.space.mass.tocsr(),
                self.space.constraints,
                values,
                vectors,
                self.space.places,
            )
        return self._derivatives[count]

    def _whole_clusters(self, count: int, soon: int) -> tuple[Array, Array]:
        """Return modes until the next one has another frequency."""
        space = self.space
        rows, skipped = len(space.constraints), space.rigid.shape[1]
        available = space.stiffness.shape[0] - rows - skipped
        while count and count < available:
            values, _ = space.modes(count + 1, soon)
            if len(clusters(values[-2:])) > 1:
                break
            count += 1
        return space.modes(count)  # of the last solution, as all later requests


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
        matrices = (self.stiffness.tocsr(), self.mass.tocsr(), self.constraints)
        if not any(map(np.iscomplexobj, matrices)):
            return pairs.values[:count], self.displacements(pairs.vectors[:, :count])
        steps = tuple(matrix.imag for matrix in matrices)
        slopes, changes = pairs.by(*steps)
        if pairs.is_mixed(count, *steps[:2]):
            raise InputError(
                f"mixes mode {count} with one of the same frequency that is left out",
                place="reduction.modes",
                expected=f"{len(pairs.values)} modes",
            )
        moved = (pairs.vectors + 1j * changes)[:, :count]
        return (pairs.values + 1j * slopes)[:count], self.displacements(moved)


class _FactorsWithStep(PinnedFactors):
    """Factors of K that solve for K + i dK to first order."""

    def __init__(self, nominal: PinnedFactors, change: sp.csr_matrix | None) -> None:
        self._nominal, self._change = nominal, change

    def solve(self, load: Numbers) -> Numbers:
        found = self._nominal.solve(load.real)
        rest: Numbers | None = load.imag if np.iscomplexobj(load) else None
        if self._change is not None:
            rest = (0.0 if rest is None else rest) - self._change @ found
        return found if rest is None else found + 1j * self._nominal.solve(rest)


def complex_step_space(
    body: FiniteElementModel,
    frame: Frame,
    fixed: tuple[str, ...],
    nominal: NominalSpaces,
) -> ComplexStepSpace:
    """Return the space of a body with or without a step, as `constrained_space` does.

    Its modes are those of the nominal spaces, so that both have the same.
    """
    plain = nominal.get(fixed)
    held = clamped_dofs(body, frame, fixed)
    parts = reduced_matrices(body, held, frame)
    parts |= {name: parts[name].tocsr() for name in ("stiffness", "mass")}
    change = None
    if np.iscomplexobj(parts["stiffness"]):
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
