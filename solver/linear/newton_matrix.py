"""Newton matrices of the index-1 and index-3 equations, in saddle-point form.

A force between two bodies would couple their blocks of the Newton matrix. Instead it
gets a row among the constraints, with the change of the force as unknown.
"""

from ..compiler.inner_kernels import row_dot
from ..compiler.kernels import entry, inner
from ..compiler.types import complex128, float64, int64, void
from ..spatial.coordinates import (
    add_row_shifted_inverse,
    apply_shifted_inverse,
    rhs_to_tangent,
    tangent_to_coordinates,
)
from ..spatial.system_arrays import (
    C1,
    C_VALUE,
    F1,
    I1,
    R_NEWTON,
    SYSTEM,
    WORK,
    is_sticking,
)
from .factor_storage import (
    FACTOR_COMPLEX,
    FACTOR_REAL,
    MEMORY,
    SOLVE_COMPLEX,
    SOLVE_REAL,
    STORE_LINEARISATION,
)
from .joint_friction import friction_residual
from .mass_matrix import mass_row_product
from .saddle_point import saddle_factor, saddle_solve


@entry(STORE_LINEARISATION)
def store_linearisation(system, work, memory):
    """Store M, C and the frames of the state that was just linearised."""
    for i in range(len(work.M)):
        memory.M[i] = work.M[i]
    for i in range(len(work.C)):
        memory.C[i] = work.C[i]
    for i in range(work.frame.shape[0]):
        for k in range(work.frame.shape[1]):
            memory.frame[i, k] = work.frame[i, k]


@inner(
    *[
        void(SYSTEM, WORK, MEMORY, float64, F1, F1),
        void(SYSTEM, WORK, MEMORY, complex128, C1, C1),
    ]
)
def newton_matrix(system, work, memory, mu, A, G):
    """Blocks of mu - J of the index-1 equations in saddle form; J is their Jacobian.

    With dz_I = (mu - E)^-1 (r_I + dz_II) inserted, the system for dz_II has A = mu M +
    Rv + Rp (mu - E)^-1 and G = mu C + Gv + Gp (mu - E)^-1, without mu C in the rows of
    forces and of friction.
    """
    for i in range(len(A)):
        A[i] = mu * memory.M[i] + work.Rv[i]
    for i in range(len(G)):
        G[i] = work.Gv[i]
    for i in range(system.n_entries):
        G[i] += mu * memory.C[i]
    sticking = system.friction_subsystem.segment
    for k in range(len(sticking)):
        if is_sticking(system, sticking[k].row):
            at = sticking[k].offset
            for i in range(at, at + system.body[sticking[k].body].nv):
                G[i] += mu * memory.C[i]
    for b in range(len(system.body)):
        n, o = system.body[b].nv, system.body[b].block
        for k in range(n):
            at = o + k * n
            add_row_shifted_inverse(system, memory.frame, b, mu, work.Rp, at, A, at)
    for s in range(len(system.segment)):
        b, at = system.segment[s].body, system.segment[s].offset
        add_row_shifted_inverse(system, memory.frame, b, mu, work.Gp, at, G, at)


@entry(FACTOR_REAL, FACTOR_COMPLEX)
def newton_factor(system, work, memory, factors, k, mu):
    """Factors mu - J into system k of `factors`; see `newton_matrix`."""
    newton_matrix(system.newton_subsystem, work, memory, mu, factors.A[k], factors.G[k])
    memory.factorisations += 1
    return saddle_factor(
        system.newton_subsystem, factors, k, memory.C, work.friction_limit_derivative
    )


@entry(SOLVE_REAL, SOLVE_COMPLEX)
def newton_solve(system, work, memory, factors, k, mu, r, s):
    """Solve (mu - J) (dz_I, dz_II) = (r, s) in place, with system k of `factors`."""
    x, p, g = factors.x, factors.p, factors.g
    system = system.newton_subsystem
    rhs_to_tangent(system, memory.frame, mu, r, x)
    apply_shifted_inverse(system, memory.frame, mu, x)
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
    sticking = system.friction_subsystem.segment
    for n in range(len(sticking)):
        j, at, b = sticking[n].row, sticking[n].offset, sticking[n].body
        if is_sticking(system, j):
            row, first = system.friction[j, R_NEWTON], system.body[b].vel
            for i in range(system.body[b].nv):
                g[row] += memory.C[at + i] * s[first + i]
    for b in range(len(system.body)):
        n, o, first = system.body[b].nv, system.body[b].block, system.body[b].vel
        for i in range(n):
            p[first + i] = mass_row_product(system, memory.M, b, i, s)
            p[first + i] -= row_dot(work.Rp, o + i * n, x, first, n)
    saddle_solve(system, factors, k, p, g)
    rhs_to_tangent(system, memory.frame, mu, r, x)
    for i in range(len(s)):
        s[i] = p[i]
        x[i] += p[i]
    apply_shifted_inverse(system, memory.frame, mu, x)
    tangent_to_coordinates(system, memory.frame, mu, x, r, r)


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
    sticking = system.friction_subsystem.segment
    for k in range(len(sticking)):
        if is_sticking(system, sticking[k].row):
            at = sticking[k].offset
            for i in range(at, at + system.body[sticking[k].body].nv):
                G[i] = memory.C[i]
    memory.factorisations += 1
    return saddle_factor(
        system.newton_subsystem,
        memory.real,
        0,
        memory.C,
        work.friction_limit_derivative,
    )


@inner(void(SYSTEM, F1, F1, float64, F1))
def add_mass_product(system, M, x, weight, out):
    """out += weight M x, M in blocks."""
    for b in range(len(system.body)):
        n, first = system.body[b].nv, system.body[b].vel
        for i in range(n):
            out[first + i] += weight * mass_row_product(system, M, b, i, x)


@inner(void(SYSTEM, WORK, I1, F1, F1, float64, F1, F1))
def index3_residual(system, work, newton_rows, acceleration, multiplier, h2, p, g):
    """Right-hand side of a correction at the evaluated state, into p and g.

    Parameters
    ----------
    newton_rows, multiplier
        Of constraints, followed by those of joints with friction.
    """
    for i in range(len(p)):
        p[i] = h2 * work.f[i]
    add_mass_product(system, work.M, acceleration, -h2, p)
    for k in range(len(system.segment)):
        force = h2 * multiplier[system.segment[k].row]
        at, b = system.segment[k].offset, system.segment[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            p[first + i] += work.C[at + i] * force
    for i in range(len(g)):
        g[i] = 0.0
    for i in range(system.n_rows):
        if newton_rows[i] >= 0:
            g[newton_rows[i]] = -work.row[i, C_VALUE]
    if len(system.friction) > 0:
        friction_residual(system, work, multiplier, h2, p, g)
