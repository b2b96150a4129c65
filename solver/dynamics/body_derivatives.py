"""Derivatives of the equations of motion of one body by its coordinates.

Rp and Rv are the derivatives of M z_II' - f by positions and by velocities; positions
vary in the body frame.

==============  =============================================  ===========
Symbol          Meaning                                        Theory
==============  =============================================  ===========
Rp, Rv          derivatives by positions and velocities        eq. (17)
H_second        second derivative of H by q                    section 12
d_u, d_u_dot    changes of the angular velocity of the mean    section 12
                axes relative to the frame, and of its rate
d_Hu_dot        change of the rate of their momentum           section 12
==============  =============================================  ===========
"""

from ..compiler.kernels import inner
from ..spatial.algebra import (
    add_column,
    add_cross,
    add_double_cross,
    add_gyroscopic_matrix,
    add_row,
    cross,
    d2_to_rotated_axes,
    d_from_rotated_axes,
    d_to_rotated_axes,
    dot,
    from_rotated_axes,
    inertia_second_derivative,
    inertia_term,
    inertia_times,
    load,
    omega_gradient,
    omega_product,
    size,
    to_rotated_axes,
    unit,
    zero,
)
from ..spatial.system_arrays import HAS_CR1, HAS_CT1, HAS_KE1, HAS_OE1, HAS_QUADRATIC_J
from .body import (
    J0,
    Cr1,
    Cr1_row,
    Ct1,
    Ct1_row,
    De,
    Ge,
    Ge_row,
    Ke,
    Ke1_offset,
    Oe0,
    Oe1,
    Oe1_row,
    add_cubic_stiffness,
    body_state,
    gravity_in_body_axes,
    mass,
    row_product,
)
from .geometric_stiffening import (
    coupling_term,
    evaluate_centre_of_mass,
    evaluate_mean_axes,
    frame_angular_motion,
    frame_torque,
    h_second_derivative,
    linearise_centre_of_mass,
)


@inner()
def _add_elastic_derivatives(system, work, b, z, v, acc, a, alpha):
    """Add the rows and columns of the elastic coordinates, and the derivatives by the
    rotation.
    """
    row, frame = system.body[b], work.frame[b]
    nq, nv, rd, flags, o, n = row.nq, row.nv, row.rd, row.flags, row.data, size(a)
    real_data, P, D, omega, x = system.real_data, work.Rp, work.Rv, frame.w, frame.x
    block, first, q = row.block, row.vel, row.pos + row.np - nq
    qd, quadratic, J = first + rd, flags & HAS_QUADRATIC_J != 0, J0(x, real_data, o)
    for k in range(nq):
        row_start = block + (rd + k) * nv
        d_omega = omega_gradient(Oe0(x, real_data, o, nq, k), omega)
        d_rotation, d_translation, Cr1_minus_Ge_qdot = zero(omega), zero(a), zero(omega)
        if flags & HAS_CR1:
            c, ge = Cr1_row(x, o, nq, k), Ge_row(x, o, nq, k)
            Ge_qdot = row_product(omega, work, real_data, ge, nq, v, qd)
            d_omega, Cr1_minus_Ge_qdot = (
                d_omega + Ge_qdot,
                row_product(omega, work, real_data, c, nq, v, qd) - Ge_qdot,
            )
            d_rotation = row_product(omega, work, real_data, c, nq, acc, qd)
            d_rotation = d_rotation - row_product(
                omega, work, real_data, ge, nq, acc, qd
            )
        if flags & HAS_OE1:
            oe = Oe1_row(x, o, nq, k)
            d_omega = d_omega + omega_gradient(
                row_product(J, work, real_data, oe, nq, z, q), omega
            )
            if quadratic:
                J_dot_k = inertia_second_derivative(
                    row_product(J, work, real_data, oe, nq, v, qd)
                )
                d_rotation = d_rotation + inertia_times(J_dot_k, omega)
        if flags & HAS_CT1:
            ct = Ct1_row(x, o, nq, k)
            d_translation = 2.0 * cross(
                omega, row_product(a, work, real_data, ct, nq, v, qd)
            )
            d_translation = d_translation + row_product(
                a, work, real_data, ct, nq, acc, qd
            )
        for i in range(nq):
            stiffness, damping = (
                Ke(x, real_data, o, nq, k, i),
                De(x, real_data, o, nq, k, i),
            )
            if flags & HAS_CR1:
                stiffness += dot(Cr1(x, real_data, o, nq, k, i), alpha)
                damping += dot(Ge(x, real_data, o, nq, k, i), omega)
            if flags & HAS_OE1:
                stiffness += omega_product(Oe1(x, real_data, o, nq, k, i), omega)
            if flags & HAS_CT1:
                stiffness += dot(Ct1(x, real_data, o, nq, k, i), a)
            P[row_start + rd + i] += stiffness
            D[row_start + rd + i] += damping
        if rd >= n:
            add_column(P, block + rd + k, nv, d_translation)
        if quadratic:
            d_rotation = d_rotation + cross(omega, Cr1_minus_Ge_qdot)
        if rd > n:
            add_row(D, row_start + n, d_omega)
            add_column(P, block + n * nv + rd + k, nv, d_rotation)
    if flags & HAS_KE1:
        at, corner = Ke1_offset(x, o, nq), block + rd * nv + rd
        add_cubic_stiffness(real_data, at, nq, z, q, P, corner, nv)


