"""Multi-blade coordinates of equal bodies around an axis (Coleman transformation).

N equal bodies rotate about an axis, at azimuths psi_k = W t + 2 pi k / N. Their
coordinates, each in the axes of its body, are sums of harmonics over the azimuth,

    x_k = sum_n a_n exp(i n psi_k),    n = -(N - 1) // 2 to (N - 1) // 2,

with n = N / 2 for even N, which alternates and is not rotated. The a_n are seen from
axes that do not turn: on supports that differ by direction the equations of a rotor of
three or more blades are constant in them. At t = 0 they are equivalent to the x_k, and
only their rates differ: x' = a' - W G x with the generator G, which mixes the bodies.

References
----------
R. P. Coleman, A. M. Feingold: Theory of self-excited mechanical oscillations of
helicopter rotors with hinged blades. NACA report 1351, 1958.
W. Johnson: Helicopter Theory, 1980, section 8-4.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sidtool.formats.base.sid import SID, Array

from ..spatial import system_arrays as at
from ..system.rotated_markers import to_3d, to_rotation_matrices
from .dense_equations import DenseEquations
from .reference_axes import EQUAL_ANGULAR_VELOCITY, axis_angular_velocities

Indices = NDArray[np.int64]

#: Least number of bodies around an axis.
LEAST_BLADES = 3
#: Largest distance from equal azimuths [rad], or in sizes of the mechanism.
EQUAL_AZIMUTHS = 1e-6


@dataclass(frozen=True, eq=False)
class BladeGroup:
    """Equal bodies around an axis.

    Attributes
    ----------
    bodies
        Their numbers, in the direction of the rotation.
    speed
        Of the rotation [rad/s].
    """

    bodies: tuple[int, ...]
    speed: float

    @property
    def harmonics(self) -> Array:
        """(N,) of the Fourier transform over the bodies."""
        count = len(self.bodies)
        return np.asarray(np.fft.fftfreq(count, 1.0 / count), float)

    @property
    def generator(self) -> Array:
        """(N, N) of the rotation of the harmonics, per angle."""
        count, orders = len(self.bodies), self.harmonics.copy()
        if count % 2 == 0:
            orders[count // 2] = 0.0
        spread = np.fft.ifft(np.eye(count), axis=0) * count
        return np.asarray((spread * (1j * orders)) @ spread.conj().T / count).real

    def rotated(self, angle: float) -> Array:
        """(N, N) coordinates after a rotation by an angle, of those before it."""
        return np.asarray(expm(angle * self.generator))


def blade_groups(mechanics: DenseEquations) -> tuple[BladeGroup, ...]:
    """Groups of equal bodies around axes, at the state evaluated last."""
    system = mechanics.system
    frames = system.frames(mechanics.work.frame)
    rotations, places = to_rotation_matrices(frames["R"]), to_3d(frames["x"])
    own = axis_angular_velocities(mechanics)
    fastest = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    turning = 3 if system.planar else 6
    rest = [
        k
        for k, (row, body) in enumerate(
            zip(system.arrays.body, system.bodies, strict=True)
        )
        if row[at.RD] == turning
        and body.is_scene_body
        and np.linalg.norm(own[k]) > EQUAL_ANGULAR_VELOCITY * fastest
    ]
    found = []
    while rest:
        first = rest[0]
        alike = [
            k
            for k in rest
            if _are_equal(system.bodies[first].sid, system.bodies[k].sid)
            and np.linalg.norm(own[k] - own[first]) <= EQUAL_ANGULAR_VELOCITY * fastest
        ]
        rest = [k for k in rest if k not in alike]
        if len(alike) >= LEAST_BLADES:
            speed = float(np.linalg.norm(own[first]))
            order = _around(
                rotations[alike],
                places[alike] / system.length,
                own[first] / speed,
            )
            if order is not None:
                found.append(BladeGroup(tuple(alike[i] for i in order), speed))
    return tuple(found)


def _around(rotations: Array, places: Array, axis: Array) -> list[int] | None:
    """The order of bodies at equal azimuths around an axis, None if they are not."""
    count, centre = len(places), places.mean(axis=0)
    turns = rotations @ rotations[0].T
    vectors = Rotation.from_matrix(turns).as_rotvec()
    angles = np.mod(vectors @ axis, 2.0 * np.pi)
    angles[angles > 2.0 * np.pi - EQUAL_AZIMUTHS] = 0.0
    order = np.argsort(angles)
    steps = angles[order] - 2.0 * np.pi * np.arange(count) / count
    moved = turns @ (places[0] - centre) + centre
    across = vectors - np.outer(vectors @ axis, axis)
    errors = *np.abs(steps), *np.abs(across).ravel(), *np.abs(moved - places).ravel()
    if max(errors) > EQUAL_AZIMUTHS:
        return None
    return [int(i) for i in order]


def _are_equal(sid: SID, other: SID) -> bool:
    """Whether two bodies have the same inertia, shape functions and stiffness."""
    if sid is other:
        return True
    if sid.nq != other.nq or sid.mass != other.mass:
        return False
    return all(
        np.array_equal(block.m0, other.blocks[name].m0)
        for name, block in sid.blocks.items()
    )


def mixing_matrix(mechanics: DenseEquations, groups: Sequence[BladeGroup]) -> Array:
    """W (n, n), scaled, of the coordinates of groups, as `frame_rotation_matrix`."""
    n = mechanics.system.n_velocities
    W = np.zeros((n, n))
    for group in groups:
        for i, j, rows, columns in _blocks(mechanics, group):
            W[rows, columns] = group.speed * group.generator[i, j] * np.eye(len(rows))
    return W * mechanics.scale / mechanics.scale[:, None]


def rotated_tangents(
    mechanics: DenseEquations, groups: Sequence[BladeGroup], dt: float, own: Array
) -> Array:
    """Tangents (n, n) of the bodies after a time by multi-blade ones, where those of
    the other bodies are `own`."""
    result = own.copy()
    for group in groups:
        rotated = group.rotated(group.speed * dt)
        for i, j, rows, columns in _blocks(mechanics, group):
            result[rows, columns] = rotated[i, j] * np.eye(len(rows))
    return result


def _blocks(
    mechanics: DenseEquations, group: BladeGroup
) -> Iterator[tuple[int, int, Indices, Indices]]:
    """Numbers of two bodies of a group and where the coordinates of these are."""
    body = mechanics.system.arrays.body
    parts = [
        np.arange(int(body[k, at.VEL]), int(body[k, at.VEL] + body[k, at.NV]))[:, None]
        for k in group.bodies
    ]
    for i, rows in enumerate(parts):
        for j, columns in enumerate(parts):
            yield i, j, rows, columns.T
