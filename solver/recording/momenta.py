"""Linear and angular momentum of bodies."""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import MOMENTA
from sidtool.formats.sid import Array

from .told import Told


def momentum_column(told: Told, owner: str, quantity: str) -> Array:
    """One of `MOMENTA` of a body, or of all if the owner is empty, (nt,).

    Inertial components [kg m/s]; angular ones about the inertial origin [kg m2/s].
    """
    which, axis = divmod(MOMENTA.index(quantity), 3)
    rows = [told.system.index(owner)] if owner else slice(None)
    values = told.bodies[("momentum", "angular")[which]][:, rows, axis]
    return np.asarray(values.sum(axis=1))