@inner()
def _add_frame_derivatives(system, work, b, md, J, J_dot, Ct_qdot, Cr_qdot, g):
    """Columns of the frame in its own rows."""
    row, frame, P, D = system.body[b], work.frame[b], work.Rp, work.Rv
    nv, block, n, omega, velocity = row.nv, row.block, size(md), frame.w, frame.v
    m = mass(md, system.real_data, row.data)
    if row.rd >= n:
        add_cross(D, block, nv, m * omega, md)
    if row.rd <= n:
        return
    r, momentum_rate = block + n * nv, m * velocity + cross(omega, md) + 2.0 * Ct_qdot
    add_cross(P, block + n, nv, -m * g, omega)
    add_double_cross(P, r + n, nv, -md, g, omega)
    add_cross(D, block + n, nv, -momentum_rate, omega)
    add_double_cross(D, block + n, nv, -omega, md, omega)
    add_double_cross(D, r, nv, md, omega, md)
    add_double_cross(D, r + n, nv, -md, velocity, omega)
    add_cross(D, r + n, nv, -inertia_times(J, omega) - Cr_qdot, omega)
    add_gyroscopic_matrix(D, r + n, nv, omega, J, J_dot)


@inner()
def linearise_body(system, work, b, z, v, acc):
    """Rp and Rv of one body: derivatives of M z_II' - f by positions and velocities.

    Positions vary in the body frame, see `coordinates`.
    """
    row, frame = system.body[b], work.frame[b]
    nq, nv, rd, n = row.nq, row.nv, row.rd, size(frame.x)
    P, D, block, first = work.Rp, work.Rv, row.block, row.vel
    for i in range(block, block + nv * nv):
        P[i] = 0.0
        D[i] = 0.0
    if nv == 0:
        return
    omega, alpha, velocity, g = (
        frame.w,
        frame.al,
        frame.v,
        gravity_in_body_axes(system, frame),
    )
    md, J, J_dot, Ct_qdot, Cr_qdot = body_state(system, work, row, omega, z, v)
    a = frame.a - g
    if rd >= n:
        a = a + load(a, acc, first)
    if rd > n:
        alpha = alpha + load(alpha, acc, first + n)
    _add_frame_derivatives(system, work, b, md, J, J_dot, Ct_qdot, Cr_qdot, g)
    for k in range(nq):
        mode, row_start = work.modal_scratch[k], block + (rd + k) * nv
        ct, j1, j1w = mode.ct, mode.j1, inertia_times(mode.j1, omega)
        if rd >= n:
            inertial_acceleration = cross(alpha, ct) + cross(omega, cross(omega, ct))
            add_column(P, block + rd + k, nv, inertial_acceleration)
            add_column(D, block + rd + k, nv, 2.0 * cross(omega, ct))
            add_row(D, row_start, cross(ct, omega))
        if rd > n:
            r = block + n * nv + rd + k
            inertial_torque = (
                cross(ct, a) + inertia_times(j1, alpha) + cross(omega, j1w)
            )
            add_column(P, r, nv, inertial_torque)
            add_column(D, r, nv, j1w + cross(omega, mode.cr_gyro))
            add_row(P, row_start + n, cross(g, ct))
            add_row(D, row_start + n, cross(velocity, ct))
    _add_elastic_derivatives(system, work, b, z, v, acc, a, alpha)


@inner()
def _force_change(mode, p, d_Hu_dot, d_u, d_u_dot, d_H_inv_Dqdot):
    """Change of the force of a row by changes of momentum, its rate, u and its rate."""
    slope = mode.D_k_dot - mode.D_column_qdot + mode.dH_H_inv_Dqdot - mode.dH_u
    force = dot(mode.theta_k, d_Hu_dot) + dot(mode.D_k, d_u_dot) + dot(slope, d_u)
    return force + dot(mode.dH_u, d_H_inv_Dqdot) - dot(p, mode.d_omega)


