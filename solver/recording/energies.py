"""Energies of a scene at recorded states, and the powers that change their sum.

Kinetic energy of a body: eq. (12). The equations of first order keep this energy up to
terms of their own order; with `quadratic_inertia` they keep it exactly, as bodies with
geometric stiffening do theirs.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import SID, Array

from ..integrators.recording import RUB_FORCE, RUB_RATE
from ..space import layout as at
from ..system.bodies.first_order import cubic_energies
from ..system.bodies.packing import symmetric
from ..system.scene import System
from .sampling import Samples
from .told import Told


def kinetic(told: Told) -> Array:
    """Kinetic energy of all bodies, (nt,) [J]."""
    return np.asarray(told.bodies["kinetic"].sum(axis=1))


def elastic(told: Told) -> Array:
    """Energy of deformation of all bodies, (nt,) [J]."""
    return np.asarray(told.bodies["elastic"].sum(axis=1))


def potential(told: Told) -> Array:
    """Energy of gravity (zero at the origin) and of springs, (nt,) [J]."""
    springs = told.forces["stored"].sum(axis=1)
    return np.asarray(told.bodies["weight"].sum(axis=1) + springs)


def dissipation(told: Told) -> Array:
    """Power lost in the damping of bodies, in dampers and by friction, (nt,) [W]."""
    rub = told.samples.friction
    rubbed = np.sum(rub[:, :, RUB_FORCE] * rub[:, :, RUB_RATE], axis=1)
    lost = told.bodies["lost"].sum(axis=1) + told.forces["lost"].sum(axis=1)
    return np.asarray(lost - rubbed)


def supply(told: Told) -> Array:
    """Power of drives, and of forces that are functions of time or laws, (nt,) [W]."""
    return np.asarray(told.forces["given"].sum(axis=1) + told.driven)


def deformation_energies(sid: SID, x: Array, size: float = 1.0) -> Array:
    """Energy of deformation at q = size x over size^2, by coordinates, (nt, nq) [J].

    Without that of the reference stress (ksigma), which is no deformation's.
    """
    return 0.5 * x * (x @ symmetric(sid.Ke.m0)) + size * cubic_energies(sid, x)


def elastic_state(system: System, samples: Samples, b: int) -> tuple[Array, Array]:
    """Elastic coordinates and their velocities of a body, (nt, nq)."""
    row = system.arrays.body[b]
    p, u = int(row[at.POS] + row[at.NP]), int(row[at.VEL] + row[at.NV])
    nq = int(row[at.NQ])
    return samples.z[:, p - nq : p], samples.v[:, u - nq : u]
