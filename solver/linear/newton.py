"""Newton's matrix of the index-1 equations.

A force between two bodies would couple their blocks of the Newton matrix. It gets a row
among the constraints instead, with its change phi as unknown beside the multipliers:
with s the direction of the force in the generalised coordinates, and its stiffness k
and damping d,

    R' - s phi = 0,    (d s + k s (mu - E)^-1) . dz_II + phi = ...,

so that such a row has d s and k s as Gv and Gp, and 1 on the diagonal of the Schur
complement.
"""

from __future__ import annotations

from numba import complex128, float64, types

from ..compiler.compiling import entry, inner
from ..compiler.lanes import row_times
from ..space.coordinates import add_row_response, lift, resolve, respond
from ..space.layout import (
    C1,
    F1,
    R_NEWTON,
    SYSTEM,
    WORK,
)
from .grips import sticks
from .mass import mass_row_times
from .memory import (
    FACTOR_COMPLEX,
    FACTOR_REAL,
    MEMORY,
    REMEMBER,
    SOLVE_COMPLEX,
    SOLVE_REAL,
)
from .saddle import saddle_factor, saddle_solve


@entry(REMEMBER)
def remember(system, work, memory):
    """Keeps M, C and the frames of the state that was just linearised."""
    for i in range(len(work.M)):
        memory.M[i] = work.M[i]
    for i in range(len(work.C)):
        memory.C[i] = work.C[i]
    for i in range(work.frame.shape[0]):
        for k in range(work.frame.shape[1]):
            memory.frame[i, k] = work.frame[i, k]


@inner(
    *[
        types.void(SYSTEM, WORK, MEMORY, float64, F1, F1),
        types.void(SYSTEM, WORK, MEMORY, complex128, C1, C1),
    ]
)
def newton_matrix(system, work, memory, mu, A, G):
    """Blocks of mu - J of the index-1 equations, J their Jacobian, in saddle form.

    With dz_I = (mu - E)^-1 (r_I + dz_II) inserted, what is left for dz_II is
    A = mu M + Rv + Rp (mu - E)^-1 and G = mu C + Gv + Gp (mu - E)^-1, without mu C
    in the rows of forces and of friction.
    """
    for i in range(len(A)):
        A[i] = mu * memory.M[i] + work.Rv[i]
    for i in range(len(G)):
        G[i] = work.Gv[i]
    for i in range(system.n_entries):
        G[i] += mu * memory.C[i]
    stuck = system.sliding.segment
    for k in range(len(stuck)):
        if sticks(system, stuck[k].row):
            at = stuck[k].offset
            for i in range(at, at + system.body[stuck[k].body].nv):
                G[i] += mu * memory.C[i]
    for b in range(len(system.body)):
        n, o = system.body[b].nv, system.body[b].block
        for k in range(n):
            at = o + k * n
            add_row_response(system, memory.frame, b, mu, work.Rp, at, A, at)
    for s in range(len(system.segment)):
        b, at = system.segment[s].body, system.segment[s].offset
        add_row_response(system, memory.frame, b, mu, work.Gp, at, G, at)


@entry(FACTOR_REAL, FACTOR_COMPLEX)
def newton_factor(system, work, memory, factors, k, mu):
    """Factors mu - J into system k of `factors`; see `newton_matrix`."""
    newton_matrix(system.newton, work, memory, mu, factors.A[k], factors.G[k])
    memory.factorisations += 1
    return saddle_factor(system.newton, factors, k, memory.C, work.rubbing)


@entry(SOLVE_REAL, SOLVE_COMPLEX)
def newton_solve(system, work, memory, factors, k, mu, r, s):
    """Solves (mu - J) (dz_I, dz_II) = (r, s) in place, with system k of `factors`."""
    x, p, g = factors.x, factors.p, factors.g
    system = system.newton
    resolve(system, memory.frame, mu, r, x)
    respond(system, memory.frame, mu, x)
    for i in range(len(g)):
        g[i] = 0.0
    for n in range(len(system.segment)):
        row, at = system.segment[n].row, system.segment[n].offset
        b = system.segment[n].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            g[row] -= work.Gp[at + i] * x[first + i]
            if at < system.n_entries:
                g[row] += memory.C[at + i] * s[first + i]
    stuck = system.sliding.segment
    for n in range(len(stuck)):
        j, at, b = stuck[n].row, stuck[n].offset, stuck[n].body
        if sticks(system, j):
            row, first = system.friction[j, R_NEWTON], system.body[b].vel
            for i in range(system.body[b].nv):
                g[row] += memory.C[at + i] * s[first + i]
    for b in range(len(system.body)):
        n, o, first = system.body[b].nv, system.body[b].block, system.body[b].vel
        for i in range(n):
            p[first + i] = mass_row_times(system, memory.M, b, i, s)
            p[first + i] -= row_times(work.Rp, o + i * n, x, first, n)
    saddle_solve(system, factors, k, p, g)
    resolve(system, memory.frame, mu, r, x)
    for i in range(len(s)):
        s[i] = p[i]
        x[i] += p[i]
    respond(system, memory.frame, mu, x)
    lift(system, memory.frame, mu, x, r, r)
