"""Energies of a scene at recorded states, and the powers that change their sum.

Kinetic energy of a body in SID quantities, eq. (12):
T = m v.v / 2 + v.(w x md) + w.J w / 2 + v.Ct^T q' + w.Cr^T q' + q'.Me q' / 2. The
equations of first order keep this energy up to terms of their own order; with
`quadratic_inertia` they keep it exactly, as bodies with geometric stiffening do theirs.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import SID, Array, symmetric_3x3
from sidtool.formats.sid_mass import skew

from ..integrators.recording import RUB_FORCE, RUB_RATE
from ..kernels import layout as at
from ..system.blocks import cr1, ct1, has_second_order, oe1
from ..system.bodies import BodyData, shapes_of_stiffened, symmetric
from ..system.first_order import cubic_energies
from ..system.scene import System
from .force_measures import Measured, measured
from .motion import FrameMotion, frame_motion, marker_motion
from .sampling import Samples


def kinetic(system: System, samples: Samples) -> Array:
    """Kinetic energy of all bodies, (nt,) [J]."""
    total = np.zeros(len(samples.z))
    for b, data in _bodies(system):
        q, qd = elastic_state(system, samples, b)
        frame = frame_motion(system, samples, b)
        total += body_kinetic(data, frame, q, qd, system.planar)
    return total


def body_kinetic(
    data: BodyData, frame: FrameMotion, q: Array, qd: Array, planar: bool
) -> Array:
    """Kinetic energy of one body, (nt,) [J]."""
    if has_second_order(data.sid):
        return _stiffened(data, frame, q, qd, planar)
    return _kinetic(data, frame, q, qd)


def _kinetic(data: BodyData, frame: FrameMotion, q: Array, qd: Array) -> Array:
    sid = data.sid
    V, W = frame.V, frame.W
    md, J = _first_moment(data, q), _inertia(data, q)
    Ct, Cr = sid.Ct.m0, sid.Cr.m0 + np.einsum("akl,tl->tka", cr1(sid), q)
    energy = 0.5 * sid.mass * _dot(V, V) + _dot(V, np.cross(W, md))
    energy += 0.5 * np.einsum("ta,tab,tb->t", W, J, W)
    energy += np.einsum("ta,ka,tk->t", V, Ct, qd)
    energy += np.einsum("ta,tka,tk->t", W, Cr, qd)
    return energy + 0.5 * np.einsum("tk,kl,tl->t", qd, symmetric(sid.Me.m0), qd)


def _stiffened(
    data: BodyData, frame: FrameMotion, q: Array, qd: Array, planar: bool
) -> Array:
    """Kinetic energy of a body with geometric stiffening, eq. (24)."""
    sid, W = data.sid, frame.W
    axes, free = shapes_of_stiffened(sid, planar)
    Ct = sid.Ct.m0 + np.einsum("akl,tl->tka", ct1(sid), q)
    flow = frame.V + np.cross(W, _first_moment(data, q)) / sid.mass
    flow = flow + np.einsum("tka,tk->ta", Ct, qd) / sid.mass
    if planar:
        flow[:, 2] = 0.0
    about = np.cross(q @ axes.tilt, W)
    turn = W - about + 0.5 * np.cross(q @ axes.tilt, about) + qd @ axes.tilt
    size = np.einsum("tk,kl,tl->t", q, free.mass, q)
    first, added = q @ sid.Ct.m0, _first_moment(data, q) - sid.mdCM.m0[:, 0]
    bow = 0.5 * np.einsum("klab,tk,tl->tab", axes.bows, q, q)
    H = axes.inertia + np.einsum("kab,tk->tab", axes.slopes, q) + bow
    H = H + (skew(added) @ skew(added) - skew(first) @ skew(first)) / sid.mass
    kick = np.cross(added, np.einsum("tka,tk->ta", Ct, qd))
    kick = -(kick - np.cross(first, qd @ sid.Ct.m0)) / sid.mass
    kick -= np.einsum("tab,tb->ta", bow, qd @ axes.tilt)
    kick += np.einsum("akl,tk,tl->ta", axes.coupling, qd, q)
    free_kick = np.einsum("akl,tk,tl->ta", free.turning, qd, q)
    round_ = axes.inertia + np.multiply.outer(size, np.eye(3))
    energy = 0.5 * sid.mass * _dot(flow, flow)
    energy += 0.5 * np.einsum("tk,kl,tl->t", qd, free.mass, qd)
    energy += _turning(H, turn, kick, planar)
    return energy - _turning(round_, 0.0 * turn, free_kick, planar)


def _turning(H: Array, turn: Array, kick: Array, planar: bool) -> Array:
    """p.H^-1 p / 2 with the angular momentum p = H turn + kick, (nt,)."""
    axes = [2] if planar else [0, 1, 2]
    H = H[:, axes][:, :, axes]
    u = np.einsum("tab,tb->ta", np.linalg.pinv(H, hermitian=True), kick[:, axes])
    u = u + turn[:, axes]
    return 0.5 * np.einsum("ta,tab,tb->t", u, H, u)


def _first_moment(data: BodyData, q: Array) -> Array:
    """md(q), with half of Ct1 for what a second-order displacement adds."""
    sid = data.sid
    moment = sid.mdCM.m0[:, 0] + q @ sid.Ct.m0
    return moment + 0.5 * np.einsum("akl,tk,tl->ta", ct1(sid), q, q)


def _inertia(data: BodyData, q: Array) -> Array:
    sid = data.sid
    six = sid.J.m0[:, 0] + q @ sid.J.first_order(sid.nq)[:, :, 0]
    if data.quadratic_inertia and sid.nq:
        xx, yy, zz, xy, yz, xz = oe1(sid)
        second = np.stack([xx, yy, zz, 0.5 * xy, 0.5 * xz, 0.5 * yz])
        six = six - np.einsum("akl,tk,tl->ta", second, q, q)
    return np.array([symmetric_3x3(row) for row in six]).reshape(-1, 3, 3)


def elastic(system: System, samples: Samples) -> Array:
    """Energy of deformation of all bodies, (nt,) [J]."""
    total = np.zeros(len(samples.z))
    for b, data in _bodies(system):
        q, _ = elastic_state(system, samples, b)
        total += deformation_energies(data.sid, q).sum(axis=1)
        total += q @ data.sid.ksigma.m0[:, 0]
    return total


def deformation_energies(sid: SID, x: Array, size: float = 1.0) -> Array:
    """Energy of deformation at q = size x over size^2, by coordinates, (nt, nq) [J].

    Without that of the reference stress (ksigma), which is no deformation's.
    """
    return 0.5 * x * (x @ symmetric(sid.Ke.m0)) + size * cubic_energies(sid, x)


def potential(system: System, samples: Samples) -> Array:
    """Energy of gravity (zero at the origin) and of springs, (nt,) [J]."""
    total = np.zeros(len(samples.z))
    gravity = system.arrays.gravity
    for b, data in _bodies(system):
        frame = frame_motion(system, samples, b)
        q, _ = elastic_state(system, samples, b)
        moment = np.einsum("tij,tj->ti", frame.R, _first_moment(data, q))
        total -= (data.sid.mass * frame.X + moment) @ gravity
    for element in system.forces:
        if element.acts and element.kind > at.FOLLOWING:
            deflection = measured(system, samples, element).g - element.law.rest
            total += element.law.stiffness.integral(deflection)
    return total


def dissipation(system: System, samples: Samples) -> Array:
    """Power lost in the damping of bodies, in dampers and by friction, (nt,) [W]."""
    total = np.zeros(len(samples.z))
    for b, data in _bodies(system):
        _, qd = elastic_state(system, samples, b)
        total += np.einsum("tk,kl,tl->t", qd, data.sid.De.m0, qd)
    for element in system.forces:
        if element.acts and element.kind > at.FOLLOWING:
            law, rate = element.law, measured(system, samples, element).rate
            total += law.damping.value(rate) * rate
            total += law.friction * np.tanh(rate / law.speed) * rate
    rub = samples.friction
    return total - np.sum(rub[:, :, RUB_FORCE] * rub[:, :, RUB_RATE], axis=1)


def supply(system: System, samples: Samples, drift: Array) -> Array:
    """Power of drives, and of forces that are functions of time or laws, (nt,) [W].

    drift : (nt, rows) derivative of the constraints by time alone
    """
    total = -np.sum(np.where(drift != 0.0, samples.multipliers * drift, 0.0), axis=1)
    for k, element in enumerate(system.forces):
        factor = samples.factors[:, k]
        if not element.acts:
            continue
        if element.kind <= at.FOLLOWING:
            total += factor * _given_power(system, samples, k)
        elif element.law.applied:
            measure: Measured = measured(system, samples, element)
            total += factor * element.law.applied * measure.rate
    return total


def _given_power(system: System, samples: Samples, k: int) -> Array:
    element = system.forces[k]
    B = marker_motion(system, samples, int(system.arrays.force[k, at.F_B]))
    data = np.array(element.data)
    force, torque = data[:3], data[3:]
    if system.planar:
        force, torque = np.array([*data[:2], 0.0]), np.array([0.0, 0.0, data[2]])
    if element.kind == at.FOLLOWING:
        return _dot(B.v, B.R @ force) + _dot(B.w, B.R @ torque)
    return B.v @ force + B.w @ torque


def elastic_state(system: System, samples: Samples, b: int) -> tuple[Array, Array]:
    """Elastic coordinates and their velocities of a body, (nt, nq)."""
    row = system.arrays.body[b]
    p, u = int(row[at.POS] + row[at.NP]), int(row[at.VEL] + row[at.NV])
    nq = int(row[at.NQ])
    return samples.z[:, p - nq : p], samples.v[:, u - nq : u]


def _bodies(system: System) -> list[tuple[int, BodyData]]:
    found = enumerate(system.bodies)
    return [(b, data) for b, data in found if data.of_scene]


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ta,ta->t", a, b)
