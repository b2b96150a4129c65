"""Inertia of bodies with geometric stiffening, theory, section 12.

Deformation rotates a body on average by theta about its centre of mass. In the mean
axes that are rotated so, the inertia of a stiffened body is evaluated.

===========  =================================================
Symbol       Meaning
===========  =================================================
theta        mean rotation by deformation, linear in q
omega_m      angular velocity of the mean axes
H            central moment of inertia in the mean axes
u, Hu        relative angular velocity and its momentum
D            coupling of the mean rotation with q'
mu1          mass times displacement of the centre of mass
Ct_qdot      momentum of the deformation
===========  =================================================
"""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import (
    add_column,
    add_row,
    add_symmetric,
    cross,
    d_from_rotated_axes,
    d_to_rotated_axes,
    dot,
    from_rotated_axes,
    inertia_term,
    inertia_times,
    isotropic,
    load,
    size,
    symmetric_entry,
    symmetric_matrix,
    to_rotated_axes,
    unit,
    zero,
)
from ..spatial.dimension import BySpace
from .body import (
    H0,
    Ct0,
    Ct1,
    H_derivative,
    H_second_derivative,
    coupling,
    free_mass,
    free_rotation,
    mass,
    mdCM,
    theta_k,
)

#: Moments of inertia below this part of the largest one are rounding: there are none.
NO_INERTIA = 1e-13


@inner()
def frame_angular_motion(system, work, b, acc, weight):
    """Angular velocity and acceleration of a body frame."""
    row, frame = system.body[b], work.frame[b]
    alpha, n = frame.al, size(frame.x)
    if row.rd > n:
        alpha = alpha + weight * load(alpha, acc, row.vel + n)
    return frame.w, alpha


@inner()
def evaluate_centre_of_mass(system, work, b, z, v, acc, weight):
    """mdCM, Ct and the acceleration of the centre of mass relative to the frame.

    Parameters
    ----------
    acc
        Accelerations, of which `weight` counts: 0, or 1.
    """
    row, real_data, s = system.body[b], system.real_data, work.rotation_scratch[0]
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    x, none = work.frame[b].x, zero(work.frame[b].x)
    mu, mu1, mu1_dot, Ct_qdot, Ct_dot_qdot, Ct_qddot = (
        none,
        none,
        none,
        none,
        none,
        none,
    )
    for k in range(nq):
        mode, qk, qdk = work.stiffened_scratch[k], z[q + k], v[qd + k]
        ct0 = Ct0(x, real_data, o, nq, k)
        Ct1_q, Ct1_qdot, Ct1_qddot = none, none, none
        for i in range(nq):
            c = Ct1(x, real_data, o, nq, k, i)
            Ct1_q, Ct1_qdot = Ct1_q + z[q + i] * c, Ct1_qdot + v[qd + i] * c
            Ct1_qddot = Ct1_qddot + acc[qd + i] * c
        ct = ct0 + Ct1_q
        mu1, mu1_dot = mu1 + qk * ct0, mu1_dot + qdk * ct0
        mu = mu + qk * (ct0 + 0.5 * Ct1_q)
        Ct_qdot, Ct_dot_qdot, Ct_qddot = (
            Ct_qdot + qdk * ct,
            Ct_dot_qdot + qdk * Ct1_qdot,
            Ct_qddot + acc[qd + k] * ct,
        )
        mode.ct0, mode.ct, mode.Ct1_qdot, mode.Ct1_qddot = ct0, ct, Ct1_qdot, Ct1_qddot
    md = mdCM(x, real_data, o) + mu
    omega, alpha = frame_angular_motion(system, work, b, acc, weight)
    a_centre = Ct_dot_qdot + weight * Ct_qddot + 2.0 * cross(omega, Ct_qdot)
    a_centre = a_centre + cross(alpha, md) + cross(omega, cross(omega, md))
    s.mu, s.mu1, s.mu1_dot, s.md = mu, mu1, mu1_dot, md
    s.Ct_qdot, s.Ct_dot_qdot, s.Ct_qddot = Ct_qdot, Ct_dot_qdot, Ct_qddot
    s.a_centre = (1.0 / mass(x, real_data, o)) * a_centre


