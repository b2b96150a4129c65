"""Motion, momenta and stresses of bodies and markers at recorded states.

Planar scenes are embedded in the plane z = 0, so that all vectors have three
components.
"""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.base.stress import (
    node_stress,
    peak_stress,
    stress_nodes,
    stress_norm,
    von_mises,
)
from sidtool.formats.scene import (
    MOMENTA,
    PEAK_STRESS,
    STRESS_NORM,
    STRESSES,
    OutputName,
)

from ..system.rotations import to_3d, to_rotation_matrices
from ..system.system import System
from .energies import elastic_coordinates
from .evaluated_forces import EvaluatedForces
from .samples import Samples


@dataclass(frozen=True, eq=False)
class MarkerMotion:
    """Motion of a marker in inertial axes.

    Attributes
    ----------
    x, v, w : (nt, 3)
        Position, velocity and angular velocity.
    R : (nt, 3, 3)
        Orientation.
    angle
        Angle of a planar marker, counted over full turns [rad].
    """

    x: Array
    v: Array
    R: Array
    w: Array
    angle: Array


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Of a body frame: inertial position X, orientation R; body-resolved V and W."""

    X: Array
    R: Array
    V: Array
    W: Array


def marker_motion(system: System, samples: Samples, m: int) -> MarkerMotion:
    """Motion of the marker in row m of the marker table."""
    point = system.points(samples.points[:, m])
    if system.planar:
        angle = point["angle"]
        R = np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        angle, R = np.full(len(point), np.nan), point["R"]
    x, v, w = (to_3d(point[part]) for part in "xvw")
    return MarkerMotion(x, v, to_rotation_matrices(R), w, angle)


def frame_motion(system: System, samples: Samples, b: int) -> FrameMotion:
    """Motion of the frame of the body in row b of the body table."""
    frame = system.frames(samples.frames[:, b])
    x, v, w = (to_3d(frame[part]) for part in "xvw")
    return FrameMotion(x, to_rotation_matrices(frame["R"]), v, w)


def position_in_body(system: System, samples: Samples, m: int) -> Array:
    """Body-resolved position of a marker on its deformed body, (nt, 3)."""
    return to_3d(system.points(samples.points[:, m])["d"])


def momentum_column(evaluated: EvaluatedForces, owner: str, quantity: str) -> Array:
    """One of `MOMENTA` of a body, or of all if the owner is empty, (nt,).

    Inertial components [kg m/s]; angular ones about the inertial origin [kg m2/s].
    """
    kind, axis = divmod(MOMENTA.index(quantity), 3)
    rows = [evaluated.system.index(owner)] if owner else slice(None)
    values = evaluated.bodies[("momentum", "angular")[kind]][:, rows, axis]
    return np.asarray(values.sum(axis=1))


def stress_column(system: System, samples: Samples, name: OutputName) -> Array:
    """BODY.MARKER.sigma_xx to .von_mises, or BODY.peak_von_mises and .norm_von_mises,
    (nt,) [Pa]."""
    b = system.index(name.owner)
    data = system.bodies[b]
    q, _ = elastic_coordinates(system, samples, b)
    if name.quantity == PEAK_STRESS:
        return peak_stress(data.sid, q)
    if name.quantity == STRESS_NORM:
        return stress_norm(data.sid, q)
    stress = node_stress(data.sid, data.node(name.marker).id, q)
    if name.quantity == STRESSES[-1]:
        return von_mises(stress)
    return stress[:, STRESSES.index(name.quantity)]


def check_stress(system: System, name: OutputName) -> None:
    """Refuse stresses that a SID does not hold.

    Raises
    ------
    InputError
        The body, or the node, has no stress rows.
    """
    data = system.bodies[system.index(name.owner)]
    known = stress_nodes(data.sid)
    place = f"outputs.record, {'.'.join(part for part in name if part)}"
    if not known:
        raise InputError(
            f"the SID of {name.owner} holds no stress",
            place=place,
            expected="a body converted with a table [stress]",
        )
    if name.marker and data.node(name.marker).sigma is None:
        more = ", ..." if len(known) > 8 else ""
        raise InputError(
            f"node {data.node(name.marker).id} of {name.owner} carries no stress",
            place=place,
            expected=f"a marker on one of the nodes {', '.join(known[:8])}{more}",
        )
