"""Places of nodes that are known to a few digits, from a stiffness known to more."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...reduction.eigen import symmetric_factors
from ..elements.quadratic_fields import softest_deformation
from ..finite_element_model import FiniteElementModel

Array = NDArray[np.float64]

#: What is left of deformations, unless they may come from the last digits of the
#: stiffness, as below this share of the largest eigenvalue.
_SHARE, _DIGITS = 1e-3, 1e-7
#: Rounds go on until that eigenvalue stays within this share.
_STEADY, _ROUNDS = 0.01, 8


def refined(positions: Array, stiffness: sp.csr_matrix, mass: sp.csr_matrix) -> Array:
    """(n, 3) positions whose rotations the stiffness does not resist.

    A rotation about an axis is a displacement field that the positions give. Rounded
    positions deform the body; of the fields near them, those of the least energy are
    rigid: the solution x of (K + s M) x = s M x0 loses the part of x0 whose Rayleigh
    quotient is far above s.
    """
    centre = positions.mean(axis=0)
    places = positions - centre
    largest = float((stiffness.diagonal() / mass.diagonal()).max())
    before = np.inf
    for _ in range(_ROUNDS):
        body = FiniteElementModel(places, None, stiffness, {}, ())
        first, _ = softest_deformation(stiffness, mass, places, body.table)
        if abs(first - before) < _STEADY * before:
            break
        before = first
        shift = max(_SHARE * abs(first), _DIGITS * largest)
        where = np.repeat(places, 3, axis=0)
        factors = symmetric_factors(stiffness + shift * mass, where)
        rigid = body.rigid_body_modes()
        turns = factors.solve(np.ascontiguousarray(shift * (mass @ rigid[:, 3:])))
        about = turns.reshape(-1, 3, 3)
        places = np.column_stack(
            [(about[:, b, c] - about[:, c, b]) / 2 for b, c in ((1, 2), (2, 0), (0, 1))]
        )
    return places + centre
