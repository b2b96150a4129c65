"""Loads that make friction: determined by the motion, or refused by name."""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError

from ..space import layout as at
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes
from .consistent import Start, State, names_of_rows
from .overconstraint import complete

#: Constraints that follow from others but for the rounding of data, and the part of a
#: load that such rounding may have.
DEPENDENT, SHARE = 1e-6, 1e-6


def check_loads(system: System, start: Start) -> None:
    """Refuses friction whose load, or whose coordinate, the joints do not leave open.

    Raises
    ------
    InputError : the load of a joint is statically indeterminate; a joint with friction
        cannot move.
    """
    if not system.rubbing:
        return
    state = State(complete(system), start)
    sizes = row_sizes(system)
    C = state.jacobian() * coordinate_sizes(system) / sizes[:, None]
    left, values, right = np.linalg.svd(C, full_matrices=True)
    rank = int(np.sum(values > DEPENDENT * max(1.0, values.max(initial=0.0))))
    shared, free = left[:, rank:], right[rank:]
    arrays, rates = system.arrays, coordinate_sizes(system) * free
    for j, rub in enumerate(system.rubbing):
        along = np.zeros(system.n_velocities)
        for row, b, offset in arrays.sliding.segment:
            if row == j:
                n, u = arrays.body[b, at.NV], arrays.body[b, at.VEL]
                along[u : u + n] += state.work.C[offset : offset + n]
        largest = np.abs(along * coordinate_sizes(system)).max(initial=0.0)
        if np.abs(rates @ along).max(initial=0.0) <= DEPENDENT * largest:
            raise InputError(
                f"{rub.joint} has friction, but other joints or drives keep it from "
                "moving of its own",
                place=f"joints.{rub.joint}.friction",
                expected="a joint that can slide, or no friction",
            )
        open_ = rub.weights.reshape(-1, len(rub.rows)) / sizes[list(rub.rows)]
        loads = open_ @ shared[list(rub.rows)]
        scale = np.abs(open_).max()
        if np.abs(loads).max(initial=0.0) > SHARE * scale:
            involved = np.abs(shared).max(axis=1) > SHARE
            rows = tuple(int(i) for i in np.flatnonzero(involved))
            names = ", ".join(dict.fromkeys(names_of_rows(system, rows)))
            raise InputError(
                f"the load of {rub.joint} is statically indeterminate, so that its "
                f"friction is not known: {names} share it in any proportion",
                place=f"joints.{rub.joint}.friction",
                expected="joints without redundant constraints, or a force of type "
                "friction, which has a limit of its own",
            )
