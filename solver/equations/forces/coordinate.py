"""COORDINATE: an elastic coordinate, which may be a state of a law."""

from __future__ import annotations

from ...compiler.compiling import inner
from .law import force_law


@inner()
def evaluate(system, work, k, z, v):
    """Keeps the measure; adds the force on it to f."""
    row = system.force[k]
    body = system.body[row.b]
    i = body.vel + body.rd + row.data
    g, rate = z[body.pos + body.np - body.nq + row.data], v[i]
    work.measure[k, 0], work.measure[k, 1] = g, rate
    if row.owner < 0:
        size, _, _ = force_law(system, work, k, g, rate)
        work.f[i] += size


@inner()
def linearise(system, work, k):
    """The row of the force, or of the measure in that of a law."""
    row = system.force[k]
    if row.seg_b < 0:
        return
    at = row.seg_b + system.body[row.b].rd + row.data
    g, rate = work.measure[k, 0], work.measure[k, 1]
    _, stiffness, damping = force_law(system, work, k, g, rate)
    work.C[at] = 1.0 if row.owner < 0 else 0.0
    work.Gp[at], work.Gv[at] = stiffness, damping
