"""How much the second-order displacements of stiffened bodies change their inertia.

With the change of the stiffness by loads (`stiffening`) this is all that geometric
stiffening does to a motion, up to terms of third order: by parts, what couples rates of
deformations with the motion of the frame is a load of its accelerations.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sidtool.formats.sid import SID, Array

from ..recording.sampling import Samples
from ..space import layout as at
from ..system.bodies.packing import symmetric
from ..system.kernel_calls import evaluate
from ..system.scene import System
from ..system.storage import new_work

#: Deformations that move less than this part of the largest moved mass move none.
MASSLESS = 1e-12


def is_stiffened(system: System, b: int) -> bool:
    """Does the body move by the inertia of stiffened bodies (theory, section 12)?"""
    return bool(system.arrays.body[b, at.FLAGS] & at.STIFFENED)


def new_maxima(q: Array, largest: Array) -> Array:
    """Rows of q (nt, nq) where a coordinate is larger than all before, `largest`."""
    sizes = np.nan_to_num(np.abs(q))
    rows = sizes.argmax(axis=0)
    return np.unique(rows[sizes.max(axis=0) > largest])


def changes_of_inertia(
    system: System, rows: Mapping[str, Array], samples: Samples, times: Array
) -> dict[str, float]:
    """Largest change of the kinetic energy of each body, over all elastic velocities.

    The eigenvalue of (Mee(q) - Me, Me) that is largest in magnitude, where Mee is the
    elastic block of the mass matrix in some states.

    rows : states to look at, by body
    """
    found = dict.fromkeys(rows, 0.0)
    states = set[int]().union(*(states.tolist() for states in rows.values()))
    if not states:
        return found
    work = new_work(system)
    bodies = {name: system.index(name) for name in rows if len(rows[name])}
    bases = {name: _basis(system.bodies[b].sid) for name, b in bodies.items()}
    for k in sorted(states):
        evaluate(system, work, float(times[k]), samples.z[k], samples.v[k])
        for name, b in bodies.items():
            if k in rows[name]:
                change = _elastic_block(system, work.M, b)
                change = change - symmetric(system.bodies[b].sid.Me.m0)
                share = _largest(bases[name].T @ change @ bases[name])
                found[name] = max(found[name], share)
    return found


def _basis(sid: SID) -> Array:
    """(nq, n) rates of deformations of kinetic energy 1/2 each."""
    values, vectors = np.linalg.eigh(symmetric(sid.Me.m0))
    kept = values > MASSLESS * values.max(initial=0.0)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))


def _elastic_block(system: System, M: Array, b: int) -> Array:
    row = system.arrays.body[b]
    n, first, rigid = int(row[at.NV]), int(row[at.BLOCK]), int(row[at.RD])
    return symmetric(M[first : first + n * n].reshape(n, n)[rigid:, rigid:])


def _largest(matrix: Array) -> float:
    if not np.isfinite(matrix).all():
        return np.inf
    return float(np.abs(np.linalg.eigvalsh(matrix)).max(initial=0.0))