@inner()
def _linearise_frame_rotation(system, work, b):
    """Derivatives by the angular velocity of the frame."""
    row, s, D, omega = (
        system.body[b],
        work.rotation_scratch[0],
        work.Rv,
        work.frame[b].w,
    )
    nq, nv, rd, n, theta, none = row.nq, row.nv, row.rd, size(s.md), s.theta, zero(s.u)
    H, H_dot, theta_dot, p0 = s.H, s.H_dot, s.theta_dot, s.Hu
    momentum = from_rotated_axes(theta, p0)
    for a in range(size(omega)):
        e = unit(omega, a)
        d_u, d_u_dot = to_rotated_axes(theta, e), d_to_rotated_axes(theta, theta_dot, e)
        p = inertia_times(H, d_u)
        d_Hu_dot = inertia_times(H, d_u_dot) + inertia_times(H_dot, d_u)
        torque = frame_torque(s, omega, p, d_Hu_dot) + cross(e, momentum)
        add_column(D, row.block + n * nv + n + a, nv, torque)
        for k in range(nq):
            mode, at = work.stiffened_scratch[k], row.block + (rd + k) * nv + n + a
            D[at] += _force_change(mode, p, d_Hu_dot, d_u, d_u_dot, none)
            D[at] -= dot(p0, d_to_rotated_axes(theta, mode.theta_k, e))


@inner()
def _coupling_derivatives(s, one, other, c, H_second_theta_rate, inverse):
    """What the terms of second order of the coupling add, in the row of `other`, to
    derivatives by the coordinate of `one`.

    To that of the row, to that less the one with both exchanged, and to that of
    row_rate - column.

    Parameters
    ----------
    c
        Derivative of its Ct.
    H_second_theta_rate
        Second derivative of these terms of H times the rate of the tilt.
    """
    ct = other.ct
    ct_skew = cross(one.ct, ct) - cross(one.ct0, other.ct0)
    d_mu_ct = ct_skew + cross(s.mu, c)
    d_mu_ct_dot = cross(one.Ct1_qdot, ct) + cross(s.Ct_qdot, c)
    H_second_theta = inertia_times(one.H_second_k, other.theta_k)
    H_second_theta_transposed = inertia_times(other.H_second_k, one.theta_k)
    H_second_theta_dot = (
        inertia_times(one.H_second_k_dot, other.theta_k) - H_second_theta_rate
    )
    d_D, minus_two_over_m = -inverse * d_mu_ct - H_second_theta, -2.0 * inverse
    return (
        d_D,
        minus_two_over_m * ct_skew + H_second_theta_transposed - H_second_theta,
        minus_two_over_m * d_mu_ct_dot - H_second_theta_dot,
    )


@inner()
def _h_second_derivative_terms(s, one, other, c, inverse):
    """Contribution of the higher-order terms of H to its second derivative."""
    terms = inertia_term(one.ct, other.ct, inverse) + inertia_term(s.mu, c, inverse)
    return terms - inertia_term(one.ct0, other.ct0, inverse)


