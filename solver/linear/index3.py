"""Newton's matrix of eq. (3) with the constraints themselves (index 3).

With dx a variation of z_I in the tangent space, dz_II = gamma' dx and
dz_II' = beta' dx, one correction solves, with s = h^2 dlambda,

    [ h^2 (beta' M + gamma' Rv + Rp)  -C^T ] [ dx ]   [ h^2 (f + C^T lambda - R) ]
    [ C                                 0  ] [ s  ] = [ -c                       ],

R = M z_II'.

Friction of joints has rows among the constraints, and forces among the unknowns: what
sticks is a constraint, of what slides the force obeys eq. (32).

The scaling by h^2 keeps the matrix well conditioned for small steps (C. L. Bottasso,
O. A. Bauchau, A. Cardona, "Time-step-size-independent conditioning and sensitivity to
perturbations in the numerical solution of index three differential algebraic
equations", SIAM Journal on Scientific Computing 29, 2007). Forces between bodies have
rows among the constraints, as in `newton`; `place` is the row of each constraint there,
or -1.
"""

from __future__ import annotations

from numba import float64, int64, types

from ..compiler.compiling import inner
from ..space.layout import (
    C_VALUE,
    F1,
    I1,
    SYSTEM,
    WORK,
)
from .friction import friction_residual
from .grips import sticks
from .mass import mass_row_times
from .memory import MEMORY
from .saddle import saddle_factor


@inner(int64(SYSTEM, WORK, MEMORY, float64, float64, float64))
def index3_factor(system, work, memory, inertia, damping, stiffness):
    """Factors the matrix; weights are h^2 beta', h^2 gamma' and h^2. 0 on success."""
    A, G = memory.real.A[0], memory.real.G[0]
    for i in range(len(A)):
        A[i] = inertia * memory.M[i] + damping * work.Rv[i] + stiffness * work.Rp[i]
    constraints = system.n_entries
    for i in range(constraints):
        G[i] = memory.C[i]
    for i in range(constraints, len(G)):
        G[i] = damping * work.Gv[i] + stiffness * work.Gp[i]
    stuck = system.sliding.segment
    for k in range(len(stuck)):
        if sticks(system, stuck[k].row):
            at = stuck[k].offset
            for i in range(at, at + system.body[stuck[k].body].nv):
                G[i] = memory.C[i]
    memory.factorisations += 1
    return saddle_factor(system.newton, memory.real, 0, memory.C, work.rubbing)


@inner(types.void(SYSTEM, F1, F1, float64, F1))
def add_mass_times(system, M, x, weight, out):
    """out += weight M x, M in blocks."""
    for b in range(len(system.body)):
        n, first = system.body[b].nv, system.body[b].vel
        for i in range(n):
            out[first + i] += weight * mass_row_times(system, M, b, i, x)


@inner(types.void(SYSTEM, WORK, I1, F1, F1, float64, F1, F1))
def index3_residual(system, work, place, acceleration, multiplier, h2, p, g):
    """Right-hand side of a correction at the evaluated state, into p and g.

    place, multiplier : of constraints, and behind them of joints with friction
    """
    for i in range(len(p)):
        p[i] = h2 * work.f[i]
    add_mass_times(system, work.M, acceleration, -h2, p)
    for k in range(len(system.segment)):
        force = h2 * multiplier[system.segment[k].row]
        at, b = system.segment[k].offset, system.segment[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            p[first + i] += work.C[at + i] * force
    for i in range(len(g)):
        g[i] = 0.0
    for i in range(system.n_rows):
        if place[i] >= 0:
            g[place[i]] = -work.row[i, C_VALUE]
    if len(system.friction) > 0:
        friction_residual(system, work, multiplier, h2, p, g)