@inner()
def add_centre_of_mass(system, work, b, v):
    """What `evaluate_centre_of_mass` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.rotation_scratch[0], work.M, work.f
    md, a_centre, nq, nv, rd, first = s.md, s.a_centre, row.nq, row.nv, row.rd, row.vel
    n, inverse = size(md), 1.0 / mass(md, system.real_data, row.data)
    rotation_rows = row.block + n * nv
    if rd > n:
        add_symmetric(M, rotation_rows + n, nv, inertia_term(md, md, -0.5 * inverse))
        add_row(f, first + n, -cross(md, a_centre))
    for k in range(nq):
        mode, row_start = work.stiffened_scratch[k], row.block + (rd + k) * nv
        ct = mode.ct
        f[first + rd + k] -= dot(ct, a_centre)
        if rd >= n:
            add_row(f, first, -v[first + rd + k] * mode.Ct1_qdot)
        if rd > n:
            md_ct = inverse * cross(md, ct)
            add_row(M, row_start + n, md_ct)
            add_column(M, rotation_rows + rd + k, nv, md_ct)
        for i in range(nq):
            M[row_start + rd + i] += dot(ct, work.stiffened_scratch[i].ct) * inverse


@inner()
def linearise_centre_of_mass(system, work, b, acc):
    """What `evaluate_centre_of_mass` found, to Rp and Rv."""
    row, real_data, s, P, D = (
        system.body[b],
        system.real_data,
        work.rotation_scratch[0],
        work.Rp,
        work.Rv,
    )
    nq, nv, rd, block, o = row.nq, row.nv, row.rd, row.block, row.data
    omega, alpha = frame_angular_motion(system, work, b, acc, 1.0)
    md, a_centre, Ct_qdot, n = s.md, s.a_centre, s.Ct_qdot, size(s.md)
    inverse, rotation_rows = 1.0 / mass(md, real_data, o), block + n * nv
    if rd > n:
        for a in range(size(omega)):
            e = unit(omega, a)
            d_omega = (
                cross(e, cross(omega, md))
                + cross(omega, cross(e, md))
                + 2.0 * cross(e, Ct_qdot)
            )
            d_omega = inverse * d_omega
            add_column(D, rotation_rows + n + a, nv, cross(md, d_omega))
            for k in range(nq):
                D[block + (rd + k) * nv + n + a] += dot(
                    work.stiffened_scratch[k].ct, d_omega
                )
    for i in range(nq):
        ct, Ct1_qdot = work.stiffened_scratch[i].ct, work.stiffened_scratch[i].Ct1_qdot
        d_q = (
            cross(alpha, ct)
            + cross(omega, cross(omega, ct))
            + 2.0 * cross(omega, Ct1_qdot)
        )
        d_q = inverse * (d_q + work.stiffened_scratch[i].Ct1_qddot)
        d_qdot = (2.0 * inverse) * (Ct1_qdot + cross(omega, ct))
        if rd >= n:
            add_column(D, block + rd + i, nv, 2.0 * Ct1_qdot)
        if rd > n:
            add_column(
                P, rotation_rows + rd + i, nv, cross(ct, a_centre) + cross(md, d_q)
            )
            add_column(D, rotation_rows + rd + i, nv, cross(md, d_qdot))
        for k in range(nq):
            other, row_start = (
                work.stiffened_scratch[k].ct,
                block + (rd + k) * nv + rd + i,
            )
            P[row_start] += dot(Ct1(md, real_data, o, nq, k, i), a_centre) + dot(
                other, d_q
            )
            D[row_start] += dot(other, d_qdot)


@inner()
def set_elastic_mass(system, work, row, x):
    """Begins the elastic block of the mass matrix with that of the free shapes."""
    nq, nv, corner = row.nq, row.nv, row.block + row.rd * (row.nv + 1)
    for k in range(nq):
        for i in range(nq):
            free = free_mass(x, system.real_data, row.data, nq, k, i)
            work.M[corner + k * nv + i] = free


@inner()
def coupling_term(x, real_data, o, nq, k, i, whole):
    """Coupling of two coordinates, of the body or of its free shapes."""
    if whole:
        return coupling(x, real_data, o, nq, k, i)
    return free_rotation(x, real_data, o, nq, k, i)


@inner()
def h_second_derivative(x, real_data, o, nq, k, i, whole):
    """Second derivative of H."""
    if whole:
        return H_second_derivative(x, real_data, o, nq, k, i)
    free = 2.0 * free_mass(x, real_data, o, nq, k, i)
    return isotropic(H0(x, real_data, o), free)


@inner()
def _planar_inverse(work, s):
    moment = symmetric_entry(s.H, 0)
    s.H_inv = isotropic(s.H, 1.0 / moment)
    return moment > 0.0


@inner()
def _spatial_inverse(work, s):
    """Without inertia about an axis there is no motion about it."""
    H = s.H
    xx, yy, zz = symmetric_entry(H, 0), symmetric_entry(H, 1), symmetric_entry(H, 2)
    xy, xz, yz = symmetric_entry(H, 3), symmetric_entry(H, 4), symmetric_entry(H, 5)
    least = NO_INERTIA * max(xx, yy, zz)
    a = 1.0 / xx if xx > least else 0.0
    l1, l2 = xy * a, xz * a
    pivot = yy - l1 * xy
    b = 1.0 / pivot if pivot > least else 0.0
    l3 = (yz - l1 * xz) * b
    last = zz - l2 * xz - l3 * (yz - l1 * xz)
    c = 1.0 / last if last > least else 0.0
    l4 = l1 * l3 - l2
    s.H_inv = symmetric_matrix(
        a + l1 * l1 * b + l4 * l4 * c,
        b + l3 * l3 * c,
        c,
        -l1 * b - l3 * l4 * c,
        l4 * c,
        -l3 * c,
    )
    return xx > -least and pivot > -least and last > -least


#: The inverse of H; false if H is not positive.
_set_inverse = BySpace(plane=_planar_inverse, space=_spatial_inverse)


@inner()
def _add_centre_terms_of_h(system, work, row, s):
    """Adds to H the terms of third and fourth order in q that leave none in J."""
    inverse = 1.0 / mass(s.mu, system.real_data, row.data)
    mu, mu1, Ct_qdot, mu1_dot = s.mu, s.mu1, s.Ct_qdot, s.mu1_dot
    s.H = (
        s.H
        + inertia_term(mu, mu, 0.5 * inverse)
        - inertia_term(mu1, mu1, 0.5 * inverse)
    )
    d_term_dot = inertia_term(mu, Ct_qdot, inverse) - inertia_term(
        mu1, mu1_dot, inverse
    )
    s.H_dot = s.H_dot + d_term_dot
    for k in range(row.nq):
        mode = work.stiffened_scratch[k]
        ct, ct0 = mode.ct, mode.ct0
        d_term = inertia_term(mu, ct, inverse) - inertia_term(mu1, ct0, inverse)
        mode.dH = mode.dH + d_term
        d_term_dot = inertia_term(ct, Ct_qdot, inverse) + inertia_term(
            mu, mode.Ct1_qdot, inverse
        )
        d_term_dot = d_term_dot - inertia_term(ct0, mu1_dot, inverse)
        mode.dH_dot = mode.dH_dot + d_term_dot


@inner()
def _add_centre_terms_of_coupling(system, work, row, s, acc):
    """Add to the coupling the terms of second order in q that leave none in Cr, eq.
    (27).

    The terms that the rotated axes cause in Cr are not included.
    """
    nq, qd, inverse = (
        row.nq,
        row.vel + row.rd,
        1.0 / mass(s.mu, system.real_data, row.data),
    )
    mu, mu1, Ct_qdot, mu1_dot = s.mu, s.mu1, s.Ct_qdot, s.mu1_dot
    theta_dot_, theta_ddot, Hu_dot = (
        s.theta_dot,
        s.theta_ddot,
        s.Ct_qddot + s.Ct_dot_qdot,
    )
    H_second, H_second_dot, Ct0_qddot = s.H_second, s.H_second_dot, zero(mu)
    for k in range(nq):
        Ct0_qddot = Ct0_qddot + acc[qd + k] * work.stiffened_scratch[k].ct0
    for k in range(nq):
        mode = work.stiffened_scratch[k]
        ct, ct0, theta_k_, H_second_k = mode.ct, mode.ct0, mode.theta_k, mode.H_second_k
        mu_Ct1_qdot = cross(mu, mode.Ct1_qdot)
        mu_ct = cross(mu, ct) - cross(mu1, ct0)
        mu_ct_dot = cross(Ct_qdot, ct) - cross(mu1_dot, ct0) + mu_Ct1_qdot
        ct_Ct_qdot = cross(ct, Ct_qdot) - cross(ct0, mu1_dot) + mu_Ct1_qdot
        ct_Ct_qddot = (
            cross(ct, Hu_dot) - cross(ct0, Ct0_qddot) + cross(mu, mode.Ct1_qddot)
        )
        H_second_theta = inertia_times(H_second_k, theta_ddot)
        H_second_theta = H_second_theta + inertia_times(mode.H_second_k_dot, theta_dot_)
        mode.D_k = mode.D_k - inverse * mu_ct - inertia_times(H_second, theta_k_)
        mu_ct_dot = inverse * mu_ct_dot + inertia_times(H_second_dot, theta_k_)
        mode.D_k_dot = mode.D_k_dot - mu_ct_dot
        ct_Ct_qdot = inverse * ct_Ct_qdot + inertia_times(H_second_k, theta_dot_)
        mode.D_column_qdot = mode.D_column_qdot - ct_Ct_qdot
        mode.D_column_qddot = (
            mode.D_column_qddot - inverse * ct_Ct_qddot - H_second_theta
        )


@inner()
def evaluate_mean_axes(system, work, b, z, v, acc, weight, whole):
    """The rotation of a body, or of its free shapes; false if H is not positive."""
    row, real_data, s = system.body[b], system.real_data, work.rotation_scratch[0]
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    x, none = s.md, zero(s.omega_m)
    H, H_dot = H0(x, real_data, o), zero(s.H)
    H_second, H_second_dot = zero(H), zero(H)
    theta, theta_dot, theta_ddot = none, none, none
    for k in range(nq):
        mode, qk, qdk = work.stiffened_scratch[k], z[q + k], v[qd + k]
        theta_k_, H_derivative_k = none, zero(H)
        if whole:
            theta_k_, H_derivative_k = (
                theta_k(x, real_data, o, nq, k),
                H_derivative(x, real_data, o, nq, k),
            )
        H_second_k, H_second_k_dot = zero(H), zero(H)
        D_k, D_k_dot, D_column_qdot, D_column_qddot = none, none, none, none
        for i in range(nq):
            qi, qdi = z[q + i], v[qd + i]
            c = coupling_term(x, real_data, o, nq, k, i, whole)
            c_transposed = coupling_term(x, real_data, o, nq, i, k, whole)
            g = h_second_derivative(x, real_data, o, nq, k, i, whole)
            H_second_k, H_second_k_dot = H_second_k + qi * g, H_second_k_dot + qdi * g
            D_k, D_k_dot = D_k + qi * c, D_k_dot + qdi * c
            D_column_qdot, D_column_qddot = (
                D_column_qdot + qdi * c_transposed,
                D_column_qddot + acc[qd + i] * c_transposed,
            )
        theta, theta_dot = theta + qk * theta_k_, theta_dot + qdk * theta_k_
        theta_ddot = theta_ddot + acc[qd + k] * theta_k_
        mode.D_k, mode.D_k_dot, mode.D_column_qdot = D_k, D_k_dot, D_column_qdot
        mode.D_column_qddot, mode.theta_k = D_column_qddot, theta_k_
        mode.H_second_k, mode.H_second_k_dot = H_second_k, H_second_k_dot
        mode.dH, mode.dH_dot = H_derivative_k + H_second_k, H_second_k_dot
        H, H_dot = H + qk * H_derivative_k, H_dot + qdk * H_derivative_k
        H_second, H_second_dot = (
            H_second + (0.5 * qk) * H_second_k,
            H_second_dot + qdk * H_second_k,
        )
    s.H, s.H_dot = H + H_second, H_dot + H_second_dot
    s.H_second, s.H_second_dot = H_second, H_second_dot
    s.theta, s.theta_dot, s.theta_ddot = theta, theta_dot, theta_ddot
    omega_m, omega_m_dot, omega = none, none, none
    if whole:
        _add_centre_terms_of_h(system, work, row, s)
        _add_centre_terms_of_coupling(system, work, row, s, acc)
        omega, alpha = frame_angular_motion(system, work, b, acc, weight)
        omega_m = to_rotated_axes(theta, omega) + theta_dot
        omega_m_dot = to_rotated_axes(theta, alpha) + d_to_rotated_axes(
            theta, theta_dot, omega
        )
        omega_m_dot = omega_m_dot + weight * theta_ddot
    if not _set_inverse(work, s):
        return False
    _set_mean_axes_motion(work, row, s, v, acc, weight, omega_m, omega_m_dot)
    u, H_inv_Dqdot = s.u, s.H_inv_Dqdot
    for k in range(nq):
        mode = work.stiffened_scratch[k]
        mode.d_omega = d_to_rotated_axes(theta, mode.theta_k, omega)
        mode.dH_u = inertia_times(mode.dH, u)
        mode.dH_H_inv_Dqdot = inertia_times(mode.dH, H_inv_Dqdot)
    return True


@inner()
def _set_mean_axes_motion(work, row, s, v, acc, weight, omega_m, omega_m_dot):
    """Angular velocity and momentum of the mean axes, and their rates."""
    qd, D_qdot, D_qdot_dot = row.vel + row.rd, zero(omega_m), zero(omega_m)
    H, H_dot, H_inv = s.H, s.H_dot, s.H_inv
    for k in range(row.nq):
        mode, qdk, qddk = work.stiffened_scratch[k], v[qd + k], weight * acc[qd + k]
        D_qdot = D_qdot + qdk * mode.D_k
        D_qdot_dot = D_qdot_dot + qddk * mode.D_k + qdk * mode.D_k_dot
    H_inv_Dqdot = inertia_times(H_inv, D_qdot)
    u = omega_m + H_inv_Dqdot
    Hu_dot = inertia_times(H, omega_m_dot) + inertia_times(H_dot, omega_m)
    Hu_dot = Hu_dot + D_qdot_dot
    s.omega_m, s.omega_m_dot, s.u, s.H_inv_Dqdot = omega_m, omega_m_dot, u, H_inv_Dqdot
    s.Hu, s.Hu_dot = inertia_times(H, omega_m) + D_qdot, Hu_dot
    s.u_dot = inertia_times(H_inv, Hu_dot - inertia_times(H_dot, u))


@inner()
def frame_torque(s, omega, p, Hu_dot):
    """Torque on the frame by changes of the momentum and of its rate."""
    theta, rate_in_body_axes = s.theta, d_from_rotated_axes(s.theta, s.theta_dot, p)
    return (
        from_rotated_axes(theta, Hu_dot)
        + rate_in_body_axes
        + cross(omega, from_rotated_axes(theta, p))
    )


@inner()
def _add_mean_axes_terms(system, work, b, whole):
    """What `evaluate_mean_axes` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.rotation_scratch[0], work.M, work.f
    nq, nv, rd, first, n = row.nq, row.nv, row.rd, row.vel, size(s.md)
    block, frame, sign = row.block, row.block + n * row.nv, 1.0 if whole else -1.0
    theta, u, u_dot, H, H_inv = s.theta, s.u, s.u_dot, s.H, s.H_inv
    p, Hu_dot, has_rotation = s.Hu, s.Hu_dot, whole and rd > n
    if has_rotation:
        add_row(f, first + n, -frame_torque(s, work.frame[b].w, p, Hu_dot))
        for a in range(size(u)):
            column = from_rotated_axes(
                theta, inertia_times(H, to_rotated_axes(theta, unit(u, a)))
            )
            add_column(M, frame + n + a, nv, column)
    for k in range(nq):
        mode, row_start = work.stiffened_scratch[k], block + (rd + k) * nv
        theta_k_, D_k = mode.theta_k, mode.D_k
        d_u = mode.D_k_dot - mode.D_column_qdot + mode.dH_H_inv_Dqdot - 0.5 * mode.dH_u
        force = dot(theta_k_, Hu_dot) + dot(D_k, u_dot) + dot(d_u, u)
        f[first + rd + k] -= sign * (force - dot(p, mode.d_omega))
        if has_rotation:
            column = from_rotated_axes(theta, inertia_times(H, theta_k_) + D_k)
            add_row(M, row_start + n, column)
            add_column(M, frame + rd + k, nv, column)
        u_k = theta_k_ + inertia_times(H_inv, D_k)
        for i in range(nq):
            other = work.stiffened_scratch[i]
            momentum_k = inertia_times(H, other.theta_k) + other.D_k
            M[row_start + rd + i] += sign * dot(u_k, momentum_k)


@inner()
def add_stiffened_inertia(system, work, b, z, v):
    """Completes mass matrix and forces of a stiffened body; spoils a mass matrix that
    is not positive, see `failure_causes`.
    """
    row = system.body[b]
    set_elastic_mass(system, work, row, work.frame[b].x)
    evaluate_centre_of_mass(system, work, b, z, v, v, 0.0)
    add_centre_of_mass(system, work, b, v)
    for part in range(2):
        if not evaluate_mean_axes(system, work, b, z, v, v, 0.0, part == 0):
            work.M[row.block + row.nv * row.nv - 1] = -math.inf
            return
        _add_mean_axes_terms(system, work, b, part == 0)