@inner()
def _linearise_elastic_rotation(system, work, b, acc, whole):
    """Derivatives by elastic coordinates and their rates."""
    row, real_data, s, P, D = (
        system.body[b],
        system.real_data,
        work.rotation_scratch[0],
        work.Rp,
        work.Rv,
    )
    nq, nv, rd, block, o = row.nq, row.nv, row.rd, row.block, row.data
    x, none, sign = s.md, zero(s.u), 1.0 if whole else -1.0
    theta, theta_dot, p0, p0_rate = s.theta, s.theta_dot, s.Hu, s.Hu_dot
    u, u_dot, H_inv_Dqdot, omega_m, omega_m_dot = (
        s.u,
        s.u_dot,
        s.H_inv_Dqdot,
        s.omega_m,
        s.omega_m_dot,
    )
    H, H_dot, H_inv = s.H, s.H_dot, s.H_inv
    omega, alpha, half_u = none, none, H_inv_Dqdot - 0.5 * u
    if whole:
        omega, alpha = frame_angular_motion(system, work, b, acc, 1.0)
    n, inverse = size(x), 1.0 / mass(x, real_data, o)
    frame = block + n * nv + rd
    for i in range(nq):
        mode = work.stiffened_scratch[i]
        theta_k_, d_omega_k, D_column_qdot, dH_u = (
            mode.theta_k,
            mode.d_omega,
            mode.D_column_qdot,
            mode.dH_u,
        )
        dH, dH_dot, D_k = mode.dH, mode.dH_dot, mode.D_k
        d_omega_m_dot = d_to_rotated_axes(theta, theta_k_, alpha) + d2_to_rotated_axes(
            theta_k_, theta_dot, omega
        )
        p = inertia_times(H, d_omega_k) + inertia_times(dH, omega_m) + D_column_qdot
        d_Hu_dot = inertia_times(H, d_omega_m_dot) + inertia_times(H_dot, d_omega_k)
        d_Hu_dot = d_Hu_dot + inertia_times(dH, omega_m_dot)
        d_Hu_dot = d_Hu_dot + inertia_times(dH_dot, omega_m) + mode.D_column_qddot
        d_u = inertia_times(H_inv, p - dH_u)
        d_u_dot = d_Hu_dot - inertia_times(dH, u_dot) - inertia_times(dH_dot, u)
        d_u_dot = inertia_times(H_inv, d_u_dot - inertia_times(H_dot, d_u))
        d_H_inv_Dqdot = inertia_times(H_inv, D_column_qdot - mode.dH_H_inv_Dqdot)
        rate_Hu = inertia_times(H, theta_k_) + D_k
        rate_Hu_dot = inertia_times(H, d_omega_k) + inertia_times(dH, omega_m)
        rate_Hu_dot = (
            rate_Hu_dot + inertia_times(H_dot, theta_k_) + mode.D_k_dot + D_column_qdot
        )
        rate_H_inv_Dqdot = inertia_times(H_inv, D_k)
        rate_u = theta_k_ + rate_H_inv_Dqdot
        rate_u_dot = rate_Hu_dot - dH_u - inertia_times(H_dot, rate_u)
        rate_u_dot = inertia_times(H_inv, rate_u_dot)
        if whole and rd > n:
            d_Hu_axes = d_from_rotated_axes(theta, theta_k_, p0)
            torque = d_from_rotated_axes(theta, theta_k_, p0_rate) + cross(
                omega, d_Hu_axes
            )
            torque = torque + d2_to_rotated_axes(theta_k_, theta_dot, p0)
            add_column(P, frame + i, nv, torque + frame_torque(s, omega, p, d_Hu_dot))
            torque = d_Hu_axes + frame_torque(s, omega, rate_Hu, rate_Hu_dot)
            add_column(D, frame + i, nv, torque)
        for k in range(nq):
            other, at = work.stiffened_scratch[k], block + (rd + k) * nv + rd + i
            c = coupling_term(x, real_data, o, nq, k, i, whole)
            g = h_second_derivative(x, real_data, o, nq, k, i, whole)
            gyroscopic, gyroscopic_rate = (
                none,
                c - coupling_term(x, real_data, o, nq, i, k, whole),
            )
            if whole:
                Ct1_ki = Ct1(x, real_data, o, nq, k, i)
                H_second_theta_dot = inertia_times(g, theta_dot)
                g = g + _h_second_derivative_terms(s, mode, other, Ct1_ki, inverse)
                d_D, d_D_skew, gyroscopic = _coupling_derivatives(
                    s, mode, other, Ct1_ki, H_second_theta_dot, inverse
                )
                c, gyroscopic_rate = c + d_D, gyroscopic_rate + d_D_skew
            d_q = _force_change(other, p, d_Hu_dot, d_u, d_u_dot, d_H_inv_Dqdot) + dot(
                c, u_dot
            )
            d_q += dot(u, inertia_times(g, half_u)) + dot(gyroscopic, u)
            d_q -= dot(p0, d2_to_rotated_axes(theta_k_, other.theta_k, omega))
            d_qdot = _force_change(
                other, rate_Hu, rate_Hu_dot, rate_u, rate_u_dot, rate_H_inv_Dqdot
            )
            P[at] += sign * d_q
            D[at] += sign * (d_qdot + dot(gyroscopic_rate, u))


@inner()
def linearise_stiffened_inertia(system, work, b, z, v, acc):
    """Completes Rp and Rv of a stiffened body."""
    evaluate_centre_of_mass(system, work, b, z, v, acc, 1.0)
    linearise_centre_of_mass(system, work, b, acc)
    for part in range(2):
        if evaluate_mean_axes(system, work, b, z, v, acc, 1.0, part == 0):
            if part == 0 and system.body[b].rd > size(work.rotation_scratch[0].md):
                _linearise_frame_rotation(system, work, b)
            _linearise_elastic_rotation(system, work, b, acc, part == 0)
