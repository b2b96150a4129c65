"""Linear and angular momentum of bodies, from the kinetic energy that moves them.

p = dT/dV and l = dT/dW in the axes of the body frame, l about its origin. T is a
quadratic form of the velocities, so that differences over any step give its
derivatives to rounding.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import MOMENTA
from sidtool.formats.sid import Array

from ..system.scene import System
from .energies import body_kinetic, elastic_state
from .motion import FrameMotion, frame_motion
from .sampling import Samples


def momentum_column(
    system: System, samples: Samples, owner: str, quantity: str
) -> Array:
    """One of `MOMENTA` of a body, or of all if the owner is empty, (nt,).

    Inertial components [kg m/s]; angular ones about the inertial origin [kg m2/s].
    """
    which, axis = divmod(MOMENTA.index(quantity), 3)
    names = [owner] if owner else list(system.scene.bodies)
    return np.asarray(
        sum(
            body_momenta(system, samples, system.index(name))[which][:, axis]
            for name in names
        )
    )


def body_momenta(system: System, samples: Samples, b: int) -> tuple[Array, Array]:
    """Momentum, and angular momentum about the inertial origin, (nt, 3) inertial."""
    frame = frame_motion(system, samples, b)
    q, qd = elastic_state(system, samples, b)
    data, planar = system.bodies[b], system.planar
    fastest = float(np.max(body_kinetic(data, frame, q, qd, planar), initial=0.0))
    speed = np.sqrt(2.0 * fastest / data.sid.mass) or 1.0
    gyration = np.sqrt(data.sid.J.m0[:3, 0].sum() / data.sid.mass) or 1.0
    p, turn = np.zeros((2, len(samples.z), 3))
    for a in range(3):
        for found, step, unit in ((p, speed, 0), (turn, speed / gyration, 1)):
            if planar and (a == 2) != (unit == 1):
                continue
            ends = []
            for sign in (1.0, -1.0):
                V, W = frame.V.copy(), frame.W.copy()
                (V, W)[unit][:, a] += sign * step
                moved = FrameMotion(frame.X, frame.R, V, W)
                ends.append(body_kinetic(data, moved, q, qd, planar))
            found[:, a] = (ends[0] - ends[1]) / (2.0 * step)
    p = np.einsum("tab,tb->ta", frame.R, p)
    turn = np.einsum("tab,tb->ta", frame.R, turn)
    return p, turn + np.cross(frame.X, p)
